//! The program COLMAP: where it is, its version, and the options that it knows.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use super::super::error::PrepareError;
use super::super::options::Gpu;

/// Names of the program on the path. On Windows it is started by a script.
const NAMES: &[&str] = if cfg!(windows) { &["colmap", "COLMAP.bat"] } else { &["colmap"] };

/// The oldest version that was tried.
const OLDEST: (u32, u32) = (3, 8);

/// The program.
#[derive(Clone, Debug)]
pub(super) struct Program {
    path: PathBuf,
    /// `3.8`, as it says.
    version: String,
    has_cuda: bool,
}

impl Program {
    /// The program that was named, or the one on the path.
    ///
    /// # Errors
    /// [`PrepareError::NoColmap`] if it cannot be started or is another program.
    pub(super) fn find(named: Option<&Path>) -> Result<Self, PrepareError> {
        let candidates: Vec<PathBuf> = match named {
            Some(path) => vec![path.to_owned()],
            None => NAMES.iter().map(PathBuf::from).collect(),
        };
        let mut refusal = "is not there".to_owned();
        for path in &candidates {
            match output(path, &["-h"]) {
                Ok(output) => return Self::of(path, &output),
                Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
                    refusal = match named {
                        Some(_) => "is not there".into(),
                        None => "is not on the path".into(),
                    };
                }
                Err(error) => refusal = format!("cannot be started ({error})"),
            }
        }
        let program = candidates.first().map(|path| path.display().to_string()).unwrap_or_default();
        Err(PrepareError::NoColmap { program, reason: refusal })
    }

    /// Reads what the program says of itself.
    fn of(path: &Path, output: &Output) -> Result<Self, PrepareError> {
        let said = both(output);
        let mut words = said.split_whitespace().skip_while(|word| *word != "COLMAP").skip(1);
        let version = words.next().filter(|word| number(word).is_some());
        let version = version.ok_or_else(|| PrepareError::NoColmap {
            program: path.display().to_string(),
            reason: "does not say that it is COLMAP".into(),
        })?;
        Ok(Self { path: path.to_owned(), version: version.to_owned(), has_cuda: said.contains("with CUDA") })
    }

    /// The version.
    pub(super) fn version(&self) -> &str {
        &self.version
    }

    /// Whether it is older than any version that was tried.
    pub(super) fn is_old(&self) -> bool {
        number(&self.version).is_some_and(|number| number < OLDEST)
    }

    /// Whether it is to compute on a GPU.
    pub(super) fn uses_gpu(&self, gpu: Gpu) -> bool {
        match gpu {
            Gpu::On => true,
            Gpu::Off => false,
            Gpu::Auto => self.has_cuda && output(Path::new("nvidia-smi"), &["-L"]).is_ok_and(|o| o.status.success()),
        }
    }

    /// The options that a command knows, such as `Mapper.num_threads`. Their names differ between versions.
    pub(super) fn options_of(&self, step: &str) -> BTreeSet<String> {
        let said = output(&self.path, &[step, "-h"]).map(|output| both(&output)).unwrap_or_default();
        let names = said.split_whitespace().filter_map(|word| word.strip_prefix("--"));
        names.map(str::to_owned).collect()
    }

    /// A command of the program.
    pub(super) fn command(&self, step: &str) -> Command {
        let mut command = Command::new(&self.path);
        command.arg(step).stdin(Stdio::null());
        command
    }
}

/// Runs a program to its end.
fn output(path: &Path, arguments: &[&str]) -> std::io::Result<Output> {
    Command::new(path).args(arguments).stdin(Stdio::null()).output()
}

/// What a program says. COLMAP writes help to either stream, depending on the version.
fn both(output: &Output) -> String {
    [&output.stdout, &output.stderr].map(|stream| String::from_utf8_lossy(stream)).join("\n")
}

/// Major and minor number of a version such as `3.12.0.dev0`.
fn number(version: &str) -> Option<(u32, u32)> {
    let mut parts = version.split('.');
    let digits = |part: &str| part.trim_end_matches(|c: char| !c.is_ascii_digit()).parse().ok();
    Some((digits(parts.next()?)?, digits(parts.next()?)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_are_read_and_compared() {
        assert_eq!(
            ["3.8", "3.12.0.dev0", "4.0-dev", "wood"].map(number),
            [Some((3, 8)), Some((3, 12)), Some((4, 0)), None]
        );
        let program = |version: &str| Program { path: "colmap".into(), version: version.into(), has_cuda: false };
        assert!(program("3.7").is_old() && !program("3.8").is_old() && !program("3.13.0").is_old());
    }

    #[test]
    fn a_program_that_is_not_there_or_another_one_is_refused_with_the_ways_to_get_colmap() {
        let said = Program::find(Some(Path::new("no/such/colmap"))).expect_err("absent").to_string();
        for part in ["`no/such/colmap` is not there", "apt install", "brew install", "conda install", "Windows"] {
            assert!(said.contains(part), "{said}");
        }
        // Every system that runs these tests has cargo.
        let said = Program::find(Some(Path::new(env!("CARGO")))).expect_err("another program").to_string();
        assert!(said.contains("does not say that it is COLMAP"), "{said}");
    }
}
