//! The cameras and times at which exported Gaussians are compared with the model.

use mvfusion_data::{Camera, Capture, Scene, View, distinct_cameras};
use mvfusion_model::timeline::spread;

/// Maximum number of renders that are compared.
const MOST_VIEWS: usize = 8;

/// The times at which exported Gaussians are compared with the model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ComparedTimes<'a> {
    /// These times, from different held-out cameras. Not empty.
    At(&'a [f64]),
    /// Those of held-out views; of training views in a photo collection, where no other times are trained.
    OfViews,
    /// The same, but in a video, every second view is compared at the middle between the keyframes around its time,
    /// where their interpolation errs most.
    BetweenKeyframes(&'a [f64]),
}

/// A camera and a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ComparedView {
    pub camera: Camera,
    pub time: f64,
    /// Whether the time is the middle between two keyframes.
    pub is_between: bool,
}

/// The cameras and times to compare.
pub(super) fn compared_views(scene: &Scene, times: ComparedTimes<'_>) -> Vec<ComparedView> {
    let is_video = scene.capture == Capture::Video;
    let held_out = |is_wanted: bool| if is_wanted && !scene.test.is_empty() { &scene.test } else { &scene.train };
    if let ComparedTimes::At(times) = times {
        let cameras = distinct_cameras(held_out(true));
        let (cameras, times): (Vec<&View>, Vec<f64>) = (
            spread(cameras.len(), MOST_VIEWS).into_iter().map(|index| cameras[index]).collect(),
            spread(times.len(), MOST_VIEWS).into_iter().map(|index| times[index]).collect(),
        );
        let view = |place: usize| {
            let (camera, time) = (cameras[place % cameras.len()].camera, times[place % times.len()]);
            ComparedView { camera, time, is_between: false }
        };
        return (0..cameras.len().max(times.len())).map(view).collect();
    }
    let views = held_out(is_video);
    let view = |(place, index): (usize, usize)| {
        let View { camera, time, .. } = views[index];
        let between = match times {
            ComparedTimes::BetweenKeyframes(keyframes) if is_video && place % 2 == 1 => between(keyframes, time),
            _ => None,
        };
        ComparedView { camera, time: between.unwrap_or(time), is_between: between.is_some() }
    };
    spread(views.len(), MOST_VIEWS).into_iter().enumerate().map(view).collect()
}

/// The middle between the keyframes around a time, or between the last two; `None` if there is only one.
fn between(keyframes: &[f64], time: f64) -> Option<f64> {
    let last = keyframes.len().checked_sub(2)?;
    let before = keyframes.partition_point(|&other| other <= time).saturating_sub(1).min(last);
    Some(0.5 * (keyframes[before] + keyframes[before + 1]))
}

#[cfg(test)]
mod tests {
    use mvfusion_data::{BuiltinKind, BuiltinOptions, builtin};

    use super::*;

    fn scene(kind: BuiltinKind) -> Scene {
        builtin::builtin(&BuiltinOptions { width: 48, height: 36, ..BuiltinOptions::of_kind(kind) })
    }

    #[test]
    fn one_time_is_compared_from_each_camera_and_many_times_from_all_of_them_in_turn() {
        let scene = scene(BuiltinKind::Video);
        let cameras = distinct_cameras(&scene.test);
        let still = compared_views(&scene, ComparedTimes::At(&[0.5]));
        assert_eq!(still.len(), cameras.len().min(MOST_VIEWS));
        assert!(still.iter().all(|view| view.time == 0.5));
        let times: Vec<f64> = (0..30).map(|frame| f64::from(frame) / 30.0).collect();
        let frames = compared_views(&scene, ComparedTimes::At(&times));
        assert!(frames.len() == MOST_VIEWS && frames.iter().all(|view| times.contains(&view.time)));
        assert_eq!((frames[0].time, frames[MOST_VIEWS - 1].time), (times[0], times[29]));
    }

    #[test]
    fn every_second_view_of_a_video_may_be_compared_between_keyframes() {
        let scene = scene(BuiltinKind::Video);
        let own = compared_views(&scene, ComparedTimes::OfViews);
        assert_eq!((own.len(), own[0].time), (scene.test.len().min(MOST_VIEWS), scene.test[0].time));
        let times = scene.training_times();
        let both = compared_views(&scene, ComparedTimes::BetweenKeyframes(&times));
        for (place, (view, own)) in both.iter().zip(&own).enumerate() {
            assert_eq!((view.is_between, view.camera), (place % 2 == 1, own.camera));
            assert_ne!(times.contains(&view.time), view.is_between);
            assert!((view.time - own.time).abs() <= 0.5 * (times[1] - times[0]) + 1e-9);
        }
        assert_eq!(between(&[0.0, 0.5, 1.0], 0.5), Some(0.75));
        assert_eq!((between(&[0.0, 0.5, 1.0], 1.0), between(&[0.3], 0.3)), (Some(0.75), None));
    }

    #[test]
    fn photos_are_compared_at_the_times_that_were_trained() {
        let scene = scene(BuiltinKind::Casual);
        let times = scene.training_times();
        for which in [ComparedTimes::OfViews, ComparedTimes::BetweenKeyframes(&times)] {
            assert!(compared_views(&scene, which).iter().all(|view| times.contains(&view.time) && !view.is_between));
        }
    }
}
