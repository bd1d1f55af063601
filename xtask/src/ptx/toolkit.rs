//! NVIDIA's compilers: from CubeCL's source to machine code, and what they tell of it.

use std::env;
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context, Result, bail, ensure};
use cubecl::Compiler;
use cubecl_cpp::shared::{CompilationOptions, CppCompiler};
use cubecl_cpp::target::Cuda;
use cudarc::nvrtc::{CompileError, CompileOptions, compile_ptx_with_opts};
use mvfusion_kernels::cube::catalogue::Kernel;

use super::{ARCHITECTURES, PtxArguments, sass};

/// The packages that a toolkit consists of, from PyPI.
const PACKAGES: &str = "nvidia-cuda-nvrtc-cu12 nvidia-cuda-nvcc-cu12 nvidia-cuda-runtime-cu12 nvidia-cuda-cccl-cu12 \
                        nvidia-cuda-nvdisasm";

/// Where the dynamic linker looks for NVRTC.
const LIBRARIES: &str = "LD_LIBRARY_PATH";

/// What `ptxas` tells of a kernel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Usage {
    pub registers: usize,
    /// Bytes of spilled registers, stored and loaded.
    pub spills: [usize; 2],
    /// Instructions within loops that access them.
    pub spills_in_loops: usize,
}

/// A kernel on all architectures.
pub(super) struct Compiled {
    pub kernel: Kernel,
    /// Bytes.
    pub shared_memory: usize,
    pub usages: Vec<Usage>,
}

/// NVIDIA's compilers, as their Python packages contain them.
pub(super) struct Toolkit {
    /// Folder of NVRTC.
    libraries: PathBuf,
    ptxas: PathBuf,
    nvdisasm: PathBuf,
    includes: Vec<String>,
}

impl Toolkit {
    pub fn at(folder: &Path) -> Result<Self> {
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
    pub fn is_linked(&self) -> bool {
        env::split_paths(&env::var_os(LIBRARIES).unwrap_or_default()).any(|folder| folder == self.libraries)
    }

    /// Runs this program again, where it finds NVRTC. The dynamic linker reads its variable only once.
    pub fn run_again(&self, arguments: &PtxArguments) -> Result<()> {
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

    pub fn compile(&self, kernel: Kernel, folder: &Path) -> Result<Compiled> {
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
