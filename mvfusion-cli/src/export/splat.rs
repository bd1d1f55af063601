//! The format `.splat` of antimatter15's viewer: 32 bytes per Gaussian, no header.

use mvfusion_data::{GaussianCloud, logit, sigmoid, unit_quaternion};
use mvfusion_model::model::gaussians::SH_C0;

/// Bytes of a Gaussian.
const RECORD: usize = 32;

/// Gaussians as records: centre and scales as floats, colour and opacity as bytes, rotation w, x, y, z as bytes around
/// 128. The most visible Gaussians come first, because viewers draw a file while it loads. Only the constant colour is
/// written.
pub fn encode_splat(gaussians: &GaussianCloud) -> Vec<u8> {
    let mut order: Vec<(f64, usize)> = (0..gaussians.len()).map(|index| (weight(gaussians, index), index)).collect();
    order.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut bytes = Vec::with_capacity(RECORD * order.len());
    for (_, index) in order {
        let sizes = gaussians.log_scales[index].map(f32::exp);
        bytes.extend(gaussians.means[index].into_iter().chain(sizes).flat_map(f32::to_le_bytes));
        bytes.extend(gaussians.sh_dc[index].map(|dc| byte(255.0 * (0.5 + SH_C0 * f64::from(dc)))));
        bytes.push(byte(255.0 * sigmoid(gaussians.opacity_logits[index])));
        bytes.extend(unit_quaternion(gaussians.quaternions[index]).map(|part| byte(128.0 * part + 128.0)));
    }
    bytes
}

/// The Gaussians of a file, as viewers understand it.
pub fn decode_splat(bytes: &[u8]) -> GaussianCloud {
    let mut gaussians = GaussianCloud::default();
    for record in bytes.as_chunks::<RECORD>().0 {
        let float = |place: usize| f32::from_le_bytes([0, 1, 2, 3].map(|byte| record[4 * place + byte]));
        let level = |place: usize| f64::from(record[place]) / 255.0;
        gaussians.means.push([0, 1, 2].map(float));
        // The logarithm of zero is no number.
        gaussians.log_scales.push([3, 4, 5].map(|place| float(place).max(f32::MIN_POSITIVE).ln()));
        gaussians.sh_dc.push([24, 25, 26].map(|place| ((level(place) - 0.5) / SH_C0) as f32));
        gaussians.opacity_logits.push(logit(level(27)));
        gaussians.quaternions.push([28, 29, 30, 31].map(|place| (f32::from(record[place]) - 128.0) / 128.0));
    }
    gaussians
}

/// Volume times opacity.
fn weight(gaussians: &GaussianCloud, index: usize) -> f64 {
    gaussians.log_scales[index].map(f64::from).iter().sum::<f64>().exp() * sigmoid(gaussians.opacity_logits[index])
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
        let bytes = encode_splat(&cloud());
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
        let bytes = encode_splat(&cloud());
        let x = |record: usize| f32::from_le_bytes([0, 1, 2, 3].map(|byte| bytes[32 * record + byte]));
        assert_eq!([x(0), x(1), x(2)], [7.0, 1.0, 4.0]);
        // A quaternion of no length turns nothing; 256 does not fit into a byte.
        assert_eq!(bytes[32 + 28..64], [255, 128, 128, 128]);
    }
    #[test]
    fn a_file_is_read_as_it_was_written() {
        let (wanted, found) = (cloud(), decode_splat(&encode_splat(&cloud())));
        // By weight: the third, the first, the second.
        for (row, index) in [2, 0, 1].into_iter().enumerate() {
            assert_eq!(found.means[row], wanted.means[index]);
            let scales = found.log_scales[row].iter().zip(wanted.log_scales[index]);
            assert!(scales.map(|(a, b)| (a - b).abs()).all(|off| off < 1e-6));
            let opacity = |cloud: &GaussianCloud, index: usize| sigmoid(cloud.opacity_logits[index]);
            assert!((opacity(&found, row) - opacity(&wanted, index)).abs() <= 0.5 / 255.0 + 1e-9);
            let turn = |cloud: &GaussianCloud, index: usize| unit_quaternion(cloud.quaternions[index]);
            let off = turn(&found, row).into_iter().zip(turn(&wanted, index)).map(|(a, b)| (a - b).abs());
            assert!(off.fold(0.0, f64::max) < 0.01, "{:?}", found.quaternions[row]);
        }
        let levels = found.sh_dc[0].map(|dc| (0.5 + SH_C0 * f64::from(dc)) * 255.0);
        assert!(levels.iter().zip([255.0, 0.0, 153.0]).all(|(a, b)| (a - b).abs() < 1e-3), "{levels:?}");
    }
}
