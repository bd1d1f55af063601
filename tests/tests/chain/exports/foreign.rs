//! The files in a reader that others wrote: the Python package plyfile.

use std::num::NonZeroUsize;
use std::path::Path;
use std::process::Command;

use super::Run;
use super::ply::{Ply, parse};
use crate::training::config;

/// Prints the names of the properties, then the numbers of each vertex in a line.
const SCRIPT: &str = "\
import plyfile, sys
vertices = plyfile.PlyData.read(sys.argv[1])['vertex']
print(*(property.name for property in vertices.properties))
for row in vertices.data:
    print(*map(float, row))
";

/// What plyfile finds in a file.
fn read(path: &Path) -> Ply {
    let output = Command::new("python3").args(["-c", SCRIPT]).arg(path).output().expect("python3 can be started");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).expect("text");
    let mut lines = text.lines().map(|line| line.split(' '));
    let names = lines.next().expect("names").map(str::to_owned).collect();
    let number = |word: &str| word.parse().unwrap_or_else(|error| panic!("{word}: {error}"));
    Ply { names, rows: lines.map(|words| words.map(number).collect()).collect() }
}

#[test]
#[ignore = "needs python3 with the package plyfile"]
fn plyfile_finds_every_number_that_was_written() {
    let run = Run::new(config());
    let out = run.export("foreign", |args| args.frames = NonZeroUsize::new(1));
    for name in ["static.ply", "dynamic.ply", "frames/frame0001.ply"] {
        let (ours, theirs) = (parse(&out.join(name)), read(&out.join(name)));
        assert!(!ours.rows.is_empty(), "{name}");
        assert_eq!(ours.names, theirs.names, "{name}");
        assert!(ours.rows == theirs.rows, "{name}: plyfile finds other numbers");
    }
}
