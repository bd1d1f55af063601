//! The server: a thread of its own, which never computes on the device.

use std::sync::Arc;
use std::thread::JoinHandle;

use anyhow::Context;
use axum::extract::ws::WebSocketUpgrade;
use axum::extract::{Path, Request, State};
use axum::http::{HeaderValue, StatusCode, header};
use axum::middleware::{Next, from_fn_with_state};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use axum::{Router, serve};
use tokio::sync::oneshot;

use super::address::BoundSocket;
use super::connection::LimitedListener;
use super::conversation;
use super::guard::{Refusal, RequestHead};
use super::protocol::{LONGEST_MESSAGE, ViewId, ViewSet};
use super::server_state::ServerState;

/// The page.
pub(super) const PAGE: &str = include_str!("page/index.html");
const STYLE: &str = "text/css; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";

/// The other files of the page: name, kind, text. They are part of the program, so that it needs no other file.
pub(super) const FILES: [(&str, &str, &str); 17] = [
    ("viewer.css", STYLE, include_str!("page/viewer.css")),
    ("address.js", SCRIPT, include_str!("page/address.js")),
    ("chart.js", SCRIPT, include_str!("page/chart.js")),
    ("controls.js", SCRIPT, include_str!("page/controls.js")),
    ("dom.js", SCRIPT, include_str!("page/dom.js")),
    ("editor.js", SCRIPT, include_str!("page/editor.js")),
    ("link.js", SCRIPT, include_str!("page/link.js")),
    ("moves.js", SCRIPT, include_str!("page/moves.js")),
    ("panel.js", SCRIPT, include_str!("page/panel.js")),
    ("path.js", SCRIPT, include_str!("page/path.js")),
    ("photo.js", SCRIPT, include_str!("page/photo.js")),
    ("picture.js", SCRIPT, include_str!("page/picture.js")),
    ("player.js", SCRIPT, include_str!("page/player.js")),
    ("pose.js", SCRIPT, include_str!("page/pose.js")),
    ("state.js", SCRIPT, include_str!("page/state.js")),
    ("vector.js", SCRIPT, include_str!("page/vector.js")),
    ("viewer.js", SCRIPT, include_str!("page/viewer.js")),
];

/// Threads that decode photos.
const PHOTO_THREADS: usize = 1;

