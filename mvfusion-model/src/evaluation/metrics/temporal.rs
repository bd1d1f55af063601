//! Flicker: metrics of consecutive frames.

use mvfusion_data::View;
use serde::{Deserialize, Serialize};

/// Metrics of a frame and the previous frame of the same camera, or their means over all such pairs. LPIPS is on
/// `[-1, 1]` here.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TemporalScores {
    /// T-LPIPS with AlexNet: `|LPIPS(render, previous render) - LPIPS(photo, previous photo)|`.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub t_lpips_alex: Option<f64>,
    /// The same with VGG-16.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub t_lpips_vgg: Option<f64>,
    /// Only `LPIPS(render, previous render)`, with AlexNet, which some papers call T-LPIPS. It counts motion as
    /// flicker.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub consecutive_lpips_alex: Option<f64>,
    /// The same with VGG-16.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub consecutive_lpips_vgg: Option<f64>,
}

/// Sequences of views by index: one per fixed camera, in order of time. Each view of a moving camera is a separate
/// sequence. Sequences are in the order of their first views.
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
