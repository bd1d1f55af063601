//! Camera paths in files: exports of nerfstudio's viewer, and the `cameras.json` of 3DGS.
//!
//! * nerfstudio: `{"camera_path": [{"camera_to_world": 16 numbers by rows, "fov": vertical, in degrees}, …],
//!   "render_width", "render_height", "fps"}`. The camera looks along -z with y up (OpenGL). `render_time` of an entry
//!   is its moment.
//! * 3DGS: `[{"position", "rotation": camera-to-world by rows, "fx", "fy", "width", "height"}, …]` in OpenCV axes.
//!
//! In both, we also accept `time` of an entry: its moment in `[0, 1]`. This is our own addition.
//!
//! Poses are taken as they are, in the scene's coordinates. nerfstudio's viewer exports poses in the world that it
//! shows. nerfstudio rotates, centres and scales that world unless configured otherwise, and the file does not contain
//! this transform.

use std::ops::RangeInclusive;
use std::path::Path;

use glam::{DMat3, DVec3};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

use super::camera::check_camera;
use crate::error::DataError;
use crate::files::{or_denied, read_json, rotation_of};
use crate::scene::Camera;

const ADVICE: &str = "Camera paths are what nerfstudio's viewer exports, or lists like the cameras.json of 3DGS: \
                      export it again, or mend the entry by hand.";
/// Largest number of cameras in a path: an hour at 30 FPS.
pub const MOST_ENTRIES: usize = 108_000;
/// Allowed frame rates in FPS.
pub const FRAME_RATES: RangeInclusive<f64> = 0.1..=240.0;

/// A camera path from a file.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraPath {
    /// The cameras, in order. Never empty.
    pub entries: Vec<PathEntry>,
    /// Frames per second, if the file contains them.
    pub fps: Option<f64>,
}

/// A camera of a path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathEntry {
    /// The camera.
    pub camera: Camera,
    /// Its moment in `[0, 1]`, if the file contains it.
    pub time: Option<f64>,
}

/// The file of nerfstudio.
#[derive(Deserialize)]
struct Export {
    camera_path: Vec<Value>,
    render_width: usize,
    render_height: usize,
    fps: Option<f64>,
    camera_type: Option<String>,
}

/// An entry of nerfstudio's file.
#[derive(Deserialize)]
struct Key {
    camera_to_world: Vec<f64>,
    fov: f64,
    #[serde(alias = "render_time")]
    time: Option<f64>,
}

/// An entry of the 3DGS file.
#[derive(Deserialize)]
struct Listed {
    position: [f64; 3],
    rotation: [[f64; 3]; 3],
    fx: f64,
    fy: f64,
    /// The principal point; 3DGS writes none and means the centre.
    cx: Option<f64>,
    cy: Option<f64>,
    width: usize,
    height: usize,
    time: Option<f64>,
}

/// Reads a path.
///
/// # Errors
/// [`DataError::Content`] that names the entry by its index, from 0.
pub fn read_camera_path(path: &Path) -> Result<CameraPath, DataError> {
    let value: Value = read_json(path, ADVICE).map_err(or_denied)?;
    let parsed = if value.is_array() { parse_list(value) } else { parse_export(value) };
    parsed.map_err(|reason| DataError::Content { path: path.to_owned(), reason, advice: ADVICE })
}

fn parse_export(value: Value) -> Result<CameraPath, String> {
    let export: Export = serde_json::from_value(value).map_err(|e| e.to_string())?;
    if let Some(kind) = export.camera_type.as_ref().filter(|kind| *kind != "perspective") {
        return Err(format!("its camera_type is `{kind}`, and only `perspective` can be rendered"));
    }
    if let Some(fps) = export.fps.filter(|fps| !FRAME_RATES.contains(fps)) {
        let (least, most) = FRAME_RATES.into_inner();
        // Printed with `{fps}`, the number could have hundreds of digits.
        return Err(format!("its fps is {fps:?}, and frames a second lie between {least} and {most}"));
    }
    let (width, height) = (export.render_width, export.render_height);
    let entries = entries(export.camera_path, |key: Key| key.entry(width, height))?;
    Ok(CameraPath { entries, fps: export.fps })
}

