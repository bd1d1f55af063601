//! The conversation with one page over its WebSocket.

use std::sync::Arc;
use std::time::Duration;

use axum::body::Bytes;
use axum::extract::ws::{CloseFrame, Message as Packet, WebSocket, close_code};
use serde::Serialize;
use tokio::sync::watch::{self, error::RecvError};
use tokio::time::{Instant, interval, sleep_until, timeout};

use super::frame::Answer;
use super::protocol::Message;
use super::requests::Client;
use super::server_state::ServerState;
use super::status::{CurvePoint, Status};

/// A page that takes nothing for so long is given up.
const TIMEOUT: Duration = Duration::from_secs(30);
/// A page that is turned away has so long to close its side.
const FAREWELL: Duration = Duration::from_secs(5);
/// What it is sent. The reason of a closed socket has at most 123 bytes.
pub(super) const TOO_MANY: &str = "Too many pages are open. Close one of them.";
/// Time between two pings, which keep the connection open.
const PING: Duration = Duration::from_secs(20);
/// Shortest time between two states.
const STATUS_INTERVAL: Duration = Duration::from_millis(100);
/// So many malformed messages of a page are answered. With the next one, the conversation ends; a page begins another.
const MOST_ERRORS: usize = 20;

/// What the page is sent as text.
#[derive(Serialize)]
#[serde(tag = "type", rename_all = "snake_case")]
enum ServerMessage<'a> {
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
pub async fn run(mut socket: WebSocket, state: Arc<ServerState>, mut client: Client) {
    let (status, next) = (state.status.subscribe(), Instant::now());
    let mut conversation = Conversation { status, last_sent: None, next, errors_sent: 0, state };
    conversation.status.mark_changed();
    let mut ping = interval(PING);
    loop {
        let packet = tokio::select! {
            received = socket.recv() => {
                let Some(Ok(packet)) = received else { break };
                match packet {
                    Packet::Text(text) => conversation.receive(&text, &client),
                    Packet::Close(_) => break,
                    Packet::Binary(_) => conversation.refuse("messages are text"),
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
            changed = conversation.status_changed() => {
                if changed.is_err() {
                    break;
                }
                conversation.send_status()
            }
            _ = ping.tick() => Some(Packet::Ping(Bytes::new())),
        };
        let Some(packet) = packet else { continue };
        let is_last = matches!(packet, Packet::Close(_));
        // While a page takes nothing, nothing is read either, so nothing piles up.
        if !matches!(timeout(TIMEOUT, socket.send(packet)).await, Ok(Ok(()))) || is_last {
            break;
        }
    }
}

/// What is known of a page.
struct Conversation {
    state: Arc<ServerState>,
    status: watch::Receiver<Status>,
    /// The step of the last point that it has.
    last_sent: Option<usize>,
    /// When the next state may be sent.
    next: Instant,
    errors_sent: usize,
}

impl Conversation {
    /// Does what a message asks for, or answers what is wrong with it.
    fn receive(&mut self, text: &str, client: &Client) -> Option<Packet> {
        match Message::parse(text, &self.state.limits) {
            Ok(Message::Frame(request)) => client.ask(request),
            Ok(Message::Pause) => client.request_pause(true),
            Ok(Message::GoOn) => client.request_pause(false),
            Ok(Message::Checkpoint) => client.request_checkpoint(),
            Err(reason) => return self.refuse(&reason),
        }
        None
    }

    fn refuse(&mut self, reason: &str) -> Option<Packet> {
        self.errors_sent += 1;
        if self.errors_sent > MOST_ERRORS {
            let reason = "too many messages could not be read";
            return Some(Packet::Close(Some(CloseFrame { code: close_code::POLICY, reason: reason.into() })));
        }
        packet(&ServerMessage::Refused { id: None, reason })
    }

    /// Waits for a change of the state. A fast training changes it hundreds of times a second.
    async fn status_changed(&mut self) -> Result<(), RecvError> {
        sleep_until(self.next).await;
        self.status.changed().await
    }

    /// The state and the new points.
    fn send_status(&mut self) -> Option<Packet> {
        self.next = Instant::now() + STATUS_INTERVAL;
        let curves = self.state.status.points_after(self.last_sent);
        self.last_sent = curves.last().map(|point| point.0).or(self.last_sent);
        let status = self.status.borrow_and_update().clone();
        packet(&ServerMessage::Status { status: &status, curves })
    }
}

/// The newest answer.
fn newest(client: &mut Client) -> Option<Packet> {
    match client.answers.borrow_and_update().clone()? {
        Answer::Frame(bytes) => Some(Packet::Binary(bytes)),
        Answer::Refused { id, reason } => packet(&ServerMessage::Refused { id: Some(id), reason: &reason }),
    }
}

fn packet(message: &ServerMessage<'_>) -> Option<Packet> {
    // Numbers and names always become JSON; if they did not, silence would be right.
    Some(Packet::Text(serde_json::to_string(message).ok()?.into()))
}
