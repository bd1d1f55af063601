//! One HTML file that plays a trained scene in a browser, without a server and without network.
//!
//! | file | contents |
//! |---|---|
//! | `source.rs` | the Gaussians of both branches at keyframes, and what each of them contributes |
//! | `position_step.rs` | the step of the centres |
//! | `budget.rs` | what is left out until the file is small enough |
//! | `scene.rs` | the description of the scene for the player |
//! | `page.rs` | the file |
//! | `player/` | the player: WebGL2 in plain JavaScript |
//!
//! The player blends the branches as the evaluation does (METHOD §1.3) and splats by the rules of the rasteriser
//! (METHOD §8), with two differences: a Gaussian ends where its alpha falls below 1/255 and not at the border of a
//! tile, and a pixel is never finished early.

mod budget;
mod page;
mod position_step;
mod scene;
mod source;

pub use budget::Cut;

use std::fs::File;
use std::io::Read;
use std::path::Path;

use anyhow::{Context, anyhow, bail};
use mvfusion_data::keyframes::{BranchLayout, Keyframes, decode, encode};

use crate::atomic;
use crate::export::{ComparedTimes, Exporter, Fidelity, Loss, ShownGaussians};
use crate::progress::{Progress, Verbosity};
use crate::run::OpenRun;
use budget::first_that_fits;
use source::Source;

/// Bytes at the beginning of a page that contain its mark.
const HEAD: u64 = 4096;

/// Whether a file is a page of this program, of any version.
pub fn is_page(path: &Path) -> bool {
    let mut head = Vec::new();
    let read = File::open(path).and_then(|file| file.take(HEAD).read_to_end(&mut head));
    read.is_ok() && String::from_utf8_lossy(&head).contains(page::MARK)
}

/// A written page.
#[derive(Clone, Debug)]
pub struct Page {
    /// Bytes of the file.
    pub bytes: u64,
    /// What was left out.
    pub cut: Cut,
    /// Number of keyframes.
    pub keyframes: usize,
    /// Number of static and dynamic Gaussians in the file.
    pub gaussians: [usize; 2],
    /// The page's Gaussians, as rendered by the rasteriser, against the model's renders.
    pub loss: Loss,
}

/// Writes the page of a run. It has at most `budget` bytes.
///
/// # Errors
/// If the scene does not fit into the budget, the device fails, or the file cannot be written.
pub fn write_page(
    run: &OpenRun,
    exporter: &Exporter,
    budget: u64,
    path: &Path,
    verbosity: Verbosity,
) -> anyhow::Result<Page> {
    let source = Source::of(run, exporter, verbosity)?;
    let cuts = source.cuts();
    let mut progress = Progress::new("packing", budget::most_trials(cuts.len()), verbosity);
    let fitting = first_that_fits(cuts.len(), |index| {
        let packed = Packed::new(&source, cuts[index])?;
        let html = page::page(&scene::describe(run, exporter, &packed), &packed.bytes)?;
        progress.advance();
        Ok((html.len() as u64 <= budget).then_some((cuts[index], packed, html)))
    });
    progress.finish();
    let (cut, packed, html) = fitting?.ok_or_else(|| {
        anyhow!(
            "the scene does not fit into {}, even with two keyframes, constant colours and a hundredth of its \
             Gaussians. Use a larger --size.",
            bytesize::ByteSize(budget).display().si()
        )
    })?;
    atomic::write(path, html.as_bytes())?;
    let [.., dynamic] = packed.layouts.as_slice() else { bail!("a page without Gaussians") };
    Ok(Page {
        bytes: html.len() as u64,
        cut,
        keyframes: dynamic.times.len(),
        gaussians: [packed.layouts.len().checked_sub(2).map_or(0, |first| packed.layouts[first].count), dynamic.count],
        loss: loss(run, exporter, &packed, verbosity)?,
    })
}

/// The page's Gaussians, as rendered by the rasteriser, against the model's renders.
fn loss(run: &OpenRun, exporter: &Exporter, packed: &Packed, verbosity: Verbosity) -> anyhow::Result<Loss> {
    // From the bytes that the page has, so that nothing can differ.
    let branches = decode(&packed.layouts, &packed.bytes).context("the page's Gaussians cannot be unpacked")?;
    let keyframes = ComparedTimes::BetweenKeyframes(branches.last().map_or(&[], Keyframes::times));
    Fidelity::new(run, exporter, keyframes, verbosity)?.loss(|time| {
        let mut clouds: Vec<_> = branches.iter().map(|branch| branch.at(time)).collect();
        let dynamic = clouds.pop().context("a page without Gaussians")?;
        Ok(ShownGaussians { static_: clouds.pop(), dynamic })
    })
}

/// The Gaussians of a page: those of the static branch if there is one, then those of the dynamic branch.
struct Packed {
    layouts: Vec<BranchLayout>,
    bytes: Vec<u8>,
}

impl Packed {
    fn new(source: &Source, cut: Cut) -> anyhow::Result<Self> {
        let branches = source.after(cut);
        let branches: Vec<&Keyframes> = branches.iter().collect();
        let (layouts, bytes) = encode(&branches).context("cannot compress the Gaussians")?;
        Ok(Self { layouts, bytes })
    }
}