fn parse_list(value: Value) -> Result<CameraPath, String> {
    let list: Vec<Value> = serde_json::from_value(value).map_err(|e| e.to_string())?;
    Ok(CameraPath { entries: entries(list, |listed: Listed| listed.entry())?, fps: None })
}

/// The checked entries of a list. An error names the entry.
fn entries<R: DeserializeOwned>(
    list: Vec<Value>,
    entry: impl Fn(R) -> Result<PathEntry, String>,
) -> Result<Vec<PathEntry>, String> {
    if list.is_empty() {
        return Err("it has no camera".into());
    }
    if list.len() > MOST_ENTRIES {
        return Err(format!("it has {} cameras, more than {MOST_ENTRIES}", list.len()));
    }
    let read = |value: Value| check(entry(serde_json::from_value(value).map_err(|e| e.to_string())?)?);
    let named = |(index, value)| read(value).map_err(|reason| format!("camera {index}: {reason}"));
    list.into_iter().enumerate().map(named).collect()
}

fn check(entry: PathEntry) -> Result<PathEntry, String> {
    check_camera(&entry.camera).map_err(|error| error.to_string())?;
    match entry.time {
        Some(time) if !(0.0..=1.0).contains(&time) => Err(format!("its time is {time}, and times lie in [0, 1]")),
        _ => Ok(entry),
    }
}

impl Key {
    fn entry(self, width: usize, height: usize) -> Result<PathEntry, String> {
        let matrix = self.camera_to_world;
        if matrix.len() != 16 {
            return Err(format!("its camera_to_world has {} numbers and not 16", matrix.len()));
        }
        let column = |c: usize| DVec3::new(matrix[c], matrix[4 + c], matrix[8 + c]);
        let axes = rotation_of(DMat3::from_cols(column(0), -column(1), -column(2)));
        let axes = axes.ok_or("its camera_to_world has axes that are no rotation")?;
        if !(self.fov > 0.0 && self.fov < 180.0) {
            return Err(format!("its fov is {} degrees, and must lie between 0 and 180", self.fov));
        }
        let focal = height as f64 / (2.0 * (self.fov.to_radians() / 2.0).tan());
        Ok(PathEntry { camera: Camera::centred(width, height, focal, axes, column(3)), time: self.time })
    }
}

