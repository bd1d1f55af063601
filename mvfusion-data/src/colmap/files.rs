//! The three files of a COLMAP model: where they lie and how they are written.

use std::fs;
use std::path::{Path, PathBuf};

use super::lens::CameraRecord;
use super::model::ImageRecord;
use super::{SPARSE, binary, text};
use crate::{DataError, PointCloud};

/// What to do about a file that is damaged.
const EXPORT_AGAIN: &str = "Copy the model again, or export it again with `colmap model_converter`";

/// What is wrong with a file of the model, and what to do about it.
#[derive(Debug)]
pub(super) struct Complaint {
    pub(super) reason: String,
    pub(super) advice: &'static str,
}

impl From<String> for Complaint {
    fn from(reason: String) -> Self {
        Self { reason, advice: EXPORT_AGAIN }
    }
}

/// One of the three files.
#[derive(Clone, Copy, Debug)]
pub(super) enum Part {
    Cameras,
    Images,
    Points,
}

impl Part {
    fn stem(self) -> &'static str {
        match self {
            Part::Cameras => "cameras",
            Part::Images => "images",
            Part::Points => "points3D",
        }
    }
}

#[derive(Clone, Copy, Debug)]
enum Encoding {
    Binary,
    Text,
}

impl Encoding {
    fn extension(self) -> &'static str {
        match self {
            Encoding::Binary => "bin",
            Encoding::Text => "txt",
        }
    }
}

/// The files of one model.
#[derive(Debug)]
pub(super) struct ModelFiles {
    folder: PathBuf,
    encoding: Encoding,
}

impl ModelFiles {
    /// Finds the model of a scene.
    ///
    /// # Errors
    /// [`DataError::Missing`] if there is none.
    pub(super) fn locate(scene: &Path) -> Result<Self, DataError> {
        let sparse = scene.join(SPARSE);
        let found = [sparse.join("0"), sparse.clone()].into_iter().find_map(|folder| {
            let files = [Encoding::Binary, Encoding::Text].map(|encoding| Self { folder: folder.clone(), encoding });
            files.into_iter().find(|files| files.path(Part::Cameras).is_file())
        });
        found.ok_or_else(|| DataError::Missing {
            what: "model with cameras.bin or cameras.txt".into(),
            folder: sparse.join("0"),
            advice: "Put the files of the COLMAP model there".into(),
        })
    }

    /// The cameras, in the order of the file.
    pub(super) fn cameras(&self) -> Result<Vec<CameraRecord>, DataError> {
        self.parse(Part::Cameras, binary::cameras, text::cameras)
    }

    /// The images, in the order of the file.
    pub(super) fn images(&self) -> Result<Vec<ImageRecord>, DataError> {
        self.parse(Part::Images, binary::images, text::images)
    }

    /// The points, in the order of the file.
    pub(super) fn points(&self) -> Result<PointCloud, DataError> {
        self.parse(Part::Points, binary::points, text::points)
    }

    /// The error for something that is wrong with a file.
    pub(super) fn blame(&self, part: Part, complaint: Complaint) -> DataError {
        DataError::Content { path: self.path(part), reason: complaint.reason, advice: complaint.advice }
    }

    fn path(&self, part: Part) -> PathBuf {
        self.folder.join(format!("{}.{}", part.stem(), self.encoding.extension()))
    }

    fn parse<T>(
        &self,
        part: Part,
        from_bytes: fn(&[u8]) -> Result<T, Complaint>,
        from_text: fn(&str) -> Result<T, Complaint>,
    ) -> Result<T, DataError> {
        let path = self.path(part);
        if !path.is_file() {
            let what = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            let advice = "A model is three files, cameras, images and points3D, all of them .bin or all of them .txt";
            return Err(DataError::Missing { what, folder: self.folder.clone(), advice: advice.into() });
        }
        let parsed = match self.encoding {
            Encoding::Binary => fs::read(&path).map_err(|e| e.to_string().into()).and_then(|b| from_bytes(&b)),
            Encoding::Text => fs::read_to_string(&path).map_err(|e| e.to_string().into()).and_then(|t| from_text(&t)),
        };
        parsed.map_err(|complaint| self.blame(part, complaint))
    }
}
