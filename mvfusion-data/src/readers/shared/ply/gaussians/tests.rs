//! Handwritten files of Gaussians, as other tools write them and malformed.

use super::*;
use crate::scene::MASK_FIELDS;

fn read(bytes: &[u8]) -> Result<GaussianCloud, String> {
    read_cloud(bytes, bytes.len() as u64)
}

/// The required fields.
const FIELDS: [&str; 14] = [
    "x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2",
    "rot_3",
];

fn header(format: &str, count: usize, fields: &[String]) -> String {
    let fields: String = fields.iter().map(|field| format!("property float {field}\n")).collect();
    format!("ply\nformat {format} 1.0\nelement vertex {count}\n{fields}end_header\n")
}

/// The required fields and `rest` higher coefficients.
fn fields(rest: usize) -> Vec<String> {
    FIELDS.iter().map(|&field| field.to_owned()).chain((0..rest).map(|i| format!("f_rest_{i}"))).collect()
}

fn ascii(count: usize, fields: &[String], rows: &[&str]) -> Vec<u8> {
    format!("{}{}\n", header("ascii", count, fields), rows.join("\n")).into_bytes()
}

const ROW: &str = "1 2 3 0.1 0.2 0.3 -1.5 -3 -2 -1 0.5 0.25 0 2";

#[test]
fn fields_are_found_by_name_in_any_order_among_others() {
    let mut names = fields(0);
    names.reverse();
    names.insert(3, "nx".to_owned());
    names.push("segment".to_owned());
    let row = "2 0 0.25 9 0.5 -1 -2 -3 -1.5 0.3 0.2 0.1 3 2 1 7";
    let cloud = read(&ascii(1, &names, &[row])).expect("read");
    assert_eq!(cloud, read(&ascii(1, &fields(0), &[ROW])).expect("read"));
    assert_eq!((cloud.means[0], cloud.sh_dc[0]), ([1.0, 2.0, 3.0], [0.1, 0.2, 0.3]));
    assert_eq!((cloud.opacity_logits[0], cloud.log_scales[0]), (-1.5, [-3.0, -2.0, -1.0]));
    assert_eq!((cloud.quaternions[0], cloud.sh_degree), ([0.5, 0.25, 0.0, 2.0], 0));
    assert_eq!(cloud.mask_logits, None);
}

#[test]
fn every_degree_is_read_channel_by_channel() {
    for (degree, rest) in [(0, 0), (1, 9), (2, 24), (3, 45)] {
        let mut bytes = header("binary_little_endian", 2, &fields(rest)).into_bytes();
        for row in 0..2 {
            let values = (0..14 + rest).map(|column| (100 * row + column) as f32 / 8.0);
            bytes.extend(values.flat_map(f32::to_le_bytes));
        }
        let cloud = read(&bytes).expect("read");
        assert_eq!((cloud.sh_degree, cloud.len()), (degree, 2));
        let per_channel = rest / 3;
        for (k, channel) in (0..per_channel).flat_map(|k| (0..3).map(move |channel| (k, channel))) {
            // In the file the channel's place is 14 + channel * per_channel + k.
            assert_eq!(cloud.rest(1)[3 * k + channel], (114 + channel * per_channel + k) as f32 / 8.0);
        }
    }
}

#[test]
fn doubles_big_ends_and_other_elements_are_read() {
    let names: String = FIELDS.iter().map(|field| format!("property double {field}\n")).collect();
    let mut bytes = format!(
        "ply\nformat binary_big_endian 1.0\nelement camera 1\nproperty list uchar int v\nelement vertex 1\n{names}\
         property list uchar float extra\nelement face 1\nproperty char a\nend_header\n"
    )
    .into_bytes();
    bytes.extend([1, 0, 0, 0, 7]);
    bytes.extend((0..14).map(f64::from).flat_map(f64::to_be_bytes));
    bytes.extend([1, 0, 0, 0, 0]);
    bytes.push(3);
    let cloud = read(&bytes).expect("read");
    assert_eq!((cloud.means[0], cloud.quaternions[0]), ([0.0, 1.0, 2.0], [10.0, 11.0, 12.0, 13.0]));
}

