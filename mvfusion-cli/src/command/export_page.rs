//! `mvfusion export --html`.

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::bail;
use bytesize::ByteSize;

use crate::args::ExportArgs;
use crate::export::Exporter;
use crate::export::html::{is_page, write_page};
use crate::progress::Verbosity;
use crate::run::{FolderLock, MasksRequest, OpenRun, PAGE, RunRequest};

/// Width of the first column.
const LABEL: usize = 16;

/// Writes an HTML file that plays the scene of a run.
///
/// # Errors
/// If the run has no checkpoint, its data are missing, the file exists, the scene does not fit into it, the device
/// fails, or the file cannot be written.
pub fn export_page(args: &ExportArgs, verbosity: Verbosity, out: &mut dyn Write) -> anyhow::Result<()> {
    let (path, _lock) = place(args)?;
    let data = args.data.as_deref();
    let request = RunRequest { run: &args.run, data, masks: MasksRequest::Unused, device: &args.compute.device };
    let run = OpenRun::open(&request, verbosity)?;
    let exporter = Exporter::of(&run, args.no_mfta, verbosity).cropped(&args.crop, verbosity)?;
    let page = write_page(&run, &exporter, args.page.size.as_u64(), &path, verbosity)?;

    let training_times = exporter.context.timeline.times().len();
    let [static_, dynamic] = page.gaussians;
    let size = |bytes: u64| ByteSize(bytes).display().si();
    writeln!(out, "{:LABEL$}{} of {}", "size", size(page.bytes), size(args.page.size.as_u64()))?;
    writeln!(out, "{:LABEL$}{static_} static, {dynamic} dynamic", "Gaussians")?;
    writeln!(out, "{:LABEL$}{} for {training_times} training times", "keyframes", page.keyframes)?;
    writeln!(out, "{:LABEL$}{}", "SH degree", page.cut.reduction.sh_degree)?;
    writeln!(out, "{:LABEL$}{}", "PSNR", page.loss)?;
    verbosity.wrote("page", &path);
    writeln!(out, "{:LABEL$}{}", "written to", path.display())?;
    Ok(())
}

/// The file to write, and the lock of the run if it lies there.
fn place(args: &ExportArgs) -> anyhow::Result<(PathBuf, Option<FolderLock>)> {
    let (path, lock) = match args.page.html.as_ref().and_then(Option::as_ref) {
        Some(path) => (path.clone(), None),
        None => (args.run.join(PAGE), Some(crate::run::lock(&args.run)?)),
    };
    if path.is_dir() {
        bail!("{} is a folder. Give the name of a file: --html=scene.html.", path.display());
    }
    if path.exists() && !args.force {
        bail!("{} exists. Use --force to replace it, or choose another file: --html=FILE.", path.display());
    }
    if path.exists() && !is_page(&path) {
        bail!(
            "{} was not written by `mvfusion export --html`, so --force does not replace it. Choose another file: \
             --html=FILE.",
            path.display()
        );
    }
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    if !folder.is_dir() {
        bail!("there is no folder {}. Create it, or choose another file: --html=FILE.", folder.display());
    }
    Ok((path, lock))
}
