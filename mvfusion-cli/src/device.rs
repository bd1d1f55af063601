//! Devices, selected by their names on the command line.

mod listed;

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};

use anyhow::anyhow;
use mvfusion_model::Device;

use crate::failure::UsageError;
use crate::machine::GpuModel;

pub use listed::{Listed, listed};

/// An open device.
#[derive(Clone, Debug)]
pub struct OpenDevice {
    /// The device of Burn.
    pub device: Device,
    /// Its name, in `results.json` and for `--device`.
    pub name: String,
    /// One line: the chosen device, and why it was chosen.
    pub reason: String,
    /// Bytes of its largest buffer; `None` for a CPU, which has no such limit.
    pub buffer: Option<u64>,
    /// Whether its tensors are in the memory of the machine: a CPU, or a software driver.
    pub computes_on_host: bool,
}

impl OpenDevice {
    /// Does work on the device. A GPU's driver panics where it cannot go on, which is an error here.
    ///
    /// # Errors
    /// Those of the work, and what a GPU's driver says.
    pub fn guarded<T>(&self, work: impl FnOnce() -> anyhow::Result<T>) -> anyhow::Result<T> {
        match self.buffer {
            Some(_) => caught(&self.name, work),
            None => work(),
        }
    }
}

fn caught<T>(name: &str, work: impl FnOnce() -> anyhow::Result<T>) -> anyhow::Result<T> {
    catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|panic| {
        let said = words(panic.as_ref());
        Err(anyhow!("the work on {name} stopped: {said}. The device may be out of memory, or lost to its driver"))
    })
}

/// What a panic says.
fn words(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("no reason was given")
}

/// How to build with GPU support.
#[cfg_attr(any(feature = "wgpu", feature = "cuda"), allow(dead_code, reason = "printed by builds without it"))]
const WITH_GPU: &str = "build with `--features wgpu` (or `cuda`)";

/// The name that stands for the best device, and for the run's own when one is resumed.
pub const AUTO: &str = "auto";

/// Names of all devices, compiled in or not.
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

/// The device that a name refers to.
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
        let unknown = || UsageError::new(format!("unknown device `{name}`; --device takes one of {NAMES}."));
        let (kind, number) = match name.split_once(':') {
            Some((kind, number)) => (kind, Some(number)),
            None => (name, None),
        };
        match (kind, number) {
            (AUTO, None) => Ok(Self::Auto),
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

/// Whether this device needs a GPU. `auto` does if this build supports GPUs.
///
/// # Errors
/// [`UsageError`] if there is no such device, or none in this build.
pub fn wants_gpu(name: &str) -> Result<bool, UsageError> {
    match Wanted::parse(name)? {
        Wanted::Auto => Ok(cfg!(any(feature = "wgpu", feature = "cuda"))),
        Wanted::Gpu { backend, .. } if features().contains(&backend) => Ok(true),
        Wanted::Gpu { backend, .. } => Err(not_built(backend)),
        // Opening a CPU device takes no memory from other processes.
        Wanted::Cpu | Wanted::Flex | Wanted::Ndarray => open(name).map(|_| false),
    }
}

/// Checks that a device of this name exists. A GPU is not opened, so that another process can have all of it.
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
        Wanted::Cpu => cpu("requested by name"),
        Wanted::Flex => flex("requested by name").ok_or_else(|| not_built("flex")),
        Wanted::Ndarray => ndarray("requested by name").ok_or_else(|| not_built("ndarray")),
        Wanted::Gpu { backend, index } => gpu::open(backend, index),
    }
}

/// A GPU if there is one, otherwise the CPU. Software drivers do not count as GPUs: they are meant for tests and slower
/// than the CPU backends.
fn auto() -> Result<OpenDevice, UsageError> {
    match gpu::best() {
        Some(gpu) => Ok(gpu),
        None if cfg!(any(feature = "wgpu", feature = "cuda")) => cpu("auto: no GPU was found; see `mvfusion devices`"),
        None => cpu(&format!("auto: this build has no GPU support; {WITH_GPU}")),
    }
}

