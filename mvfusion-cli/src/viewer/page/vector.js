// Vectors of three numbers.

/** @typedef {[number, number, number]} Vector */

/** @type {(a: Vector, b: Vector) => Vector} */
export const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];

/** @type {(a: Vector, b: Vector) => Vector} */
export const subtract = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];

/** @type {(a: Vector, factor: number) => Vector} */
export const scale = (a, factor) => [a[0] * factor, a[1] * factor, a[2] * factor];

/** @type {(a: Vector, b: Vector) => number} */
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

/** @type {(a: Vector, b: Vector) => Vector} */
export const cross = (a, b) => [
  a[1] * b[2] - a[2] * b[1],
  a[2] * b[0] - a[0] * b[2],
  a[0] * b[1] - a[1] * b[0],
];

/** @type {(a: Vector) => number} */
export const length = (a) => Math.hypot(...a);

/**
 * The vector of length 1, or `otherwise` for one that has no direction.
 * @type {(a: Vector, otherwise?: Vector) => Vector}
 */
export const unit = (a, otherwise = [0, 0, 1]) => {
  const size = length(a);
  return size > 1e-12 ? scale(a, 1 / size) : otherwise;
};

/**
 * Turns a vector around an axis of length 1, by an angle in radians (Rodrigues).
 * @type {(a: Vector, axis: Vector, angle: number) => Vector}
 */
export const turn = (a, axis, angle) => {
  const [cos, sin] = [Math.cos(angle), Math.sin(angle)];
  return add(add(scale(a, cos), scale(cross(axis, a), sin)), scale(axis, dot(axis, a) * (1 - cos)));
};

/** @type {(a: Vector, b: Vector, share: number) => Vector} */
export const mix = (a, b, share) => add(scale(a, 1 - share), scale(b, share));
