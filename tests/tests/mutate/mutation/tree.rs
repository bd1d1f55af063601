//! Changes to JSON and TOML: to values and keys, whatever their text looks like.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use serde_json::{Value, json};

use super::any;

/// Brackets within brackets, more than any parser of ours follows.
const DEEP: usize = 200;

/// Most copies of an entry.
const COPIES: usize = 40;

/// Keys for an entry that is renamed or added.
const KEYS: [&str; 6] = ["", "x", "frames", "__metadata__", "\u{0}", "time"];

pub fn json(content: &[u8], random: &mut ChaCha8Rng) -> Option<Vec<u8>> {
    let mut value = serde_json::from_slice(content).ok()?;
    change(&mut value, random);
    Some(value.to_string().into_bytes())
}

pub fn json_lines(content: &[u8], random: &mut ChaCha8Rng) -> Option<Vec<u8>> {
    let mut lines: Vec<Vec<u8>> = content.split(|&byte| byte == b'\n').map(<[u8]>::to_vec).collect();
    let at = random.random_range(0..lines.len());
    lines[at] = json(&lines[at], random)?;
    Some(lines.join(&b'\n'))
}

pub fn toml(content: &[u8], random: &mut ChaCha8Rng) -> Option<Vec<u8>> {
    let table: toml::Table = std::str::from_utf8(content).ok()?.parse().ok()?;
    let mut value = serde_json::to_value(table).ok()?;
    change(&mut value, random);
    Some(toml::to_string(&value).ok()?.into_bytes())
}

/// Changes a node of a value.
pub fn change(value: &mut Value, random: &mut ChaCha8Rng) {
    let mut places = Vec::new();
    collect(value, String::new(), &mut places);
    let place = any(&places, random);
    let Some(node) = value.pointer_mut(place) else { return };
    match node {
        Value::Array(entries) if !entries.is_empty() && random.random_bool(0.8) => array(entries, random),
        Value::Object(entries) if !entries.is_empty() && random.random_bool(0.8) => object(entries, random),
        Value::Number(number) if random.random_bool(0.5) => {
            let old = number.as_f64().unwrap_or(0.0);
            *node = match (number.as_i64(), random.random_range(0..5)) {
                (Some(old), 0) => json!(old.wrapping_add(1)),
                (Some(old), 1) => json!(old.wrapping_sub(1)),
                (_, 2) => json!(-old),
                (_, 3) => json!(old * 1e30),
                _ => json!(old * 0.5),
            };
        }
        node => *node = odd(random),
    }
}

/// The JSON pointers of all nodes.
fn collect(value: &Value, place: String, places: &mut Vec<String>) {
    match value {
        Value::Array(entries) => {
            entries.iter().enumerate().for_each(|(at, entry)| collect(entry, format!("{place}/{at}"), places));
        }
        Value::Object(entries) => {
            let escaped = |key: &str| key.replace('~', "~0").replace('/', "~1");
            entries.iter().for_each(|(key, entry)| collect(entry, format!("{place}/{}", escaped(key)), places));
        }
        _ => {}
    }
    places.push(place);
}

fn array(entries: &mut Vec<Value>, random: &mut ChaCha8Rng) {
    let (one, other) = (random.random_range(0..entries.len()), random.random_range(0..entries.len()));
    match random.random_range(0..6) {
        0 => drop(entries.remove(one)),
        1 => entries.swap(one, other),
        2 => entries.truncate(one),
        3 => entries[other] = entries[one].clone(),
        4 => {
            let copies = vec![entries[one].clone(); random.random_range(1..COPIES)];
            entries.extend(copies);
        }
        _ => entries[one] = odd(random),
    }
}

fn object(entries: &mut serde_json::Map<String, Value>, random: &mut ChaCha8Rng) {
    let keys: Vec<String> = entries.keys().cloned().collect();
    let (one, other) = (any(&keys, random), any(&keys, random));
    match random.random_range(0..5) {
        0 => drop(entries.remove(one)),
        1 => {
            let value = entries.remove(one).unwrap_or(Value::Null);
            entries.insert((*any(&KEYS, random)).to_owned(), value);
        }
        2 => drop(entries.insert((*any(&KEYS, random)).to_owned(), odd(random))),
        3 => drop(entries.insert(one.clone(), entries[other].clone())),
        _ => drop(entries.insert(one.clone(), odd(random))),
    }
}

/// A value that is hardly ever right.
fn odd(random: &mut ChaCha8Rng) -> Value {
    match random.random_range(0..18) {
        0 => Value::Null,
        1 => json!(true),
        2 => json!(0),
        3 => json!(-1),
        4 => json!(1),
        5 => json!(u64::MAX),
        6 => json!(i64::MIN),
        7 => json!(u32::MAX),
        8 => json!(1e308),
        9 => json!(1e38),
        10 => json!(1e-320),
        11 => json!(0.5),
        12 => json!(""),
        13 => json!("../../etc/passwd"),
        14 => json!("NaN"),
        15 => json!([]),
        16 => json!({}),
        _ => (0..random.random_range(1..DEEP)).fold(json!(1), |inner, _| json!([inner])),
    }
}
