//! The machine on which metrics were computed.

use serde::{Deserialize, Serialize};
use sysinfo::{CpuRefreshKind, RefreshKind, System};

use crate::device::{self, OpenDevice};

/// A machine, as far as the system tells.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Machine {
    /// Operating system and kernel.
    pub os: String,
    /// Model of the processor.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub cpu: Option<String>,
    /// The GPU; absent if a CPU was the device.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub gpu: Option<GpuModel>,
}

/// A GPU, or the software driver that stands for one.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct GpuModel {
    /// As it names itself.
    pub name: String,
    /// Its driver, with the version.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub driver: Option<String>,
}

impl Machine {
    /// This machine, with the GPU that a device is.
    pub fn this(device: &OpenDevice) -> Self {
        let known = RefreshKind::nothing().with_cpu(CpuRefreshKind::nothing());
        let system = System::new_with_specifics(known);
        let cpu = system.cpus().first().map(|cpu| cpu.brand().trim().to_owned());
        let kernel = System::kernel_long_version();
        Self {
            os: System::long_os_version().map_or(kernel.clone(), |os| format!("{os}, {kernel}")),
            cpu: cpu.filter(|model| !model.is_empty()),
            gpu: device.buffer.and_then(|_| device::gpu_model(&device.name)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[cfg(all(feature = "flex", target_arch = "x86_64"))]
    fn a_machine_tells_its_system_and_its_processor() {
        let machine = Machine::this(&device::open("flex").expect("opened"));
        assert!(machine.os.to_lowercase().contains(std::env::consts::OS), "{machine:?}");
        assert!(machine.cpu.is_some_and(|model| model.len() > 3));
        assert_eq!(machine.gpu, None);
    }
}
