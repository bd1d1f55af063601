//! Every number of the configuration at the ends of its range and beyond it: refused by its key, or some steps of
//! training with finite numbers. The table of cases is made from the configuration itself.

use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use burn::tensor::Tensor;
use mvfusion_cli::args::ConfigSourceArgs;
use mvfusion_cli::device::{self, OpenDevice};
use mvfusion_cli::memory::{Available, refusal_of_training};
use mvfusion_cli::{config, failure};
use mvfusion_data::builtin::builtin;
use mvfusion_data::{BuiltinKind, BuiltinOptions, PointCloud, Scene};
use mvfusion_model::ModelError;
use mvfusion_model::config::{Config, NumberKind, NumericKey};
use mvfusion_model::memory::MemoryNeed;
use mvfusion_model::train::Trainer;
use mvfusion_tests::numbers;

/// Set to anything, all accepted cases train, which takes a minute. Otherwise one in [`SHARE`] does.
const ALL: &str = "MVFUSION_ALL_RANGES";

/// One in this many cases trains in a usual test run.
const SHARE: usize = 4;

/// Memory that a case may need, in bytes: the program and a little.
const MEMORY: u64 = 300_000_000;

/// Steps of a case: all three stages, and every event of training at least once.
const STAGES: &str = "train.stages={geometry=6, deformation=6, refinement=8}";

/// A run of a moment with everything in it.
const SETTINGS: [&str; 37] = [
    STAGES,
    "train.batch_size=1",
    "train.accumulation=2",
    "train.log_interval=1",
    "train.dynamic_sh_interval=3",
    "train.static_sh_interval=3",
    "train.lonely_visits=1.0",
    "model.width=8",
    "model.exposure=true",
    "model.grid.features=2",
    "model.grid.resolution=[4, 4, 4, 4]",
    "model.grid.multipliers=[1]",
    "motion.interval=3",
    "motion.samples=4",
    "motion.knot_stride=2",
    "motion.hidden=8",
    "motion.attention_width=8",
    "motion.heads=2",
    "motion.octaves=2",
    "init.dynamic_points=30",
    "init.motion_points=20",
    "init.dynamic_from_cloud=10",
    "init.sky_points=10",
    "init.static_points=10",
    "init.photo_points=20",
    "densify.from=0",
    "densify.until=100",
    "densify.interval=2",
    "densify.prune_from=0",
    "densify.prune_interval=3",
    "densify.reset_interval=5",
    "densify.births_interval=4",
    "densify.births=5",
    "densify.dynamic.max_gaussians=80",
    "densify.static.max_gaussians=80",
    "densify.dynamic.prune_above=10",
    "densify.static.prune_above=10",
];

/// One number of the configuration with one value.
#[derive(Debug)]
struct Case {
    key: NumericKey,
    /// The value, as TOML.
    value: String,
    is_in_range: bool,
}

/// What became of a case.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Outcome {
    /// Refused: the value is out of range, or of another type.
    OutOfRange,
    /// Refused beside the other keys.
    Contradiction,
    /// Refused for its memory.
    Memory,
    /// All steps have finite numbers.
    Trained,
    /// Accepted, and trained only with [`ALL`].
    Accepted,
}

/// A number as TOML.
fn written(value: f64, kind: NumberKind) -> String {
    match kind {
        NumberKind::Real if value.is_finite() => format!("{value:?}"),
        NumberKind::Real => value.to_string().to_lowercase(),
        // TOML ends at the largest of 64 bits.
        _ if value >= i64::MAX as f64 && value < 1e20 => i64::MAX.to_string(),
        _ if value.fract() == 0.0 && value.abs() < 1e20 => (value as i64).to_string(),
        _ => format!("{value:?}").to_lowercase(),
    }
}

fn cases(config: &Config) -> Vec<Case> {
    let mut cases = Vec::new();
    for key in config.numeric_keys() {
        let mut seen = Vec::new();
        for value in [0.0, -1.0, 1e30, f64::NAN, key.least, key.most] {
            let mut text = written(value, key.kind);
            if key.kind == NumberKind::List {
                text = if key.key.ends_with("resolution") { format!("[{text}, 4, 4, 4]") } else { format!("[{text}]") };
            }
            let is_in_range = key.least <= value && value <= key.most;
            if !seen.contains(&text) {
                seen.push(text.clone());
                cases.push(Case { key: key.clone(), value: text, is_in_range });
            }
        }
    }
    cases
}

/// A scene of few, small pictures and points.
fn scene(kind: BuiltinKind) -> Scene {
    let options = BuiltinOptions { width: 16, height: 16, frames: 4, photos: 6, ..BuiltinOptions::of_kind(kind) };
    let scene = builtin(&options);
    let mut points = PointCloud::default();
    (0..40).for_each(|index| points.push(scene.points.positions[index], scene.points.colours[index]));
    Scene { points, ..scene }
}

/// The scenes and the device that all cases share.
struct Bench {
    video: Scene,
    photos: Scene,
    device: OpenDevice,
}

impl Bench {
    fn new() -> Self {
        let device = device::open("cpu").expect("this build has a CPU device");
        Self { video: scene(BuiltinKind::Video), photos: scene(BuiltinKind::Casual), device }
    }

