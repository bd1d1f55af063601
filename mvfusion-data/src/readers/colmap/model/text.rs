//! Text files of a COLMAP model: one line per record, two lines per image. `#` starts a comment.

use std::str::FromStr;

use super::complaint::Complaint;
use super::lens::{CameraRecord, LensModel};
use super::records::{ImageRecord, push_point};
use crate::scene::PointCloud;

/// Reads `cameras.txt`: CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS.
pub(crate) fn cameras(text: &str) -> Result<Vec<CameraRecord>, Complaint> {
    text.lines().enumerate().filter(|(_, line)| is_record(line)).map(|at| on_line(at, camera)).collect()
}

/// Reads `images.txt`: IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME. The next line contains observations (X,
/// Y, POINT3D_ID), which are skipped.
pub(crate) fn images(text: &str) -> Result<Vec<ImageRecord>, Complaint> {
    let mut images = Vec::new();
    let mut lines = text.lines().enumerate();
    while let Some(line) = lines.next() {
        if !is_record(line.1) {
            continue;
        }
        images.push(on_line(line, image)?);
        // The second line is empty if nothing was observed. It still belongs to the record.
        if let Some(line) = lines.next() {
            on_line(line, observations)?;
        }
    }
    Ok(images)
}

/// Reads `points3D.txt`: POINT3D_ID, X, Y, Z, R, G, B. The error and the track after them are skipped.
pub(crate) fn points(text: &str) -> Result<PointCloud, Complaint> {
    let mut points = PointCloud::default();
    for line in text.lines().enumerate().filter(|(_, line)| is_record(line)) {
        on_line(line, |fields| point(fields, &mut points))?;
    }
    Ok(points)
}

fn camera(fields: &mut Fields) -> Result<CameraRecord, Complaint> {
    let id = fields.number("camera's number")?;
    let model = LensModel::named(fields.word("camera model")?, id)?;
    let (width, height) = (fields.number("width")?, fields.number("height")?);
    let mut parameters = Vec::new();
    while !fields.is_empty() {
        parameters.push(fields.number("camera parameter")?);
    }
    Ok(CameraRecord { id, model, width, height, parameters })
}

fn image(fields: &mut Fields) -> Result<ImageRecord, Complaint> {
    fields.number::<u32>("image's number")?; // Names identify images.
    let quaternion = fields.numbers("quaternion")?;
    let translation = fields.numbers("translation")?;
    let camera = fields.number("camera's number")?;
    let name = fields.rest().to_owned(); // It may contain spaces.
    Ok(ImageRecord { name, camera, quaternion, translation })
}

/// Checks that a line contains observations. If empty second lines were lost, every other image would be skipped.
fn observations(fields: &mut Fields) -> Result<(), Complaint> {
    let line = fields.rest();
    let ends_with_a_point = || line.split_whitespace().next_back().is_some_and(|word| word.parse::<i64>().is_ok());
    if line.is_empty() || (line.split_whitespace().count().is_multiple_of(3) && ends_with_a_point()) {
        return Ok(());
    }
    Err("it is no list of observations (X, Y, POINT3D_ID), as the second line of an image must be".to_owned().into())
}

fn point(fields: &mut Fields, points: &mut PointCloud) -> Result<(), Complaint> {
    fields.number::<u64>("point's number")?;
    let position = fields.numbers("position")?;
    let colour = fields.numbers("colour")?;
    Ok(push_point(points, position, colour)?)
}

fn is_record(line: &str) -> bool {
    let line = line.trim_start();
    !line.is_empty() && !line.starts_with('#')
}

/// Parses a line. Errors name its number, from 1.
fn on_line<T>(
    (index, line): (usize, &str),
    parse: impl FnOnce(&mut Fields) -> Result<T, Complaint>,
) -> Result<T, Complaint> {
    parse(&mut Fields(line))
        .map_err(|complaint| Complaint { reason: format!("line {}: {}", index + 1, complaint.reason), ..complaint })
}

/// The rest of a line.
struct Fields<'a>(&'a str);

impl<'a> Fields<'a> {
    fn word(&mut self, what: &str) -> Result<&'a str, String> {
        let line = self.0.trim_start();
        let (word, rest) = line.split_at(line.find(char::is_whitespace).unwrap_or(line.len()));
        self.0 = rest;
        if word.is_empty() { Err(format!("the {what} is missing")) } else { Ok(word) }
    }

    fn number<T: FromStr>(&mut self, what: &str) -> Result<T, String> {
        let word = self.word(what)?;
        word.parse().map_err(|_| format!("`{word}` cannot be a {what}"))
    }

    fn numbers<T: FromStr + Copy + Default, const N: usize>(&mut self, what: &str) -> Result<[T; N], String> {
        let mut values = [T::default(); N];
        for value in &mut values {
            *value = self.number(what)?;
        }
        Ok(values)
    }

    fn is_empty(&self) -> bool {
        self.0.trim().is_empty()
    }

    fn rest(&mut self) -> &'a str {
        std::mem::take(&mut self.0).trim()
    }
}
