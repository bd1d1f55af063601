//! A reader for binary glTF that knows the format's description alone.

use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use serde_json::Value;

/// A file: its document, and its one buffer.
#[derive(Clone, Debug)]
pub struct Glb {
    /// The JSON chunk.
    pub document: Value,
    /// The binary chunk, without its padding.
    pub binary: Vec<u8>,
}

impl Glb {
    /// Reads a file and checks the container: magic, version, lengths, order and alignment of the chunks.
    ///
    /// # Errors
    /// If it cannot be read, or anything is wrong with it.
    pub fn read(path: &Path) -> Result<Self> {
        Self::parse(&std::fs::read(path)?).with_context(|| path.display().to_string())
    }

    fn parse(bytes: &[u8]) -> Result<Self> {
        let word = |at: usize| -> Result<u32> {
            let four = bytes.get(at..at + 4).context("the file ends too early")?;
            Ok(u32::from_le_bytes(four.try_into()?))
        };
        ensure!(&bytes[..4] == b"glTF" && word(4)? == 2, "another magic or version");
        ensure!(word(8)? as usize == bytes.len(), "{} bytes, not {}", bytes.len(), word(8)?);
        let chunk = |at: usize, kind: &[u8; 4]| -> Result<(&[u8], usize)> {
            let length = word(at)? as usize;
            ensure!(length.is_multiple_of(4), "a chunk of {length} bytes");
            ensure!(&bytes[at + 4..at + 8] == kind, "another kind of chunk");
            Ok((bytes.get(at + 8..at + 8 + length).context("a chunk beyond the file")?, at + 8 + length))
        };
        let (json, next) = chunk(12, b"JSON")?;
        let (binary, end) = chunk(next, b"BIN\0")?;
        ensure!(end == bytes.len(), "bytes behind the last chunk");
        let document: Value = serde_json::from_slice(json)?;
        let length = document["buffers"][0]["byteLength"].as_u64().context("a buffer")? as usize;
        ensure!(length <= binary.len() && binary.len() - length < 4, "a buffer of {length} in {}", binary.len());
        Ok(Self { document, binary: binary[..length].to_vec() })
    }

    /// The rows of floats of an accessor, checked against its view, its type and its bounds.
    ///
    /// # Errors
    /// If anything is wrong with it.
    pub fn rows(&self, accessor: &Value) -> Result<Vec<Vec<f32>>> {
        let number = |value: &Value, name: &str| value[name].as_u64().with_context(|| format!("no {name} in {value}"));
        let accessor = &self.document["accessors"][accessor.as_u64().context("an index")? as usize];
        ensure!(accessor["componentType"] == 5126, "other numbers than floats: {accessor}");
        let width = match accessor["type"].as_str() {
            Some("SCALAR") => 1,
            Some("VEC3") => 3,
            Some("VEC4") => 4,
            other => bail!("another type: {other:?}"),
        };
        let count = number(accessor, "count")? as usize;
        let view = &self.document["bufferViews"][number(accessor, "bufferView")? as usize];
        let (start, length) = (number(view, "byteOffset")? as usize, number(view, "byteLength")? as usize);
        ensure!(start.is_multiple_of(4) && length == 4 * width * count, "{view} for {count} rows of {width}");
        let bytes = self.binary.get(start..start + length).context("a view beyond its buffer")?;
        let floats: Vec<f32> = bytes.as_chunks().0.iter().map(|&four| f32::from_le_bytes(four)).collect();
        ensure!(floats.iter().all(|value| value.is_finite()), "numbers that are not finite");
        let rows: Vec<Vec<f32>> = floats.chunks(width).map(<[f32]>::to_vec).collect();
        for (name, of) in [("min", f32::min as fn(f32, f32) -> f32), ("max", f32::max)] {
            let Some(bounds) = accessor.get(name) else { continue };
            for axis in 0..width {
                let found = rows.iter().map(|row| row[axis]).reduce(of).context("a row")?;
                ensure!(bounds[axis].as_f64() == Some(f64::from(found)), "{name} is {bounds}, not {found}");
            }
        }
        Ok(rows)
    }
}
