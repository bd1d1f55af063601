// The controls beside the picture, and what they say.

import { write } from './address.js';
import { download, element } from './dom.js';
import { PathEditor } from './editor.js';
import { Player } from './player.js';
import { beginning } from './state.js';

/** @typedef {import('./viewer.js').Viewer} Viewer */

export class Panel {
  /** @param {Viewer} viewer */
  constructor(viewer) {
    this.viewer = viewer;
    const { scene } = viewer;
    document.title = `${scene.scene} – MVFusion-GS viewer`;
    element('title').textContent = scene.scene;
    element('training').hidden = !scene.training;
    element('mfta').closest('label').hidden = !scene.mfta;
    element('points').disabled = scene.points === 0;
    for (const layer of scene.layers) element('layer').append(new Option(layer.label, layer.name));
    this.player = new Player(viewer);
    this.editor = new PathEditor(viewer);
    this.#fillViews();
    this.#legend(scene.heat);
    this.#listen();
    this.rates = /** @type {number[]} */ ([]);
  }

  /** Factor of the speed of flight. */
  get flight() {
    return 2 ** this.viewer.state.speed;
  }

  /** Shows the state in the controls. */
  show() {
    const { state, scene } = this.viewer;
    element('layer').value = state.layer;
    element('mfta').checked = state.mfta;
    element('background').value = state.background;
    if (![...element('largest').options].some((option) => Number(option.value) === state.largest)) {
      element('largest').append(new Option(String(state.largest)));
    }
    element('largest').value = String(state.largest);
    element('frusta').checked = state.frusta;
    element('points').checked = state.points;
    element('fov').value = String(state.fov);
    element('degrees').textContent = `${state.fov.toFixed(0)}°`;
    element('speed').value = String(state.speed);
    element('pace-of-flight').textContent = `${this.flight.toPrecision(2)}×`;
    element('up').value = state.up;
    element('views').value = state.view ? `${state.view.set}/${state.view.index}` : '';
    const hasSplit = state.view !== undefined && state.split !== undefined;
    element('compare').checked = hasSplit;
    element('split').hidden = !hasSplit;
    if (hasSplit) element('split').value = String(state.split);
    this.player.show(state);
    document.body.dataset.view = state.view ? scene[state.view.set][state.view.index][0] : '';
  }

  /** Does what a key means. @param {string} key */
  press(key) {
    const does = /** @type {Record<string, () => void>} */ ({
      ' ': () => this.player.toggle(),
      r: () => this.#reset(),
      R: () => this.#reset(),
      '[': () => this.#step(-1),
      ']': () => this.#step(1),
    })[key];
    does?.();
    return does !== undefined;
  }

  /** Shows a sentence over the picture; an empty one hides it. @param {string} text @param {number} [milliseconds] */
  say(text, milliseconds) {
    const notice = element('notice');
    clearTimeout(this.timer);
    notice.textContent = text;
    notice.hidden = text === '';
    if (milliseconds) this.timer = setTimeout(() => this.say(''), milliseconds);
  }

  /** @param {boolean} isOpen */
  linked(isOpen) {
    element('link').textContent = isOpen ? this.viewer.scene.run : 'not connected';
    for (const id of ['pause', 'checkpoint']) element(id).disabled = !isOpen;
  }

  /** Shows the numbers of a picture. @param {any} facts */
  tell(facts) {
    const now = performance.now();
    this.rates = [...this.rates.filter((time) => now - time < 2000), now];
    const { gaussians, ms } = facts;
    const [first, count] = [this.rates[0], this.rates.length];
    const rate = count > 1 ? ((1000 * (count - 1)) / (now - first)).toFixed(1) : '–';
    const time = (/** @type {number} */ value) => `${value.toFixed(1)} ms`;
    const rows = [
      ['Picture', `${facts.width} × ${facts.height}`],
      ['FPS', rate],
      ['Static Gaussians', gaussians.static.toLocaleString('en')],
      ['Dynamic Gaussians', `${gaussians.alive.toLocaleString('en')} of ${gaussians.dynamic.toLocaleString('en')}`],
      ['Step', facts.step.toLocaleString('en')],
      ['MFTA', facts.mfta ? 'on' : 'off'],
      ['Networks', ms.deform < 0.05 ? 'cached' : time(ms.deform)],
      ['Splats', time(ms.splat)],
      ['Read back', time(ms.read)],
      ['JPEG', time(ms.encode)],
      ['Latency', facts.roundTrip === undefined ? '–' : time(facts.roundTrip)],
      ['PSNR of this view', facts.psnr === undefined ? '–' : `${facts.psnr.toFixed(2)} dB`],
    ];
    const row = (/** @type {string[]} */ [name, value]) => {
      const line = document.createElement('tr');
      const [head, cell] = [document.createElement('th'), document.createElement('td')];
      [head.textContent, cell.textContent] = [name, value];
      line.append(head, cell);
      return line;
    };
    element('numbers').tBodies[0].replaceChildren(...rows.map(row));
    this.#showLegend(facts.scale);
  }

  /** Shows the state of the training. @param {any} status */
  train(status) {
    const words = { shows: 'trained', trains: 'training', pauses: 'paused', scores: 'done, evaluating' };
    const rate = status.steps_per_second ? `, ${status.steps_per_second.toFixed(1)} steps/s` : '';
    const stage = status.stage ? `, ${status.stage}` : '';
    element('progress').textContent =
      `${words[status.activity]}: step ${status.step} of ${status.total}${stage}${rate}`;
    element('pause').textContent = status.activity === 'pauses' ? 'Go on' : 'Pause';
    element('saved').hidden = !status.saved;
    element('saved').textContent = status.saved ? `saved: ${status.saved}` : '';
    document.body.dataset.activity = status.activity;
    document.body.dataset.trained = status.step;
    const reasons = new Map(status.unavailable);
    for (const option of element('layer').options) {
      option.disabled = reasons.has(option.value);
      option.title = reasons.get(option.value) ?? '';
    }
  }

