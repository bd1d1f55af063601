// The view in the address, behind the #, so that it can be shared and survives a reload.

import { Pose } from './pose.js';

/** Digits that are kept of a number. */
const DIGITS = 6;

/** @param {number} value */
const short = (value) => String(Number(value.toPrecision(DIGITS)));

/** @param {readonly number[]} values */
const list = (values) => values.map(short).join(',');

/**
 * @param {import('./state.js').State} state
 * @returns {string}
 */
export function write(state) {
  const { pose } = state;
  const values = {
    p: list(pose.position), f: list(pose.forward), d: list(pose.down), r: short(pose.distance), fov: short(state.fov),
    t: state.time === null ? 'none' : short(state.time),
    layer: state.layer, mfta: state.mfta ? '1' : '0', back: state.background, up: state.up, side: String(state.largest),
    view: state.view ? `${state.view.set}/${state.view.index}` : '',
    split: state.split === undefined ? '' : short(state.split),
    over: [state.frusta && 'frusta', state.points && 'points'].filter(Boolean).join(','),
    pace: state.pace === 1 ? '' : short(state.pace), loop: state.loop ? '' : '0',
    fly: state.speed === 0 ? '' : short(state.speed),
  };
  const parts = Object.entries(values).filter(([, value]) => value !== '');
  return parts.map(([key, value]) => `${key}=${value.replace(/\+/g, '%2B')}`).join('&');
}

/**
 * What an address says; what it does not say, or says wrongly, is left out.
 * @param {string} hash
 * @param {any} scene
 * @returns {Partial<import('./state.js').State>}
 */
export function read(hash, scene) {
  const found = new URLSearchParams(hash.replace(/^#/, ''));
  if (found.size === 0) return {};
  /** @type {Partial<import('./state.js').State>} */
  const state = { view: undefined, split: undefined };
  const vector = (/** @type {string} */ key) => {
    const values = (found.get(key) ?? '').split(',').map(Number);
    if (values.length !== 3 || !values.every(Number.isFinite)) return undefined;
    return /** @type {[number, number, number]} */ (values);
  };
  const number = (/** @type {string} */ key, /** @type {number} */ low, /** @type {number} */ high) => {
    const text = found.get(key);
    const value = Number(text);
    return text && value >= low && value <= high ? value : undefined;
  };
  const [position, forward, down, distance] = [vector('p'), vector('f'), vector('d'), number('r', 1e-9, 1e9)];
  if (position && forward && down && distance) state.pose = new Pose(position, forward, down, distance);
  const put = (/** @type {string} */ key, /** @type {any} */ value) => {
    if (value !== undefined) Object.assign(state, { [key]: value });
  };
  put('fov', number('fov', 1, 170));
  put('time', found.get('t') === 'none' ? null : number('t', 0, 1));
  put('split', number('split', 0, 1));
  put('largest', number('side', 16, 16384));
  put('layer', scene.layers.find((/** @type {any} */ layer) => layer.name === found.get('layer'))?.name);
  put('background', ['run', '0', '0.5', '1'].find((name) => name === found.get('back')));
  put('up', ['scene', '+x', '-x', '+y', '-y', '+z', '-z'].find((name) => name === found.get('up')));
  if (found.has('mfta')) state.mfta = found.get('mfta') === '1';
  const over = (found.get('over') ?? '').split(',');
  Object.assign(state, { frusta: over.includes('frusta'), points: over.includes('points') });
  const pace = [0.25, 0.5, 1, 2, 4].find((value) => value === Number(found.get('pace'))) ?? 1;
  Object.assign(state, { pace, loop: found.get('loop') !== '0', speed: number('fly', -2, 2) ?? 0 });
  const [set, index] = (found.get('view') ?? '').split('/');
  if ((set === 'train' || set === 'test') && scene[set][Number(index)]) state.view = { set, index: Number(index) };
  return state;
}
