// What is drawn on the canvas: the rendered picture, the photo beside it, cameras and points over both.

import { project } from './pose.js';

/** @typedef {import('./pose.js').Pinhole} Pinhole */

/** Depth of the drawn frusta, in extents of the scene. */
const FRUSTUM = 0.08;

export class Picture {
  /** @param {HTMLCanvasElement} canvas */
  constructor(canvas) {
    this.canvas = canvas;
    this.context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext('2d'));
    /** @type {ImageBitmap | undefined} */
    this.bitmap = undefined;
    /** The JPEG file of the picture. @type {Blob | undefined} */
    this.file = undefined;
    /** @type {HTMLImageElement | undefined} */
    this.photo = undefined;
    /** Where the photo ends, as a share of the width; `undefined` without one. @type {number | undefined} */
    this.split = undefined;
    /** What is said of the photo. */
    this.caption = 'photo';
  }

  /** Fits the canvas to its place on the page. Returns whether its size has changed. */
  fit() {
    const dense = Math.min(devicePixelRatio || 1, 2);
    const { clientWidth, clientHeight } = this.canvas;
    const [width, height] = [clientWidth, clientHeight].map((side) => Math.max(1, Math.round(side * dense)));
    if (this.canvas.width === width && this.canvas.height === height) return false;
    Object.assign(this.canvas, { width, height });
    return true;
  }

  /** The rectangle of a picture with this ratio of width to height. @param {number} aspect */
  place(aspect) {
    const { width, height } = this.canvas;
    const shown = width / height > aspect ? [height * aspect, height] : [width, width / aspect];
    return { x: (width - shown[0]) / 2, y: (height - shown[1]) / 2, width: shown[0], height: shown[1] };
  }

  /** The same rectangle from left to right, in pixels of the page. @param {number} aspect */
  span(aspect) {
    const { x, width } = this.place(aspect);
    const dense = this.canvas.width / Math.max(1, this.canvas.clientWidth);
    return { left: x / dense, width: width / dense };
  }

  /**
   * Takes a picture, unless a newer one has come meanwhile. Whether it was taken.
   * @param {Blob} file
   * @param {() => boolean} isNewest
   */
  async take(file, isNewest) {
    const bitmap = await createImageBitmap(file);
    if (!isNewest()) {
      bitmap.close();
      return false;
    }
    this.bitmap?.close();
    [this.bitmap, this.file] = [bitmap, file];
    return true;
  }

  /**
   * @param {number} aspect
   * @param {Pinhole} camera in pixels of a picture that is 1 high
   * @param {{ scene: any, points?: Points, frusta: boolean }} overlay
   */
  draw(aspect, camera, overlay) {
    const { context, canvas, bitmap, photo } = this;
    const { x, y, width, height } = this.place(aspect);
    context.clearRect(0, 0, canvas.width, canvas.height);
    if (bitmap) context.drawImage(bitmap, x, y, width, height);
    if (this.split !== undefined && photo?.complete && photo.naturalWidth > 0) {
      const line = x + width * this.split;
      context.save();
      context.beginPath();
      context.rect(x, y, width * this.split, height);
      context.clip();
      context.drawImage(photo, x, y, width, height);
      context.restore();
      stroke(context, [[line, y], [line, y + height]], '#fff', 2);
      label(context, this.caption, [line - 8, y], 'right');
      label(context, 'render', [line + 8, y], 'left');
    }
    const { fx, fy, cx, cy } = camera;
    const placed = { ...camera, fx: fx * height, fy: fy * height, cx: x + cx * height, cy: y + cy * height };
    context.save();
    context.beginPath();
    context.rect(x, y, width, height);
    context.clip();
    if (overlay.points) this.#points(placed, overlay.points);
    if (overlay.frusta) this.#frusta(placed, overlay.scene);
    context.restore();
  }

  /** @param {Pinhole} camera @param {Points} points */
  #points(camera, points) {
    const size = Math.max(2, this.canvas.height / 300);
    for (let index = 0; index < points.count; index += 1) {
      const [x, y, depth] = project(camera, points.places.subarray(3 * index, 3 * index + 3));
      if (depth <= 0) continue;
      const [r, g, b] = points.colours.subarray(3 * index, 3 * index + 3);
      this.context.fillStyle = `rgb(${r} ${g} ${b})`;
      this.context.fillRect(x - size / 2, y - size / 2, size, size);
    }
  }

  /** @param {Pinhole} camera @param {any} scene */
  #frusta(camera, scene) {
    const held = new Set(scene.test.map((/** @type {any} */ view) => view[1]));
    const depth = FRUSTUM * (scene.extent || 1);
    scene.cameras.forEach((/** @type {any} */ other, /** @type {number} */ index) => {
      const corner = (/** @type {number} */ u, /** @type {number} */ v) => {
        const [x, y] = [((u - other.cx) / other.fx) * depth, ((v - other.cy) / other.fy) * depth];
        return other.rotation.map((/** @type {number[]} */ row, /** @type {number} */ i) =>
          other.position[i] + row[0] * x + row[1] * y + row[2] * depth);
      };
      const { width, height } = other;
      const corners = [corner(0, 0), corner(width, 0), corner(width, height), corner(0, height)];
      const seen = [other.position, ...corners].map((point) => project(camera, point));
      if (seen.some((point) => point[2] <= 1e-6)) return;
      const [tip, a, b, c, d] = seen.map((point) => [point[0], point[1]]);
      const colour = held.has(index) ? '#ff9f1a' : '#35a7ff';
      for (const line of [[a, b, c, d, a], [tip, a], [tip, b], [tip, c], [tip, d]]) {
        stroke(this.context, line, colour, 1.5);
      }
    });
  }

  /** The picture alone as a file. @param {'image/png' | 'image/jpeg'} type */
  async saved(type) {
    if (!this.bitmap || type === 'image/jpeg') return this.file;
    const canvas = new OffscreenCanvas(this.bitmap.width, this.bitmap.height);
    canvas.getContext('2d')?.drawImage(this.bitmap, 0, 0);
    return canvas.convertToBlob({ type });
  }
}

/**
 * @param {CanvasRenderingContext2D} context
 * @param {string} text
 * @param {number[]} at
 * @param {CanvasTextAlign} align
 */
function label(context, text, [x, y], align) {
  const size = 13 * Math.min(devicePixelRatio || 1, 2);
  Object.assign(context, { font: `600 ${size}px system-ui, sans-serif`, textAlign: align, textBaseline: 'top' });
  // Readable on any photo.
  Object.assign(context, { fillStyle: '#fff', strokeStyle: '#000', lineWidth: 3, lineJoin: 'round' });
  context.strokeText(text, x, y + 8);
  context.fillText(text, x, y + 8);
}

/** @param {CanvasRenderingContext2D} context @param {number[][]} line @param {string} colour @param {number} width */
function stroke(context, line, colour, width) {
  context.strokeStyle = colour;
  context.lineWidth = width;
  context.beginPath();
  line.forEach(([x, y], index) => (index === 0 ? context.moveTo(x, y) : context.lineTo(x, y)));
  context.stroke();
}

/**
 * Points of the scene.
 * @typedef {{ count: number, places: Float32Array, colours: Uint8Array }} Points
 */

/** @param {number} count @returns {Promise<Points>} */
export async function loadPoints(count) {
  const bytes = await (await fetch('points.bin')).arrayBuffer();
  return { count, places: new Float32Array(bytes, 0, 3 * count), colours: new Uint8Array(bytes, 12 * count) };
}
