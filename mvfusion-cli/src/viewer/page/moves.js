// What gestures do to the camera.

/** Speed of flight in extents of the scene a second. */
const FLIGHT = 0.5;
/** The line between photo and render is grabbed from so near, pixels of the page. */
const GRIP = 10;

/**
 * @param {import('./viewer.js').Viewer} viewer
 * @returns {import('./controls.js').Moves}
 */
export function movesOf(viewer) {
  const height = () => Math.max(200, viewer.picture.canvas.clientHeight);
  /** Radians of a pixel: half a turn from top to bottom. */
  const angle = () => Math.PI / height();
  /** Length of a pixel at the distance of the target. */
  const world = () => {
    const { pose, fov } = viewer.state;
    return (2 * pose.distance * Math.tan((fov * Math.PI) / 360)) / height();
  };
  return {
    orbit: (x, y) => viewer.move(viewer.state.pose.orbited(x * angle(), y * angle(), viewer.up)),
    pan: (x, y) => viewer.move(viewer.state.pose.shifted(-x * world(), -y * world(), 0)),
    look: (x, y) => viewer.move(viewer.state.pose.looked(x * angle(), y * angle(), viewer.up)),
    zoom: (factor) => viewer.move(viewer.state.pose.zoomed(factor)),
    fly: (right, down, forward, seconds) => {
      const by = FLIGHT * (viewer.scene.extent || 1) * viewer.panel.flight * seconds;
      viewer.move(viewer.state.pose.shifted(right * by, down * by, forward * by));
    },
    isAtLine: (x) => {
      const { split, view } = viewer.state;
      const { left, width } = viewer.picture.span(viewer.aspect);
      return view !== undefined && split !== undefined && Math.abs(x - left - split * width) <= GRIP;
    },
    moveLine: (x) => {
      const { left, width } = viewer.picture.span(viewer.aspect);
      viewer.keep({ split: Math.max(0, Math.min(1, (x - left) / width)) });
    },
    press: (key) => viewer.panel.press(key),
  };
}
