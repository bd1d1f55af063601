// The state of the player in the address of the page.

/** Keeps the player's state in the address, and what else stands there. */
function writeAddress(player) {
  const state = new URLSearchParams(location.hash.slice(1));
  // The pose stands for them.
  for (const name of ['camera', 'matrix']) state.delete(name);
  state.set('time', +player.time.toFixed(4));
  state.set('pose', player.orbit.toString());
  if (player.layer === LAYERS[0]) state.delete('layer');
  else state.set('layer', player.layer);
  // Some hosts of embedded pages forbid it.
  try {
    history.replaceState(null, '', `#${state.toString().replaceAll('%2C', ',')}`);
  } catch { /* The address stays as it was. */ }
}

/** Takes the player's state from the address: what follows the question mark, then what follows the hash sign. */
function readAddress(player) {
  const wanted = new URLSearchParams(`${location.search.slice(1)}&${location.hash.slice(1)}`);
  // The last one counts.
  const value = name => wanted.getAll(name).at(-1);
  const { cameras } = player.scene;
  const named = cameras.findIndex(({ name }) => name === value('camera'));
  const index = named >= 0 ? named : Number(value('camera') ?? NaN);
  if (cameras[index]) player.jump(index);
  const matrix = value('matrix')?.split(',').map(Number) ?? [];
  if (matrix.length === 12 && matrix.every(Number.isFinite)) {
    const part = columns => [0, 4, 8].flatMap(row => columns.map(column => matrix[row + column]));
    player.orbit.take({ ...cameras[0], rotation: part([0, 1, 2]), translation: part([3]) });
  }
  if (value('pose')) player.orbit.parse(value('pose'));
  if (Number.isFinite(Number(value('time') ?? NaN))) player.setTime(Number(value('time')));
  if (LAYERS.includes(value('layer'))) player.layer = value('layer');
  if (Number(value('speed')) > 0) player.speed = Number(value('speed'));
  if (value('loop')) player.loops = value('loop') !== '0';
  const size = /^(\d+)x(\d+)$/.exec(value('size') ?? '')?.slice(1).map(Number);
  if (size && Math.min(...size) > 0) player.setCamera(player.orbit.camera(...size));
  player.form.hidden = value('ui') === '0';
  if (value('play') === '1') player.play(true);
  player.changed();
}
