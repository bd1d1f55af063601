//! `cargo xtask ptx`: the kernels as NVIDIA's compilers see them, without a GPU.
//!
//! CubeCL writes CUDA C++, as its runtime for CUDA does. NVRTC makes PTX of it, and `ptxas` the machine code, of which it
//! tells registers and spills. `nvdisasm` shows where the spills are. `ptxas` spills a few words before a loop and loads
//! them behind it where one more group of threads then fits into a multiprocessor, which is a gain; a spill within a loop
//! is a loss.

mod sass;

use std::collections::BTreeSet;
use std::env;
use std::ffi::OsStr;
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use cubecl::Compiler;
use cubecl_cpp::shared::{CompilationOptions, CppCompiler, register_supported_types};
use cubecl_cpp::target::Cuda;
use cudarc::nvrtc::{CompileError, CompileOptions, compile_ptx_with_opts};
use mvfusion_kernels::cube::catalogue::{Kernel, Target, catalogue};

use crate::docs;
use crate::splice::splice;

/// The packages that a toolkit consists of, from PyPI.
const PACKAGES: &str = "nvidia-cuda-nvrtc-cu12 nvidia-cuda-nvcc-cu12 nvidia-cuda-runtime-cu12 nvidia-cuda-cccl-cu12 \
                        nvidia-cuda-nvdisasm";

/// The architectures: A100, RTX 4090, H100. CUDA's runtime of CubeCL asks for the last one by this name, too.
const ARCHITECTURES: [&str; 3] = ["sm_80", "sm_89", "sm_90a"];

/// The kernels whose registers are limited, so that sixteen warps fit into the 65,536 registers of a multiprocessor.
const LIMITED: [&str; 3] = ["blend", "blend_backward", "product"];
/// Their limit.
const MOST_REGISTERS: usize = 128;

/// Bytes that a kernel may spill outside of its loops.
const MOST_SPILLED: usize = 32;

/// Where the dynamic linker looks for NVRTC.
const LIBRARIES: &str = "LD_LIBRARY_PATH";

/// The page that shows the table, and its place.
const PAGE: &str = "docs/performance.md";
const START: &str = "<!-- registers: written by `cargo xtask ptx --write` -->";
const END: &str = "<!-- end of registers -->";

/// Compiles every kernel for NVIDIA GPUs, without one.
///
/// Prints registers, spills and shared memory by architecture. A kernel that spills within a loop, or more than 32 bytes,
/// is an error, and so is a blending kernel or product with more than 128 registers.
///
/// The toolkit is a folder made by `pip install --no-deps --target DIR nvidia-cuda-nvrtc-cu12 nvidia-cuda-nvcc-cu12
/// nvidia-cuda-runtime-cu12 nvidia-cuda-cccl-cu12 nvidia-cuda-nvdisasm`.
#[derive(Debug, Args)]
pub struct PtxArguments {
    /// Folder of the toolkit.
    #[arg(long, value_name = "DIR")]
    toolkit: PathBuf,
    /// Write the table into docs/performance.md.
    #[arg(long)]
    write: bool,
    /// Keep the sources and the PTX in this folder.
    #[arg(long)]
    keep: Option<PathBuf>,
}

/// What `ptxas` tells of a kernel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Usage {
    registers: usize,
    /// Bytes of spilled registers, stored and loaded.
    spills: [usize; 2],
    /// Instructions within loops that access them.
    spills_in_loops: usize,
}

