//! The common timeline of the videos of a rig: offsets that are given or measured, and the frames to take.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Serialize;

use super::delay::{Delay, LEAST_CONFIDENCE, Reference};
use super::error::PrepareError;
use super::event::{Event, Listener, Tell};
use super::options::{PrepareOptions, Sync};
use crate::video::sound;

/// Samples per second of the sound.
const RATE: u32 = 16_000;

/// The part of the sound that is compared, in seconds.
const LONGEST_SOUND: f64 = 600.0;

/// A video of a rig.
#[derive(Clone, Debug)]
pub(super) struct Clip {
    /// The file's name without its extension.
    pub(super) name: String,
    /// Number of frames.
    pub(super) frames: usize,
    pub(super) fps: f64,
}

/// When a video began.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(super) struct Offset {
    /// Seconds by which its recording started later than time zero.
    pub(super) seconds: f64,
    pub(super) source: OffsetSource,
    /// Of a measured offset: the peak of the correlation, over the next one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) confidence: Option<f64>,
}

/// Where an offset comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum OffsetSource {
    Given,
    /// The sound of the others is compared with its own.
    TimeZero,
    Sound,
    TakenAsSynchronous,
}

/// The offset of each clip, and a note for the user on each.
///
/// # Errors
/// If an offset was given for no video, a sound cannot be read, or two sounds have nothing in common.
pub(super) fn offsets(
    clips: &[Clip],
    paths: &[&Path],
    options: &PrepareOptions,
    listen: &mut Listener<'_>,
) -> Result<Vec<Offset>, PrepareError> {
    if let Some(unknown) = options.offsets.keys().find(|name| clips.iter().all(|clip| clip.name != **name)) {
        let names: Vec<&str> = clips.iter().map(|clip| clip.name.as_str()).collect();
        let reason = format!("there is no video {unknown}, only {}", names.join(", "));
        return Err(PrepareError::Option { option: "--offset", reason });
    }
    let measured = match options.sync {
        Sync::None => BTreeMap::new(),
        Sync::Sound => measured(clips, paths, &options.offsets, listen)?,
    };
    let offset = |(place, clip): (usize, &Clip)| {
        let given = options.offsets.get(&clip.name).map(|&seconds| (seconds, OffsetSource::Given, None));
        let heard = || measured.get(clip.name.as_str()).map(|d| (d.seconds, OffsetSource::Sound, Some(d.confidence)));
        let zero = || (options.sync == Sync::Sound && place == 0).then_some((0.0, OffsetSource::TimeZero, None));
        let found = given.or_else(heard).or_else(zero);
        let (seconds, source, confidence) = found.unwrap_or((0.0, OffsetSource::TakenAsSynchronous, None));
        Offset { seconds, source, confidence }
    };
    let offsets: Vec<Offset> = clips.iter().enumerate().map(offset).collect();
    for (clip, offset) in clips.iter().zip(&offsets) {
        if let Some(told) = told(&clip.name, offset) {
            listen.note(told)?;
        }
    }
    let taken: Vec<&str> = clips
        .iter()
        .zip(&offsets)
        .filter(|(_, offset)| offset.source == OffsetSource::TakenAsSynchronous)
        .map(|(clip, _)| clip.name.as_str())
        .collect();
    if !taken.is_empty() {
        listen.note(format!(
            "taken as synchronous, from their first frames on: {} (--offset CAM=SECONDS gives an offset, and --sync \
             sound measures it)",
            taken.join(", ")
        ))?;
    }
    Ok(offsets)
}

/// A given or measured offset in words.
fn told(name: &str, offset: &Offset) -> Option<String> {
    let seconds = offset.seconds;
    match (offset.source, offset.confidence) {
        (OffsetSource::Given, _) => Some(format!("{name} started {seconds:+.3} s after time zero, as given")),
        (OffsetSource::TimeZero, _) => Some(format!("{name} is time zero")),
        (OffsetSource::Sound, confidence) => Some(format!(
            "{name} started {seconds:+.3} s after time zero by its sound (the peak is {:.1} times the next one)",
            confidence.unwrap_or(1.0)
        )),
        (OffsetSource::TakenAsSynchronous, _) => None,
    }
}

/// The delays by sound of the videos without a given offset. The first video is time zero, at its given offset.
fn measured<'a>(
    clips: &'a [Clip],
    paths: &[&Path],
    given: &BTreeMap<String, f64>,
    listen: &mut Listener<'_>,
) -> Result<BTreeMap<&'a str, Delay>, PrepareError> {
    let (Some(first), Some(path)) = (clips.first(), paths.first()) else { return Ok(BTreeMap::new()) };
    let wanted: Vec<(&Clip, &Path)> =
        clips.iter().zip(paths.iter().copied()).skip(1).filter(|(clip, _)| !given.contains_key(&clip.name)).collect();
    let mut delays = BTreeMap::new();
    if wanted.is_empty() {
        return Ok(delays);
    }
    let zero = given.get(&first.name).copied().unwrap_or(0.0);
    let mut reference = Reference::new(sound(path, RATE, LONGEST_SOUND)?, RATE);
    // One after another: the transform of ten minutes takes hundreds of megabytes.
    for (clip, path) in wanted {
        listen.tell(Event::Continues)?;
        let name = clip.name.as_str();
        let delay = reference.delay(&sound(path, RATE, LONGEST_SOUND)?);
        if delay.confidence < LEAST_CONFIDENCE {
            let reason = format!(
                "the sounds of {name} and {} have too little in common to tell their offset (the peak of their \
                 correlation is {:.2} times the next one, and {LEAST_CONFIDENCE} is the least): give it with --offset \
                 {name}=SECONDS",
                first.name, delay.confidence
            );
            return Err(PrepareError::Option { option: "--sync sound", reason });
        }
        delays.insert(name, Delay { seconds: zero + delay.seconds, ..delay });
    }
    Ok(delays)
}

