//! The videos of still cameras, one for each: the layout of MultipleView, which keeps every lens.

mod analysis;
mod camera;
mod layout;
mod models;

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use rayon::prelude::*;

use super::colmap::{Colmap, Effort, Images, Kind, Log, chosen};
use super::draft::Draft;
use super::error::PrepareError;
use super::event::{Event, Listener, Tell};
use super::frames::rate;
use super::masks::{Masks, given, none_given};
use super::options::PrepareOptions;
use super::placed::{Placed, unplaced};
use super::record::{Footage, RigCamera};
use super::sync::{Clip, offsets, timeline};
use crate::error::DataError;
use crate::video::{FrameStore, Video};
use analysis::{Start, is_still};
use camera::Camera;
use layout::{image_name, numbers};
use models::best_models;

/// Fewest cameras that see depth.
const FEWEST_CAMERAS: usize = 2;

/// What helps if cameras were not placed.
const HELP: &str = "Neighbouring cameras must show the same still things from less than about 30 degrees apart: \
                    sharper or larger videos, more cameras between those that were placed and those that were not, or \
                    a textured background help; poses from a calibration need no COLMAP (docs/data.md).";

/// Makes the scene in the draft.
///
/// # Errors
/// If the videos cannot be used or share no moment, or COLMAP places fewer than two cameras.
pub(super) fn prepare(
    paths: &[PathBuf],
    draft: &Draft,
    (colmap, log): (&Colmap<'_>, &mut Log),
    options: &PrepareOptions,
    listen: &mut Listener<'_>,
) -> Result<(Footage, Placed), PrepareError> {
    let (cameras, fps) = cameras(paths, options, listen)?;
    let starts = starts(&cameras, listen)?;
    let images = draft.work().join("images");
    fs::create_dir(&images).map_err(|error| PrepareError::unwritable(&images, error))?;
    for (camera, start) in cameras.iter().zip(&starts) {
        start.save(&images.join(image_name(camera.number)))?;
    }
    let (masks, shares) = masks(&cameras, &starts, draft, options, listen)?;
    let names: Vec<String> = cameras.iter().map(|camera| image_name(camera.number)).collect();
    let wanted = Images { folder: &images, count: names.len(), masks: masks.folder(), kind: Kind::Rig };
    let attempt = |effort, listen: &mut Listener<'_>| {
        let work = draft.work().join(if effort == Effort::Usual { "usual" } else { "wide" });
        colmap.models(wanted, effort, &work, log, listen)
    };
    let models = best_models(names.len(), attempt, listen)?;
    let place = chosen(&models, options.colmap.model)?;
    let titles: Vec<String> = cameras.iter().map(|camera| camera.clip.name.clone()).collect();
    let titles_of = |images: &[String]| -> Vec<String> {
        names.iter().zip(&titles).filter(|(name, _)| images.contains(name)).map(|(_, title)| title.clone()).collect()
    };
    let Some(place) = place.filter(|&place| models[place].images.len() >= FEWEST_CAMERAS) else {
        let placed = place.map_or(Vec::new(), |place| titles_of(&models[place].images));
        return Err(unplaced(&titles, &placed, "cameras", HELP, log.shown()));
    };
    models[place].copy_to(&draft.scene().join("sparse_"))?;
    let mut placed = Placed::of(&names, &models, place);
    (placed.placed, placed.unplaced) = (titles_of(&placed.placed), titles_of(&placed.unplaced));
    placed.tell("cameras", HELP, listen)?;
    let moments = cameras.first().map_or(0, |camera| camera.frames.len());
    let kept: Vec<&Camera> = cameras.iter().filter(|camera| placed.placed.contains(&camera.clip.name)).collect();
    layout::write(&kept, &draft.scene(), listen)?;
    let records = cameras.iter().zip(&starts).zip(&shares).map(|((camera, start), &masked)| RigCamera {
        name: layout::folder_name(camera),
        placed: placed.placed.contains(&camera.clip.name),
        video: camera.video.path().to_owned(),
        first_frame: camera.first_frame(),
        offset: camera.offset,
        changing_edges: start.changing_edges,
        masked,
    });
    Ok((Footage::Rig { fps, moments, cameras: records.collect() }, placed))
}

