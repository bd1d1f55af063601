//! `cargo xtask ptx`: the kernels as NVIDIA's compilers see them, without a GPU.
//!
//! CubeCL writes CUDA C++, as its runtime for CUDA does. NVRTC makes PTX of it, and `ptxas` the machine code, of which it
//! tells registers and spills. `nvdisasm` shows where the spills are. `ptxas` spills a few words before a loop and loads
//! them behind it where one more group of threads then fits into a multiprocessor, which is a gain; a spill within a loop
//! is a loss.

mod sass;
mod toolkit;

use std::collections::BTreeSet;
use std::env;
use std::fmt::Write;
use std::fs;
use std::path::PathBuf;

use anyhow::{Context, Result, ensure};
use clap::Args;
use cubecl_cpp::shared::register_supported_types;
use mvfusion_kernels::cube::catalogue::{Target, catalogue};

use self::toolkit::{Compiled, Toolkit, Usage};
use crate::docs;
use crate::splice::splice;

/// The architectures: A100, RTX 4090, H100. CUDA's runtime of CubeCL asks for the last one by this name, too.
const ARCHITECTURES: [&str; 3] = ["sm_80", "sm_89", "sm_90a"];

/// The kernels whose registers are limited, and their limits. Sixteen warps of 128 registers fit into the 65,536 of a
/// multiprocessor, and twelve of 168, which the products take.
const LIMITS: [(&str, usize); 3] = [("blend", 128), ("blend_backward", 128), ("product", 168)];

/// Bytes of shared memory of a cube on these architectures, without asking for more.
const SHARED_MEMORY: usize = 48 << 10;

/// Bytes that a kernel may spill outside of its loops.
const MOST_SPILLED: usize = 32;

/// The page that shows the table, and its place.
const PAGE: &str = "docs/performance-kernels.md";
const START: &str = "<!-- registers: written by `cargo xtask ptx --write` -->";
const END: &str = "<!-- end of registers -->";

/// Compiles every kernel for NVIDIA GPUs, without one.
///
/// Prints registers, spills and shared memory by architecture. A kernel that spills within a loop, or more than 32 bytes,
/// is an error, and so is a blending kernel or product with more registers than its limit.
///
/// The toolkit is a folder made by `pip install --no-deps --target DIR nvidia-cuda-nvrtc-cu12 nvidia-cuda-nvcc-cu12
/// nvidia-cuda-runtime-cu12 nvidia-cuda-cccl-cu12 nvidia-cuda-nvdisasm`.
#[derive(Debug, Args)]
pub struct PtxArguments {
    /// Folder of the toolkit.
    #[arg(long, value_name = "DIR")]
    toolkit: PathBuf,
    /// Write the table into docs/performance-kernels.md.
    #[arg(long)]
    write: bool,
    /// Keep the sources and the PTX in this folder.
    #[arg(long)]
    keep: Option<PathBuf>,
}

/// Names the folder of a toolkit for continuous integration.
const TOOLKIT: &str = "MVFUSION_CUDA_TOOLKIT";

/// Compiles the kernels if this machine has a toolkit; otherwise says that it has none.
pub fn check() -> Result<()> {
    match env::var_os(TOOLKIT).filter(|folder| !folder.is_empty()) {
        Some(folder) => run(&PtxArguments { toolkit: folder.into(), write: false, keep: None }),
        None => {
            eprintln!("-- skipped: {TOOLKIT} names no folder with NVIDIA's compilers (`cargo xtask help ptx`)");
            Ok(())
        }
    }
}

/// Carries out the chore.
pub fn run(arguments: &PtxArguments) -> Result<()> {
    let toolkit = Toolkit::at(&arguments.toolkit)?;
    if !toolkit.is_linked() {
        return toolkit.run_again(arguments);
    }
    let scratch = tempfile::tempdir().context("cannot make a folder for the PTX")?;
    let folder = arguments.keep.as_deref().unwrap_or(scratch.path());
    fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    let target = Target::new(|device| {
        device.hardware.max_shared_memory_size = SHARED_MEMORY;
        register_supported_types(device);
    });
    let kernels = catalogue(&target);
    let compiled = kernels.into_iter().map(|kernel| toolkit.compile(kernel, folder)).collect::<Result<Vec<_>>>()?;
    let table = table(&compiled);
    print(&table);
    if arguments.write {
        let path = docs::root().join(PAGE);
        let old = fs::read_to_string(&path).with_context(|| format!("cannot read {PAGE}"))?;
        let new = splice(&old, START, END, &table)
            .with_context(|| format!("{PAGE} lacks the lines `{START}` and `{END}`"))?;
        fs::write(&path, new).with_context(|| format!("cannot write {PAGE}"))?;
    }
    let faults: Vec<String> = compiled.iter().flat_map(faults).collect();
    ensure!(faults.is_empty(), "{}", faults.join("\n"));
    Ok(())
}

#[expect(clippy::print_stdout, reason = "this is what the chore is for")]
fn print(table: &str) {
    print!("{table}");
}

/// Why a kernel does not suit a GPU.
fn faults(compiled: &Compiled) -> Vec<String> {
    let name = compiled.kernel.label();
    let limit =
        LIMITS.iter().find(|(kernel, _)| *kernel == compiled.kernel.name).map_or(usize::MAX, |&(_, limit)| limit);
    let of = |(usage, architecture): (&Usage, &str)| {
        if usage.spills_in_loops > 0 {
            Some(format!(
                "{name} accesses spilled registers {} times within loops on {architecture}",
                usage.spills_in_loops
            ))
        } else if usage.spills.iter().any(|&bytes| bytes > MOST_SPILLED) {
            let [stored, loaded] = usage.spills;
            Some(format!(
                "{name} spills {stored} bytes and loads {loaded} on {architecture}; {MOST_SPILLED} of each at most"
            ))
        } else if usage.registers > limit {
            Some(format!("{name} takes {} registers on {architecture}; {limit} at most", usage.registers))
        } else {
            None
        }
    };
    compiled.usages.iter().zip(ARCHITECTURES).filter_map(of).collect()
}

fn table(compiled: &[Compiled]) -> String {
    let mut text = format!(
        "| kernel | units | shared memory | registers ({}) | spills outside loops |\n|---|---|---|---|---|\n",
        ARCHITECTURES.join(", ")
    );
    for Compiled { kernel, shared_memory, usages } in compiled {
        let all = |of: &dyn Fn(&Usage) -> usize| {
            let numbers: Vec<usize> = usages.iter().map(of).collect();
            let distinct: BTreeSet<&usize> = numbers.iter().collect();
            let shown = if distinct.len() == 1 { &numbers[..1] } else { &numbers };
            shown.iter().map(usize::to_string).collect::<Vec<_>>().join(", ")
        };
        // Proof: writing to a string does not fail.
        // Proof: writing to a string does not fail.
        writeln!(
            text,
            "| `{}`{} | {} | {} B | {} | {} B |",
            kernel.name,
            if kernel.variant.is_empty() { String::new() } else { format!(", {}", kernel.variant) },
            kernel.units,
            shared_memory,
            all(&|usage| usage.registers),
            all(&|usage| usage.spills[0]),
        )
        .expect("a string");
    }
    text
}
