//! Folders that cannot be read.

use std::fs;
use std::path::Path;

use super::*;

fn refusal(folder: &Path) -> Problem {
    let (inspection, scene) = inspect(folder, &ReadOptions::default(), Pictures::Decoded);
    assert!(scene.is_none() && inspection.summary.is_none() && !inspection.can_train());
    assert_eq!(inspection.problems.len(), 1, "{:?}", inspection.problems);
    inspection.problems.into_iter().next().expect("one")
}

#[test]
fn every_format_says_what_it_misses() {
    let folder = tempfile::tempdir().expect("folder");
    let problem = refusal(folder.path());
    assert_eq!(problem.what.lines().count(), 1 + Format::ALL.len(), "{problem:?}");
    assert!(problem.what.contains("\nD-NeRF: it needs transforms_train.json"), "{problem:?}");
}

#[test]
fn the_folder_that_was_meant_is_proposed() {
    let folder = tempfile::tempdir().expect("folder");
    fs::create_dir_all(folder.path().join("lego/train")).expect("folders");
    fs::write(folder.path().join("lego/transforms_train.json"), "{}").expect("written");
    for path in [folder.path().to_owned(), folder.path().join("lego/train")] {
        let problem = refusal(&path);
        assert!(problem.remedy.contains("lego (D-NeRF)"), "{problem:?}");
    }
}

#[test]
fn a_scene_that_was_not_written_to_its_end_is_not_proposed() {
    let folder = tempfile::tempdir().expect("folder");
    fs::create_dir_all(folder.path().join(".unfinished-x/cam00")).expect("folders");
    assert!(!refusal(folder.path()).remedy.contains("unfinished"));
}

#[test]
fn pictures_without_cameras_need_structure_from_motion() {
    let folder = tempfile::tempdir().expect("folder");
    fs::create_dir_all(folder.path().join("images")).expect("folder");
    RgbImage::new(20, 20).save(folder.path().join("images/1.png")).expect("written");
    assert!(refusal(folder.path()).remedy.contains("COLMAP"));
}

#[test]
fn an_error_of_the_reader_is_parted_into_what_and_remedy() {
    let folder = tempfile::tempdir().expect("folder");
    fs::write(folder.path().join("transforms_train.json"), "{").expect("written");
    let (inspection, _) = inspect(folder.path(), &ReadOptions::default(), Pictures::Headers);
    assert_eq!(inspection.format, Some(Format::DNERF));
    let problem = refusal(folder.path());
    assert!(problem.what.contains("transforms_train.json"), "{problem:?}");
    assert!(!problem.remedy.is_empty() && problem.remedy.ends_with('.'), "{problem:?}");
    assert!(!problem.what.contains(&problem.remedy), "{problem:?}");
}

#[test]
fn a_folder_that_is_not_there_is_named() {
    assert!(refusal(Path::new("no/such/folder")).what.contains("no/such/folder"));
}
