'use strict';
// A worker that sorts Gaussians by depth, the farthest first.

/** The last centres of each branch: x, y, z of each Gaussian; not a number where it cannot be seen. */
const centres = new Map();

/**
 * The Gaussians beyond the near plane, the farthest first; of two at one depth, the one with the higher index first.
 * A radix sort by the bits of the depths, which have the order of positive floats, in two digits.
 * @param {Float32Array} points
 * @param {number[]} axis forward axis of the camera and the depth of the origin: a, b, c, d
 * @param {number} near
 * @returns {Uint32Array}
 */
function farthestFirst(points, [a, b, c, d], near) {
  const total = points.length / 3;
  const depths = new Float32Array(total);
  let ids = new Uint32Array(total);
  let count = 0;
  for (let index = total - 1; index >= 0; index--) {
    const depth = a * points[3 * index] + b * points[3 * index + 1] + c * points[3 * index + 2] + d;
    // False for NaN.
    if (depth > near) {
      depths[count] = depth;
      ids[count++] = index;
    }
  }
  let keys = new Uint32Array(depths.buffer);
  for (let place = 0; place < count; place++) keys[place] = ~keys[place];
  for (const shift of [0, 16]) {
    const starts = new Uint32Array(0x10001);
    for (let place = 0; place < count; place++) starts[((keys[place] >>> shift) & 0xffff) + 1]++;
    for (let digit = 1; digit < starts.length; digit++) starts[digit] += starts[digit - 1];
    const [sortedIds, sortedKeys] = [new Uint32Array(count), new Uint32Array(count)];
    for (let place = 0; place < count; place++) {
      const to = starts[(keys[place] >>> shift) & 0xffff]++;
      sortedIds[to] = ids[place];
      sortedKeys[to] = keys[place];
    }
    [ids, keys] = [sortedIds, sortedKeys];
  }
  return ids;
}

onmessage = ({ data: { ticket, branch, points, axis, near } }) => {
  if (points) centres.set(branch, points);
  const order = farthestFirst(centres.get(branch), axis, near);
  postMessage({ ticket, order }, [order.buffer]);
};
