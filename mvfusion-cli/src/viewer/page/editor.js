// The editor of a camera path.

import { download, element } from './dom.js';
import { between, fromFile, toFile } from './path.js';

/** Longest side of the pictures of a saved path, pixels. */
const LONGEST = 1280;
/** Most keys of a path. */
const MOST_KEYS = 200;

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

  #add() {
    const { pose, fov, time } = this.viewer.state;
    if (this.keys.length >= MOST_KEYS) return;
    this.keys.push({ pose, fov, time: time ?? 0 });
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
        button('Take', () => {
          const { pose, fov, time: now } = this.viewer.state;
          this.keys[index] = { pose, fov, time: now ?? 0 };
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

  #play() {
    this.isPlaying = !this.isPlaying;
    element('play-path').setAttribute('aria-pressed', String(this.isPlaying));
    element('play-path').textContent = this.isPlaying ? 'Stop' : 'Play';
    const started = performance.now();
    const step = (/** @type {number} */ now) => {
      if (!this.isPlaying) return;
      const at = Math.max(0, (now - started) / 1000 / this.seconds);
      this.#show(between(this.keys, Math.min(at, this.keys.length - 1)));
      if (at >= this.keys.length - 1) return this.#play();
      requestAnimationFrame(step);
    };
    if (this.isPlaying) requestAnimationFrame(step);
  }

  /** The size of the pictures: that of the window, with even sides, which videos need. @returns {[number, number]} */
  get size() {
    const { aspect } = this.viewer;
    const even = (/** @type {number} */ side) => Math.max(16, 2 * Math.round(side / 2));
    return aspect > 1 ? [LONGEST, even(LONGEST / aspect)] : [even(LONGEST * aspect), LONGEST];
  }

  #save() {
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
      this.keys = keys.slice(0, MOST_KEYS);
      element('seconds').value = String(Math.max(0.1, Number(seconds.toFixed(2))));
      this.#list();
    } catch (error) {
      this.viewer.panel.say(`${file.name} is no camera path: ${/** @type {Error} */ (error).message}`, 6000);
    }
  }
}
