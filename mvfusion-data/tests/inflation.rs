//! Files that are large, and whose entries are as short as can be: what is read of them may not take many times their size.

use std::fs;
use std::path::Path;

use mvfusion_data::{BuiltinKind, BuiltinOptions, Capture, Layout, ReadOptions, builtin, open, write};
use peak_alloc::PeakAlloc;

#[global_allocator]
static ALLOCATOR: PeakAlloc = PeakAlloc;

/// How many times the bytes of a file its reading may hold at once.
const MOST_TIMES: usize = 10;

/// Bytes of each file, more or less: enough that what reading takes for other things does not count.
const SIZE: usize = 4 << 20;

/// As much text of a piece as a file has.
fn repeated(piece: &str) -> String {
    piece.repeat(SIZE / piece.len())
}

/// A file that is put in the place of another.
struct Inflated {
    layout: Layout,
    file: &'static str,
    content: Vec<u8>,
}

fn inflated() -> Vec<Inflated> {
    let zeros = repeated("0,");
    let numbered = |piece: fn(usize) -> String| (0..SIZE / 40).map(piece).collect::<String>();
    let ply = |format: &str, kind: &str, rows: &[u8], row: usize| {
        let head = format!(
            "ply\nformat {format} 1.0\nelement vertex {}\nproperty {kind} x\nproperty {kind} y\nproperty {kind} z\nend_header\n",
            rows.len() / row
        );
        [head.as_bytes(), rows].concat()
    };
    let entries: Vec<(Layout, &'static str, Vec<u8>)> = vec![
        (Layout::Nerfstudio, "transforms.json", format!("{{\"x\":[{zeros}0],\"frames\":[]}}").into()),
        (Layout::Nerfstudio, "transforms.json", format!("{{\"frames\":[{{\"x\":[{zeros}0]}}]}}").into()),
        (
            Layout::Nerfstudio,
            "transforms.json",
            format!("{{\"frames\":[{}", repeated("{\"file_path\":\"\",\"transform_matrix\":[]},")).into(),
        ),
        (
            Layout::Nerfstudio,
            "transforms.json",
            format!("{{\"frames\":[{{\"file_path\":\"\",\"transform_matrix\":[{}", repeated("[],")).into(),
        ),
        (
            Layout::Nerfstudio,
            "transforms.json",
            format!(
                "{{\"frames\":[{}",
                numbered(|i| format!(
                    "{{\"file_path\":\"{i:06}\",\"transform_matrix\":[[1,0,0,0],[0,1,0,0],[0,0,1,0]]}},"
                ))
            )
            .into(),
        ),
        (Layout::Panoptic, "train_meta.json", format!("{{\"k\":[[[{}", repeated("[],")).into()),
        (Layout::Panoptic, "train_meta.json", format!("{{\"fn\":[[{}", repeated("\"\",")).into()),
        (Layout::Panoptic, "train_meta.json", format!("{{\"cam_id\":[{}", repeated("[],")).into()),
        (Layout::HyperNerf, "dataset.json", format!("{{\"ids\":[{zeros}0]}}").into()),
        (Layout::HyperNerf, "dataset.json", format!("{{\"ids\":[{}", repeated("\"\",")).into()),
        (
            Layout::HyperNerf,
            "metadata.json",
            format!("{{{}", numbered(|i| format!("\"{i}\":{{\"warp_id\":0}},"))).into(),
        ),
        (Layout::HyperNerf, "camera/000000.json", format!("{{\"radial_distortion\":[{zeros}0]}}").into()),
        (Layout::OnTheGo, "split.json", format!("{{\"clutter\":[{zeros}0]}}").into()),
        (
            Layout::Colmap,
            "sparse/0/points3D.bin",
            [&(100_000u64).to_le_bytes()[..], &[0u8; 51].repeat(100_000)].concat(),
        ),
        (
            Layout::Colmap,
            "sparse/0/images.bin",
            [&(50_000u64).to_le_bytes()[..], &{
                (0..50_000u32)
                    .flat_map(|i| {
                        let mut image = i.to_le_bytes().to_vec();
                        image.extend([1.0f64, 0., 0., 0., 0., 0., 0.].iter().flat_map(|v| v.to_le_bytes()));
                        image.extend(1u32.to_le_bytes());
                        image.extend(format!("{i:05}\0").bytes());
                        image.extend([0u8; 8]);
                        image
                    })
                    .collect::<Vec<u8>>()
            }]
            .concat(),
        ),
        (
            Layout::Colmap,
            "sparse/0/cameras.bin",
            [&(60_000u64).to_le_bytes()[..], &{
                (0..60_000u32)
                    .flat_map(|i| {
                        let mut camera = i.to_le_bytes().to_vec();
                        camera.extend(0u32.to_le_bytes());
                        camera.extend([16u64; 2].iter().flat_map(|v| v.to_le_bytes()));
                        camera.extend([9.0f64; 3].iter().flat_map(|v| v.to_le_bytes()));
                        camera
                    })
                    .collect::<Vec<u8>>()
            }]
            .concat(),
        ),
        (Layout::RobustNerf, "0/sparse/0/images.txt", numbered(|i| format!("1 1 0 0 0 0 0 0 1 {i}\n\n")).into()),
        (Layout::RobustNerf, "0/sparse/0/cameras.txt", numbered(|i| format!("{i} PINHOLE 9 9 1 1 1 1\n")).into()),
        (Layout::RobustNerf, "0/sparse/0/points3D.txt", repeated("1 1 1 1 1 1 1\n").into()),
        (Layout::Neu3d, "points3D.ply", ply("ascii", "float", repeated("0 0 0\n").as_bytes(), 6)),
        (Layout::Neu3d, "points3D.ply", ply("binary_little_endian", "uchar", &vec![0; SIZE / 3 * 3], 3)),
        (Layout::Neu3d, "points3D.ply", format!("ply\nformat ascii 1.0\n{}", repeated("a ")).into()),
        (
            Layout::Neu3d,
            "points3D.ply",
            format!("ply\nformat ascii 1.0\nelement vertex 1\n{}", repeated("property int a\n")).into(),
        ),
        (Layout::OnTheGoColmap, "train_list.txt", repeated("a\n").into()),
    ];
    entries.into_iter().map(|(layout, file, content)| Inflated { layout, file, content }).collect()
}

/// A small sound scene of a layout.
fn written(layout: Layout, folder: &Path) {
    let kind = match layout.capture() {
        Capture::Video => BuiltinKind::Video,
        Capture::Photos => BuiltinKind::Casual,
    };
    let options = BuiltinOptions { kind, width: 16, height: 16, frames: 2, photos: 2, test_photos: 1, seed: 1 };
    write(&builtin::builtin(&options), layout, folder).expect("written");
    if layout == Layout::RobustNerf {
        let model = folder.join("0/sparse/0");
        fs::remove_dir_all(&model).expect("removed");
        fs::create_dir_all(&model).expect("made");
        let image = "1 1 0 0 0 0 0 4 1 2clutter000.png\n\n";
        for (name, text) in
            [("cameras.txt", "1 PINHOLE 16 16 14 14 8 8\n"), ("images.txt", image), ("points3D.txt", "")]
        {
            fs::write(model.join(name), text).expect("written");
        }
    }
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
        let outcome = open(&folder, &ReadOptions::default());
        let taken = ALLOCATOR.peak_usage().saturating_sub(before);
        let says = outcome.map_or_else(|error| error.to_string(), |scene| format!("{} points", scene.points.len()));
        let says: String = says.chars().take(200).collect();
        eprintln!("{number} {file} {size}: {:.1} times: {says}", taken as f64 / size as f64);
    }
}
