//! `cargo xtask results`: trains every method on every scene and writes the tables of `docs/results.md`.

mod cells;
mod figures;
mod table;

use std::collections::VecDeque;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Mutex;

use anyhow::{Context, bail, ensure};
use clap::Args;

use cells::{Cell, SCENES};
use figures::Figures;

/// The page that the tables stand in.
const PAGE: &str = "docs/results.md";

/// The tables stand between these lines of the page; what stands around them was written by hand.
const BEGIN: &str = "<!-- cargo xtask results: begin -->";
const END: &str = "<!-- cargo xtask results: end -->";

/// Trains 4DGS, DeGauss, both with motion-aware refinement, on four scenes, and writes the tables of docs/results.md.
///
/// A run that is finished is not done again unless its configuration has changed, so the command can be stopped and started
/// at will; remove a run's folder, or all of --out, after a change of the code that matters. Scenes whose data are not there
/// are skipped.
#[derive(Debug, Args)]
pub struct ResultsArguments {
    /// Folder that holds the real scenes, each under the name that `--list` shows.
    #[arg(long, value_name = "DIR")]
    data_root: Option<PathBuf>,
    /// Folder with the weights of LPIPS; without it there are no such figures.
    #[arg(long, value_name = "DIR")]
    lpips_weights: Option<PathBuf>,
    /// Where the runs lie.
    #[arg(long, value_name = "DIR", default_value = "runs/results")]
    out: PathBuf,
    /// Seeds.
    #[arg(long, value_delimiter = ',', default_values_t = [11, 12, 13])]
    seeds: Vec<u64>,
    /// Runs at the same time, each on one thread.
    #[arg(long, default_value_t = 1)]
    jobs: usize,
    /// Shows what there is to do and does nothing.
    #[arg(long)]
    list: bool,
    /// Writes the tables of the runs that are finished, and starts none.
    #[arg(long)]
    table_only: bool,
}

/// Carries out the chore.
pub fn run(arguments: &ResultsArguments) -> anyhow::Result<()> {
    let cells = cells::all(arguments.data_root.as_deref(), arguments.lpips_weights.as_deref(), &arguments.seeds);
    build()?;
    if arguments.list {
        for scene in SCENES {
            say(&format!("{:16}{}", scene.name, scene.source));
        }
        for cell in &cells {
            let state = if finished(cell, &arguments.out)? { "finished" } else { "to do" };
            say(&format!("{state:16}{}", cell.name()));
        }
        return Ok(());
    }
    ensure!(arguments.jobs > 0, "--jobs must be at least 1");
    let mut failures = Vec::new();
    if !arguments.table_only {
        let (_, to_do) = divided(&cells, &arguments.out)?;
        failures = train(to_do.into(), arguments)?;
    }
    let (done, _) = divided(&cells, &arguments.out)?;
    let runs = done.into_iter().map(|cell| Ok((cell.clone(), Figures::read(&cell.folder(&arguments.out))?)));
    let runs = runs.collect::<anyhow::Result<Vec<_>>>()?;
    replace(Path::new(PAGE), &table::write(&runs))?;
    say(&format!("{} of {} runs are in {PAGE}", runs.len(), cells.len()));
    match failures.is_empty() {
        true => Ok(()),
        false => bail!("these runs failed, see the logs beside their folders: {}", failures.join(", ")),
    }
}

#[allow(clippy::print_stdout, reason = "the list is this program's output")]
fn say(line: &str) {
    println!("{line}");
}

/// Builds the program.
fn build() -> anyhow::Result<()> {
    let build = Command::new(env!("CARGO")).args(["build", "--package", "mvfusion-cli"]).status();
    ensure!(build.context("cannot start cargo")?.success(), "the program does not build");
    Ok(())
}

/// The program, which lies beside this one.
fn program() -> anyhow::Result<Command> {
    let path = std::env::current_exe()?.with_file_name(format!("mvfusion{}", std::env::consts::EXE_SUFFIX));
    Ok(Command::new(path))
}

