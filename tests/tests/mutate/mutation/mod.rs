//! Changes to the content of a file: to its bytes, and to what they mean.

mod bytes;
mod chunks;
mod tree;

use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// Most changes to a file.
const MOST_CHANGES: usize = 4;

/// Share of the changes that follow the structure of the file, as long as it can be parsed.
const STRUCTURED: f64 = 0.6;

/// How the content of a file is structured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Binary numbers, and text of lines and words.
    Plain,
    /// A JSON value.
    Json,
    /// A JSON value on each line.
    JsonLines,
    /// TOML.
    Toml,
    /// Chunks with lengths and sums.
    Png,
    /// Segments with lengths.
    Jpeg,
    /// Boxes with lengths, nested.
    Mp4,
    /// A JSON header with its length, which itself holds JSON, before the data.
    Safetensors,
    /// A text header with its length, before the data.
    Npy,
    /// An archive of one `Npy`, of this name.
    Npz(&'static str),
    /// A text header up to a known line, before the data.
    Ply,
}

/// A file with some changes.
pub fn mutated(sound: &[u8], kind: Kind, random: &mut ChaCha8Rng) -> Vec<u8> {
    let mut content = sound.to_vec();
    for _ in 0..random.random_range(1..=MOST_CHANGES) {
        let changed = random.random_bool(STRUCTURED).then(|| structured(&content, kind, random)).flatten();
        match changed {
            Some(changed) => content = changed,
            None => bytes::change(&mut content, random),
        }
    }
    content
}

/// A change that follows the structure; `None` if the content has it no longer.
fn structured(content: &[u8], kind: Kind, random: &mut ChaCha8Rng) -> Option<Vec<u8>> {
    match kind {
        Kind::Plain => None,
        Kind::Json => tree::json(content, random),
        Kind::JsonLines => tree::json_lines(content, random),
        Kind::Toml => tree::toml(content, random),
        Kind::Png => chunks::png(content, random),
        Kind::Jpeg => chunks::jpeg(content, random),
        Kind::Mp4 => chunks::mp4(content, random),
        Kind::Safetensors => chunks::safetensors(content, random),
        Kind::Npy => chunks::npy(content, random),
        Kind::Npz(name) => chunks::npz(content, name, random),
        Kind::Ply => chunks::ply(content, random),
    }
}

/// One of some things.
fn any<'a, T>(things: &'a [T], random: &mut ChaCha8Rng) -> &'a T {
    &things[random.random_range(0..things.len())]
}
