//! The server as other programs see it: what it serves, and what it refuses.

mod bounds;

use std::collections::BTreeSet;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

use serde_json::Value;
use tungstenite::client::IntoClientRequest;
use tungstenite::{Message, WebSocket};

use super::address::BoundSocket;
use super::frame::Answer;
use super::guard::Guard;
use super::protocol::tests::request;
use super::server::{FILES, PAGE};
use super::{Viewer, answered, facts, status};

/// How long an answer may take.
const TIMEOUT: Duration = Duration::from_secs(20);

/// A running server.
struct Running {
    viewer: Viewer,
    /// `127.0.0.1:PORT`.
    host: String,
}

impl Running {
    fn start(guard: Guard) -> Self {
        let socket = BoundSocket { guard, ..BoundSocket::bind("127.0.0.1", 0).expect("a free port") };
        let host = socket.listener.local_addr().expect("an address").to_string();
        let viewer = Viewer::start(socket, &facts::tests::scene(), &facts::tests::run_facts(), status::tests::status());
        Self { viewer: viewer.expect("started"), host }
    }

    /// The status and the whole answer of a request with further headers.
    fn ask(&self, method: &str, path: &str, headers: &[(&str, &str)]) -> (u16, String) {
        let mut lines = format!("{method} {path} HTTP/1.1\r\n");
        for (name, usual) in [("Host", self.host.as_str()), ("Connection", "close")] {
            if !headers.iter().any(|(given, _)| *given == name) {
                lines += &format!("{name}: {usual}\r\n");
            }
        }
        headers.iter().for_each(|(name, value)| lines += &format!("{name}: {value}\r\n"));
        let mut stream = self.connect();
        stream.write_all(format!("{lines}\r\n").as_bytes()).expect("sent");
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).expect("an answer");
        let answer = String::from_utf8_lossy(&answer).into_owned();
        let status = answer.split(' ').nth(1).and_then(|status| status.parse().ok());
        (status.unwrap_or_else(|| panic!("{answer}")), answer)
    }

    fn status(&self, path: &str, headers: &[(&str, &str)]) -> u16 {
        self.ask("GET", path, headers).0
    }

    fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect(&self.host).expect("connected");
        stream.set_read_timeout(Some(TIMEOUT)).expect("set");
        stream
    }

    /// Opens a WebSocket, perhaps as a page of another server; the status of a refusal otherwise.
    fn page(&self, path: &str, origin: Option<&str>) -> Result<WebSocket<TcpStream>, u16> {
        let mut request = format!("ws://{}{path}", self.host).into_client_request().expect("a request");
        if let Some(origin) = origin {
            request.headers_mut().insert("Origin", origin.parse().expect("a header"));
        }
        match tungstenite::client(request, self.connect()) {
            Ok((socket, _)) => Ok(socket),
            Err(tungstenite::HandshakeError::Failure(tungstenite::Error::Http(answer))) => {
                Err(answer.status().as_u16())
            }
            Err(other) => panic!("{other}"),
        }
    }
}

fn local() -> Running {
    Running::start(Guard::local())
}

/// The next message in words.
fn receive(page: &mut WebSocket<TcpStream>) -> Value {
    loop {
        if let Message::Text(text) = page.read().expect("a message") {
            return serde_json::from_str(&text).expect("JSON");
        }
    }
}

/// Waits until something holds.
fn wait_for(what: &str, holds: impl Fn() -> bool) {
    let until = Instant::now() + TIMEOUT;
    while !holds() {
        assert!(Instant::now() < until, "{what}");
        std::thread::sleep(Duration::from_millis(10));
    }
}

#[test]
fn the_page_is_small_complete_and_needs_no_network() {
    let size = PAGE.len() + FILES.iter().map(|(_, _, text)| text.len()).sum::<usize>();
    assert!(size < 100_000, "{size} bytes");
    let names: BTreeSet<&str> = FILES.iter().map(|(name, _, _)| *name).collect();
    for (name, _, text) in FILES {
        for import in text.lines().filter_map(|line| line.strip_prefix("import ")) {
            let file = import.split('\'').nth(1).and_then(|path| path.strip_prefix("./")).expect("a neighbour");
            assert!(names.contains(file), "{name} imports {file}");
        }
        assert!(!text.contains("http://") && !text.contains("https://"), "{name}");
    }
    assert!(PAGE.contains("src=\"viewer.js\"") && PAGE.contains("href=\"viewer.css\"") && !PAGE.contains("style="));
}

