//! A browser without a window, driven by the DevTools protocol through two pipes.

pub mod devtools;

use std::env;
use std::ffi::{OsStr, OsString};
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::OnceLock;
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use serde_json::{Value, json};
use tempfile::TempDir;

use devtools::Connection;

/// The variable that names the program.
const PROGRAM: &str = "CHROME";

/// Names that it is looked for by in the search path.
const NAMES: [&str; 5] = ["chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome"];

/// The browser reads commands from descriptor 3 and answers on 4; the standard library hands on 0 and 1, which the
/// shell moves there.
const START: &str = r#"exec "$0" "$@" 3<&0 4>&1 0</dev/null 1>&2"#;

/// Ends a group of processes. The shell has a `kill` of its own; small systems have no other.
const KILL: &str = r#"kill -s KILL -- "-$0""#;

/// Where the browser's standard error goes, within its profile.
const SAID: &str = "stderr.txt";

/// How long a program may take to say its version, and the browser to end when it is told to.
const VERSION: Duration = Duration::from_secs(30);
const FAREWELL: Duration = Duration::from_secs(10);

/// A page may take so long to be loaded.
const LOADING: Duration = Duration::from_secs(60);

/// Time from one look at a process or a page to the next.
const PAUSE: Duration = Duration::from_millis(20);

/// A running browser, ended when dropped.
pub struct Browser {
    child: Child,
    /// The connection to it.
    pub connection: Connection,
    /// Its profile; dropped after the process is gone.
    _profile: TempDir,
}

impl Browser {
    /// The browser's program, if this machine has one that can be driven. It is looked for once.
    pub fn find() -> Option<&'static Path> {
        static FOUND: OnceLock<Option<PathBuf>> = OnceLock::new();
        FOUND.get_or_init(search).as_deref()
    }

    /// Starts it with an empty profile.
    ///
    /// # Errors
    /// If there is none, or it does not start.
    pub fn start() -> Result<Self> {
        let program = Self::find().context("no browser")?;
        let profile = tempfile::tempdir()?;
        let said = profile.path().join(SAID);
        let mut child = command(program, profile.path())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(File::create(&said)?)
            .spawn()
            .with_context(|| format!("cannot start {}", program.display()))?;
        let (input, output) = child.stdin.take().zip(child.stdout.take()).context("both pipes")?;
        Ok(Self { child, connection: Connection::new(input, output, said), _profile: profile })
    }
}

/// Goes to a file's address, and waits until all of it is there.
///
/// # Errors
/// If it cannot be opened, or does not load in time.
pub fn open(connection: &mut Connection, address: &str) -> Result<()> {
    let answer = connection.call("Page.navigate", json!({"url": address}))?;
    if let Some(error) = answer.get("errorText") {
        bail!("{address} cannot be opened: {error}");
    }
    let until = Instant::now() + LOADING;
    loop {
        // The empty page before it is complete as well, and may go while it is asked, which is an error of no account.
        let state = connection.evaluate("location.protocol === 'file:' && document.readyState === 'complete'");
        if matches!(state, Ok(Value::Bool(true))) {
            return Ok(());
        }
        if Instant::now() > until {
            bail!("{address} was not loaded in time: {state:?}");
        }
        thread::sleep(PAUSE);
    }
}

/// The program that the variable names, so that a wrong name is an error; else the first in the search path that runs.
fn search() -> Option<PathBuf> {
    if cfg!(not(unix)) {
        return None;
    }
    if let Some(program) = env::var_os(PROGRAM).filter(|program| !program.is_empty()) {
        return Some(program.into());
    }
    let folders: Vec<PathBuf> = env::split_paths(&env::var_os("PATH").unwrap_or_default()).collect();
    let mut paths = NAMES.iter().flat_map(|name| folders.iter().map(move |folder| folder.join(name)));
    paths.find(|path| path.is_file() && !is_of_snap(path) && says_its_version(path))
}

/// Whether a program is a package of snap, which sees neither our temporary folders nor our pipes: it lies there, is a
/// link to the command `snap`, or a script that names its folder.
fn is_of_snap(program: &Path) -> bool {
    let real = program.canonicalize().unwrap_or_else(|_| program.to_owned());
    if [program, real.as_path()].iter().any(|path| path.starts_with("/snap"))
        || real.file_name() == Some(OsStr::new("snap"))
    {
        return true;
    }
    let mut begin = Vec::new();
    let read = File::open(&real).and_then(|file| file.take(4096).read_to_end(&mut begin));
    read.is_ok() && begin.starts_with(b"#!") && String::from_utf8_lossy(&begin).contains("/snap/bin/")
}

/// Whether a program runs at all. A file that only bears the name may be a stub that asks for an installation.
fn says_its_version(program: &Path) -> bool {
    let Ok(home) = tempfile::tempdir() else { return false };
    let mut command = Command::new(program);
    command.arg("--version").env("HOME", home.path());
    lead_a_group(&mut command);
    let started = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn();
    let Ok(mut child) = started else { return false };
    match ended(&mut child, VERSION) {
        Some(status) => status.success(),
        None => {
            kill(&mut child);
            false
        }
    }
}

fn command(program: &Path, profile: &Path) -> Command {
    let mut command = Command::new("sh");
    command.args([OsStr::new("-c"), OsStr::new(START), program.as_os_str()]).args([
        "--headless=new",
        "--remote-debugging-pipe",
        // Containers run as root, without the kernel's namespaces and with little shared memory.
        "--no-sandbox",
        "--disable-dev-shm-usage",
        "--disable-gpu",
        "--no-first-run",
        "--disable-background-networking",
        "--disable-component-update",
        "--hide-scrollbars",
        "--force-device-scale-factor=1",
        // WebGPU on the CPU.
        "--enable-unsafe-webgpu",
        "--use-webgpu-adapter=swiftshader",
    ]);
    let mut folder = OsString::from("--user-data-dir=");
    folder.push(profile);
    // What it keeps beside its profile, it keeps at home.
    command.arg(folder).env("HOME", profile);
    lead_a_group(&mut command);
    command
}

/// Makes a process the first of a group of its own, in which its children are as well.
fn lead_a_group(command: &mut Command) {
    #[cfg(unix)]
    std::os::unix::process::CommandExt::process_group(command, 0);
    #[cfg(not(unix))]
    let _ = command;
}

/// How a process ended, if it did so in time.
fn ended(child: &mut Child, patience: Duration) -> Option<ExitStatus> {
    let until = Instant::now() + patience;
    loop {
        match child.try_wait() {
            Ok(None) if Instant::now() < until => thread::sleep(PAUSE),
            Ok(status) => return status,
            Err(_) => return None,
        }
    }
}

/// Ends a process that leads a group, and all others of the group. As nobody has waited for it yet, its number is still
/// its own.
fn kill(child: &mut Child) {
    let _ = Command::new("sh").args(["-c", KILL, &child.id().to_string()]).stderr(Stdio::null()).status();
    let _ = child.kill();
    let _ = child.wait();
}

impl Drop for Browser {
    fn drop(&mut self) {
        // Told to close, it ends its own children first. One that hangs, or does not hear, leaves them to us.
        let _ = self.connection.send("Browser.close", json!({}));
        if ended(&mut self.child, FAREWELL).is_none() {
            kill(&mut self.child);
        }
    }
}
