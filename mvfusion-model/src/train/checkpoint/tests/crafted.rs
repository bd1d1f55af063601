//! Files with the right checksum, whose tensors are not what the model needs.

use super::parts::{Entry, Parts};
use super::{BYTES, Specimen, is_short};

/// A change of a tensor. `None` if it changes nothing of this tensor.
type Change = fn(&Entry) -> Option<Entry>;

fn retyped(entry: &Entry, dtype: &str, factor: f64) -> Option<Entry> {
    let length = (entry.bytes.len() as f64 * factor) as usize;
    let bytes = entry.bytes.iter().copied().chain(std::iter::repeat(0)).take(length).collect();
    Some(Entry { dtype: dtype.to_owned(), bytes, ..entry.clone() })
}

/// The tensor with other rows: zeros are added, or the last are removed.
fn with_rows(entry: &Entry, rows: usize) -> Option<Entry> {
    let width = 4 * entry.shape[1..].iter().product::<usize>();
    let bytes = entry.bytes.iter().copied().chain(std::iter::repeat(0)).take(rows * width).collect();
    let shape = [&[rows], &entry.shape[1..]].concat();
    (shape != entry.shape).then(|| Entry { shape, bytes, ..entry.clone() })
}

fn with_number(entry: &Entry, number: f32) -> Option<Entry> {
    let mut entry = entry.clone();
    let last = entry.bytes.len().checked_sub(4)?;
    entry.bytes[last..].copy_from_slice(&number.to_le_bytes());
    Some(entry)
}

const CHANGES: [(&str, Change); 16] = [
    ("twice as wide a type", |entry| retyped(entry, "F64", 2.0)),
    ("half as wide a type", |entry| retyped(entry, "F16", 0.5)),
    ("a type of a byte", |entry| retyped(entry, "U8", 0.25)),
    ("whole numbers", |entry| retyped(entry, "I32", 1.0)),
    ("another half type", |entry| retyped(entry, "BF16", 0.5)),
    ("an unknown type", |entry| retyped(entry, "F33", 1.0)),
    ("a row more", |entry| with_rows(entry, entry.shape[0] + 1)),
    ("a row less", |entry| with_rows(entry, entry.shape[0] - 1)),
    ("no row", |entry| with_rows(entry, 0)),
    ("one dimension more", |entry| Some(Entry { shape: [&[1], entry.shape.as_slice()].concat(), ..entry.clone() })),
    ("other dimensions", |entry| {
        let shape: Vec<usize> = match entry.shape.as_slice() {
            [one] => vec![*one, 1],
            more => more.iter().rev().copied().collect(),
        };
        (shape != entry.shape).then(|| Entry { shape, ..entry.clone() })
    }),
    ("a shape that overflows", |entry| Some(Entry { shape: vec![usize::MAX, 2], ..entry.clone() })),
    ("a shape beyond its bytes", |entry| {
        let mut shape = entry.shape.clone();
        shape[0] = 1 << 40;
        (!entry.bytes.is_empty()).then(|| Entry { shape, ..entry.clone() })
    }),
    ("a number that is none", |entry| with_number(entry, f32::NAN)),
    ("infinity", |entry| with_number(entry, f32::INFINITY)),
    ("minus infinity", |entry| with_number(entry, f32::NEG_INFINITY)),
];

#[test]
fn a_tensor_of_another_type_or_shape_or_without_numbers_is_refused_by_name() {
    let (specimen, whole) = (Specimen::new(), Parts::of(&BYTES));
    let mut tried = 0;
    for (name, entry) in &whole.tensors {
        for (what, change) in CHANGES {
            let Some(changed) = change(entry) else { continue };
            let mut parts = whole.clone();
            *parts.tensor(name) = changed;
            let said = match tried % 10 {
                0 => specimen.refusal(&parts.bytes()),
                _ => specimen.refusal_of_training(&parts.bytes()),
            };
            let said = said.unwrap_or_else(|| panic!("`{name}` with {what} is accepted"));
            assert!(said.contains(&format!("`{name}`")) && is_short(&said), "`{name}` with {what}: {said}");
            tried += 1;
        }
    }
    assert!(tried > 15 * whole.tensors.len() - 100, "{tried} changes of {} tensors", whole.tensors.len());
}

#[test]
fn a_tensor_that_is_missing_is_refused_by_name() {
    let (specimen, whole) = (Specimen::new(), Parts::of(&BYTES));
    // Gradients are there for attributes that have an influence.
    let is_optional =
        |name: &str| name.starts_with("pending.") && !["pending.visible", "pending.radii"].contains(&name);
    for name in whole.tensors.keys().filter(|name| !is_optional(name)) {
        let mut parts = whole.clone();
        parts.tensors.remove(name);
        let said = specimen.refusal(&parts.bytes()).unwrap_or_else(|| panic!("`{name}` is not missed"));
        assert!(said.contains(&format!("`{name}`")), "{name}: {said}");
    }
}

#[test]
fn a_tensor_that_the_model_does_not_have_is_refused_by_name() {
    let (specimen, whole) = (Specimen::new(), Parts::of(&BYTES));
    for name in
        ["static.mask_logits", "dynamic.colour", "adam.x.first", "statistics.third.seen", "pending.x", "motion.x"]
    {
        let mut parts = whole.clone();
        parts.tensors.insert(name.to_owned(), whole.tensors["dynamic.means"].clone());
        let said = specimen.refusal(&parts.bytes()).unwrap_or_else(|| panic!("`{name}` is accepted"));
        assert!(said.contains(&format!("`{name}`")), "{name}: {said}");
    }
}

#[test]
fn tensors_that_overlap_or_leave_gaps_are_refused_by_name() {
    let specimen = Specimen::new();
    let bytes = BYTES.as_slice();
    let size = u64::from_le_bytes(bytes[..8].try_into().expect("eight bytes")) as usize;
    let json = String::from_utf8(bytes[8..8 + size].to_vec()).expect("JSON");
    let place = json.find(r#""adam.dynamic.log_durations.second""#).expect("it is there");
    let offsets = json[place..].find("[").and_then(|_| json[place..].find(r#""data_offsets":["#)).expect("offsets");
    let first = place + offsets + r#""data_offsets":["#.len();
    let end = first + json[first..].find(']').expect("an end");
    let old: Vec<u64> = json[first..end].split(',').map(|number| number.parse().expect("a number")).collect();
    for new in [[old[0] - 4, old[1] - 4], [old[0] + 4, old[1] + 4], [old[1], old[0]], [old[0], u64::MAX]] {
        let json = format!("{}{},{}{}", &json[..first], new[0], new[1], &json[end..]);
        let file = [&(json.len() as u64).to_le_bytes(), json.as_bytes(), &bytes[8 + size..]].concat();
        let said = specimen.refusal(&Parts::sealed(file)).unwrap_or_else(|| panic!("{new:?} is accepted"));
        assert!(said.contains("`adam.dynamic."), "{new:?}: {said}");
    }
}
