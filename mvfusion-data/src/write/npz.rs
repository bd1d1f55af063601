//! Gaussians as a NumPy archive.

use std::io::{self, Cursor, Write};

use npyz::{WriteOptions, WriterBuilder};
use zip::ZipWriter;
use zip::write::SimpleFileOptions;

use crate::GaussianCloud;

/// Gaussians as an `.npz` archive, not compressed: the arrays of [`GaussianCloud::to_arrays`] as `float32`, and the
/// scalar `time` as `float64` if they belong to one.
///
/// # Errors
/// If the archive cannot be made, which its writer allows for.
pub fn gaussian_npz(gaussians: &GaussianCloud, time: Option<f64>) -> io::Result<Vec<u8>> {
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    for array in gaussians.to_arrays() {
        add(&mut archive, array.name, &npy(&array.shape, array.values)?)?;
    }
    if let Some(time) = time {
        add(&mut archive, "time", &npy(&[], vec![time])?)?;
    }
    Ok(archive.finish()?.into_inner())
}

/// An array as the bytes of an `.npy` file, row by row.
fn npy<T: npyz::AutoSerialize>(shape: &[usize], values: Vec<T>) -> io::Result<Vec<u8>> {
    let shape: Vec<u64> = shape.iter().map(|&length| length as u64).collect();
    let mut bytes = Vec::new();
    let mut writer = WriteOptions::new().default_dtype().shape(&shape).writer(&mut bytes).begin_nd()?;
    writer.extend(values)?;
    writer.finish()?;
    Ok(bytes)
}

fn add(archive: &mut ZipWriter<Cursor<Vec<u8>>>, name: &str, npy: &[u8]) -> io::Result<()> {
    let options = SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored);
    // Sizes of 4 GiB and more need the longer fields of zip.
    archive.start_file(format!("{name}.npy"), options.large_file(npy.len() >= u32::MAX as usize))?;
    archive.write_all(npy)
}
