// What a reader does: pointer, keys and the controls below the image.

/** Radians of a turn by a pointer that crosses the height of the image. */
const TURN = 3;
/** Factor of the distance for a step of the wheel. */
const WHEEL = 1.0015;

/**
 * Lets pointers move the camera: one turns it, or pans with Shift or another button; two pan and zoom. The wheel zooms.
 * @param {HTMLCanvasElement} canvas
 * @param {Orbit} orbit
 * @param {() => void} moved
 */
function followPointers(canvas, orbit, moved) {
  /** @type {Map<number, { x: number, y: number }>} */
  const pointers = new Map();
  const middle = () => {
    const all = [...pointers.values()];
    const mean = axis => all.reduce((sum, pointer) => sum + pointer[axis], 0) / all.length;
    const [x, y] = [mean('x'), mean('y')];
    return { x, y, reach: Math.hypot(all[0].x - x, all[0].y - y) };
  };
  canvas.addEventListener('pointerdown', event => {
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
  });
  canvas.addEventListener('pointermove', event => {
    if (!pointers.has(event.pointerId)) return;
    const before = middle();
    pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    const after = middle();
    const [x, y] = [(after.x - before.x) / canvas.clientHeight, (after.y - before.y) / canvas.clientHeight];
    if (pointers.size > 1) {
      orbit.pan(x, y);
      if (before.reach > 0 && after.reach > 0) orbit.zoom(before.reach / after.reach);
    } else if (event.shiftKey || event.buttons > 1) {
      orbit.pan(x, y);
    } else {
      orbit.orbit(-TURN * x, -TURN * y);
    }
    moved();
  });
  for (const end of ['pointerup', 'pointercancel']) {
    canvas.addEventListener(end, event => pointers.delete(event.pointerId));
  }
  canvas.addEventListener('contextmenu', event => event.preventDefault());
  canvas.addEventListener('wheel', event => {
    event.preventDefault();
    // Some browsers count in lines.
    orbit.zoom(WHEEL ** (event.deltaMode === 1 ? 30 * event.deltaY : event.deltaY));
    moved();
  }, { passive: false });
}

/**
 * Connects the controls with the player.
 * @param {HTMLFormElement} form
 * @param {Player} player
 */
function connectControls(form, player) {
  const { elements } = form;
  const [first, last] = player.scene.span;
  Object.assign(elements.time, { min: first, max: last });
  player.scene.cameras.forEach(({ name }, index) => elements.camera.add(new Option(name, index)));
  if (!player.scene.static) elements.layer.closest('label').hidden = true;
  const isStill = last <= first;
  for (const name of ['play', 'time', 'speed', 'loop']) elements[name].disabled = isStill;

  elements.time.addEventListener('input', () => player.setTime(Number(elements.time.value)));
  elements.play.addEventListener('click', () => player.play(!player.isPlaying));
  elements.speed.addEventListener('change', () => { player.speed = Number(elements.speed.value); });
  elements.loop.addEventListener('change', () => { player.loops = elements.loop.checked; });
  elements.layer.addEventListener('change', () => player.setLayer(elements.layer.value));
  elements.reset.addEventListener('click', () => player.jump(0));
  elements.camera.addEventListener('change', () => {
    if (elements.camera.value !== '') player.jump(Number(elements.camera.value));
    elements.camera.value = '';
  });
  const full = () => {
    if (document.fullscreenElement) document.exitFullscreen();
    else document.documentElement.requestFullscreen?.();
  };
  elements.full.addEventListener('click', full);
  elements.full.hidden = !document.fullscreenEnabled;

  const step = (last - first) / Math.max(1, player.scene.training_times - 1);
  const keys = {
    ' ': () => player.play(!player.isPlaying),
    ArrowLeft: () => player.setTime(player.time - step),
    ArrowRight: () => player.setTime(player.time + step),
    r: () => player.jump(0),
    f: full,
  };
  addEventListener('keydown', event => {
    // Controls have keys of their own.
    const isElsewhere = event.target instanceof Element && event.target.closest('input, select, button');
    if (isElsewhere || event.ctrlKey || event.metaKey || event.altKey) return;
    const key = keys[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!key) return;
    event.preventDefault();
    key();
  });
}

/** Shows the player's state in the controls. */
function showState({ elements }, player) {
  elements.time.value = player.time;
  elements.shown.value = player.time.toFixed(2);
  elements.speed.value = player.speed;
  elements.loop.checked = player.loops;
  elements.layer.value = player.layer;
  elements.play.textContent = player.isPlaying ? '\u23f8' : '\u25b6';
  elements.play.ariaLabel = player.isPlaying ? 'Pause' : 'Play';
}
