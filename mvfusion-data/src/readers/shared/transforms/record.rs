//! The entries of a `transforms.json`, as stored.

use std::fmt;

use serde::de::{Error, Unexpected, Visitor};
use serde::{Deserialize, Deserializer};

/// A number, or one in quotes, as nerfstudio's converter of RealityCapture writes coefficients.
fn number<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<f64>, D::Error> {
    struct Number;

    impl<'de> Visitor<'de> for Number {
        type Value = Option<f64>;

        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str("a number")
        }

        fn visit_unit<E>(self) -> Result<Self::Value, E> {
            Ok(None)
        }

        fn visit_f64<E>(self, value: f64) -> Result<Self::Value, E> {
            Ok(Some(value))
        }

        fn visit_i64<E>(self, value: i64) -> Result<Self::Value, E> {
            Ok(Some(value as f64))
        }

        fn visit_u64<E>(self, value: u64) -> Result<Self::Value, E> {
            Ok(Some(value as f64))
        }

        fn visit_str<E: Error>(self, text: &str) -> Result<Self::Value, E> {
            text.trim().parse().map(Some).map_err(|_| E::invalid_value(Unexpected::Str(text), &self))
        }
    }

    deserializer.deserialize_any(Number)
}

/// The file as stored, without the intrinsics at its top. Unknown entries are skipped, because every tool adds its own.
#[derive(Debug, Deserialize)]
pub(super) struct FileRecord {
    pub(super) frames: Vec<FrameRecord>,
    pub(super) ply_file_path: Option<String>,
    pub(super) train_filenames: Option<Vec<String>>,
    pub(super) val_filenames: Option<Vec<String>>,
    pub(super) test_filenames: Option<Vec<String>>,
}

/// The records with the entries of a lens. All except two of these entries are numbers. (`serde(flatten)` would be
/// shorter, but it keeps every unknown entry in memory, at many times its size in the file.)
macro_rules! records {
    ($($number:ident)*) => {
        /// Intrinsics, at the top of the file or in a frame.
        #[derive(Debug, Deserialize)]
        pub(super) struct LensRecord {
            pub(super) camera_model: Option<String>,
            pub(super) is_fisheye: Option<bool>,
            $(#[serde(default, deserialize_with = "number")] pub(super) $number: Option<f64>,)*
        }

        /// A frame as stored.
        #[derive(Debug, Deserialize)]
        pub(super) struct FrameRecord {
            pub(super) file_path: String,
            pub(super) transform_matrix: Vec<Vec<f64>>,
            pub(super) time: Option<f64>,
            pub(super) timestamp: Option<f64>,
            pub(super) mask_path: Option<String>,
            pub(super) camera_model: Option<String>,
            pub(super) is_fisheye: Option<bool>,
            $(#[serde(default, deserialize_with = "number")] pub(super) $number: Option<f64>,)*
        }

        impl FrameRecord {
            /// The frame's own intrinsics. Missing entries come from `common`.
            pub(super) fn lens_or(&self, common: &LensRecord) -> LensRecord {
                LensRecord {
                    camera_model: self.camera_model.clone().or_else(|| common.camera_model.clone()),
                    is_fisheye: self.is_fisheye.or(common.is_fisheye),
                    $($number: self.$number.or(common.$number),)*
                }
            }
        }
    };
}

records!(camera_angle_x camera_angle_y fl_x fl_y cx cy w h k1 k2 k3 k4 k5 k6 p1 p2);
