//! Gaussians in PLY files of 3DGS, gsplat, Brush and their kin, read by the names of their fields.

use std::fmt;
use std::io::{BufRead, BufReader, ErrorKind};
use std::path::Path;

use serde::Deserialize;
use serde::de::{DeserializeSeed, Deserializer, Error, IgnoredAny, MapAccess, SeqAccess, Visitor};
use serde_ply::{DeserializeError, ElementDef, PlyReader, ScalarType};

use super::{check_room, scalar, vertex_element};
use crate::gaussian_cloud::{LIFETIME_FIELDS, Lifetime, MASK_FIELDS, rest_width};
use crate::paths::open_file;
use crate::{DataError, GaussianCloud};

/// Beginning of the names of the higher colour coefficients.
const REST: &str = "f_rest_";

/// Highest degree of the spherical harmonics that 3DGS knows.
const HIGHEST_DEGREE: usize = 3;

/// Reads the Gaussians of a PLY file, text or binary: `x y z`, `f_dc_0..2`, `f_rest_*` (none, 9, 24 or 45, channel by
/// channel), `opacity`, `scale_0..2` and `rot_0..3`, all floating-point and before any activation; and `mask_static`,
/// `mask_brightness` and `mask_dynamic`, and `time_centre`, `log_duration` and `velocity_x` to `velocity_z`, as this
/// program writes them, if they are there. Other fields, such as normals, are passed over.
///
/// # Errors
/// [`DataError::Content`] if the file cannot be read, lacks a field, holds more or fewer rows than it says, a number
/// that is not finite, or the logarithm of a size that cannot be computed with.
pub fn read_gaussians(path: &Path) -> Result<GaussianCloud, DataError> {
    let fail = |reason: String| DataError::Content {
        path: path.to_owned(),
        reason,
        advice: "Export the Gaussians again as an uncompressed PLY file in the layout of 3DGS",
    };
    let file = open_file(path).map_err(fail)?;
    let room = file.metadata().map_err(|error| fail(error.to_string()))?.len();
    read_cloud(BufReader::new(file), room).map_err(fail)
}

