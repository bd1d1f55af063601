// The player: its state, its frames, and its interface for other scripts.

/** Training times in a second of the film at speed 1, and its least length in seconds. */
const TIMES_PER_SECOND = 30;
const LEAST_SECONDS = 2;
/** Most pixels of the image. */
const MOST_PIXELS = 3e6;
/** A frame that takes longer, in milliseconds, is drawn with fewer pixels while something moves. */
const SLOW = 50;
/** So long after the last motion, in milliseconds, the image is drawn with all pixels. */
const STILL = 250;

/** Plays a scene in a canvas. */
class Player {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {HTMLFormElement} form
   * @param {object} scene
   * @param {Branch[]} branches
   */
  constructor(canvas, form, scene, branches) {
    Object.assign(this, { canvas, form, scene, isPlaying: false, speed: 1, loops: true, layer: LAYERS[0] });
    // A camera that is shown exactly; the share of the pixels along a side that are drawn.
    Object.assign(this, { fixed: null, sharpness: 1, movedAt: -Infinity, drawnAt: null });
    // Whether the order belongs to another camera or time; whether the image does.
    Object.assign(this, { isSorting: false, isStale: true, isDirty: true });
    this.renderer = new Renderer(canvas, scene, branches);
    this.orbit = new Orbit(scene.target, scene.up);
    this.orbit.take(scene.cameras[0]);
    this.time = scene.cameras[0].time ?? scene.span[0];
    followPointers(canvas, this.orbit, () => this.moved());
    connectControls(form, this);
    new ResizeObserver(() => this.changed()).observe(canvas);
    canvas.addEventListener('webglcontextlost', event => {
      event.preventDefault();
      showMessage('The graphics driver has dropped the scene. It comes back as soon as the driver allows.');
    });
    canvas.addEventListener('webglcontextrestored', () => attempt(() => {
      this.renderer.create();
      showMessage('');
      this.changed();
    }));
    const frame = now => {
      attempt(() => this.frame(now));
      requestAnimationFrame(frame);
    };
    requestAnimationFrame(frame);
  }

  /** The camera of the next image. */
  get camera() {
    if (this.fixed) return this.fixed;
    const ratio = Math.min(2, devicePixelRatio || 1) * this.sharpness;
    const pixels = this.canvas.clientWidth * this.canvas.clientHeight * ratio ** 2;
    const scale = ratio * Math.min(1, Math.sqrt(MOST_PIXELS / Math.max(1, pixels)));
    const side = length => Math.max(1, Math.round(scale * length));
    return this.orbit.camera(side(this.canvas.clientWidth), side(this.canvas.clientHeight));
  }

  /** What is shown is no longer what should be. */
  changed() {
    Object.assign(this, { isStale: true, isDirty: true });
  }

  /** The reader has moved the camera. */
  moved() {
    if (this.fixed) Object.assign(this.canvas.style, { width: '', height: '' });
    Object.assign(this, { fixed: null, movedAt: performance.now() });
    this.changed();
    clearTimeout(this.writing);
    this.writing = setTimeout(() => writeAddress(this), STILL);
  }

  /** One frame of the browser. */
  frame(now) {
    if (this.isPlaying && this.playedAt !== undefined) this.advance((now - this.playedAt) / 1000);
    this.playedAt = this.isPlaying ? now : undefined;
    this.adapt(now);
    if (this.isStale && !this.isSorting) this.sort();
    if (!this.isDirty) return;
    this.isDirty = false;
    this.renderer.draw(this.camera, this.time, this.layer);
    showState(this.form, this);
  }

  /** Fewer pixels while something moves too slowly, all of them when it stands still. */
  adapt(now) {
    const isMoving = this.isPlaying || now - this.movedAt < STILL;
    const took = this.drawnAt === null ? 0 : now - this.drawnAt;
    this.drawnAt = isMoving ? now : null;
    const wanted = !isMoving ? 1 : took > SLOW ? Math.max(0.4, 0.8 * this.sharpness) : this.sharpness;
    if (wanted !== this.sharpness && !this.fixed) {
      this.sharpness = wanted;
      this.isDirty = true;
    }
  }

  /** Sorts for the present camera and time; the image follows when that is done. */
  async sort() {
    this.isStale = false;
    this.isSorting = true;
    try {
      await this.renderer.sort(this.camera, this.time);
    } finally {
      this.isSorting = false;
      this.isDirty = true;
    }
  }