#[test]
fn the_page_the_scene_its_points_and_its_photos_are_served() {
    let running = local();
    for (path, kind) in [
        ("/", "text/html"),
        ("/viewer.css", "text/css"),
        ("/viewer.js", "text/javascript"),
        ("/scene.json", "application/json"),
        ("/points.bin", "application/octet-stream"),
        ("/photo/train/0", "image/jpeg"),
        ("/photo/test/1", "image/jpeg"),
    ] {
        let (status, answer) = running.ask("GET", path, &[]);
        assert_eq!(status, 200, "{path}");
        let head = answer.split("\r\n\r\n").next().unwrap_or_default().to_lowercase();
        for header in [kind, "nosniff", "no-store", "default-src 'none'", "cross-origin-resource-policy: same-origin"] {
            assert!(head.contains(header), "{path} lacks {header}: {head}");
        }
    }
    for path in ["/etc/passwd", "/../Cargo.toml", "/photo/gt/0", "/photo/train/9999", "/photo/train/x", "/viewer.js/"] {
        assert!([400, 404].contains(&running.status(path, &[])), "{path}");
    }
}

#[test]
fn only_get_of_the_own_name_and_origin_is_served() {
    let running = local();
    for method in ["POST", "PUT", "DELETE", "OPTIONS", "PATCH"] {
        assert_eq!(running.ask(method, "/", &[]).0, 405, "{method}");
    }
    // Whoever is refused keeps no connection, whatever it asked for.
    let kept = [("Host", "evil.example"), ("Connection", "keep-alive")];
    let (status, answer) = running.ask("GET", "/", &kept);
    assert!(status == 403 && answer.to_lowercase().contains("connection: close"), "{answer}");
    assert_eq!(running.status("/scene.json", &[("Origin", "https://evil.example")]), 403);
    let own = format!("http://{}", running.host);
    assert_eq!(running.status("/scene.json", &[("Origin", &own)]), 200);
    assert_eq!(running.page("/socket", Some("https://evil.example")).err(), Some(403));
    assert!(running.page("/socket", Some(&own)).is_ok());
}

#[test]
fn without_the_token_nothing_is_served_and_with_it_everything() {
    let running = Running::start(Guard::with_token("secret".to_owned(), ["machine".to_owned()]));
    for path in ["/", "/viewer.js", "/scene.json", "/photo/train/0", "/socket", "/wrong/", "/nowhere"] {
        assert_eq!(running.status(path, &[]), 401, "{path}");
    }
    assert_eq!(running.page("/socket", None).err(), Some(401));
    for path in ["/secret/", "/secret/viewer.js", "/secret/scene.json", "/secret/photo/test/0"] {
        assert_eq!(running.status(path, &[]), 200, "{path}");
    }
    assert!(running.page("/secret/socket", None).is_ok());
}

#[test]
fn a_page_is_told_the_state_and_gets_the_picture_that_it_asks_for() {
    let running = local();
    running.viewer.status.add((10, 0.5, Some(20.0)));
    let mut page = running.page("/socket", None).expect("open");
    let state = receive(&mut page);
    assert_eq!((state["type"].as_str(), state["activity"].as_str()), (Some("status"), Some("trains")));
    assert_eq!(state["curves"][0][0].as_u64(), Some(10));
    page.send(Message::text(request(3).to_string())).expect("sent");
    let (client, wanted) = running.viewer.requests.take(TIMEOUT).expect("a request");
    running.viewer.requests.answer(client, Answer::Frame(vec![wanted.id as u8].into()));
    let frame = loop {
        if let Message::Binary(bytes) = page.read().expect("a message") {
            break bytes;
        }
    };
    assert_eq!(&*frame, [3]);
    // Only what is new is told.
    running.viewer.status.add((20, 0.25, None));
    running.viewer.status.change(|status| status.step = 20);
    let state = receive(&mut page);
    assert_eq!((state["step"].as_u64(), state["curves"].as_array().map(Vec::len)), (Some(20), Some(1)));
}

#[test]
fn a_render_that_panics_is_a_refusal() {
    let answer = answered(7, || panic!("a test"));
    assert!(matches!(answer, Answer::Refused { id: 7, reason } if reason.contains("memory")));
}

#[test]
fn a_server_that_is_dropped_leaves_its_port_to_the_next_one() {
    let running = local();
    let mut page = running.page("/socket", None).expect("open");
    receive(&mut page);
    let port = running.host.rsplit(':').next().and_then(|port| port.parse().ok()).expect("a port");
    drop(running);
    assert!(std::iter::from_fn(|| Some(page.read())).any(|read| read.is_err()));
    let next = BoundSocket::bind("127.0.0.1", port);
    assert!(next.is_ok(), "{next:?}");
}
