//! What other programs send, open or leave unread makes the server neither grow nor wait.

use super::super::connection::MOST_CONNECTIONS;
use super::super::conversation::TOO_MANY;
use super::super::requests::MOST_PAGES;
use super::*;

/// Bytes of a large picture, and more than the buffers of a connection hold.
const LARGE: usize = 1 << 20;
const FULL: usize = 64 << 20;

#[test]
fn malformed_messages_are_answered_and_too_many_end_their_conversation_alone() {
    let running = local();
    let mut page = running.page("/socket", None).expect("open");
    let mut other = running.page("/socket", None).expect("open");
    let bad =
        ["", "{", "null", "[]", "{\"type\":\"frame\"}", "{\"type\":\"frame\",\"id\":-1}", "\u{0}\u{ffff}", "{\"a\":"];
    let deep = "[".repeat(4000);
    for text in bad.into_iter().chain([deep.as_str()]) {
        page.send(Message::text(text)).expect("sent");
        let answer = std::iter::from_fn(|| Some(receive(&mut page))).find(|said| said["type"] != "status");
        assert_eq!(answer.expect("an answer")["type"], "refused", "{text:.20}");
    }
    page.send(Message::text(request(4).to_string())).expect("sent");
    assert_eq!(running.viewer.requests.take(TIMEOUT).map(|(_, wanted)| wanted.id), Some(4), "the next good one counts");
    for index in 0..10_000 {
        // The server may have closed before all of them are sent.
        if page.send(Message::binary(bad[index % bad.len()].as_bytes().to_vec())).is_err() {
            break;
        }
    }
    let said = std::iter::from_fn(|| Some(page.read())).take_while(|read| matches!(read, Ok(read) if !read.is_close()));
    let refusals = said.filter(|read| matches!(read, Ok(Message::Text(text)) if text.contains("refused"))).count();
    assert!(refusals <= 20, "{refusals}");
    assert!(!running.viewer.requests.is_asked());
    // Another page has not noticed.
    other.send(Message::text(request(5).to_string())).expect("sent");
    assert_eq!(running.viewer.requests.take(TIMEOUT).map(|(_, wanted)| wanted.id), Some(5));
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
    wait_for("slots come back", || running.viewer.requests.pages() == 0);
    assert_eq!(running.status("/", &[]), 200);
}

#[test]
fn two_hundred_connections_are_accepted_up_to_the_limit() {
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
    // One more is told why. A page cannot read the status of a refused socket.
    let mut late = running.page("/socket", None).expect("open");
    let end = std::iter::from_fn(|| Some(late.read())).find(|read| !matches!(read, Ok(Message::Ping(_))));
    let Some(Ok(Message::Close(Some(frame)))) = end else { panic!("{end:?}") };
    assert_eq!((u16::from(frame.code), frame.reason.as_str()), (1013, TOO_MANY));
    drop(pages);
    wait_for("slots come back", || running.viewer.requests.pages() == 0);
    assert!(running.page("/socket", None).is_ok());
}

#[test]
fn a_page_that_reads_nothing_stops_neither_the_others_nor_the_server() {
    let running = local();
    let mut lazy = running.page("/socket", None).expect("open");
    let mut keen = running.page("/socket", None).expect("open");
    // Until its socket is full, and the server waits for it: then a newer picture takes the place of the one before.
    let picture = axum::body::Bytes::from(vec![0; LARGE]);
    lazy.send(Message::text(request(0).to_string())).expect("sent");
    let (client, _) = running.viewer.requests.take(TIMEOUT).expect("a request");
    for _ in 0..FULL.div_ceil(LARGE) {
        running.viewer.requests.answer(client, Answer::Frame(picture.clone()));
        // The server takes one at a time.
        std::thread::sleep(Duration::from_millis(5));
    }
    keen.send(Message::text(request(1).to_string())).expect("sent");
    let (client, wanted) = running.viewer.requests.take(TIMEOUT).expect("a request");
    running.viewer.requests.answer(client, Answer::Frame(vec![wanted.id as u8].into()));
    while !matches!(keen.read().expect("a message"), Message::Binary(_)) {}
    running.viewer.status.change(|status| status.step = 1999);
    while receive(&mut keen)["step"].as_u64() != Some(1999) {}
    assert_eq!(running.status("/", &[]), 200);
    // It has not got all of them: its socket was full.
    lazy.get_ref().set_nonblocking(true).expect("set");
    let got = std::iter::from_fn(|| lazy.read().ok()).filter(Message::is_binary).count();
    assert!(got < FULL.div_ceil(LARGE), "{got} pictures were sent");
}
