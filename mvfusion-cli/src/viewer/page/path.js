// A camera path: keys with a pose, a field of view and a time, and smooth frames between them.

import { Pose } from './pose.js';
import { add, mix, scale, subtract } from './vector.js';

/** @typedef {import('./vector.js').Vector} Vector */
/** @typedef {{ pose: Pose, fov: number, time: number }} Key */

/** Frames per second of a saved path. */
export const FPS = 30;
/** Allowed fields of view, degrees. */
const FIELDS_OF_VIEW = /** @type {[number, number]} */ ([1, 170]);
/** Largest coordinate. */
const FARTHEST = 1e9;

/**
 * The camera between the keys.
 * @param {Key[]} keys
 * @param {number} at in keys from the first: 1.5 is halfway from the second to the third
 * @returns {Key}
 */
export function between(keys, at) {
  const index = Math.max(0, Math.min(keys.length - 2, Math.floor(at)));
  const share = Math.max(0, Math.min(1, at - index));
  const key = (/** @type {number} */ i) => keys[Math.max(0, Math.min(keys.length - 1, i))];
  const [a, b] = [key(index), key(index + 1)];
  const number = (/** @type {'fov' | 'time'} */ name) => a[name] + (b[name] - a[name]) * share;
  const curve = (/** @type {(key: Key) => Vector} */ value) =>
    catmullRom([-1, 0, 1, 2].map((step) => value(key(index + step))), share);
  // Both ends of an axis are kept, and the axes between them are made orthogonal again.
  const axis = (/** @type {'forward' | 'down'} */ name) => mix(a.pose[name], b.pose[name], smooth(share));
  const distance = a.pose.distance + (b.pose.distance - a.pose.distance) * share;
  const pose = new Pose(curve((each) => each.pose.position), axis('forward'), axis('down'), distance);
  return { pose, fov: number('fov'), time: number('time') };
}

/** @param {number} share */
const smooth = (share) => share * share * (3 - 2 * share);

/** A smooth curve through the two middle ones of four points. @param {Vector[]} points @param {number} t */
function catmullRom([p0, p1, p2, p3], t) {
  const [a, b] = [scale(subtract(p2, p0), 0.5), scale(subtract(p3, p1), 0.5)];
  const [t2, t3] = [t * t, t * t * t];
  const ends = add(scale(p1, 2 * t3 - 3 * t2 + 1), scale(p2, -2 * t3 + 3 * t2));
  return add(ends, add(scale(a, t3 - 2 * t2 + t), scale(b, t3 - t2)));
}

/** Frames from one key to the next. @param {number} seconds */
const stepsOf = (seconds) => Math.max(1, Math.round(seconds * FPS));

/** Frames of a path. @param {number} keys @param {number} seconds from one key to the next */
export const count = (keys, seconds) => (keys > 1 ? (keys - 1) * stepsOf(seconds) + 1 : keys);

/**
 * The file of a path, in the format of nerfstudio's viewer. The keys are kept in it, so that it can be opened again.
 * @param {Key[]} keys
 * @param {number} seconds from one key to the next
 * @param {[number, number]} size
 */
export function toFile(keys, seconds, [width, height]) {
  const steps = stepsOf(seconds);
  const frame = (/** @type {number} */ index) => (keys.length === 1 ? keys[0] : between(keys, index / steps));
  const frames = Array.from({ length: count(keys.length, seconds) }, (_, index) => frame(index));
  const aspect = width / height;
  const entry = (/** @type {Key} */ { pose, fov, time }) =>
    ({ camera_to_world: matrix(pose), fov, aspect, render_time: time });
  return {
    camera_type: 'perspective',
    render_width: width,
    render_height: height,
    fps: FPS,
    seconds: frames.length / FPS,
    camera_path: frames.map(entry),
    mvfusion_keys: { seconds, keys: keys.map((key) => ({ ...entry(key), distance: key.pose.distance })) },
  };
}

/** @param {unknown} value @param {number} low @param {number} high */
const lies = (value, low, high) => typeof value === 'number' && value >= low && value <= high;

/**
 * The keys of such a file; of a file without keys, its frames. What is wrong with it is an error.
 * @param {any} file
 * @returns {{ seconds: number, keys: Key[] }}
 */
export function fromFile(file) {
  const found = file?.mvfusion_keys ?? { seconds: 1 / (file?.fps ?? FPS), keys: file?.camera_path };
  if (!Array.isArray(found.keys) || found.keys.length === 0) throw new Error('it lists no cameras');
  const key = (/** @type {any} */ entry, /** @type {number} */ index) => {
    const wrong = (/** @type {string} */ what) => new Error(`camera ${index}: ${what}`);
    const m = entry?.camera_to_world;
    const isMatrix = Array.isArray(m) && m.length === 16 && m.every((value) => lies(value, -FARTHEST, FARTHEST));
    if (!isMatrix) throw wrong(`its camera_to_world must be 16 numbers up to ${FARTHEST}`);
    if (!lies(entry.fov, ...FIELDS_OF_VIEW)) throw wrong(`its fov must lie in ${FIELDS_OF_VIEW.join(' to ')} degrees`);
    const time = entry.render_time ?? entry.time ?? 0;
    if (!lies(time, 0, 1)) throw wrong('its render_time must lie in 0 to 1');
    const column = (/** @type {number} */ c) => /** @type {Vector} */ ([m[c], m[4 + c], m[8 + c]]);
    const distance = lies(entry.distance, 0, FARTHEST) ? entry.distance : 1;
    return { pose: new Pose(column(3), scale(column(2), -1), scale(column(1), -1), distance), fov: entry.fov, time };
  };
  const seconds = lies(found.seconds, 1e-3, 3600) ? found.seconds : 1 / FPS;
  return { seconds, keys: found.keys.map(key) };
}

/** Camera to world by rows, in axes of OpenGL: right, up, backwards. @param {Pose} pose */
function matrix(pose) {
  const row = (/** @type {number} */ i) => [pose.right[i], -pose.down[i], -pose.forward[i], pose.position[i]];
  return [...row(0), ...row(1), ...row(2), 0, 0, 0, 1];
}
