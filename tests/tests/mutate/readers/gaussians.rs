//! PLY files of points and of Gaussians.

use std::fs;
use std::path::Path;

use mvfusion_data::{GaussianCloud, PointCloud, read_gaussians, read_points, rest_width};

use super::{SCENES, Target, Targets, answer_of};
use crate::mutation::Kind;

/// The readers of this file.
pub const READERS: &[(&str, Targets)] = &[("ply_points", points), ("ply_gaussians", gaussians)];

/// Number of Gaussians in a file. Their rows take more memory than [`SCENES`] allows for anything.
const GAUSSIANS: usize = 600;

fn points(place: &Path) -> Vec<Target> {
    let fields = ["x", "y", "z"].map(|name| format!("property float {name}\n")).concat()
        + &["red", "green", "blue"].map(|name| format!("property uchar {name}\n")).concat();
    let head = |format: &str| {
        format!(
            "ply\nformat {format} 1.0\ncomment made by hand\nelement vertex 20\n{fields}element face 1\n\
                 property list uchar int vertex_indices\nend_header\n"
        )
    };
    let float = |row: usize, column: usize| (row * 3 + column) as f32 / 7.0 - 4.0;
    let bytes = |order: fn(f32) -> [u8; 4], index: fn(i32) -> [u8; 4]| -> Vec<u8> {
        let row = |row: usize| (0..3).flat_map(move |column| order(float(row, column))).chain([row as u8, 9, 200]);
        let face = [3].into_iter().chain((0..3).flat_map(index));
        (0..20).flat_map(row).chain(face).collect()
    };
    let row = |row: usize| format!("{} {} {} {row} 9 200\n", float(row, 0), float(row, 1), float(row, 2));
    let text: String = (0..20).map(row).chain(["3 0 1 2\n".to_owned()]).collect();
    let files = [
        head("binary_little_endian")
            .into_bytes()
            .into_iter()
            .chain(bytes(f32::to_le_bytes, i32::to_le_bytes))
            .collect(),
        head("binary_big_endian").into_bytes().into_iter().chain(bytes(f32::to_be_bytes, i32::to_be_bytes)).collect(),
        (head("ascii") + &text).into_bytes(),
    ];
    targets(place, files, |path| {
        super::answer_of(read_points(path), |cloud: PointCloud| {
            let all = cloud.positions.iter().chain(&cloud.colours);
            match all.clone().find(|point| !point.is_finite()) {
                Some(point) => Err(format!("a point holds {point}")),
                None if cloud.positions.len() != cloud.colours.len() => Err("a point has no colour".into()),
                None => Ok(()),
            }
        })
    })
}

/// Gaussians as 3DGS writes them, in binary and as text; the second file has masks, which only our program writes.
fn gaussians(place: &Path) -> Vec<Target> {
    let header = |format: &str, names: &[String]| {
        let fields: String = names.iter().map(|name| format!("property float {name}\n")).collect();
        format!("ply\nformat {format} 1.0\nelement vertex {GAUSSIANS}\n{fields}end_header\n")
    };
    let names = |before: &[&str], rest: usize, after: &[&str]| -> Vec<String> {
        let own = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect::<Vec<_>>();
        [own(before), (0..rest).map(|index| format!("f_rest_{index}")).collect(), own(after)].concat()
    };
    let before = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"];
    let after = ["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"];
    let masks = ["mask_static", "mask_brightness", "mask_dynamic"];
    let value = |place: usize| (place % 97) as f32 / 10.0 - 4.0;

    let standard = names(&before, 45, &after);
    let mut binary = header("binary_little_endian", &standard).into_bytes();
    binary.extend((0..GAUSSIANS * standard.len()).flat_map(|place| value(place).to_le_bytes()));
    let masked = names(&before, 9, &[after.as_slice(), &masks].concat());
    let mut text = header("ascii", &masked);
    for row in 0..GAUSSIANS {
        let words: Vec<String> = (0..masked.len()).map(|column| value(row + column).to_string()).collect();
        text.push_str(&words.join(" "));
        text.push('\n');
    }
    targets(place, [binary, text.into_bytes()], |path| answer_of(read_gaussians(path), |cloud| whole(&cloud)))
}

fn targets<const N: usize>(place: &Path, files: [Vec<u8>; N], read: fn(&Path) -> super::Answer) -> Vec<Target> {
    let target = |(number, content): (usize, Vec<u8>)| {
        let file = place.join(format!("{number}.ply"));
        fs::write(&file, content).expect("written");
        assert_eq!(read(&file), Ok(Ok(())), "a sound file");
        let path = file.clone();
        Target { file, kind: Kind::Ply, room: SCENES, others: 0, read: Box::new(move || read(&path)) }
    };
    files.into_iter().enumerate().map(target).collect()
}

/// Whether all lists of a cloud have an entry for each Gaussian, and all numbers and sizes are finite.
fn whole(cloud: &GaussianCloud) -> Result<(), String> {
    let count = cloud.len();
    let lengths = [cloud.sh_dc.len(), cloud.opacity_logits.len(), cloud.log_scales.len(), cloud.quaternions.len()];
    let masks = cloud.mask_logits.as_ref().map_or(count, Vec::len);
    if lengths != [count; 4] || masks != count || cloud.sh_rest.len() != count * rest_width(cloud.sh_degree) {
        return Err(format!("{count} Gaussians with {lengths:?}, {masks}, {}", cloud.sh_rest.len()));
    }
    if let Some(sizes) = cloud.log_scales.iter().find(|sizes| !sizes.iter().all(|size| size.exp().is_finite())) {
        return Err(format!("a Gaussian has the sizes {sizes:?}"));
    }
    let threes = [&cloud.means, &cloud.sh_dc, &cloud.log_scales].into_iter().chain(&cloud.mask_logits);
    let numbers = threes.flat_map(|rows| rows.as_flattened()).chain(&cloud.sh_rest).chain(&cloud.opacity_logits);
    match numbers.chain(cloud.quaternions.as_flattened()).find(|value| !value.is_finite()) {
        Some(value) => Err(format!("a Gaussian holds {value}")),
        None => Ok(()),
    }
}
