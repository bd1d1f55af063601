//! The models that COLMAP made, and the choice of one.

use std::fs;
use std::path::{Path, PathBuf};

use super::super::error::PrepareError;
use crate::readers::colmap::model;

/// The three files of a model. Newer versions write more, which no reader of ours needs.
const FILES: [&str; 3] = ["cameras.bin", "images.bin", "points3D.bin"];

/// A model of COLMAP.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(in super::super) struct MadeModel {
    /// Its number, which is the name of its folder.
    pub(in super::super) number: usize,
    folder: PathBuf,
    /// Names of the images that were placed, sorted.
    pub(in super::super) images: Vec<String>,
    /// Number of its points.
    pub(in super::super) points: usize,
}

impl MadeModel {
    /// Reads every model in a folder, in the order of the numbers.
    ///
    /// # Errors
    /// If one cannot be read.
    pub(super) fn all(sparse: &Path) -> Result<Vec<Self>, PrepareError> {
        let listed = fs::read_dir(sparse).into_iter().flatten().flatten();
        let mut numbers: Vec<usize> = listed.filter_map(|entry| entry.file_name().to_str()?.parse().ok()).collect();
        numbers.sort_unstable();
        let read = |number: usize| -> Result<Self, PrepareError> {
            let folder = sparse.join(number.to_string());
            let model = model::read(&folder)?;
            let images = model.photos.into_iter().map(|photo| photo.name).collect();
            Ok(Self { number, folder, images, points: model.points.len() })
        };
        numbers.into_iter().map(read).collect()
    }

    #[cfg(test)]
    pub(in super::super) fn example(number: usize, images: usize, points: usize) -> Self {
        Self { number, folder: PathBuf::new(), images: vec![String::new(); images], points }
    }

    /// Copies its files to a folder that is made.
    ///
    /// # Errors
    /// [`PrepareError::Unwritable`].
    pub(in super::super) fn copy_to(&self, folder: &Path) -> Result<(), PrepareError> {
        let copied = fs::create_dir_all(folder).and_then(|()| {
            FILES.iter().try_for_each(|name| fs::copy(self.folder.join(name), folder.join(name)).map(drop))
        });
        copied.map_err(|error| PrepareError::unwritable(folder, error))
    }

    /// In words: `model 1 (12 images, 3400 points)`.
    pub(in super::super) fn describe(&self) -> String {
        format!("model {} ({} images, {} points)", self.number, self.images.len(), self.points)
    }
}

/// The place of the model to use: the one asked for, or the one with the most images, then points, then the first.
/// `None` if there is none.
///
/// # Errors
/// [`PrepareError::Option`] if there is no model with the number asked for.
pub(in super::super) fn chosen(models: &[MadeModel], asked: Option<usize>) -> Result<Option<usize>, PrepareError> {
    let size = |place: &usize| (models[*place].images.len(), models[*place].points);
    match asked {
        None => Ok((0..models.len()).rev().max_by_key(size)),
        Some(_) if models.is_empty() => Ok(None),
        Some(number) => match models.iter().position(|model| model.number == number) {
            Some(place) => Ok(Some(place)),
            None => {
                let known: Vec<String> = models.iter().map(MadeModel::describe).collect();
                let reason = format!("there is no model {number}, only {}", known.join(", "));
                Err(PrepareError::Option { option: "--model", reason })
            }
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_model_is_chosen_by_images_then_by_points_unless_another_is_asked_for() {
        let models = [(0, 5, 900), (1, 12, 100), (2, 12, 300), (3, 12, 300)]
            .map(|(number, images, points)| MadeModel::example(number, images, points));
        assert_eq!(chosen(&models, None).expect("chosen"), Some(2));
        assert_eq!(chosen(&models, Some(0)).expect("chosen"), Some(0));
        assert_eq!(chosen(&[], Some(1)).expect("none"), None);
        let said = chosen(&models, Some(7)).expect_err("no such model").to_string();
        assert!(said.contains("no model 7") && said.contains("model 1 (12 images, 100 points)"), "{said}");
    }
}