impl Listed {
    fn entry(self) -> Result<PathEntry, String> {
        let axes = rotation_of(DMat3::from_cols_array_2d(&self.rotation).transpose());
        let axes = axes.ok_or("its rotation is none")?;
        let camera = Camera::centred(self.width, self.height, self.fx, axes, DVec3::from_array(self.position));
        let [cx, cy] = [self.cx.unwrap_or(camera.cx), self.cy.unwrap_or(camera.cy)];
        Ok(PathEntry { camera: Camera { fy: self.fy, cx, cy, ..camera }, time: self.time })
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    fn read(text: &str) -> Result<CameraPath, String> {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("path.json");
        fs::write(&path, text).expect("written");
        read_camera_path(&path).map_err(|error| error.to_string())
    }

    fn times(path: &CameraPath) -> Vec<Option<f64>> {
        path.entries.iter().map(|entry| entry.time).collect()
    }

    /// The identity in OpenGL axes, at (1, 2, 3).
    const MATRIX: &str = "[1,0,0,1, 0,1,0,2, 0,0,1,3, 0,0,0,1]";

    #[test]
    fn an_export_of_nerfstudio_looks_along_minus_z_with_y_up() {
        let path = read(&format!(
            r#"{{"camera_type":"perspective","render_height":100,"render_width":200,"fps":24,"seconds":4,"camera_path":[
                {{"camera_to_world":{MATRIX},"fov":90,"aspect":2}},
                {{"camera_to_world":{MATRIX},"fov":90,"aspect":2,"render_time":0.25}}]}}"#
        ))
        .expect("read");
        assert_eq!((path.fps, path.entries.len()), (Some(24.0), 2));
        let camera = path.entries[0].camera;
        assert_eq!((camera.width, camera.height), (200, 100));
        // For 90 degrees, half the height equals the focal length.
        assert!((camera.fx - 50.0).abs() < 1e-12 && (camera.fy - 50.0).abs() < 1e-12);
        assert!(camera.centre().distance(DVec3::new(1.0, 2.0, 3.0)) < 1e-12);
        assert!(
            camera.forward().distance(DVec3::NEG_Z) < 1e-12 && camera.rotation.row(1).distance(DVec3::NEG_Y) < 1e-12
        );
        assert_eq!(times(&path), [None, Some(0.25)]);
    }

    #[test]
    fn a_list_of_3dgs_has_rotations_to_the_world_by_rows() {
        // Right is the world's y, down its z, forward its x.
        let path = read(
            r#"[{"id":0,"img_name":"a","width":64,"height":48,"position":[1,2,3],"rotation":[[0,0,1],[1,0,0],[0,1,0]],
                "fx":60,"fy":61,"time":1}]"#,
        )
        .expect("read");
        let camera = path.entries[0].camera;
        assert!(camera.forward().distance(DVec3::X) < 1e-12 && camera.rotation.row(0).distance(DVec3::Y) < 1e-12);
        assert_eq!((camera.fx, camera.fy, camera.cx, camera.cy), (60.0, 61.0, 32.0, 24.0));
        assert!(camera.centre().distance(DVec3::new(1.0, 2.0, 3.0)) < 1e-12);
        assert_eq!((times(&path), path.fps), (vec![Some(1.0)], None));
        let shifted = read(
            r#"[{"width":64,"height":48,"position":[1,2,3],"rotation":[[0,0,1],[1,0,0],[0,1,0]],"fx":60,"fy":61,
                "cx":20,"cy":25.5}]"#,
        )
        .expect("read");
        let camera = shifted.entries[0].camera;
        assert_eq!((camera.cx, camera.cy), (20.0, 25.5));
    }

    #[test]
    fn rates_at_which_no_film_is_shown_are_refused() {
        let with = |fps: &str| {
            read(&format!(
                r#"{{"render_height":100,"render_width":200,"fps":{fps},
                    "camera_path":[{{"camera_to_world":{MATRIX},"fov":90}}]}}"#
            ))
        };
        assert_eq!(with("240").expect("read").fps, Some(240.0));
        assert_eq!(with("null").expect("read").fps, None);
        for fps in ["1e300", "1e-300", "0.0", "-1.0", "240.5"] {
            let error = with(fps).expect_err("refused");
            assert!(error.contains(&format!("its fps is {fps}")) && error.contains("between 0.1 and 240"), "{error}");
        }
    }

    #[test]
    fn complaints_name_the_file_and_the_entry() {
        let good =
            r#"{"width":64,"height":48,"position":[0,0,0],"rotation":[[1,0,0],[0,1,0],[0,0,1]],"fx":60,"fy":60}"#;
        let with = |from: &str, to: &str| format!("[{good}, {}]", good.replace(from, to));
        for (text, words) in [
            (with("\"fx\":60", "\"fx\":0"), ["camera 1", "focal lengths"]),
            (with("[[1,0,0]", "[[2,0,0]"), ["camera 1", "rotation"]),
            (with("\"width\":64", "\"width\":999999"), ["camera 1", "pixels"]),
            (with("\"fy\":60", "\"fy\":60,\"time\":2"), ["camera 1", "time"]),
            (with("\"position\":[0,0,0],", ""), ["camera 1", "position"]),
            (with("\"position\":[0,0,0]", "\"position\":[1e300,0,0]"), ["camera 1", "too large"]),
            (with("\"fx\":60", "\"fx\":1e30"), ["camera 1", "too large"]),
            ("[]".into(), ["path.json", "no camera"]),
            ("{\"camera_path\": 7".into(), ["path.json", "line 1"]),
            ("{\"frames\": []}".into(), ["path.json", "camera_path"]),
        ] {
            let error = read(&text).expect_err("refused");
            assert!(words.iter().all(|word| error.contains(word)), "{error}");
        }
    }
}
