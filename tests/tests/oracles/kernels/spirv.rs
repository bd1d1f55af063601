//! The kernels as SPIR-V, judged by Khronos' validator. No driver is needed.

use std::path::Path;
use std::process::Command;

use anyhow::{Context, Result, anyhow, ensure};
use cubecl::wgpu::SpirvCompiler;
use cubecl::{Compiler, VulkanCompilationOptions, WgpuCompilationOptions};
use libtest_mimic::Trial;
use mvfusion_kernels::cube::catalogue::{Kernel, catalogue};

use super::target;
use crate::{failed, ignored};

/// The validator, of Debian's package `spirv-tools`.
const VALIDATOR: &str = "spirv-val";

pub fn trial() -> Trial {
    let name = "kernels::spirv_is_valid";
    match Command::new(VALIDATOR).arg("--version").output() {
        Ok(_) => Trial::test(name, || all().map_err(failed)),
        Err(_) => ignored(name.to_owned(), format!("{VALIDATOR} was not found: install spirv-tools")),
    }
}

/// Every kernel is valid for a card whose shared memory has an explicit layout. Where it has none, CubeCL 0.11 gets the types of shared memory wrong. So a kernel with shared memory shows that the
/// validator finds faults.
fn all() -> Result<()> {
    let folder = tempfile::tempdir()?;
    let mut faults = Vec::new();
    let mut found = 0;
    for kernel in catalogue(&target()) {
        let name = kernel.label();
        if let Err(error) = judged(&kernel, true, folder.path()) {
            faults.push(format!("{name}: {error:#}"));
        }
        found += usize::from(judged(&kernel, false, folder.path()).is_err());
    }
    ensure!(faults.is_empty(), "{}", faults.join("\n"));
    ensure!(
        found > 0,
        "CubeCL lays out shared memory everywhere: README and docs/performance-kernels.md say otherwise"
    );
    Ok(())
}

fn judged(kernel: &Kernel, explicit_layout: bool, folder: &Path) -> Result<()> {
    let options = WgpuCompilationOptions {
        supports_vulkan_compiler: true,
        vulkan: VulkanCompilationOptions {
            max_spirv_version: (1, 6),
            max_vector_size: 4,
            push_constant_size: 128,
            supports_explicit_smem: explicit_layout,
            ..VulkanCompilationOptions::default()
        },
        ..WgpuCompilationOptions::default()
    };
    let compiled = SpirvCompiler::default().compile(kernel.define(), &options);
    let words = compiled.map_err(|error| anyhow!("CubeCL does not compile it: {error:?}"))?.assembled_module;
    let file = folder.join("kernel.spv");
    std::fs::write(&file, words.iter().flat_map(|word| word.to_le_bytes()).collect::<Vec<u8>>())?;
    let mut validator = Command::new(VALIDATOR);
    let judged = validator.args(["--target-env", "vulkan1.3"]).arg(&file).output().context(VALIDATOR)?;
    ensure!(judged.status.success(), "{}", String::from_utf8_lossy(&judged.stderr).trim());
    Ok(())
}