/// The frames to take of each clip, so that all have one rate and the same moments.
///
/// # Errors
/// [`PrepareError::Option`] if the videos share no moment.
pub(super) fn timeline(clips: &[Clip], offsets: &[Offset], fps: f64) -> Result<Vec<Vec<usize>>, PrepareError> {
    let both = || clips.iter().zip(offsets);
    let start = both().map(|(_, offset)| offset.seconds).fold(f64::NEG_INFINITY, f64::max);
    let end = both().map(|(clip, offset)| offset.seconds + clip.frames as f64 / clip.fps).fold(f64::INFINITY, f64::min);
    // The frames of one moment are at most half a frame apart.
    let index = |moment: usize, clip: &Clip, offset: &Offset| {
        ((start + moment as f64 / fps - offset.seconds) * clip.fps).round() as usize
    };
    let is_filmed = |&moment: &usize| both().all(|(clip, offset)| index(moment, clip, offset) < clip.frames);
    let most = ((end - start) * fps).ceil().max(0.0) as usize + 1;
    let count = (0..most).take_while(is_filmed).count();
    if count == 0 {
        let reason =
            format!("with these offsets, the last video starts at {start:.3} s and the first one ends at {end:.3} s");
        return Err(PrepareError::Option { option: "--offset", reason });
    }
    Ok(both().map(|(clip, offset)| (0..count).map(|moment| index(moment, clip, offset)).collect()).collect())
}

#[cfg(test)]
mod tests {
    use std::ops::ControlFlow;

    use super::*;

    fn clip(name: &str, frames: usize, fps: f64) -> Clip {
        Clip { name: name.into(), frames, fps }
    }

    fn at(seconds: f64) -> Offset {
        Offset { seconds, source: OffsetSource::Given, confidence: None }
    }

    #[test]
    fn synchronous_videos_keep_their_frames_up_to_the_end_of_the_shortest() {
        let clips = [clip("a", 24, 29.97), clip("b", 20, 29.97)];
        let frames = timeline(&clips, &[at(0.0), at(0.0)], 29.97).expect("shared");
        assert_eq!(frames, vec![(0..20).collect::<Vec<_>>(); 2]);
    }

    #[test]
    fn a_later_start_skips_frames_of_the_others_and_rates_may_differ() {
        let clips = [clip("a", 60, 30.0), clip("b", 100, 60.0)];
        let frames = timeline(&clips, &[at(0.0), at(0.5)], 15.0).expect("shared");
        assert_eq!(frames[0][..3], [15, 17, 19]);
        assert_eq!(frames[1][..3], [0, 4, 8]);
        assert_eq!(frames[0].len(), 23);
        assert!(frames[0].iter().all(|&frame| frame < 60) && frames[1].iter().all(|&frame| frame < 100));
    }

    #[test]
    fn videos_without_a_common_moment_are_refused() {
        let said = timeline(&[clip("a", 30, 30.0), clip("b", 30, 30.0)], &[at(0.0), at(2.0)], 30.0);
        let said = said.expect_err("nothing shared").to_string();
        assert!(said.contains("starts at 2.000 s") && said.contains("ends at 1.000 s"), "{said}");
    }

    #[test]
    fn what_is_not_known_is_said_and_an_offset_of_no_video_is_refused() {
        let clips = [clip("a", 30, 30.0), clip("b", 30, 30.0)];
        let paths = [Path::new("a.mp4"), Path::new("b.mp4")];
        let mut notes = Vec::new();
        let mut options = PrepareOptions { offsets: BTreeMap::from([("b".into(), 0.25)]), ..Default::default() };
        let mut listen = |event: Event| {
            notes.push(event);
            ControlFlow::Continue(())
        };
        let found = offsets(&clips, &paths, &options, &mut listen).expect("found");
        assert_eq!(found.iter().map(|offset| offset.seconds).collect::<Vec<_>>(), [0.0, 0.25]);
        assert_eq!(notes[0], Event::Note("b started +0.250 s after time zero, as given".into()));
        assert!(
            matches!(&notes[1], Event::Note(note) if note.starts_with("taken as synchronous, from their first frames on: a (")),
            "{notes:?}"
        );
        options.offsets = BTreeMap::from([("c".into(), 1.0)]);
        let said = offsets(&clips, &paths, &options, &mut |_| ControlFlow::Continue(()))
            .expect_err("no such video")
            .to_string();
        assert!(said.contains("there is no video c, only a, b"), "{said}");
    }
}
