// The viewer's page: what is shown, what is asked of the server, and when.

import { read, write } from './address.js';
import { Curves } from './chart.js';
import { listen } from './controls.js';
import { element } from './dom.js';
import { Link } from './link.js';
import { movesOf } from './moves.js';
import { Panel } from './panel.js';
import { Photo } from './photo.js';
import { Picture, loadPoints } from './picture.js';
import { beginning, fovOf, poseOf } from './state.js';
import { unit } from './vector.js';

/** @typedef {import('./vector.js').Vector} Vector */
/** @typedef {import('./pose.js').Pose} Pose */
/** @typedef {import('./state.js').State} State */
/** @typedef {import('./state.js').ViewId} ViewId */

/** Nothing has moved for so long: the picture may be sharp. Milliseconds. */
const QUIET = 160;
/** While something moves, a picture shall not take longer than this; it gets smaller or larger. Milliseconds. */
const AIM = [40, 85];
/** Pixels of a picture while something moves: the least, and the first guess. */
const LEAST_PIXELS = 160 * 90;
const FIRST_PIXELS = 480 * 270;
const QUALITY = { moving: 60, still: 92 };
/** How long a sharp picture is waited for before what is there is saved. Milliseconds. */
const PATIENCE = 10_000;

export class Viewer {
  /** @param {any} scene */
  constructor(scene) {
    this.scene = scene;
    /** @type {State} */
    this.state = { ...beginning(scene), ...read(location.hash, scene) };
    this.status = /** @type {any} */ (undefined);
    this.facts = /** @type {any} */ (undefined);
    this.pixels = FIRST_PIXELS;
    // Something has changed that no picture shows yet; the newest picture is as good as it gets.
    [this.isChanged, this.isSharp] = [true, false];
    this.changedAt = 0;
    this.frames = 0;
    this.picture = new Picture(element('picture'));
    this.photo = new Photo(this);
    this.curves = new Curves(element('loss'), element('psnr'));
    this.panel = new Panel(this);
    this.link = new Link({
      opened: () => this.#opened(),
      closed: (reason) => this.#closed(reason),
      frame: (facts, jpeg) => this.#frame(facts, jpeg),
      status: (status) => this.#status(status),
      refused: (reason) => this.#refused(reason),
    });
    listen(this.picture.canvas, movesOf(this));
    new ResizeObserver(() => this.picture.fit() && this.change({})).observe(this.picture.canvas);
    addEventListener('hashchange', () => this.change(read(location.hash, scene)));
    this.picture.fit();
    this.photo.load();
    this.#loadPoints();
    this.panel.show();
    this.link.connect();
  }

  /** The up direction that is chosen. @returns {Vector} */
  get up() {
    const { up } = this.state;
    if (up === 'scene') return unit(this.scene.up);
    const sign = up[0] === '-' ? -1 : 1;
    return /** @type {Vector} */ (['x', 'y', 'z'].map((axis) => (axis === up[1] ? sign : 0)));
  }

  /** Ratio of width to height of the picture: the photo's at its camera, otherwise the window's. */
  get aspect() {
    const camera = this.camera;
    return camera ? camera.width / camera.height : this.picture.canvas.width / this.picture.canvas.height;
  }

  /** The camera of the view that is shown. */
  get camera() {
    const { view } = this.state;
    return view && this.scene.cameras[this.scene[view.set][view.index][1]];
  }

  /** Changes what is shown. @param {Partial<State>} change */
  change(change) {
    const before = this.state;
    this.state = { ...before, ...change };
    // A pose that comes with its up direction, from an address, keeps its roll.
    if (change.up && change.up !== before.up && !change.pose) this.state.pose = this.state.pose.upright(this.up);
    const hasPhoto = (/** @type {State} */ state) => state.split !== undefined;
    if (this.state.view !== before.view || hasPhoto(this.state) !== hasPhoto(before)) this.photo.load();
    if (this.state.points && !before.points) this.#loadPoints();
    [this.isChanged, this.isSharp] = [true, false];
    this.changedAt = performance.now();
    document.body.dataset.sharp = 'false';
    this.panel.show();
    this.draw();
    this.#remember();
    this.#pump();
  }

