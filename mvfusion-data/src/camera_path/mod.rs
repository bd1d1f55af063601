//! Where to look at a scene from when no photo says so: paths around it, and paths from files.

mod file;
mod orbit;
mod spiral;
mod vantage;

use glam::{DMat3, DVec3};

pub use file::{CameraPath, FRAME_RATES, LONGEST_SIDE, MOST_ENTRIES, PathEntry, read_camera_path};
pub use orbit::orbit;
pub use spiral::spiral;

use crate::{Scene, View};

/// The axes of a camera that looks along `forward` with `down` as nearly downwards as that allows: columns right, down,
/// forward. `None` if the two are parallel or one is zero.
fn axes(forward: DVec3, down: DVec3) -> Option<DMat3> {
    let forward = forward.try_normalize()?;
    let right = down.cross(forward).try_normalize()?;
    Some(DMat3::from_cols(right, forward.cross(right), forward))
}

/// `count` moments, evenly spread from the first to the last time of the training views.
pub fn running_times(scene: &Scene, count: usize) -> Vec<f64> {
    let times = scene.training_times();
    let (first, last) = (times.first().copied().unwrap_or(0.0), times.last().copied().unwrap_or(0.0));
    let steps = count.saturating_sub(1).max(1) as f64;
    (0..count).map(|i| first + (last - first) * (i as f64 / steps)).collect()
}

/// The view whose camera a user means: the name of a view (`cam00/0003`), that of a camera (`cam00`: its first view),
/// or the number of a held-out view (of a training view, where none is held out). Held-out views are looked through
/// first.
pub fn find_view<'a>(scene: &'a Scene, wanted: &str) -> Option<&'a View> {
    let all = || scene.test.iter().chain(&scene.train);
    let named = |view: &&View| view.name == wanted;
    let of_camera = |view: &&View| view.name.rsplit_once('/').is_some_and(|(camera, _)| camera == wanted);
    let numbered = || {
        let index: usize = wanted.parse().ok()?;
        if scene.test.is_empty() { scene.train.get(index) } else { scene.test.get(index) }
    };
    all().find(named).or_else(|| all().find(of_camera)).or_else(numbered)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{BuiltinKind, BuiltinOptions, builtin};

    fn scene() -> Scene {
        builtin::builtin(&BuiltinOptions { width: 32, height: 24, ..BuiltinOptions::of_kind(BuiltinKind::Video) })
    }

    #[test]
    fn axes_are_orthonormal_and_turn_right_handed() {
        let axes = axes(DVec3::new(0.3, -2.0, 0.5), DVec3::new(0.1, 0.2, 3.0)).expect("axes");
        let off = axes * axes.transpose() - DMat3::IDENTITY;
        assert!(off.to_cols_array().iter().all(|v| v.abs() < 1e-14) && axes.determinant() > 0.0);
        assert!(axes.y_axis.dot(DVec3::Z) > 0.9, "down was to be along z");
        assert_eq!(super::axes(DVec3::Z, 2.0 * DVec3::Z), None);
    }

    #[test]
    fn times_run_once_from_the_first_to_the_last() {
        let scene = scene();
        let times = running_times(&scene, 5);
        let training = scene.training_times();
        assert_eq!((times.len(), times[0], times[4]), (5, training[0], training[training.len() - 1]));
        assert!(times.is_sorted());
        assert_eq!(running_times(&scene, 1), [training[0]]);
    }

    #[test]
    fn a_view_is_found_by_its_name_by_its_camera_and_by_its_number() {
        let scene = scene();
        let (test, train) = (&scene.test[3], scene.train.last().expect("views"));
        let found = |wanted: &str| find_view(&scene, wanted).map(|view| view.name.as_str());
        assert_eq!(found(&test.name), Some(&*test.name));
        assert_eq!(found("3"), Some(&*test.name));
        let camera = train.name.rsplit_once('/').expect("camera/frame").0;
        let place = find_view(&scene, camera).expect("found").camera;
        assert_eq!(place, train.camera);
        assert_eq!(found("cam99"), None);
        assert_eq!(found("100000"), None);
    }
}
