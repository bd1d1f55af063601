//! Problems with videos, and their remedies.

use std::path::{Path, PathBuf};

use crate::error::DataError;

/// Advice for a file that may be damaged.
pub(super) const CHECK_FILE: &str = "Check that the file is complete and plays, and copy it again if not.";

/// Advice for a file that has fewer frames than announced.
pub(super) const READ_FEWER: &str = "Check that the file is complete and plays, and copy it again if not; or read fewer \
                                     frames of all videos with `--set scene.frames=N`.";

/// Advice for a file that cannot be decoded here.
pub(super) const EXTRACT: &str = "Install the program ffmpeg, or turn the video into images on another computer: make \
                                  the folder NAME/images (in the layout of MultipleView, NAME), and in it \
                                  `ffmpeg -i VIDEO %04d.png`.";

/// Advice for a file that the built-in decoder might decode, in a program without it.
#[cfg(not(feature = "h264"))]
pub(super) const BUILD: &str = "Install the program ffmpeg, or build this program with `--features h264` for a \
                                built-in decoder, or turn the video into images on another computer: make the folder \
                                NAME/images (in the layout of MultipleView, NAME), and in it \
                                `ffmpeg -i VIDEO %04d.png`.";

/// A problem with a video. Unlike [`DataError`], it can be cloned and reported again.
#[derive(Clone, Debug)]
pub(super) struct Flaw {
    path: PathBuf,
    pub(super) reason: String,
    advice: &'static str,
}

impl Flaw {
    pub(super) fn new(path: &Path, reason: impl ToString, advice: &'static str) -> Self {
        Self { path: path.to_owned(), reason: reason.to_string(), advice }
    }

    /// The same for a program that reads whole videos, and has no option to read fewer frames.
    pub(super) fn of_whole_video(self) -> Self {
        let advice = if self.advice == READ_FEWER { CHECK_FILE } else { self.advice };
        Self { advice, ..self }
    }
}

impl From<Flaw> for DataError {
    fn from(Flaw { path, reason, advice }: Flaw) -> Self {
        DataError::Content { path, reason, advice }
    }
}
