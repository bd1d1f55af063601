//! Gaussians as a PLY file in the layout of 3DGS, which other viewers open.

use std::path::Path;

use anyhow::{Context, anyhow};
use mvfusion_model::gaussians::{Attribute, Gaussians};

use crate::atomic;

/// Colour channels.
const CHANNELS: usize = 3;

/// A group of columns, row-major.
struct Columns {
    names: Vec<String>,
    values: Vec<f32>,
}

/// Writes Gaussians as they are stored, before any activation: opacity as logit, scales as logarithms, rotation w, x, y,
/// z. The mask logits of the dynamic branch follow the standard properties as `mask_static`, `mask_brightness` and
/// `mask_dynamic`; readers go by name and pass over them. The header has no comments, because some readers count lines.
///
/// # Errors
/// If the device fails or the file cannot be written.
pub fn write_ply(gaussians: &Gaussians, path: &Path) -> anyhow::Result<()> {
    let count = gaussians.count();
    let read = |attribute: Attribute| -> anyhow::Result<Option<Vec<f32>>> {
        let Some(tensor) = gaussians.plain(attribute) else { return Ok(None) };
        let values = tensor.try_into_vec_as::<f32>();
        values.map(Some).map_err(|error| anyhow!("the device failed to hand over the {attribute}: {error}"))
    };
    let columns = columns(count, read).with_context(|| format!("cannot write {}", path.display()))?;
    atomic::write(path, &encode(count, &columns))
}

/// The columns of `count` Gaussians in the file's order; `read` hands over an attribute, row-major.
fn columns(count: usize, read: impl Fn(Attribute) -> anyhow::Result<Option<Vec<f32>>>) -> anyhow::Result<Vec<Columns>> {
    let mut columns = vec![group(&["x", "y", "z"], read(Attribute::Means)?)];
    columns.push(group(&["nx", "ny", "nz"], Some(vec![0.0; 3 * count])));
    columns.push(group(&["f_dc_0", "f_dc_1", "f_dc_2"], read(Attribute::ShDc)?));
    columns.push(higher_colour(count, read(Attribute::ShRest)?.unwrap_or_default()));
    columns.push(group(&["opacity"], read(Attribute::OpacityLogits)?));
    columns.push(group(&["scale_0", "scale_1", "scale_2"], read(Attribute::LogScales)?));
    columns.push(group(&["rot_0", "rot_1", "rot_2", "rot_3"], read(Attribute::Quaternions)?));
    if let Some(masks) = read(Attribute::MaskLogits)? {
        columns.push(group(&["mask_static", "mask_brightness", "mask_dynamic"], Some(masks)));
    }
    Ok(columns)
}

fn group(names: &[&str], values: Option<Vec<f32>>) -> Columns {
    Columns { names: names.iter().map(|&name| name.to_owned()).collect(), values: values.unwrap_or_default() }
}

/// The higher colour coefficients: ours go coefficient by coefficient, the file's channel by channel.
fn higher_colour(count: usize, values: Vec<f32>) -> Columns {
    let width = values.len() / count.max(1);
    let coefficients = width / CHANNELS;
    let names = (0..width).map(|index| format!("f_rest_{index}")).collect();
    let transposed = values
        .chunks_exact(width.max(1))
        .flat_map(|row| {
            (0..CHANNELS).flat_map(move |channel| (0..coefficients).map(move |k| row[k * CHANNELS + channel]))
        })
        .collect();
    Columns { names, values: transposed }
}

fn encode(count: usize, columns: &[Columns]) -> Vec<u8> {
    let mut header = format!("ply\nformat binary_little_endian 1.0\nelement vertex {count}\n");
    for name in columns.iter().flat_map(|group| &group.names) {
        header.push_str(&format!("property float {name}\n"));
    }
    header.push_str("end_header\n");
    let mut bytes = header.into_bytes();
    for row in 0..count {
        for group in columns {
            let width = group.names.len();
            let values = &group.values[row * width..(row + 1) * width];
            bytes.extend(values.iter().flat_map(|value| value.to_le_bytes()));
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
    fn attribute(attribute: Attribute, sh_degree: usize) -> Option<Vec<f32>> {
        let width = match attribute {
            Attribute::Means | Attribute::ShDc | Attribute::LogScales | Attribute::MaskLogits => 3,
            Attribute::ShRest => CHANNELS * ((sh_degree + 1).pow(2) - 1),
            Attribute::OpacityLogits => 1,
            Attribute::Quaternions => 4,
        };
        let place = Attribute::ALL.iter().position(|&other| other == attribute).expect("listed");
        Some((0..2 * width).map(|i| (100_000 * place + 1000 * (i / width) + i % width) as f32).collect())
    }

    #[test]
    fn every_number_is_found_again_by_its_name() {
        let properties = read(&encode(2, &columns(2, |name| Ok(attribute(name, 3))).expect("columns")));
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
    fn the_static_branch_has_the_standard_properties_in_the_standard_order() {
        let without_masks = |name| Ok(attribute(name, 3).filter(|_| name != Attribute::MaskLogits));
        let columns = columns(2, without_masks).expect("columns");
        let names: Vec<&str> = columns.iter().flat_map(|group| &group.names).map(String::as_str).collect();
        assert_eq!(names[..10], ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", "f_rest_0"]);
        assert_eq!(
            names[53..],
            ["f_rest_44", "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
        );
    }

    #[test]
    fn lower_degrees_have_fewer_coefficients() {
        for (degree, count) in [(0, 0), (1, 9), (2, 24)] {
            let properties = read(&encode(2, &columns(2, |name| Ok(attribute(name, degree))).expect("columns")));
            assert_eq!(properties.keys().filter(|name| name.starts_with("f_rest_")).count(), count);
        }
    }
}
