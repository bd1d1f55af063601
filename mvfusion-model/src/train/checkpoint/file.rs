//! The bytes of a checkpoint: where the checksum stands, what it covers, and how a file is written.
//!
//! A checkpoint is a safetensors file: the length of the JSON header (8 bytes, little endian), the JSON header, and the
//! values of the tensors without gaps. The JSON header begins with [`MARK`], 64 hexadecimal digits and a quotation mark.
//! The digits are the SHA-256 of all bytes of the file except these digits, in their order.

use std::collections::BTreeMap;
use std::io::{self, BufWriter, Read, Write};
use std::path::Path;

use burn::tensor::TensorData;
use safetensors::tensor::{Dtype, TensorInfo};
use serde::Serialize;
use sha2::{Digest, Sha256};

use super::header::Header;
use crate::ModelError;
use crate::files::hexadecimal;

/// The version of the format. Files of schema 1 have no number and no checksum.
pub(super) const SCHEMA: u64 = 2;

/// Keys of the file's metadata.
pub(super) const HEADER: &str = "mvfusion";
pub(super) const NUMBER: &str = "schema";

/// The first bytes of the JSON header, up to the checksum.
const MARK: &[u8] = br#"{"__metadata__":{"sha256":""#;

/// Hexadecimal digits of a SHA-256.
const DIGITS: usize = 64;

/// Largest JSON header, in bytes. One of a run with 100,000 training views has about a megabyte.
const MOST_HEADER: u64 = 16 << 20;

/// Bytes that are read at a time, a multiple of 4.
const CHUNK: usize = 1 << 20;

/// Alignment of the first tensor.
const ALIGNMENT: usize = 8;

/// Tensors by name, on the host, all of them f32.
pub(super) type Tensors = BTreeMap<String, TensorData>;

/// The JSON header.
#[derive(Serialize)]
struct FileHeader<'a> {
    #[serde(rename = "__metadata__")]
    metadata: FileMetadata<'a>,
    #[serde(flatten)]
    tensors: BTreeMap<&'a str, TensorInfo>,
}

/// Its metadata, whose values are texts. `sha256` must come first.
#[derive(Serialize)]
struct FileMetadata<'a> {
    sha256: &'a str,
    schema: String,
    mvfusion: String,
}

/// What was found in the bytes of a file.
pub(super) struct Scan {
    /// The JSON header.
    pub json: Vec<u8>,
    /// Position of the first tensor.
    pub start: u64,
    /// The checksum in the file, if there is one.
    pub written: Option<String>,
    /// The checksum of its bytes.
    pub now: String,
    /// The first value that is not finite: its number of bytes after `start`.
    pub bad: Option<u64>,
}

/// Reads all bytes of a file of `length` bytes. At most [`MOST_HEADER`] of them are kept.
pub(super) fn scan(file: &mut impl Read, length: u64) -> io::Result<Scan> {
    let short = || io::Error::other("it ends before its header does");
    let mut size = [0; 8];
    file.read_exact(&mut size).map_err(|_| short())?;
    let bytes = u64::from_le_bytes(size);
    let start = bytes.checked_add(8).filter(|&start| start <= length).ok_or_else(short)?;
    if bytes > MOST_HEADER {
        return Err(io::Error::other(format!("its header has {bytes} bytes, more than {MOST_HEADER}")));
    }
    let mut json = vec![0; bytes as usize];
    file.read_exact(&mut json).map_err(|_| short())?;

    let digits = digits(&json);
    let mut hash = Sha256::new_with_prefix(size);
    match &digits {
        Some(place) => [&json[..place.start], &json[place.end..]].iter().for_each(|part| hash.update(part)),
        None => hash.update(&json),
    }
    let (mut chunk, mut done, mut bad) = (vec![0; CHUNK], 0, None);
    loop {
        let read = fill(file, &mut chunk)?;
        if read == 0 {
            break;
        }
        hash.update(&chunk[..read]);
        bad = bad.or_else(|| Some(done + first_not_finite(&chunk[..read])? as u64));
        done += read as u64;
    }
    let written = digits.map(|place| String::from_utf8_lossy(&json[place]).into_owned());
    Ok(Scan { json, start, written, now: hexadecimal(hash), bad })
}

