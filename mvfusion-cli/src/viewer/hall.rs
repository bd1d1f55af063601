//! What all requests and conversations of a server share.

use std::sync::Arc;

use axum::body::Bytes;

use super::board::Board;
use super::desk::Desk;
use super::guard::Guard;
use super::photos::Photos;
use super::protocol::Limits;

/// What all requests share.
#[derive(Debug)]
pub struct Hall {
    /// Where requests are left.
    pub desk: Arc<Desk>,
    /// What all pages are told.
    pub board: Arc<Board>,
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
