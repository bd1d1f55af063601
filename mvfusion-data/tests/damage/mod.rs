//! Damage to a file.

use proptest::prelude::*;

/// Numbers as text that may confuse readers.
const NUMBERS: [&str; 16] = [
    "0",
    "-1",
    "1",
    "2",
    "1e308",
    "-1e-320",
    "1e999",
    "NaN",
    "null",
    "9223372036854775807",
    "18446744073709551616",
    "4294967295",
    "0.5",
    "1e-30",
    "\"x\"",
    "[]",
];

/// Replacements for a word: names, and paths that lead elsewhere or nowhere.
const WORDS: [&str; 10] =
    ["../..", "/etc/passwd", "", ".", "a/../../b", "images", "\u{0}", "\u{1F98A}", "2clutter000.png", "NaN"];

/// Byte patterns of unusual lengths and floats.
const PATTERNS: [[u8; 8]; 8] = [
    [0; 8],
    [255; 8],
    [255, 255, 255, 255, 255, 255, 255, 127],
    [1, 0, 0, 0, 0, 0, 0, 0],
    [0, 0, 0, 0, 0, 0, 240, 127],
    [0, 0, 0, 0, 0, 0, 248, 127],
    [0, 0, 0, 64, 0, 0, 0, 0],
    [16, 39, 0, 0, 0, 0, 0, 0],
];

/// A change to the bytes of a file. Positions are fractions of its length, in 1/65536.
#[derive(Clone, Debug)]
pub enum Damage {
    /// Flips bits of a byte.
    Flip { at: u16, bits: u8 },
    /// Replaces bytes by part of a pattern.
    Pattern { at: u16, which: usize, length: usize },
    /// Removes the rest.
    Cut { at: u16 },
    /// Removes a piece.
    Remove { at: u16, length: u16 },
    /// Repeats a piece.
    Repeat { at: u16, length: u16, times: u8 },
    /// Inserts bytes.
    Insert { at: u16, bytes: Vec<u8> },
    /// Replaces a number in text.
    Number { nth: u16, which: usize },
    /// Replaces a word.
    Word { nth: u16, which: usize },
    /// Swaps two lines.
    Swap { one: u16, other: u16 },
    /// Replaces everything.
    Replace { bytes: Vec<u8> },
}

/// Any change. Common ones are more frequent.
pub fn any_damage() -> impl Strategy<Value = Damage> {
    let bytes = |most| prop::collection::vec(any::<u8>(), 0..most);
    prop_oneof![
        3 => (any::<u16>(), 1u8..).prop_map(|(at, bits)| Damage::Flip { at, bits }),
        3 => (any::<u16>(), 0..PATTERNS.len(), 1usize..=8).prop_map(|(at, which, length)| Damage::Pattern { at, which, length }),
        2 => any::<u16>().prop_map(|at| Damage::Cut { at }),
        2 => (any::<u16>(), 1u16..200).prop_map(|(at, length)| Damage::Remove { at, length }),
        1 => (any::<u16>(), 1u16..200, 1u8..20).prop_map(|(at, length, times)| Damage::Repeat { at, length, times }),
        1 => (any::<u16>(), bytes(40)).prop_map(|(at, bytes)| Damage::Insert { at, bytes }),
        5 => (any::<u16>(), 0..NUMBERS.len()).prop_map(|(nth, which)| Damage::Number { nth, which }),
        3 => (any::<u16>(), 0..WORDS.len()).prop_map(|(nth, which)| Damage::Word { nth, which }),
        1 => (any::<u16>(), any::<u16>()).prop_map(|(one, other)| Damage::Swap { one, other }),
        1 => bytes(300).prop_map(|bytes| Damage::Replace { bytes }),
    ]
}

impl Damage {
    /// Applies the change.
    pub fn apply(&self, content: &mut Vec<u8>) {
        let length = content.len();
        let place = |at: u16| usize::from(at) * length / 65536;
        match self {
            &Self::Flip { at, bits } => {
                if let Some(byte) = content.get_mut(place(at)) {
                    *byte ^= bits;
                }
            }
            &Self::Pattern { at, which, length } => {
                for (byte, &new) in content.iter_mut().skip(place(at)).zip(&PATTERNS[which][..length]) {
                    *byte = new;
                }
            }
            &Self::Cut { at } => content.truncate(place(at)),
            &Self::Remove { at, length: piece } => {
                content.drain(place(at)..(place(at) + usize::from(piece)).min(length));
            }
            &Self::Repeat { at, length: piece, times } => {
                let piece = content[place(at)..(place(at) + usize::from(piece)).min(length)].repeat(times.into());
                content.splice(place(at)..place(at), piece);
            }
            Self::Insert { at, bytes } => {
                content.splice(place(*at)..place(*at), bytes.iter().copied());
            }
            &Self::Number { nth, which } => {
                let is_part = |byte: u8| byte.is_ascii_digit() || b".-+e".contains(&byte);
                replace_token(content, nth, is_part, |token| token.iter().any(u8::is_ascii_digit), NUMBERS[which]);
            }
            &Self::Word { nth, which } => {
                let is_part = |byte: u8| byte.is_ascii_alphanumeric() || b"_./".contains(&byte);
                replace_token(content, nth, is_part, |token| token.iter().any(u8::is_ascii_alphabetic), WORDS[which]);
            }
            &Self::Swap { one, other } => {
                let mut lines: Vec<&[u8]> = content.split(|&byte| byte == b'\n').collect();
                let place = |at: u16| usize::from(at) * lines.len() / 65536;
                let (one, other) = (place(one), place(other));
                lines.swap(one, other);
                *content = lines.join(&b'\n');
            }
            Self::Replace { bytes } => content.clone_from(bytes),
        }
    }
}

/// Replaces a token, which is a run of bytes with `is_part`. Only tokens that `counts` accepts are considered.
fn replace_token(
    content: &mut Vec<u8>,
    nth: u16,
    is_part: impl Fn(u8) -> bool,
    counts: impl Fn(&[u8]) -> bool,
    text: &str,
) {
    let mut tokens = Vec::new();
    let mut start = None;
    for place in 0..=content.len() {
        let inside = content.get(place).is_some_and(|&byte| is_part(byte));
        match (start, inside) {
            (None, true) => start = Some(place),
            (Some(begin), false) => {
                if counts(&content[begin..place]) {
                    tokens.push(begin..place);
                }
                start = None;
            }
            _ => {}
        }
    }
    if !tokens.is_empty() {
        let token = tokens.swap_remove(usize::from(nth) * tokens.len() / 65536);
        content.splice(token, text.bytes());
    }
}
