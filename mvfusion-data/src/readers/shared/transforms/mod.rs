//! `transforms.json` and related files: cameras of nerfstudio, instant-ngp, NeRF On-the-go and D-NeRF.
//!
//! Assumptions:
//! * `transform_matrix` maps the camera to the world. The camera looks along -z with x right and y up (OpenGL). It is
//!   converted to our convention here: along +z, y down.
//! * Intrinsics are at the top or in a frame, and those in a frame take precedence: `fl_x fl_y cx cy w h`.
//!   `camera_angle_x` may replace `fl_x`, and `camera_angle_y` may replace `fl_y`. Without either of the latter, pixels
//!   are square. Angles alone mean a centred principal point, for images of any size. Distortion is `k1 … k6 p1 p2`,
//!   interpreted by `camera_model`. The default is OPENCV, or OPENCV_FISHEYE if `is_fisheye` is set, as instant-ngp
//!   does. If all coefficients are zero or absent, a lens that is not a fisheye is a pinhole.
//! * Paths are relative to the file's folder and cannot lead out of it. A missing extension means .png.

mod lens;
mod record;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3};

use super::shot::{FrameLens, Shot};
use crate::error::DataError;
use crate::files::{below, dataset_text, parse_json, rotation_of, with_slashes};
use crate::scene::{PictureSource, Scene};
use lens::read_lens;
use record::{FileRecord, FrameRecord, LensRecord};

/// The convention of the poses.
pub(crate) const POSES: &str =
    "A transform_matrix leads from the camera to the world, in OpenGL's axes: x right, y up, z backward.";

/// Advice for an unusable file.
const ADVICE: &str = "Export it again, or mend the entry by hand";

/// The cameras of a file.
#[derive(Debug)]
pub(crate) struct Transforms {
    /// The file itself.
    pub(crate) path: PathBuf,
    /// In file order. No two frames share an image.
    pub(crate) frames: Vec<Frame>,
    /// A point cloud, below the file's folder.
    pub(crate) points: Option<PathBuf>,
    /// Names of the training and held-out images, if the file lists them.
    pub(crate) train: Option<Vec<String>>,
    pub(crate) test: Option<Vec<String>>,
}

/// An image and its camera.
#[derive(Clone, Debug)]
pub(crate) struct Frame {
    /// The image's path as the file writes it: `images/0001.jpg`, or `./train/r_000`.
    pub(crate) name: String,
    /// The image on disk.
    pub(crate) file: PathBuf,
    /// From the world to the camera, OpenCV axes.
    pub(crate) rotation: DMat3,
    pub(crate) translation: DVec3,
    pub(crate) lens: FrameLens,
    /// `time`, as in the file.
    pub(crate) time: Option<f64>,
    /// `timestamp`, nanoseconds.
    pub(crate) timestamp: Option<f64>,
    /// A mask: white is valid, black is ignored.
    pub(crate) mask: Option<PathBuf>,
}

/// The masks in the folder of a `transforms.json` that no frame names; `None` if there are none.
pub(crate) fn ignored_masks(folder: &Path, scene: &Scene) -> Option<String> {
    super::ignored_masks::ignored_masks(folder, scene, "no frame has a `mask_path`")
}

/// A path without a leading `./`. A file may write the same path with and without it.
pub(crate) fn plain(name: &str) -> &str {
    name.strip_prefix("./").unwrap_or(name)
}

impl Frame {
    /// The image's path without its extension, which is also the name of its mask.
    fn view_name(&self) -> String {
        Path::new(plain(&self.name)).with_extension("").to_string_lossy().into_owned()
    }

    /// The shot of the image at a time in `[0, 1]`.
    pub(crate) fn shot(&self, time: f64) -> Shot {
        Shot {
            name: self.view_name(),
            source: PictureSource::Image(self.file.clone()),
            mask: self.mask.clone(),
            lens: self.lens,
            rotation: self.rotation,
            translation: self.translation,
            time,
        }
    }
}

impl Transforms {
    /// Reads a file.
    ///
    /// # Errors
    /// [`DataError::Content`] that names the invalid frame and the problem.
    pub(crate) fn read(path: &Path) -> Result<Self, DataError> {
        let fail = |reason: String| DataError::Content { path: path.to_owned(), reason, advice: ADVICE };
        let text = dataset_text(path).map_err(fail)?;
        let record: FileRecord = parse_json(&text).map_err(fail)?;
        let common: LensRecord = parse_json(&text).map_err(fail)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let mut frames: Vec<Frame> = Vec::with_capacity(record.frames.len());
        let mut places = BTreeMap::new();
        for (index, frame) in record.frames.iter().enumerate() {
            let about = |reason: String| fail(format!("frame {index} ({}): {reason}", frame.file_path));
            let frame = read_frame(frame, &common, folder).map_err(about)?;
            if let Some(twin) = places.insert(frame.file.clone(), index) {
                return Err(fail(format!("frames {twin} and {index} are both of {}", frame.name)));
            }
            frames.push(frame);
        }
        if frames.is_empty() {
            return Err(fail("it lists no frame".into()));
        }
        let points = record.ply_file_path.as_deref().map(|name| below(folder, name)).transpose().map_err(fail)?;
        // If no test images are listed, the validation images are held out.
        let listed = |names: Option<Vec<String>>| -> Option<Vec<String>> {
            names.map(|names| names.iter().map(|name| with_slashes(folder, name).into_owned()).collect())
        };
        let named = |names: Option<Vec<String>>| listed(names).filter(|names| !names.is_empty());
        let test = named(record.test_filenames).or_else(|| named(record.val_filenames));
        let train = listed(record.train_filenames);
        Ok(Self { path: path.to_owned(), frames, points, train, test })
    }
}

fn read_frame(record: &FrameRecord, common: &LensRecord, folder: &Path) -> Result<Frame, String> {
    let (rotation, translation) = read_pose(&record.transform_matrix)?;
    let mut file = below(folder, &record.file_path)?;
    if file.extension().is_none() {
        file.set_extension("png");
    }
    let finite = |what: &str, value: Option<f64>| match value {
        Some(value) if !value.is_finite() => Err(format!("its {what} is {value}")),
        value => Ok(value),
    };
    Ok(Frame {
        name: with_slashes(folder, &record.file_path).into_owned(),
        file,
        rotation,
        translation,
        lens: read_lens(&record.lens_or(common))?,
        time: finite("time", record.time)?,
        timestamp: finite("timestamp", record.timestamp)?,
        mask: record.mask_path.as_deref().map(|name| below(folder, name)).transpose()?,
    })
}

/// The pose from the world to the camera, in OpenCV axes.
fn read_pose(rows: &[Vec<f64>]) -> Result<(DMat3, DVec3), String> {
    if !(3..=4).contains(&rows.len()) || rows.iter().any(|row| row.len() != 4) {
        return Err("its transform_matrix has not 3 or 4 rows of 4 numbers".into());
    }
    if let Some(value) = rows.iter().flatten().find(|value| !value.is_finite()) {
        return Err(format!("its transform_matrix holds {value}"));
    }
    let column = |c: usize| DVec3::new(rows[0][c], rows[1][c], rows[2][c]);
    let to_world = rotation_of(DMat3::from_cols(column(0), -column(1), -column(2)));
    let rotation = to_world.ok_or("its transform_matrix is no rotation and shift")?.transpose();
    Ok((rotation, -(rotation * column(3))))
}