/// A running server. It ends when it is dropped.
#[derive(Debug)]
pub struct Server {
    stop: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Server {
    /// Serves at a socket.
    ///
    /// # Errors
    /// If the system refuses the thread.
    pub fn start(socket: BoundSocket, state: ServerState) -> anyhow::Result<Self> {
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_io()
            .enable_time()
            .max_blocking_threads(PHOTO_THREADS)
            .build()
            .context("cannot start the server of the viewer")?;
        let (stop, stopped) = oneshot::channel();
        let work = move || {
            runtime.block_on(async {
                let serving = async {
                    let socket = tokio::net::TcpListener::from_std(socket.listener)?;
                    serve(LimitedListener::new(socket), router(Arc::new(state))).await
                };
                tokio::select! {
                    ended = serving => if let Err(error) = ended {
                        tracing::warn!("the viewer has ended: {error}");
                    },
                    _ = stopped => {}
                }
            });
            // Conversations end here, and a photo that is being decoded is not waited for.
            runtime.shutdown_background();
        };
        let thread = std::thread::Builder::new().name("viewer".to_owned()).spawn(work);
        Ok(Self { stop: Some(stop), thread: Some(thread.context("cannot start a thread for the viewer")?) })
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        if let Some(stop) = self.stop.take() {
            // A server that has ended by itself needs no word.
            let _ = stop.send(());
        }
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn router(state: Arc<ServerState>) -> Router {
    let base = state.guard.base();
    let at = |path: &str| format!("{base}/{path}");
    let page = Router::new().route(&at(""), get(|| async { text("text/html; charset=utf-8", PAGE) }));
    let file = |router: Router<_>, (name, kind, contents): (&str, &'static str, &'static str)| {
        router.route(&at(name), get(move || async move { text(kind, contents) }))
    };
    FILES
        .into_iter()
        .fold(page, file)
        .route(&at("scene.json"), get(facts))
        .route(&at("points.bin"), get(points))
        .route(&at("photo/{set}/{index}"), get(photo))
        .route(&at("socket"), get(socket))
        .layer(from_fn_with_state(Arc::clone(&state), guarded))
        .with_state(state)
}

/// Lets a request pass if the guard agrees, and adds the headers that keep other pages out.
async fn guarded(State(state): State<Arc<ServerState>>, request: Request, next: Next) -> Response {
    let (checked, policy) = checked(&state, &request);
    let mut response = match checked {
        Ok(()) => next.run(request).await,
        Err(refusal) => {
            let status = StatusCode::from_u16(refusal.status()).unwrap_or(StatusCode::FORBIDDEN);
            // Whoever is refused keeps no connection.
            (status, [(header::CONNECTION, "close")], refusal.sentence()).into_response()
        }
    };
    let headers = response.headers_mut();
    for (name, value) in [
        (header::CACHE_CONTROL, "no-store"),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::REFERRER_POLICY, "no-referrer"),
        (header::HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
    ] {
        headers.insert(name, HeaderValue::from_static(value));
    }
    if let Ok(policy) = HeaderValue::from_str(&policy) {
        headers.insert(header::CONTENT_SECURITY_POLICY, policy);
    }
    response
}

/// What the guard says, and the policy of content for the answer.
fn checked(state: &ServerState, request: &Request) -> (Result<(), Refusal>, String) {
    let headers = request.headers();
    let host = headers.get(header::HOST).and_then(|value| value.to_str().ok());
    let head = RequestHead {
        method: request.method().as_str(),
        path: request.uri().path(),
        host,
        // A header that is no text is not ours.
        origin: headers.get(header::ORIGIN).map(|value| value.to_str().unwrap_or_default()),
    };
    let checked = state.guard.check(&head);
    // Some browsers do not count sockets as of the same origin.
    let own = host.filter(|_| checked.is_ok()).unwrap_or("localhost");
    let policy = format!(
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; connect-src 'self' \
         ws://{own}; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    );
    (checked, policy)
}

fn text(kind: &'static str, text: &'static str) -> Response {
    ([(header::CONTENT_TYPE, kind)], text).into_response()
}

async fn facts(State(state): State<Arc<ServerState>>) -> Response {
    ([(header::CONTENT_TYPE, "application/json")], state.facts.clone()).into_response()
}

async fn points(State(state): State<Arc<ServerState>>) -> Response {
    ([(header::CONTENT_TYPE, "application/octet-stream")], state.points.clone()).into_response()
}

async fn photo(State(state): State<Arc<ServerState>>, Path((set, index)): Path<(String, usize)>) -> Response {
    let set = match set.as_str() {
        "train" => ViewSet::Train,
        "test" => ViewSet::Test,
        _ => return StatusCode::NOT_FOUND.into_response(),
    };
    match state.photos.jpeg(ViewId { set, index }).await {
        Some(Ok(jpeg)) => ([(header::CONTENT_TYPE, "image/jpeg")], jpeg).into_response(),
        Some(Err(reason)) => {
            tracing::warn!("a photo cannot be shown: {reason}");
            (StatusCode::INTERNAL_SERVER_ERROR, reason).into_response()
        }
        None => StatusCode::NOT_FOUND.into_response(),
    }
}

async fn socket(State(state): State<Arc<ServerState>>, upgrade: WebSocketUpgrade) -> Response {
    let upgrade = upgrade.max_message_size(LONGEST_MESSAGE).max_frame_size(LONGEST_MESSAGE);
    match state.requests.connect() {
        Some(client) => upgrade.on_upgrade(move |socket| conversation::run(socket, state, client)),
        // Browsers hide the status of a refused socket from the page, but not the reason of a closed one.
        None => upgrade.on_upgrade(conversation::turn_away),
    }
}
