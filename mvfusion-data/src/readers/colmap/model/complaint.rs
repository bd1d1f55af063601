//! Problems with files of a COLMAP model.

/// Advice for a damaged file.
const EXPORT_AGAIN: &str = "Copy the model again, or export it again with `colmap model_converter`";

/// A problem with a file of the model, and its remedy.
#[derive(Debug)]
pub(crate) struct Complaint {
    pub(crate) reason: String,
    pub(crate) advice: &'static str,
}

impl From<String> for Complaint {
    fn from(reason: String) -> Self {
        Self { reason, advice: EXPORT_AGAIN }
    }
}
