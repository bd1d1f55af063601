//! Colours of Gaussians outside a render: spherical harmonics that turn with the scene, and colours without a direction.

use glam::{DMat3, DQuat, DVec3};
use mvfusion_data::GaussianCloud;
use mvfusion_render::splat::sh_basis;

use super::gaussians::SH_C0;

/// Colour channels.
const CHANNELS: usize = 3;
/// Coefficients up to degree 3.
const COEFFICIENTS: usize = 16;

/// Nodes and weights of the Gauss-Legendre rule that is exact up to degree 7 on `[-1, 1]` (Abramowitz and Stegun, table
/// 25.4). Products of two harmonics have at most degree 6.
const HEIGHTS: [(f64, f64); 4] = [
    (-0.861_136_311_594_052_6, 0.347_854_845_137_453_86),
    (-0.339_981_043_584_856_26, 0.652_145_154_862_546_1),
    (0.339_981_043_584_856_26, 0.652_145_154_862_546_1),
    (0.861_136_311_594_052_6, 0.347_854_845_137_453_86),
];
/// Evenly spaced angles around the axis, which integrate frequencies below their number exactly.
const ANGLES: usize = 8;

/// Gaussians in a turned world: what was at `x` is at `rotation * x`, and looks the same from the turned camera.
/// `rotation` must be a rotation. Masks stay; lifetimes are dropped.
pub fn rotated(cloud: GaussianCloud, rotation: DMat3) -> GaussianCloud {
    let turn = DQuat::from_mat3(&rotation);
    let mean = |&mean: &[f32; 3]| (rotation * DVec3::from_array(mean.map(f64::from))).as_vec3().to_array();
    let quaternion = |&[w, x, y, z]: &[f32; 4]| {
        let [w, x, y, z] = [w, x, y, z].map(f64::from);
        let turned = turn * DQuat::from_xyzw(x, y, z, w);
        [turned.w as f32, turned.x as f32, turned.y as f32, turned.z as f32]
    };
    let width = cloud.sh_rest.len() / cloud.len().max(1);
    let matrix = harmonics_matrix(rotation);
    let sh_rest = cloud.sh_rest.chunks_exact(width.max(1)).flat_map(|rest| turned_rest(rest, &matrix)).collect();
    GaussianCloud {
        means: cloud.means.iter().map(mean).collect(),
        quaternions: cloud.quaternions.iter().map(quaternion).collect(),
        sh_rest,
        lifetimes: None,
        ..cloud
    }
}

/// The higher coefficients of one Gaussian, turned. The constant one does not change.
fn turned_rest(rest: &[f32], matrix: &[[f64; COEFFICIENTS]; COEFFICIENTS]) -> Vec<f32> {
    let count = rest.len() / CHANNELS;
    let value = |row: usize, channel: usize| -> f32 {
        let weights = &matrix[1 + row][1..=count];
        let coefficients = rest.iter().skip(channel).step_by(CHANNELS);
        weights.iter().zip(coefficients).map(|(weight, &coefficient)| weight * f64::from(coefficient)).sum::<f64>()
            as f32
    };
    (0..count).flat_map(|row| (0..CHANNELS).map(move |channel| (row, channel))).map(|(r, c)| value(r, c)).collect()
}

/// The matrix that turns coefficients: row `j`, column `k` is the integral over all directions `d` of harmonic `j` at
/// `d` times harmonic `k` at `rotation^T d`. It is zero between degrees (a Wigner D-matrix of real harmonics).
fn harmonics_matrix(rotation: DMat3) -> [[f64; COEFFICIENTS]; COEFFICIENTS] {
    let mut matrix = [[0.0; COEFFICIENTS]; COEFFICIENTS];
    for (height, weight) in HEIGHTS {
        for step in 0..ANGLES {
            let (sin, cos) = (std::f64::consts::TAU * step as f64 / ANGLES as f64).sin_cos();
            let radius = (1.0 - height * height).sqrt();
            let direction = DVec3::new(radius * cos, radius * sin, height);
            let here = sh_basis(direction.to_array());
            let before = sh_basis((rotation.transpose() * direction).to_array());
            let area = weight * std::f64::consts::TAU / ANGLES as f64;
            for (row, here) in matrix.iter_mut().zip(here) {
                row.iter_mut().zip(before).for_each(|(entry, before)| *entry += area * here * before);
            }
        }
    }
    matrix
}

/// The same Gaussians with one colour each ([`mean_colours`]), at degree 0.
pub fn without_directions(cloud: GaussianCloud, eyes: &[DVec3]) -> GaussianCloud {
    let coefficient = |level: f32| ((f64::from(level) - 0.5) / SH_C0) as f32;
    let sh_dc = mean_colours(&cloud, eyes).into_iter().map(|colour| colour.map(coefficient)).collect();
    GaussianCloud { sh_degree: 0, sh_dc, sh_rest: Vec::new(), ..cloud }
}

/// The colour of each Gaussian as the mean of its colours from `eyes`, for formats whose colours do not depend on the
/// direction. Without eyes, it is the constant part. It is not negative, and exceeds 1 where the brightness of a mask
/// darkens it (METHOD §1.3).
pub fn mean_colours(cloud: &GaussianCloud, eyes: &[DVec3]) -> Vec<[f32; 3]> {
    (0..cloud.len()).map(|index| mean_colour(cloud, index, eyes)).collect()
}