/// A kernel on all architectures.
struct Compiled {
    kernel: Kernel,
    /// Bytes.
    shared_memory: usize,
    usages: Vec<Usage>,
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
    let kernels = catalogue(&Target::new(register_supported_types));
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
    let is_limited = LIMITED.contains(&compiled.kernel.name);
    let of = |(usage, architecture): (&Usage, &str)| {
        if usage.spills_in_loops > 0 {
            Some(format!(
                "{name} accesses spilled registers {} times within loops on {architecture}",
                usage.spills_in_loops
            ))
        } else if usage.spills.iter().any(|&bytes| bytes > MOST_SPILLED) {
            Some(format!("{name} spills {} bytes on {architecture}; {MOST_SPILLED} at most", usage.spills[0]))
        } else if is_limited && usage.registers > MOST_REGISTERS {
            Some(format!("{name} takes {} registers on {architecture}; {MOST_REGISTERS} at most", usage.registers))
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

/// NVIDIA's compilers, as their Python packages contain them.
struct Toolkit {
    /// Folder of NVRTC.
    libraries: PathBuf,
    ptxas: PathBuf,
    nvdisasm: PathBuf,
    includes: Vec<String>,
}

impl Toolkit {
    fn at(folder: &Path) -> Result<Self> {
        let folder = fs::canonicalize(folder).with_context(|| {
            format!(
                "there is no folder {}: make it by `pip install --no-deps --target DIR {PACKAGES}`",
                folder.display()
            )
        })?;
        let part = |path: &str| {
            let path = folder.join("nvidia").join(path);
            ensure!(path.exists(), "{} is missing: `pip install --no-deps --target DIR {PACKAGES}`", path.display());
            Ok(path)
        };
        let includes = ["cuda_runtime/include", "cuda_cccl/include"];
        let includes = includes.into_iter().map(|path| Ok(part(path)?.display().to_string())).collect::<Result<_>>()?;
        let (ptxas, nvdisasm) = (part("cuda_nvcc/bin/ptxas")?, part("cu13/bin/nvdisasm")?);
        Ok(Self { libraries: part("cuda_nvrtc/lib")?, ptxas, nvdisasm, includes })
    }

    /// Whether this process finds NVRTC.
    fn is_linked(&self) -> bool {
        env::split_paths(&env::var_os(LIBRARIES).unwrap_or_default()).any(|folder| folder == self.libraries)
    }

    /// Runs this program again, where it finds NVRTC. The dynamic linker reads its variable only once.
    fn run_again(&self, arguments: &PtxArguments) -> Result<()> {
        let others = env::var_os(LIBRARIES).unwrap_or_default();
        let folders = std::iter::once(self.libraries.clone()).chain(env::split_paths(&others));
        let program = env::current_exe().context("cannot tell the path of this program")?;
        let mut again = Command::new(program);
        again.arg("ptx").arg("--toolkit").arg(&arguments.toolkit).env(LIBRARIES, env::join_paths(folders)?);
        again.args(arguments.write.then_some("--write"));
        again.args(arguments.keep.iter().flat_map(|folder| [OsStr::new("--keep"), folder.as_os_str()]));
        ensure!(again.status().context("cannot start this program again")?.success(), "the kernels are not all right");
        Ok(())
    }

    fn compile(&self, kernel: Kernel, folder: &Path) -> Result<Compiled> {
        let name = kernel.label();
        let mut compiler = CppCompiler::<Cuda>::default();
        let source = compiler
            .compile(kernel.define(), &CompilationOptions::default())
            .map_err(|error| anyhow::anyhow!("CubeCL does not compile {name}: {error:?}"))?;
        let stem = name.replace([' ', ','], "_");
        write(folder, &format!("{stem}.cu"), &source.source)?;
        let usage = |architecture: &'static str| {
            let options = CompileOptions {
                arch: Some(architecture),
                include_paths: self.includes.clone(),
                ..CompileOptions::default()
            };
            let ptx = compile_ptx_with_opts(&source.source, options).map_err(|error| match error {
                CompileError::CompileError { log, .. } => {
                    anyhow::anyhow!("NVRTC does not compile {name} for {architecture}: {}", log.to_string_lossy())
                }
                error => anyhow::anyhow!("NVRTC does not compile {name} for {architecture}: {error}"),
            })?;
            let path = write(folder, &format!("{stem}.{architecture}.ptx"), &ptx.to_src())?;
            self.assemble(&path, architecture).with_context(|| format!("{name} for {architecture}"))
        };
        let usages = ARCHITECTURES.into_iter().map(usage).collect::<Result<_>>()?;
        Ok(Compiled { kernel, shared_memory: source.shared_memory_size, usages })
    }

    fn assemble(&self, ptx: &Path, architecture: &str) -> Result<Usage> {
        let machine_code = ptx.with_extension("cubin");
        let mut ptxas = Command::new(&self.ptxas);
        ptxas.args(["-v", "--gpu-name", architecture, "--output-file"]).arg(&machine_code).arg(ptx);
        let output = ptxas.stdin(Stdio::null()).output().context("cannot start ptxas")?;
        let said = String::from_utf8_lossy(&output.stderr);
        if !output.status.success() {
            bail!("ptxas refuses it: {said}");
        }
        let usage = usage_of(&said).with_context(|| format!("ptxas does not tell the registers: {said}"))?;
        match usage.spills {
            [0, 0] => Ok(usage),
            _ => Ok(Usage { spills_in_loops: sass::spills_in_loops(&self.disassembled(&machine_code)?), ..usage }),
        }
    }

    fn disassembled(&self, machine_code: &Path) -> Result<String> {
        let mut nvdisasm = Command::new(&self.nvdisasm);
        let output = nvdisasm.arg("-c").arg(machine_code).stdin(Stdio::null()).output();
        let output = output.context("cannot start nvdisasm")?;
        let said = String::from_utf8_lossy(&output.stderr);
        ensure!(output.status.success(), "nvdisasm refuses {}: {said}", machine_code.display());
        Ok(String::from_utf8_lossy(&output.stdout).into_owned())
    }
}

fn write(folder: &Path, name: &str, text: &str) -> Result<PathBuf> {
    let path = folder.join(name);
    fs::write(&path, text).with_context(|| format!("cannot write {}", path.display()))?;
    Ok(path)
}

/// The numbers in what `ptxas -v` says of one kernel.
fn usage_of(said: &str) -> Option<Usage> {
    let before = |words: &str| {
        let (text, _) = said.split_once(words)?;
        text.split_whitespace().next_back()?.parse::<usize>().ok()
    };
    Some(Usage {
        registers: before(" registers")?,
        spills: [before(" bytes spill stores")?, before(" bytes spill loads")?],
        spills_in_loops: 0,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_words_of_the_assembler_are_understood() {
        let said = "ptxas info    : 0 bytes gmem\n\
                    ptxas info    : Compiling entry function 'blend' for 'sm_89'\n\
                    ptxas info    : Function properties for blend\n    \
                    16 bytes stack frame, 8 bytes spill stores, 4 bytes spill loads\n\
                    ptxas info    : Used 72 registers, used 1 barriers, 16 bytes cumulative stack size, 424 bytes cmem[0]\n";
        assert_eq!(usage_of(said), Some(Usage { registers: 72, spills: [8, 4], spills_in_loops: 0 }));
        assert_eq!(usage_of("ptxas fatal"), None);
    }
}
