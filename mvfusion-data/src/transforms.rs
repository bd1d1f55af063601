//! `transforms.json` and its kin: cameras of nerfstudio, instant-ngp, NeRF On-the-go and D-NeRF.
//!
//! What is assumed of them:
//! * `transform_matrix` leads from the camera to the world; the camera looks along -z with x right and y up (OpenGL). Here
//!   it becomes our own convention: along +z, y down.
//! * Intrinsics stand at the top or in a frame, which wins: `fl_x fl_y cx cy w h`. `camera_angle_x` may stand for `fl_x`, and
//!   alone it means square pixels and the principal point in the middle of pictures of any size. Distortion is
//!   `k1 … k6 p1 p2`, read as `camera_model` says: OPENCV where none is named, OPENCV_FISHEYE where `is_fisheye` is set, as
//!   instant-ngp does. Where they are zero or absent the lens is a pinhole, whatever the model is called.
//! * Paths are relative to the file's folder and lead nowhere else; an extension may be missing, and is .png then.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use glam::{DMat3, DVec2, DVec3};
use serde::Deserialize;

use crate::lens::{Bend, Lens};
use crate::paths::{below, parse_json, read_text};
use crate::rotation::rotation_of;
use crate::shot::{FrameLens, Shot};
use crate::{DataError, PictureSource};

/// What to do about a file that cannot be used.
const ADVICE: &str = "Export it again, or mend the entry by hand";

/// The cameras of a file.
#[derive(Debug)]
pub(crate) struct Transforms {
    /// Where it was read.
    pub(crate) path: PathBuf,
    /// In the order of the file, no two of one picture.
    pub(crate) frames: Vec<Frame>,
    /// A point cloud, below the file's folder.
    pub(crate) points: Option<PathBuf>,
    /// Names of the pictures to train on and to hold out, where the file has such a list.
    pub(crate) train: Option<Vec<String>>,
    pub(crate) test: Option<Vec<String>>,
}

/// A picture and its camera.
#[derive(Clone, Debug)]
pub(crate) struct Frame {
    /// The picture, as the file writes it: `images/0001.jpg`, or `./train/r_000`.
    pub(crate) name: String,
    /// The picture on disk.
    pub(crate) file: PathBuf,
    /// From the world to the camera, OpenCV axes.
    pub(crate) rotation: DMat3,
    pub(crate) translation: DVec3,
    pub(crate) lens: FrameLens,
    /// `time` as it stands there.
    pub(crate) time: Option<f64>,
    /// `timestamp`, nanoseconds.
    pub(crate) timestamp: Option<f64>,
    /// A mask beside it: white counts, black is ignored.
    pub(crate) mask: Option<PathBuf>,
}

/// A path as it may be written in several places of a file, here with `./` before it and there without.
pub(crate) fn plain(name: &str) -> &str {
    name.strip_prefix("./").unwrap_or(name)
}

impl Frame {
    /// The picture's path without its extension, as masks are named.
    fn view_name(&self) -> String {
        Path::new(plain(&self.name)).with_extension("").to_string_lossy().into_owned()
    }