/// Whether the figures of a run are there, trained with the configuration that it would have today.
fn finished(cell: &Cell, out: &Path) -> anyhow::Result<bool> {
    let folder = cell.folder(out);
    if !folder.join("results.json").is_file() {
        return Ok(false);
    }
    let path = folder.join("config.toml");
    let today = program()?.arg("config").args(cell.configuration()).output().context("cannot start the program")?;
    ensure!(today.status.success(), "{}: {}", cell.name(), String::from_utf8_lossy(&today.stderr).trim_end());
    // Keys that the program did not have then get their defaults, for `neu3d` sets none. A key that it has no longer is
    // a reason to train again.
    let then = program()?.args(["config", "--preset", "neu3d", "--config"]).arg(&path).output();
    let then = then.context("cannot start the program")?;
    Ok(then.status.success() && then.stdout == today.stdout)
}

/// The finished runs, and those that are to do.
fn divided<'a>(cells: &'a [Cell], out: &Path) -> anyhow::Result<(Vec<&'a Cell>, Vec<&'a Cell>)> {
    let (mut done, mut to_do) = (Vec::new(), Vec::new());
    for cell in cells {
        if finished(cell, out)? { &mut done } else { &mut to_do }.push(cell);
    }
    Ok((done, to_do))
}

/// Trains what there is to do. Returns the names of the runs that failed.
fn train(to_do: VecDeque<&Cell>, arguments: &ResultsArguments) -> anyhow::Result<Vec<String>> {
    fs::create_dir_all(&arguments.out).with_context(|| format!("cannot make {}", arguments.out.display()))?;
    let (queue, failures) = (Mutex::new(to_do), Mutex::new(Vec::new()));
    let work = || {
        while let Some(cell) = next(&queue) {
            say(&cell.name());
            if let Err(error) = train_one(cell, &arguments.out) {
                say(&format!("{}: {error:#}", cell.name()));
                push(&failures, cell.name());
            }
        }
    };
    std::thread::scope(|scope| {
        for _ in 0..arguments.jobs {
            scope.spawn(work);
        }
    });
    Ok(failures.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner))
}

fn next<'a>(queue: &Mutex<VecDeque<&'a Cell>>) -> Option<&'a Cell> {
    queue.lock().unwrap_or_else(std::sync::PoisonError::into_inner).pop_front()
}

fn push(failures: &Mutex<Vec<String>>, name: String) {
    failures.lock().unwrap_or_else(std::sync::PoisonError::into_inner).push(name);
}

fn train_one(cell: &Cell, out: &Path) -> anyhow::Result<()> {
    let log = out.join(format!("{}.log", cell.name()));
    let output = fs::File::create(&log).with_context(|| format!("cannot write {}", log.display()))?;
    let errors = output.try_clone()?;
    let status = program()?
        .arg("train")
        .args(cell.configuration())
        .args(["--threads", "1", "--force", "--out"])
        .arg(cell.folder(out))
        .stdin(Stdio::null())
        .stdout(output)
        .stderr(errors)
        .status()
        .context("cannot start the program")?;
    ensure!(status.success(), "{status}; its last words are in {}", log.display());
    Ok(())
}

/// Puts `tables` between the marks of a page.
fn replace(page: &Path, tables: &str) -> anyhow::Result<()> {
    let text = fs::read_to_string(page).with_context(|| format!("cannot read {}", page.display()))?;
    let (Some(begin), Some(end)) = (text.find(BEGIN), text.find(END)) else {
        bail!("{} lacks the lines `{BEGIN}` and `{END}`", page.display());
    };
    let text = format!("{}{BEGIN}\n{tables}{}", &text[..begin], &text[end..]);
    fs::write(page, text).with_context(|| format!("cannot write {}", page.display()))
}