/// The Gaussians in a file of `room` bytes.
fn read_cloud(reader: impl BufRead, room: u64) -> Result<GaussianCloud, String> {
    // The parser wants a line to end, and in some files the last one does not.
    let mut reader = reader.chain(&b"\n"[..]);
    let mut ply = PlyReader::from_reader(&mut reader).map_err(|error| error.to_string())?;
    let vertex = vertex_element(&mut ply)?;
    let mut table = Table::new(Columns::of(&vertex)?);
    check_room(&vertex, ply.header().format, room)?;
    // Through the trait: `next_element` takes no seed, and the rows are to be taken apart as they come.
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

/// Whether there is something behind the last element; blank space counts as nothing.
fn rows_left(reader: impl BufRead) -> Result<bool, String> {
    for byte in reader.bytes() {
        if !byte.map_err(|error| error.to_string())?.is_ascii_whitespace() {
            return Ok(true);
        }
    }
    Ok(false)
}

/// Where the numbers of a Gaussian stand in a row.
struct Columns {
    means: [usize; 3],
    sh_dc: [usize; 3],
    /// Channel by channel, as in the file.
    sh_rest: Vec<usize>,
    sh_degree: usize,
    opacity: [usize; 1],
    scales: [usize; 3],
    rotation: [usize; 4],
    masks: Option<[usize; 3]>,
    lifetimes: Option<[usize; 5]>,
}

impl Columns {
    fn of(vertex: &ElementDef) -> Result<Self, String> {
        if vertex.has_property("packed_position") {
            return Err("its Gaussians are compressed (`packed_position`)".to_owned());
        }
        let rest = vertex.properties.iter().filter(|property| property.name.starts_with(REST)).count();
        let sh_degree = (0..=HIGHEST_DEGREE).find(|&degree| rest_width(degree) == rest).ok_or_else(|| {
            let allowed = (0..=HIGHEST_DEGREE).map(|degree| rest_width(degree).to_string()).collect::<Vec<_>>();
            format!("its vertices have {rest} fields `{REST}*`; there can be {}", allowed.join(", "))
        })?;
        let masks = MASK_FIELDS.iter().any(|name| vertex.has_property(name));
        let lifetimes = LIFETIME_FIELDS.iter().any(|name| vertex.has_property(name));
        Ok(Self {
            means: places(vertex, ["x", "y", "z"])?,
            sh_dc: places(vertex, ["f_dc_0", "f_dc_1", "f_dc_2"])?,
            sh_rest: (0..rest).map(|index| place(vertex, &format!("{REST}{index}"))).collect::<Result<_, _>>()?,
            sh_degree,
            opacity: places(vertex, ["opacity"])?,
            scales: places(vertex, ["scale_0", "scale_1", "scale_2"])?,
            rotation: places(vertex, ["rot_0", "rot_1", "rot_2", "rot_3"])?,
            masks: masks.then(|| places(vertex, MASK_FIELDS)).transpose()?,
            lifetimes: lifetimes.then(|| places(vertex, LIFETIME_FIELDS)).transpose()?,
        })
    }
}

fn places<const N: usize>(vertex: &ElementDef, names: [&str; N]) -> Result<[usize; N], String> {
    let mut found = [0; N];
    for (found, name) in found.iter_mut().zip(names) {
        *found = place(vertex, name)?;
    }
    Ok(found)
}

/// Which property of a row has this name.
fn place(vertex: &ElementDef, name: &str) -> Result<usize, String> {
    let found = vertex.properties.iter().position(|property| property.name == name);
    let found = found.ok_or_else(|| format!("its vertices have no field `{name}`"))?;
    match scalar(vertex, name) {
        Some(ScalarType::F32 | ScalarType::F64) => Ok(found),
        _ => Err(format!("the field `{name}` of its vertices is not a floating-point number")),
    }
}

/// What was read so far.
struct Table {
    columns: Columns,
    /// The row that is being read: a number for every property.
    row: Vec<f32>,
    cloud: GaussianCloud,
}

impl Table {
    fn new(columns: Columns) -> Self {
        let mask_logits = columns.masks.map(|_| Vec::new());
        let lifetimes = columns.lifetimes.map(|_| Vec::new());
        let cloud = GaussianCloud { sh_degree: columns.sh_degree, mask_logits, lifetimes, ..GaussianCloud::default() };
        Self { columns, row: Vec::new(), cloud }
    }

    /// Takes what is wanted of the row.
    fn finish_row(&mut self) -> Result<(), String> {
        let Self { columns, row, cloud } = self;
        let [opacity] = finite(row, columns.opacity, "opacity")?;
        let means = finite(row, columns.means, "x, y, z")?;
        let sh_dc = finite(row, columns.sh_dc, "f_dc_*")?;
        let scales = finite(row, columns.scales, "scale_*")?;
        check_sizes(scales)?;
        let rotation = finite(row, columns.rotation, "rot_*")?;
        let masks = columns.masks.map(|places| finite(row, places, "mask_*")).transpose()?;
        let lifetime = columns.lifetimes.map(|places| finite(row, places, "time_centre, log_duration, velocity_*"));
        let lifetime = lifetime.transpose()?.map(Lifetime::from_array);
        // Channel by channel in the file, coefficient by coefficient here.
        let coefficients = columns.sh_rest.len() / 3;
        for (coefficient, channel) in (0..coefficients).flat_map(|k| (0..3).map(move |channel| (k, channel))) {
            let [value] = finite(row, [columns.sh_rest[channel * coefficients + coefficient]], "f_rest_*")?;
            cloud.sh_rest.push(value);
        }
        cloud.means.push(means);
        cloud.sh_dc.push(sh_dc);
        cloud.opacity_logits.push(opacity);
        cloud.log_scales.push(scales);
        cloud.quaternions.push(rotation);
        if let (Some(logits), Some(masks)) = (&mut cloud.mask_logits, masks) {
            logits.push(masks);
        }
        if let (Some(lifetimes), Some(lifetime)) = (&mut cloud.lifetimes, lifetime) {
            lifetimes.push(lifetime);
        }
        Ok(())
    }
}

fn finite<const N: usize>(row: &[f32], places: [usize; N], name: &str) -> Result<[f32; N], String> {
    let values = places.map(|place| row[place]);
    if values.iter().all(|value| value.is_finite()) { Ok(values) } else { Err(format!("`{name}` is not finite")) }
}

/// Refuses logarithms of sizes whose squares, of which a covariance is made, single precision cannot hold.
fn check_sizes(log_scales: [f32; 3]) -> Result<(), String> {
    match log_scales.into_iter().find(|log_scale| !(2.0 * log_scale).exp().is_finite()) {
        Some(large) => Err(format!("`scale_*` is the logarithm of a size, and {large} is too large for one")),
        None => Ok(()),
    }
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

/// A property's value; that of a list, which no field of a Gaussian is, does not matter.
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

#[cfg(test)]
mod tests;
