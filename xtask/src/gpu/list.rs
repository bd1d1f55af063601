//! What a GPU is asked, in the order of worth: whoever has little time has the first answers.

use std::time::Duration;

/// The program that answers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Program {
    /// The program of the project.
    Mvfusion,
    /// The tests against oracles.
    Oracles,
    /// These chores.
    Xtask,
    /// A program of the machine, which may be missing.
    Machine(&'static str),
}

/// What an entry must come to, as far as this chore can tell. The rest is for people: [`Entry::look_for`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Goal {
    /// It ends with the exit status 0.
    End,
    /// So it does, and at least one test has run.
    Tests,
    /// `mvfusion devices` lists the device of this name. Only a rehearsal takes a software driver.
    Device { name: String, rehearsal: bool },
    /// Its training has written a checkpoint. Then it is killed on purpose.
    Checkpoint,
}

/// One question.
#[derive(Clone, Debug)]
pub(super) struct Entry {
    /// Its name, also of the file with what was said.
    pub name: &'static str,
    pub program: Program,
    pub arguments: Vec<String>,
    /// Variables of its environment.
    pub environment: Vec<(&'static str, &'static str)>,
    /// It is ended after this time.
    pub limit: Duration,
    pub goal: Goal,
    /// What the reader of the answer should look for.
    pub look_for: &'static str,
}

/// The arguments before the name of what an entry makes.
const MAKERS: [&str; 3] = ["--json", "--out", "synth"];

impl Entry {
    /// The file or folder that it makes within the folder of the results.
    pub(super) fn makes(&self) -> Option<&str> {
        let pair = self.arguments.windows(2).find(|pair| MAKERS.contains(&pair[0].as_str()))?;
        Some(pair[1].as_str())
    }
}

/// The sizes of the benchmarks: the quickstart, the paper's pictures, the paper's Gaussians.
const SPLATS: &str = "12000@160x120,30000@1352x1014,300000@1352x1014";
const NETS: &str = "4000,30000,90000";

/// The seeds of the trainings on the GPU and on the CPU.
const SEEDS: [u64; 3] = [11, 12, 13];

/// The training that is killed has one checkpoint before its end: after these of its 3300 steps, in the last stage,
/// where there is most to bring back. `train.scale` shortens this number with the stages.
const CHECKPOINT: usize = 2000;

/// Small sizes for a rehearsal on a software driver.
const SMALL_SPLATS: &str = "2000@160x120";
const SMALL_NETS: &str = "1000";

