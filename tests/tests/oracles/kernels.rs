//! The kernels' texts for WebGPU, and their SPIR-V in a build with `vulkan`: within the limits of every adapter that is accepted, and in order by WGSL's own rules,
//! which the checks of wgpu are weaker than.

#[cfg(feature = "vulkan")]
mod spirv;

use std::collections::BTreeSet;
use std::sync::{Arc, Mutex, PoisonError};

use anyhow::{Context, Result, anyhow, ensure};
use burn::tensor::Device;
use cubecl::Compiler;
use cubecl::ir::features::AtomicUsage;
use cubecl::logging::{LaunchObservation, LaunchObserver};
use cubecl::prelude::*;
use cubecl::wgpu::WgslCompiler;
use libtest_mimic::Trial;
use mvfusion_kernels::cube::catalogue::{Target, catalogue};
use mvfusion_kernels::cube::{MOST_BUFFERS, UNITS};
use mvfusion_tests::{gpu_backends, is_there};
use serde_json::{Value, json};

use crate::browser::{Browser, open};
use crate::training::losses;
use crate::{failed, ignored};

/// Bytes of shared memory that WebGPU guarantees.
const SHARED_MEMORY: usize = 16 << 10;

/// The storage buffers that an accepted adapter binds: those of a kernel, and the one in which CubeCL passes numbers.
const BINDINGS: usize = MOST_BUFFERS as usize + 1;

/// What the page does with the texts: compiles each of them and gives the messages that are errors.
const COMPILE: &str = r"(async texts => {
    const adapter = navigator.gpu && await navigator.gpu.requestAdapter();
    if (!adapter) return null;
    const device = await adapter.requestDevice();
    device.pushErrorScope('validation');
    const faults = [];
    for (const [name, code] of texts) {
        const info = await device.createShaderModule({ code }).getCompilationInfo();
        const errors = info.messages.filter(message => message.type === 'error');
        if (errors.length) faults.push(name + ': ' + errors.map(error => error.message).join('; '));
    }
    await device.popErrorScope();
    return faults;
})";

/// A barrier in a loop whose end differs from unit to unit as far as the compiler knows; wgpu takes it.
const NON_UNIFORM: &str = "@group(0) @binding(0) var<storage, read_write> ends: array<u32>;
    @compute @workgroup_size(64) fn main() {
        let end = ends[0];
        for (var turn = 0u; turn < end; turn++) { workgroupBarrier(); }
    }";

/// A kernel's text.
struct Text {
    name: String,
    units: usize,
    shared_memory: usize,
    wgsl: String,
}

/// All trials.
pub fn trials() -> Vec<Trial> {
    let browser = |name: &str, check: fn() -> Result<()>| {
        let name = format!("kernels::{name}");
        match Browser::find() {
            Some(_) => Trial::test(name, move || check().map_err(failed)),
            None => ignored(name, "no browser was found: set CHROME, or install chromium".to_owned()),
        }
    };
    let complete = "kernels::catalogue_is_complete";
    vec![
        match gpu_backends().into_iter().find(|&gpu| is_there(gpu)) {
            Some(gpu) => Trial::test(complete, move || catalogue_is_complete(&(gpu.device)()).map_err(failed)),
            None => ignored(complete.to_owned(), "no GPU was found, not even a software driver".to_owned()),
        },
        Trial::test("kernels::limits", || limits().map_err(failed)),
        browser("browser", compiled_by_a_browser),
        browser("browser_finds_faults", a_browser_finds_faults),
        #[cfg(feature = "vulkan")]
        spirv::trial(),
    ]
}

/// An adapter that adds floats atomically.
fn target() -> Target {
    Target::new(|device| {
        device.register_atomic_type_usage(Type::atomic(f32::elem_type_native()), AtomicUsage::all());
    })
}

