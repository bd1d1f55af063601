//! What is to be prepared: photos, one video, or one video for each camera of a rig.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use super::error::PrepareError;
use crate::files::entries;

/// Extensions of photos that COLMAP reads.
const PHOTOS: [&str; 3] = ["png", "jpg", "jpeg"];

/// Extensions of videos.
const VIDEOS: [&str; 10] = ["mp4", "mov", "m4v", "mkv", "webm", "avi", "mts", "m2ts", "mpg", "3gp"];

/// Extensions of pictures that are not read. COLMAP reads some of them, and training does not. EXR is the reverse.
const OTHER_PICTURES: [&str; 18] = [
    "heic", "heif", "avif", "webp", "jxl", "jp2", "tif", "tiff", "bmp", "gif", "exr", "dng", "cr2", "cr3", "nef",
    "arw", "raf", "orf",
];

/// Fewest photos from which COLMAP can compute poses.
const FEWEST_PHOTOS: usize = 3;

/// Whether a file is a video by its name.
pub(crate) fn is_video(path: &Path) -> bool {
    has(path, &VIDEOS)
}

/// What is to be prepared.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Input {
    /// Photos of one place, sorted by name.
    Photos(Vec<PathBuf>),
    /// The video of one moving camera.
    Video(PathBuf),
    /// The videos of still cameras, sorted by name.
    Rig(Vec<PathBuf>),
}

impl Input {
    /// Looks at a file or folder.
    ///
    /// # Errors
    /// [`PrepareError::Input`] if it holds none of the three.
    pub(super) fn of(path: &Path) -> Result<Self, PrepareError> {
        let refused = |reason: String| PrepareError::Input { input: path.to_owned(), reason };
        if path.is_file() {
            return match has(path, &VIDEOS) {
                true => Ok(Self::Video(path.to_owned())),
                false => Err(refused(format!(
                    "it is a file, but no video ({}); photos and the videos of a rig are given by their folder",
                    VIDEOS.join(", ")
                ))),
            };
        }
        let files = entries(path, "Give a folder of photos, a video, or a folder with a video for each camera")?;
        let of = |kinds: &[&str]| -> Vec<PathBuf> {
            files.iter().filter(|file| has(file, kinds) && file.is_file()).cloned().collect()
        };
        let (photos, mut videos) = (of(&PHOTOS), of(&VIDEOS));
        let and_others = || left_out(&files).map(|others| format!("; {others}")).unwrap_or_default();
        match (photos.len(), videos.len()) {
            (0, 0) => Err(refused(format!(
                "it holds neither photos ({}) nor videos ({}); subfolders are not searched{}",
                PHOTOS.join(", "),
                VIDEOS.join(", "),
                and_others()
            ))),
            (0, 1) => Ok(Self::Video(videos.remove(0))),
            (0, _) => Ok(Self::Rig(videos)),
            (few, 0) if few < FEWEST_PHOTOS => {
                let others = and_others();
                Err(refused(format!("it holds {few} photos, and poses need at least {FEWEST_PHOTOS}{others}")))
            }
            (_, 0) => Ok(Self::Photos(photos)),
            (photos, videos) => {
                Err(refused(format!("it holds {photos} photos and {videos} videos: give a folder with one of the two")))
            }
        }
    }

    /// The pictures beside photos that are left out, in words.
    pub(super) fn left_out(&self) -> Option<String> {
        let Self::Photos(photos) = self else { return None };
        left_out(&entries(photos.first()?.parent()?, "").ok()?)
    }
}

/// The pictures among files that are not read, in words.
fn left_out(files: &[PathBuf]) -> Option<String> {
    let others = || files.iter().filter(|file| has(file, &OTHER_PICTURES) && file.is_file());
    let kinds: BTreeSet<String> =
        others().filter_map(|file| Some(file.extension()?.to_str()?.to_ascii_lowercase())).collect();
    let kinds: Vec<String> = kinds.into_iter().collect();
    (!kinds.is_empty()).then(|| {
        format!(
            "{} images of other kinds ({}) are left out: convert them to {} to use them",
            others().count(),
            kinds.join(", "),
            PHOTOS[..2].join(" or ")
        )
    })
}

/// Whether a path ends in one of these extensions and is not hidden.
fn has(path: &Path, extensions: &[&str]) -> bool {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("").to_ascii_lowercase();
    // macOS creates a file `._a.jpg` next to each `a.jpg` on foreign disks.
    let is_hidden = path.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.'));
    extensions.contains(&extension.as_str()) && !is_hidden
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    fn folder(names: &[&str]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().expect("folder");
        names.iter().for_each(|name| fs::write(folder.path().join(name), "").expect("written"));
        folder
    }

    #[test]
    fn photos_a_video_and_a_rig_are_told_apart() {
        let photos = folder(&["b.JPG", "a.png", "c.jpeg", "._c.jpeg", "notes.txt"]);
        let names = ["a.png", "b.JPG", "c.jpeg"].map(|name| photos.path().join(name)).to_vec();
        assert_eq!(Input::of(photos.path()).expect("photos"), Input::Photos(names));
        let rig = folder(&["cam01.mp4", "cam00.MOV"]);
        let names = ["cam00.MOV", "cam01.mp4"].map(|name| rig.path().join(name));
        assert_eq!(Input::of(rig.path()).expect("a rig"), Input::Rig(names.to_vec()));
        assert_eq!(Input::of(&names[0]).expect("a video"), Input::Video(names[0].clone()));
        let one = folder(&["walk.mp4"]);
        assert_eq!(Input::of(one.path()).expect("a video"), Input::Video(one.path().join("walk.mp4")));
    }

    #[test]
    fn pictures_that_are_not_read_are_counted_with_their_kinds() {
        let mixed = folder(&["a.jpg", "b.jpg", "c.jpg", "d.HEIC", "e.heic", "f.tif", "._g.heic", "notes.txt"]);
        let said = Input::of(mixed.path()).expect("photos").left_out().expect("some are left out");
        assert_eq!(said, "3 images of other kinds (heic, tif) are left out: convert them to png or jpg to use them");
        let pure = folder(&["a.jpg", "b.jpg", "c.jpg", "notes.txt"]);
        assert_eq!(Input::of(pure.path()).expect("photos").left_out(), None);
        for names in [&["a.heic", "b.heic"][..], &["a.jpg", "b.heic"]] {
            let said = Input::of(folder(names).path()).expect_err("refused").to_string();
            assert!(said.contains("images of other kinds (heic) are left out"), "{said}");
        }
    }

    #[test]
    fn anything_else_is_refused_with_what_is_there() {
        for (names, part) in [
            (&[][..], "neither photos"),
            (&["a.jpg", "b.jpg"], "2 photos"),
            (&["a.jpg", "b.jpg", "c.jpg", "d.mp4"], "3 photos and 1 videos"),
        ] {
            let said = Input::of(folder(names).path()).expect_err("refused").to_string();
            assert!(said.contains(part), "{said}");
        }
        let file = folder(&["notes.txt"]);
        let said = Input::of(&file.path().join("notes.txt")).expect_err("refused").to_string();
        assert!(said.contains("no video"), "{said}");
        assert!(matches!(Input::of(Path::new("no/such")), Err(PrepareError::Data(_))));
    }
}
