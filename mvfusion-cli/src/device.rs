//! The device by its name on the command line.

use mvfusion_model::Device;

use crate::failure::UsageError;

/// A device that was opened.
#[derive(Clone, Debug)]
pub struct OpenDevice {
    /// For Burn.
    pub device: Device,
    /// Its name, in `results.json` and for `--device`.
    pub name: String,
    /// One line: what was taken, and why.
    pub reason: String,
}

/// How a build with GPU support is made.
#[cfg_attr(any(feature = "wgpu", feature = "cuda"), allow(dead_code, reason = "said by builds without it"))]
const WITH_GPU: &str = "build with `--features wgpu` (or `cuda`)";

/// Names of devices of this program, compiled in or not.
const NAMES: &str = "auto, cpu, flex, ndarray, wgpu[:N], cuda[:N]";

/// The cargo features of this build that name a device.
pub fn features() -> Vec<&'static str> {
    [
        ("flex", cfg!(feature = "flex")),
        ("ndarray", cfg!(feature = "ndarray")),
        ("wgpu", cfg!(feature = "wgpu")),
        ("cuda", cfg!(feature = "cuda")),
    ]
    .into_iter()
    .filter_map(|(name, on)| on.then_some(name))
    .collect()
}

/// What a device's name asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Wanted<'a> {
    Auto,
    Cpu,
    Flex,
    Ndarray,
    Gpu { backend: &'a str, index: usize },
}

impl<'a> Wanted<'a> {
    fn parse(name: &'a str) -> Result<Self, UsageError> {
        let unknown = || UsageError::new(format!("there is no device `{name}`; --device takes one of {NAMES}."));
        let (kind, number) = match name.split_once(':') {
            Some((kind, number)) => (kind, Some(number)),
            None => (name, None),
        };
        match (kind, number) {
            ("auto", None) => Ok(Self::Auto),
            ("cpu", None) => Ok(Self::Cpu),
            ("flex", None) => Ok(Self::Flex),
            ("ndarray", None) => Ok(Self::Ndarray),
            ("wgpu" | "cuda", number) => {
                let index = number.map_or(Ok(0), str::parse).map_err(|_| unknown())?;
                Ok(Self::Gpu { backend: kind, index })
            }
            _ => Err(unknown()),
        }
    }
}

/// Whether a machine should have a GPU for a device of this name; `auto` takes one where this build can use it.
///
/// # Errors
/// [`UsageError`] if there is no such device, or none in this build.
pub fn wants_gpu(name: &str) -> Result<bool, UsageError> {
    match Wanted::parse(name)? {
        Wanted::Auto => Ok(cfg!(any(feature = "wgpu", feature = "cuda"))),
        Wanted::Gpu { backend, .. } if features().contains(&backend) => Ok(true),
        Wanted::Gpu { backend, .. } => Err(not_built(backend)),
        // These take no memory of anybody.
        Wanted::Cpu | Wanted::Flex | Wanted::Ndarray => open(name).map(|_| false),
    }
}

/// Whether there is a device of this name. A GPU is not opened: another process is to have all of it.
///
/// # Errors
/// [`UsageError`] if there is none.
pub fn check(name: &str) -> Result<(), UsageError> {
    match Wanted::parse(name)? {
        Wanted::Auto => Ok(()),
        Wanted::Gpu { backend, index } => gpu::check(backend, index),
        Wanted::Cpu | Wanted::Flex | Wanted::Ndarray => open(name).map(|_| ()),
    }
}

/// Opens the device of a name.
///
/// # Errors
/// [`UsageError`] if there is no such device, or none in this build.
pub fn open(name: &str) -> Result<OpenDevice, UsageError> {
    match Wanted::parse(name)? {
        Wanted::Auto => auto(),
        Wanted::Cpu => cpu("the CPU was asked for"),
        Wanted::Flex => flex("asked for by name").ok_or_else(|| not_built("flex")),
        Wanted::Ndarray => ndarray("asked for by name").ok_or_else(|| not_built("ndarray")),
        Wanted::Gpu { backend, index } => gpu::open(backend, index),
    }
}

