//! Point clouds in PLY files, read by the names of their fields.

use std::fmt;
use std::io::{BufRead, BufReader};
use std::path::Path;

use glam::Vec3;
use serde::de::{SeqAccess, Visitor};
use serde::{Deserialize, Deserializer};
use serde_ply::{ElementDef, PlyReader, ScalarType};
use tracing::warn;

use super::element::{check_room, scalar, vertex_element};
use crate::error::DataError;
use crate::files::{open_file, or_denied};
use crate::scene::{PointCloud, check_place};

/// Colour of points in files without colours.
pub(crate) const GREY: f32 = 0.5;

/// Floating-point colours have a maximum of 1 or of 255. This brightness separates the two. Rounding and spherical
/// harmonics exceed 1 slightly, and a cloud whose brightest point has 16 of 255 would be black.
const BRIGHTEST_OF_ONE: f32 = 16.0;

/// A vertex as the file stores it. The unit of its colour depends on the field's type.
#[derive(Deserialize)]
struct Vertex {
    x: f32,
    y: f32,
    z: f32,
    #[serde(default)]
    red: f32,
    #[serde(default)]
    green: f32,
    #[serde(default)]
    blue: f32,
}

/// The vertices, with colours in the file's unit. They are read one by one, because a list of them would take more
/// memory than the file.
struct Vertices(PointCloud);

impl<'de> Deserialize<'de> for Vertices {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Rows;

        impl<'de> Visitor<'de> for Rows {
            type Value = Vertices;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("vertices")
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut rows: A) -> Result<Vertices, A::Error> {
                // The count in the header. `check_room` has compared it with the size of the file.
                let count = rows.size_hint().unwrap_or(0);
                let [positions, colours] = [(); 2].map(|()| Vec::with_capacity(count));
                let mut points = PointCloud { positions, colours };
                while let Some(Vertex { x, y, z, red, green, blue }) = rows.next_element()? {
                    points.push(Vec3::new(x, y, z), Vec3::new(red, green, blue));
                }
                Ok(Vertices(points))
            }
        }

        deserializer.deserialize_seq(Rows)
    }
}

/// Reads the vertices of a PLY file, text or binary. Positions are `x`, `y`, `z`, colours are `red`, `green`, `blue`.
/// Integer colours are divided by 255, those of 16 bits by 65535. Floating-point colours are taken as 0 to 255 if the
/// brightest is far above 1. Points without colours are grey.
///
/// # Errors
/// [`DataError::Content`] if the file cannot be read, has no vertices with positions, ends early or contains a
/// number that is not finite or too large to compute with.
pub fn read_points(path: &Path) -> Result<PointCloud, DataError> {
    let fail = |reason: String| {
        let advice = "Export the point cloud again, or remove the file to start without points";
        or_denied(DataError::Content { path: path.to_owned(), reason, advice })
    };
    let file = open_file(path).map_err(|e| fail(e.to_string()))?;
    let room = file.metadata().map_err(|e| fail(e.to_string()))?.len();
    let (points, has_colours) = read_vertices(BufReader::new(file), room).map_err(fail)?;
    if !has_colours {
        warn!(file = %path.display(), "its points have no colours `red`, `green`, `blue`, so they are grey");
    }
    Ok(points)
}

/// The points of the first of the named files that exists in `folder`.
///
/// # Errors
/// Same as [`read_points`].
pub(crate) fn read_first(folder: &Path, names: &[&str]) -> Result<Option<PointCloud>, DataError> {
    let found = names.iter().map(|name| folder.join(name)).find(|path| path.is_file());
    found.map(|path| read_points(&path)).transpose()
}

/// Warns that a scene has no points.
pub(crate) fn warn_of_none(folder: &Path, names: &[&str]) {
    let names = names.join(", ");
    warn!(folder = %folder.display(), "no point cloud ({names}): training starts from random points");
}

/// The vertices in a file of `room` bytes, and whether they have colours.
fn read_vertices(reader: impl BufRead, room: u64) -> Result<(PointCloud, bool), String> {
    // The parser needs an end of line, which the last line of some files lacks.
    let mut ply = PlyReader::from_reader(reader.chain(&b"\n"[..])).map_err(|e| e.to_string())?;
    let vertex = vertex_element(&mut ply)?;
    for name in ["x", "y", "z"] {
        scalar(&vertex, name).ok_or_else(|| format!("its vertices have no number `{name}`"))?;
    }
    let unit = colour_unit(&vertex)?;
    check_room(&vertex, ply.header().format, room)?;
    let Vertices(mut points) = ply.next_element().map_err(|e| e.to_string())?;
    let largest = points.colours.iter().map(|colour| colour.max_element()).fold(0.0, f32::max);
    let unit = unit.map(|unit| if unit == 1.0 && largest > BRIGHTEST_OF_ONE { 255.0 } else { unit });
    for (index, (position, colour)) in points.positions.iter().zip(&mut points.colours).enumerate() {
        *colour = unit.map_or(Vec3::splat(GREY), |unit| *colour / unit);
        if !position.is_finite() || !colour.is_finite() {
            return Err(format!("vertex {index} holds a number that is not finite"));
        }
        check_place(*position).map_err(|reason| format!("vertex {index} {reason}"))?;
        *colour = colour.clamp(Vec3::ZERO, Vec3::ONE);
    }
    Ok((points, unit.is_some()))
}

