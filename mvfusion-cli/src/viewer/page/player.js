// The timeline: play, speed, loop.

import { element } from './dom.js';

/** Seconds from the first to the last time at speed 1, if the scene has many times; fewer ones play faster. */
const SECONDS = 6;
/** Frames per second of the scene, so that short scenes do not crawl. */
const RATE = 10;
/** Moments that a pass is divided into. They come back in the next pass, so that the server has them ready. */
const MOMENTS = 120;

export class Player {
  /** @param {import('./viewer.js').Viewer} viewer */
  constructor(viewer) {
    this.viewer = viewer;
    const { times } = viewer.scene;
    [this.first, this.last] = [times[0] ?? 0, times.at(-1) ?? 0];
    this.seconds = Math.min(SECONDS, Math.max(1, times.length / RATE));
    this.isPlaying = false;
    const slider = element('time');
    // A scene may be trained for a part of [0, 1] only, and its slider goes no further.
    [slider.min, slider.max] = [this.first, this.last];
    slider.disabled = this.first === this.last;
    slider.addEventListener('input', () => {
      this.stop();
      this.#go(slider.valueAsNumber);
    });
    element('play').addEventListener('click', () => this.toggle());
    element('pace').addEventListener('change', () => viewer.keep({ pace: Number(element('pace').value) }));
    element('loop').addEventListener('change', () => viewer.keep({ loop: element('loop').checked }));
    element('play').disabled = slider.disabled;
  }

  /** @param {import('./state.js').State} state */
  show({ time, pace, loop }) {
    element('pace').value = String(pace);
    element('loop').checked = loop;
    if (time !== null) element('time').value = String(time);
    element('moment').textContent = time === null ? 'no time' : time.toFixed(3);
  }

  toggle() {
    if (this.isPlaying) return this.stop();
    if (this.first === this.last) return;
    // Both would set the time in turns.
    this.viewer.panel.editor.stop();
    this.isPlaying = true;
    this.#mark();
    const at = this.viewer.state.time ?? this.first;
    // What is exactly at the end begins anew.
    this.share = at >= this.last ? 0 : (at - this.first) / (this.last - this.first);
    let before = performance.now();
    const step = (/** @type {number} */ now) => {
      if (!this.isPlaying) return;
      const { pace, loop } = this.viewer.state;
      // The time of the first frame may lie before the click.
      this.share += (Math.max(0, now - before) / 1000 / this.seconds) * pace;
      before = now;
      if (this.share >= 1 && !loop) {
        this.stop();
        return this.#go(this.last);
      }
      this.share %= 1;
      const moment = Math.floor(this.share * MOMENTS) / (MOMENTS - 1);
      const time = this.first + (this.last - this.first) * Math.min(1, moment);
      if (time !== this.viewer.state.time) this.#go(time);
      requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }

  stop() {
    this.isPlaying = false;
    this.#mark();
  }

  /** @param {number} time */
  #go(time) {
    this.viewer.change({ time: Math.min(1, Math.max(0, time)) });
  }

  #mark() {
    element('play').setAttribute('aria-pressed', String(this.isPlaying));
    element('play').textContent = this.isPlaying ? 'Stop' : 'Play';
  }
}