  /** Changes what no rendered picture depends on. @param {Partial<State>} change */
  keep(change) {
    Object.assign(this.state, change);
    this.panel.show();
    this.draw();
    this.#remember();
  }

  /** Moves the camera, which leaves the camera of a view. @param {Pose} pose */
  move(pose) {
    this.change({ pose, view: undefined, split: undefined });
  }

  /** Goes to the camera of a view, at its time. @param {ViewId} view */
  jump(view) {
    const camera = this.scene.cameras[this.scene[view.set][view.index][1]];
    this.change({ view, pose: poseOf(this.scene, camera), fov: fovOf(camera), time: this.photo.timeOf(view) });
  }

  draw() {
    const { pose, fov } = this.state;
    const camera = this.camera;
    const focal = 0.5 / Math.tan((fov * Math.PI) / 360);
    const free = { position: pose.position, rows: pose.rows, fx: focal, fy: focal, cx: this.aspect / 2, cy: 0.5 };
    const own = camera && {
      position: camera.position, rows: camera.rotation, fx: camera.fx / camera.height, fy: camera.fy / camera.height,
      cx: camera.cx / camera.height, cy: camera.cy / camera.height,
    };
    this.picture.split = this.state.split;
    this.picture.caption = this.photo.caption;
    const points = this.state.points ? this.points : undefined;
    const { left, width } = this.picture.span(this.aspect);
    Object.assign(element('split').style, { left: `${left}px`, width: `${width}px` });
    this.picture.draw(this.aspect, own ?? free, { scene: this.scene, points, frusta: this.state.frusta });
  }

  /** Waits for a sharp picture of what stands still. While a training runs there is none. */
  async still() {
    const until = performance.now() + PATIENCE;
    const isOver = () => document.body.dataset.sharp === 'true' || performance.now() > until
      || document.body.dataset.link !== 'open' || ['trains', 'scores'].includes(this.status?.activity);
    while (!isOver()) await new Promise((resolve) => setTimeout(resolve, 30));
  }

  /** Asks for the next picture, if one is wanted and none is on its way. */
  #pump() {
    if (!this.link.isFree || this.status?.activity === 'scores') return;
    const isQuiet = performance.now() - this.changedAt >= QUIET;
    const isTraining = this.status?.activity === 'trains';
    const isOld = this.facts && this.facts.step !== this.status?.step;
    if (this.isChanged && !(isQuiet && !isTraining)) {
      this.isChanged = false;
      this.#ask('moving');
    } else if (!isQuiet) {
      setTimeout(() => this.#pump(), QUIET);
    } else if (isTraining ? isOld || this.isChanged : !this.isSharp) {
      [this.isChanged, this.isSharp] = [false, true];
      this.#ask(isTraining ? 'moving' : 'still');
    }
  }

