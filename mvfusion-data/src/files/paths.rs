//! Paths of the files that a scene refers to, and the name of the scene.

use std::borrow::Cow;
use std::path::{Component, Path, PathBuf};

/// The path of `name` below `folder`. The name is from a file. Scenes are shared between users, so no name may lead out
/// of the folder.
///
/// # Errors
/// If the name is empty, absolute, or leads upwards.
pub(crate) fn below(folder: &Path, name: &str) -> Result<PathBuf, String> {
    let slashed = with_slashes(folder, name);
    let path = Path::new(&*slashed);
    let inside = |part: Component<'_>| matches!(part, Component::Normal(_) | Component::CurDir);
    if path.components().all(inside) && path.file_name().is_some() {
        Ok(folder.join(path.strip_prefix("./").unwrap_or(path)))
    } else {
        Err(format!("the path `{name}` leads out of the folder; it must be relative and free of `..`"))
    }
}

/// A name from a file with slashes. Tools on Windows write `train\0001.png`, which elsewhere is the name of one file; if
/// there is such a file in `folder`, it is meant.
pub(crate) fn with_slashes<'a>(folder: &Path, name: &'a str) -> Cow<'a, str> {
    // Windows reads both alike.
    match cfg!(not(windows)) && name.contains('\\') && !folder.join(name).exists() {
        true => Cow::Owned(name.replace('\\', "/")),
        false => Cow::Borrowed(name),
    }
}

/// The scene's name for people, which is the name of the folder.
pub(crate) fn scene_name(folder: &Path) -> String {
    let folder = std::path::absolute(folder).unwrap_or_else(|_| folder.to_owned());
    folder.file_name().map_or_else(|| "scene".into(), |name| name.to_string_lossy().into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_stay_below_their_folder() {
        let folder = Path::new("scene");
        assert_eq!(below(folder, "./a/b.png"), Ok(PathBuf::from("scene/a/b.png")));
        assert_eq!(below(folder, "a/./b"), Ok(PathBuf::from("scene/a/b")));
        assert_eq!(below(folder, "a\\b.png"), Ok(PathBuf::from("scene/a/b.png")));
        for name in ["", ".", "..", "/etc/passwd", "a/../../b", "../b", "..\\b"] {
            let reason = below(folder, name).expect_err(name);
            assert!(reason.contains(&format!("`{name}`")), "{reason}");
        }
    }
}
