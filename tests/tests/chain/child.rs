//! A test that runs itself again in a process of its own, to be alone there or to have another number of threads.

use std::path::PathBuf;
use std::process::Command;

/// Where the child is to write what it found.
const REPORT: &str = "MVFUSION_CHAIN_REPORT";

/// In the child: where to write the report. `None` in the parent.
pub fn report_path() -> Option<PathBuf> {
    std::env::var_os(REPORT).map(PathBuf::from)
}

/// In the parent: runs the test of this full name (`module::function`) alone in a new process with further environment
/// variables, and returns its report.
pub fn run_alone(test: &str, environment: &[(&str, &str)]) -> String {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let report = folder.path().join("report");
    let program = std::env::current_exe().expect("this program has a path");
    let output = Command::new(program)
        .args([test, "--exact", "--test-threads=1"])
        .envs(environment.iter().copied())
        .env(REPORT, &report)
        .output()
        .expect("this program starts");
    let log = [output.stdout, output.stderr].map(|text| String::from_utf8_lossy(&text).into_owned()).concat();
    assert!(output.status.success(), "{test} failed in its own process:\n{log}");
    std::fs::read_to_string(&report).unwrap_or_else(|error| panic!("{test} wrote no report ({error}):\n{log}"))
}
