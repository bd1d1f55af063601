//! The smallest scene that a layout can hold.

use std::path::Path;

use mvfusion_data::{BuiltinKind, BuiltinOptions, Capture, Layout, builtin, write};

/// Writes a sound scene of a layout: pictures of 16 x 16, three photos or two frames of each camera.
pub fn write_small(layout: Layout, folder: &Path) {
    let kind = match layout.capture() {
        Capture::Video => BuiltinKind::Video,
        Capture::Photos => BuiltinKind::Casual,
    };
    let options = BuiltinOptions { kind, width: 16, height: 16, frames: 2, photos: 2, test_photos: 1, seed: 1 };
    write(&builtin::builtin(&options), layout, folder).expect("written");
}
