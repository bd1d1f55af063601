//! In the place of the viewer of a training, in builds without it.

use super::session::Session;
use super::watch::Watch;
use crate::args::TrainArgs;
use crate::run::MetricsLine;

/// No socket.
pub(super) type ViewerSocket = ();

/// Opens nothing.
///
/// # Errors
/// Never.
pub(super) fn bind_viewer(_: &TrainArgs) -> anyhow::Result<ViewerSocket> {
    Ok(())
}

/// Nothing: no value of this type exists.
pub(super) enum Live {}

impl Live {
    pub(super) fn start((): ViewerSocket, _: &Session) -> anyhow::Result<Option<Self>> {
        Ok(None)
    }

    pub(super) fn log(&mut self, _: &MetricsLine) {}

    pub(super) fn training_done(&self) {}
}

impl Session {
    pub(super) fn serve_viewer(&mut self, _: &mut Watch) {}
}
