//! What COLMAP is given.

use std::path::Path;

/// The images that COLMAP places.
#[derive(Clone, Copy, Debug)]
pub(in super::super) struct Images<'a> {
    /// Their folder.
    pub(in super::super) folder: &'a Path,
    /// Their number.
    pub(in super::super) count: usize,
    /// Folder of masks `NAME.png.png`, black = ignored.
    pub(in super::super) masks: Option<&'a Path>,
    pub(in super::super) kind: Kind,
}

/// Where the images come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in super::super) enum Kind {
    /// One camera, no order.
    Photos,
    /// One camera, in order.
    Frames,
    /// A camera each.
    Rig,
}

/// How much effort the search for common features takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in super::super) enum Effort {
    /// COLMAP's defaults.
    Usual,
    /// Also weak and skewed features, for cameras that stand far apart. As many common ones are needed for a pose: with
    /// fewer, COLMAP places more cameras of a wide rig, and most of them in the wrong place.
    Wide,
}