#[test]
fn masks_are_read_where_there_are_all_three() {
    let mut names = fields(0);
    names.extend(MASK_FIELDS.map(str::to_owned));
    let cloud = read(&ascii(1, &names, &[&format!("{ROW} 4 5 6")])).expect("read");
    assert_eq!(cloud.mask_logits, Some(vec![[4.0, 5.0, 6.0]]));
    names.pop();
    let error = read(&ascii(1, &names, &[&format!("{ROW} 4 5")])).expect_err("refused");
    assert!(error.contains("`mask_dynamic`"), "{error}");
}

#[test]
fn each_missing_field_is_named() {
    for missing in FIELDS {
        let names: Vec<String> = fields(0).into_iter().filter(|name| name != missing).collect();
        let error = read(&ascii(1, &names, &[ROW])).expect_err("refused");
        assert_eq!(error, format!("its vertices have no field `{missing}`"));
    }
    let mut names = fields(9);
    names[14] = "f_rest_9".to_owned();
    let error = read(&ascii(1, &names, &[&format!("{ROW}{}", " 0".repeat(9))])).expect_err("refused");
    assert!(error.contains("`f_rest_0`"), "{error}");
}

#[test]
fn wrong_counts_are_told() {
    for (count, part) in
        [(3, "announces 3 vertices, but it ends after 2"), (1, "announces 1 vertices, but more follow")]
    {
        let error = read(&ascii(count, &fields(0), &[ROW, ROW])).expect_err("refused");
        assert!(error.contains(part), "{error}");
    }
    let error = read(&ascii(1, &fields(10), &[&format!("{ROW}{}", " 0".repeat(10))])).expect_err("refused");
    assert!(error.contains("10 fields `f_rest_*`") && error.contains("0, 9, 24, 45"), "{error}");
    assert!(read(&ascii(0, &fields(0), &[])).expect("read").is_empty());
}

#[test]
fn numbers_that_are_none_are_named_with_their_row() {
    for (column, name) in
        [(0, "x, y, z"), (4, "f_dc_*"), (6, "opacity"), (8, "scale_*"), (13, "rot_*"), (20, "f_rest_*")]
    {
        for bad in ["nan", "inf", "1e99"] {
            let row = format!("{ROW}{}", " 0".repeat(9));
            let mut words: Vec<&str> = row.split(' ').collect();
            words[column] = bad;
            let error = read(&ascii(2, &fields(9), &[&row, &words.join(" ")])).expect_err("refused");
            assert!(error.contains("vertex 1 of 2") && error.contains(&format!("`{name}` is not finite")), "{error}");
        }
    }
}

#[test]
fn what_is_no_file_of_gaussians_is_refused_with_a_reason() {
    let integers = String::from_utf8(ascii(1, &fields(0), &[ROW])).expect("text");
    let packed = "ply\nformat ascii 1.0\nelement vertex 1\nproperty uint packed_position\nend_header\n1\n";
    let points = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n\
        end_header\n1 2 3\n";
    let cases = [
        ("no ply".to_owned(), ""),
        (integers.replace("float opacity", "int opacity"), "`opacity` of its vertices is not a floating-point number"),
        (integers.replace("float rot_2", "list uchar float rot_2"), "`rot_2`"),
        (integers.replace("1 2 3", "1 two 3"), "vertex 0 of 1"),
        (integers.replace("element vertex", "element point"), "no element `vertex`"),
        (integers.replace("-3 -2 -1", "-3 45 -1"), "`scale_*` is a logarithm from -87 to 20.7, and not 4.5e1"),
        (integers.replace("-3 -2 -1", "-3 -1e30 -1"), "`scale_*` is -1e30, and the largest number is 1e6"),
        (integers.replace("-3 -2 -1", "-3 -90 -1"), "`scale_*` is a logarithm from -87 to 20.7, and not -9e1"),
        (integers.replace("1 2 3", "1 -1e38 3"), "vertex 0 of 1: `x, y, z` is -1e38, and the largest number is 1e9"),
        (packed.to_owned(), "compressed"),
        (points.to_owned(), "`f_dc_0`"),
    ];
    for (text, part) in cases {
        let error = read(text.as_bytes()).expect_err(&text);
        assert!(error.contains(part), "{error}");
    }
}
