//! Whether pictures may be those that their cameras were made for.

use std::path::Path;

use tracing::info;

use crate::DataError;
use crate::shot::{FrameLens, Shot};

/// Makes sure that pictures of `size` pixels have the shape of those that their lenses are for, if perhaps scaled.
///
/// # Errors
/// [`DataError::Disagreement`] if no common factor leads from the one to the other.
pub(crate) fn check_shapes(folder: &Path, (width, height): (u32, u32), shots: &[Shot]) -> Result<(), DataError> {
    let mut scaled = None;
    for shot in shots {
        let FrameLens::Known { size: full, .. } = shot.lens else { continue };
        if (full.x, full.y) == (f64::from(width), f64::from(height)) {
            continue;
        }
        if !is_scaled((full.x, full.y), (f64::from(width), f64::from(height))) {
            return Err(DataError::Disagreement {
                folder: folder.to_owned(),
                first: format!("the pictures have {width} x {height} pixels"),
                second: format!("the camera of {} is for {} x {}", shot.name, full.x, full.y),
                advice:
                    "Use the pictures that the cameras were made from, or copies scaled by one factor along both sides"
                        .into(),
            });
        }
        scaled = Some(full);
    }
    if let Some(full) = scaled {
        info!(
            "the pictures have {width}x{height} pixels, their cameras are for {}x{}: \
             focal lengths and principal points are scaled to the pictures",
            full.x, full.y
        );
    }
    Ok(())
}

/// Whether one factor takes both sides of the larger picture to those of the smaller, each rounded to the nearest pixel, or
/// each rounded down.
fn is_scaled(one: (f64, f64), other: (f64, f64)) -> bool {
    /// How far a side before rounding may lie below and above the one after it.
    const ROUNDING: [(f64, f64); 2] = [(0.5, 0.5), (0.0, 1.0)];
    let (full, scaled) = if one.0 < other.0 { (other, one) } else { (one, other) };
    // A fraction of a pixel is within the rounding of any shape.
    scaled.0.min(scaled.1) >= 1.0
        && ROUNDING.iter().any(|(below, above)| {
            let factors = |full: f64, scaled: f64| ((scaled - below) / full, (scaled + above) / full);
            let (x, y) = (factors(full.0, scaled.0), factors(full.1, scaled.1));
            x.0.max(y.0) < x.1.min(y.1)
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scaled_copies_are_accepted_however_their_sides_were_rounded() {
        for (full, factor) in
            [((4032.0, 3024.0), 8.0), ((1003.0, 667.0), 8.0), ((1000.0, 671.0), 8.0), ((31.0, 17.0), 4.0)]
        {
            let (x, y) = (full.0 / factor, full.1 / factor);
            assert!(is_scaled(full, (f64::round(x), f64::round(y))), "{full:?} / {factor}, rounded");
            assert!(is_scaled(full, (f64::floor(x), f64::floor(y))), "{full:?} / {factor}, rounded down");
            assert!(is_scaled((x.round(), y.round()), full), "enlarged again");
        }
    }

    #[test]
    fn other_shapes_are_refused() {
        for (full, scaled) in [
            ((1000.0, 667.0), (125.0, 85.0)),
            ((48.0, 32.0), (32.0, 48.0)),
            ((1352.0, 1014.0), (1350.0, 1014.0)),
            ((48.0, 32.0), (0.3, 0.1)),
        ] {
            assert!(!is_scaled(full, scaled), "{full:?} -> {scaled:?}");
        }
    }
}
