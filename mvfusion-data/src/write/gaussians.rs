//! Gaussians as a PLY file in the layout of 3DGS, which other viewers open.

use crate::{GaussianCloud, LIFETIME_FIELDS, MASK_FIELDS, rest_width};

/// Colour channels.
const CHANNELS: usize = 3;

/// The properties after the colours, in the standard order.
const SHAPE: [&str; 8] = ["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"];

/// The names of the properties in the file's order.
fn names(gaussians: &GaussianCloud) -> Vec<String> {
    let before = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"].map(str::to_owned);
    let rest = (0..rest_width(gaussians.sh_degree)).map(|index| format!("f_rest_{index}"));
    let masks = gaussians.mask_logits.as_ref().map(|_| MASK_FIELDS).into_iter().flatten();
    let lifetimes = gaussians.lifetimes.as_ref().map(|_| LIFETIME_FIELDS).into_iter().flatten();
    let after = SHAPE.into_iter().chain(masks).chain(lifetimes).map(str::to_owned);
    before.into_iter().chain(rest).chain(after).collect()
}

/// Gaussians as a binary PLY file, as stored, before any activation: opacities as logits, scales as logarithms, rotations
/// as w, x, y, z, and zeros for normals. Mask logits follow the standard properties as `mask_static`, `mask_brightness`
/// and `mask_dynamic`, lifetimes as `time_centre`, `log_duration` and `velocity_x` to `velocity_z`. Readers look up
/// properties by name and ignore these. The header has no comments, because some readers count lines.
pub fn gaussian_ply(gaussians: &GaussianCloud) -> Vec<u8> {
    let names = names(gaussians);
    let mut header = format!("ply\nformat binary_little_endian 1.0\nelement vertex {}\n", gaussians.len());
    for name in &names {
        header.push_str(&format!("property float {name}\n"));
    }
    header.push_str("end_header\n");
    let mut bytes = header.into_bytes();
    bytes.reserve(gaussians.len() * names.len() * size_of::<f32>());
    for index in 0..gaussians.len() {
        let mut put = |values: &[f32]| bytes.extend(values.iter().flat_map(|value| value.to_le_bytes()));
        put(&gaussians.means[index]);
        put(&[0.0; 3]);
        put(&gaussians.sh_dc[index]);
        // Our order is by coefficient, the file's by channel.
        let rest = gaussians.rest(index);
        for channel in 0..CHANNELS {
            rest.iter().skip(channel).step_by(CHANNELS).for_each(|&value| put(&[value]));
        }
        put(&[gaussians.opacity_logits[index]]);
        put(&gaussians.log_scales[index]);
        put(&gaussians.quaternions[index]);
        if let Some(masks) = &gaussians.mask_logits {
            put(&masks[index]);
        }
        if let Some(lifetimes) = &gaussians.lifetimes {
            put(&lifetimes[index].to_array());
        }
    }
    bytes
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;

    /// Reads every property by its name, from the format's description alone.
    fn read(bytes: &[u8]) -> BTreeMap<String, Vec<f32>> {
        const END: &[u8] = b"end_header\n";
        let end = bytes.windows(END.len()).position(|window| window == END).expect("a header") + END.len();
        let header = std::str::from_utf8(&bytes[..end]).expect("text");
        let mut lines = header.lines();
        assert_eq!((lines.next(), lines.next()), (Some("ply"), Some("format binary_little_endian 1.0")));
        let count: usize =
            lines.next().and_then(|line| line.strip_prefix("element vertex ")).expect("count").parse().expect("number");
        let names: Vec<&str> = lines.filter_map(|line| line.strip_prefix("property float ")).collect();
        let body: Vec<f32> =
            bytes[end..].chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
        assert_eq!(body.len(), count * names.len());
        let column = |index: usize| body.iter().skip(index).step_by(names.len()).copied().collect();
        names.iter().enumerate().map(|(index, name)| ((*name).to_owned(), column(index))).collect()
    }

    /// Two Gaussians; every number tells its attribute (hundreds of thousands), row (thousands) and column.
    fn cloud(sh_degree: usize) -> GaussianCloud {
        let flat = |place: usize, width: usize| {
            (0..2 * width).map(move |i| (100_000 * place + 1000 * (i / width) + i % width) as f32)
        };
        fn rows<const N: usize>(values: impl Iterator<Item = f32>) -> Vec<[f32; N]> {
            values.collect::<Vec<_>>().as_chunks().0.to_vec()
        }
        GaussianCloud {
            sh_degree,
            means: rows(flat(0, 3)),
            sh_dc: rows(flat(1, 3)),
            sh_rest: flat(2, rest_width(sh_degree).max(1)).take(2 * rest_width(sh_degree)).collect(),
            opacity_logits: flat(3, 1).collect(),
            log_scales: rows(flat(4, 3)),
            quaternions: rows(flat(5, 4)),
            mask_logits: Some(rows(flat(6, 3))),
            lifetimes: None,
        }
    }

    #[test]
    fn every_number_is_found_again_by_its_name() {
        let properties = read(&gaussian_ply(&cloud(3)));
        assert_eq!(properties.len(), 62 + 3);
        assert_eq!(properties["y"], [1.0, 1001.0]);
        assert_eq!(properties["nz"], [0.0, 0.0]);
        assert_eq!(properties["f_dc_2"], [100_002.0, 101_002.0]);
        assert_eq!(properties["opacity"], [300_000.0, 301_000.0]);
        assert_eq!(properties["scale_1"], [400_001.0, 401_001.0]);
        assert_eq!(properties["rot_0"], [500_000.0, 501_000.0]);
        assert_eq!(properties["mask_dynamic"], [600_002.0, 601_002.0]);
        // Channel-major in the file: entry 15 c + k is colour c of coefficient k, which we keep at 3 k + c.
        for (c, k) in [(0, 0), (0, 14), (1, 0), (2, 7), (2, 14)] {
            let ours = (200_000 + 3 * k + c) as f32;
            assert_eq!(properties[&format!("f_rest_{}", 15 * c + k)], [ours, ours + 1000.0]);
        }
    }

    #[test]
    fn without_masks_there_are_the_standard_properties_in_the_standard_order() {
        let names = names(&GaussianCloud { mask_logits: None, ..cloud(3) });
        assert_eq!(names[..10], ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", "f_rest_0"]);
        assert_eq!(
            names[53..],
            ["f_rest_44", "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
        );
    }

    #[test]
    fn lower_degrees_have_fewer_coefficients() {
        for (degree, count) in [(0, 0), (1, 9), (2, 24)] {
            let properties = read(&gaussian_ply(&cloud(degree)));
            assert_eq!(properties.keys().filter(|name| name.starts_with("f_rest_")).count(), count);
        }
    }
}