  /** @param {'moving' | 'still'} kind */
  #ask(kind) {
    const { pose, fov, time, layer, mfta, background, view } = this.state;
    const place = view ? { view } : { pose: { position: pose.position, rotation: pose.rows, fov } };
    this.asked = kind;
    document.body.dataset.sharp = 'false';
    this.link.ask({
      ...place, size: this.#size(kind), time, layer, mfta: mfta && kind === 'still', quality: QUALITY[kind],
      background: background === 'run' ? null : Number(background),
    });
  }

  /** Width and height of a picture. @param {'moving' | 'still'} kind @returns {[number, number]} */
  #size(kind) {
    const { aspect } = this;
    const place = this.picture.place(aspect);
    const camera = this.camera;
    let height = place.height;
    // A photo's own size is as good as it gets, and the one to compare with.
    if (camera && kind === 'still') height = camera.height;
    height = Math.min(height, this.state.largest / Math.max(1, aspect), Math.sqrt(this.scene.most_pixels / aspect));
    if (kind === 'moving') height = Math.min(height, Math.sqrt(this.pixels / aspect));
    return [Math.max(16, Math.floor(height * aspect)), Math.max(16, Math.floor(height))];
  }

  /** @param {any} facts @param {Blob} jpeg */
  async #frame(facts, jpeg) {
    this.facts = facts;
    this.frames += 1;
    const number = this.frames;
    // Before the next one is asked for: what has changed meanwhile is not in this one.
    const isSharp = this.asked === 'still' && !this.isChanged;
    this.#adapt(facts);
    // The next one is on its way while this one is decoded.
    this.#pump();
    // Decoded later than a newer one, it is dropped with its facts.
    if (!(await this.picture.take(jpeg, () => number === this.frames))) return;
    this.draw();
    this.panel.tell(facts);
    Object.assign(document.body.dataset, {
      frames: number, step: facts.step, sharp: isSharp && !this.isChanged, width: facts.width,
    });
  }

  /** Fits the size of moving pictures to the time that they take. @param {any} facts */
  #adapt(facts) {
    if (facts.roundTrip === undefined || this.asked === 'still' || this.status?.activity === 'trains') return;
    if (facts.roundTrip > AIM[1]) this.pixels = Math.max(LEAST_PIXELS, this.pixels * 0.75);
    if (facts.roundTrip < AIM[0]) this.pixels = Math.min(this.scene.most_pixels, this.pixels * 1.15);
  }

  async #opened() {
    // Another run may be served at the same place.
    const scene = await fetch('scene.json').then((answer) => answer.json()).catch(() => undefined);
    // It may have closed meanwhile, for want of a place.
    if (!this.link.isOpen) return;
    if (scene && (scene.run !== this.scene.run || scene.training !== this.scene.training)) return location.reload();
    document.body.dataset.link = 'open';
    [this.isChanged, this.isSharp] = [true, false];
    this.panel.say('');
    this.panel.linked(true);
    this.#pump();
  }

  /** @param {string} reason why the server has closed the connection, if it says so */
  #closed(reason) {
    if (reason) {
      this.panel.say(reason);
    } else if (document.body.dataset.link === 'open') {
      this.panel.say(this.status?.activity === 'scores'
        ? `The training is done. “mvfusion view ${this.scene.run}” shows its result.`
        : 'The connection is lost. Trying again …');
    } else if (document.body.dataset.link === undefined) {
      this.panel.say('The server does not answer. Trying again …');
    }
    document.body.dataset.link = 'closed';
    this.panel.linked(false);
  }

  /** @param {any} status */
  #status(status) {
    // A training that pauses can be looked at more closely.
    if (status.activity !== this.status?.activity) this.isSharp = false;
    this.status = status;
    this.curves.add(status.curves);
    this.panel.train(status);
    this.#pump();
  }

  /** @param {string} reason */
  #refused(reason) {
    this.panel.say(reason, 6000);
    // The same would be refused again. What has changed meanwhile, or changes next, asks anew.
    if (!this.isChanged) this.isSharp = true;
    this.#pump();
  }

  async #loadPoints() {
    if (!this.state.points || this.points || this.scene.points === 0) return;
    this.points = await loadPoints(this.scene.points);
    this.draw();
  }

  /** Puts the view into the address, not more often than browsers allow. */
  #remember() {
    clearTimeout(this.timer);
    this.timer = setTimeout(() => history.replaceState(null, '', `#${write(this.state)}`), 200);
  }
}

fetch('scene.json').then((answer) => answer.json()).then((scene) => {
  globalThis.viewer = new Viewer(scene);
}).catch((error) => {
  element('notice').hidden = false;
  element('notice').textContent = `The scene could not be loaded: ${error.message}. Reload the page.`;
});
