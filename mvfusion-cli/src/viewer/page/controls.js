// Pointer, wheel, touch and keyboard become moves of the camera.

/**
 * What the page does with a gesture. Lengths are in pixels of the page.
 * @typedef {object} Moves
 * @property {(x: number, y: number) => void} orbit
 * @property {(x: number, y: number) => void} pan
 * @property {(x: number, y: number) => void} look
 * @property {(factor: number) => void} zoom
 * @property {(right: number, down: number, forward: number, seconds: number) => void} fly
 * @property {(x: number) => boolean} isAtLine whether the line between photo and render is there
 * @property {(x: number) => void} moveLine
 * @property {(key: string) => boolean} press whether the key meant something
 */

/** Keys of flight: right, down, forward. @type {Record<string, [number, number, number]>} */
const FLIGHT = {
  KeyW: [0, 0, 1], KeyS: [0, 0, -1], KeyA: [-1, 0, 0], KeyD: [1, 0, 0], KeyQ: [0, 1, 0], KeyE: [0, -1, 0],
};

/** A pixel of the wheel zooms by this factor. */
const ZOOM = 1.0015;
/** Keys that are known by their place: on many layouts, their characters need a second key. */
const PLACES = /** @type {Record<string, string>} */ ({ BracketLeft: '[', BracketRight: ']' });
/** What letters are written in, or chosen with. */
const WRITTEN = 'select, textarea, input:not([type="range"], [type="checkbox"], [type="file"])';
/** What the space bar presses. */
const PRESSED = 'button, summary, input[type="checkbox"], input[type="file"]';

/** @param {HTMLElement} element @param {Moves} moves */
export function listen(element, moves) {
  pointers(element, moves);
  element.addEventListener('wheel', (event) => {
    event.preventDefault();
    const lines = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 33 : 1;
    moves.zoom(ZOOM ** Math.max(-500, Math.min(500, event.deltaY * lines)));
  }, { passive: false });
  element.addEventListener('contextmenu', (event) => event.preventDefault());
  keyboard(moves);
}

/** @param {HTMLElement} element @param {Moves} moves */
function pointers(element, moves) {
  /** The pointers that are down, by their number. @type {Map<number, { x: number, y: number }>} */
  const down = new Map();
  /** The pointer that holds the line between photo and render. @type {number | undefined} */
  let grip;
  element.addEventListener('pointerdown', (event) => {
    if (down.size === 0 && event.button === 0 && moves.isAtLine(event.offsetX)) grip = event.pointerId;
    element.setPointerCapture(event.pointerId);
    element.focus({ preventScroll: true });
    down.set(event.pointerId, { x: event.clientX, y: event.clientY });
    event.preventDefault();
  });
  element.addEventListener('pointermove', (event) => {
    const last = down.get(event.pointerId);
    if (!last) {
      element.classList.toggle('line', moves.isAtLine(event.offsetX));
      return;
    }
    if (grip !== undefined) {
      if (event.pointerId === grip) moves.moveLine(event.offsetX);
      return;
    }
    const here = { x: event.clientX, y: event.clientY };
    const by = /** @type {[number, number]} */ ([here.x - last.x, here.y - last.y]);
    if (down.size === 1) {
      gesture(event, moves)(...by);
    } else if (down.size === 2) {
      const other = [...down].find(([id]) => id !== event.pointerId)?.[1] ?? last;
      const apart = (/** @type {{ x: number, y: number }} */ a) => Math.hypot(a.x - other.x, a.y - other.y);
      moves.pan(by[0] / 2, by[1] / 2);
      if (apart(here) > 1 && apart(last) > 1) moves.zoom(apart(last) / apart(here));
    }
    down.set(event.pointerId, here);
  });
  const up = (/** @type {PointerEvent} */ event) => {
    down.delete(event.pointerId);
    if (event.pointerId === grip) grip = undefined;
  };
  for (const name of /** @type {const} */ (['pointerup', 'pointercancel', 'lostpointercapture'])) {
    element.addEventListener(name, up);
  }
}

/** @param {PointerEvent} event @param {Moves} moves */
function gesture(event, moves) {
  const RIGHT = 2;
  const MIDDLE = 4;
  if (event.buttons & MIDDLE || event.altKey) return moves.look;
  return event.buttons & RIGHT || event.shiftKey ? moves.pan : moves.orbit;
}

/** @param {Moves} moves */
function keyboard(moves) {
  /** @type {Set<string>} */
  const held = new Set();
  let last = 0;
  const step = (/** @type {number} */ now) => {
    const seconds = Math.min(0.1, (now - last) / 1000);
    last = now;
    if (held.size === 0) return;
    const sum = [...held].map((key) => FLIGHT[key]).reduce((a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]]);
    moves.fly(...sum, seconds);
    requestAnimationFrame(step);
  };
  addEventListener('keydown', (event) => {
    const isIn = (/** @type {string} */ kinds) => event.target instanceof Element && event.target.closest(kinds);
    if (isIn(WRITTEN) || (event.key === ' ' && isIn(PRESSED))) return;
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.code in FLIGHT) {
      if (held.size === 0) {
        last = performance.now();
        requestAnimationFrame(step);
      }
      held.add(event.code);
      event.preventDefault();
    } else if (moves.press(PLACES[event.code] ?? event.key)) {
      event.preventDefault();
    }
  });
  addEventListener('keyup', (event) => held.delete(event.code));
  addEventListener('blur', () => held.clear());
}
