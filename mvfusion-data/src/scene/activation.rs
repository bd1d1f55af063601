//! The parameters of Gaussians before and after activation.

/// Bound of logits. Probabilities of 0 and 1 become finite logits and are 2e-9 off.
const LARGEST_LOGIT: f64 = 20.0;

/// The opacity or mask probability of a logit: the logistic function.
pub fn sigmoid(logit: f32) -> f64 {
    1.0 / (1.0 + f64::from(-logit).exp())
}

/// The logit of a probability, the inverse of [`sigmoid`]. It is finite also at and beyond 0 and 1.
pub fn logit(probability: f64) -> f32 {
    let probability = probability.clamp(0.0, 1.0);
    (probability / (1.0 - probability)).ln().clamp(-LARGEST_LOGIT, LARGEST_LOGIT) as f32
}

/// A rotation w, x, y, z as a unit quaternion. A quaternion without a length becomes the identity.
pub fn unit_quaternion(quaternion: [f32; 4]) -> [f64; 4] {
    let parts = quaternion.map(f64::from);
    let length = parts.iter().map(|part| part * part).sum::<f64>().sqrt();
    if length > 0.0 && length.is_finite() { parts.map(|part| part / length) } else { [1.0, 0.0, 0.0, 0.0] }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn probabilities_and_logits_are_inverse_and_finite() {
        for share in [0.25, 0.5, 0.999] {
            assert!((sigmoid(logit(share)) - share).abs() < 1e-6);
        }
        assert!(logit(0.0).is_finite() && logit(1.5).is_finite() && sigmoid(logit(1.0)) > 0.999_999_99);
    }

    #[test]
    fn quaternions_get_length_one() {
        assert_eq!(unit_quaternion([0.0, 3.0, 0.0, 4.0]), [0.0, 0.6, 0.0, 0.8]);
        for nothing in [[0.0; 4], [f32::NAN, 0.0, 0.0, 0.0], [f32::INFINITY; 4]] {
            assert_eq!(unit_quaternion(nothing), [1.0, 0.0, 0.0, 0.0]);
        }
    }
}
