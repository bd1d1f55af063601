//! Masks that no image uses.

use std::path::Path;

use super::problem::{Problem, Subject};
use crate::readers::Reader;
use crate::scene::Scene;

/// A folder of masks beside the images that nothing is read from.
pub(super) fn ignored(reader: &Reader, folder: &Path, scene: &Scene) -> Option<Problem> {
    let what = (reader.hints.ignored_masks)(folder, scene)?;
    Some(Problem::warning(
        Subject::Masks,
        what,
        "Rename or list them as the format expects, if it reads any, or move them elsewhere; `eval.dynamic_masks` names those \
         that only scores use.",
    ))
}
