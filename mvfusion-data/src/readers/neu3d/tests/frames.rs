//! Frames that are missing, damaged, or named in other ways.

use super::*;

#[test]
fn bad_frames_are_refused() {
    let fixture = Fixture::new();
    fs::remove_file(fixture.at("cam02/images/0003.png")).expect("removed");
    let parts = ["cam02 has no frame 0003, but cam00 has it", "from every camera", "`--set scene.frames=3`"];
    assert_says(&fixture.complaint(), &parts);
    assert!(fixture.read_with(ReadOptions { frames: Some(3), ..Default::default() }).is_ok());
    fs::write(fixture.at("cam02/images/0003.png"), b"torn").expect("written");
    assert_says(&fixture.complaint(), &["cam02/images/0003.png"]);
    fixture.write_frame("cam02/images/0003.png", (40, 32), [1, 2, 3]);
    assert_says(&fixture.complaint(), &["48 x 32", "40 x 32", "cam02/images/0003.png"]);
    fixture.write_frame("cam02/images/0003.png", SIZE, [1, 2, 3]);
    fixture.write_frame("cam02/images/0003.jpg", SIZE, [1, 2, 3]);
    assert_says(&fixture.complaint(), &["same frame", "0003.jpg", "0003.png"]);
    fs::remove_file(fixture.at("cam02/images/0003.jpg")).expect("removed");
    assert!(fixture.read().is_ok());
}

#[test]
fn frames_with_the_same_number_belong_together() {
    let fixture = Fixture::new();
    let remove = |name: &str| fs::remove_file(fixture.at(name)).expect("removed");
    // Without the check, all later frames of this camera would have the time of the frame before.
    remove("cam02/images/0001.png");
    let said = fixture.complaint();
    assert_says(&said, &["cam02 has no frame 0001, but cam00 has it. Add it, or remove frame 0001 from every camera"]);
    assert!(!said.contains("scene.frames"), "{said}");
    // As many frames in every camera do not make it right.
    remove("cam00/images/0002.png");
    remove("cam05/images/0003.png");
    assert_says(&fixture.complaint(), &["cam02 has no frame 0001, but cam00 has it"]);
    // A gap that all cameras have is fine, and so is a first number other than 0.
    for name in ["cam00/images/0001", "cam05/images/0001", "cam02/images/0002", "cam05/images/0002"] {
        remove(&format!("{name}.png"));
    }
    remove("cam00/images/0003.png");
    remove("cam02/images/0003.png");
    for camera in CAMERAS {
        fs::rename(fixture.at(&format!("{camera}/images/0000.png")), fixture.at(&format!("{camera}/images/7.png")))
            .expect("renamed");
        fixture.write_frame(&format!("{camera}/images/0009.png"), SIZE, [1, 2, 3]);
    }
    let scene = fixture.read().expect("read");
    assert_eq!((scene.test[0].name.as_str(), scene.test[1].name.as_str()), ("cam00/7", "cam00/0009"));
    assert_eq!((scene.test.len(), scene.test[1].time), (2, 0.5));
}

#[test]
fn one_photo_of_each_camera_may_have_any_number() {
    let fixture = Fixture::new();
    for (camera, number) in CAMERAS.into_iter().zip([4711, 815, 7]) {
        fs::remove_dir_all(fixture.at(&format!("{camera}/images"))).expect("removed");
        fs::create_dir(fixture.at(&format!("{camera}/images"))).expect("made");
        fixture.write_frame(&format!("{camera}/images/IMG_{number}.png"), SIZE, [9; 3]);
    }
    assert_eq!(fixture.read().expect("read").train.len(), 2);
}

#[test]
fn frames_beyond_the_last_that_is_used_may_be_missing() {
    let fixture = Fixture::new();
    fs::remove_file(fixture.at("cam02/images/0002.png")).expect("removed");
    let read = |frames| fixture.read_with(ReadOptions { frames: Some(frames), ..Default::default() });
    assert_eq!(read(2).expect("read").test.len(), 2);
    assert_says(&read(3).expect_err("refused").to_string(), &["cam02 has no frame 0002"]);
}

#[test]
fn frames_without_numbers_are_matched_by_their_order() {
    let fixture = Fixture::new();
    for (camera, names) in CAMERAS.into_iter().zip([["a", "b"], ["c", "d"], ["e", "f"]]) {
        fs::remove_dir_all(fixture.at(&format!("{camera}/images"))).expect("removed");
        fs::create_dir(fixture.at(&format!("{camera}/images"))).expect("made");
        names.iter().for_each(|name| fixture.write_frame(&format!("{camera}/images/{name}.png"), SIZE, [9; 3]));
    }
    assert_eq!(fixture.read().expect("read").train[1].name, "cam02/d");
    fs::remove_file(fixture.at("cam05/images/f.png")).expect("removed");
    let parts = ["cam00 has 2 frames", "but cam05 has 1 frame. ", "matched by their order", "`--set scene.frames=1`"];
    assert_says(&fixture.complaint(), &parts);
}

#[test]
fn an_image_that_is_no_frame_does_not_take_the_place_of_one() {
    let fixture = Fixture::new();
    fs::rename(fixture.at("cam02/images/0001.png"), fixture.at("cam02/images/cover.png")).expect("renamed");
    assert_says(&fixture.complaint(), &["the frames of cam00 are named by their numbers", "cam02 has a frame cover"]);
}

#[test]
fn a_camera_without_frames_is_named_and_so_is_a_video_that_is_none() {
    let fixture = Fixture::new();
    fs::remove_dir_all(fixture.at("cam05/images")).expect("removed");
    assert_says(&fixture.complaint(), &["no frame of the camera cam05", "png or jpg"]);
    fs::remove_dir_all(fixture.at("cam05")).expect("removed");
    for video in ["cam05.mp4", "cam05.MP4"] {
        fs::write(fixture.at(video), b"video").expect("written");
        assert_says(&fixture.complaint(), &[video]);
        fs::remove_file(fixture.at(video)).expect("removed");
    }
}
