//! Interruptions at random moments.

use std::path::Path;
use std::process::Child;
use std::time::Duration;

use anyhow::Result;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::Tally;
use super::ground::{Ground, Outcome, end, has_checkpoint, logged, said, signal};

/// A checkpoint every other step.
const OFTEN: [&str; 2] = ["--set", "train.checkpoint_interval=2"];

/// How a training is interrupted.
#[derive(Clone, Copy, Debug)]
pub struct Interruption {
    /// The signal.
    signal: &'static str,
    /// Settings of checkpoints.
    settings: &'static [&'static str],
    /// A run that logged this many steps must have a checkpoint.
    due: usize,
}

/// SIGKILL with a checkpoint every other step: the third step begins after the first checkpoint.
pub const KILL: Interruption = Interruption { signal: "KILL", settings: &OFTEN, due: 3 };
/// SIGKILL with the default checkpoints: the second step begins after the first one.
pub const KILL_DEFAULTS: Interruption = Interruption { signal: "KILL", settings: &[], due: 2 };
/// SIGTERM, which writes one; a first checkpoint comes after the first step.
pub const TERMINATE: Interruption = Interruption { signal: "TERM", settings: &[], due: 2 };

/// Exit code after SIGTERM.
const TERMINATED: i32 = 143;

/// Interrupts trainings, and goes on with them, until `count` interruptions have been done; the last one is completed.
pub fn interrupt(ground: &Ground, how: Interruption, count: usize, random: &mut ChaCha8Rng) -> Result<Tally> {
    let mut tally = Tally::default();
    let mut run = ground.fresh()?;
    while tally.done < count {
        let child = go_on(ground, &run, "1", how.settings)?;
        pause(ground, random);
        signal(&child, how.signal)?;
        let output = end(child)?;
        if output.status.success() {
            compare(&mut tally, &run, &ground.reference[0]);
            run = ground.fresh()?;
            continue;
        }
        tally.done += 1;
        let is_saved = has_checkpoint(&run);
        if how.signal == "TERM" && !matches!(output.status.code(), None | Some(TERMINATED)) {
            tally.lost.push(format!("{}: {}", output.status, said(&output)));
        }
        if !is_saved && logged(&run) >= how.due {
            tally.lost.push(format!("no checkpoint after {} steps", logged(&run)));
        }
        tally.early += usize::from(!is_saved);
    }
    complete(ground, &run, &mut tally, &ground.reference[0])?;
    Ok(tally)
}

/// Kills trainings that replace a finished run. Every other time, the old run is brought back; otherwise the new one
/// goes on.
pub fn replace(ground: &Ground, count: usize, random: &mut ChaCha8Rng) -> Result<Tally> {
    let mut tally = Tally::default();
    let mut run = ground.finished()?;
    for number in 0..count {
        let child = ground.begin(&run, "2", &["--force", OFTEN[0], OFTEN[1]])?;
        pause(ground, random);
        signal(&child, "KILL")?;
        end(child)?;
        tally.done += 1;
        // Until `.replaced` has its name, what is in the folder belongs to the old run.
        let is_new = has_checkpoint(&run) && run.join(".replaced").exists();
        tally.early += usize::from(!is_new);
        if is_new && number % 2 == 1 {
            complete(ground, &run, &mut tally, &ground.reference[1])?;
            run = ground.finished()?;
            continue;
        }
        if Outcome::of(&run).ok().as_ref() == Some(&ground.reference[1]) {
            // It ended before the signal came.
            run = ground.finished()?;
            continue;
        }
        if let Err(error) = ground.ask("restore", &run, &["--force"]) {
            tally.lost.push(format!("{error:#}"));
        }
        compare(&mut tally, &run, &ground.reference[0]);
        if let Err(error) = ground.ask("eval", &run, &["--speed-frames", "0"]) {
            tally.lost.push(format!("{error:#}"));
        }
    }
    Ok(tally)
}

/// Starts two trainings at once in one folder: one must be refused, the other end as if it were alone. Every other
/// time, both go on with an interrupted run.
pub fn double(ground: &Ground, count: usize, random: &mut ChaCha8Rng) -> Result<Tally> {
    let mut tally = Tally::default();
    for number in 0..count {
        let run = ground.fresh()?;
        if number % 2 == 1 {
            let child = ground.begin(&run, "1", &OFTEN)?;
            pause(ground, random);
            signal(&child, "KILL")?;
            end(child)?;
        }
        let start = || -> Result<Child> { go_on(ground, &run, "1", &[]) };
        let pair = [start()?, start()?].map(end);
        tally.done += 1;
        let [first, second] = pair;
        let outputs = [first?, second?];
        let refused: Vec<_> = outputs.iter().filter(|output| !output.status.success()).collect();
        match refused.as_slice() {
            [one] if one.status.code().is_some_and(|code| code <= 2) => {}
            _ => {
                tally.lost.push(format!("{} of two failed: {}", refused.len(), outputs.each_ref().map(said).join("; ")))
            }
        }
        compare(&mut tally, &run, &ground.reference[0]);
    }
    Ok(tally)
}

/// Begins a training, or goes on with it if it has a checkpoint.
fn go_on(ground: &Ground, run: &Path, seed: &str, settings: &[&str]) -> Result<Child> {
    if has_checkpoint(run) {
        return ground.resume(run, settings);
    }
    let anew: &[&str] = if run.exists() { &["--force"] } else { &[] };
    ground.begin(run, seed, &[settings, anew].concat())
}

/// Goes on with a training to its end.
fn complete(ground: &Ground, run: &Path, tally: &mut Tally, reference: &Outcome) -> Result<()> {
    let is_finished = Outcome::of(run).is_ok();
    let output = if is_finished { None } else { Some(end(go_on(ground, run, "1", &[])?)?) };
    match output {
        Some(output) if !output.status.success() => tally.lost.push(format!("it cannot go on: {}", said(&output))),
        _ => compare(tally, run, reference),
    }
    Ok(())
}

/// Counts a run with another outcome as lost.
fn compare(tally: &mut Tally, run: &Path, reference: &Outcome) {
    match Outcome::of(run) {
        Ok(outcome) if outcome == *reference => {}
        Ok(_) => tally.lost.push("it ended with other parameters or metrics".to_owned()),
        Err(error) => tally.lost.push(format!("{error:#}")),
    }
}

/// Waits for a random part of the time that a run takes.
fn pause(ground: &Ground, random: &mut ChaCha8Rng) {
    std::thread::sleep(ground.duration.mul_f64(random.random_range(0.0..1.0)) + Duration::from_millis(1));
}
