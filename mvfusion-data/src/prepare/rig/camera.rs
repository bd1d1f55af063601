//! A camera of a rig.

use std::sync::Arc;

use crate::prepare::sync::{Clip, Offset};
use crate::video::Video;

/// A camera of a rig.
pub(super) struct Camera {
    pub(super) video: Arc<Video>,
    /// Its number in the scene.
    pub(super) number: u32,
    pub(super) clip: Clip,
    pub(super) offset: Offset,
    /// Indices of the frames to take.
    pub(super) frames: Vec<usize>,
}

impl Camera {
    /// Index of the first frame to take.
    pub(super) fn first_frame(&self) -> usize {
        self.frames.first().copied().unwrap_or(0)
    }
}
