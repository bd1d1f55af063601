//! Changes to bytes, to the numbers that they may be, and to words and lines.

use std::ops::Range;

use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::any;

/// Numbers as text that may confuse readers.
const NUMBERS: [&str; 18] = [
    "0",
    "-1",
    "1",
    "2",
    "1e308",
    "-1e-320",
    "1e999",
    "1e38",
    "NaN",
    "inf",
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

/// Floats that are hard to compute with.
const FLOATS: [f64; 8] = [f64::NAN, f64::INFINITY, -f64::INFINITY, 1e300, 1e38, -0.0, 1e-310, -1e19];

/// Bytes at the start of a file that a header often has.
const HEADER: usize = 256;

/// Longest piece that is removed or repeated.
const PIECE: usize = 200;

/// Any change.
pub fn change(content: &mut Vec<u8>, random: &mut ChaCha8Rng) {
    match random.random_range(0..20) {
        0..3 => flip(content, random),
        3..7 => integer(content, random),
        7 => float(content, random),
        8 => content.truncate(place(content, random)),
        9 => drop(content.drain(piece(content, random))),
        10 => repeat(content, random),
        11 => insert(content, random),
        12 => swap_pieces(content, random),
        13..16 => number(content, random),
        16..18 => word(content, random),
        18 => lines(content, random),
        _ => *content = some_bytes(300, random),
    }
}

/// A place, more often in the header than elsewhere.
fn place(content: &[u8], random: &mut ChaCha8Rng) -> usize {
    let end = if random.random_bool(0.4) { content.len().min(HEADER) } else { content.len() };
    random.random_range(0..=end)
}

fn piece(content: &[u8], random: &mut ChaCha8Rng) -> Range<usize> {
    let start = place(content, random);
    start..(start + random.random_range(1..=PIECE)).min(content.len())
}

fn some_bytes(most: usize, random: &mut ChaCha8Rng) -> Vec<u8> {
    (0..random.random_range(0..most)).map(|_| random.random()).collect()
}

fn flip(content: &mut [u8], random: &mut ChaCha8Rng) {
    let at = place(content, random);
    if let Some(byte) = content.get_mut(at) {
        *byte ^= random.random_range(1..=u8::MAX);
    }
}

/// Changes a binary integer, as a count, a length or an offset may be one: to 0, 1, the largest, or by one.
pub fn integer(content: &mut [u8], random: &mut ChaCha8Rng) {
    let width = *any(&[1, 2, 4, 8], random);
    let at = place(content, random);
    // Numbers mostly lie at multiples of their width.
    let at = if random.random_bool(0.7) { at - at % width } else { at };
    let Some(bytes) = content.get_mut(at..at + width) else { return };
    let is_big_endian = random.random_bool(0.5);
    if is_big_endian {
        bytes.reverse();
    }
    let old = bytes.iter().rev().fold(0, |number: u64, &byte| number << 8 | u64::from(byte));
    let new = match random.random_range(0..9) {
        0 => 0,
        1 => 1,
        2 => u64::MAX,
        3 => u64::MAX >> 1 >> (64 - 8 * width as u32),
        4 => old.wrapping_add(1),
        5 => old.wrapping_sub(1),
        6 => old.wrapping_mul(2),
        7 => old << random.random_range(1..32),
        _ => random.random_range(0..100_000),
    };
    bytes.copy_from_slice(&new.to_le_bytes()[..width]);
    if is_big_endian {
        bytes.reverse();
    }
}

fn float(content: &mut [u8], random: &mut ChaCha8Rng) {
    let value = *any(&FLOATS, random);
    let bytes =
        if random.random_bool(0.5) { value.to_le_bytes().to_vec() } else { (value as f32).to_le_bytes().to_vec() };
    let at = place(content, random) / 4 * 4;
    if let Some(old) = content.get_mut(at..at + bytes.len()) {
        old.copy_from_slice(&bytes);
    }
}

fn repeat(content: &mut Vec<u8>, random: &mut ChaCha8Rng) {
    let range = piece(content, random);
    let start = range.start;
    let copies = content[range].repeat(random.random_range(1..20));
    content.splice(start..start, copies);
}

fn insert(content: &mut Vec<u8>, random: &mut ChaCha8Rng) {
    let at = place(content, random);
    content.splice(at..at, some_bytes(40, random));
}

fn swap_pieces(content: &mut Vec<u8>, random: &mut ChaCha8Rng) {
    let range = piece(content, random);
    let cut: Vec<u8> = content.drain(range).collect();
    let at = place(content, random);
    content.splice(at..at, cut);
}

/// Replaces a number in text, or changes it by one.
pub fn number(content: &mut Vec<u8>, random: &mut ChaCha8Rng) {
    let is_part = |byte: u8| byte.is_ascii_digit() || b".-+e".contains(&byte);
    let found = tokens(content, is_part, |token| token.iter().any(u8::is_ascii_digit));
    if found.is_empty() {
        return;
    }
    let token = any(&found, random).clone();
    let old = std::str::from_utf8(&content[token.clone()]).ok().and_then(|text| text.parse::<i64>().ok());
    let new = match (old, random.random_bool(0.4)) {
        (Some(old), true) => old.wrapping_add(*any(&[1, -1], random)).to_string(),
        _ => (*any(&NUMBERS, random)).to_owned(),
    };
    content.splice(token, new.into_bytes());
}

fn word(content: &mut Vec<u8>, random: &mut ChaCha8Rng) {
    let is_part = |byte: u8| byte.is_ascii_alphanumeric() || b"_./".contains(&byte);
    let found = tokens(content, is_part, |token| token.iter().any(u8::is_ascii_alphabetic));
    if !found.is_empty() {
        let token = any(&found, random).clone();
        content.splice(token, any(&WORDS, random).bytes());
    }
}

/// The runs of bytes with `is_part` that `counts`.
fn tokens(content: &[u8], is_part: impl Fn(u8) -> bool, counts: impl Fn(&[u8]) -> bool) -> Vec<Range<usize>> {
    let mut found = Vec::new();
    let mut start = None;
    for place in 0..=content.len() {
        let inside = content.get(place).is_some_and(|&byte| is_part(byte));
        match (start, inside) {
            (None, true) => start = Some(place),
            (Some(begin), false) => {
                if counts(&content[begin..place]) {
                    found.push(begin..place);
                }
                start = None;
            }
            _ => {}
        }
    }
    found
}

/// Swaps, removes or repeats lines.
pub fn lines(content: &mut Vec<u8>, random: &mut ChaCha8Rng) {
    let mut lines: Vec<&[u8]> = content.split(|&byte| byte == b'\n').collect();
    let (one, other) = (random.random_range(0..lines.len()), random.random_range(0..lines.len()));
    match random.random_range(0..3) {
        0 => lines.swap(one, other),
        1 => drop(lines.remove(one)),
        _ => lines.insert(other, lines[one]),
    }
    *content = lines.join(&b'\n');
}
