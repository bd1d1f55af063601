//! The live viewer: a local server with one page, for a trained run and for one that trains.
//!
//! A thread of its own (`server.rs`) talks with the pages and computes nothing. Their [`requests`] wait until the
//! thread that owns the device takes them: the main thread, which either has nothing else to do (`mvfusion view`) or
//! trains (`mvfusion train --view`). The CPU ops need that thread, because it is part of the pool. What it renders
//! ([`renderer`]) goes back as a JPEG file ([`frame`]). What all pages are sent is the [`status`].
//!
//! Everything that a page may make grow has a bound: requests (one for each page), pages, connections, the length of a
//! message, cached moments, points of the curves.

pub mod address;
pub mod budget;
mod connection;
mod conversation;
pub mod facts;
pub mod frame;
pub mod guard;
pub mod moments;
mod photos;
pub mod protocol;
pub mod renderer;
pub mod requests;
mod server;
mod server_state;
pub mod status;
#[cfg(test)]
mod tests;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::time::Duration;

use mvfusion_data::Scene;

use address::BoundSocket;
use facts::RunFacts;
use frame::Answer;
use photos::Photos;
use renderer::FrameRenderer;
use requests::RequestQueue;
use server::Server;
use server_state::ServerState;
use status::{Status, StatusBoard};

/// A viewer that is served. It ends when it is dropped.
#[derive(Debug)]
pub struct Viewer {
    /// What pages ask for.
    pub requests: Arc<RequestQueue>,
    /// What all pages are sent.
    pub status: Arc<StatusBoard>,
    _server: Server,
}

impl Viewer {
    /// Starts to serve a run of a scene.
    ///
    /// # Errors
    /// If the system refuses the thread.
    pub fn start(socket: BoundSocket, scene: &Scene, run: &RunFacts<'_>, first: Status) -> anyhow::Result<Self> {
        let (requests, status) = (Arc::new(RequestQueue::default()), Arc::new(StatusBoard::new(first)));
        let state = ServerState {
            requests: Arc::clone(&requests),
            status: Arc::clone(&status),
            facts: facts::facts(scene, run)?,
            points: facts::points(scene),
            photos: Photos::of(scene),
            limits: facts::limits(scene),
            guard: socket.guard.clone(),
        };
        Ok(Self { requests, status, _server: Server::start(socket, state)? })
    }

    /// Renders the next request, if one comes in time.
    pub fn serve_next(&self, renderer: &mut FrameRenderer, timeout: Duration) -> bool {
        let Some((client, request)) = self.requests.take(timeout) else { return false };
        self.requests.answer(client, answered(request.id, || renderer.answer(&request)));
        true
    }
}

/// An answer, or a refusal where the render panics: for want of memory, a GPU's driver does. Whoever watches must not
/// end a training.
fn answered(id: u64, render: impl FnOnce() -> Answer) -> Answer {
    // A renderer has nothing half-done: it keeps a moment or a photo when it is complete.
    catch_unwind(AssertUnwindSafe(render)).unwrap_or_else(|_| {
        let reason = "the render failed, perhaps for want of memory; the terminal says more. Try a smaller image";
        Answer::Refused { id, reason: reason.to_owned() }
    })
}