  advance(seconds) {
    const [first, last] = this.scene.span;
    const length = Math.max(LEAST_SECONDS, this.scene.training_times / TIMES_PER_SECOND);
    let time = this.time + (this.speed * seconds * (last - first)) / length;
    if (time > last) {
      time = this.loops ? first + ((time - first) % (last - first)) : last;
      if (!this.loops) this.play(false);
    }
    this.time = time;
    this.changed();
  }

  /** @param {boolean} isPlaying */
  play(isPlaying) {
    const [first, last] = this.scene.span;
    // The slider rounds the last time.
    if (isPlaying && this.time > last - 1e-6) this.time = first;
    this.isPlaying = isPlaying && last > first;
    this.isDirty = true;
    if (!isPlaying) writeAddress(this);
  }

  /** @param {number} time */
  setTime(time) {
    const [first, last] = this.scene.span;
    this.time = Math.min(last, Math.max(first, time));
    this.changed();
    clearTimeout(this.writing);
    this.writing = setTimeout(() => writeAddress(this), STILL);
  }

  /** @param {string} layer one of LAYERS */
  setLayer(layer) {
    if (LAYERS.includes(layer)) this.layer = layer;
    this.isDirty = true;
    writeAddress(this);
  }

  /** @param {number} index of a camera of the scene */
  jump(index) {
    const camera = this.scene.cameras[index];
    this.orbit.take(camera);
    if (camera.time !== null) this.setTime(camera.time);
    this.moved();
  }

  /**
   * Shows an image of exactly this camera, one pixel for each of its pixels, until a reader moves it.
   * @param {Camera} camera
   */
  setCamera(camera) {
    this.orbit.take(camera);
    this.fixed = { ...camera };
    Object.assign(this.canvas.style, { width: `${camera.width}px`, height: `${camera.height}px` });
    this.changed();
  }

  /** The image as it is for the present camera and time. */
  async pixels() {
    this.sharpness = 1;
    const { camera, time, layer } = this;
    await this.renderer.sort(camera, time);
    this.renderer.draw(camera, time, layer);
    return this.renderer.read();
  }
}

/** Shows a message over the image; an empty one hides it. */
function showMessage(text) {
  const message = document.getElementById('message');
  message.textContent = text;
  message.hidden = !text;
}

/** Shows why the scene cannot be shown. */
function explain(error) {
  showMessage(error instanceof Unsupported ? error.message : `The scene cannot be shown: ${error.message}`);
  if (!(error instanceof Unsupported)) console.error(error);
}

/** Does something, or shows why it cannot be done. */
function attempt(action) {
  try {
    action();
  } catch (error) {
    explain(error);
  }
}

/** Unpacks the page and starts the player. */
async function start() {
  if (typeof DecompressionStream === 'undefined') {
    throw new Unsupported('This browser cannot unpack the scene: it has no DecompressionStream. Try a newer version.');
  }
  const scene = JSON.parse(document.getElementById('scene').textContent);
  const packed = document.getElementById('gaussians');
  const planes = await unpack(packed.textContent);
  // The text is of no use any more.
  packed.remove();
  const branches = decodeBranches([scene.static, scene.dynamic].filter(Boolean), planes);
  const player = new Player(document.getElementById('view'), document.getElementById('controls'), scene, branches);
  readAddress(player);
  addEventListener('hashchange', () => readAddress(player));
  await player.sort();
  // What a driver does not offer may show only when it draws.
  player.renderer.draw(player.camera, player.time, player.layer);
  showMessage('');
  return player;
}

/**
 * For scripts of pages that embed this one, and for tests.
 * @property {Promise<void>} ready resolves when the scene is shown, rejects where it cannot be
 */
const mvfusion = { ready: start().then(player => Object.assign(mvfusion, {
  player,
  /** @param {Camera} camera */
  setCamera: camera => player.setCamera(camera),
  /** @param {number} time */
  setTime: time => player.setTime(time),
  /** @param {string} layer */
  setLayer: layer => player.setLayer(layer),
  /** @returns {Promise<ImageData>} of the present camera and time */
  pixels: () => player.pixels(),
})).then(() => {}) };
window.mvfusion = mvfusion;
mvfusion.ready.catch(explain);
