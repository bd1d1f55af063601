//! Poses by the program COLMAP, which must be installed.

mod attempt;
mod images;
mod models;
mod program;
mod step;

use std::fs;
use std::path::Path;

use super::error::PrepareError;
use super::event::{Listener, Tell};
use super::options::ColmapOptions;
use attempt::Attempt;
pub(super) use images::{Effort, Images, Kind};
pub(super) use models::{MadeModel, chosen};
use program::Program;
pub(super) use step::Log;

/// Runs COLMAP.
#[derive(Clone, Debug)]
pub(super) struct Colmap<'a> {
    program: Program,
    options: &'a ColmapOptions,
}

impl<'a> Colmap<'a> {
    /// Finds the program.
    ///
    /// # Errors
    /// [`PrepareError::NoColmap`], or if the listener ends it.
    pub(super) fn find(options: &'a ColmapOptions, listen: &mut Listener<'_>) -> Result<Self, PrepareError> {
        let program = Program::find(options.program.as_deref())?;
        if program.is_old() {
            let version = program.version();
            listen.note(format!("COLMAP {version} is older than 3.8, the oldest version that was tried"))?;
        }
        Ok(Self { program, options })
    }

    /// The program's version.
    pub(super) fn version(&self) -> &str {
        self.program.version()
    }

    /// The models of images, which are made in the folder `work`.
    ///
    /// # Errors
    /// [`PrepareError::Step`] if a step fails, or if the listener ends it. That no model could be made is no error:
    /// there is none then. If the last step fails after it has made some, a note says so.
    pub(super) fn models(
        &self,
        images: Images<'_>,
        effort: Effort,
        work: &Path,
        log: &mut Log,
        listen: &mut Listener<'_>,
    ) -> Result<Vec<MadeModel>, PrepareError> {
        let (database, sparse) = (work.join("database.db"), work.join("sparse"));
        // An earlier attempt lies there.
        let _ = fs::remove_file(&database);
        let _ = fs::remove_dir_all(&sparse);
        fs::create_dir_all(&sparse).map_err(|error| PrepareError::unwritable(&sparse, error))?;
        let Self { program, options } = self;
        let is_gpu = effort == Effort::Usual && program.uses_gpu(options.gpu);
        let mut attempt = Attempt { program, options, images, effort, is_gpu, database: &database, log, listen };
        attempt.extract()?;
        attempt.compare()?;
        let mapped = attempt.map(&sparse);
        if matches!(mapped, Err(PrepareError::Interrupted)) {
            return Err(PrepareError::Interrupted);
        }
        let models = MadeModel::all(&sparse)?;
        match mapped {
            // It also fails if it found no model, and says so.
            Err(PrepareError::Step { said, .. }) if models.is_empty() && is_no_model(&said) => Ok(models),
            Err(error) if models.is_empty() => Err(error),
            Err(error) => {
                let (reason, count) = (error.in_short(), models.len());
                listen.note(format!("{reason}; models that it had made by then are used, {count} in number"))?;
                Ok(models)
            }
            Ok(()) => Ok(models),
        }
    }
}

/// Whether the mapper's last words are that it made no model.
fn is_no_model(said: &str) -> bool {
    ["failed to create sparse model", "No good initial image pair", "no images with matches", "No images with matches"]
        .iter()
        .any(|words| said.contains(words))
}
