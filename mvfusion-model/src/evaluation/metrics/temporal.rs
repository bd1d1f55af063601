//! Metrics of consecutive frames: flicker.

use mvfusion_data::View;
use serde::{Deserialize, Serialize};

/// Metrics of a frame and the one before it, seen by one camera, or their means over all such pairs. LPIPS here takes
/// numbers in `[-1, 1]`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TemporalScores {
    /// T-LPIPS: `|LPIPS(picture, picture before) - LPIPS(photo, photo before)|`, by AlexNet.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub t_lpips_alex: Option<f64>,
    /// The same by VGG-16.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub t_lpips_vgg: Option<f64>,
    /// `LPIPS(picture, picture before)` alone, by AlexNet: what some papers call T-LPIPS. It counts motion as flicker.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub consecutive_lpips_alex: Option<f64>,
    /// The same by VGG-16.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub consecutive_lpips_vgg: Option<f64>,
}

/// The views of each camera that stands still, by their index, in order of time. Every view is in one sequence; a
/// camera that moves makes a sequence of each view. Sequences come in the order of their first views.
pub fn sequences(views: &[View]) -> Vec<Vec<usize>> {
    let mut sequences: Vec<Vec<usize>> = Vec::new();
    for (index, view) in views.iter().enumerate() {
        match sequences.iter_mut().find(|sequence| views[sequence[0]].camera == view.camera) {
            Some(sequence) => sequence.push(index),
            None => sequences.push(vec![index]),
        }
    }
    for sequence in &mut sequences {
        sequence.sort_by(|&a, &b| views[a].time.total_cmp(&views[b].time));
    }
    sequences
}

#[cfg(test)]
mod tests {
    use mvfusion_data::BuiltinOptions;
    use mvfusion_data::builtin::builtin;

    use super::*;

    #[test]
    fn frames_of_a_camera_are_in_order_of_time_and_cameras_apart() {
        let scene = builtin(&BuiltinOptions { width: 16, height: 12, frames: 3, ..BuiltinOptions::default() });
        let mut views: Vec<View> = scene.train[..6].to_vec();
        let other = views.iter().find(|view| view.camera != views[0].camera).expect("two cameras").camera;
        for (view, (camera, time)) in views.iter_mut().zip([(0, 0.5), (1, 0.0), (0, 0.0), (1, 0.5), (0, 1.0), (1, 1.0)])
        {
            view.time = time;
            view.camera = if camera == 0 { scene.train[0].camera } else { other };
        }
        assert_eq!(sequences(&views), [vec![2, 0, 4], vec![1, 3, 5]]);
    }
}
