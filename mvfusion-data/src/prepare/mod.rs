//! From photos or videos to a scene that [`open`](crate::open) reads: frames are chosen, videos are put on one
//! timeline, and the program COLMAP, which must be installed, finds the poses.
//!
//! | input | frames | COLMAP's images | output |
//! |---|---|---|---|
//! | a folder of photos | all | all | `images/`, `sparse/0/` |
//! | a video of one moving camera | the sharpest of each window | the frames | `images/`, `sparse/0/` |
//! | a folder of videos, one for each still camera | all, or at a lower rate | the first of each camera | the layout of MultipleView: `camNN.mp4` or `camNN/`, `sparse_/` |
//!
//! The layout of MultipleView keeps the lens of each camera; that of Neu3D would lose all but the focal length.
//! Everything is made in a folder beside the output and renamed at the end, with a record (`prepare.json`) and COLMAP's
//! log (`colmap.log`).

mod colmap;
mod delay;
mod draft;
mod error;
mod event;
mod frames;
mod input;
mod masks;
mod options;
mod placed;
mod record;
mod rig;
mod sharp;
mod single;
mod sync;
#[cfg(test)]
mod tests;

use std::path::Path;

pub use crate::readers::colmap::model::lens_models;
pub use error::PrepareError;
pub use event::{Event, Listener};
pub(crate) use input::is_video;
pub use options::{ColmapOptions, Gpu, Matcher, PrepareOptions, Sync};
pub use placed::Placed;
pub use record::{Footage, RigCamera};

use colmap::{Colmap, Log};
use draft::{Draft, LOG};
use event::Tell;
use input::Input;
use record::Record;
use single::Source;

/// What was made.
#[derive(Clone, Debug, PartialEq)]
pub struct Prepared {
    /// What it was made of.
    pub footage: Footage,
    /// Which images COLMAP placed.
    pub placed: Placed,
}

/// Makes a scene from photos or videos in the folder `out`. `listen` hears what is chosen, assumed and found, and can
/// end it.
///
/// # Errors
/// [`PrepareError`]. Nothing is left then but COLMAP's log, if it failed: beside `out`, under the name that the error
/// gives.
pub fn prepare(
    input: &Path,
    out: &Path,
    options: &PrepareOptions,
    listen: &mut Listener<'_>,
) -> Result<Prepared, PrepareError> {
    let footage = Input::of(input)?;
    check_options(&footage, options)?;
    Draft::check(out, options.replace)?;
    let colmap = Colmap::find(&options.colmap, listen)?;
    let draft = Draft::create(out)?;
    draft.make()?;
    if let Some(others) = footage.left_out() {
        listen.note(others)?;
    }
    let mut log = Log::create(&draft.scene().join(LOG), &draft.failed_log())?;
    let tools = (&colmap, &mut log);
    let made = match &footage {
        Input::Photos(photos) => single::prepare(&Source::Photos(photos), &draft, tools, options, listen),
        Input::Video(video) => single::prepare(&Source::Video(video), &draft, tools, options, listen),
        Input::Rig(videos) => rig::prepare(videos, &draft, tools, options, listen),
    };
    // A signal from a terminal also ends the programs that were started, and their failure may be seen first.
    let made = made.map_err(|error| listen.tell(Event::Continues).err().unwrap_or(error));
    let (footage, placed) = made.inspect_err(|error| {
        if matches!(error, PrepareError::Step { .. } | PrepareError::Unplaced { .. }) {
            draft.keep_log();
        }
    })?;
    let (version, seed) = (colmap.version(), options.colmap.seed);
    Record { input, colmap: version, seed, footage: &footage, placed: &placed }.write(&draft.scene())?;
    // Some systems rename no folder in which a file is open.
    drop(log);
    draft.publish()?;
    Ok(Prepared { footage, placed })
}

/// Refuses options that cannot be used with this footage.
fn check_options(footage: &Input, options: &PrepareOptions) -> Result<(), PrepareError> {
    let refused = |option, reason: &str| Err(PrepareError::Option { option, reason: reason.into() });
    let is_rig = matches!(footage, Input::Rig(_));
    if !is_rig && (!options.offsets.is_empty() || options.sync != Sync::None) {
        let option = if options.offsets.is_empty() { "--sync" } else { "--offset" };
        return refused(option, "it is for a folder with a video for each camera");
    }
    if matches!(footage, Input::Photos(_)) && options.fps.is_some() {
        return refused("--fps", "it is for videos, and these are photos");
    }
    if options.fps.is_some_and(|fps| !fps.is_finite() || fps <= 0.0) {
        return refused("--fps", "it must be above 0");
    }
    if let Some((name, _)) = options.offsets.iter().find(|(_, seconds)| !seconds.is_finite()) {
        return refused("--offset", &format!("that of {name} is no number"));
    }
    if let Some(masks) = options.masks.as_ref().filter(|masks| !masks.is_dir()) {
        return refused("--masks", &format!("{} is no folder", masks.display()));
    }
    Ok(())
}
