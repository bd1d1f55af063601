//! Gives a reader damaged files, one after another.

use std::fs;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::sync::mpsc::{self, RecvTimeoutError};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::ALLOCATOR;
use crate::mutation::mutated;
use crate::readers::{Target, Targets};

/// Time after which a reader counts as hanging, on a machine that does other work, too. Reading a file takes
/// milliseconds; the table shows the longest time.
const PATIENCE: Duration = Duration::from_secs(60);

/// Failures after which a reader is given no more files.
const MOST_FAILURES: usize = 20;

/// Damaged files after which a sound reader has refused one. If it has not, it does not read the file.
const SURELY_NOTICED: u64 = 25;

/// Readers that go on without a damaged file: the report tells what it lacks, and a cell that cannot be read is to be
/// trained.
const LENIENT: [&str; 2] = ["report", "sweep_index"];

/// Longest message. It repeats names and numbers of the file, never the file itself.
const LONGEST_MESSAGE: usize = 20_000;

/// The last panic: where, and with which words.
static PANIC: Mutex<String> = Mutex::new(String::new());

/// How much is tried.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Files of each reader.
    files: u64,
    /// Time of each reader, however few files that are.
    budget: Duration,
    /// Number of the first file.
    first: u64,
    /// Whether a person has asked for more than the tests do.
    pub is_by_hand: bool,
}

impl Settings {
    /// Files of each reader in the tests.
    pub const FILES: u64 = 200;

    /// What `MUTATE_FILES`, `MUTATE_SECONDS` and `MUTATE_FIRST` ask for.
    pub fn from_environment() -> Self {
        let files = number("MUTATE_FILES");
        Self {
            files: files.unwrap_or(Self::FILES),
            budget: number("MUTATE_SECONDS").map_or(Duration::MAX, Duration::from_secs),
            first: number("MUTATE_FIRST").unwrap_or(0),
            is_by_hand: files.is_some(),
        }
    }
}

fn number<T: FromStr>(name: &str) -> Option<T> {
    std::env::var(name).ok().and_then(|text| text.parse().ok())
}

/// What came of the files of a reader.
#[derive(Debug, Default)]
pub struct Outcome {
    name: &'static str,
    files: u64,
    accepted: u64,
    refused: u64,
    panics: u64,
    longest: Duration,
    /// Bytes that one file took at most.
    memory: usize,
    /// What went wrong, with the place of the file.
    pub failures: Vec<String>,
}

/// A table of outcomes in Markdown.
pub fn table(outcomes: &[Outcome]) -> String {
    let head = "| reader | files | accepted | refused | panics | other failures | longest, ms | memory, MB |\n\
                |---|---|---|---|---|---|---|---|\n";
    let row = |outcome: &Outcome| {
        let Outcome { name, files, accepted, refused, panics, longest, memory, failures } = outcome;
        let (others, memory) = (failures.len() as u64 - panics, *memory as f64 / 1e6);
        let longest = longest.as_millis();
        format!("| {name} | {files} | {accepted} | {refused} | {panics} | {others} | {longest} | {memory:.1} |\n")
    };
    head.to_owned() + &outcomes.iter().map(row).collect::<String>()
}

