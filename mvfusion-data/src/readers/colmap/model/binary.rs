//! Binary files of a COLMAP model: a count, then little-endian records.
//!
//! A count in a file is only trusted if the file contains the bytes that it announces.

use super::complaint::Complaint;
use super::lens::{CameraRecord, LensModel};
use super::records::{ImageRecord, push_point};
use crate::scene::PointCloud;

/// Minimum bytes of a camera: camera and model number, two sides, three parameters.
const LEAST_CAMERA: usize = 4 + 4 + 2 * 8 + 3 * 8;

/// Minimum bytes of an image: its number, seven numbers of the pose, its camera, the end of its name, a count.
const LEAST_IMAGE: usize = 4 + 7 * 8 + 4 + 1 + 8;

/// Bytes of an observation in an image: two coordinates and the point's number.
const OBSERVATION: usize = 3 * 8;

/// Minimum bytes of a point: its number, three coordinates, a colour, an error, a count.
const LEAST_POINT: usize = 8 + 3 * 8 + 3 + 8 + 8;

/// Bytes of an entry in a point's track: the numbers of an image and of an observation in it.
const TRACK_ENTRY: usize = 2 * 4;

/// Reads `cameras.bin`.
pub(crate) fn cameras(bytes: &[u8]) -> Result<Vec<CameraRecord>, Complaint> {
    let mut reader = Reader::new(bytes);
    let count = reader.count(LEAST_CAMERA, "cameras")?;
    let mut cameras = Vec::with_capacity(count);
    for _ in 0..count {
        let id = reader.u32()?;
        let model = LensModel::numbered(reader.i32()?, id)?;
        let (width, height) = (reader.u64()?, reader.u64()?);
        let parameters = (0..model.parameters()).map(|_| reader.f64()).collect::<Result<_, _>>()?;
        cameras.push(CameraRecord { id, model, width, height, parameters });
    }
    reader.finish()?;
    Ok(cameras)
}

/// Reads `images.bin`. Observations are skipped.
pub(crate) fn images(bytes: &[u8]) -> Result<Vec<ImageRecord>, Complaint> {
    let mut reader = Reader::new(bytes);
    let count = reader.count(LEAST_IMAGE, "images")?;
    let mut images = Vec::with_capacity(count);
    for _ in 0..count {
        reader.u32()?; // Names identify images, so numbers are not needed.
        let quaternion = reader.floats()?;
        let translation = reader.floats()?;
        let camera = reader.u32()?;
        let name = reader.name()?;
        reader.pass_over(OBSERVATION, "observations")?;
        images.push(ImageRecord { name, camera, quaternion, translation });
    }
    reader.finish()?;
    Ok(images)
}

/// Reads `points3D.bin`. Errors and tracks are skipped.
pub(crate) fn points(bytes: &[u8]) -> Result<PointCloud, Complaint> {
    let mut reader = Reader::new(bytes);
    let count = reader.count(LEAST_POINT, "points")?;
    let mut points = PointCloud::default();
    for _ in 0..count {
        reader.u64()?; // The point's number.
        let position = reader.floats()?;
        let colour = reader.take()?;
        reader.f64()?; // The mean reprojection error.
        reader.pass_over(TRACK_ENTRY, "observations")?;
        push_point(&mut points, position, colour)?;
    }
    reader.finish()?;
    Ok(points)
}

/// Bytes that are read from the front.
struct Reader<'a> {
    rest: &'a [u8],
    length: usize,
}

impl<'a> Reader<'a> {
    fn new(bytes: &'a [u8]) -> Self {
        Self { rest: bytes, length: bytes.len() }
    }

    fn position(&self) -> usize {
        self.length - self.rest.len()
    }

    fn take<const N: usize>(&mut self) -> Result<[u8; N], String> {
        let (head, rest) = self
            .rest
            .split_first_chunk()
            .ok_or_else(|| format!("it ends after {} bytes, in the middle of a record", self.length))?;
        self.rest = rest;
        Ok(*head)
    }

    fn u32(&mut self) -> Result<u32, String> {
        self.take().map(u32::from_le_bytes)
    }

    fn i32(&mut self) -> Result<i32, String> {
        self.take().map(i32::from_le_bytes)
    }

    fn u64(&mut self) -> Result<u64, String> {
        self.take().map(u64::from_le_bytes)
    }

    fn f64(&mut self) -> Result<f64, String> {
        self.take().map(f64::from_le_bytes)
    }

    fn floats<const N: usize>(&mut self) -> Result<[f64; N], String> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.f64()?;
        }
        Ok(values)
    }

    /// Reads the number of records that follow, each of `least` bytes or more.
    fn count(&mut self, least: usize, what: &str) -> Result<usize, String> {
        let at = self.position();
        let (count, room) = (self.u64()?, self.rest.len() / least);
        usize::try_from(count).ok().filter(|&count| count <= room).ok_or_else(|| {
            format!("it announces {count} {what} at byte {at}, and the rest has room for {room} at most")
        })
    }

    /// Skips records of `size` bytes each, and their count.
    fn pass_over(&mut self, size: usize, what: &str) -> Result<(), String> {
        let count = self.count(size, what)?;
        self.rest = &self.rest[count * size..]; // `count` checked that they exist.
        Ok(())
    }

    /// Reads a text that ends with a zero byte.
    fn name(&mut self) -> Result<String, String> {
        let at = self.position();
        let end = self.rest.iter().position(|&b| b == 0).ok_or("it ends in the middle of an image's name")?;
        let name =
            str::from_utf8(&self.rest[..end]).map_err(|_| format!("the image's name at byte {at} is no UTF-8"))?;
        self.rest = &self.rest[end + 1..];
        Ok(name.to_owned())
    }

    /// Checks that no byte is left.
    fn finish(self) -> Result<(), String> {
        match self.rest.len() {
            0 => Ok(()),
            more => Err(format!("{more} bytes follow after the last record")),
        }
    }
}
