//! Constants of the training objective: how the branches are blended, and where a term counts (METHOD §1.3, §4.4).

/// Brightness control above which the brightness rises steeply.
pub const BRIGHTNESS_KNEE: f64 = 0.75;
/// Slope above the knee: from 0.75 to 10 over the last quarter.
pub const BRIGHTNESS_SLOPE: f64 = (10.0 - BRIGHTNESS_KNEE) / (1.0 - BRIGHTNESS_KNEE);
/// Brightness at control 0.
pub const BRIGHTNESS_OFFSET: f64 = 0.5;

/// Bias of the mask towards the background in the first stage.
pub const GEOMETRY_LEAN: f64 = 0.25;
/// Lower bound of the mask's normaliser in the first stage, where the bias can cancel (METHOD §12, item 6).
pub const MIN_GEOMETRY_NORMALISER: f64 = 1e-3;
/// Added to both probabilities in the later stages, so that their sum is never zero.
pub const SHARE_GUARD: f64 = 1e-6;

/// Factor of the photo in the comparison with the mean of both branches in the first stage.
pub const GEOMETRY_DARKENING: f64 = 0.9;

/// Mask value above which the foreground must not resemble the background.
pub const DYNAMIC: f64 = 0.51;
/// Mask value above which the foreground must be in front.
pub const SURELY_DYNAMIC: f64 = 0.6;
/// Mask value below which it must be behind.
pub const SURELY_STATIC: f64 = 0.4;

/// Keeps the logarithm of the mask's entropy finite.
pub const ENTROPY_GUARD: f64 = 1e-6;