/// The value of full brightness; `None` if there are no colours.
fn colour_unit(vertex: &ElementDef) -> Result<Option<f32>, String> {
    let types = ["red", "green", "blue"].map(|name| scalar(vertex, name));
    match types {
        [None, None, None] => Ok(None),
        [Some(red), Some(green), Some(blue)] if red == green && green == blue => Ok(Some(match red {
            ScalarType::I8 | ScalarType::U8 => 255.0,
            ScalarType::I16 | ScalarType::U16 => 65535.0,
            ScalarType::I32 | ScalarType::U32 => 255.0,
            ScalarType::F32 | ScalarType::F64 => 1.0,
        })),
        _ => Err("its fields `red`, `green` and `blue` are not three numbers of one type".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points(text: &[u8]) -> Result<PointCloud, String> {
        read_vertices(text, text.len() as u64).map(|(points, _)| points)
    }

    const HEAD: &str = "ply\nformat ascii 1.0\n";
    const XYZ: &str = "property float x\nproperty float y\nproperty float z\n";

    #[test]
    fn fields_are_found_by_name_whatever_stands_between_them() {
        let text = format!(
            "{HEAD}element camera 1\nproperty list uchar float v\nelement vertex 2\nproperty float z\nproperty float nx\n\
             property uchar blue\nproperty uchar red\nproperty double y\nproperty uchar green\nproperty float x\n\
             end_header\n2 0.5 0.5\n3 9 255 0 2 51 1\n6 9 0 102 5 0 4\n"
        );
        let cloud = points(text.as_bytes()).expect("read");
        assert_eq!(cloud.positions, [Vec3::new(1.0, 2.0, 3.0), Vec3::new(4.0, 5.0, 6.0)]);
        assert_eq!(cloud.colours, [Vec3::new(0.0, 0.2, 1.0), Vec3::new(0.4, 0.0, 0.0)]);
    }

    #[test]
    fn binary_points_with_normals_are_read() {
        let mut bytes = b"ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty float x\nproperty float y\n\
            property float z\nproperty float nx\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n"
            .to_vec();
        [1.0f32, 2.0, 3.0, 0.0].iter().for_each(|v| bytes.extend(v.to_le_bytes()));
        bytes.extend([255, 0, 51]);
        let cloud = points(&bytes).expect("read");
        assert_eq!((cloud.positions[0], cloud.colours[0]), (Vec3::new(1.0, 2.0, 3.0), Vec3::new(1.0, 0.0, 0.2)));
    }

    #[test]
    fn floating_point_colours_may_reach_one_or_255() {
        let colours = "property float red\nproperty float green\nproperty float blue\n";
        for (row, expected) in [
            ("0 0 0 1 0.5 0", Vec3::new(1.0, 0.5, 0.0)),
            ("0 0 0 255 51 0", Vec3::new(1.0, 0.2, 0.0)),
            // Brighter than white, as rounded colours or colours from spherical harmonics may be.
            ("0 0 0 1.5 0.5 0", Vec3::new(1.0, 0.5, 0.0)),
        ] {
            let text = format!("{HEAD}element vertex 1\n{XYZ}{colours}end_header\n{row}\n");
            assert_eq!(points(text.as_bytes()).expect("read").colours, [expected]);
        }
    }

    #[test]
    fn points_without_colours_are_grey() {
        let text = format!("{HEAD}element vertex 1\n{XYZ}end_header\n1 2 3\n");
        assert_eq!(points(text.as_bytes()).expect("read").colours, [Vec3::splat(GREY)]);
    }

    #[test]
    fn the_last_line_of_a_text_need_not_end() {
        let text = format!("{HEAD}element vertex 2\n{XYZ}end_header\n1 2 3\n4 5 6");
        assert_eq!(points(text.as_bytes()).expect("read").positions[1], Vec3::new(4.0, 5.0, 6.0));
    }

    #[test]
    fn malformed_files_are_refused_with_a_reason() {
        let cases = [
            ("not a ply\n".to_string(), "ply"),
            (format!("{HEAD}element vertex 1\n{XYZ}end_header\n1 2"), ""),
            (format!("{HEAD}element vertex 99\n{XYZ}end_header\n1 2 3\n"), "announces 99 vertices"),
            (format!("{HEAD}element vertex {}\n{XYZ}end_header\n1 2 3\n", u64::MAX), "announces"),
            (format!("{HEAD}element face 0\nproperty int a\nend_header\n"), "no element `vertex`"),
            (format!("{HEAD}element face 9\nend_header\n"), "no properties"),
            (format!("{HEAD}element vertex 1\nproperty float x\nproperty float y\nend_header\n1 2\n"), "`z`"),
            (format!("{HEAD}element vertex 1\n{XYZ}end_header\n1 nan 3\n"), "not finite"),
            (format!("{HEAD}element vertex 2\n{XYZ}end_header\n1 2 3\n1 1e38 3\n"), "vertex 1 is at [1.0, 1e38, 3.0]"),
            (format!("{HEAD}element vertex 1\n{XYZ}property uchar red\nend_header\n1 2 3 4\n"), "`red`"),
        ];
        for (text, part) in &cases {
            let error = points(text.as_bytes()).expect_err(text);
            assert!(error.contains(part), "{error}");
        }
    }
}
