//! Videos, which are renamed to their final path when they are complete.

use std::path::{Path, PathBuf};

use anyhow::Context;
use image::RgbImage;
use mvfusion_data::VideoWriter;
use tempfile::TempPath;

use crate::atomic::beside;

/// A video in progress.
pub(super) struct Mp4Writer {
    path: PathBuf,
    /// Dropped before its file, because some systems do not remove an open file.
    video: VideoWriter,
    file: TempPath,
}

impl Mp4Writer {
    /// A video with frames of `size`.
    pub(super) fn create(path: &Path, size: (u32, u32), fps: f64) -> anyhow::Result<Self> {
        let file = beside(path).with_context(|| format!("cannot write {}", path.display()))?.into_temp_path();
        Ok(Self { path: path.to_owned(), video: VideoWriter::create(&file, size, fps)?, file })
    }

    /// Adds a frame.
    pub(super) fn add(&mut self, picture: &RgbImage) -> anyhow::Result<()> {
        Ok(self.video.add(picture)?)
    }

    /// Ends the video.
    pub(super) fn finish(self) -> anyhow::Result<()> {
        self.video.finish()?;
        self.file.persist(&self.path).with_context(|| format!("cannot write {}", self.path.display()))
    }
}
