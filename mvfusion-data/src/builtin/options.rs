//! Options of the built-in scenes.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Kind of the built-in scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum BuiltinKind {
    /// Eight synchronised cameras. The first, in the middle of the others, is held out. A block flies and tumbles, a
    /// lamp barely sways, and a visitor comes and goes.
    #[default]
    Video,
    /// The same cameras, with what is harder to follow: a fast ball, a block that slides behind it, a tentacle that
    /// bends, and a blob that hops and changes its size.
    Motion,
    /// Single photos from a walk. People and objects in them are gone or elsewhere in the next photo. Ten empty photos
    /// from poses in between are held out.
    Casual,
}

impl BuiltinKind {
    /// All kinds.
    pub const ALL: [Self; 3] = [Self::Video, Self::Motion, Self::Casual];

    /// Its name in a configuration (`scene.kind`) and on the command line.
    pub fn key(self) -> &'static str {
        match self {
            Self::Video => "video",
            Self::Motion => "motion",
            Self::Casual => "casual",
        }
    }

    /// The kind with the given key.
    pub fn of_key(key: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.key() == key)
    }
}

/// Options of a built-in scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BuiltinOptions {
    /// Which scene. Default: video.
    pub kind: BuiltinKind,
    /// Seed of everything random: patterns, noise of the points, camera shake, passers-by. Default 0.
    pub seed: u64,
    /// Width of the images in pixels, at least 16. Default 160.
    pub width: usize,
    /// Height of the images in pixels, at least 16. Default 120.
    pub height: usize,
    /// Frames of each camera of the video, at least 1. Default 24.
    pub frames: usize,
    /// Training photos of the casual scene, at least 2. Default 60.
    pub photos: usize,
    /// Held-out photos of the casual scene. Default 10.
    pub test_photos: usize,
}

impl Default for BuiltinOptions {
    fn default() -> Self {
        Self { kind: BuiltinKind::Video, seed: 0, width: 160, height: 120, frames: 24, photos: 60, test_photos: 10 }
    }
}

impl BuiltinOptions {
    /// The default scene of a kind.
    pub fn of_kind(kind: BuiltinKind) -> Self {
        Self { kind, ..Self::default() }
    }

    /// Raises numbers that are too small to the minimum for a scene.
    pub(super) fn at_least(self) -> Self {
        Self {
            width: self.width.max(16),
            height: self.height.max(16),
            frames: self.frames.max(1),
            photos: self.photos.max(2),
            ..self
        }
    }

    /// The part of the seed that patterns use: 32 bits.
    pub(super) fn pattern_seed(&self) -> u32 {
        (self.seed ^ (self.seed >> 32)) as u32
    }
}