fn mean_colour(cloud: &GaussianCloud, index: usize, eyes: &[DVec3]) -> [f32; 3] {
    let mean = DVec3::from_array(cloud.means[index].map(f64::from));
    let mut sum = [0.0; CHANNELS];
    for eye in eyes {
        // Right at a camera, any direction will do.
        let direction = (mean - *eye).try_normalize().unwrap_or(DVec3::Z);
        let colour = colour_from(cloud, index, &sh_basis(direction.to_array()));
        sum.iter_mut().zip(colour).for_each(|(sum, level)| *sum += level);
    }
    let mean = match eyes.len() {
        0 => colour_from(cloud, index, &sh_basis([0.0; 3])),
        count => sum.map(|sum| sum / count as f64),
    };
    mean.map(|level| level as f32)
}

/// The colour in the direction of a basis; not negative. Of a basis at no direction, the constant part.
fn colour_from(cloud: &GaussianCloud, index: usize, basis: &[f64; COEFFICIENTS]) -> [f64; CHANNELS] {
    let rest = cloud.rest(index);
    std::array::from_fn(|channel| {
        let constant = 0.5 + basis[0] * f64::from(cloud.sh_dc[index][channel]);
        let coefficients = rest.iter().skip(channel).step_by(CHANNELS);
        let higher = basis[1..].iter().zip(coefficients).map(|(value, &coefficient)| value * f64::from(coefficient));
        (constant + higher.sum::<f64>()).max(0.0)
    })
}

#[cfg(test)]
mod tests {
    use mvfusion_data::rest_width;

    use super::*;

    /// Tolerance for rounding in single precision.
    const ROUNDING: f64 = 2e-6;

    fn cloud() -> GaussianCloud {
        let rest = (0..rest_width(3)).map(|k| (k as f32 * 0.7).sin() * 0.2).collect();
        GaussianCloud {
            sh_degree: 3,
            means: vec![[1.0, -2.0, 0.5]],
            sh_dc: vec![[0.9, 0.4, 0.1]],
            sh_rest: rest,
            opacity_logits: vec![0.0],
            log_scales: vec![[0.0; 3]],
            quaternions: vec![[0.6, 0.0, 0.8, 0.0]],
            mask_logits: None,
            lifetimes: None,
        }
    }

    /// A turn about no axis of the world.
    fn turn() -> DMat3 {
        DMat3::from_quat(DQuat::from_xyzw(0.3, -0.5, 0.2, 0.7).normalize())
    }

    #[test]
    fn a_turned_gaussian_has_the_same_colour_from_the_turned_eye() {
        let (before, turn) = (cloud(), turn());
        let after = rotated(before.clone(), turn);
        for eye in [DVec3::new(4.0, 1.0, 2.0), DVec3::new(-3.0, 0.5, -6.0), DVec3::ZERO] {
            let [wanted] = mean_colours(&before, &[eye])[..] else { panic!("one colour") };
            let [found] = mean_colours(&after, &[turn * eye])[..] else { panic!("one colour") };
            for (found, wanted) in found.into_iter().zip(wanted) {
                assert!(f64::from(found - wanted).abs() < ROUNDING, "{found}, not {wanted}");
            }
        }
    }

    #[test]
    fn a_turned_gaussian_has_turned_axes() {
        let (before, turn) = (cloud(), turn());
        let after = rotated(before.clone(), turn);
        let axes = |[w, x, y, z]: [f32; 4]| {
            DMat3::from_quat(DQuat::from_xyzw(x.into(), y.into(), z.into(), w.into()).normalize())
        };
        let off = axes(after.quaternions[0]) - turn * axes(before.quaternions[0]);
        assert!(off.to_cols_array().iter().all(|part| part.abs() < ROUNDING), "{off}");
        let centre = turn * DVec3::new(1.0, -2.0, 0.5);
        assert!((DVec3::from_array(after.means[0].map(f64::from)) - centre).length() < ROUNDING);
    }

    #[test]
    fn no_turn_changes_nothing() {
        let same = rotated(cloud(), DMat3::IDENTITY);
        let off = same.sh_rest.iter().zip(&cloud().sh_rest).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(f64::from(off) < ROUNDING, "{off}");
    }

    #[test]
    fn a_colour_without_eyes_is_the_constant_part_and_with_some_their_mean() {
        let cloud = cloud();
        let [constant] = mean_colours(&cloud, &[])[..] else { panic!("one colour") };
        assert!((f64::from(constant[0]) - (0.5 + 0.282_094_791_773_878_14 * 0.9)).abs() < ROUNDING);
        let eyes = [DVec3::new(4.0, 1.0, 2.0), DVec3::new(-3.0, 0.5, -6.0)];
        let each = eyes.map(|eye| mean_colours(&cloud, &[eye])[0][1]);
        let both = mean_colours(&cloud, &eyes)[0][1];
        assert!(f64::from(both - 0.5 * (each[0] + each[1])).abs() < ROUNDING);
        let flat = without_directions(cloud, &eyes);
        assert_eq!(flat.sh_degree, 0);
        assert!(f64::from(mean_colours(&flat, &[])[0][1] - both).abs() < ROUNDING);
    }

    #[test]
    fn a_colour_above_one_stays_as_it_is() {
        let bright = GaussianCloud { sh_dc: vec![[3.0, 0.4, 0.1]], ..cloud() };
        let flat = without_directions(bright, &[DVec3::new(4.0, 1.0, 2.0)]);
        let [colour] = mean_colours(&flat, &[])[..] else { panic!("one colour") };
        assert!(colour[0] > 1.1, "{colour:?}");
    }
}
