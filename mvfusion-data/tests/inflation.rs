//! Large files with the shortest possible entries. Reading them may not take many times their size in memory.

mod small;

use std::fs;
use std::path::Path;

use mvfusion_data::{Layout, ReadOptions, open};
use peak_alloc::PeakAlloc;

use small::write_small;

#[global_allocator]
static ALLOCATOR: PeakAlloc = PeakAlloc;

/// Memory that reading may hold at once, in bytes of the file.
const MOST_TIMES: usize = 10;

/// Approximate size of each file in bytes. Other memory of the reader is negligible beside it.
const SIZE: usize = 4 << 20;

/// A piece of text, repeated to the size of a file.
fn repeated(piece: &str) -> String {
    piece.repeat(SIZE / piece.len())
}

/// A file that replaces another.
struct Inflated {
    layout: Layout,
    file: &'static str,
    content: Vec<u8>,
}

/// A file of points with equal rows.
fn ply(format: &str, kind: &str, row: &[u8]) -> Vec<u8> {
    let rows = SIZE / row.len();
    let fields = ["x", "y", "z"].map(|name| format!("property {kind} {name}\n")).concat();
    let head = format!("ply\nformat {format} 1.0\nelement vertex {rows}\n{fields}end_header\n");
    [head.as_bytes(), &row.repeat(rows)].concat()
}

/// A binary file of records that differ at most in their numbers.
fn records(record: impl Fn(u32) -> Vec<u8>) -> Vec<u8> {
    let count = SIZE / record(0).len();
    let records = (0..count as u32).flat_map(record);
    (count as u64).to_le_bytes().into_iter().chain(records).collect()
}

fn camera(number: u32) -> Vec<u8> {
    let (sides, parameters) = ([16u64; 2].map(u64::to_le_bytes).concat(), [9.0f64; 3].map(f64::to_le_bytes).concat());
    [&number.to_le_bytes()[..], &[0; 4], &sides, &parameters].concat()
}

fn inflated() -> Vec<Inflated> {
    let zeros = repeated("0,");
    let moments: String = (0..SIZE / 20).map(|i| format!("\"{i}\":{{\"warp_id\":0}},")).collect();
    let properties = repeated("property int a\n");
    let of = |layout, file, content: Vec<u8>| Inflated { layout, file, content };
    vec![
        // Entries that no reader knows.
        of(Layout::Nerfstudio, "transforms.json", format!("{{\"x\":[{zeros}0],\"frames\":[]}}").into()),
        of(Layout::Nerfstudio, "transforms.json", format!("{{\"frames\":[{{\"x\":[{zeros}0]}}]}}").into()),
        of(Layout::HyperNerf, "metadata.json", format!("{{{moments}\"last\":{{\"warp_id\":0}}}}").into()),
        of(Layout::Colmap, "sparse/0/points3D.bin", records(|_| vec![0; 51])),
        of(Layout::Colmap, "sparse/0/cameras.bin", records(camera)),
        of(Layout::OnTheGo, "points3D.ply", ply("ascii", "float", b"0 0 0\n")),
        of(Layout::Neu3d, "points3D.ply", ply("binary_little_endian", "uchar", &[0; 3])),
        of(Layout::Neu3d, "points3D.ply", format!("ply\nformat ascii 1.0\nelement vertex 1\n{properties}").into()),
        of(Layout::OnTheGoColmap, "train_list.txt", repeated("a\n").into()),
    ]
}

/// A small sound scene of a layout.
fn written(layout: Layout, folder: &Path) {
    write_small(layout, folder);
    if layout == Layout::OnTheGoColmap {
        fs::write(folder.join("test_list.txt"), "1extra000.png\n").expect("written");
    }
}

// One test, one thread: memory is counted for the whole process.
#[test]
fn entries_as_short_as_can_be_do_not_take_many_times_their_bytes() {
    let place = tempfile::tempdir().expect("folder");
    for (number, Inflated { layout, file, content }) in inflated().into_iter().enumerate() {
        let folder = place.path().join(number.to_string());
        written(layout, &folder);
        fs::write(folder.join(file), &content).expect("written");
        let size = content.len();
        drop(content);
        let before = ALLOCATOR.current_usage();
        ALLOCATOR.reset_peak_usage();
        drop(open(&folder, &ReadOptions::default()));
        let taken = ALLOCATOR.peak_usage().saturating_sub(before);
        assert!(taken <= MOST_TIMES * size, "{file} of {size} bytes ({number}) takes {taken}");
    }
}