  #listen() {
    const { viewer } = this;
    const on = (/** @type {string} */ id, /** @type {string} */ event, /** @type {(target: any) => void} */ act) =>
      element(id).addEventListener(event, () => act(element(id)));
    on('layer', 'change', (select) => viewer.change({ layer: select.value }));
    on('mfta', 'change', (box) => viewer.change({ mfta: box.checked }));
    on('background', 'change', (select) => viewer.change({ background: select.value }));
    on('largest', 'change', (select) => viewer.change({ largest: Number(select.value) }));
    on('frusta', 'change', (box) => viewer.change({ frusta: box.checked }));
    on('points', 'change', (box) => viewer.change({ points: box.checked }));
    on('fov', 'input', (range) => viewer.change({ fov: range.valueAsNumber, view: undefined, split: undefined }));
    on('speed', 'input', (range) => viewer.keep({ speed: range.valueAsNumber }));
    on('up', 'change', (select) => viewer.change({ up: select.value }));
    on('views', 'change', (select) => select.value && this.#jump(select.value));
    on('before', 'click', () => this.#step(-1));
    on('after', 'click', () => this.#step(1));
    on('compare', 'change', (box) => this.#compare(box.checked));
    on('split', 'input', (range) => {
      // The picture stays the same, so none is asked for.
      viewer.state.split = range.valueAsNumber;
      viewer.draw();
    });
    on('split', 'change', (range) => viewer.keep({ split: range.valueAsNumber }));
    on('reset', 'click', () => this.#reset());
    on('share', 'click', () => this.#share());
    on('png', 'click', () => this.#save('image/png', 'png'));
    on('jpeg', 'click', () => this.#save('image/jpeg', 'jpg'));
    on('pause', 'click', () => viewer.link.command(viewer.status?.activity === 'pauses' ? 'go_on' : 'pause'));
    on('checkpoint', 'click', () => viewer.link.command('checkpoint'));
    matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => viewer.curves.draw());
  }

  #fillViews() {
    const { scene } = this.viewer;
    element('views').append(new Option('a free camera', ''));
    for (const [set, label] of [['test', 'Held-out views'], ['train', 'Training views']]) {
      if (scene[set].length === 0) continue;
      const group = document.createElement('optgroup');
      group.label = label;
      scene[set].forEach((/** @type {any} */ view, /** @type {number} */ index) =>
        group.append(new Option(view[0], `${set}/${index}`)));
      element('views').append(group);
    }
  }

  /** @param {string} value */
  #jump(value) {
    const [set, index] = value.split('/');
    this.viewer.jump({ set: /** @type {'train' | 'test'} */ (set), index: Number(index) });
  }

  /** Goes to the view before or after the one that is shown. @param {number} by */
  #step(by) {
    const values = [...element('views').options].map((option) => option.value).filter((value) => value !== '');
    const now = values.indexOf(element('views').value);
    this.#jump(values[now < 0 ? 0 : (now + by + values.length) % values.length]);
  }

  /** @param {boolean} isOn */
  #compare(isOn) {
    const { viewer } = this;
    if (isOn && !viewer.state.view) this.#step(0);
    viewer.change({ split: isOn ? 0.5 : undefined });
  }

  #reset() {
    const { pose, fov, up, view, split } = beginning(this.viewer.scene);
    this.viewer.change({ pose, fov, up, view, split });
  }

  async #share() {
    history.replaceState(null, '', `#${write(this.viewer.state)}`);
    try {
      await navigator.clipboard.writeText(location.href);
      this.say('The address is copied.', 2000);
    } catch {
      this.say('The address in the browser holds this view; copy it from there.', 4000);
    }
  }

  /** @param {'image/png' | 'image/jpeg'} type @param {string} ending */
  async #save(type, ending) {
    // What moves is small and compressed.
    this.player.stop();
    this.editor.stop();
    await this.viewer.still();
    const { state, picture } = this.viewer;
    const file = await picture.saved(type);
    const time = state.time === null ? '' : `-${state.time.toFixed(3)}`;
    if (file) download(file, `${state.layer}${time}.${ending}`);
  }

  /** @param {number[][]} heat */
  #legend(heat) {
    this.heat = heat;
    this.grey = heat.map((_, index) => Array(3).fill((255 * index) / (heat.length - 1)));
  }

  /** @param {any} scale */
  #showLegend(scale) {
    element('legend').hidden = !scale;
    if (!scale) return;
    const isDepth = scale.kind === 'depth';
    const colours = (isDepth ? this.grey : this.heat) ?? [];
    const canvas = element('colours');
    const context = canvas.getContext('2d');
    canvas.width = colours.length;
    colours.forEach(([r, g, b], x) => {
      context.fillStyle = `rgb(${r} ${g} ${b})`;
      context.fillRect(x, 0, 1, 1);
    });
    element('low').textContent = isDepth ? `far ${scale.far.toPrecision(3)}` : '0';
    element('high').textContent = isDepth ? `near ${scale.near.toPrecision(3)}` : scale.white.toPrecision(3);
  }
}
