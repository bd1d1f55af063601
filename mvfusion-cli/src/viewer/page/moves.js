// What gestures do to the camera.

/** Speed of flight in extents of the scene a second. */
const FLIGHT = 0.5;

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
    press: (key) => viewer.panel.press(key),
  };
}
