//! The server as other programs see it: what it serves, what it refuses, and what cannot make it grow.

use std::collections::BTreeSet;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

use serde_json::Value;
use tungstenite::client::IntoClientRequest;
use tungstenite::{Message, WebSocket};

use super::address::Listening;
use super::connection::MOST_CONNECTIONS;
use super::desk::MOST_PAGES;
use super::frame::Answer;
use super::guard::Guard;
use super::protocol::tests::request;
use super::server::{FILES, PAGE};
use super::{Viewer, board, facts};

/// How long an answer may take.
const PATIENCE: Duration = Duration::from_secs(20);

/// A running server.
struct Running {
    viewer: Viewer,
    /// `127.0.0.1:PORT`.
    host: String,
}

impl Running {
    fn start(guard: Guard) -> Self {
        let listening = Listening { guard, ..Listening::at("127.0.0.1", 0).expect("a free port") };
        let host = listening.socket.local_addr().expect("an address").to_string();
        let viewer =
            Viewer::start(listening, &facts::tests::scene(), &facts::tests::run_facts(), board::tests::status());
        Self { viewer: viewer.expect("started"), host }
    }

    /// The status and the whole answer of a request with further headers.
    fn ask(&self, method: &str, path: &str, headers: &[(&str, &str)]) -> (u16, String) {
        let mut lines = format!("{method} {path} HTTP/1.1\r\nConnection: close\r\n");
        if !headers.iter().any(|(name, _)| *name == "Host") {
            lines += &format!("Host: {}\r\n", self.host);
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
        stream.set_read_timeout(Some(PATIENCE)).expect("set");
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
fn hear(page: &mut WebSocket<TcpStream>) -> Value {
    loop {
        if let Message::Text(text) = page.read().expect("a message") {
            return serde_json::from_str(&text).expect("JSON");
        }
    }
}

/// Waits until something holds.
fn wait_for(what: &str, holds: impl Fn() -> bool) {
    let until = Instant::now() + PATIENCE;
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
    assert_eq!(running.status("/", &[("Host", "evil.example")]), 403);
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
    running.viewer.board.add((10, 0.5, Some(20.0)));
    let mut page = running.page("/socket", None).expect("open");
    let state = hear(&mut page);
    assert_eq!((state["type"].as_str(), state["activity"].as_str()), (Some("status"), Some("trains")));
    assert_eq!(state["curves"][0][0].as_u64(), Some(10));
    page.send(Message::text(request(3).to_string())).expect("sent");
    let (seat, wanted) = running.viewer.desk.take(PATIENCE).expect("a request");
    running.viewer.desk.answer(seat, Answer::Frame(vec![wanted.id as u8].into()));
    let frame = loop {
        if let Message::Binary(bytes) = page.read().expect("a message") {
            break bytes;
        }
    };
    assert_eq!(&*frame, [3]);
    // Only what is new is told.
    running.viewer.board.add((20, 0.25, None));
    running.viewer.board.change(|status| status.step = 20);
    let state = hear(&mut page);
    assert_eq!((state["step"].as_u64(), state["curves"].as_array().map(Vec::len)), (Some(20), Some(1)));
}

#[test]
fn ten_thousand_malformed_messages_are_answered_or_dropped_and_the_next_good_one_counts() {
    let running = local();
    let mut page = running.page("/socket", None).expect("open");
    let mut other = running.page("/socket", None).expect("open");
    let bad =
        ["", "{", "null", "[]", "{\"type\":\"frame\"}", "{\"type\":\"frame\",\"id\":-1}", "\u{0}\u{ffff}", "{\"a\":"];
    let deep = "[".repeat(4000);
    for index in 0..10_000 {
        let text = if index % 100 == 99 { deep.as_str() } else { bad[index % bad.len()] };
        let packet = if index % 10 == 7 { Message::binary(text.as_bytes().to_vec()) } else { Message::text(text) };
        page.send(packet).expect("sent");
    }
    page.send(Message::text(request(4).to_string())).expect("sent");
    assert_eq!(running.viewer.desk.take(PATIENCE).map(|(_, wanted)| wanted.id), Some(4));
    assert!(!running.viewer.desk.is_asked());
    // The answers are few, and end.
    running.viewer.board.change(|status| status.step = 99);
    let complaints = std::iter::from_fn(|| Some(hear(&mut page))).take_while(|said| said["step"].as_u64() != Some(99));
    let complaints = complaints.filter(|said| said["type"] == "refused").count();
    assert!((1..=20).contains(&complaints), "{complaints}");
    // Another page has not noticed.
    other.send(Message::text(request(5).to_string())).expect("sent");
    assert_eq!(running.viewer.desk.take(PATIENCE).map(|(_, wanted)| wanted.id), Some(5));
}

#[test]
fn a_message_that_is_too_long_ends_its_conversation_alone() {
    let running = local();
    for size in [5_000, 1 << 20] {
        let mut page = running.page("/socket", None).expect("open");
        // The server may close before all of it is sent.
        let _ = page.send(Message::text("x".repeat(size)));
        let end = std::iter::from_fn(|| Some(page.read()))
            .find(|read| !matches!(read, Ok(Message::Text(_) | Message::Ping(_))));
        assert!(matches!(end, Some(Err(_) | Ok(Message::Close(_)))), "{end:?}");
    }
    wait_for("seats come back", || running.viewer.desk.pages() == 0);
    assert_eq!(running.status("/", &[]), 200);
}

#[test]
fn two_hundred_connections_take_their_places_and_no_more() {
    let running = local();
    let connections: Vec<TcpStream> = (0..200).map(|_| running.connect()).collect();
    // Those beyond the bound are closed at once: reading them ends.
    let is_closed = |stream: &mut &TcpStream| {
        stream.set_nonblocking(true).expect("set");
        match stream.read(&mut [0]) {
            Ok(count) => count == 0,
            Err(error) => error.kind() != std::io::ErrorKind::WouldBlock,
        }
    };
    let open = || connections.iter().filter(|stream| !is_closed(&mut &**stream)).count();
    wait_for("the excess is closed", || open() <= MOST_CONNECTIONS);
    assert_eq!(open(), MOST_CONNECTIONS);
    drop(connections);
    let page_is_served = || {
        let mut stream = running.connect();
        let asked = write!(stream, "GET / HTTP/1.1\r\nHost: {}\r\nConnection: close\r\n\r\n", running.host);
        let mut answer = String::new();
        asked.is_ok() && stream.read_to_string(&mut answer).is_ok() && answer.starts_with("HTTP/1.1 200")
    };
    wait_for("places come back", page_is_served);
}

#[test]
fn there_are_only_so_many_pages() {
    let running = local();
    let pages: Vec<_> = (0..MOST_PAGES).map(|_| running.page("/socket", None).expect("open")).collect();
    assert_eq!(running.page("/socket", None).err(), Some(503));
    drop(pages);
    wait_for("seats come back", || running.viewer.desk.pages() == 0);
    assert!(running.page("/socket", None).is_ok());
}

#[test]
fn a_page_that_reads_nothing_stops_neither_the_others_nor_the_server() {
    let running = local();
    let lazy = running.page("/socket", None).expect("open");
    let mut keen = running.page("/socket", None).expect("open");
    for step in 0..2000 {
        running.viewer.board.add((step, 0.5, None));
        running.viewer.board.change(|status| status.step = step);
    }
    while hear(&mut keen)["step"].as_u64() != Some(1999) {}
    assert_eq!(running.status("/", &[]), 200);
    drop(lazy);
}

#[test]
fn a_server_that_is_dropped_leaves_its_port_to_the_next_one() {
    let running = local();
    let mut page = running.page("/socket", None).expect("open");
    hear(&mut page);
    let port = running.host.rsplit(':').next().and_then(|port| port.parse().ok()).expect("a port");
    drop(running);
    assert!(std::iter::from_fn(|| Some(page.read())).any(|read| read.is_err()));
    let next = Listening::at("127.0.0.1", port);
    assert!(next.is_ok(), "{next:?}");
}