/// Opens the videos and finds their common timeline.
fn cameras(
    paths: &[PathBuf],
    options: &PrepareOptions,
    listen: &mut Listener<'_>,
) -> Result<(Vec<Camera>, f64), PrepareError> {
    let store = FrameStore::new(None);
    let videos: Vec<Arc<Video>> =
        paths.iter().map(|path| Video::open(path, usize::MAX, &store)).collect::<Result<_, _>>()?;
    let stem = |path: &Path| path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    if let Some(other) = videos.iter().find(|video| video.size() != videos[0].size()) {
        let size = |video: &Video| format!("{} has {} x {} pixels", stem(video.path()), video.size().0, video.size().1);
        return Err(PrepareError::Data(DataError::Disagreement {
            folder: other.path().parent().unwrap_or(other.path()).to_owned(),
            first: size(&videos[0]),
            second: size(other),
            advice: "All videos of a rig must have one size: scale them alike".into(),
        }));
    }
    let clip = |video: &Arc<Video>, listen: &mut Listener<'_>| -> Result<Clip, PrepareError> {
        let fps = rate(video, listen)?;
        Ok(Clip { name: stem(video.path()), frames: video.len(), fps })
    };
    let clips: Vec<Clip> = videos.iter().map(|video| clip(video, listen)).collect::<Result<_, _>>()?;
    let names: Vec<&str> = clips.iter().map(|clip| clip.name.as_str()).collect();
    if let Some(twin) = names.windows(2).find(|pair| pair[0] == pair[1]) {
        let reason = format!("two videos are named {}: each camera needs one video", twin[0]);
        return Err(PrepareError::Input { input: paths[0].parent().unwrap_or(&paths[0]).to_owned(), reason });
    }
    let slowest = clips.iter().map(|clip| clip.fps).fold(f64::INFINITY, f64::min);
    let fps = options.fps.map_or(slowest, |fps| fps.min(slowest));
    let paths: Vec<&Path> = paths.iter().map(PathBuf::as_path).collect();
    let offsets = offsets(&clips, &paths, options, listen)?;
    let frames = timeline(&clips, &offsets, fps)?;
    listen.note(format!("{} cameras share {} moments, {fps:.2} per second", clips.len(), frames[0].len()))?;
    let numbers = numbers(&names);
    let parts = videos.into_iter().zip(numbers).zip(clips).zip(offsets).zip(frames);
    let cameras = parts
        .map(|((((video, number), clip), offset), frames)| Camera { video, number, clip, offset, frames })
        .collect();
    Ok((cameras, fps))
}

/// The beginning of every video.
fn starts(cameras: &[Camera], listen: &mut Listener<'_>) -> Result<Vec<Start>, PrepareError> {
    listen.tell(Event::Begins { what: "first frames", total: cameras.len() })?;
    let mut starts = Vec::with_capacity(cameras.len());
    // One after another: a video that is decoded keeps several processors busy.
    for camera in cameras {
        starts.push(Start::of(camera, listen)?);
        listen.tell(Event::Advances)?;
    }
    listen.tell(Event::Ends)?;
    for (camera, start) in cameras.iter().zip(&starts) {
        let Some(share) = start.changing_edges.filter(|&share| !is_still(share)) else { continue };
        listen.note(format!(
            "{} does not stand still: {:.0} % of the edges in its first frame change within seconds. The poses of a \
             rig are those of its first frames. If the camera moves, leave it out, or prepare its video alone",
            camera.clip.name,
            100.0 * share
        ))?;
    }
    Ok(starts)
}

/// Masks for COLMAP of what moves in the first frames, given or found, and the masked share of each.
fn masks(
    cameras: &[Camera],
    starts: &[Start],
    draft: &Draft,
    options: &PrepareOptions,
    listen: &mut Listener<'_>,
) -> Result<(Masks, Vec<Option<f64>>), PrepareError> {
    let mut masks = Masks::create(draft.work().join("masks"))?;
    let found: Vec<Option<image::GrayImage>> = match &options.masks {
        Some(folder) => {
            let of = |camera: &Camera| {
                let (name, first) = (&camera.clip.name, camera.first_frame());
                given(folder, &[name.clone(), format!("{name}/{first:04}")], camera.video.size())
            };
            cameras.iter().map(of).collect::<Result<_, _>>()?
        }
        None => starts.par_iter().map(Start::moving).collect(),
    };
    if let (Some(folder), true) = (&options.masks, found.iter().all(Option::is_none)) {
        return Err(none_given(folder, &cameras[0].clip.name));
    }
    let shares: Vec<Option<f64>> = found.iter().map(|mask| mask.as_ref().map(analysis::share)).collect();
    for (camera, mask) in cameras.iter().zip(found) {
        if let Some(mask) = mask {
            masks.add(&image_name(camera.number), mask)?;
        }
    }
    let known: Vec<f64> = shares.iter().flatten().copied().collect();
    let mean = 100.0 * known.iter().sum::<f64>() / known.len().max(1) as f64;
    listen.note(match (known.is_empty(), &options.masks) {
        (true, _) => "the videos are too short to see what moves: COLMAP gets no masks".into(),
        (false, Some(_)) => format!("{} of {} cameras have masks; they cover {mean:.0} %", known.len(), cameras.len()),
        (false, None) => format!("what moves covers {mean:.0} % of the first frames: COLMAP ignores it"),
    })?;
    Ok((masks, shares))
}