    /// The settings of all cases on this scene, and of one case.
    fn sources(&self, more: &[String]) -> ConfigSourceArgs {
        let set = SETTINGS.iter().map(|&setting| setting.to_owned()).chain(more.iter().cloned()).collect();
        ConfigSourceArgs { set, ..ConfigSourceArgs::default() }
    }

    /// What becomes of a case; the error is what should not.
    fn outcome(&self, case: &Case, trains: bool) -> Result<Outcome, String> {
        let key = &case.key.key;
        let setting = vec![format!("{key}={}", case.value)];
        let resolved = match config::resolve(&self.sources(&setting), None) {
            Ok(resolved) => resolved,
            Err(error) => return refused(case, &error),
        };
        let scene = if key.starts_with("init.photo") { &self.photos } else { &self.video };
        let config = resolved.config.for_times_of(scene).scaled();
        let need = MemoryNeed::of(&config, scene, 0).map_err(|error| error.to_string())?;
        let available = Available { bytes: MEMORY, limit: "are free".to_owned() };
        if let Some(said) = refusal_of_training(&need, &config, &self.device, Some(&available)) {
            return if said.contains(&format!("`{key}`")) { Ok(Outcome::Memory) } else { Err(said) };
        }
        if !trains {
            return Ok(Outcome::Accepted);
        }
        let mut trainer = match Trainer::new(config, scene, &self.device.device) {
            Ok(trainer) => trainer,
            Err(error) => return refused(case, &error.into()),
        };
        while let Some(losses) = trainer.step().map_err(|error: ModelError| error.to_string())? {
            let loss = numbers(losses.total);
            if trainer.state().completed >= 20 {
                break;
            }
            if !loss.iter().all(|loss| loss.is_finite()) {
                return Err(format!("the loss is {loss:?} after {} steps", trainer.state().completed));
            }
        }
        check_moments(&trainer)?;
        Ok(Outcome::Trained)
    }
}

/// A refusal names the key, and the valid values if the value is none of them.
fn refused(case: &Case, error: &anyhow::Error) -> Result<Outcome, String> {
    let (said, key) = (format!("{error:#}"), &case.key.key);
    if !said.contains(&format!("`{key}`")) || failure::exit_code(error) != failure::USAGE {
        return Err(format!("refused without its key: {said}"));
    }
    match (case.is_in_range, said.contains("(from ") || said.contains(" must be ")) {
        (true, _) => Ok(Outcome::Contradiction),
        (false, true) => Ok(Outcome::OutOfRange),
        (false, false) => Err(format!("refused without its range: {said}")),
    }
}

/// Checks Adam's moments, which no step does.
fn check_moments(trainer: &Trainer) -> Result<(), String> {
    fn check<const D: usize>(name: &str, moments: [&Tensor<D>; 2]) -> Result<(), String> {
        let finite = |tensor: &Tensor<D>| numbers(tensor.clone()).iter().all(|value| value.is_finite());
        if moments.into_iter().all(finite) { Ok(()) } else { Err(format!("the moments of {name} are not finite")) }
    }
    let state = trainer.state();
    for branch in std::iter::once(&state.dynamic).chain(&state.static_) {
        for (attribute, moments) in &branch.optimiser.moments {
            check(&attribute.to_string(), [&moments.first, &moments.second])?;
        }
    }
    let mut modules = state.optimiser.moments.iter();
    modules.try_for_each(|(name, moments)| check(name, [&moments.first, &moments.second]))
}

#[test]
fn every_number_is_refused_by_its_key_and_range_or_trains_to_finite_numbers() {
    let bench = Bench::new();
    let base = config::resolve(&bench.sources(&[]), None).expect("the settings are valid").config;
    let cases = cases(&base);
    let (all, next) = (std::env::var_os(ALL).is_some(), AtomicUsize::new(0));
    let (counts, faults) = (Mutex::new(BTreeMap::<Outcome, usize>::new()), Mutex::new(Vec::new()));
    let work = || {
        loop {
            let index = next.fetch_add(1, Ordering::Relaxed);
            let Some(case) = cases.get(index) else { break };
            let trains = all || index.is_multiple_of(SHARE);
            // A panic is a fault of its case alone.
            let outcome = catch_unwind(AssertUnwindSafe(|| bench.outcome(case, trains)));
            match outcome.unwrap_or_else(|_| Err("it panics".to_owned())) {
                Ok(outcome) => *counts.lock().expect("no panic").entry(outcome).or_default() += 1,
                Err(fault) => {
                    faults.lock().expect("no panic").push(format!("{} = {}: {fault}", case.key.key, case.value))
                }
            }
        }
    };
    std::thread::scope(|scope| {
        let threads = std::thread::available_parallelism().map_or(1, std::num::NonZeroUsize::get);
        (0..threads).for_each(|_| {
            scope.spawn(work);
        });
    });
    let (counts, faults) = (counts.into_inner().expect("no panic"), faults.into_inner().expect("no panic"));
    eprintln!("{} keys, {} cases: {counts:?}", base.numeric_keys().len(), cases.len());
    assert!(faults.is_empty(), "{} of {} cases:\n{}", faults.len(), cases.len(), faults.join("\n"));
}
