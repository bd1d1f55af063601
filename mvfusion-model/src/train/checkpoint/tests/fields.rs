//! Files with the right checksum, whose header says what cannot be.

use serde_json::{Value, json};

use super::parts::Parts;
use super::{BYTES, Specimen, is_short};

/// Fields by their pointers, and values that do not belong there. The name of the field must be in the message.
fn changes() -> Vec<(&'static str, Vec<Value>)> {
    let counts = || vec![json!(-1), json!(1e300), json!(u64::MAX), json!(0.5), json!("many"), Value::Null];
    let normaliser = |means: usize, variances: usize, value: f64| json!({"means": vec![0.0; means], "variances": vec![value; variances]});
    vec![
        // The training has eight steps.
        ("/completed", [counts(), vec![json!(9)]].concat()),
        (
            "/sh_degrees",
            vec![json!([9, 0]), json!([0, 2]), json!([]), json!([0]), json!([0, 0, 0]), json!([-1, 0]), json!(0)],
        ),
        (
            "/grid_max",
            vec![json!([1, 1]), json!([-1e9, 1e9, 1e9]), json!([1e300, 1e300, 1e300]), json!([null, 1, 1]), json!("x")],
        ),
        ("/grid_min", vec![json!([1e9, 0, 0]), json!([-1e39, -1, -1]), json!([-3e38, -3e38, -3e38, 0]), json!([])]),
        ("/grid_layout", vec![json!({}), Value::Null, json!([3, 4])]),
        ("/grid_layout/features", vec![json!(0), json!(3), json!(-1), json!(u64::MAX)]),
        (
            "/grid_layout/resolution",
            vec![json!([4, 3, 5, 6]), json!([0, 0, 0, 0]), json!([u64::MAX, 2, 2, 2]), json!([3, 4, 5])],
        ),
        ("/grid_layout/multipliers", vec![json!([]), json!([2, 1]), json!([1]), json!([u64::MAX, 1])]),
        (
            "/knot_times",
            vec![
                json!([]),
                json!([0.0, 1.0, 0.5]),
                json!([0.0, 0.0, 1.0]),
                json!(vec![0.0; 4]),
                json!([0.0, 0.1, 0.2, 0.3]),
                json!([0.0, null, 1.0]),
                json!(3),
            ],
        ),
        (
            "/adam_steps",
            vec![json!({"dynamic.means": -1}), json!({"dynamic.means": u64::MAX}), json!({"nobody": 1}), json!([])],
        ),
        (
            "/normalisers/signatures",
            vec![normaliser(12, 12, 1.0), normaliser(13, 12, 1.0), normaliser(13, 13, -1.0), normaliser(0, 13, 1.0)],
        ),
        ("/normalisers/local", vec![normaliser(2, 2, 1.0), normaliser(1, 0, 1.0), normaliser(1, 1, -1e-9), json!({})]),
        ("/streams", vec![json!({}), Value::Null]),
        ("/streams/densify", vec![json!({"seed": [0, 1]}), json!(-1)]),
        (
            "/sampler",
            vec![
                json!({"remaining": [-1], "round_ended": false}),
                json!({"remaining": [0.5], "round_ended": true}),
                json!({}),
            ],
        ),
        ("/census", vec![json!([]), json!({})]),
        ("/census/0/added", counts()),
        ("/census/1/pruned", counts()),
        ("/census/1/relocated", counts()),
        ("/census/0/resets", counts()),
        ("/refreshes", counts()),
        ("/bad_steps", vec![json!({}), json!(0)]),
        ("/bad_steps/total", counts()),
        ("/bad_steps/in_a_row", counts()),
    ]
}

/// What a message must contain: the first name of a pointer.
fn field(pointer: &str) -> &str {
    pointer.trim_start_matches('/').split('/').next().unwrap_or_default()
}

#[test]
fn a_field_that_cannot_be_is_refused_by_name() {
    let (specimen, whole) = (Specimen::new(), Parts::of(&BYTES));
    for (pointer, values) in changes() {
        for value in values {
            let mut parts = whole.clone();
            let slot = parts.header.pointer_mut(pointer).unwrap_or_else(|| panic!("{pointer} is not there"));
            *slot = value.clone();
            let said = specimen.refusal(&parts.bytes()).unwrap_or_else(|| panic!("{pointer} = {value} is accepted"));
            assert!(said.contains(&format!("`{}", field(pointer))) && is_short(&said), "{pointer} = {value}: {said}");
        }
    }
}

#[test]
fn fewer_or_more_knots_than_columns_are_refused() {
    let (specimen, whole) = (Specimen::new(), Parts::of(&BYTES));
    for (knots, name) in [(json!([0.0, 1.0]), "`motion.local`"), (Value::Null, "`motion.")] {
        let mut parts = whole.clone();
        parts.header["knot_times"] = knots;
        let said = specimen.refusal(&parts.bytes()).expect("it is refused");
        assert!(said.contains(name), "{said}");
    }
}

#[test]
fn a_field_that_is_missing_or_unknown_is_refused_by_name() {
    let (specimen, whole) = (Specimen::new(), Parts::of(&BYTES));
    let names: Vec<String> = whole.header.as_object().expect("an object").keys().cloned().collect();
    for name in names {
        let mut parts = whole.clone();
        parts.header.as_object_mut().expect("an object").remove(&name);
        let said = specimen.refusal(&parts.bytes()).unwrap_or_else(|| panic!("`{name}` is not missed"));
        assert!(said.contains(&format!("`{name}` is missing")), "{said}");
    }
    let mut parts = whole.clone();
    parts.header["colour"] = json!(1);
    let said = specimen.refusal(&parts.bytes()).expect("it is refused");
    assert!(said.contains("`colour` is no field"), "{said}");
}

#[test]
fn a_header_that_is_no_json_is_refused() {
    let (specimen, mut parts) = (Specimen::new(), Parts::of(&BYTES));
    parts.header = json!("deep");
    assert!(specimen.refusal(&parts.bytes()).is_some_and(|said| said.contains("its header is no JSON object")));
    // Nested deeper than any reader should follow.
    let json = format!(
        r#"{{"__metadata__":{{"sha256":"{}","schema":"2","mvfusion":"{{}}"}},"x":{}}}"#,
        "0".repeat(64),
        "[".repeat(1 << 20)
    );
    let bytes = [&(json.len() as u64).to_le_bytes(), json.as_bytes()].concat();
    assert!(specimen.refusal(&Parts::sealed(bytes)).is_some_and(|said| is_short(&said)));
}
