//! A training that is watched by a hostile page: it goes on, and its memory stays bounded.

use std::io::{self, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::time::{Duration, Instant};

use clap::Parser;
use mvfusion_cli::args::Command;
use mvfusion_cli::interrupt::Signals;
use mvfusion_cli::progress::Verbosity;
use mvfusion_cli::viewer::address::{BoundSocket, HOST};
use mvfusion_cli::{Cli, command};
use mvfusion_tests::{SMALL_MODEL, ViewerClient};
use serde_json::json;

use crate::allocations::peak_during;
use crate::child;

/// What the server may hold beyond what it held before, with the pictures and steps of the training, bytes.
const LIMIT: usize = 48 << 20;

/// So many steps must follow.
const STEPS: u64 = 20;

/// How long anything may take.
const TIMEOUT: Duration = Duration::from_secs(60);

/// Trains a small model for longer than the test lasts.
fn train(run: &Path, viewer: BoundSocket) {
    let out = run.to_str().expect("a path that is text");
    let settings = ["train.stages={geometry=1000000, deformation=0, refinement=0}", "train.log_interval=1"];
    let settings = settings.iter().chain(&SMALL_MODEL).flat_map(|setting| ["--set", setting]);
    let line = ["mvfusion", "train", "--device", "cpu", "--lpips-weights", "none", "--out", out];
    let line = line.into_iter().chain(settings);
    let Command::Train(args) = Cli::try_parse_from(line).expect("a command line").command else { panic!("train") };
    // Ends with the process.
    let _ = command::train_in_thread(&args, Signals::default(), Some(viewer), Verbosity::SILENT, &mut Vec::new());
}

fn connect(port: u16) -> TcpStream {
    let stream = TcpStream::connect((HOST, port)).expect("connected");
    stream.set_read_timeout(Some(TIMEOUT)).expect("set");
    stream
}

fn page(port: u16) -> ViewerClient {
    ViewerClient::open(port).expect("a conversation")
}

/// What the server answers to somebody who asks for the page.
fn ask(port: u16) -> io::Result<String> {
    let mut answer = String::new();
    let mut stream = connect(port);
    write!(stream, "GET / HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n")?;
    stream.read_to_string(&mut answer)?;
    Ok(answer)
}

/// Everything that a page, or another program, should not do.
fn assault(port: u16) {
    let mut rude = page(port);
    let request = json!({
        "type": "frame", "id": 1, "size": [64, 48], "time": 0.5, "layer": "composed", "mfta": true, "background": null,
        "quality": 60, "view": {"set": "test", "index": 0},
    });
    for index in 0..10_000 {
        let text = match index % 4 {
            0 => "{\"type\":\"frame\"}".to_owned(),
            1 => "[".repeat(1000),
            2 => request.to_string().replace("64", "640000000000"),
            // Sound ones, too, and many more than can be rendered.
            _ => request.to_string(),
        };
        // Too many that cannot be read end a conversation; a page begins another one, if there is a place.
        if rude.send(text).is_err()
            && let Ok(next) = ViewerClient::open(port)
        {
            rude = next;
        }
    }
    for _ in 0..20 {
        let mut long = page(port);
        // The server may close before all of it is sent, or have no place while those before are still being closed.
        let _ = long.send("x".repeat(4 << 20));
        drop(long);
    }
    let connections: Vec<TcpStream> = (0..200).map(|_| connect(port)).collect();
    for mut stream in &connections {
        let _ = stream.write_all(b"GET / HTTP/1.1\r\nX-Long: ");
        let _ = stream.write_all(&[b'x'; 4096]);
    }
    drop(connections);
}

#[test]
fn a_hostile_page_stops_no_training_and_takes_no_memory() {
    if let Some(report) = child::report_path() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let run = folder.path().join("run");
        let viewer = BoundSocket::bind(HOST, 0).expect("a free port");
        let port = viewer.port();
        std::thread::spawn(move || train(&run, viewer));
        let mut watcher = page(port);
        let mut step = || watcher.step().expect("a state");
        let before = step();
        let ((), peak) = peak_during(|| assault(port));
        // What was told meanwhile waits in the socket; later steps follow.
        let until = Instant::now() + TIMEOUT;
        let mut now = step();
        while now < before + STEPS && Instant::now() < until {
            now = step();
        }
        assert!(now >= before + STEPS, "the training stands at step {now}, and stood at {before}");
        // While the server still closes the others, it resets this one.
        let until = Instant::now() + TIMEOUT;
        let mut answer = ask(port);
        while answer.is_err() && Instant::now() < until {
            std::thread::sleep(Duration::from_millis(100));
            answer = ask(port);
        }
        let answer = answer.expect("an answer");
        assert!(answer.starts_with("HTTP/1.1 200"), "{answer:.100}");
        std::fs::write(report, peak.to_string()).expect("the report can be written");
        return;
    }
    // In a process of its own: its memory is counted, and its training ends with it.
    let test = "viewer::a_hostile_page_stops_no_training_and_takes_no_memory";
    let peak: usize = child::run_alone(test, &[]).parse().expect("the report is a number");
    assert!(peak < LIMIT, "{peak} bytes more are held, {LIMIT} allowed");
}
