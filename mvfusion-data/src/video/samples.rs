//! Position and time of the coded frames of an mp4 track (ISO/IEC 14496-12, section 8.6 and 8.7).

use std::iter::repeat_n;

use mp4_atom::{Co64, Ctts, Stco, Stsc, StscEntry, Stsz, StszSamples, Stts};

use super::boxes::{leaf, optional_leaf};

/// Maximum number of frames of a video: a day at 48 FPS. A header can claim billions in a few bytes.
const MOST_SAMPLES: usize = 1 << 22;

/// A coded frame in the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(not(feature = "h264"), allow(dead_code, reason = "only the built-in decoder reads it"))]
pub(super) struct Sample {
    /// First byte in the file.
    pub(super) start: u64,
    /// Number of bytes.
    pub(super) bytes: u32,
}

/// The coded frames of a track, in decoding order.
pub(super) struct Samples {
    pub(super) samples: Vec<Sample>,
    /// Display time of each, in the time units of the track.
    pub(super) times: Vec<i64>,
}

impl Samples {
    /// Reads a sample table, the content of a `stbl` box. Every sample is within the file.
    pub(super) fn read(stbl: &[u8], file_bytes: u64) -> Result<Self, String> {
        let sizes = leaf::<Stsz>(stbl)?.samples;
        let count = match &sizes {
            StszSamples::Identical { count, .. } => *count as usize,
            StszSamples::Different { sizes } => sizes.len(),
        };
        if count > MOST_SAMPLES {
            return Err(format!("its header tells of {count} frames"));
        }
        let samples = places(&sizes, count, &leaf::<Stsc>(stbl)?.entries, &chunks(stbl)?, file_bytes)?;
        Ok(Self { samples, times: times(stbl, count)? })
    }
}

/// The position of each chunk of samples in the file.
fn chunks(stbl: &[u8]) -> Result<Vec<u64>, String> {
    if let Some(large) = optional_leaf::<Co64>(stbl)? {
        return Ok(large.entries);
    }
    Ok(leaf::<Stco>(stbl)?.entries.into_iter().map(u64::from).collect())
}

/// Assigns the samples to the chunks, one after another.
fn places(
    sizes: &StszSamples,
    count: usize,
    runs: &[StscEntry],
    chunks: &[u64],
    file_bytes: u64,
) -> Result<Vec<Sample>, String> {
    let mut samples = Vec::new();
    let mut runs = runs.iter().peekable();
    let mut in_chunk = 0;
    for (number, &chunk) in (1..).zip(chunks) {
        while let Some(run) = runs.next_if(|run| run.first_chunk <= number) {
            in_chunk = run.samples_per_chunk as usize;
        }
        let mut start = chunk;
        for index in samples.len()..count.min(samples.len().saturating_add(in_chunk)) {
            let bytes = match sizes {
                StszSamples::Identical { size, .. } => *size,
                StszSamples::Different { sizes } => sizes[index],
            };
            let end = start.checked_add(bytes.into()).filter(|&end| end <= file_bytes);
            let end = end.ok_or_else(|| format!("it is cut short: frame {index} of {count} lies beyond its end"))?;
            samples.push(Sample { start, bytes });
            start = end;
        }
    }
    match samples.len() == count {
        true => Ok(samples),
        false => Err(format!("its header places only {} of {count} frames", samples.len())),
    }
}

/// Display time of each sample. Sums saturate, so that no header can make them overflow.
fn times(stbl: &[u8], count: usize) -> Result<Vec<i64>, String> {
    let steps = leaf::<Stts>(stbl)?.entries;
    let shifts = optional_leaf::<Ctts>(stbl)?.unwrap_or_default().entries;
    let steps = steps.iter().flat_map(|run| repeat_n(i64::from(run.sample_delta), run.sample_count as usize));
    let shifts = shifts.iter().flat_map(|run| repeat_n(run.sample_offset, run.sample_count as usize));
    let decoded = steps.scan(0i64, |next, step| {
        let time = *next;
        *next = next.saturating_add(step);
        Some(time)
    });
    let shown = decoded.zip(shifts.chain(std::iter::repeat(0))).map(|(time, shift)| time.saturating_add(shift));
    let times: Vec<i64> = shown.take(count).collect();
    match times.len() == count {
        true => Ok(times),
        false => Err(format!("its header times only {} of {count} frames", times.len())),
    }
}
