// Where the camera stands, and how it moves. Axes as in the program: right, down, forward (OpenCV).

import { add, cross, dot, scale, subtract, turn, unit } from './vector.js';

/** @typedef {import('./vector.js').Vector} Vector */

/** The camera comes no nearer than this to looking along the up axis, radians. */
const POLE = 0.05;

/** The camera and its target come no farther than this from the origin along any axis: the server refuses 1e9. */
const FARTHEST = 1e8;

export class Pose {
  /**
   * @param {Vector} position
   * @param {Vector} forward
   * @param {Vector} down need not be at right angles to `forward`
   * @param {number} distance to the point that an orbit goes around
   */
  constructor(position, forward, down, distance) {
    this.position = /** @type {Vector} */ (position.map((place) => Math.min(FARTHEST, Math.max(-FARTHEST, place))));
    this.forward = unit(forward);
    this.right = unit(cross(down, this.forward), unit(cross([0.3, 0.9, 0.2], this.forward)));
    this.down = cross(this.forward, this.right);
    this.distance = Math.min(FARTHEST, Math.max(distance, 1e-6));
  }

  /**
   * @param {Vector} position
   * @param {Vector[]} rows camera to world
   * @param {number} distance
   */
  static of(position, rows, distance) {
    const column = (/** @type {number} */ c) => /** @type {Vector} */ (rows.map((row) => row[c]));
    return new Pose(position, column(2), column(1), distance);
  }

  /** The point that an orbit goes around. */
  get target() {
    return add(this.position, scale(this.forward, this.distance));
  }

  /** Camera to world, by rows. */
  get rows() {
    return [0, 1, 2].map((row) => [this.right[row], this.down[row], this.forward[row]]);
  }

  /** The same camera elsewhere. @param {Vector} by */
  moved(by) {
    return new Pose(add(this.position, by), this.forward, this.down, this.distance);
  }

  /**
   * Turns around the target: the scene follows the pointer.
   * @param {number} x radians to the right
   * @param {number} y radians downwards
   * @param {Vector} up
   */
  orbited(x, y, up) {
    const turned = this.looked(-x, -y, up);
    const position = subtract(this.target, scale(turned.forward, this.distance));
    return new Pose(position, turned.forward, turned.down, this.distance);
  }

  /**
   * Turns on the spot.
   * @param {number} x radians around the up axis
   * @param {number} y radians around the right axis
   * @param {Vector} up
   */
  looked(x, y, up) {
    // How far the direction is from straight down, and may still turn.
    const tilt = Math.acos(Math.min(1, Math.max(-1, -dot(this.forward, up))));
    const pitch = Math.min(Math.PI - POLE, Math.max(POLE, tilt + y)) - tilt;
    const both = (/** @type {Vector} */ axis) => turn(turn(axis, this.right, pitch), up, x);
    return new Pose(this.position, both(this.forward), both(this.down), this.distance);
  }

  /** Nearer to the target for a factor below 1, and farther for one above. @param {number} factor */
  zoomed(factor) {
    const distance = Math.min(FARTHEST, this.distance * factor);
    return new Pose(subtract(this.target, scale(this.forward, distance)), this.forward, this.down, distance);
  }

  /** Moves along its own axes. @param {number} right @param {number} down @param {number} forward */
  shifted(right, down, forward) {
    return this.moved(add(add(scale(this.right, right), scale(this.down, down)), scale(this.forward, forward)));
  }

  /**
   * Stands upright as far as the direction allows.
   * @param {Vector} up
   */
  upright(up) {
    return new Pose(this.position, this.forward, scale(up, -1), this.distance);
  }
}

/**
 * A pinhole for drawing over a picture.
 * @typedef {{ position: Vector, rows: number[][], fx: number, fy: number, cx: number, cy: number }} Pinhole
 */

/**
 * The pixel of a point, with its depth; depths at or below zero are behind the camera.
 * @param {Pinhole} camera
 * @param {ArrayLike<number>} point
 * @returns {[number, number, number]}
 */
export function project(camera, point) {
  const { rows, position } = camera;
  const [x, y, z] = [point[0] - position[0], point[1] - position[1], point[2] - position[2]];
  const along = (/** @type {number} */ c) => rows[0][c] * x + rows[1][c] * y + rows[2][c] * z;
  const depth = along(2);
  return [(camera.fx * along(0)) / depth + camera.cx, (camera.fy * along(1)) / depth + camera.cy, depth];
}
