//! Folders that are created, replaced, restored and locked.

use super::*;

/// Records by which a folder is known as a run.
const OLD: &str = r#"{ "burn": "1", "preset": "old" }"#;
const NEW: &str = r#"{ "burn": "1", "preset": "new" }"#;

fn names(folder: &Path) -> Vec<OsString> {
    fs::read_dir(folder).expect("listed").map(|entry| entry.expect("entry").file_name()).collect()
}

#[test]
fn a_failed_run_leaves_nothing_not_even_the_parents_it_made() {
    let ground = tempfile::tempdir().expect("folder");
    let plan = || RunPlan::new(&ground.path().join("runs/deep/a"), Existing::Keep).expect("planned");
    drop(plan());
    assert!(names(ground.path()).is_empty());
    let plan = plan();
    let folder = plan.create().expect("made");
    fs::write(folder.place(&["checkpoints", "x"]).expect("placed"), "x").expect("written");
    drop(folder);
    assert!(names(ground.path()).is_empty());
}

#[test]
fn a_failed_replacement_brings_the_old_run_back() {
    let ground = tempfile::tempdir().expect("folder");
    let path = ground.path().join("a");
    fs::create_dir(&path).expect("made");
    fs::write(path.join(RECORD), OLD).expect("written");
    let create = || RunPlan::new(&path, Existing::Replace).expect("planned").create().expect("made");
    let write = |folder: &RunFolder| fs::write(folder.place(&[RECORD]).expect("placed"), NEW);
    let folder = create();
    write(&folder).expect("written");
    drop(folder);
    assert_eq!(names(&path), [RECORD]);
    assert_eq!(fs::read(path.join(RECORD)).expect("read"), OLD.as_bytes());

    let mut folder = create();
    write(&folder).expect("written");
    folder.keep();
    drop(folder);
    assert_eq!(fs::read(path.join(aside::REPLACED).join(RECORD)).expect("read"), OLD.as_bytes());
    assert_eq!(fs::read(path.join(RECORD)).expect("read"), NEW.as_bytes());

    let mut folder = create();
    write(&folder).expect("written");
    folder.finish();
    drop(folder);
    assert_eq!(names(&path), [RECORD]);
    assert_eq!(fs::read(path.join(RECORD)).expect("read"), NEW.as_bytes());
}

#[test]
fn a_replacement_that_was_cut_short_does_not_cost_the_old_run() {
    let ground = tempfile::tempdir().expect("folder");
    let path = ground.path().join("a");
    fs::create_dir_all(path.join(aside::REPLACED)).expect("made");
    fs::write(path.join(aside::REPLACED).join("results.json"), "old").expect("written");
    fs::write(path.join("metrics.jsonl"), "half a run").expect("written");
    drop(RunPlan::new(&path, Existing::Replace).expect("planned").create().expect("made"));
    assert_eq!(names(&path), ["results.json"]);
}

#[test]
fn what_a_killed_process_was_writing_is_in_nobodys_way() {
    let ground = tempfile::tempdir().expect("folder");
    let path = ground.path().join("a");
    fs::create_dir(&path).expect("made");
    for existing in [Existing::Keep, Existing::Replace] {
        fs::write(path.join(".mvfusion-x7Gh1s.part"), "half a file").expect("written");
        RunPlan::new(&path, existing).expect("planned").create().expect("made").finish();
        assert!(names(&path).is_empty());
    }
}

/// The folder of a run with this text as its only checkpoint.
fn interrupted(path: &Path, text: &str) {
    fs::create_dir_all(path.join("checkpoints")).expect("made");
    fs::write(path.join(RECORD), NEW).expect("written");
    fs::write(path.join("checkpoints/step_7.safetensors"), text).expect("written");
}

fn checkpoint(path: &Path) -> String {
    fs::read_to_string(path.join("checkpoints/step_7.safetensors")).expect("there")
}

#[test]
fn runs_that_replace_each_other_unfinished_come_back_one_by_one() {
    let ground = tempfile::tempdir().expect("folder");
    let path = ground.path().join("a");
    for text in ["first", "second", "third"] {
        let mut folder = RunPlan::new(&path, Existing::Replace).expect("planned").create().expect("made");
        interrupted(&path, text);
        folder.keep();
    }
    for text in ["third", "second", "first"] {
        assert_eq!(checkpoint(&path), text);
        RunFolder::continued(&path).expect("locked").restore().expect("back");
    }
    assert_eq!((checkpoint(&path).as_str(), names(&path).len()), ("first", 2));
}

