//! Changes to files of pieces with lengths: a piece goes, moves, comes twice or changes, and all lengths and sums fit
//! again. Lengths that do not fit come from the changes to bytes.

use std::io::{Cursor, Read, Write};

use mvfusion_model::files::sha256;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use serde_json::Value;
use zip::write::SimpleFileOptions;
use zip::{ZipArchive, ZipWriter};

use super::{any, bytes, tree};

/// Boxes of an mp4 file that consist of boxes.
const CONTAINERS: [&[u8; 4]; 7] = [b"moov", b"trak", b"mdia", b"minf", b"stbl", b"edts", b"dinf"];

/// The first bytes of a PNG file.
const PNG: &[u8] = b"\x89PNG\r\n\x1a\n";

/// A named piece of a file.
#[derive(Clone)]
struct Chunk {
    name: [u8; 4],
    content: Vec<u8>,
    /// The pieces that it consists of, instead of content.
    inner: Vec<Chunk>,
}

/// Changes a list of pieces.
fn change(chunks: &mut Vec<Chunk>, random: &mut ChaCha8Rng) {
    let Some(last) = chunks.len().checked_sub(1) else { return };
    let (one, other) = (random.random_range(0..=last), random.random_range(0..=last));
    // Half of the changes to a container go to what it holds.
    if !chunks[one].inner.is_empty() && random.random_bool(0.8) {
        return change(&mut chunks[one].inner, random);
    }
    match random.random_range(0..8) {
        0 => drop(chunks.remove(one)),
        1 => chunks.swap(one, other),
        2 => chunks.insert(other, chunks[one].clone()),
        3 => chunks[one].name = chunks[other].name,
        4 => {
            let length = random.random_range(0..=chunks[one].content.len());
            chunks[one].content.truncate(length);
        }
        5 => bytes::change(&mut chunks[one].content, random),
        _ => bytes::integer(&mut chunks[one].content, random),
    }
}

pub fn png(content: &[u8], random: &mut ChaCha8Rng) -> Option<Vec<u8>> {
    let mut rest = content.strip_prefix(PNG)?;
    let mut chunks = Vec::new();
    while !rest.is_empty() {
        let (head, behind) = rest.split_at_checked(8)?;
        let (content, behind) = behind.split_at_checked(big_endian(&head[..4])?)?;
        let name = head[4..].try_into().ok()?;
        chunks.push(Chunk { name, content: content.to_vec(), inner: Vec::new() });
        rest = behind.get(4..)?;
    }
    change(&mut chunks, random);
    let mut file = PNG.to_vec();
    for Chunk { name, content, .. } in chunks {
        let named = [&name[..], &content].concat();
        file.extend((content.len() as u32).to_be_bytes());
        file.extend(&named);
        file.extend(crc(&named).to_be_bytes());
    }
    Some(file)
}

/// CRC-32 of PNG and zip.
fn crc(bytes: &[u8]) -> u32 {
    let step = |crc: u32, _| if crc & 1 == 1 { 0xedb8_8320 ^ (crc >> 1) } else { crc >> 1 };
    !bytes.iter().fold(u32::MAX, |crc, &byte| (0..8).fold(crc ^ u32::from(byte), step))
}

fn big_endian(bytes: &[u8]) -> Option<usize> {
    bytes.try_into().ok().map(|bytes| u32::from_be_bytes(bytes) as usize)
}

/// Changes the segments before the pixels of a JPEG file.
pub fn jpeg(content: &[u8], random: &mut ChaCha8Rng) -> Option<Vec<u8>> {
    const PIXELS: u8 = 0xda;
    let mut rest = content.strip_prefix(&[0xff, 0xd8])?;
    let mut chunks = Vec::new();
    while let [0xff, marker, high, low, ..] = *rest
        && marker != PIXELS
    {
        let end = 2 + usize::from(u16::from_be_bytes([high, low]));
        chunks.push(Chunk { name: [marker, 0, 0, 0], content: rest.get(4..end)?.to_vec(), inner: Vec::new() });
        rest = &rest[end..];
    }
    change(&mut chunks, random);
    let mut file = vec![0xff, 0xd8];
    for Chunk { name, content, .. } in chunks {
        file.extend([0xff, name[0]]);
        file.extend((content.len() as u16).wrapping_add(2).to_be_bytes());
        file.extend(content);
    }
    Some([&file, rest].concat())
}

pub fn mp4(content: &[u8], random: &mut ChaCha8Rng) -> Option<Vec<u8>> {
    let mut boxes = boxes(content)?;
    change(&mut boxes, random);
    Some(written(&boxes))
}

fn boxes(mut rest: &[u8]) -> Option<Vec<Chunk>> {
    let mut found = Vec::new();
    while !rest.is_empty() {
        let name: [u8; 4] = rest.get(4..8)?.try_into().ok()?;
        let (content, behind) = rest.split_at_checked(big_endian(&rest[..4])?)?;
        let content = content.get(8..)?;
        let inner = if CONTAINERS.contains(&&name) { boxes(content)? } else { Vec::new() };
        let content = if inner.is_empty() { content.to_vec() } else { Vec::new() };
        found.push(Chunk { name, content, inner });
        rest = behind;
    }
    Some(found)
}