/// Where the checksum stands in a JSON header that has one.
fn digits(json: &[u8]) -> Option<std::ops::Range<usize>> {
    let place = MARK.len()..MARK.len() + DIGITS;
    (json.starts_with(MARK) && json.len() >= place.end).then_some(place)
}

/// Reads until the buffer is full or the file ends. Returns the number of bytes.
fn fill(file: &mut impl Read, buffer: &mut [u8]) -> io::Result<usize> {
    let mut read = 0;
    while read < buffer.len() {
        match file.read(&mut buffer[read..]) {
            Ok(0) => break,
            Ok(more) => read += more,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(read)
}

/// Place of the first f32 that is not finite, in bytes.
fn first_not_finite(bytes: &[u8]) -> Option<usize> {
    let is_bad = |number: &[u8; 4]| !f32::from_le_bytes(*number).is_finite();
    let numbers = bytes.as_chunks().0;
    // Without a branch in the loop, it is vectorised.
    let any = numbers.iter().fold(false, |any, number| any | is_bad(number));
    any.then(|| numbers.iter().position(is_bad)).flatten().map(|place| 4 * place)
}

/// Writes tensors and header to a temporary file and renames it.
pub(super) fn write(path: &Path, tensors: &Tensors, header: &Header) -> Result<(), ModelError> {
    let attempt = || -> io::Result<()> {
        for (name, data) in tensors {
            if let Some(place) = first_not_finite(data.bytes()) {
                return Err(io::Error::other(format!("number {} of `{name}` is not finite", place / 4)));
            }
        }
        let head = head(tensors, header)?;
        let mut file = crate::files::beside(path)?;
        let mut writer = BufWriter::with_capacity(CHUNK, file.as_file_mut());
        writer.write_all(&head)?;
        tensors.values().try_for_each(|data| writer.write_all(data.bytes()))?;
        writer.flush()?;
        drop(writer);
        file.as_file().sync_all()?;
        file.persist(path)?;
        crate::files::sync_folder(path);
        Ok(())
    };
    attempt().map_err(|error| ModelError::File { action: "write", path: path.to_owned(), reason: error.to_string() })
}

/// The bytes before the tensors, with the checksum.
fn head(tensors: &Tensors, header: &Header) -> io::Result<Vec<u8>> {
    let mut end = 0;
    let info = |(name, data): (&'_ String, &TensorData)| {
        let first = end;
        end += data.bytes().len();
        (name.clone(), TensorInfo { dtype: Dtype::F32, shape: data.shape().to_vec(), data_offsets: (first, end) })
    };
    let infos: Vec<(String, TensorInfo)> = tensors.iter().map(info).collect();
    let header = FileHeader {
        metadata: FileMetadata {
            sha256: &"0".repeat(DIGITS),
            schema: SCHEMA.to_string(),
            mvfusion: serde_json::to_string(header)?,
        },
        tensors: infos.iter().map(|(name, info)| (name.as_str(), info.clone())).collect(),
    };
    let mut json = serde_json::to_vec(&header)?;
    json.resize(json.len().next_multiple_of(ALIGNMENT), b' ');
    if json.len() as u64 > MOST_HEADER {
        return Err(io::Error::other(format!("its header would have {} bytes, more than {MOST_HEADER}", json.len())));
    }
    let size = (json.len() as u64).to_le_bytes();
    let place = digits(&json).ok_or_else(|| io::Error::other("its header has no place for a checksum"))?;
    let mut hash = Sha256::new_with_prefix(size);
    hash.update(&json[..place.start]);
    hash.update(&json[place.end..]);
    tensors.values().for_each(|data| hash.update(&data.bytes()[..]));
    json[place].copy_from_slice(hexadecimal(hash).as_bytes());
    Ok([&size, json.as_slice()].concat())
}
