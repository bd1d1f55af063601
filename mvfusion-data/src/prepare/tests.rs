//! Whole preparations, with a script in the place of COLMAP: `mvfusion-tests` has those with COLMAP itself.
#![cfg(unix)]

use std::fs;
use std::ops::ControlFlow;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use tempfile::TempDir;

use super::*;
use crate::builtin::builtin;
use crate::{BuiltinKind, BuiltinOptions, Format, Layout, ReadOptions};

/// Photos, and a program that says of them what the model that they were written with says.
struct Footage {
    folder: TempDir,
}

/// Answers as COLMAP 3.13 does: other names of options, and messages on stderr. `MODEL` and `HERE` are replaced.
const SCRIPT: &str = r#"#!/bin/sh
step="$1"
[ "$2" = -h ] || echo "$@" >> HERE/calls
case "$step" in
-h) echo "COLMAP 3.13.0 -- Structure-from-Motion and Multi-View Stereo"; echo "(Commit 1 on 2 with CUDA)" ;;
feature_extractor)
    if [ "$2" = -h ]; then
        echo "--default_random_seed arg (=0) --database_path arg --image_path arg --ImageReader.mask_path arg"
        echo "--ImageReader.camera_model arg --ImageReader.single_camera arg"
        echo "--FeatureExtraction.num_threads arg --FeatureExtraction.use_gpu arg"
    else
        echo "I20261126 feature_extraction.cc:1] Processed file [1/9]" >&2
    fi ;;
exhaustive_matcher)
    [ "$2" = -h ] && echo "--database_path arg --FeatureMatching.num_threads arg --FeatureMatching.use_gpu arg" ;;
mapper)
    if [ "$2" = -h ]; then
        echo "--database_path arg --image_path arg --output_path arg --Mapper.num_threads arg --Mapper.random_seed arg"
    else
        while [ "$1" != --output_path ]; do shift; done
        MAPPER
    fi ;;
esac
exit 0
"#;

