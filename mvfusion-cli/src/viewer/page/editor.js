// The editor of a camera path.

import { download, element } from './dom.js';
import { between, count, fromFile, toFile } from './path.js';

/** Longest side of the pictures of a saved path, pixels. */
const LONGEST = 1280;
/** Most keyframes of a path. */
const MOST_KEYS = 200;
/** Shortest time from one keyframe to the next, seconds. */
const LEAST = 0.1;
/** Most frames that `mvfusion render` takes from a file. */
const MOST_FRAMES = 108_000;
/** How long a sentence is shown, milliseconds. */
const READING = 6000;

export class PathEditor {
  /** @param {import('./viewer.js').Viewer} viewer */
  constructor(viewer) {
    this.viewer = viewer;
    /** @type {import('./path.js').Key[]} */
    this.keys = [];
    this.isPlaying = false;
    element('add-key').addEventListener('click', () => this.#add());
    element('play-path').addEventListener('click', () => this.#play());
    element('save-path').addEventListener('click', () => this.#save());
    element('open-path').addEventListener('change', (/** @type {any} */ event) => this.#open(event.target));
    this.#list();
  }

  get seconds() {
    const value = element('seconds').valueAsNumber;
    return value >= 0.1 && value <= 60 ? value : 2;
  }

  /** What is shown, as a keyframe. @returns {import('./path.js').Key} */
  #now() {
    const { pose, fov, time } = this.viewer.state;
    if (time !== null) return { pose, fov, time };
    this.viewer.panel.say('Each keyframe has a time. This one gets the first time of the scene.', READING);
    return { pose, fov, time: this.viewer.scene.times[0] ?? 0 };
  }

  #add() {
    if (this.keys.length >= MOST_KEYS) {
      this.viewer.panel.say(`A path has at most ${MOST_KEYS} keyframes.`, READING);
      return;
    }
    this.keys.push(this.#now());
    this.#list();
  }

  #list() {
    const lines = this.keys.map((key, index) => {
      const line = document.createElement('li');
      const time = document.createElement('output');
      time.textContent = `time ${key.time.toFixed(2)}`;
      const button = (/** @type {string} */ text, /** @type {() => void} */ act) => {
        const made = document.createElement('button');
        made.type = 'button';
        made.textContent = text;
        made.addEventListener('click', act);
        return made;
      };
      line.append(
        time,
        button('Go there', () => this.#show(key)),
        button('Replace', () => {
          this.keys[index] = this.#now();
          this.#list();
        }),
        button('Remove', () => {
          this.keys.splice(index, 1);
          this.#list();
        }),
      );
      return line;
    });
    element('keys').replaceChildren(...lines);
    element('play-path').disabled = this.keys.length < 2;
    element('save-path').disabled = this.keys.length === 0;
  }

  /** @param {import('./path.js').Key} key */
  #show({ pose, fov, time }) {
    this.viewer.change({ pose, fov, time, view: undefined, split: undefined });
  }

  stop() {
    this.#mark(false);
  }

  /** @param {boolean} isPlaying */
  #mark(isPlaying) {
    this.isPlaying = isPlaying;
    element('play-path').setAttribute('aria-pressed', String(isPlaying));
    element('play-path').textContent = isPlaying ? 'Stop' : 'Play';
  }

  #play() {
    if (this.isPlaying) return this.stop();
    // Both would set the time in turns.
    this.viewer.panel.player.stop();
    this.#mark(true);
    const started = performance.now();
    const step = (/** @type {number} */ now) => {
      if (!this.isPlaying) return;
      const at = Math.max(0, (now - started) / 1000 / this.seconds);
      this.#show(between(this.keys, Math.min(at, this.keys.length - 1)));
      if (at >= this.keys.length - 1) return this.stop();
      requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }

  /** The size of the pictures: that of the window, with even sides, which videos need. @returns {[number, number]} */
  get size() {
    const { aspect } = this.viewer;
    const even = (/** @type {number} */ side) => Math.max(16, 2 * Math.round(side / 2));
    return aspect > 1 ? [LONGEST, even(LONGEST / aspect)] : [even(LONGEST * aspect), LONGEST];
  }

  #save() {
    const frames = count(this.keys.length, this.seconds);
    if (frames > MOST_FRAMES) {
      const [many, most] = [frames, MOST_FRAMES].map((number) => number.toLocaleString('en'));
      this.viewer.panel.say(`The path has ${many} frames, and at most ${most} can be rendered: shorten it.`, READING);
      return;
    }
    const text = JSON.stringify(toFile(this.keys, this.seconds, this.size), null, 1);
    download(new Blob([text], { type: 'application/json' }), 'camera-path.json');
  }

  /** @param {HTMLInputElement} input */
  async #open(input) {
    const file = input.files?.[0];
    input.value = '';
    if (!file) return;
    try {
      const { keys, seconds } = fromFile(JSON.parse(await file.text()));
      // Of more, those that are evenly spread are kept, as far apart in time as before, but no nearer than `LEAST`.
      const most = Math.floor(((keys.length - 1) * seconds) / LEAST + 1e-9) + 1;
      const kept = Math.min(keys.length, MOST_KEYS, Math.max(2, most));
      const stride = kept > 1 ? (keys.length - 1) / (kept - 1) : 1;
      this.keys = Array.from({ length: kept }, (_, index) => keys[Math.round(index * stride)]);
      element('seconds').value = String(Math.min(60, Math.max(LEAST, Number((seconds * stride).toFixed(3)))));
      this.#list();
      if (kept < keys.length) {
        this.viewer.panel.say(`${file.name} has ${keys.length} cameras; ${kept} are kept as keyframes.`, READING);
      }
    } catch (error) {
      this.viewer.panel.say(`${file.name} is no camera path: ${/** @type {Error} */ (error).message}`, READING);
    }
  }
}
