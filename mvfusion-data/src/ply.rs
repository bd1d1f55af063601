//! Point clouds in PLY files, read by the names of their fields.

use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;

use glam::Vec3;
use serde::Deserialize;
use serde_ply::{ElementDef, PlyReader, PropertyType, ScalarType};
use tracing::warn;

use crate::{DataError, PointCloud};

/// Colour of the points of a file without colours.
pub(crate) const GREY: f32 = 0.5;

/// A vertex as it stands in the file; a colour's unit depends on the field's type.
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

/// A row of an element that does not interest us.
#[derive(Deserialize)]
struct Ignored {}

/// Reads the vertices of a PLY file, text or binary: positions from `x`, `y`, `z`, colours from `red`, `green`, `blue`
/// (integers are divided by the largest value of their type; floating-point colours above 1 are taken as 0 to 255).
/// Points without colours are grey.
///
/// # Errors
/// [`DataError::Content`] if the file cannot be read, has no vertices with positions, ends early or holds a number
/// that is not finite.
pub fn read_points(path: &Path) -> Result<PointCloud, DataError> {
    let fail = |reason: String| DataError::Content {
        path: path.to_owned(),
        reason,
        advice: "Export the point cloud again, or remove the file to start without points",
    };
    let file = File::open(path).map_err(|e| fail(e.to_string()))?;
    read_vertices(BufReader::new(file)).map_err(fail)
}

/// The points of the first of the named files that is in `folder`.
///
/// # Errors
/// As [`read_points`].
pub(crate) fn read_first(folder: &Path, names: &[&str]) -> Result<Option<PointCloud>, DataError> {
    let found = names.iter().map(|name| folder.join(name)).find(|path| path.is_file());
    found.map(|path| read_points(&path)).transpose()
}

/// Says that a scene has no points.
pub(crate) fn warn_of_none(folder: &Path, names: &[&str]) {
    let names = names.join(", ");
    warn!(folder = %folder.display(), "no point cloud ({names}): training starts from random points");
}

fn read_vertices(reader: BufReader<impl Read>) -> Result<PointCloud, String> {
    let mut ply = PlyReader::from_reader(reader).map_err(|e| e.to_string())?;
    let vertex = loop {
        let element = ply.current_element().ok_or("it has no element `vertex`")?.clone();
        if element.name == "vertex" {
            break element;
        }
        // Rows of no bytes would never meet the end of the file.
        if !element.properties.is_empty() {
            ply.next_element::<Vec<Ignored>>().map_err(|e| e.to_string())?;
        } else {
            return Err(format!("its element `{}` has no properties", element.name));
        }
    };
    for name in ["x", "y", "z"] {
        scalar(&vertex, name).ok_or_else(|| format!("its vertices have no number `{name}`"))?;
    }
    let unit = colour_unit(&vertex)?;
    let vertices: Vec<Vertex> = ply.next_element().map_err(|e| e.to_string())?;
    let largest = vertices.iter().map(|v| v.red.max(v.green).max(v.blue)).fold(0.0, f32::max);
    let unit = unit.map(|unit| if unit == 1.0 && largest > 1.0 { 255.0 } else { unit });
    let mut points = PointCloud::default();
    for (index, v) in vertices.iter().enumerate() {
        let position = Vec3::new(v.x, v.y, v.z);
        let colour = unit.map_or(Vec3::splat(GREY), |unit| Vec3::new(v.red, v.green, v.blue) / unit);
        if !position.is_finite() || !colour.is_finite() {
            return Err(format!("vertex {index} holds a number that is not finite"));
        }
        points.push(position, colour.clamp(Vec3::ZERO, Vec3::ONE));
    }
    Ok(points)
}

/// The value that means full brightness, or `None` if there are no colours.
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

fn scalar(element: &ElementDef, name: &str) -> Option<ScalarType> {
    match element.get_property(name)?.property_type {
        PropertyType::Scalar(kind) => Some(kind),
        PropertyType::List { .. } => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points(text: &[u8]) -> Result<PointCloud, String> {
        read_vertices(BufReader::new(text))
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
        for (row, expected) in
            [("0 0 0 1 0.5 0", Vec3::new(1.0, 0.5, 0.0)), ("0 0 0 255 51 0", Vec3::new(1.0, 0.2, 0.0))]
        {
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
    fn malformed_files_are_refused_with_a_reason() {
        let cases = [
            ("not a ply\n".to_string(), "ply"),
            (format!("{HEAD}element vertex 1\n{XYZ}end_header\n"), ""),
            (format!("{HEAD}element face 0\nproperty int a\nend_header\n"), "no element `vertex`"),
            (format!("{HEAD}element face 9\nend_header\n"), "no properties"),
            (format!("{HEAD}element vertex 1\nproperty float x\nproperty float y\nend_header\n1 2\n"), "`z`"),
            (format!("{HEAD}element vertex 1\n{XYZ}end_header\n1 nan 3\n"), "not finite"),
            (format!("{HEAD}element vertex 1\n{XYZ}property uchar red\nend_header\n1 2 3 4\n"), "`red`"),
        ];
        for (text, part) in &cases {
            let error = points(text.as_bytes()).expect_err(text);
            assert!(error.contains(part), "{error}");
        }
    }
}