fn written(boxes: &[Chunk]) -> Vec<u8> {
    let one = |chunk: &Chunk| {
        let content = if chunk.inner.is_empty() { chunk.content.clone() } else { written(&chunk.inner) };
        [&(content.len() as u32 + 8).to_be_bytes()[..], &chunk.name, &content].concat()
    };
    boxes.iter().flat_map(one).collect()
}

/// Changes the header, or the JSON in one of its texts, or the data. If the header holds a checksum, it mostly fits again
/// (docs/formats.md), because a reader looks no further where it does not.
pub fn safetensors(content: &[u8], random: &mut ChaCha8Rng) -> Option<Vec<u8>> {
    let (length, rest) = content.split_at_checked(8)?;
    let length = u64::from_le_bytes(length.try_into().ok()?);
    let (header, data) = rest.split_at_checked(usize::try_from(length).ok()?)?;
    let mut header: Value = serde_json::from_slice(header).ok()?;
    let mut data = data.to_vec();
    let texts = header.get_mut("__metadata__").and_then(Value::as_object_mut);
    let text =
        texts.and_then(|texts| texts.values_mut().find(|text| text.as_str().is_some_and(|t| t.starts_with('{'))));
    match (text, random.random_range(0..5)) {
        (Some(text), 0..2) => {
            let mut inner: Value = serde_json::from_str(text.as_str()?).ok()?;
            tree::change(&mut inner, random);
            *text = Value::String(inner.to_string());
        }
        (_, 2) => bytes::integer(&mut data, random),
        _ => tree::change(&mut header, random),
    }
    let header = match random.random_bool(0.9) {
        true => signed(header.clone(), &data).unwrap_or_else(|| header.to_string()),
        false => header.to_string(),
    };
    Some([&(header.len() as u64).to_le_bytes()[..], header.as_bytes(), &data].concat())
}

/// The header with a checksum that fits; `None` if it holds none.
fn signed(mut header: Value, data: &[u8]) -> Option<String> {
    const MARK: &str = r#"{"__metadata__":{"sha256":""#;
    let mut metadata = header.as_object_mut()?.remove("__metadata__")?;
    metadata.as_object_mut()?.remove("sha256")?;
    let (metadata, tensors) = (metadata.to_string(), header.to_string());
    let rest = format!("\",{},{}", metadata.strip_prefix('{')?, tensors.strip_prefix('{')?);
    let length = (MARK.len() + 64 + rest.len()).next_multiple_of(8);
    let padding = " ".repeat(length - MARK.len() - 64 - rest.len());
    let covered = [&(length as u64).to_le_bytes()[..], MARK.as_bytes(), rest.as_bytes(), padding.as_bytes(), data];
    Some(format!("{MARK}{}{rest}{padding}", sha256(&covered.concat())))
}

/// Changes a number in the header, or the data.
pub fn npy(content: &[u8], random: &mut ChaCha8Rng) -> Option<Vec<u8>> {
    let (start, rest) = content.split_at_checked(10)?;
    let (header, data) = rest.split_at_checked(usize::from(u16::from_le_bytes([start[8], start[9]])))?;
    let (mut header, mut data) = (header.to_vec(), data.to_vec());
    match random.random_range(0..4) {
        0 => bytes::change(&mut data, random),
        1 => bytes::change(&mut header, random),
        _ => bytes::number(&mut header, random),
    }
    Some([&start[..8], &(header.len() as u16).to_le_bytes(), &header, &data].concat())
}

pub fn npz(content: &[u8], name: &str, random: &mut ChaCha8Rng) -> Option<Vec<u8>> {
    let mut table = Vec::new();
    // An archive whose lengths lie could unpack to anything.
    const MOST: u64 = 1 << 20;
    ZipArchive::new(Cursor::new(content)).ok()?.by_name(name).ok()?.take(MOST).read_to_end(&mut table).ok()?;
    let table = npy(&table, random)?;
    let name = if random.random_bool(0.05) { *any(&["", "a/../../b", "data"], random) } else { name };
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    archive.start_file(name, SimpleFileOptions::default().compression_level(Some(1))).ok()?;
    archive.write_all(&table).ok()?;
    Some(archive.finish().ok()?.into_inner())
}

/// Changes a line, a number or anything of the header.
pub fn ply(content: &[u8], random: &mut ChaCha8Rng) -> Option<Vec<u8>> {
    const END: &[u8] = b"end_header\n";
    let end = content.windows(END.len()).position(|window| window == END)?;
    let (header, data) = content.split_at(end);
    let mut header = header.to_vec();
    match random.random_range(0..4) {
        0 => bytes::change(&mut header, random),
        1 => bytes::lines(&mut header, random),
        _ => bytes::number(&mut header, random),
    }
    Some([&header, data].concat())
}
