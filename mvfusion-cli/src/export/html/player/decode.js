// The Gaussians of the page: from text to numbers at keyframes.

/**
 * A quantity of all Gaussians of a branch: `offset + step * level`.
 * @typedef {object} Track
 * @property {(Int16Array | Int32Array)[]} columns integers, keyframe by keyframe, then Gaussian by Gaussian
 * @property {number} offset
 * @property {number} step
 */

/**
 * The Gaussians of a branch.
 * @typedef {object} Branch
 * @property {number} count
 * @property {number} degree of the spherical harmonics
 * @property {number[]} times of the keyframes, ascending
 * @property {Object<string, Track>} tracks by name: mean, log_scale, rotation, opacity, mask, brightness,
 *   sh_dc, sh_rest
 */

/**
 * Bytes from base64 of a zlib stream.
 * @param {string} text
 * @returns {Promise<Uint8Array>}
 */
async function unpack(text) {
  const letters = atob(text);
  const packed = new Uint8Array(letters.length);
  for (let place = 0; place < packed.length; place++) packed[place] = letters.charCodeAt(place);
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream('deflate'));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/**
 * A column from its bytes: differences to the keyframe before, Gaussian by Gaussian, the lowest bytes of all first.
 * @param {object} layout of the track
 * @param {Uint8Array} planes
 * @param {number} count of Gaussians
 * @returns {Int16Array | Int32Array}
 */
function decodeColumn({ keyframes, bytes, chained }, planes, count) {
  const total = keyframes * count;
  const column = new Int32Array(total);
  let [first, least, most] = [0, 0, 0];
  for (let row = 0; row < count; row++) {
    let value = chained ? first : 0;
    for (let k = 0; k < keyframes; k++) {
      let number = 0;
      for (let byte = 0; byte < bytes; byte++) number |= planes[byte * total + row * keyframes + k] << (8 * byte);
      value += (number >>> 1) ^ -(number & 1);
      column[k * count + row] = value;
      if (k === 0) first = value;
      if (value < least) least = value;
      if (value > most) most = value;
    }
  }
  return least >= -0x8000 && most < 0x8000 ? Int16Array.from(column) : column;
}

/**
 * The branches of a page from their bytes, which follow each other.
 * @param {object[]} layouts
 * @param {Uint8Array} planes
 * @returns {Branch[]}
 */
function decodeBranches(layouts, planes) {
  let place = 0;
  return layouts.map(({ count, sh_degree: degree, times, tracks: listed }) => {
    const tracks = {};
    for (const layout of listed) {
      const size = layout.bytes * layout.keyframes * count;
      const columns = Array.from({ length: layout.columns }, () => {
        place += size;
        return decodeColumn(layout, planes.subarray(place - size, place), count);
      });
      tracks[layout.name] = { columns, offset: layout.offset, step: layout.step };
    }
    return { count, degree, times, tracks };
  });
}

/**
 * The keyframes around a time, and the weight of the later one. Before the first and after the last, time stands still.
 * @param {number[]} times
 * @param {number} time
 * @returns {{ before: number, after: number, weight: number }}
 */
function bracketOf(times, time) {
  let after = times.findIndex(t => t > time);
  if (after < 0) after = times.length;
  if (after === 0) return { before: 0, after: 0, weight: 0 };
  if (after === times.length) return { before: after - 1, after: after - 1, weight: 0 };
  const before = after - 1;
  return { before, after, weight: (time - times[before]) / (times[after] - times[before]) };
}

/**
 * The centres at a time, for sorting. Those of Gaussians that cannot be seen are not numbers.
 * @param {Branch} branch
 * @param {{ before: number, after: number, weight: number }} bracket
 * @returns {Float32Array}
 */
function centresAt({ count, tracks: { mean, opacity } }, { before, after, weight }) {
  const points = new Float32Array(3 * count);
  const [opacities] = opacity.columns;
  // The integer of an opacity of 0.
  const nothing = Math.round(-opacity.offset / opacity.step);
  const [first, second] = [before * count, after * count];
  for (let row = 0; row < count; row++) {
    const isSeen = opacities[first + row] > nothing || opacities[second + row] > nothing;
    for (let axis = 0; axis < 3; axis++) {
      const column = mean.columns[axis];
      const level = (1 - weight) * column[first + row] + weight * column[second + row];
      points[3 * row + axis] = isSeen ? mean.offset + mean.step * level : NaN;
    }
  }
  return points;
}
