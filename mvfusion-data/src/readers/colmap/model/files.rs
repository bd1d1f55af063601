//! The three files of a COLMAP model: their location and encoding.

use std::fs;
use std::path::{Path, PathBuf};

use tracing::warn;

use super::complaint::Complaint;
use super::lens::CameraRecord;
use super::records::ImageRecord;
use super::{binary, text};
use crate::error::DataError;
use crate::files::{dataset_text, read_bytes};
use crate::readers::shared::ply::read_points;
use crate::scene::PointCloud;

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
    /// Finds a model in the numbered folders of `sparse`, or in `sparse` itself. COLMAP creates one folder for each set
    /// of photos that it could not join. Of several models, the one with the most photos is used.
    ///
    /// # Errors
    /// [`DataError::Missing`] if there is none.
    pub(super) fn locate(sparse: &Path) -> Result<Self, DataError> {
        let mut numbers = numbers_in(sparse);
        numbers.sort_unstable();
        let mut models: Vec<Self> =
            numbers.iter().filter_map(|number| Self::within(&sparse.join(number.to_string()))).collect();
        let largest = if models.len() > 1 { most_photos(&models) } else { 0 };
        if largest < models.len() {
            return Ok(models.swap_remove(largest));
        }
        Self::within(sparse).ok_or_else(|| DataError::Missing {
            what: "model with cameras.bin or cameras.txt".into(),
            folder: sparse.join("0"),
            advice: "Put the files of the COLMAP model there".into(),
        })
    }

    /// The model in a folder. Binary files take precedence over text files.
    fn within(folder: &Path) -> Option<Self> {
        let files = [Encoding::Binary, Encoding::Text].map(|encoding| Self { folder: folder.to_owned(), encoding });
        files.into_iter().find(|files| files.path(Part::Cameras).is_file())
    }

    /// The cameras, in file order.
    pub(super) fn cameras(&self) -> Result<Vec<CameraRecord>, DataError> {
        self.parse(Part::Cameras, binary::cameras, text::cameras)
    }

    /// The images, in file order.
    pub(super) fn images(&self) -> Result<Vec<ImageRecord>, DataError> {
        self.parse(Part::Images, binary::images, text::images)
    }

    /// The points, in file order. If the model has only `points3D.ply`, as loaders of 3DGS leave it, those of that file.
    pub(super) fn points(&self) -> Result<PointCloud, DataError> {
        let ply = self.folder.join("points3D.ply");
        match self.path(Part::Points).is_file() || !ply.is_file() {
            true => self.parse(Part::Points, binary::points, text::points),
            false => read_points(&ply),
        }
    }

    /// The error for a complaint about a file.
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
            Encoding::Binary => {
                read_bytes(&path, u64::MAX).map_err(|e| e.to_string().into()).and_then(|b| from_bytes(&b))
            }
            Encoding::Text => dataset_text(&path).map_err(Complaint::from).and_then(|text| from_text(&text)),
        };
        parsed.map_err(|complaint| self.blame(part, complaint))
    }
}

/// The subfolders of `sparse` whose names are numbers.
fn numbers_in(sparse: &Path) -> Vec<u32> {
    let Ok(entries) = fs::read_dir(sparse) else { return Vec::new() };
    let number = |entry: std::io::Result<fs::DirEntry>| {
        let name = entry.ok()?.file_name();
        let name = name.to_str()?;
        // Only canonical numbers count, so that the name can be restored from the number.
        name.parse::<u32>().ok().filter(|number| number.to_string() == name)
    };
    entries.filter_map(number).collect()
}

/// The index of the model with the most photos; the first one on a tie. Logs the unused models.
fn most_photos(models: &[ModelFiles]) -> usize {
    let counts: Vec<Option<usize>> =
        models.iter().map(|files| files.images().ok().map(|images| images.len())).collect();
    let largest = (0..models.len()).rev().max_by_key(|&place| counts[place]).unwrap_or(0);
    let shown: Vec<String> = models
        .iter()
        .zip(&counts)
        .map(|(files, count)| match count {
            Some(count) => format!("{} ({count} photos)", files.folder.display()),
            None => format!("{} (damaged)", files.folder.display()),
        })
        .collect();
    warn!("there are {} models, {}: {} is read", models.len(), shown.join(", "), models[largest].folder.display());
    largest
}
