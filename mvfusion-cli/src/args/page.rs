//! Arguments of `mvfusion export --html`.

use std::path::PathBuf;

use bytesize::ByteSize;
use clap::Args;

use super::numbers::parse_bytes;

/// Size of a page if none is asked for.
const DEFAULT_SIZE: ByteSize = ByteSize::mb(20);

/// The page that plays a scene.
#[derive(Clone, Debug, Args)]
pub struct PageArgs {
    /// Write one HTML file that plays the scene in a browser, instead of a folder [default: RUN/scene.html]
    ///
    /// The page needs WebGL 2 and no network. Its Gaussians are quantised; the PSNR that is printed compares them,
    /// rendered by this program, with the images of `mvfusion render`.
    #[arg(long, value_name = "FILE", num_args = 0..=1, require_equals = true)]
    #[arg(conflicts_with_all = ["out", "format", "time", "frames", "shared_static", "samples", "precision"])]
    pub html: Option<Option<PathBuf>>,
    /// Largest size of the HTML file
    ///
    /// Until it fits, these are left out, in this order: precision, twice; keyframes between training times; a fifth of
    /// the Gaussians, those that contribute least to the training views; the highest degree of the colours; every other
    /// keyframe, as long as 12 are left; more Gaussians and degrees in turn; more Gaussians and keyframes.
    #[arg(long, value_name = "SIZE", default_value_t = DEFAULT_SIZE, value_parser = parse_bytes, requires = "html")]
    pub size: ByteSize,
}

impl Default for PageArgs {
    fn default() -> Self {
        Self { html: None, size: DEFAULT_SIZE }
    }
}
