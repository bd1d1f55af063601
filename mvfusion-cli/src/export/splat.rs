//! The format `.splat` of antimatter15's viewer: 32 bytes per Gaussian, no header.

use std::path::Path;

use mvfusion_data::GaussianCloud;
use mvfusion_model::model::gaussians::SH_C0;

use super::activated::{opacity, unit_quaternion};
use crate::atomic;

/// Bytes of a Gaussian.
const RECORD: usize = 32;

/// Writes Gaussians as records: centre and scales as floats, colour and opacity as bytes, rotation w, x, y, z as bytes
/// around 128. The most visible Gaussians come first, because viewers draw a file while it loads. Only the constant
/// colour is written.
///
/// # Errors
/// If the file cannot be written.
pub fn write_splat(gaussians: &GaussianCloud, path: &Path) -> anyhow::Result<()> {
    atomic::write(path, &encode(gaussians))
}

fn encode(gaussians: &GaussianCloud) -> Vec<u8> {
    let mut order: Vec<(f64, usize)> = (0..gaussians.len()).map(|index| (weight(gaussians, index), index)).collect();
    order.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut bytes = Vec::with_capacity(RECORD * order.len());
    for (_, index) in order {
        let sizes = gaussians.log_scales[index].map(f32::exp);
        bytes.extend(gaussians.means[index].into_iter().chain(sizes).flat_map(f32::to_le_bytes));
        bytes.extend(gaussians.sh_dc[index].map(|dc| byte(255.0 * (0.5 + SH_C0 * f64::from(dc)))));
        bytes.push(byte(255.0 * opacity(gaussians.opacity_logits[index])));
        bytes.extend(unit_quaternion(gaussians.quaternions[index]).map(|part| byte(128.0 * part + 128.0)));
    }
    bytes
}

/// Volume times opacity.
fn weight(gaussians: &GaussianCloud, index: usize) -> f64 {
    gaussians.log_scales[index].map(f64::from).iter().sum::<f64>().exp() * opacity(gaussians.opacity_logits[index])
}

fn byte(value: f64) -> u8 {
    value.round().clamp(0.0, 255.0) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cloud() -> GaussianCloud {
        GaussianCloud {
            sh_degree: 0,
            means: vec![[1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [7.0, 8.0, 9.0]],
            sh_dc: vec![[0.0; 3], [0.0; 3], [1.772_453_9, -9.0, 0.354_490_77]],
            sh_rest: Vec::new(),
            opacity_logits: vec![0.0, -20.0, 1.098_612_3],
            log_scales: vec![[0.0; 3], [0.0; 3], [0.0, std::f32::consts::LN_2, -std::f32::consts::LN_2]],
            quaternions: vec![[0.0; 4], [1.0, 0.0, 0.0, 0.0], [2.0, -2.0, 0.0, 0.0]],
            mask_logits: None,
            lifetimes: None,
        }
    }

    #[test]
    fn a_record_is_what_the_format_says_byte_by_byte() {
        let bytes = encode(&cloud());
        assert_eq!(bytes.len(), 3 * 32);
        // The third Gaussian has volume 1 and opacity 0.75, the first 1 and 0.5, the second next to none.
        let record = &bytes[..32];
        let float = |at: usize| f32::from_le_bytes([record[at], record[at + 1], record[at + 2], record[at + 3]]);
        assert_eq!([float(0), float(4), float(8)], [7.0, 8.0, 9.0]);
        assert_eq!([float(12), float(16), float(20)], [1.0, 2.0, 0.5]);
        // 0.5 + 0.28209479 * 1.7724539 = 1; far below 0; 0.6. Opacity 0.75.
        assert_eq!(record[24..28], [255, 0, 153, 191]);
        // (1, -1, 0, 0) / sqrt(2): 128 +- 90.5.
        assert_eq!(record[28..], [219, 37, 128, 128]);
    }

    #[test]
    fn what_shows_most_comes_first() {
        let bytes = encode(&cloud());
        let x = |record: usize| f32::from_le_bytes([0, 1, 2, 3].map(|byte| bytes[32 * record + byte]));
        assert_eq!([x(0), x(1), x(2)], [7.0, 1.0, 4.0]);
        // A quaternion of no length turns nothing; 256 does not fit into a byte.
        assert_eq!(bytes[32 + 28..64], [255, 128, 128, 128]);
    }
}
