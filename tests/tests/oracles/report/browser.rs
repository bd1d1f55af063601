//! A browser without a window, driven by the DevTools protocol through two pipes.

use std::env;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use anyhow::{Context, Result};
use tempfile::TempDir;

use super::devtools::Connection;

/// The variable that names the program.
const PROGRAM: &str = "CHROME";

/// Names that it is looked for by in the search path.
const NAMES: [&str; 5] = ["chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome"];

/// The browser reads commands from descriptor 3 and answers on 4; the standard library hands on 0 and 1, which the
/// shell moves there.
const START: &str = r#"exec "$0" "$@" 3<&0 4>&1 0</dev/null 1>&2"#;

/// A running browser, ended when dropped.
pub struct Browser {
    child: Child,
    /// The connection to it.
    pub connection: Connection,
    /// Its profile; dropped after the process is gone.
    _profile: TempDir,
}

impl Browser {
    /// The browser's program, if this machine has one that can be driven.
    pub fn find() -> Option<PathBuf> {
        if cfg!(not(unix)) {
            return None;
        }
        if let Some(program) = env::var_os(PROGRAM).filter(|program| !program.is_empty()) {
            return Some(program.into());
        }
        let folders: Vec<PathBuf> = env::split_paths(&env::var_os("PATH").unwrap_or_default()).collect();
        NAMES.iter().flat_map(|name| folders.iter().map(move |folder| folder.join(name))).find(|path| path.is_file())
    }

    /// Starts it with an empty profile.
    ///
    /// # Errors
    /// If there is none, or it does not start.
    pub fn start() -> Result<Self> {
        let program = Self::find().context("no browser")?;
        let profile = tempfile::tempdir()?;
        let mut child = command(&program, profile.path())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .with_context(|| format!("cannot start {}", program.display()))?;
        let (input, output) = child.stdin.take().zip(child.stdout.take()).context("both pipes")?;
        Ok(Self { child, connection: Connection::new(input, output), _profile: profile })
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
    ]);
    let mut folder = std::ffi::OsString::from("--user-data-dir=");
    folder.push(profile);
    command.arg(folder);
    command
}

impl Drop for Browser {
    fn drop(&mut self) {
        // It closes its own children when it is told to, and has none left to end when that fails.
        let closed = self.connection.call("Browser.close", serde_json::json!({}));
        if closed.is_err() {
            let _ = self.child.kill();
        }
        let _ = self.child.wait();
    }
}