    /// The picture at its time, in `[0, 1]`.
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

/// The file as it is written, but for the intrinsics at its top. Unknown entries are passed over: every tool adds its own.
#[derive(Debug, Deserialize)]
struct FileRecord {
    frames: Vec<FrameRecord>,
    ply_file_path: Option<String>,
    train_filenames: Option<Vec<String>>,
    val_filenames: Option<Vec<String>>,
    test_filenames: Option<Vec<String>>,
}

/// The records that have the entries of a lens, all but two of which are these numbers. (`serde(flatten)` would say so in fewer
/// words, but it keeps every unknown entry in memory, at many times its size in the file.)
macro_rules! records {
    ($($number:ident)*) => {
        /// Intrinsics, at the top of the file or in a frame.
        #[derive(Debug, Deserialize)]
        struct LensRecord {
            camera_model: Option<String>,
            is_fisheye: Option<bool>,
            $($number: Option<f64>,)*
        }

        /// A frame as it is written.
        #[derive(Debug, Deserialize)]
        struct FrameRecord {
            file_path: String,
            transform_matrix: Vec<Vec<f64>>,
            time: Option<f64>,
            timestamp: Option<f64>,
            mask_path: Option<String>,
            camera_model: Option<String>,
            is_fisheye: Option<bool>,
            $($number: Option<f64>,)*
        }

        impl FrameRecord {
            /// What stands in the frame, and where nothing does, what is common to all.
            fn lens_or(&self, common: &LensRecord) -> LensRecord {
                LensRecord {
                    camera_model: self.camera_model.clone().or_else(|| common.camera_model.clone()),
                    is_fisheye: self.is_fisheye.or(common.is_fisheye),
                    $($number: self.$number.or(common.$number),)*
                }
            }
        }
    };
}

records!(camera_angle_x fl_x fl_y cx cy w h k1 k2 k3 k4 k5 k6 p1 p2);

impl Transforms {
    /// Reads a file.
    ///
    /// # Errors
    /// [`DataError::Content`] that says which frame is wrong, and in what.
    pub(crate) fn read(path: &Path) -> Result<Self, DataError> {
        let fail = |reason: String| DataError::Content { path: path.to_owned(), reason, advice: ADVICE };
        let text = read_text(path).map_err(fail)?;
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
        // Where nothing is held out for tests, what is held out for validation serves.
        let test = record.test_filenames.filter(|names| !names.is_empty()).or(record.val_filenames);
        let train = record.train_filenames;
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
        name: record.file_path.clone(),
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

fn read_lens(record: &LensRecord) -> Result<FrameLens, String> {
    let positive = |name: &str, value: Option<f64>| match value {
        Some(value) if !(value.is_finite() && value > 0.0) => Err(format!("its {name} is {value}")),
        value => Ok(value),
    };
    let [fl_x, fl_y, w, h] = [("fl_x", record.fl_x), ("fl_y", record.fl_y), ("w", record.w), ("h", record.h)]
        .map(|(name, value)| positive(name, value));
    let (fl_x, fl_y, size, bend) = (fl_x?, fl_y?, w?.zip(h?), read_bend(record)?);
    let focal_in_widths = || {
        let angle = positive("camera_angle_x", record.camera_angle_x)?.filter(|angle| *angle < std::f64::consts::PI);
        angle
            .map(|angle| 0.5 / (0.5 * angle).tan())
            .ok_or("it has neither fl_x nor a camera_angle_x below π".to_owned())
    };
    let Some((w, h)) = size else {
        // An angle alone is for pictures of any size, all else for those of one.
        let alone = fl_x.or(fl_y).or(record.cx).or(record.cy).is_none() && bend.is_none();
        return match (fl_x, alone) {
            (None, true) => Ok(FrameLens::Angle { focal_in_widths: focal_in_widths()? }),
            (Some(_), _) => Err("it has fl_x but not w and h, the size that it is for".into()),
            (None, false) => Err("it has intrinsics but not w and h, the size that they are for".into()),
        };
    };
    let fl_x = fl_x.map_or_else(|| focal_in_widths().map(|focal| w * focal), Ok)?;
    let principal = DVec2::new(record.cx.unwrap_or(0.5 * w), record.cy.unwrap_or(0.5 * h));
    if !principal.is_finite() {
        return Err(format!("its principal point is {principal}"));
    }
    let lens = Lens { focal: DVec2::new(fl_x, fl_y.unwrap_or(fl_x)), principal, bend };
    Ok(FrameLens::Known { lens, size: DVec2::new(w, h) })
}

fn read_bend(record: &LensRecord) -> Result<Bend, String> {
    let of = |value: Option<f64>| value.unwrap_or(0.0);
    let [k1, k2, k3, k4, k5, k6] = [record.k1, record.k2, record.k3, record.k4, record.k5, record.k6].map(of);
    let tangential = [record.p1, record.p2].map(of);
    if ![k1, k2, k3, k4, k5, k6, tangential[0], tangential[1]].iter().all(|k| k.is_finite()) {
        return Err("a coefficient of its distortion is not finite".into());
    }
    let unnamed = if record.is_fisheye == Some(true) { "OPENCV_FISHEYE" } else { "OPENCV" };
    match record.camera_model.as_deref().unwrap_or(unnamed) {
        // nerfstudio gives OPENCV a third and a fourth radial coefficient, which OpenCV puts into a fraction, and straightens
        // pictures by the coefficients even if the model is called a pinhole.
        "OPENCV" | "RADIAL" | "SIMPLE_RADIAL" | "FULL_OPENCV" | "PINHOLE" | "SIMPLE_PINHOLE" | "perspective" => {
            Ok(Bend::Perspective { radial: [k1, k2, k3, k4, k5, k6], tangential })
        }
        "OPENCV_FISHEYE" | "fisheye" => Ok(Bend::Fisheye {
            radial: [k1, k2, k3, k4, 0.0, 0.0],
            tangential: [0.0; 2],
            prism: [0.0; 4],
            shifted_last: false,
        }),
        other => Err(format!(
            "its camera_model is {other}, and only these are read: PINHOLE, SIMPLE_PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, \
             FULL_OPENCV, OPENCV_FISHEYE"
        )),
    }
}

#[cfg(test)]
mod tests;
