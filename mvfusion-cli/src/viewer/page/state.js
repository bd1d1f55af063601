// What is shown, and what the page begins with.

import { Pose } from './pose.js';

/** @typedef {{ set: 'train' | 'test', index: number }} ViewId */

/**
 * Everything that an address holds.
 * @typedef {object} State
 * @property {Pose} pose
 * @property {number} fov vertical, degrees
 * @property {number | null} time `null` for the static scene alone
 * @property {string} layer
 * @property {boolean} mfta
 * @property {string} background
 * @property {string} up
 * @property {number} largest longest side of a picture, pixels
 * @property {ViewId | undefined} view the view whose camera is shown, until it is moved
 * @property {number | undefined} split where its photo ends
 * @property {boolean} frusta
 * @property {boolean} points
 * @property {number} pace speed of the timeline
 * @property {boolean} loop whether it begins anew at its end
 * @property {number} speed of flight, as a power of two
 */

/**
 * The view that the page begins with: the first held-out camera, looked at freely.
 * @param {any} scene
 * @returns {State}
 */
export function beginning(scene) {
  const view = scene.test[0] ?? scene.train[0];
  const camera = scene.cameras[view[1]];
  return {
    pose: poseOf(scene, camera), fov: fovOf(camera), time: view[2], layer: 'composed', mfta: true, background: 'run',
    up: 'scene', largest: scene.training ? 640 : 1280, view: undefined, split: undefined, frusta: false,
    points: false, pace: 1, loop: true, speed: 0,
  };
}

/** The pose of a camera of the scene. @param {any} scene @param {any} camera */
export function poseOf(scene, camera) {
  const pose = Pose.of(camera.position, camera.rotation, 1);
  const ahead = [0, 1, 2].map((i) => (scene.target[i] - camera.position[i]) * pose.forward[i]);
  const distance = ahead.reduce((a, b) => a + b);
  return Pose.of(camera.position, camera.rotation, distance > 0 ? distance : scene.extent || 1);
}

/** Vertical field of view in degrees. @param {any} camera */
export function fovOf(camera) {
  return (360 / Math.PI) * Math.atan(camera.height / (2 * camera.fy));
}
