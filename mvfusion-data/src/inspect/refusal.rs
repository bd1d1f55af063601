//! Errors of a reader as problems with remedies.

use std::path::Path;

use super::problem::{Problem, Subject};
use crate::error::{DataError, MAKE_READABLE, REPLACE_IMAGE, Refusal};
use crate::files::pictures_in;
use crate::prepare::is_video;
use crate::readers::{Format, recognise};

/// Maximum number of subfolders to search for a scene.
const LOOKED_INTO: usize = 100;

/// The problem for a reader's error.
pub(super) fn problem(error: &DataError) -> Problem {
    let (what, remedy) = match error {
        DataError::Image { path, reason } => {
            (format!("cannot read the image {}: {reason}", path.display()), REPLACE_IMAGE.into())
        }
        DataError::Denied { path } => {
            (format!("cannot read {}: permission denied", path.display()), MAKE_READABLE.into())
        }
        DataError::Folder { folder, reason, advice } => {
            (format!("cannot open the folder {}: {reason}", folder.display()), stopped(advice))
        }
        DataError::Missing { what, folder, advice } => {
            (format!("there is no {what} in {}", folder.display()), stopped(advice))
        }
        DataError::Content { path, reason, advice } => {
            (format!("cannot use {}: {reason}", path.display()), stopped(advice))
        }
        DataError::Disagreement { folder, first, second, advice } => {
            (format!("{}: {first}, but {second}", folder.display()), stopped(advice))
        }
        DataError::Setting { option, value, reason, advice } => {
            (format!("scene.{option} = {value} cannot be used: {reason}"), stopped(advice))
        }
        DataError::Scene { scene, reason, advice } => {
            (format!("the scene {scene} cannot be used: {reason}"), stopped(advice))
        }
        DataError::Unrecognised { folder, refusals } => (unrecognised(folder, refusals), where_to_look(folder)),
    };
    Problem::error(Subject::Reading, what, remedy)
}

fn stopped(advice: &str) -> String {
    if advice.ends_with('.') { advice.into() } else { format!("{advice}.") }
}

/// The reasons of all formats, one per line.
fn unrecognised(folder: &Path, refusals: &[Refusal]) -> String {
    let listed: String = refusals.iter().map(|refusal| format!("\n{refusal}")).collect();
    format!("{} is in no format that can be read{listed}", folder.display())
}

/// A hint for a folder without a scene.
fn where_to_look(folder: &Path) -> String {
    if let Ok(format) = recognise(folder, None) {
        return format!("It is a scene of the format {0}: leave out --format, or give --format {0}.", format.key());
    }
    if let Some((inner, format)) = scene_within(folder) {
        return format!("Give a folder that holds one scene, such as {inner} ({}).", format.name());
    }
    let holds_pictures = |folder: &Path| pictures_in(folder).is_ok_and(|pictures| !pictures.is_empty());
    if holds_pictures(folder) || holds_pictures(&folder.join("images")) {
        return "It holds images but no cameras: `mvfusion prepare` finds them with COLMAP. So does nerfstudio's \
                `ns-process-data`, which writes transforms.json."
            .into();
    }
    let holds_videos = std::fs::read_dir(folder)
        .is_ok_and(|mut entries| entries.any(|entry| entry.is_ok_and(|entry| is_video(&entry.path()))));
    if holds_videos {
        return "It holds videos but no cameras: `mvfusion prepare` finds them with COLMAP.".into();
    }
    "Add what is missing for one of the formats, or give the folder that lies right above the files they name.".into()
}

/// The first subfolder that contains a scene. Otherwise, the parent folder is tried, for users who give `images`
/// itself.
fn scene_within(folder: &Path) -> Option<(String, Format)> {
    let below = std::fs::read_dir(folder).ok()?.filter_map(|entry| Some(entry.ok()?.path()));
    let hidden = |path: &Path| path.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.'));
    let mut candidates: Vec<_> = below.filter(|path| path.is_dir() && !hidden(path)).take(LOOKED_INTO).collect();
    candidates.sort();
    candidates.extend(std::path::absolute(folder).ok().and_then(|path| Some(path.parent()?.to_owned())));
    candidates.into_iter().find_map(|path| Some((path.display().to_string(), recognise(&path, None).ok()?)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scene_of_another_format_is_told_by_the_key_that_the_option_takes() {
        let folder = tempfile::tempdir().expect("folder");
        for name in ["images", "sparse"] {
            std::fs::create_dir(folder.path().join(name)).expect("made");
        }
        let said = where_to_look(folder.path());
        assert!(said.contains("--format colmap"), "{said}");
    }
}