/// What the GPU of this name says about itself; `None` for a CPU.
pub fn gpu_model(name: &str) -> Option<GpuModel> {
    gpu::model(name)
}

/// The compiled backends and the detected devices, one line each.
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
    use mvfusion_model::device::{Gpu, GpuError, GpuProperties, gpus};
    use tracing::warn;

    use super::{GpuModel, OpenDevice, UsageError};

    /// The first usable GPU that is not a software driver.
    pub fn best() -> Option<OpenDevice> {
        gpus().iter().filter(|gpu| !gpu.is_software).find_map(|gpu| {
            opened(gpu, "auto: the first GPU").inspect_err(|error| warn!("{error}; this GPU is skipped")).ok()
        })
    }

    /// The GPU with this index of a backend.
    pub fn open(backend: &str, index: usize) -> Result<OpenDevice, UsageError> {
        opened(find(backend, index)?, "requested by name").map_err(|error| {
            UsageError::new(format!("{error}. Update its driver, or use another device or `--device cpu`."))
        })
    }

    /// Checks that such a GPU exists.
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
                    "`--device {backend}:{index}`: no such device; {there}. `mvfusion devices` prints details."
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
        let (name, card) = (gpu.label(), gpu.properties()?);
        let reason = format!("{name}, {}{} ({reason})", card.name, software(gpu));
        let (buffer, computes_on_host) = (Some(card.buffer), gpu.is_software);
        Ok(OpenDevice { device: gpu.device.clone(), name, reason, buffer, computes_on_host })
    }

    /// The GPU of this name; `None` if it does not open.
    pub fn model(name: &str) -> Option<GpuModel> {
        let gpu = gpus().iter().find(|gpu| gpu.label() == name)?;
        Some(GpuModel { name: gpu.properties().ok()?.name, driver: gpu.driver() })
    }

    fn software(gpu: &Gpu) -> &'static str {
        if gpu.is_software { ", a software driver" } else { "" }
    }

    fn describe(gpu: &Gpu) -> String {
        let GpuProperties { name, buffer, shared_memory, units, adds_floats, language } = match gpu.properties() {
            Ok(card) => card,
            Err(error) => return format!("{:9} cannot be used: {error}", gpu.label()),
        };
        let atomics = if adds_floats { "atomic float addition" } else { "no atomic float addition" };
        format!(
            "{:9} {name}{}: buffers up to {} MiB, {} KiB of shared memory for up to {units} threads, {atomics}, \
             kernels in {language}",
            gpu.label(),
            software(gpu),
            buffer >> 20,
            shared_memory >> 10,
        )
    }
}

#[cfg(not(any(feature = "wgpu", feature = "cuda")))]
mod gpu {
    use super::{GpuModel, OpenDevice, UsageError, WITH_GPU};

    pub fn best() -> Option<OpenDevice> {
        None
    }

    pub fn open(backend: &str, _: usize) -> Result<OpenDevice, UsageError> {
        Err(UsageError::new(format!(
            "`--device {backend}`: this build has no GPU support; {WITH_GPU}, or use `--device cpu`."
        )))
    }

    pub fn check(backend: &str, index: usize) -> Result<(), UsageError> {
        open(backend, index).map(|_| ())
    }

    pub fn model(_: &str) -> Option<GpuModel> {
        None
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
        "`--device {name}`: this build does not include {name}; build with `--features {name}`, or use `--device cpu`."
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
    let reason = format!("{name} on the {} ({reason})", threads());
    OpenDevice { device, name: name.to_owned(), reason, buffer: None, computes_on_host: true }
}

/// The CPU, with the number of threads that this process uses.
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
    fn the_panic_of_a_driver_becomes_an_error() {
        let error = caught("wgpu:0", || -> anyhow::Result<()> { panic!("{} is lost", "the device") });
        let text = error.expect_err("it panicked").to_string();
        assert!(text.contains("wgpu:0 stopped: the device is lost"), "{text}");
        assert_eq!(caught("wgpu:0", || Ok(3)).expect("no panic"), 3);
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
