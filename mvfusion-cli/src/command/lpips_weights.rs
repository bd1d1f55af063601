//! `mvfusion lpips-weights`.

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use mvfusion_data::files::read_bytes;
use mvfusion_model::evaluation::Backbone;
use mvfusion_model::evaluation::lpips_conversion::{Collection, FoundPart, Part, Weights};
use mvfusion_model::files::sha256;
use tracing::warn;

use crate::args::LpipsWeightsArgs;
use crate::failure::UsageError;
use crate::{atomic, lpips};

/// Makes the files that `--lpips-weights` reads. Everything is checked before anything is written.
///
/// # Errors
/// If a given file cannot be used, no network is complete, other weights are in the way, or a file cannot be written.
pub fn lpips_weights(args: &LpipsWeightsArgs, out: &mut dyn Write) -> anyhow::Result<()> {
    let folder = output_folder(args.out.as_deref())?;
    let collection = Collection::gather(&args.from)?;
    for unused in &collection.unused {
        warn!("not used: {unused}");
    }
    let networks = Backbone::ALL.map(|backbone| Ok((backbone, collection.weights(backbone)?)));
    let networks = networks.into_iter().collect::<anyhow::Result<Vec<_>>>()?;
    if networks.iter().all(|(_, weights)| weights.is_none()) {
        bail!("no network is complete, and nothing was written. {}", missing(&collection));
    }
    for weights in networks.iter().filter_map(|(_, weights)| weights.as_ref()).filter(|_| !args.force) {
        refuse_to_replace(weights, &folder)?;
    }
    std::fs::create_dir_all(&folder).with_context(|| format!("cannot create the folder {}", folder.display()))?;
    // Files first: whoever reads stdout may have left.
    for weights in networks.iter().filter_map(|(_, weights)| weights.as_ref()) {
        atomic::write(&folder.join(&weights.name), &weights.bytes)?;
    }
    for (backbone, weights) in &networks {
        writeln!(out, "{}", backbone.label())?;
        for part in Part::ALL.into_iter().filter(|part| part.backbone == *backbone) {
            describe(part, collection.part(part), out)?;
        }
        match weights {
            Some(weights) => {
                let path = folder.join(&weights.name);
                writeln!(out, "  {:15}{}, SHA-256 {}", "written", path.display(), weights.sha256)?;
            }
            None => writeln!(out, "  {:15}its weights are not complete", "not written")?,
        }
    }
    writeln!(out, "{}", how_to_use(&folder)?)?;
    Ok(())
}

/// The folder that is written to.
fn output_folder(asked: Option<&Path>) -> anyhow::Result<PathBuf> {
    let folder = asked.map(Path::to_owned).or_else(lpips::default_folder);
    let folder = folder.ok_or_else(|| UsageError::new("this system names no folder for data; give one with --out."))?;
    Ok(std::path::absolute(folder)?)
}

/// The parts that were not found, and where they come from.
fn missing(collection: &Collection) -> String {
    let lacks = |part: &Part| collection.part(*part).is_none();
    let said = Part::ALL.into_iter().filter(lacks).map(|part| format!("{}: {}", part.words(), part.source()));
    format!("Missing are {}", said.collect::<Vec<_>>().join("; "))
}

fn refuse_to_replace(weights: &Weights, folder: &Path) -> anyhow::Result<()> {
    let path = folder.join(&weights.name);
    if !path.exists() {
        return Ok(());
    }
    let bytes = read_bytes(&path, Backbone::MOST_BYTES).with_context(|| format!("cannot read {}", path.display()))?;
    let there = sha256(&bytes);
    if there == weights.sha256 {
        return Ok(());
    }
    let message = format!(
        "{} holds other weights (SHA-256 {there}). --force replaces them, and --out names another folder.",
        path.display()
    );
    Err(UsageError::new(message).into())
}

/// A line for a part, and a warning if nobody published its file.
fn describe(part: Part, found: Option<&FoundPart>, out: &mut dyn Write) -> anyhow::Result<()> {
    let kind = part.kind.words();
    let Some(FoundPart { origin, sha256, is_published, .. }) = found else {
        return Ok(writeln!(out, "  {kind:15}missing; get {}", part.source())?);
    };
    let published = if *is_published { ", as published" } else { "" };
    writeln!(out, "  {kind:15}{origin}, SHA-256 {sha256}{published}")?;
    if !is_published {
        warn!(
            "{origin} is not the published file: distances by these weights compare with those of others only if its \
             numbers are the same. The published one: {}",
            part.source()
        );
    }
    Ok(())
}

/// How the commands find the folder.
fn how_to_use(folder: &Path) -> anyhow::Result<String> {
    let found = lpips::find(None)?;
    Ok(match found {
        Some(found) if found.folder == folder => {
            "train and eval use this folder by themselves; --lpips-weights none leaves LPIPS out.".to_owned()
        }
        _ => format!("Use it with --lpips-weights {}", crate::interrupt::for_shell(&folder.to_string_lossy())),
    })
}
