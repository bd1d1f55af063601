//! Opening a checkpoint: its bytes, its header and its list of tensors are checked before any value is used.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use burn::tensor::{Device, Tensor, TensorData};
use safetensors::tensor::{Dtype, TensorInfo};
use serde_json::Value;
use tracing::warn;

use super::file::{HEADER, NUMBER, SCHEMA, Scan, scan};
use super::header::Header;
use crate::ModelError;

/// An open checkpoint whose bytes agree with their checksum, and in which every number is finite. Tensors are read on
/// request, each after a comparison of its shape with the expected one.
///
/// ```no_run
/// use mvfusion_model::train::Checkpoint;
/// # use mvfusion_model::{Config, ModelError, device};
/// # fn look(config: &Config) -> Result<(), ModelError> {
/// let checkpoint = Checkpoint::open("runs/a/checkpoints/final.safetensors".as_ref())?;
/// let model = checkpoint.model(config, &device::flex())?;
/// println!("{} dynamic Gaussians after {} steps", model.dynamic.count(), checkpoint.steps());
/// # Ok(())
/// # }
/// ```
#[derive(Debug)]
pub struct Checkpoint {
    path: PathBuf,
    file: File,
    /// Start of the tensors in the file.
    start: u64,
    tensors: BTreeMap<String, TensorInfo>,
    pub(super) header: Header,
}

impl Checkpoint {
    /// Opens a checkpoint and checks it: first the checksum, then the schema, the header, the types and places of all
    /// tensors, and that every number is finite. A file of schema 1, which has no checksum, causes a warning.
    ///
    /// # Errors
    /// [`ModelError::File`] if it cannot be read. [`ModelError::Checkpoint`] if it is damaged, no checkpoint, or of a
    /// newer schema.
    pub fn open(path: &Path) -> Result<Self, ModelError> {
        let misfit = |reason: String| ModelError::Checkpoint { path: path.to_owned(), reason };
        let failed = |error: io::Error| match error.raw_os_error() {
            Some(_) => ModelError::File { action: "read", path: path.to_owned(), reason: error.to_string() },
            None => misfit(error.to_string()),
        };
        let metadata = fs::metadata(path).map_err(failed)?;
        if !metadata.is_file() {
            return Err(misfit("it is no file".to_owned()));
        }
        let mut file = File::open(path).map_err(failed)?;
        let found = scan(&mut file, metadata.len()).map_err(failed)?;
        if let Some(written) = found.written.as_ref().filter(|written| **written != found.now) {
            return Err(misfit(format!(
                "it is damaged: its SHA-256 was written as {written} and is now {}",
                found.now
            )));
        }
        let (header, tensors) = contents(&found, metadata.len()).map_err(misfit)?;
        if found.written.is_none() {
            warn!("{} is of an earlier version and has no checksum: damage would not be noticed", path.display());
        }
        Ok(Self { path: path.to_owned(), file, start: found.start, tensors, header })
    }

    /// Number of completed training steps.
    pub fn steps(&self) -> usize {
        self.header.completed
    }

    /// The error for contents that cannot be used.
    pub(super) fn misfit(&self, reason: String) -> ModelError {
        ModelError::Checkpoint { path: self.path.clone(), reason }
    }

    /// The names of all tensors.
    pub(super) fn names(&self) -> impl Iterator<Item = &str> {
        self.tensors.keys().map(String::as_str)
    }

    /// The shape of a tensor in the file, if it exists.
    pub(super) fn shape(&self, name: &str) -> Option<&[usize]> {
        self.tensors.get(name).map(|info| info.shape.as_slice())
    }

    /// Compares the shape of a tensor with the expected one.
    pub(super) fn expect(&self, name: &str, expected: &[usize]) -> Result<(), ModelError> {
        match self.shape(name) {
            None => Err(self.misfit(format!("`{name}` is missing"))),
            Some(shape) if shape != expected => {
                Err(self.misfit(format!("`{name}` has the shape {shape:?} instead of {expected:?}")))
            }
            Some(_) => Ok(()),
        }
    }

