//! Layouts in which collections are distributed: lists, smaller copies, several models.

use super::*;

#[test]
fn lists_win_over_names_and_name_the_photos_as_they_like() {
    let fixture = Fixture::new(&NAMES);
    fixture.write("train_list.txt", "\u{feff}1extra000.png\r\nimages/2clutter002\n\n");
    fixture.write("test_list.txt", "./images/0clean003.PNG\n");
    let scene = fixture.read().expect("read");
    let shown = |views: &[View]| views.iter().map(|v| (v.name.clone(), v.time)).collect::<Vec<_>>();
    assert_eq!(shown(&scene.train), [("1extra000".to_owned(), 0.0), ("2clutter002".to_owned(), 0.2)]);
    assert_eq!(shown(&scene.test), [("0clean003".to_owned(), 0.3)]);
    for (list, parts) in [
        ("2clutter010.png\n2clutter011.png\n", &["test_list.txt", "line 2 (2clutter011.png)", "no photo"][..]),
        ("2clutter002.png\n", &["test_list.txt", "line 1 (2clutter002.png)", "listed before"]),
        ("..\n", &["test_list.txt", "line 1 (..)", "no photo"]),
        ("clean/0clean003.png\n", &["test_list.txt", "line 1 (clean/0clean003.png)", "no photo"]),
    ] {
        fixture.write("test_list.txt", list);
        assert_says(&fixture.complaint(), parts);
    }
    fixture.write("test_list.txt", b"\xff\xfe");
    assert_says(&fixture.complaint(), &["test_list.txt", "UTF-8"]);
    fs::remove_file(fixture.at("test_list.txt")).expect("removed");
    assert_says(&fixture.complaint(), &["no test_list.txt in", "train_list.txt is there"]);
    fixture.write("train_list.txt", "");
    fixture.write("test_list.txt", "2clutter002.png");
    assert_says(&fixture.complaint(), &["no photo to train on", "Those in train_list.txt train"]);
}

#[test]
fn listed_photos_without_numbers_are_timed_by_their_places() {
    let fixture = Fixture::new(&["day/b.png", "a.png", "night/b.png", "2clutter004.png"]);
    fixture.write("train_list.txt", "2clutter004.png\nday/b.png\n");
    fixture.write("test_list.txt", "night/b\n");
    let scene = fixture.read().expect("read");
    let times = |views: &[View]| views.iter().map(|v| (v.name.clone(), v.time)).collect::<Vec<_>>();
    assert_eq!(times(&scene.train), [("2clutter004".to_owned(), 0.0), ("day/b".to_owned(), 0.5)]);
    assert_eq!(times(&scene.test), [("night/b".to_owned(), 0.75)]);
    fixture.write("test_list.txt", "b.png\n");
    assert_says(&fixture.complaint(), &["line 1 (b.png)", "several photos"]);
}

#[test]
fn smaller_copies_of_the_photos_stand_for_those_made_smaller_here() {
    let fixture = Fixture::new(&NAMES);
    let read = |downscale: f64| {
        let view = read(fixture.0.path(), &ReadOptions { downscale, ..Default::default() }).map(|s| s.train[0].clone());
        view.map(|view| {
            (view.camera.width, view.camera.fx as f32, view.image.rgb().expect("photo").get_pixel(3, 3).0[0])
        })
    };
    assert_eq!(read(2.0).expect("read"), (24, 20.0, 30));
    fixture.write_photo("images_2/2clutter002.jpg", (24, 16), [200; 3]);
    // Three of the four are missing.
    assert_eq!(read(2.0).expect("read"), (24, 20.0, 30));
    for name in ["2clutter010.png", "1extra000.png", "1extra005.png"] {
        fixture.write_photo(&format!("images_2/{name}"), (24, 16), [200; 3]);
    }
    assert_eq!(read(2.0).expect("read"), (24, 20.0, 200));
    assert_eq!(read(1.0).expect("read"), (48, 40.0, 30));
    assert_eq!(read(1.5).expect("read"), (32, 40.0 / 1.5, 30));
    fs::remove_dir_all(fixture.at("images")).expect("removed");
    assert_eq!(recognise(fixture.0.path()), None);
    for downscale in [1.0, 1.5, 2.0] {
        assert_eq!(read(downscale).expect("read"), (24, 20.0, 200));
    }
    assert!(read(0.5).is_err() && read(f64::NAN).is_err());
    fixture.write_photo("images_4/2clutter002.png", (12, 8), [100; 3]);
    assert_eq!(read(2.0).expect("read"), (24, 20.0, 200));
    assert_says(&fixture.complaint(), &["no folder images in", "images_2, images_4", "downscale"]);
    assert_says(&read(4.0).expect_err("incomplete").to_string(), &["no image images_4/", "3 of 4"]);
}

#[test]
fn of_several_models_the_one_with_the_most_photos_is_read() {
    let fixture = Fixture::new(&NAMES);
    let expected = content(&fixture.read().expect("read"));
    fs::rename(fixture.at("sparse/0"), fixture.at("sparse/10")).expect("renamed");
    assert_eq!(content(&fixture.read().expect("read")), expected);
    let small = Sample::new(&NAMES[..2]);
    fixture.write_binary(&small);
    assert_eq!(content(&fixture.read().expect("read")), expected);
    for (name, text) in
        [("cameras", small.cameras_text()), ("images", small.images_text()), ("points3D", small.points_text())]
    {
        fixture.write(&format!("sparse/2/{name}.txt"), text);
    }
    fixture.write("sparse/1/cameras.bin", "damaged");
    fixture.write("sparse/03/cameras.bin", "no number");
    assert_eq!(content(&fixture.read().expect("read")), expected);
    fs::remove_dir_all(fixture.at("sparse/10")).expect("removed");
    assert_eq!(fixture.read().expect("the first of two with as many photos").test.len(), 1);
}
