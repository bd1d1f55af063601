// Curves of the training.

/** @typedef {[step: number, loss: number, psnr: number | null]} Point */

/** Most points that are kept. Above that, every second one goes. */
const MOST = 2000;

export class Curves {
  /** @param {HTMLCanvasElement} loss @param {HTMLCanvasElement} psnr */
  constructor(loss, psnr) {
    this.charts = [
      {
        canvas: loss,
        value: (/** @type {Point} */ point) => Math.log10(Math.max(point[1], 1e-9)),
        text: (/** @type {number} */ value) => (10 ** value).toPrecision(2),
      },
      {
        canvas: psnr,
        value: (/** @type {Point} */ point) => point[2] ?? NaN,
        text: (/** @type {number} */ value) => value.toFixed(1),
      },
    ];
    /** @type {Point[]} */
    this.points = [];
  }

  /** Adds points of later steps. Points of earlier ones mean that the training began anew. @param {Point[]} points */
  add(points) {
    if (points.length === 0) return;
    const last = this.points.at(-1);
    if (last && points[0][0] <= last[0]) this.points = this.points.filter((point) => point[0] < points[0][0]);
    this.points.push(...points);
    while (this.points.length > MOST) this.points = this.points.filter((_, index) => index % 2 === 1);
    this.draw();
  }

  draw() {
    for (const { canvas, value, text } of this.charts) {
      const points = this.points.map((point) => [point[0], value(point)]).filter((point) => Number.isFinite(point[1]));
      drawChart(canvas, points, text);
    }
  }
}

/** @param {HTMLCanvasElement} canvas @param {number[][]} points @param {(value: number) => string} text */
function drawChart(canvas, points, text) {
  const dense = devicePixelRatio || 1;
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  if (width === 0 || points.length === 0) return;
  [canvas.width, canvas.height] = [width * dense, height * dense];
  const context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext('2d'));
  const style = getComputedStyle(canvas);
  context.scale(dense, dense);
  const values = points.map((point) => point[1]);
  let [low, high] = [Math.min(...values), Math.max(...values)];
  if (high - low < 1e-6) [low, high] = [low - 0.5, high + 0.5];
  const [first, last] = [points[0][0], points[points.length - 1][0]];
  const left = 38;
  const at = (/** @type {number[]} */ [step, value]) => [
    left + ((width - left - 4) * (step - first)) / Math.max(1, last - first),
    6 + (height - 22) * (1 - (value - low) / (high - low)),
  ];
  context.font = `11px ${style.fontFamily}`;
  context.fillStyle = style.getPropertyValue('--quiet');
  context.textAlign = 'right';
  context.fillText(text(high), left - 4, 12);
  context.fillText(text(low), left - 4, height - 14);
  context.fillText(String(last), width - 4, height - 2);
  context.textAlign = 'left';
  context.fillText(`step ${first}`, left, height - 2);
  context.strokeStyle = style.getPropertyValue('--accent');
  context.lineWidth = 1.5;
  context.beginPath();
  points.map(at).forEach(([x, y], index) => (index === 0 ? context.moveTo(x, y) : context.lineTo(x, y)));
  context.stroke();
  canvas.setAttribute('aria-label', `from ${text(values[0])} to ${text(values[values.length - 1])} at step ${last}`);
}
