//! The conversation with one page over its WebSocket.

use std::sync::Arc;
use std::time::Duration;

use axum::body::Bytes;
use axum::extract::ws::{CloseFrame, Message as Packet, WebSocket, close_code};
use serde::Serialize;
use tokio::sync::watch::{self, error::RecvError};
use tokio::time::{Instant, interval, sleep_until, timeout};

use super::board::{CurvePoint, Status};
use super::desk::Client;
use super::frame::Answer;
use super::hall::Hall;
use super::protocol::Message;

/// A page that takes nothing for so long is given up.
const PATIENCE: Duration = Duration::from_secs(30);
/// A page that is turned away has so long to close its side.
const FAREWELL: Duration = Duration::from_secs(5);
/// What it is told. The reason of a closed socket has at most 123 bytes.
pub(super) const TOO_MANY: &str = "Too many pages are open. Close one of them.";
/// Time between two pings, which keep the connection open.
const PING: Duration = Duration::from_secs(20);
/// Shortest time between two words about the state.
const NEWS: Duration = Duration::from_millis(100);
/// So many malformed messages of a page are answered. The others are dropped.
const MOST_COMPLAINTS: usize = 20;

/// What the page is told in words.
#[derive(Serialize)]
#[serde(tag = "type", rename_all = "snake_case")]
enum Said<'a> {
    /// The state, and the points of the curves since the last time.
    Status {
        #[serde(flatten)]
        status: &'a Status,
        curves: Vec<CurvePoint>,
    },
    /// There is no picture.
    Refused {
        #[serde(skip_serializing_if = "Option::is_none")]
        id: Option<u64>,
        reason: &'a str,
    },
}

/// Closes the conversation with a page for which there is no place, and says why.
pub async fn turn_away(mut socket: WebSocket) {
    let frame = CloseFrame { code: close_code::AGAIN, reason: TOO_MANY.into() };
    let farewell = async {
        if socket.send(Packet::Close(Some(frame))).await.is_ok() {
            // The other side confirms. A connection that were dropped before might lose the reason.
            while let Some(Ok(_)) = socket.recv().await {}
        }
    };
    // A page that does not confirm is dropped all the same.
    let _ = timeout(FAREWELL, farewell).await;
}

/// Talks with a page until it leaves.
pub async fn run(mut socket: WebSocket, hall: Arc<Hall>, mut client: Client) {
    let mut session = Session { status: hall.board.follow(), told: None, next: Instant::now(), complaints: 0, hall };
    session.status.mark_changed();
    let mut ping = interval(PING);
    loop {
        let packet = tokio::select! {
            received = socket.recv() => {
                let Some(Ok(packet)) = received else { break };
                match packet {
                    Packet::Text(text) => session.hear(&text, &client),
                    Packet::Close(_) => break,
                    Packet::Binary(_) => session.complain("messages are text"),
                    // The library answers pings itself.
                    Packet::Ping(_) | Packet::Pong(_) => None,
                }
            }
            changed = client.answers.changed() => {
                if changed.is_err() {
                    break;
                }
                newest(&mut client)
            }
            changed = session.news() => {
                if changed.is_err() {
                    break;
                }
                session.tell()
            }
            _ = ping.tick() => Some(Packet::Ping(Bytes::new())),
        };
        let Some(packet) = packet else { continue };
        // While a page takes nothing, nothing is read either, so nothing piles up.
        if !matches!(timeout(PATIENCE, socket.send(packet)).await, Ok(Ok(()))) {
            break;
        }
    }
}

/// What is known of a page.
struct Session {
    hall: Arc<Hall>,
    status: watch::Receiver<Status>,
    /// The step of the last point that it has.
    told: Option<usize>,
    /// When it may be told again.
    next: Instant,
    complaints: usize,
}

impl Session {
    /// Does what a message asks for, or answers what is wrong with it.
    fn hear(&mut self, text: &str, client: &Client) -> Option<Packet> {
        match Message::parse(text, &self.hall.limits) {
            Ok(Message::Frame(request)) => client.ask(request),
            Ok(Message::Pause) => client.order_pause(true),
            Ok(Message::GoOn) => client.order_pause(false),
            Ok(Message::Checkpoint) => client.order_checkpoint(),
            Err(reason) => return self.complain(&reason),
        }
        None
    }

    fn complain(&mut self, reason: &str) -> Option<Packet> {
        self.complaints += 1;
        if self.complaints > MOST_COMPLAINTS {
            return None;
        }
        said(&Said::Refused { id: None, reason })
    }

    /// Waits for a change of the state. A fast training changes it hundreds of times a second.
    async fn news(&mut self) -> Result<(), RecvError> {
        sleep_until(self.next).await;
        self.status.changed().await
    }

    /// The state and the new points.
    fn tell(&mut self) -> Option<Packet> {
        self.next = Instant::now() + NEWS;
        let curves = self.hall.board.points_after(self.told);
        self.told = curves.last().map(|point| point.0).or(self.told);
        let status = self.status.borrow_and_update().clone();
        said(&Said::Status { status: &status, curves })
    }
}

/// The newest answer.
fn newest(client: &mut Client) -> Option<Packet> {
    match client.answers.borrow_and_update().clone()? {
        Answer::Frame(bytes) => Some(Packet::Binary(bytes)),
        Answer::Refused { id, reason } => said(&Said::Refused { id: Some(id), reason: &reason }),
    }
}

fn said(said: &Said<'_>) -> Option<Packet> {
    // Numbers and names always become JSON; if they did not, silence would be right.
    Some(Packet::Text(serde_json::to_string(said).ok()?.into()))
}