/// Damages the files of a reader. Everything happens in folders of `place`.
pub fn run(name: &'static str, targets: Targets, place: &Path, settings: Settings) -> Outcome {
    let folder = place.join(name);
    fs::create_dir(&folder).expect("made");
    let targets = targets(&folder);
    let (alive, watch) = mpsc::channel::<(u64, PathBuf)>();
    let watchdog = std::thread::spawn(move || watch_over(name, &watch));
    std::panic::set_hook(Box::new(|panic| {
        let place = panic.location().map(ToString::to_string).unwrap_or_default();
        let words = panic.payload_as_str().unwrap_or("no words");
        *PANIC.lock().unwrap_or_else(PoisonError::into_inner) = format!("{place}: {words}");
    }));
    let mut outcome = Outcome { name, ..Outcome::default() };
    let started = Instant::now();
    let sound: Vec<Vec<u8>> = targets.iter().map(|target| fs::read(&target.file).expect("a sound file")).collect();
    let mut noticed = vec![[0u64; 2]; targets.len()];
    for number in settings.first..settings.first + settings.files {
        if started.elapsed() > settings.budget || outcome.failures.len() >= MOST_FAILURES {
            break;
        }
        let turn = (number % targets.len() as u64) as usize;
        let (target, sound) = (&targets[turn], &sound[turn]);
        let content = mutated(sound, target.kind, &mut random(name, number));
        fs::write(&target.file, &content).expect("written");
        let _ = alive.send((number, target.file.clone()));
        let refused = outcome.refused;
        if let Err(reason) = outcome.count(target, content.len()) {
            let kept = keep(name, number, &content);
            outcome.failures.push(format!("{name}, number {number}, {}: {reason}", kept.display()));
        }
        noticed[turn][0] += 1;
        noticed[turn][1] += outcome.refused - refused;
        fs::write(&target.file, sound).expect("restored");
    }
    for ([files, refused], target) in noticed.into_iter().zip(&targets) {
        if files >= SURELY_NOTICED && refused == 0 && !LENIENT.contains(&name) {
            outcome.failures.push(format!("{name}: none of {files} times was {} refused", target.file.display()));
        }
    }
    let _ = std::panic::take_hook();
    drop(alive);
    watchdog.join().expect("the watchdog ends");
    drop(targets);
    fs::remove_dir_all(&folder).expect("removed");
    outcome
}

/// The damage of a file depends on the reader and the number of the file alone.
fn random(name: &str, number: u64) -> ChaCha8Rng {
    let mut hasher = DefaultHasher::new();
    (name, number).hash(&mut hasher);
    ChaCha8Rng::seed_from_u64(hasher.finish())
}

/// Keeps a file for a closer look.
fn keep(name: &str, number: u64, content: &[u8]) -> PathBuf {
    let folder = std::env::temp_dir().join("mvfusion-mutate");
    let path = folder.join(format!("{name}-{number}"));
    fs::create_dir_all(&folder).and_then(|()| fs::write(&path, content)).expect("kept");
    path
}

impl Outcome {
    /// Reads a damaged file. The error says what is wrong with the answer.
    fn count(&mut self, target: &Target, bytes: usize) -> Result<(), String> {
        let before = ALLOCATOR.current_usage();
        ALLOCATOR.reset_peak_usage();
        let started = Instant::now();
        let answer = catch_unwind(AssertUnwindSafe(|| (target.read)()));
        self.longest = self.longest.max(started.elapsed());
        let taken = ALLOCATOR.peak_usage().saturating_sub(before);
        self.memory = self.memory.max(taken);
        self.files += 1;
        match answer {
            Err(_) => {
                self.panics += 1;
                return Err(format!("panicked at {}", PANIC.lock().unwrap_or_else(PoisonError::into_inner)));
            }
            Ok(Ok(soundness)) => {
                self.accepted += 1;
                soundness?;
            }
            Ok(Err(message)) => {
                self.refused += 1;
                if message.trim().is_empty() || message.len() > LONGEST_MESSAGE {
                    return Err(format!("a message of {} bytes", message.len()));
                }
            }
        }
        let most = target.room.fixed + target.room.times * (bytes + target.others);
        if taken > most { Err(format!("{taken} bytes were taken, more than {most}")) } else { Ok(()) }
    }
}

/// Ends the process after too long a silence, because a hanging test cannot fail.
fn watch_over(name: &str, watch: &mpsc::Receiver<(u64, PathBuf)>) {
    let mut last = None;
    loop {
        match watch.recv_timeout(PATIENCE) {
            Ok(next) => last = Some(next),
            Err(RecvTimeoutError::Disconnected) => return,
            Err(RecvTimeoutError::Timeout) => {
                let Some((number, file)) = last else { continue };
                let kept = fs::read(&file).map(|content| keep(name, number, &content));
                eprintln!("{name} hangs at number {number}: {kept:?}");
                std::process::abort();
            }
        }
    }
}
