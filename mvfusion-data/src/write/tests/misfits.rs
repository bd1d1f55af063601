//! Scenes that a layout cannot represent, and folders that are not writable.

use super::*;

/// A change that makes a scene unsuitable.
type Damage = fn(&mut Scene);

fn refused(scene: &Scene, layout: Layout) -> String {
    let folder = tempfile::tempdir().expect("folder");
    let place = folder.path().join("new");
    let error = write(scene, layout, &place).expect_err("refused");
    assert!(matches!(error, WriteError::Layout { .. }), "{error}");
    assert!(!place.exists(), "nothing is written before it is known to fit");
    let message = error.to_string();
    assert!(message.contains(&format!("as {}", layout.key())), "{message}");
    message
}

#[test]
fn a_scene_of_the_other_kind_is_refused_with_the_layouts_that_fit() {
    for layout in Layout::ALL {
        let (other, fitting) = match layout.capture() {
            Capture::Video => (Capture::Photos, "colmap, onthego, onthego-colmap, robustnerf"),
            Capture::Photos => (Capture::Video, "neu3d, panoptic, nerfstudio, multipleview, dnerf, hypernerf"),
        };
        let message = refused(&scene(other), layout);
        assert!(message.contains(fitting), "{message}");
    }
}

#[test]
fn cameras_that_the_layout_has_no_words_for_are_named() {
    let mut odd = scene(Capture::Video);
    off_centre(&mut odd);
    for layout in [Layout::Neu3d, Layout::DNerf] {
        assert!(refused(&odd, layout).contains("not square"));
    }
    let mut walking = scene(Capture::Video);
    moving(&mut walking);
    for layout in [Layout::Neu3d, Layout::MultipleView] {
        assert!(refused(&walking, layout).contains("moves (cam00/0001)"));
    }
    let mut zoomed = scene(Capture::Video);
    let camera = zoomed.train[5].camera;
    zoomed.train[5].camera = Camera { fx: 2.0 * camera.fx, fy: 2.0 * camera.fy, ..camera };
    assert!(refused(&zoomed, Layout::DNerf).contains("different focal lengths"));
}

#[test]
fn cameras_that_are_no_rig_are_refused_where_one_is_needed() {
    let damages: [(&str, Damage); 5] = [
        ("cam02 has 2", |scene| drop(scene.train.remove(4))),
        ("not synchronised", |scene| scene.train[4].time += 0.01),
        ("one moment", |scene| scene.test[1].time = scene.test[0].time),
        ("camera/frame", |scene| scene.train[0].name = "picture".into()),
        ("some frames of cam01", |scene| {
            let moved = scene.train.remove(0);
            scene.test.push(moved);
        }),
    ];
    for (part, damage) in damages {
        let mut scene = scene(Capture::Video);
        damage(&mut scene);
        for layout in [Layout::Neu3d, Layout::Panoptic, Layout::MultipleView] {
            let message = refused(&scene, layout);
            assert!(message.contains(part), "{message}");
        }
    }
}

#[test]
fn splits_that_the_layout_has_no_words_for_are_refused() {
    let mut two = scene(Capture::Video);
    two.test.extend(two.train.split_off(two.train.len() - FRAMES));
    assert!(refused(&two, Layout::Neu3d).contains("2 of its 8 cameras are held out"));
    written(&two, Layout::Panoptic);
    let mut none = scene(Capture::Video);
    none.test.clear();
    for layout in [Layout::Neu3d, Layout::Panoptic, Layout::DNerf, Layout::HyperNerf] {
        assert!(refused(&none, layout).contains("holds nothing out"));
    }
    for layout in [Layout::Nerfstudio, Layout::MultipleView] {
        written(&none, layout);
    }
    std::mem::swap(&mut none.train, &mut none.test);
    assert!(refused(&none, Layout::Nerfstudio).contains("no view to train on"));
}

#[test]
fn pictures_of_two_sizes_and_names_that_lead_elsewhere_are_refused() {
    let mut uneven = scene(Capture::Photos);
    uneven.test[0].camera = uneven.test[0].camera.resized(96, 64);
    assert!(refused(&uneven, Layout::Colmap).contains("extra000 is 96x64"));
    for name in ["../escape", "/root", "", "cam01/0000", "cam01//0000"] {
        let mut scene = scene(Capture::Video);
        scene.train[1].name = name.into();
        assert!(refused(&scene, Layout::Nerfstudio).contains(&format!("`{name}`")));
    }
}

#[test]
fn a_held_out_camera_in_the_middle_becomes_the_first() {
    let mut scene = scene(Capture::Video);
    // cam03 is held out, cam00 trains.
    let middle = scene.train.drain(2 * FRAMES..3 * FRAMES).collect();
    let first = std::mem::replace(&mut scene.test, middle);
    scene.train.splice(0..0, first);
    let folder = written(&scene, Layout::Neu3d);
    let read = open(folder.path(), &ReadOptions::default()).expect("read");
    assert_eq!((read.test[0].name.as_str(), read.train[0].name.as_str()), ("cam00/0000", "cam01/0000"));
    for (before, after) in scene.test.iter().chain(&scene.train).zip(read.test.iter().chain(&read.train)) {
        assert_same_camera(&before.camera, &after.camera, Layout::Neu3d);
    }
}

#[test]
fn numbers_of_cameras_may_have_gaps() {
    let mut scene = scene(Capture::Video);
    scene.train.drain(FRAMES..3 * FRAMES); // cam02 and cam03
    let folder = written(&scene, Layout::Neu3d);
    let read = open(folder.path(), &ReadOptions::default()).expect("read");
    assert_eq!(read.train[FRAMES].name, "cam04/0000");
}

#[test]
fn a_scene_that_cannot_be_written_to_its_end_leaves_nothing() {
    for layout in Layout::ALL {
        let mut scene = scene(layout.capture());
        scene.test[0].image = Picture::file("no/such/picture.png".into(), (48, 32));
        let folder = tempfile::tempdir().expect("folder");
        let error = write(&scene, layout, &folder.path().join("deep/new")).expect_err("a picture is not there");
        assert!(matches!(error, WriteError::Picture(_)), "{error}");
        assert_eq!(std::fs::read_dir(folder.path()).expect("listed").count(), 0, "{layout:?}");
    }
}

#[test]
fn what_a_killed_program_left_goes_and_a_hidden_leftover_is_named() {
    let scene = scene(Capture::Photos);
    let folder = tempfile::tempdir().expect("folder");
    let left = folder.path().join(".unfinished-left");
    std::fs::create_dir(&left).expect("made");
    let said = write(&scene, Layout::Colmap, folder.path()).expect_err("not known to be left").to_string();
    assert!(said.contains("`.unfinished-left` is in it"), "{said}");
    // A program that still ran would have locked it.
    std::fs::write(left.join("in-use"), "").expect("written");
    write(&scene, Layout::Colmap, folder.path()).expect("written");
    assert!(!left.exists() && !folder.path().join("in-use").exists());
}

#[test]
fn nothing_is_overwritten() {
    let scene = scene(Capture::Photos);
    let folder = written(&scene, Layout::Colmap);
    let error = write(&scene, Layout::Colmap, folder.path()).expect_err("refused");
    assert!(matches!(error, WriteError::Occupied { .. }) && error.to_string().contains("nothing is overwritten"));
    let file = folder.path().join("images/2clutter000.png");
    let error = write(&scene, Layout::Colmap, &file).expect_err("refused");
    assert!(matches!(error, WriteError::Unwritable { .. }), "{error}");
}
