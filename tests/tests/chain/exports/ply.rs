//! A reader for PLY files as FORMATS describes them for Gaussians, apart from the one that the program has.

use std::path::Path;

/// A file of float properties.
pub struct Ply {
    /// The properties in the file's order.
    pub names: Vec<String>,
    /// Their values, a list for each vertex.
    pub rows: Vec<Vec<f32>>,
}

impl Ply {
    /// The values of a property.
    pub fn column(&self, name: &str) -> Vec<f32> {
        let place = self.names.iter().position(|other| other == name).unwrap_or_else(|| panic!("no {name}"));
        self.rows.iter().map(|row| row[place]).collect()
    }
}

/// Reads a binary file with one element.
pub fn parse(path: &Path) -> Ply {
    const END: &[u8] = b"end_header\n";
    let bytes = std::fs::read(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let end = bytes.windows(END.len()).position(|window| window == END).expect("a header") + END.len();
    let header: Vec<&str> = std::str::from_utf8(&bytes[..end]).expect("text").lines().collect();
    assert_eq!(header[..2], ["ply", "format binary_little_endian 1.0"]);
    let count: usize = header[2].strip_prefix("element vertex ").expect("vertices").parse().expect("a count");
    let property = |line: &&str| line.strip_prefix("property float ").expect("a float").to_owned();
    let names: Vec<String> = header[3..header.len() - 1].iter().map(property).collect();
    let body = &bytes[end..];
    assert_eq!(body.len(), 4 * count * names.len(), "{}", path.display());
    let numbers: Vec<f32> = body.as_chunks().0.iter().map(|&bytes| f32::from_le_bytes(bytes)).collect();
    Ply { rows: numbers.chunks(names.len()).map(<[f32]>::to_vec).collect(), names }
}
