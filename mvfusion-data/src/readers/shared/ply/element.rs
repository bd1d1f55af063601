//! The element `vertex` of a PLY file.

use std::io::BufRead;

use serde::Deserialize;
use serde_ply::{ElementDef, PlyFormat, PlyReader, PropertyType, ScalarType};

/// A row of an element that is skipped.
#[derive(Deserialize)]
struct Ignored {}

/// Moves to the element `vertex`. Skips the elements before it.
pub(super) fn vertex_element(ply: &mut PlyReader<impl BufRead>) -> Result<ElementDef, String> {
    loop {
        let element = ply.current_element().ok_or("it has no element `vertex`")?.clone();
        if element.name == "vertex" {
            return Ok(element);
        }
        // Rows of zero bytes would never reach the end of the file.
        if element.properties.is_empty() {
            return Err(format!("its element `{}` has no properties", element.name));
        }
        ply.next_element::<Vec<Ignored>>().map_err(|e| e.to_string())?;
    }
}

/// Checks that a file of `room` bytes can contain the vertices that it announces.
pub(super) fn check_room(vertex: &ElementDef, format: PlyFormat, room: u64) -> Result<(), String> {
    let bytes = |kind: ScalarType| match (format, kind) {
        (PlyFormat::Ascii, _) => 2, // A digit and a space.
        (_, ScalarType::I8 | ScalarType::U8) => 1,
        (_, ScalarType::I16 | ScalarType::U16) => 2,
        (_, ScalarType::I32 | ScalarType::U32 | ScalarType::F32) => 4,
        (_, ScalarType::F64) => 8,
    };
    let kinds = vertex.properties.iter().map(|property| match property.property_type {
        PropertyType::Scalar(kind) => kind,
        PropertyType::List { count_type, .. } => count_type,
    });
    let row: u64 = kinds.map(bytes).sum();
    let most = room / row.max(1);
    match vertex.count as u64 > most {
        true => Err(format!("it announces {} vertices, and has room for {most} at most", vertex.count)),
        false => Ok(()),
    }
}

pub(super) fn scalar(element: &ElementDef, name: &str) -> Option<ScalarType> {
    match element.get_property(name)?.property_type {
        PropertyType::Scalar(kind) => Some(kind),
        PropertyType::List { .. } => None,
    }
}
