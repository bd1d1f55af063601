//! Files of common formats, as bytes.

use std::io::{self, Cursor, Write};

use npyz::{AutoSerialize, WriteOptions, WriterBuilder};
use serde::Serialize;
use zip::write::SimpleFileOptions;

use super::error::Misfit;
use crate::scene::PointCloud;

/// A colour channel in `[0, 1]` as 8 bits.
pub(super) fn byte(channel: f32) -> u8 {
    (channel * 255.0).round().clamp(0.0, 255.0) as u8
}

/// An array as an `.npy` file, row by row.
pub(super) fn npy<T: AutoSerialize>(shape: &[usize], values: impl IntoIterator<Item = T>) -> io::Result<Vec<u8>> {
    let shape: Vec<u64> = shape.iter().map(|&n| n as u64).collect();
    let mut bytes = Vec::new();
    let mut writer = WriteOptions::new().default_dtype().shape(&shape).writer(&mut bytes).begin_nd()?;
    writer.extend(values)?;
    writer.finish()?;
    Ok(bytes)
}

/// A compressed `.npz` file with one array.
pub(super) fn npz(key: &str, array: &[u8]) -> io::Result<Vec<u8>> {
    let mut zip = zip::ZipWriter::new(Cursor::new(Vec::new()));
    let options = SimpleFileOptions::default().compression_method(zip::CompressionMethod::Deflated);
    zip.start_file(format!("{key}.npy"), options)?;
    zip.write_all(array)?;
    Ok(zip.finish()?.into_inner())
}

/// A value as an indented JSON file.
pub(super) fn json(value: &impl Serialize) -> Result<Vec<u8>, Misfit> {
    let mut bytes = serde_json::to_vec_pretty(value).map_err(|e| e.to_string())?;
    bytes.push(b'\n');
    Ok(bytes)
}

/// A point cloud as a binary PLY file. Its normals are zero. 3DGS and similar programs require them.
pub fn ply(points: &PointCloud) -> Vec<u8> {
    let mut bytes = format!("ply\nformat binary_little_endian 1.0\nelement vertex {}\n", points.len()).into_bytes();
    for name in ["x", "y", "z", "nx", "ny", "nz"] {
        bytes.extend(format!("property float {name}\n").bytes());
    }
    for name in ["red", "green", "blue"] {
        bytes.extend(format!("property uchar {name}\n").bytes());
    }
    bytes.extend(b"end_header\n");
    for (position, colour) in points.positions.iter().zip(&points.colours) {
        let normal = [0.0f32; 3];
        bytes.extend(position.to_array().into_iter().chain(normal).flat_map(f32::to_le_bytes));
        bytes.extend(colour.to_array().map(byte));
    }
    bytes
}
