//! Pipes and devices in the place of the files of a run or a sweep: refused by name, and never waited for.

use std::cell::{Cell, RefCell};
use std::fs;
use std::os::unix::fs::symlink;
use std::path::Path;
use std::process::{Child, Command, Stdio};

use super::resume::wait_until;
use super::{mvfusion, program};

/// Where a name leads that should be a file.
#[derive(Clone, Copy, Debug)]
enum Strange {
    /// A pipe that nobody writes to.
    Pipe,
    /// A link to a device without end.
    Device,
}

impl Strange {
    fn put(self, path: &Path) {
        let _ = fs::remove_file(path);
        match self {
            Self::Pipe => assert!(Command::new("mkfifo").arg(path).status().expect("`mkfifo` starts").success()),
            Self::Device => symlink("/dev/zero", path).expect("linked"),
        }
    }
}

/// A program that does not outlive a failed test.
struct Running(RefCell<Child>);

impl Drop for Running {
    fn drop(&mut self) {
        // It has ended, unless the test failed.
        let _ = self.0.get_mut().kill();
    }
}

/// The exit code of a command that must end, and what it says.
fn ended(folder: &Path, arguments: &[&str]) -> (Option<i32>, String) {
    let said = folder.join("said");
    let output = || fs::File::options().create(true).append(true).open(&said).expect("opened");
    let _ = fs::remove_file(&said);
    let child =
        program().args(arguments).current_dir(folder).stdin(Stdio::null()).stdout(output()).stderr(output()).spawn();
    let running = Running(RefCell::new(child.expect("the program starts")));
    let status = Cell::new(None);
    wait_until(&format!("{arguments:?} ends"), || {
        status.set(running.0.borrow_mut().try_wait().expect("a status"));
        status.get().is_some()
    });
    (status.get().and_then(|status| status.code()), fs::read_to_string(&said).expect("read"))
}

/// Each command fails and names the file.
fn refuse(folder: &Path, file: &str, commands: &[&[&str]]) {
    for strange in [Strange::Pipe, Strange::Device] {
        strange.put(&folder.join(file));
        for command in commands {
            let (code, said) = ended(folder, command);
            let name = Path::new(file).file_name().and_then(|name| name.to_str()).expect("a name");
            assert!(matches!(code, Some(1 | 2)), "{strange:?}: {command:?} ended with {code:?}: {said}");
            assert!(said.contains(name) && said.contains("it is no file"), "{strange:?}: {command:?}: {said}");
        }
        fs::remove_file(folder.join(file)).expect("removed");
    }
}

#[test]
fn a_pipe_or_a_device_in_the_place_of_a_file_is_refused_by_name() {
    let ground = tempfile::tempdir().expect("folder");
    let folder = ground.path();
    refuse(folder, "own.toml", &[&["config", "--config", "own.toml"], &["sweep", "own.toml", "--dry-run"]]);

    fs::create_dir_all(folder.join("run/checkpoints")).expect("made");
    fs::write(folder.join("run/checkpoints/final.safetensors"), "").expect("written");
    let readers: [&[&str]; 2] = [&["eval", "run"], &["export", "run", "--out", "out"]];
    refuse(folder, "run/config.toml", &readers);
    refuse(folder, "run/run.json", &[&["train", "--resume", "run"]]);
    let config = mvfusion(folder, &["config", "--preset", "quickstart"]);
    fs::write(folder.join("run/config.toml"), &config.stdout).expect("written");

    fs::create_dir_all(folder.join("sweep/cells")).expect("made");
    refuse(folder, "sweep/sweep.json", &[&["sweep", "status", "sweep"], &["sweep", "table", "sweep"]]);
    refuse(folder, "sweep/cells/a.json", &[&["sweep", "run-cell", "--out", "sweep", "--cell", "a"]]);
}

#[test]
fn a_report_tells_of_pipes_and_devices_and_shows_the_rest() {
    let folder = tempfile::tempdir().expect("folder");
    let run = folder.path().join("run");
    fs::create_dir(&run).expect("made");
    for strange in [Strange::Pipe, Strange::Device] {
        for name in ["config.toml", "run.json", "results.json", "per_view.json", "metrics.jsonl"] {
            strange.put(&run.join(name));
        }
        let (code, said) = ended(folder.path(), &["report", "run"]);
        assert_eq!(code, Some(0), "{said}");
        let page = fs::read_to_string(run.join("report.html")).expect("a page");
        assert!(page.matches("it is no file").count() >= 3, "{strange:?}: {page}");
    }
}
