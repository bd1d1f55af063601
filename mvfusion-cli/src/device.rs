//! The device by its name on the command line.

use mvfusion_model::Device;

use crate::failure::UsageError;

/// A device that was opened.
#[derive(Clone, Debug)]
pub struct OpenDevice {
    /// For Burn.
    pub device: Device,
    /// Its name, in `results.json` and for `--device`.
    pub name: &'static str,
    /// One line: what was taken, and why.
    pub reason: String,
}

/// How a build with the graphics backend is made.
const WITH_GPU: &str = "build with `--features wgpu` (not available yet)";

/// Names of devices of this program, compiled in or not.
const NAMES: &str = "auto, cpu, flex, ndarray, wgpu[:N], cuda[:N]";

/// The cargo features of this build that name a device.
pub fn features() -> Vec<&'static str> {
    [("flex", cfg!(feature = "flex")), ("ndarray", cfg!(feature = "ndarray"))]
        .into_iter()
        .filter_map(|(name, on)| on.then_some(name))
        .collect()
}

/// Opens the device of a name.
///
/// # Errors
/// [`UsageError`] if there is no such device, or none in this build.
pub fn open(name: &str) -> Result<OpenDevice, UsageError> {
    let (kind, number) = match name.split_once(':') {
        Some((kind, number)) => (kind, Some(number)),
        None => (name, None),
    };
    let numbered = number.is_none_or(|number| number.parse::<usize>().is_ok());
    match (kind, number) {
        ("auto", None) => cpu(&format!("auto: this build has no GPU support, {WITH_GPU}")),
        ("cpu", None) => cpu("the CPU was asked for"),
        ("flex", None) => flex("asked for by name").ok_or_else(|| not_built("flex")),
        ("ndarray", None) => ndarray("asked for by name").ok_or_else(|| not_built("ndarray")),
        ("wgpu" | "cuda", _) if numbered => Err(UsageError::new(format!(
            "`--device {name}`: this build has no GPU support; {WITH_GPU}, or take `--device cpu`."
        ))),
        _ => Err(UsageError::new(format!("there is no device `{name}`; --device takes one of {NAMES}."))),
    }
}

/// The faster of the CPU backends in this build.
fn cpu(reason: &str) -> Result<OpenDevice, UsageError> {
    flex(reason).or_else(|| ndarray(reason)).ok_or_else(|| {
        UsageError::new("this build has no device at all; build with `--features flex` (the default) or `ndarray`.")
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
    let threads = match rayon::current_num_threads() {
        1 => "1 thread".to_owned(),
        threads => format!("{threads} threads"),
    };
    OpenDevice { device, name, reason: format!("{name} on the CPU, {threads} ({reason})") }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refusal(name: &str) -> String {
        open(name).expect_err("refused").to_string()
    }

    #[test]
    fn known_devices_that_were_not_built_are_told_from_unknown_ones() {
        assert!(refusal("wgpu").contains("--features wgpu"));
        assert!(refusal("cuda:1").contains("no GPU support"));
        for name in ["tpu", "wgpu:first", "cpu:0", ""] {
            assert!(refusal(name).contains("auto, cpu, flex"), "{name}");
        }
    }

    #[test]
    #[cfg(feature = "flex")]
    fn flex_is_the_first_choice_among_cpus() {
        assert_eq!(open("auto").expect("opened").name, "flex");
        assert_eq!(open("cpu").expect("opened").name, "flex");
    }
}
