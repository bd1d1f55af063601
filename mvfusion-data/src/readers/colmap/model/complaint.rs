//! What is wrong with a file of a COLMAP model.

/// Advice for a damaged file.
const EXPORT_AGAIN: &str = "Copy the model again, or export it again with `colmap model_converter`";

/// What is wrong with a file of the model, and what to do about it.
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
