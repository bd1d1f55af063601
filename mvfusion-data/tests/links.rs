//! Scenes with folders, devices, and circular or broken links in place of files. Scenes are distributed as archives,
//! which can hold all of these.
#![cfg(unix)]

mod small;

use std::fs;
use std::os::unix::fs::symlink;
use std::path::Path;

use mvfusion_data::{Layout, ReadOptions, open};
use small::write_small;

/// Creates something at a path.
type Replace = fn(&Path);

/// Replacements for a file or a folder.
const REPLACEMENTS: [(&str, Replace); 4] = [
    ("a folder", |path| fs::create_dir(path).expect("made")),
    ("a device", |path| symlink("/dev/null", path).expect("linked")),
    ("a circle", |path| symlink(path, path).expect("linked")),
    ("a link to its own folder", |path| symlink(".", path).expect("linked")),
];

/// Required parts of a layout, and optional ones (points and bounds).
const PARTS: [(Layout, &[&str], &[&str]); 8] = [
    (Layout::Neu3d, &["poses_bounds.npy", "cam01/images", "cam01/images/0000.png"], &["points3D.ply"]),
    (Layout::Panoptic, &["train_meta.json", "test_meta.json", "ims"], &["init_pt_cld.npz"]),
    (Layout::Nerfstudio, &["transforms.json", "images", "points3D.ply"], &[]),
    (Layout::MultipleView, &["sparse_", "sparse_/cameras.bin", "sparse_/images.bin"], &["points3D_multipleview.ply"]),
    (Layout::DNerf, &["transforms_train.json", "transforms_test.json", "train"], &["fused.ply"]),
    (
        Layout::HyperNerf,
        &["dataset.json", "metadata.json", "camera/000000.json", "rgb/1x"],
        &["points.npy", "scene.json"],
    ),
    (Layout::Colmap, &["images", "sparse", "sparse/0/images.bin", "sparse/0/points3D.bin"], &[]),
    (Layout::OnTheGo, &["images", "transforms.json"], &["points3D.ply"]),
];

#[test]
fn what_is_no_file_is_an_error_or_is_not_there() {
    let place = tempfile::tempdir().expect("folder");
    for (layout, needed, spare) in PARTS {
        let folder = place.path().join(layout.key());
        write_small(layout, &folder);
        for (part, is_needed) in needed.iter().map(|part| (part, true)).chain(spare.iter().map(|part| (part, false))) {
            let (path, aside) = (folder.join(part), place.path().join("aside"));
            fs::rename(&path, &aside).unwrap_or_else(|error| panic!("{part} of {}: {error}", layout.key()));
            for (what, replace) in REPLACEMENTS {
                replace(&path);
                let outcome = open(&folder, &ReadOptions::default());
                match outcome {
                    Ok(_) => assert!(!is_needed, "{what} in the place of {part} of {}", layout.key()),
                    Err(error) => {
                        let message = error.to_string();
                        assert!(
                            is_needed && message.contains(layout.key()),
                            "{what} in the place of {part}: {message}"
                        );
                    }
                }
                let is_folder = path.symlink_metadata().expect("there").is_dir();
                if is_folder { fs::remove_dir(&path) } else { fs::remove_file(&path) }.expect("removed");
            }
            fs::rename(&aside, &path).expect("restored");
        }
        open(&folder, &ReadOptions::default()).expect("whole again");
    }
}
