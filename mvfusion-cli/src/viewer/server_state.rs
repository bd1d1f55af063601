//! What all requests and conversations of a server share.

use std::sync::Arc;

use axum::body::Bytes;

use super::guard::Guard;
use super::photos::Photos;
use super::protocol::Limits;
use super::requests::RequestQueue;
use super::status::StatusBoard;

/// What all requests share.
#[derive(Debug)]
pub struct ServerState {
    /// The requests of pages.
    pub requests: Arc<RequestQueue>,
    /// What all pages are sent.
    pub status: Arc<StatusBoard>,
    /// The facts of the scene, as JSON.
    pub facts: Bytes,
    /// The points of the scene.
    pub points: Bytes,
    /// Its photos.
    pub photos: Photos,
    /// What is granted.
    pub limits: Limits,
    /// Who may ask.
    pub guard: Guard,
}
