//! A checkpoint taken apart, written without the code under test.

use std::collections::BTreeMap;

use serde_json::{Value, json};

use crate::files::sha256;

/// Where the checksum stands in a file.
const DIGITS: std::ops::Range<usize> = 8 + 27..8 + 27 + 64;

/// A tensor in a file.
#[derive(Clone)]
pub struct Entry {
    pub dtype: String,
    pub shape: Vec<usize>,
    pub bytes: Vec<u8>,
}

/// The parts of a checkpoint.
#[derive(Clone)]
pub struct Parts {
    /// Entries of the metadata besides checksum and header.
    pub metadata: BTreeMap<String, String>,
    pub header: Value,
    pub tensors: BTreeMap<String, Entry>,
}

impl Parts {
    /// Takes a file apart.
    pub fn of(bytes: &[u8]) -> Self {
        let size = u64::from_le_bytes(bytes[..8].try_into().expect("eight bytes")) as usize;
        let json: Value = serde_json::from_slice(&bytes[8..8 + size]).expect("JSON");
        let mut entries: BTreeMap<String, Value> = serde_json::from_value(json).expect("an object");
        let metadata = entries.remove("__metadata__").expect("metadata");
        let mut metadata: BTreeMap<String, String> = serde_json::from_value(metadata).expect("texts");
        metadata.remove("sha256");
        let header = serde_json::from_str(&metadata.remove("mvfusion").expect("a header")).expect("JSON");
        let data = &bytes[8 + size..];
        let entry = |entry: Value| {
            let place = |index: usize| entry["data_offsets"][index].as_u64().expect("a number") as usize;
            let shape = entry["shape"].as_array().expect("a list");
            Entry {
                dtype: entry["dtype"].as_str().expect("a name").to_owned(),
                shape: shape.iter().map(|side| side.as_u64().expect("a number") as usize).collect(),
                bytes: data[place(0)..place(1)].to_vec(),
            }
        };
        let tensors = entries.into_iter().map(|(name, value)| (name, entry(value))).collect();
        Self { metadata, header, tensors }
    }

    /// The file, with the right checksum.
    pub fn bytes(&self) -> Vec<u8> {
        Self::sealed(self.joined(&format!(r#""sha256":"{}","#, "0".repeat(64))))
    }

    /// The bytes of a file with the right checksum.
    pub fn sealed(mut bytes: Vec<u8>) -> Vec<u8> {
        let rest = [&bytes[..DIGITS.start], &bytes[DIGITS.end..]].concat();
        bytes[DIGITS].copy_from_slice(sha256(&rest).as_bytes());
        bytes
    }

    /// The file without a checksum.
    pub fn without_checksum(&self) -> Vec<u8> {
        self.joined("")
    }

    fn joined(&self, checksum: &str) -> Vec<u8> {
        let text = |text: &str| serde_json::to_string(text).expect("a text");
        let header = serde_json::to_string(&self.header).expect("JSON");
        let mut json = format!(r#"{{"__metadata__":{{{checksum}"#);
        for (key, value) in &self.metadata {
            json += &format!("{}:{},", text(key), text(value));
        }
        json += &format!(r#""mvfusion":{}}}"#, text(&header));
        let mut data = Vec::new();
        for (name, Entry { dtype, shape, bytes }) in &self.tensors {
            let first = data.len();
            data.extend_from_slice(bytes);
            let entry = json!({"dtype": dtype, "shape": shape, "data_offsets": [first, data.len()]});
            json += &format!(",{}:{entry}", text(name));
        }
        json.push('}');
        json.extend(std::iter::repeat_n(' ', json.len().next_multiple_of(8) - json.len()));
        [&(json.len() as u64).to_le_bytes(), json.as_bytes(), &data].concat()
    }

    /// The tensor of this name.
    pub fn tensor(&mut self, name: &str) -> &mut Entry {
        self.tensors.get_mut(name).expect("it is there")
    }
}
