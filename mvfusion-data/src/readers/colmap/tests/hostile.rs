//! Damaged files, and files that were never models. None may crash the program or make it allocate more memory than the
//! size of the file justifies.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::readers::colmap::model::{binary, text};

/// Number of damaged files of each kind. Some thousand reach every branch of the parsers.
const ROUNDS: usize = 4000;

/// Parses bytes as each of the six files. Returns the number of parsers that accept them.
fn parse(bytes: &[u8]) -> usize {
    let text = String::from_utf8_lossy(bytes);
    [
        binary::cameras(bytes).is_ok(),
        binary::images(bytes).is_ok(),
        binary::points(bytes).is_ok(),
        text::cameras(&text).is_ok(),
        text::images(&text).is_ok(),
        text::points(&text).is_ok(),
    ]
    .into_iter()
    .filter(|&taken| taken)
    .count()
}

fn whole_files() -> [Vec<u8>; 6] {
    let sample = Sample::new(&NAMES);
    [
        sample.cameras_binary(),
        sample.images_binary(),
        sample.points_binary(),
        sample.cameras_text().into_bytes(),
        sample.images_text().into_bytes(),
        sample.points_text().into_bytes(),
    ]
}

#[test]
fn files_that_end_early_or_late_are_refused_at_every_length() {
    let [cameras, images, points, ..] = whole_files();
    (0..cameras.len()).for_each(|end| assert!(binary::cameras(&cameras[..end]).is_err()));
    (0..images.len()).for_each(|end| assert!(binary::images(&images[..end]).is_err()));
    (0..points.len()).for_each(|end| assert!(binary::points(&points[..end]).is_err()));
    assert!(binary::cameras(&[&cameras[..], &[0]].concat()).expect_err("late").reason.contains("1 bytes follow"));
    for file in whole_files() {
        for end in 0..file.len() {
            parse(&file[..end]);
        }
    }
}

#[test]
fn a_count_is_not_believed_before_its_bytes_are_there() {
    let counts = [u64::MAX, u64::MAX / 24 + 1, 1 << 40, 3];
    for count in counts.map(u64::to_le_bytes) {
        let bytes = [&count[..], &[0; 100]].concat();
        assert!(binary::cameras(&bytes).expect_err("refused").reason.contains("cameras at byte 0"));
        assert!(binary::images(&bytes).expect_err("refused").reason.contains("images at byte 0"));
        assert!(binary::points(&bytes).expect_err("refused").reason.contains("points at byte 0"));
    }
    let sample = Sample::new(&NAMES[..1]);
    let (mut images, mut points) = (sample.images_binary(), sample.points_binary());
    let inner = images.len() - 8; // The image has no observations: the file ends with their number.
    for count in counts[..3].iter().map(|count| count.to_le_bytes()) {
        images[inner..].copy_from_slice(&count);
        assert!(binary::images(&images).expect_err("refused").reason.contains("observations at byte"));
        points[51..59].copy_from_slice(&count);
        assert!(binary::points(&points).expect_err("refused").reason.contains("observations at byte 51"));
    }
}

#[test]
fn damaged_and_random_files_never_panic() {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let mut taken = 0;
    for round in 0..ROUNDS {
        let mut file = whole_files()[round % 6].clone();
        for _ in 0..random.random_range(1..4) {
            let place = random.random_range(0..file.len());
            match random.random_range(0..4) {
                0 => file[place] = random.random(),
                1 => drop(file.remove(place)),
                2 => file.insert(place, random.random()),
                _ => file[place] ^= 1 << random.random_range(0..8),
            }
        }
        taken += parse(&file);
        let noise: Vec<u8> = (0..random.random_range(0..300)).map(|_| random.random()).collect();
        parse(&noise);
        // Small numbers in the counts, so that noise is read as records.
        parse(&[&[random.random_range(0..3), 0, 0, 0, 0, 0, 0, 0][..], &noise].concat());
    }
    assert!(taken > 0 && taken < 6 * ROUNDS, "some damage does no harm, other does: {taken}");
}

#[test]
fn a_damaged_model_is_an_error_or_a_scene_of_finite_numbers() {
    let fixture = Fixture::new(&NAMES);
    let [cameras, images, points, ..] = whole_files();
    let mut random = ChaCha8Rng::seed_from_u64(2);
    for _ in 0..200 {
        for (name, whole) in [("cameras.bin", &cameras), ("images.bin", &images), ("points3D.bin", &points)] {
            let mut file = whole.clone();
            let place = random.random_range(0..file.len());
            file[place] = random.random();
            fixture.write(&format!("sparse/0/{name}"), &file);
            let Ok(scene) = fixture.read() else { continue };
            for view in scene.train.iter().chain(&scene.test) {
                let camera = &view.camera;
                assert!(camera.rotation.is_finite() && camera.translation.is_finite() && camera.fx * camera.fy > 0.0);
                assert!((0.0..=1.0).contains(&view.time));
            }
            assert!(scene.points.positions.iter().all(|p| p.is_finite()));
        }
        fixture.write_binary(&Sample::new(&NAMES));
    }
}

#[test]
fn malformed_lines_are_named() {
    let fixture = Fixture::new(&NAMES);
    fixture.remove_model();
    let sample = Sample::new(&NAMES);
    let images = sample.images_text();
    for (name, content, parts) in [
        ("cameras.txt", "3 PINHOLE 48\n".to_owned(), &["line 1", "height", "missing"][..]),
        ("cameras.txt", "3 PINHOLE 48 32 40 40 23\n".into(), &["camera 3 (PINHOLE)", "3 parameters, not 4"]),
        ("cameras.txt", "# none\n3 PINHOLE 48 32 40 4o 23 17\n".into(), &["line 2", "`4o`", "camera parameter"]),
        ("images.txt", images.replace("1 1 0 0 0 ", "1 1 0 zero 0 "), &["line 2", "`zero`", "quaternion"]),
        ("images.txt", images.replace("\n\n", "\n"), &["line 3", "no list of observations"]),
        ("points3D.txt", "0 1 2 3 255 0 256\n".into(), &["line 1", "`256`", "colour"]),
        ("points3D.txt", "0 1 2\n".into(), &["line 1", "position", "missing"]),
    ] {
        fixture.write_text(&sample);
        fixture.write(&format!("sparse/0/{name}"), content);
        assert_says(&fixture.complaint(), &[&[name][..], parts].concat());
    }
    fixture.write_text(&sample);
    fixture.write("sparse/0/points3D.txt", b"\xff\xfe");
    assert_says(&fixture.complaint(), &["points3D.txt", "UTF-8"]);
}
