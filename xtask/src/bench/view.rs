//! Latency of the viewer, from a request to a decoded picture, as a page asks while something moves.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use anyhow::{Context, Result, anyhow, ensure};
use clap::{Args, Parser};
use glam::{DMat3, DVec3};
use mvfusion_cli::args::Command;
use mvfusion_cli::progress::Verbosity;
use mvfusion_cli::viewer::address::{BoundSocket, HOST};
use mvfusion_cli::viewer::frame;
use mvfusion_cli::{Cli, command};
use serde_json::{Value, json};
use tungstenite::{Message, WebSocket};

use super::{Row, Seconds};

/// Requests that are not counted.
const WARM_UP: usize = 5;
/// JPEG quality of the page while something moves.
const QUALITY: u8 = 60;
/// Angle between two pictures of an orbit, radians.
const ANGLE: f64 = 0.01;
/// Most seconds, in the median, that a page may wait while the camera moves, and while the time changes.
const ORBIT_LIMIT: f64 = 0.08;
const TIME_LIMIT: f64 = 0.2;

/// What to look at.
#[derive(Debug, Args)]
pub struct ViewArguments {
    /// Run folder, such as runs/quickstart-0.
    run: PathBuf,
    /// Width and height of the pictures.
    #[arg(long, value_delimiter = ',', default_values = ["320", "180"])]
    size: Vec<usize>,
    /// Pictures of each kind.
    #[arg(long, default_value_t = 100)]
    pictures: usize,
}

/// What is measured.
#[derive(Clone, Copy)]
enum Kind {
    /// The camera moves, at a time that is cached.
    Orbit,
    /// The time changes to one that was never asked for.
    Time,
    /// The picture of one that stands still: with temporal attention, at a time that was asked for before.
    Still,
    /// The same at a time that was never asked for, as after each change of the time.
    StillTime,
}

impl Kind {
    const ALL: [Self; 4] = [Self::Orbit, Self::Time, Self::Still, Self::StillTime];

    fn name(self) -> &'static str {
        match self {
            Self::Orbit => "view: orbit, cached time",
            Self::Time => "view: another time",
            Self::Still => "view: still, with MFTA, cached time",
            Self::StillTime => "view: still, with MFTA, another time",
        }
    }

    /// The largest median, in seconds. Nothing moves while a sharp picture is waited for.
    fn limit(self) -> Option<f64> {
        match self {
            Self::Orbit => Some(ORBIT_LIMIT),
            Self::Time => Some(TIME_LIMIT),
            Self::Still | Self::StillTime => None,
        }
    }
}

/// Serves the run on this thread, as the program does, and asks from another one.
pub fn measure(arguments: &ViewArguments, device: &str, note: &mut impl FnMut(Row)) -> Result<()> {
    let [width, height] = *arguments.size.as_slice() else { return Err(anyhow!("--size takes WIDTH,HEIGHT")) };
    ensure!(arguments.pictures > 0, "--pictures is 0: nothing would be measured");
    let run = arguments.run.to_str().context("a path that is text")?;
    let line = ["mvfusion", "view", run, "--device", device];
    let Command::View(view) = Cli::try_parse_from(line)?.command else { return Err(anyhow!("another command")) };
    // What listens can be asked before it is served.
    let socket = BoundSocket::bind(HOST, 0)?;
    let (port, is_over) = (socket.port(), AtomicBool::new(false));
    let times = std::thread::scope(|scope| {
        let asking = scope.spawn(|| {
            // However it ends: the server waits for it.
            let _end = End(&is_over);
            ask(port, [width, height], arguments.pictures)
        });
        let mut said = Vec::new();
        command::view_until(&view, socket, Verbosity::NORMAL, &mut said, || is_over.load(Ordering::Relaxed))?;
        asking.join().map_err(|_| anyhow!("the thread that asks has panicked"))?
    })?;
    for (kind, times) in times {
        let scene = format!("{}, {width}x{height}, median of {}", kind.name(), times.len());
        let worst = times.iter().copied().fold(0.0, f64::max);
        let median = super::median(times);
        let verdict = kind.limit().map_or(String::new(), |limit| {
            let word = if median <= limit { "met" } else { "NOT met" };
            format!("; the limit of {:.0} ms is {word}", 1e3 * limit)
        });
        eprintln!("{scene}: {:.1} ms, at most {:.1} ms{verdict}", 1e3 * median, 1e3 * worst);
        let (device, threads) = (device.to_owned(), rayon::current_num_threads());
        let seconds = Seconds::Whole(median);
        note(Row { scene, device, threads, seconds, pairs: None, peak_bytes: None });
    }
    Ok(())
}