/// A GPU if there is one, else the CPU. A driver that computes on the CPU is no GPU: it is there for tests, and slower
/// than the CPU's own backends.
fn auto() -> Result<OpenDevice, UsageError> {
    match gpu::best() {
        Some(gpu) => Ok(gpu),
        None if cfg!(any(feature = "wgpu", feature = "cuda")) => cpu("auto: no GPU was found, see `mvfusion devices`"),
        None => cpu(&format!("auto: this build has no GPU support, {WITH_GPU}")),
    }
}

/// What was compiled in and what was found, a line each, for people.
pub fn list() -> Vec<String> {
    let mut lines = Vec::new();
    if cfg!(feature = "flex") {
        lines.push(format!("{:9} {}: pure Rust", "flex", threads()));
    }
    if cfg!(feature = "ndarray") {
        lines.push(format!("{:9} {}: the `ndarray` crate, for comparison", "ndarray", threads()));
    }
    lines.extend(gpu::list());
    lines
}

#[cfg(any(feature = "wgpu", feature = "cuda"))]
mod gpu {
    use mvfusion_model::device::{Card, Gpu, GpuError, gpus};
    use tracing::warn;

    use super::{OpenDevice, UsageError};

    /// The first GPU that can be used and is no software.
    pub fn best() -> Option<OpenDevice> {
        gpus().iter().filter(|gpu| !gpu.is_software).find_map(|gpu| {
            opened(gpu, "auto: the first GPU").inspect_err(|error| warn!("{error}: it is passed over")).ok()
        })
    }

    /// A GPU by its backend and its number there.
    pub fn open(backend: &str, index: usize) -> Result<OpenDevice, UsageError> {
        opened(find(backend, index)?, "asked for by name").map_err(|error| {
            UsageError::new(format!("{error}. Update its driver, or take another device or `--device cpu`."))
        })
    }

    /// Whether there is such a GPU.
    pub fn check(backend: &str, index: usize) -> Result<(), UsageError> {
        find(backend, index).map(|_| ())
    }

    fn find(backend: &str, index: usize) -> Result<&'static Gpu, UsageError> {
        if !super::features().contains(&backend) {
            return Err(super::not_built(backend));
        }
        let found = gpus();
        match found.iter().find(|gpu| gpu.backend == backend && gpu.index == index) {
            Some(gpu) => Ok(gpu),
            None => {
                let names: Vec<String> = found.iter().map(Gpu::label).collect();
                let there = if names.is_empty() {
                    "no GPU was found".to_owned()
                } else {
                    format!("found: {}", names.join(", "))
                };
                Err(UsageError::new(format!(
                    "`--device {backend}:{index}`: there is no such device; {there}. `mvfusion devices` tells more."
                )))
            }
        }
    }

    /// The GPUs with their limits.
    pub fn list() -> Vec<String> {
        let found = gpus();
        if found.is_empty() {
            return vec!["no GPU was found".to_owned()];
        }
        found.iter().map(describe).collect()
    }

    fn opened(gpu: &Gpu, reason: &str) -> Result<OpenDevice, GpuError> {
        let (name, card) = (gpu.label(), gpu.card()?);
        let reason = format!("{name}, {}{} ({reason})", card.name, software(gpu));
        Ok(OpenDevice { device: gpu.device.clone(), name, reason })
    }

    fn software(gpu: &Gpu) -> &'static str {
        if gpu.is_software { ", a software driver" } else { "" }
    }

    fn describe(gpu: &Gpu) -> String {
        let Card { name, buffer, shared_memory, units, adds_floats } = match gpu.card() {
            Ok(card) => card,
            Err(error) => return format!("{:9} cannot be used: {error}", gpu.label()),
        };
        let atomics = if adds_floats { "atomic float addition" } else { "no atomic float addition" };
        format!(
            "{:9} {name}{}: buffers up to {} MiB, {} KiB shared by up to {units} units, {atomics}",
            gpu.label(),
            software(gpu),
            buffer >> 20,
            shared_memory >> 10,
        )
    }
}

