// Cameras: pinholes in OpenCV axes (x right, y down, z forward), and the one that the pointer moves.

/**
 * A pinhole camera. `rotation` goes from world to camera, by rows.
 * @typedef {object} Camera
 * @property {number} width
 * @property {number} height
 * @property {number} fx
 * @property {number} fy
 * @property {number} cx
 * @property {number} cy
 * @property {number[]} rotation nine numbers
 * @property {number[]} translation
 */

const add = (a, b, scale = 1) => a.map((value, axis) => value + scale * b[axis]);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = a => a.map(value => value / Math.hypot(...a));
const row = (matrix, index) => matrix.slice(3 * index, 3 * index + 3);

/** A vector turned around a unit axis. */
function turned(vector, axis, angle) {
  const [sin, cos] = [Math.sin(angle), Math.cos(angle)];
  const along = (1 - cos) * dot(axis, vector);
  const sideways = cross(axis, vector);
  return vector.map((value, i) => cos * value + sin * sideways[i] + along * axis[i]);
}

/** The quaternion w, x, y, z of a rotation by rows. */
function quaternionOf(m) {
  // Each part times four times the largest one, so that nothing small is divided by.
  const [x, y, z] = [m[7] - m[5], m[2] - m[6], m[3] - m[1]];
  const [xy, xz, yz] = [m[1] + m[3], m[2] + m[6], m[5] + m[7]];
  const candidates = [
    [1 + m[0] + m[4] + m[8], x, y, z],
    [x, 1 + m[0] - m[4] - m[8], xy, xz],
    [y, xy, 1 - m[0] + m[4] - m[8], yz],
    [z, xz, yz, 1 - m[0] - m[4] + m[8]],
  ];
  const largest = candidates.reduce((best, parts, i) => (parts[i] > candidates[best][best] ? i : best), 0);
  return unit(candidates[largest]);
}

/** The rotation by rows of a quaternion w, x, y, z of any length. */
function rotationOf(quaternion) {
  const [w, x, y, z] = quaternion.map(part => part / Math.hypot(...quaternion));
  return [
    1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
    2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
    2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
  ];
}

/** The camera that a reader moves. It looks at a point straight ahead, around which it orbits. */
class Orbit {
  /**
   * @param {number[]} target what the cameras of the scene look at
   * @param {number[]} up
   */
  constructor(target, up) {
    this.target = target;
    this.up = up;
  }

  /**
   * Takes the place of a camera.
   * @param {Camera} camera
   */
  take({ width, height, fx, fy, cx, cy, rotation, translation }) {
    this.rotation = [...rotation];
    this.eye = [0, 1, 2].map(axis => -dot([rotation[axis], rotation[axis + 3], rotation[axis + 6]], translation));
    const ahead = dot(add(this.target, this.eye, -1), row(rotation, 2));
    this.distance = ahead > 0 ? ahead : Math.hypot(...add(this.target, this.eye, -1)) || 1;
    // Half sides of the image and its shift, at depth 1.
    this.half = [width / 2 / fx, height / 2 / fy];
    this.shift = [(cx - width / 2) / fx, (cy - height / 2) / fy];
  }

  /**
   * The camera for an image of this size. It shows at least what the camera showed whose place was taken.
   * @param {number} width
   * @param {number} height
   * @returns {Camera}
   */
  camera(width, height) {
    const [fx, fy] = [width, height].map((side, axis) => side / 2 / this.half[axis]);
    const focal = Math.min(fx, fy);
    const translation = [0, 1, 2].map(axis => -dot(row(this.rotation, axis), this.eye));
    const [cx, cy] = [width / 2 + focal * this.shift[0], height / 2 + focal * this.shift[1]];
    return { width, height, fx: focal, fy: focal, cx, cy, rotation: this.rotation, translation };
  }

  /** Turns around the point ahead: around the vertical, and up or down; in radians. */
  orbit(yaw, pitch) {
    const centre = add(this.eye, row(this.rotation, 2), this.distance);
    const right = row(this.rotation, 0);
    // Not beyond the poles, where left and right would change places.
    const height = Math.asin(Math.max(-1, Math.min(1, dot(row(this.rotation, 2), this.up))));
    const tilt = Math.max(-1.5 - height, Math.min(1.5 - height, pitch));
    const turn = vector => turned(turned(vector, right, tilt), this.up, yaw);
    const [across, ahead] = [unit(turn(right)), unit(turn(row(this.rotation, 2)))];
    this.rotation = [...across, ...cross(ahead, across), ...ahead];
    this.eye = add(centre, ahead, -this.distance);
  }

  /** Moves sideways by shares of the image's height. */
  pan(x, y) {
    const height = 2 * this.half[1] * this.distance;
    this.eye = add(add(this.eye, row(this.rotation, 0), -x * height), row(this.rotation, 1), -y * height);
  }

  /** Moves to `factor` times the distance from the point ahead. */
  zoom(factor) {
    this.eye = add(this.eye, row(this.rotation, 2), this.distance * (1 - factor));
    this.distance *= factor;
  }

  /** The pose as short text: centre, quaternion, distance of the point ahead, half of the height at depth 1. */
  toString() {
    const numbers = [...this.eye, ...quaternionOf(this.rotation), this.distance, this.half[1]];
    return numbers.map(number => +number.toPrecision(7)).join(',');
  }

  /**
   * Takes the pose of such a text; other texts change nothing.
   * @param {string} text
   */
  parse(text) {
    const numbers = text.split(',').map(Number);
    if (numbers.length !== 9 || !numbers.every(Number.isFinite) || !(numbers[7] > 0 && numbers[8] > 0)) return;
    if (!(Math.hypot(...numbers.slice(3, 7)) > 0.5)) return;
    this.eye = numbers.slice(0, 3);
    this.rotation = rotationOf(numbers.slice(3, 7));
    this.distance = numbers[7];
    this.half = this.half.map(half => (half * numbers[8]) / this.half[1]);
  }
}