/// Tells the server to end when dropped.
struct End<'a>(&'a AtomicBool);

impl Drop for End<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// The seconds of each picture, by kind.
fn ask(port: u16, size: [usize; 2], pictures: usize) -> Result<Vec<(Kind, Vec<f64>)>> {
    let mut page = Page::open(port, size)?;
    let (first, last) = (page.times[0], page.times[page.times.len() - 1]);
    let middle = 0.5 * (first + last);
    let mut measured = Vec::new();
    for kind in Kind::ALL {
        let mut times = Vec::new();
        for index in 0..WARM_UP + pictures {
            let share = (index as f64 + 0.5) / (WARM_UP + pictures) as f64;
            let (angle, time, mfta) = match kind {
                Kind::Orbit => (ANGLE * index as f64, middle, false),
                Kind::Time => (0.0, first + (last - first) * share, false),
                Kind::Still => (ANGLE * index as f64, middle, true),
                Kind::StillTime => (0.0, first + (last - first) * share, true),
            };
            let taken = page.picture(angle, time, mfta)?;
            if index >= WARM_UP {
                times.push(taken);
            }
        }
        measured.push((kind, times));
    }
    Ok(measured)
}

/// A page that asks for one picture at a time.
struct Page {
    socket: WebSocket<TcpStream>,
    size: [usize; 2],
    times: Vec<f64>,
    position: DVec3,
    /// Camera to world.
    axes: DMat3,
    target: DVec3,
    up: DVec3,
    /// Vertical field of view in degrees.
    fov: f64,
    next: u64,
}

impl Page {
    fn open(port: u16, size: [usize; 2]) -> Result<Self> {
        let scene = scene(port)?;
        let address = format!("ws://{HOST}:{port}/socket");
        let stream = TcpStream::connect((HOST, port))?;
        stream.set_nodelay(true)?;
        let (socket, _) = tungstenite::client(address, stream).map_err(|error| anyhow!("{error}"))?;
        let camera = &scene["cameras"][0];
        let vector = |value: &Value| serde_json::from_value::<[f64; 3]>(value.clone()).map(DVec3::from_array);
        let rows: [[f64; 3]; 3] = serde_json::from_value(camera["rotation"].clone())?;
        let number = |name: &str| camera[name].as_f64().context("a camera");
        Ok(Self {
            socket,
            size,
            times: serde_json::from_value(scene["times"].clone())?,
            position: vector(&camera["position"])?,
            axes: DMat3::from_cols_array_2d(&rows).transpose(),
            target: vector(&scene["target"])?,
            up: vector(&scene["up"])?,
            fov: 2.0 * (number("height")? / (2.0 * number("fy")?)).atan().to_degrees(),
            next: 0,
        })
    }

    /// Seconds from a request to the decoded picture, after an orbit by an angle.
    fn picture(&mut self, angle: f64, time: f64, mfta: bool) -> Result<f64> {
        self.next += 1;
        let turn = DMat3::from_axis_angle(self.up.try_normalize().context("an up axis")?, angle);
        let position = self.target + turn * (self.position - self.target);
        let axes = (turn * self.axes).transpose();
        let rotation = [axes.x_axis, axes.y_axis, axes.z_axis].map(|row| row.to_array());
        let request = json!({
            "type": "frame", "id": self.next, "size": self.size, "time": time, "layer": "composed", "mfta": mfta,
            "background": null, "quality": QUALITY,
            "pose": {"position": position.to_array(), "rotation": rotation, "fov": self.fov},
        });
        let started = Instant::now();
        self.socket.send(Message::text(request.to_string()))?;
        loop {
            match self.socket.read()? {
                Message::Binary(bytes) => {
                    let (_, jpeg) = frame::parts(&bytes).context("a frame")?;
                    let picture = image::load_from_memory(jpeg)?;
                    ensure!([picture.width() as usize, picture.height() as usize] == self.size, "another size");
                    return Ok(started.elapsed().as_secs_f64());
                }
                Message::Text(text) if text.contains("\"refused\"") => return Err(anyhow!("{text}")),
                _ => {}
            }
        }
    }
}

/// The facts of the scene.
fn scene(port: u16) -> Result<Value> {
    let mut stream = TcpStream::connect((HOST, port))?;
    write!(stream, "GET /scene.json HTTP/1.1\r\nHost: {HOST}:{port}\r\nConnection: close\r\n\r\n")?;
    let mut answer = String::new();
    stream.read_to_string(&mut answer)?;
    Ok(serde_json::from_str(answer.split_once("\r\n\r\n").context("an answer")?.1)?)
}