#[test]
fn files_that_were_on_their_way_when_a_process_was_killed_go_back() {
    let ground = tempfile::tempdir().expect("folder");
    let path = ground.path().join("a");
    // What is moved aside, and what is brought back: killed after each rename.
    interrupted(&path.join(".moving"), "old");
    fs::write(path.join("metrics.jsonl"), "old").expect("written");
    assert!(waiting_note(&path).is_some());
    RunFolder::continued(&path).expect("locked");
    assert_eq!((checkpoint(&path).as_str(), names(&path).len()), ("old", 3));
    // The rest of what was removed.
    interrupted(&path.join(".discarded"), "rubbish");
    RunFolder::continued(&path).expect("locked");
    assert_eq!((checkpoint(&path).as_str(), names(&path).len()), ("old", 3));
}

#[test]
fn a_folder_has_one_writer() {
    let ground = tempfile::tempdir().expect("folder");
    let path = ground.path().join("a");
    let plan = RunPlan::new(&path, Existing::Keep).expect("planned");
    for existing in [Existing::Keep, Existing::Replace] {
        let error = RunPlan::new(&path, existing).expect_err("refused").to_string();
        assert!(error.contains(&format!("process {}", std::process::id())), "{error}");
    }
    let mut folder = plan.create().expect("made");
    RunFolder::continued(&path).expect_err("refused");
    interrupted(&path, "only");
    folder.keep();
    drop(folder);
    RunFolder::continued(&path).expect("free");
    let error = RunPlan::new(&path, Existing::Keep).expect_err("refused").to_string();
    assert!(error.contains("--resume"), "{error}");
}

#[test]
fn half_written_files_are_removed_at_every_depth_but_not_where_others_write() {
    let ground = tempfile::tempdir().expect("folder");
    let path = ground.path();
    for folder in ["checkpoints", "strips", "renders/test", "films/train"] {
        fs::create_dir_all(path.join(folder)).expect("made");
        fs::write(path.join(folder).join(".mvfusion-x7Gh1s.part"), "half").expect("written");
    }
    RunFolder::continued(path).expect("locked");
    let left = |folder: &str| names(&path.join(folder)).len();
    assert_eq!(["checkpoints", "strips", "renders/test", "films/train"].map(left), [0, 0, 0, 1]);
}

#[test]
fn an_empty_folder_stays_after_a_failure() {
    let ground = tempfile::tempdir().expect("folder");
    let folder = RunPlan::new(ground.path(), Existing::Keep).expect("planned").create().expect("made");
    fs::write(folder.place(&["config.toml"]).expect("placed"), "x").expect("written");
    drop(folder);
    assert!(ground.path().exists() && names(ground.path()).is_empty());
}

#[test]
fn what_is_no_run_is_never_replaced() {
    let ground = tempfile::tempdir().expect("folder");
    fs::write(ground.path().join("thesis.tex"), "x").expect("written");
    for existing in [Existing::Keep, Existing::Replace] {
        RunPlan::new(ground.path(), existing).expect_err("refused");
    }
    let error = RunPlan::new(&ground.path().join("thesis.tex/a"), Existing::Keep).expect_err("refused");
    assert!(error.to_string().contains("thesis.tex is a file"), "{error}");
}

#[test]
fn what_another_program_wrote_under_such_names_is_never_replaced() {
    let ground = tempfile::tempdir().expect("folder");
    let path = ground.path();
    fs::create_dir(path.join("checkpoints")).expect("made");
    fs::write(path.join("config.toml"), "x").expect("written");
    for record in ["", r#"{ "id": 7 }"#] {
        fs::write(path.join(RECORD), record).expect("written");
        for existing in [Existing::Keep, Existing::Replace] {
            let error = RunPlan::new(path, existing).expect_err("refused").to_string();
            assert!(error.contains("was not made by this program") && !error.contains("--force"), "{error}");
        }
    }
    fs::write(path.join(RECORD), OLD).expect("written");
    RunPlan::new(path, Existing::Replace).expect("ours");
}

#[test]
fn a_training_that_was_killed_before_its_record_is_in_nobodys_way() {
    let ground = tempfile::tempdir().expect("folder");
    fs::write(ground.path().join("metrics.jsonl"), "").expect("written");
    RunPlan::new(ground.path(), Existing::Replace).expect("planned").create().expect("made").finish();
    assert!(names(ground.path()).is_empty());
}