    /// The values of a tensor that must have this shape, without autodiff.
    pub(super) fn tensor<const D: usize>(
        &self,
        name: &str,
        expected: [usize; D],
        device: &Device,
    ) -> Result<Tensor<D>, ModelError> {
        self.expect(name, &expected)?;
        let (first, end) = self.tensors[name].data_offsets;
        let mut bytes = vec![0; end - first];
        let read = (&self.file).seek(SeekFrom::Start(self.start + first as u64));
        read.and_then(|_| (&self.file).read_exact(&mut bytes)).map_err(|error| ModelError::File {
            action: "read",
            path: self.path.clone(),
            reason: error.to_string(),
        })?;
        let values: Vec<f32> = bytes.as_chunks().0.iter().map(|&number| f32::from_le_bytes(number)).collect();
        Ok(Tensor::from_data(TensorData::new(values, expected), &device.clone().inner()))
    }
}

/// The header and the list of tensors in a file of `length` bytes.
fn contents(found: &Scan, length: u64) -> Result<(Header, BTreeMap<String, TensorInfo>), String> {
    let mut entries: BTreeMap<String, Value> =
        serde_json::from_slice(&found.json).map_err(|error| format!("its header is no JSON object: {error}"))?;
    let metadata = entries.remove("__metadata__").ok_or("it has no header of this program")?;
    let metadata: BTreeMap<String, String> =
        serde_json::from_value(metadata).map_err(|error| format!("its metadata: {error}"))?;
    let schema = schema(&metadata, found.written.is_some())?;
    let header = metadata.get(HEADER).ok_or("it has no header of this program")?;
    let header = Header::parse(header, schema)?;
    let tensors = entries.into_iter().map(|(name, entry)| {
        let info: TensorInfo =
            serde_json::from_value(entry).map_err(|error| format!("the entry of `{name}`: {error}"))?;
        Ok((name, info))
    });
    let tensors: BTreeMap<String, TensorInfo> = tensors.collect::<Result<_, String>>()?;
    check_places(&tensors, length - found.start)?;
    match found.bad {
        None => Ok((header, tensors)),
        Some(bad) => Err(not_finite(&tensors, bad)),
    }
}

/// The version of the format.
fn schema(metadata: &BTreeMap<String, String>, has_checksum: bool) -> Result<u64, String> {
    let Some(text) = metadata.get(NUMBER) else {
        // Files of schema 1 have one entry. A file with more of them has lost its number or its checksum.
        return match metadata.keys().find(|key| *key != HEADER) {
            None => Ok(1),
            Some(key) => Err(format!("its metadata have `{key}` and no `{NUMBER}`")),
        };
    };
    let number: u64 = text.parse().map_err(|_| format!("its `{NUMBER}` is {text:?}, which is no number"))?;
    match number {
        SCHEMA if has_checksum => Ok(SCHEMA),
        0..=SCHEMA => Err(format!("its `{NUMBER}` is {number}, but its checksum is not at the beginning")),
        _ => Err(format!(
            "it is of schema {number}, and this version of the program reads up to schema {SCHEMA}. Use the version \
             that wrote it, or a newer one"
        )),
    }
}

/// Checks the type of every tensor, and that they fill the rest of the file, `length` bytes, without gaps.
fn check_places(tensors: &BTreeMap<String, TensorInfo>, length: u64) -> Result<(), String> {
    let mut ordered: Vec<(&String, &TensorInfo)> = tensors.iter().collect();
    ordered.sort_by_key(|(_, info)| info.data_offsets);
    let mut place = 0;
    for (name, info) in ordered {
        let (first, end) = info.data_offsets;
        if info.dtype != Dtype::F32 {
            return Err(format!("`{name}` is of type {} instead of F32", info.dtype));
        }
        let bytes = info.shape.iter().try_fold(4usize, |bytes, &side| bytes.checked_mul(side));
        if end.checked_sub(first) != bytes {
            return Err(format!("`{name}` with the shape {:?} does not fit its bytes {first} to {end}", info.shape));
        }
        if first != place {
            return Err(format!("`{name}` begins at byte {first} instead of {place}"));
        }
        place = end;
    }
    match place as u64 == length {
        true => Ok(()),
        false => Err(format!("its tensors have {place} bytes, and the file has {length} for them")),
    }
}

/// The message for a number that is not finite, `place` bytes after the start of the tensors.
fn not_finite(tensors: &BTreeMap<String, TensorInfo>, place: u64) -> String {
    let place = place as usize;
    let holds = |info: &TensorInfo| (info.data_offsets.0..info.data_offsets.1).contains(&place);
    match tensors.iter().find(|(_, info)| holds(info)) {
        Some((name, info)) => format!("number {} of `{name}` is not finite", (place - info.data_offsets.0) / 4),
        None => "one of its numbers is not finite".to_owned(),
    }
}