impl Footage {
    fn new(mapper: &str) -> Self {
        let footage = Self { folder: tempfile::tempdir().expect("folder") };
        let kind = BuiltinOptions::of_kind(BuiltinKind::Casual);
        let scene = builtin(&BuiltinOptions { width: 48, height: 36, photos: 9, ..kind });
        crate::write(&scene, Layout::of_key("colmap").expect("known"), &footage.path("known")).expect("written");
        let script = SCRIPT
            .replace("MAPPER", mapper)
            .replace("HERE", &footage.folder.path().display().to_string())
            .replace("MODEL", &footage.path("known/sparse/0").display().to_string());
        let program = footage.path("colmap");
        fs::write(&program, script).expect("written");
        fs::set_permissions(&program, fs::Permissions::from_mode(0o755)).expect("made a program");
        footage
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn prepare(&self, options: PrepareOptions, notes: &mut Vec<String>) -> Result<Prepared, PrepareError> {
        let colmap = ColmapOptions { program: Some(self.path("colmap")), seed: 7, gpu: Gpu::Off, ..options.colmap };
        let options = PrepareOptions { colmap, ..options };
        prepare(&self.path("known/images"), &self.path("scene"), &options, &mut |event| {
            if let Event::Note(note) = event {
                notes.push(note);
            }
            ControlFlow::Continue(())
        })
    }

    fn calls(&self) -> String {
        fs::read_to_string(self.path("calls")).expect("called")
    }
}

fn listed(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        fs::read_dir(folder).expect("listed").flatten().map(|e| e.file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

#[test]
fn photos_become_a_scene_and_options_have_the_names_that_the_version_knows() {
    let footage = Footage::new(r#"cp -r MODEL "$2/0""#);
    let mut notes = Vec::new();
    let prepared = footage.prepare(PrepareOptions::default(), &mut notes).expect("prepared");
    let images = listed(&footage.path("known/images"));
    assert_eq!(prepared.placed.placed, images);
    assert!(prepared.placed.unplaced.is_empty() && prepared.placed.models.is_empty());
    assert!(notes.iter().any(|note| note.starts_with(&format!("COLMAP placed {0} of {0} photos", images.len()))));
    assert_eq!(listed(&footage.path("scene")), ["colmap.log", "images", "prepare.json", "sparse"]);
    let scene = crate::open(&footage.path("scene"), &ReadOptions::default()).expect("read");
    let options = ReadOptions { format: Some(Format::COLMAP), ..Default::default() };
    let known = crate::open(&footage.path("known"), &options).expect("read");
    assert_eq!((scene.train.len(), scene.test.len()), (known.train.len(), known.test.len()));
    assert_eq!(listed(footage.folder.path()), ["calls", "colmap", "known", "scene"]);
    let calls = footage.calls();
    for part in [
        "--FeatureExtraction.use_gpu 0",
        "--FeatureMatching.use_gpu 0",
        "--Mapper.random_seed 7",
        "--default_random_seed 7",
        "--ImageReader.camera_model OPENCV",
        "--ImageReader.single_camera 1",
    ] {
        assert!(calls.contains(part), "{part}: {calls}");
    }
    assert!(!calls.contains("Sift") && !calls.contains(" --random_seed"), "{calls}");
}

#[test]
fn of_several_models_the_largest_is_used_and_the_others_are_named() {
    // The second model is whole, the first one has no images.
    let two =
        r#"mkdir -p "$2/0"; cp MODEL/* "$2/0"; printf '\0\0\0\0\0\0\0\0' > "$2/0/images.bin"; cp -r MODEL "$2/1""#;
    let footage = Footage::new(two);
    let mut notes = Vec::new();
    let prepared = footage.prepare(PrepareOptions::default(), &mut notes).expect("prepared");
    assert_eq!((prepared.placed.model, prepared.placed.models.len()), (1, 2));
    assert!(notes.iter().any(|note| note.contains("2 models") && note.contains("model 0 (0 images")), "{notes:?}");
    let colmap = ColmapOptions { model: Some(5), ..Default::default() };
    let again = PrepareOptions { colmap, replace: true, ..Default::default() };
    let said = footage.prepare(again, &mut notes).expect_err("no such model").to_string();
    assert!(said.contains("there is no model 5"), "{said}");
    assert!(footage.path("scene/sparse/0/images.bin").is_file(), "what was there still is");
}

#[test]
fn without_a_model_the_error_counts_the_photos_and_only_the_log_is_left() {
    let footage = Footage::new("echo 'ERROR: failed to create sparse model' >&2; exit 1");
    let photos = listed(&footage.path("known/images"));
    let error = footage.prepare(PrepareOptions::default(), &mut Vec::new()).expect_err("not placed");
    let said = error.to_string();
    let count = photos.len();
    assert!(said.contains(&format!("placed 0 of {count} photos; {count} failed: {}", photos[0])), "{said}");
    assert!(said.contains("--masks") && said.contains("scene-colmap.log") && !error.is_usage(), "{said}");
    assert_eq!(listed(footage.folder.path()), ["calls", "colmap", "known", "scene-colmap.log"]);
    assert!(fs::read_to_string(footage.path("scene-colmap.log")).expect("kept").contains("failed to create"));
}

#[test]
fn a_step_that_fails_is_named_with_its_last_words() {
    let footage = Footage::new("echo 'bad allocation' >&2; exit 3");
    let said = footage.prepare(PrepareOptions::default(), &mut Vec::new()).expect_err("failed").to_string();
    assert!(said.contains("mapper failed (exit code 3): bad allocation"), "{said}");
}

#[test]
fn a_mapper_that_fails_after_it_has_made_a_model_is_told() {
    let footage = Footage::new(r#"cp -r MODEL "$2/0"; echo 'bad allocation' >&2; exit 3"#);
    let mut notes = Vec::new();
    footage.prepare(PrepareOptions::default(), &mut notes).expect("prepared");
    let told = |note: &String| note.contains("mapper failed (exit code 3): bad allocation; models that it had made");
    assert!(notes.iter().any(told), "{notes:?}");
}

#[test]
fn photos_that_differ_in_their_extensions_only_are_refused_before_colmap_runs() {
    let footage = Footage::new(r#"cp -r MODEL "$2/0""#);
    let photo = listed(&footage.path("known/images")).remove(0);
    let twin = Path::new(&photo).with_extension("jpg");
    fs::copy(footage.path("known/images").join(&photo), footage.path("known/images").join(&twin)).expect("copied");
    let error = footage.prepare(PrepareOptions::default(), &mut Vec::new()).expect_err("twins");
    let said = error.to_string();
    assert!(error.is_usage() && said.contains(&photo) && said.contains(&*twin.to_string_lossy()), "{said}");
    assert!(said.contains("nothing but their extensions"), "{said}");
    // Only its version was asked for.
    assert_eq!(footage.calls(), "-h\n");
}

#[test]
fn pictures_that_are_left_out_are_told() {
    let footage = Footage::new(r#"cp -r MODEL "$2/0""#);
    fs::write(footage.path("known/images/a.HEIC"), "").expect("written");
    let mut notes = Vec::new();
    footage.prepare(PrepareOptions::default(), &mut notes).expect("prepared");
    assert!(notes[0].starts_with("1 images of other kinds (heic)"), "{notes:?}");
}

#[test]
fn masks_reach_colmap_and_a_folder_without_any_is_refused() {
    let footage = Footage::new(r#"cp -r MODEL "$2/0""#);
    let masks = footage.path("masks");
    fs::create_dir(&masks).expect("made");
    let options = || PrepareOptions { masks: Some(masks.clone()), ..Default::default() };
    let said = footage.prepare(options(), &mut Vec::new()).expect_err("no mask").to_string();
    assert!(said.contains("no mask of any image") && !footage.path("scene").exists(), "{said}");
    let photo = listed(&footage.path("known/images")).remove(0);
    let name = Path::new(&photo).with_extension("png");
    image::GrayImage::new(48, 36).save(masks.join(name)).expect("written");
    let mut notes = Vec::new();
    footage.prepare(options(), &mut notes).expect("prepared");
    assert!(notes[0].starts_with("1 of ") && footage.calls().contains("--ImageReader.mask_path"), "{notes:?}");
}

#[test]
fn without_colmap_nothing_is_written() {
    let footage = Footage::new("");
    let colmap = ColmapOptions { program: Some(footage.path("absent")), ..Default::default() };
    let options = PrepareOptions { colmap, ..Default::default() };
    let prepared =
        prepare(&footage.path("known/images"), &footage.path("scene"), &options, &mut |_| ControlFlow::Continue(()));
    let error = prepared.expect_err("no program");
    assert!(error.is_usage() && matches!(error, PrepareError::NoColmap { .. }));
    assert_eq!(listed(footage.folder.path()), ["colmap", "known"]);
}

#[test]
fn options_that_do_not_fit_the_footage_are_refused() {
    let footage = Footage::new("");
    for (options, part) in [
        (PrepareOptions { fps: Some(2.0), ..Default::default() }, "--fps"),
        (PrepareOptions { sync: super::Sync::Sound, ..Default::default() }, "--sync"),
        (PrepareOptions { offsets: [("a".into(), 1.0)].into(), ..Default::default() }, "--offset"),
        (PrepareOptions { masks: Some(footage.path("absent")), ..Default::default() }, "absent is no folder"),
    ] {
        let error = footage.prepare(options, &mut Vec::new()).expect_err("refused");
        assert!(error.is_usage() && error.to_string().contains(part), "{error}");
    }
}
