//! A small model, and its files in both encodings.

use std::fmt::Write;

/// A camera as COLMAP writes it.
#[derive(Clone)]
pub(super) struct SampleCamera {
    pub(super) id: u32,
    pub(super) number: i32,
    pub(super) name: &'static str,
    pub(super) size: (u64, u64),
    pub(super) parameters: Vec<f64>,
}

/// An image as COLMAP writes it.
#[derive(Clone)]
pub(super) struct SampleImage {
    pub(super) name: String,
    pub(super) camera: u32,
    pub(super) quaternion: [f64; 4],
    pub(super) translation: [f64; 3],
    /// x, y, number of the point.
    pub(super) observations: Vec<(f64, f64, i64)>,
}

/// The content of the three files.
#[derive(Clone)]
pub(super) struct Sample {
    pub(super) cameras: Vec<SampleCamera>,
    pub(super) images: Vec<SampleImage>,
    pub(super) points: Vec<([f64; 3], [u8; 3])>,
}

impl Sample {
    /// One OPENCV camera without distortion and with an off-centre principal point, and images with these names. Image
    /// `i` is at x = -i and looks along +z.
    pub(super) fn new(names: &[&str]) -> Self {
        let parameters = vec![40.0, 42.0, 23.0, 17.5, 0.0, 0.0, 0.0, 0.0];
        let camera = SampleCamera { id: 3, number: 4, name: "OPENCV", size: (48, 32), parameters };
        let image = |(place, name): (usize, &&str)| SampleImage {
            name: (*name).to_owned(),
            camera: 3,
            quaternion: [1.0, 0.0, 0.0, 0.0],
            translation: [place as f64, 0.0, 0.0],
            // Some images have no observations, which is an empty line in a text file.
            observations: (0..place as i64 % 3).map(|i| (2.5 * i as f64, 7.25, i - 1)).collect(),
        };
        let points = vec![([1.0, 2.0, 3.0], [255, 0, 51]), ([-4.5, 0.125, 6.0], [0, 102, 255])];
        Self { cameras: vec![camera], images: names.iter().enumerate().map(image).collect(), points }
    }

    pub(super) fn cameras_binary(&self) -> Vec<u8> {
        let mut bytes = count(self.cameras.len());
        for camera in &self.cameras {
            bytes.extend(camera.id.to_le_bytes());
            bytes.extend(camera.number.to_le_bytes());
            bytes.extend([camera.size.0, camera.size.1].map(u64::to_le_bytes).concat());
            bytes.extend(floats(&camera.parameters));
        }
        bytes
    }

    pub(super) fn images_binary(&self) -> Vec<u8> {
        let mut bytes = count(self.images.len());
        for (number, image) in self.images.iter().enumerate() {
            bytes.extend((number as u32 + 1).to_le_bytes());
            bytes.extend(floats(&image.quaternion));
            bytes.extend(floats(&image.translation));
            bytes.extend(image.camera.to_le_bytes());
            bytes.extend(image.name.bytes().chain([0]));
            bytes.extend(count(image.observations.len()));
            for &(x, y, point) in &image.observations {
                bytes.extend(floats(&[x, y]));
                bytes.extend(point.to_le_bytes());
            }
        }
        bytes
    }

    pub(super) fn points_binary(&self) -> Vec<u8> {
        let mut bytes = count(self.points.len());
        for (number, (position, colour)) in self.points.iter().enumerate() {
            bytes.extend(count(number));
            bytes.extend(floats(position));
            bytes.extend(colour);
            bytes.extend(floats(&[0.75]));
            bytes.extend(count(2));
            bytes.extend([1u32, 0, 2, 1].map(u32::to_le_bytes).concat());
        }
        bytes
    }

    pub(super) fn cameras_text(&self) -> String {
        let mut text = "# Camera list with one line of data per camera:\n\n".to_owned();
        for camera in &self.cameras {
            let SampleCamera { id, name, size, .. } = camera;
            line(&mut text, format!("{id} {name} {} {} {}", size.0, size.1, words(&camera.parameters)));
        }
        text
    }

    pub(super) fn images_text(&self) -> String {
        let mut text = "# Image list with two lines of data per image:\n".to_owned();
        for (number, image) in self.images.iter().enumerate() {
            let (quaternion, translation) = (words(&image.quaternion), words(&image.translation));
            line(&mut text, format!("{} {quaternion} {translation} {} {}", number + 1, image.camera, image.name));
            let observations = image.observations.iter().map(|(x, y, point)| format!("{x} {y} {point}"));
            line(&mut text, observations.collect::<Vec<_>>().join(" "));
        }
        text
    }

    pub(super) fn points_text(&self) -> String {
        let mut text = "# 3D point list with one line of data per point:\n".to_owned();
        for (number, (position, [red, green, blue])) in self.points.iter().enumerate() {
            line(&mut text, format!("{number} {} {red} {green} {blue} 0.75 1 0 2 1", words(position)));
        }
        text
    }
}

fn count(number: usize) -> Vec<u8> {
    (number as u64).to_le_bytes().to_vec()
}

fn floats(values: &[f64]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

fn words(values: &[f64]) -> String {
    values.iter().map(f64::to_string).collect::<Vec<_>>().join(" ")
}

fn line(text: &mut String, content: String) {
    writeln!(text, "{content}").expect("a string grows");
}
