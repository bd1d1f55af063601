//! Names of photos as in SpotLessSplats: `2clutter008.png` trains, `1extra003.png` is held out.
//!
//! Numbers follow the order of the scene. Readers turn them into times: number / largest number.

use super::package::PictureEntry;
use crate::scene::{Scene, View};

/// Digits of the numbers, unless there are more photos. Names must sort like numbers.
const DIGITS: usize = 3;

/// The photos, training photos first. Images go to `images` below `inner`, masks to `masks`.
pub(super) fn entries<'a>(scene: &'a Scene, inner: &str) -> Vec<PictureEntry<'a>> {
    let most = scene.train.len().max(scene.test.len());
    let digits = most.saturating_sub(1).to_string().len().max(DIGITS);
    let part = |word: &str, views: &'a [View]| -> Vec<PictureEntry<'a>> {
        let entry = |(number, view): (usize, &'a View)| {
            let name = format!("{word}{number:0digits$}");
            let mask = view.mask.as_ref().map(|_| format!("{inner}masks/{name}.png"));
            PictureEntry { view, file: format!("{inner}images/{name}.png"), name, mask }
        };
        views.iter().enumerate().map(entry).collect()
    };
    [part("2clutter", &scene.train), part("1extra", &scene.test)].concat()
}
