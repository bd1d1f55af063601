//! Keeps a scene away from the rasteriser's thresholds, where finite differences mean nothing.

use std::collections::BTreeSet;

use mvfusion_data::Camera;
use mvfusion_render::splat::{SplatDiagnosis, SplatInputs, SplatRules, SplatSettings, Stop, diagnose};

/// Below this alpha a Gaussian is not added to a pixel (3DGS).
const LEAST_ALPHA: f64 = 1.0 / 255.0;

/// Relative distance from every threshold that a scene keeps; a step of a difference moves an alpha by some 1e-4 of it.
const MARGIN: f64 = 1e-3;

/// What an opacity logit is moved by, to leave a threshold.
const NUDGE: f64 = 0.004_3;

/// Moves the opacity logits of Gaussians that come near a threshold at any pixel, until none does.
///
/// # Panics
/// If that does not end.
pub fn keep_off_thresholds(
    logits: &mut [f64],
    camera: &Camera,
    settings: &SplatSettings,
    inputs: impl Fn(&[f64]) -> SplatInputs,
) {
    for _ in 0..500 {
        let seen = diagnose(&inputs(logits), camera, settings).expect("the scene can be rendered");
        let near = near_thresholds(&seen, camera, &settings.rules);
        if near.is_empty() {
            return;
        }
        near.into_iter().for_each(|row| logits[row] -= NUDGE);
    }
    panic!("the scene does not leave the thresholds");
}

/// The Gaussians that are within the margin of a threshold somewhere.
fn near_thresholds(seen: &SplatDiagnosis, camera: &Camera, rules: &SplatRules) -> BTreeSet<usize> {
    let mut order: Vec<usize> = (0..seen.depths.len()).filter(|&row| seen.radii[row] != [0, 0]).collect();
    order.sort_by(|&a, &b| seen.depths[a].total_cmp(&seen.depths[b]));
    let (Stop::Below(least_light) | Stop::AtOrBelow(least_light)) = rules.stop;
    let near = |value: f64, threshold: f64| (value / threshold - 1.0).abs() < MARGIN;
    let mut found = BTreeSet::new();
    for pixel in 0..camera.width * camera.height {
        let (x, y) = ((pixel % camera.width) as f64 + 0.5, (pixel / camera.width) as f64 + 0.5);
        let mut light = 1.0;
        for &row in &order {
            let ([dx, dy], [a, b, c]) = ([seen.means2d[row][0] - x, seen.means2d[row][1] - y], seen.conics[row]);
            let alpha = seen.opacities[row] * (-0.5 * (a * dx * dx + c * dy * dy) - b * dx * dy).exp();
            let behind = light * (1.0 - alpha.min(rules.alpha_clamp));
            if near(alpha, LEAST_ALPHA) || near(alpha, rules.alpha_clamp) || near(behind, least_light) {
                found.insert(row);
            }
            if behind < least_light {
                break;
            }
            if alpha >= LEAST_ALPHA {
                light = behind;
            }
        }
    }
    found
}
