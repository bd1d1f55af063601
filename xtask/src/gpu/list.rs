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
    /// What passes, in words.
    pub passes: &'static str,
}

/// The sizes of the benchmarks: the quickstart, the paper's pictures, the paper's Gaussians.
const SPLATS: &str = "12000@160x120,30000@1352x1014,300000@1352x1014";
const NETS: &str = "4000,30000,90000";

/// The seeds of the trainings on the GPU and on the CPU.
const SEEDS: [u64; 3] = [11, 12, 13];

/// Small sizes for a rehearsal on a software driver.
const SMALL_SPLATS: &str = "2000@160x120";
const SMALL_NETS: &str = "1000";

/// The list for a device, such as `wgpu:0`. A rehearsal asks the same of a software driver, in small.
pub(super) fn list(device: &str, rehearsal: bool) -> Vec<Entry> {
    let (splats, nets) = if rehearsal { (SMALL_SPLATS, SMALL_NETS) } else { (SPLATS, NETS) };
    let repeat = if rehearsal { "1" } else { "15" };
    let backend = device.split(':').next().unwrap_or(device);
    let entry = |name, program, arguments: &str, minutes: u64, passes| Entry {
        name,
        program,
        arguments: arguments.split_whitespace().map(str::to_owned).collect(),
        environment: Vec::new(),
        limit: Duration::from_secs(60 * minutes),
        passes,
    };
    let with = |entry: Entry, environment: &[(&'static str, &'static str)]| Entry {
        environment: environment.to_vec(),
        ..entry
    };
    let bench = |what: &str| format!("bench {what} --devices {device} --repeat {repeat}");
    let step = if rehearsal { "1000@160x120 --static 2000" } else { "30000@1352x1014 --static 300000" };
    let mut list = vec![
        entry("card", Program::Machine("nvidia-smi"), "", 1, "names the card and its driver"),
        entry("devices", Program::Mvfusion, "devices", 2, "the device is no software driver"),
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
    for tasks in ["32", "128"] {
        let name = if tasks == "32" { "step-32-tasks" } else { "step-128-tasks" };
        let again = entry(name, Program::Xtask, &bench(&format!("step --scene {step}")), 5, "times");
        list.push(with(again, &[("CUBECL_WGPU_MAX_TASKS", if tasks == "32" { "32" } else { "128" })]));
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
    let scale = if rehearsal { "0.01" } else { "1" };
    for (seed, [on_gpu, on_cpu]) in SEEDS.into_iter().zip([
        ["train-11-gpu", "train-11-flex"],
        ["train-12-gpu", "train-12-flex"],
        ["train-13-gpu", "train-13-flex"],
    ]) {
        for (name, device) in [(on_gpu, device), (on_cpu, "flex")] {
            let arguments = format!("train --device {device} --seed {seed} --out {name} --set train.scale={scale}");
            list.push(entry(name, Program::Mvfusion, &arguments, 10, "PSNR within the spread of seeds"));
        }
        if rehearsal {
            break;
        }
    }
    let size = if rehearsal { "160 120" } else { "1352 1014" };
    let (width, height) = size.split_once(' ').unwrap_or((size, size));
    list.push(entry(
        "train-large",
        Program::Mvfusion,
        &format!(
            "train --device {device} --seed 11 --out train-large --set train.scale=0.02 --set scene.width={width} \
             --set scene.height={height} --set eval.pictures=false"
        ),
        10,
        "it ends",
    ));
    let frames = if rehearsal { 3 } else { 300 };
    list.push(entry(
        "speed",
        Program::Mvfusion,
        &format!("eval train-large --device {device} --speed-frames {frames}"),
        5,
        "200 frames a second, with and without MFTA",
    ));
    list.push(entry("resume", Program::Xtask, "torture kill-defaults terminate --short", 10, "no run is lost"));
    list
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn names_differ_and_serve_as_file_names() {
        for rehearsal in [false, true] {
            let list = list("wgpu:0", rehearsal);
            let names: BTreeSet<&str> = list.iter().map(|entry| entry.name).collect();
            assert_eq!(names.len(), list.len());
            assert!(names.iter().all(|name| name.chars().all(|c| c.is_ascii_alphanumeric() || c == '-')));
        }
    }
}