/// The texts of all kernels.
fn texts() -> Result<Vec<Text>> {
    let text = |kernel: mvfusion_kernels::cube::catalogue::Kernel| {
        let name = kernel.label();
        let shader = WgslCompiler
            .compile(kernel.define(), &Default::default())
            .map_err(|error| anyhow!("CubeCL does not compile {name}: {error:?}"))?;
        Ok(Text { name, units: kernel.units, shared_memory: shader.shared_memory_size, wgsl: shader.to_string() })
    };
    catalogue(&target()).into_iter().map(text).collect()
}

fn limits() -> Result<()> {
    let mut most = 0;
    for Text { name, units, shared_memory, wgsl } in texts()? {
        let bindings = wgsl.matches("var<storage").count();
        most = most.max(bindings);
        ensure!(bindings <= BINDINGS, "{name} binds {bindings} storage buffers, {BINDINGS} at most");
        ensure!(shared_memory <= SHARED_MEMORY, "{name} takes {shared_memory} bytes of shared memory");
        ensure!(units <= UNITS, "{name} has {units} units a cube");
        ensure!(wgsl.contains(&format!("@workgroup_size({units}, 1, 1)")), "{name} has other units: {wgsl}");
    }
    ensure!(most == BINDINGS, "at most {most} buffers are bound, so `MOST_BUFFERS` refuses adapters without need");
    Ok(())
}

/// Names of launched kernels.
#[derive(Default)]
struct Launched(Mutex<BTreeSet<&'static str>>);

impl LaunchObserver for Launched {
    fn launched(&self, kernel: &'static str) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).insert(kernel);
    }
}

/// What a training launches is in the catalogue, so that no kernel escapes the other trials.
fn catalogue_is_complete(device: &Device) -> Result<()> {
    let launched = Arc::new(Launched::default());
    let observation = LaunchObservation::new(launched.clone());
    losses(device)?;
    drop(observation);
    let known: BTreeSet<&str> = catalogue(&target()).iter().map(|kernel| kernel.name).collect();
    let launched = launched.0.lock().unwrap_or_else(PoisonError::into_inner);
    let ours: BTreeSet<&str> = launched.iter().filter_map(|name| own_name(name)).collect();
    ensure!(ours.len() > 20, "a training launches more kernels than {ours:?}");
    let missing: Vec<&&str> = ours.difference(&known).collect();
    ensure!(missing.is_empty(), "not in the catalogue: {missing:?}");
    Ok(())
}

/// The function of a kernel of this project, whose type stands in a module of the function's name.
fn own_name(path: &str) -> Option<&str> {
    let path = path.split('<').next()?;
    let is_ours = path.starts_with("mvfusion_kernels::");
    path.rsplit("::").nth(1).filter(|_| is_ours)
}

/// What a browser says of the texts, by name.
fn faults(texts: &[(String, String)]) -> Result<Vec<String>> {
    let folder = tempfile::tempdir()?;
    let page = folder.path().join("page.html");
    // WebGPU is for pages with an address of their own.
    std::fs::write(&page, "<!doctype html><title>kernels</title>")?;
    let mut browser = Browser::start()?;
    let connection = &mut browser.connection;
    connection.open_page()?;
    open(connection, &format!("file://{}", page.display()))?;
    let found = connection.evaluate(&format!("{COMPILE}({})", json!(texts)))?;
    ensure!(found != Value::Null, "this browser has no WebGPU");
    let faults = found.as_array().context("a list of faults")?;
    Ok(faults.iter().map(|fault| fault.as_str().unwrap_or_default().to_owned()).collect())
}

fn compiled_by_a_browser() -> Result<()> {
    let texts = texts()?;
    // CubeCL's exchanges of floats are an extension that browsers lack: those kernels are left to wgpu.
    let texts = texts.into_iter().filter(|text| !text.wgsl.contains("atomic<f32>"));
    let found = faults(&texts.map(|text| (text.name, text.wgsl)).collect::<Vec<_>>())?;
    ensure!(found.is_empty(), "{}", found.join("\n"));
    Ok(())
}

fn a_browser_finds_faults() -> Result<()> {
    let found = faults(&[("non-uniform".to_owned(), NON_UNIFORM.to_owned())])?;
    ensure!(found.len() == 1 && found[0].contains("uniform control flow"), "{found:?}");
    Ok(())
}
