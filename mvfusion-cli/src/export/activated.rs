//! The parameters of Gaussians after activation, as formats other than PLY store them.

/// The sigmoid of a logit.
pub fn opacity(logit: f32) -> f64 {
    1.0 / (1.0 + f64::from(-logit).exp())
}

/// The logit of an opacity between 0 and 1, finite also at the ends.
pub fn logit(opacity: f64) -> f32 {
    // Less than 8-bit images show, and far from the precision of a float.
    const MARGIN: f64 = 1e-6;
    let opacity = opacity.clamp(MARGIN, 1.0 - MARGIN);
    (opacity / (1.0 - opacity)).ln() as f32
}

/// A rotation w, x, y, z as a unit quaternion. A zero quaternion becomes the identity.
pub fn unit_quaternion(quaternion: [f32; 4]) -> [f64; 4] {
    let parts = quaternion.map(f64::from);
    let length = parts.iter().map(|part| part * part).sum::<f64>().sqrt();
    if length > 0.0 { parts.map(|part| part / length) } else { [1.0, 0.0, 0.0, 0.0] }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn opacities_and_logits_are_inverse_and_finite() {
        for share in [0.25, 0.5, 0.999] {
            assert!((opacity(logit(share)) - share).abs() < 1e-6);
        }
        assert!(logit(0.0).is_finite() && logit(1.0).is_finite() && opacity(logit(1.0)) > 0.99999);
    }

    #[test]
    fn quaternions_get_length_one() {
        assert_eq!(unit_quaternion([0.0, 3.0, 0.0, 4.0]), [0.0, 0.6, 0.0, 0.8]);
        assert_eq!(unit_quaternion([0.0; 4]), [1.0, 0.0, 0.0, 0.0]);
    }
}
