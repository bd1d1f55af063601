// The photo of a view, which a render is compared with.

/** @typedef {import('./state.js').ViewId} ViewId */

/** Times that differ by less are the same: addresses keep six digits. */
const SAME_TIME = 1e-6;

export class Photo {
  /** @param {import('./viewer.js').Viewer} viewer */
  constructor(viewer) {
    this.viewer = viewer;
  }

  /** The time that the photo of a view shows; `null` for the static scene alone. @param {ViewId} view */
  timeOf({ set, index }) {
    const { scene } = this.viewer;
    return scene.clean_test && set === 'test' ? null : scene[set][index][2];
  }

  /** What is said of the photo: its time, if another one is rendered. */
  get caption() {
    const { view, time } = this.viewer.state;
    const own = view ? this.timeOf(view) : time;
    const isSame = own === time || (own !== null && time !== null && Math.abs(own - time) < SAME_TIME);
    if (isSame) return 'photo';
    return own === null ? 'photo of the static scene' : `photo at ${own.toFixed(3)}`;
  }

  /** Loads the photo of the view that is shown, if it is compared with. */
  load() {
    const { state, picture, panel } = this.viewer;
    picture.photo = undefined;
    if (!state.view || state.split === undefined) return;
    const photo = new Image();
    photo.addEventListener('load', () => this.viewer.draw());
    photo.addEventListener('error', () => panel.say('The photo cannot be shown; the terminal says why.', 6000));
    photo.src = `photo/${state.view.set}/${state.view.index}`;
    picture.photo = photo;
  }
}
