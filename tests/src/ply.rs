//! A reader for PLY files of Gaussians that knows the format's description alone, apart from the one that the program
//! has.

use std::path::Path;

use anyhow::{Context, Result, bail, ensure};

/// What the header ends with.
const END: &[u8] = b"end_header\n";

/// A file of float properties.
#[derive(Clone, Debug, PartialEq)]
pub struct Ply {
    /// The properties in the file's order.
    pub names: Vec<String>,
    /// Their values, a list for each vertex.
    pub rows: Vec<Vec<f32>>,
}

impl Ply {
    /// Reads a binary file with one element.
    ///
    /// # Errors
    /// If it cannot be read, or is another kind of file.
    pub fn read(path: &Path) -> Result<Self> {
        let context = || path.display().to_string();
        Self::parse(&std::fs::read(path).with_context(context)?).with_context(context)
    }

    fn parse(bytes: &[u8]) -> Result<Self> {
        let end = bytes.windows(END.len()).position(|window| window == END).context("no header")? + END.len();
        let header: Vec<&str> = std::str::from_utf8(&bytes[..end])?.lines().collect();
        let ["ply", "format binary_little_endian 1.0", element, properties @ .., _] = header.as_slice() else {
            bail!("another header: {header:?}")
        };
        let count: usize = element.strip_prefix("element vertex ").context("no vertices")?.parse()?;
        let float = |line: &&str| line.strip_prefix("property float ").map(str::to_owned);
        let names: Vec<String> = properties.iter().map(float).collect::<Option<_>>().context("not all are floats")?;
        let body = &bytes[end..];
        let (width, length) = (names.len(), body.len());
        ensure!(width > 0 && length == 4 * width * count, "{length} bytes for {count} rows of {width} numbers");
        let numbers: Vec<f32> = body.as_chunks().0.iter().map(|&bytes| f32::from_le_bytes(bytes)).collect();
        Ok(Self { names, rows: numbers.chunks(width).map(<[f32]>::to_vec).collect() })
    }

    /// The values of a property.
    ///
    /// # Panics
    /// If there is no such property.
    pub fn column(&self, name: &str) -> Vec<f32> {
        let place = self.names.iter().position(|other| other == name).unwrap_or_else(|| panic!("no {name}"));
        self.rows.iter().map(|row| row[place]).collect()
    }
}
