//! Gaussians in PLY files of 3DGS, gsplat, Brush and similar programs, read by the names of their fields.

mod table;
#[cfg(test)]
mod tests;

use std::fmt;
use std::io::{BufRead, BufReader, ErrorKind};
use std::path::Path;

use serde::Deserialize;
use serde::de::{DeserializeSeed, Deserializer, Error, IgnoredAny, MapAccess, SeqAccess, Visitor};
use serde_ply::{DeserializeError, PlyReader};

use super::element::{check_room, vertex_element};
use crate::error::DataError;
use crate::files::{open_file, or_denied};
use crate::scene::GaussianCloud;
use table::{Columns, Table};

/// Reads the Gaussians of a PLY file, text or binary. All fields are floating-point numbers before any activation.
/// Required are `x y z`, `f_dc_0..2`, `opacity`, `scale_0..2` and `rot_0..3`. There are 0, 9, 24 or 45 fields
/// `f_rest_*`, channel by channel. Optional are the fields of this program: `mask_static`, `mask_brightness` and
/// `mask_dynamic`, and `time_centre`, `log_duration` and `velocity_x` to `velocity_z`. Other fields, such as normals,
/// are skipped.
///
/// # Errors
/// [`DataError::Content`] if the file cannot be read, lacks a field, or contains more or fewer rows than announced.
/// Also if a number is not finite or too large to compute with, or a size is beyond single precision.
pub fn read_gaussians(path: &Path) -> Result<GaussianCloud, DataError> {
    let fail = |reason: String| {
        let advice = "Export the Gaussians again as an uncompressed PLY file in the layout of 3DGS";
        or_denied(DataError::Content { path: path.to_owned(), reason, advice })
    };
    let file = open_file(path).map_err(|error| fail(error.to_string()))?;
    let room = file.metadata().map_err(|error| fail(error.to_string()))?.len();
    read_cloud(BufReader::new(file), room).map_err(fail)
}

/// The Gaussians in a file of `room` bytes.
fn read_cloud(reader: impl BufRead, room: u64) -> Result<GaussianCloud, String> {
    // The parser needs an end of line, which the last line of some files lacks.
    let mut reader = reader.chain(&b"\n"[..]);
    let mut ply = PlyReader::from_reader(&mut reader).map_err(|error| error.to_string())?;
    let vertex = vertex_element(&mut ply)?;
    let mut table = Table::new(Columns::of(&vertex)?);
    check_room(&vertex, ply.header().format, room)?;
    // Called through the trait, because `next_element` takes no seed. The rows are parsed as they come.
    let mut elements = &mut ply;
    let outcome = elements.next_value_seed(Rows(&mut table));
    let (found, count) = (table.cloud.len(), vertex.count);
    outcome.map_err(|DeserializeError(error)| match error.kind() {
        ErrorKind::UnexpectedEof => format!("its header announces {count} vertices, but it ends after {found}"),
        _ => format!("vertex {found} of {count}: {error}"),
    })?;
    let is_last = ply.current_element().is_none();
    if is_last && rows_left(reader)? {
        return Err(format!("its header announces {count} vertices, but more follow"));
    }
    Ok(table.cloud)
}

/// Whether anything except white space follows the last element.
fn rows_left(reader: impl BufRead) -> Result<bool, String> {
    for byte in reader.bytes() {
        if !byte.map_err(|error| error.to_string())?.is_ascii_whitespace() {
            return Ok(true);
        }
    }
    Ok(false)
}

/// Reads all rows into a table.
struct Rows<'a>(&'a mut Table);

impl<'de> DeserializeSeed<'de> for Rows<'_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_seq(self)
    }
}

impl<'de> Visitor<'de> for Rows<'_> {
    type Value = ();

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("rows of Gaussians")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut rows: A) -> Result<(), A::Error> {
        while rows.next_element_seed(Row(self.0))?.is_some() {}
        Ok(())
    }
}

/// Reads one row.
struct Row<'a>(&'a mut Table);

impl<'de> DeserializeSeed<'de> for Row<'_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_map(self)
    }
}

impl<'de> Visitor<'de> for Row<'_> {
    type Value = ();

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("the properties of a Gaussian")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut properties: A) -> Result<(), A::Error> {
        self.0.row.clear();
        while properties.next_key::<IgnoredAny>()?.is_some() {
            self.0.row.push(properties.next_value::<Number>()?.0);
        }
        self.0.finish_row().map_err(Error::custom)
    }
}

/// A property's value. Lists become NaN, because no field of a Gaussian is a list.
struct Number(f32);

impl<'de> Deserialize<'de> for Number {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(AnyNumber)
    }
}

struct AnyNumber;

impl<'de> Visitor<'de> for AnyNumber {
    type Value = Number;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("a number or a list of them")
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<Number, E> {
        Ok(Number(value as f32))
    }

    fn visit_i64<E: Error>(self, value: i64) -> Result<Number, E> {
        Ok(Number(value as f32))
    }

    fn visit_u64<E: Error>(self, value: u64) -> Result<Number, E> {
        Ok(Number(value as f32))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Number, A::Error> {
        while list.next_element::<IgnoredAny>()?.is_some() {}
        Ok(Number(f32::NAN))
    }
}
