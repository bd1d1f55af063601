//! The live viewer: a local server with one page, for a trained run and for one that trains.
//!
//! A thread of its own (`server.rs`) talks with the pages and computes nothing. Their requests lie on the [`desk`]
//! until the thread that owns the device takes them: the main thread, which either has nothing else to do (`mvfusion view`)
//! or trains (`mvfusion train --view`). The CPU ops need that thread, because it is part of the pool. What it renders
//! ([`painter`]) goes back as a JPEG file ([`frame`]). What all pages are told stands on the [`board`].
//!
//! Everything that a page may make grow has a bound: requests (one for each page), pages, connections, the length of a
//! message, cached moments, points of the curves.

pub mod address;
pub mod board;
pub mod budget;
mod connection;
pub mod desk;
pub mod facts;
pub mod frame;
pub mod guard;
mod hall;
pub mod moments;
pub mod painter;
mod photos;
pub mod protocol;
mod server;
mod session;
#[cfg(test)]
mod tests;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::time::Duration;

use mvfusion_data::Scene;

use address::Listening;
use board::{Board, Status};
use desk::Desk;
use facts::RunFacts;
use frame::Answer;
use hall::Hall;
use painter::Painter;
use photos::Photos;
use server::Server;

/// A viewer that is served. It ends when it is dropped.
#[derive(Debug)]
pub struct Viewer {
    /// Where pages leave their requests.
    pub desk: Arc<Desk>,
    /// What all pages are told.
    pub board: Arc<Board>,
    _server: Server,
}

impl Viewer {
    /// Starts to serve a run of a scene.
    ///
    /// # Errors
    /// If the system refuses the thread.
    pub fn start(listening: Listening, scene: &Scene, run: &RunFacts<'_>, status: Status) -> anyhow::Result<Self> {
        let (desk, board) = (Arc::new(Desk::default()), Arc::new(Board::new(status)));
        let hall = Hall {
            desk: Arc::clone(&desk),
            board: Arc::clone(&board),
            facts: facts::facts(scene, run)?,
            points: facts::points(scene),
            photos: Photos::of(scene),
            limits: facts::limits(scene),
            guard: listening.guard.clone(),
        };
        Ok(Self { desk, board, _server: Server::start(listening, hall)? })
    }

    /// Renders the next request, if one comes in time.
    pub fn serve_next(&self, painter: &mut Painter, patience: Duration) -> bool {
        let Some((seat, request)) = self.desk.take(patience) else { return false };
        self.desk.answer(seat, answered(request.id, || painter.answer(&request)));
        true
    }
}

/// An answer, or a refusal where the render panics: for want of memory, a GPU's driver does. Whoever watches must not
/// end a training.
fn answered(id: u64, render: impl FnOnce() -> Answer) -> Answer {
    // A painter has nothing half-done: it keeps a moment or a photo when it is complete.
    catch_unwind(AssertUnwindSafe(render)).unwrap_or_else(|_| {
        let reason = "the render failed, perhaps for want of memory; the terminal says more. Try a smaller image";
        Answer::Refused { id, reason: reason.to_owned() }
    })
}