/// The list for a device, such as `wgpu:0`. A rehearsal asks the same of a software driver, in small.
pub(super) fn list(device: &str, rehearsal: bool) -> Vec<Entry> {
    let (splats, nets) = if rehearsal { (SMALL_SPLATS, SMALL_NETS) } else { (SPLATS, NETS) };
    let repeat = if rehearsal { "1" } else { "15" };
    let backend = device.split(':').next().unwrap_or(device);
    let entry = |name, program: Program, arguments: &str, minutes: u64, look_for| Entry {
        name,
        program,
        arguments: arguments.split_whitespace().map(str::to_owned).collect(),
        environment: Vec::new(),
        limit: Duration::from_secs(60 * minutes),
        goal: if program == Program::Oracles { Goal::Tests } else { Goal::End },
        look_for,
    };
    let with = |entry: Entry, environment: &[(&'static str, &'static str)]| Entry {
        environment: environment.to_vec(),
        ..entry
    };
    let bench = |what: &str| format!("bench {what} --devices {device} --repeat {repeat}");
    let step = if rehearsal { "1000@160x120 --static 2000" } else { "30000@1352x1014 --static 300000" };
    let devices = entry("devices", Program::Mvfusion, "devices", 2, "the card and its limits");
    let mut list = vec![
        entry("card", Program::Machine("nvidia-smi"), "", 1, "the card and its driver"),
        Entry { goal: Goal::Device { name: device.to_owned(), rehearsal }, ..devices },
        entry("parity", Program::Oracles, &format!("parity::{backend}"), 10, "every op agrees with flex"),
        entry(
            "splat",
            Program::Xtask,
            &bench(&format!("splat --scene {splats} --json splat.json")),
            5,
            "forward and backward times",
        ),
        entry("net", Program::Xtask, &bench(&format!("net --gaussians {nets} --json net.json")), 5, "times"),
        entry("step", Program::Xtask, &bench(&format!("step --scene {step} --json step.json")), 10, "30 ms refined"),
        entry("launches", Program::Xtask, &format!("bench launches --devices {device} --scene {step}"), 5, "counts"),
    ];
    for (name, tasks) in [("step-32-tasks", "32"), ("step-128-tasks", "128")] {
        let again =
            entry(name, Program::Xtask, &bench(&format!("step --scene {step}")), 5, "times below those of step");
        list.push(with(again, &[("CUBECL_WGPU_MAX_TASKS", tasks)]));
    }
    list.push(with(
        entry(
            "profile",
            Program::Xtask,
            &format!("bench step --devices {device} --repeat 1 --scene {step}"),
            5,
            "times by kernel",
        ),
        &[("CUBECL_DEBUG_OPTION", "profile-medium"), ("CUBECL_DEBUG_LOG", "profile.log")],
    ));
    list.push(entry("oracles", Program::Oracles, &format!("oracle::{backend}"), 10, "as on flex, within tolerances"));
    list.push(entry("training", Program::Oracles, &format!("training::{backend}"), 10, "losses agree, memory stays"));
    let train = |arguments: &str| {
        let scale = if rehearsal { "0.01" } else { "1" };
        format!("train {arguments} --set train.scale={scale}")
    };
    for (seed, [on_gpu, on_cpu]) in SEEDS.into_iter().zip([
        ["train-11-gpu", "train-11-flex"],
        ["train-12-gpu", "train-12-flex"],
        ["train-13-gpu", "train-13-flex"],
    ]) {
        for (name, device) in [(on_gpu, device), (on_cpu, "flex")] {
            let arguments = train(&format!("--device {device} --seed {seed} --out {name}"));
            list.push(entry(name, Program::Mvfusion, &arguments, 10, "PSNR within the spread of seeds"));
        }
        if rehearsal {
            break;
        }
    }
    // The built-in scene has one size unless it is read from files. The buffers of software drivers are too small for
    // the paper's preset.
    let (size, preset, scale, frames) =
        if rehearsal { ("160x120", "quickstart", 0.01, 3) } else { ("1352x1014", "neu3d", 0.02, 300) };
    let scene = format!("synth large-scene --layout neu3d --size {size} --frames 8");
    let large = format!(
        "train --data large-scene --preset {preset} --device {device} --seed 11 --out train-large \
         --set train.scale={scale} --set eval.pictures=false"
    );
    let speed = format!("eval train-large --device {device} --speed-frames {frames}");
    let killed =
        train(&format!("--device {device} --seed 11 --out killed --set train.checkpoint_interval={CHECKPOINT}"));
    let killed = entry("killed", Program::Mvfusion, &killed, 10, "its pace up to the checkpoint");
    let resumed = format!("train --resume killed --device {device}");
    list.extend([
        entry("large-scene", Program::Mvfusion, &scene, 10, "the next entry can read it"),
        entry("train-large", Program::Mvfusion, &large, 10, "steps a second"),
        entry("speed", Program::Mvfusion, &speed, 5, "200 frames a second, with and without MFTA"),
        Entry { goal: Goal::Checkpoint, ..killed },
        entry("resumed", Program::Mvfusion, &resumed, 10, "it goes on from its last checkpoint, to a PSNR as above"),
    ]);
    list
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use clap::Parser;
    use mvfusion_cli::args::Command;
    use mvfusion_cli::{Cli, config};

    use super::*;

    fn lists() -> [Vec<Entry>; 2] {
        [false, true].map(|rehearsal| list("wgpu:0", rehearsal))
    }

    #[test]
    fn names_differ_and_serve_as_file_names() {
        for list in lists() {
            let names: BTreeSet<&str> = list.iter().map(|entry| entry.name).collect();
            assert_eq!(names.len(), list.len());
            assert!(names.iter().all(|name| name.chars().all(|c| c.is_ascii_alphanumeric() || c == '-')));
        }
    }

    #[test]
    fn the_programs_know_all_arguments_and_keys() {
        for entry in lists().iter().flatten() {
            let name = entry.name;
            let words = ["program"].into_iter().chain(entry.arguments.iter().map(String::as_str));
            match entry.program {
                Program::Mvfusion => {
                    let cli = Cli::try_parse_from(words).unwrap_or_else(|error| panic!("{name}: {error}"));
                    let Command::Train(args) = cli.command else { continue };
                    let resolved = config::resolve(&args.sources, args.data.as_deref());
                    let train = resolved.unwrap_or_else(|error| panic!("{name}: {error:#}")).config.scaled().train;
                    if entry.goal == Goal::Checkpoint {
                        let (first, total) = (train.checkpoint_interval.0, train.stages.total());
                        assert!((1..total).contains(&first), "{name}: after step {first} of {total}");
                    }
                }
                // A build without GPUs counts no launches.
                Program::Xtask if name == "launches" && !cfg!(feature = "cube") => {}
                Program::Xtask => {
                    crate::Arguments::try_parse_from(words).unwrap_or_else(|error| panic!("{name}: {error}"));
                }
                Program::Oracles | Program::Machine(_) => {}
            }
        }
    }

    #[test]
    fn an_entry_reads_what_an_earlier_one_made() {
        for list in lists() {
            let mut made: BTreeSet<&str> = BTreeSet::new();
            for entry in &list {
                for pair in entry.arguments.windows(2) {
                    let reads = ["--data", "--resume", "eval"].contains(&pair[0].as_str());
                    assert!(!reads || made.contains(pair[1].as_str()), "{}: {}", entry.name, pair[1]);
                }
                if let Some(name) = entry.makes() {
                    assert!(made.insert(name), "{name} is made twice");
                }
            }
            assert!(["step.json", "train-large", "large-scene", "killed"].iter().all(|&name| made.contains(name)));
        }
    }
}