#[cfg(not(any(feature = "wgpu", feature = "cuda")))]
mod gpu {
    use super::{OpenDevice, UsageError, WITH_GPU};

    pub fn best() -> Option<OpenDevice> {
        None
    }

    pub fn open(backend: &str, _: usize) -> Result<OpenDevice, UsageError> {
        Err(UsageError::new(format!(
            "`--device {backend}`: this build has no GPU support; {WITH_GPU}, or take `--device cpu`."
        )))
    }

    pub fn check(backend: &str, index: usize) -> Result<(), UsageError> {
        open(backend, index).map(|_| ())
    }

    pub fn list() -> Vec<String> {
        vec![format!("this build has no GPU support; {WITH_GPU}")]
    }
}

/// The faster of the CPU backends in this build.
fn cpu(reason: &str) -> Result<OpenDevice, UsageError> {
    flex(reason).or_else(|| ndarray(reason)).ok_or_else(|| {
        UsageError::new("this build has no CPU device; build with `--features flex` (the default) or `ndarray`.")
    })
}

fn not_built(name: &str) -> UsageError {
    UsageError::new(format!(
        "`--device {name}`: this build has no {name}; build with `--features {name}`, or take `--device cpu`."
    ))
}

#[cfg(feature = "flex")]
fn flex(reason: &str) -> Option<OpenDevice> {
    Some(opened(mvfusion_model::device::flex(), "flex", reason))
}

#[cfg(not(feature = "flex"))]
fn flex(_: &str) -> Option<OpenDevice> {
    None
}

#[cfg(feature = "ndarray")]
fn ndarray(reason: &str) -> Option<OpenDevice> {
    Some(opened(mvfusion_model::device::ndarray(), "ndarray", reason))
}

#[cfg(not(feature = "ndarray"))]
fn ndarray(_: &str) -> Option<OpenDevice> {
    None
}

#[cfg(any(feature = "flex", feature = "ndarray"))]
fn opened(device: Device, name: &'static str, reason: &str) -> OpenDevice {
    OpenDevice { device, name: name.to_owned(), reason: format!("{name} on the {} ({reason})", threads()) }
}

/// The CPU, with the threads that this process takes of it.
fn threads() -> String {
    match rayon::current_num_threads() {
        1 => "CPU, 1 thread".to_owned(),
        threads => format!("CPU, {threads} threads"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refusal(name: &str) -> String {
        open(name).expect_err("refused").to_string()
    }

    #[test]
    fn known_devices_that_were_not_built_are_told_from_unknown_ones() {
        for (name, built) in [("wgpu", cfg!(feature = "wgpu")), ("cuda:1", cfg!(feature = "cuda"))] {
            assert!(built || refusal(name).contains("build with `--features"), "{name}");
        }
        for name in ["tpu", "wgpu:first", "cpu:0", ""] {
            assert!(refusal(name).contains("auto, cpu, flex"), "{name}");
        }
    }

    #[test]
    fn a_gpu_is_wanted_by_name() {
        assert_eq!(wants_gpu("cpu"), Ok(false));
        assert_eq!(wants_gpu("auto"), Ok(cfg!(any(feature = "wgpu", feature = "cuda"))));
        assert_eq!(wants_gpu("cuda:3").is_ok(), cfg!(feature = "cuda"));
        wants_gpu("gpu").expect_err("unknown");
    }

    #[test]
    #[cfg(feature = "flex")]
    fn flex_is_the_first_choice_among_cpus() {
        assert_eq!(open("cpu").expect("opened").name, "flex");
    }
}
