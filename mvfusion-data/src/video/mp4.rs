//! The headers of an mp4 file: its first video track, and the positions of the coded frames.
//!
//! Only the boxes of that track are parsed, so a sound track in an unknown format is harmless.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use mp4_atom::{Avcc, Colr, Decode, Elst, FourCC, Hdlr, Header, Mdhd, Mvhd, ReadFrom, Tkhd, Visual};

use super::boxes::{child, children, leaf, optional_leaf};
use super::samples::{Sample, Samples};
use crate::files::open_file;

/// Largest accepted `moov` box. An hour of frames needs about two megabytes.
const MOST_HEADER_BYTES: u64 = 1 << 28;
/// Maximum number of boxes before the `moov` box.
const MOST_BOXES: usize = 4096;
/// Types of boxes at the start of an mp4 or QuickTime file.
const FIRST_KINDS: [&[u8; 4]; 7] = [b"ftyp", b"moov", b"mdat", b"free", b"skip", b"wide", b"pnot"];

/// The first video track of a file.
#[derive(Debug)]
#[cfg_attr(not(feature = "h264"), allow(dead_code, reason = "where the frames lie is for the built-in decoder"))]
pub(super) struct Track {
    /// Width and height as coded.
    coded_size: (u32, u32),
    /// The rotation that makes the frames upright.
    pub(super) turn: Turn,
    pub(super) codec: Codec,
    /// The coded frames, in decoding order.
    pub(super) samples: Vec<Sample>,
    /// Number of frames at the start that are decoded but not shown, because the edit list cuts them.
    pub(super) hidden: usize,
    /// Number of frames that are shown.
    pub(super) shown: usize,
    /// Mean number of coded frames per second, if the header tells the duration.
    pub(super) fps: Option<f64>,
}

/// The codec of a track.
#[derive(Debug)]
#[cfg_attr(not(feature = "h264"), allow(dead_code, reason = "the setup is for the built-in decoder"))]
pub(super) enum Codec {
    H264(H264Setup),
    /// Another codec, by its common name or its four-letter code.
    Other(String),
}

/// The parameters of an H.264 track in the container.
#[derive(Debug)]
#[cfg_attr(not(feature = "h264"), allow(dead_code, reason = "only the built-in decoder reads it"))]
pub(super) struct H264Setup {
    /// Sequence parameter sets, then picture parameter sets, without start codes.
    pub(super) parameter_sets: Vec<Vec<u8>>,
    /// Bytes of the length before each unit of a sample, 1 to 4.
    pub(super) length_size: u8,
    /// Matrix coefficients (ITU-T H.273) and whether the range is full, if the container states them.
    pub(super) colour: Option<(u16, bool)>,
}

/// A clockwise turn, in quarters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Turn {
    None,
    Quarter,
    Half,
    ThreeQuarters,
}

impl Track {
    /// Width and height of the upright frames.
    pub(super) fn size(&self) -> (u32, u32) {
        let (width, height) = self.coded_size;
        match self.turn {
            Turn::None | Turn::Half => (width, height),
            Turn::Quarter | Turn::ThreeQuarters => (height, width),
        }
    }
}

/// Reads the headers. The error is a clause that continues "cannot use the file:".
pub(super) fn read(path: &Path) -> Result<Track, String> {
    let mut file = open_file(path).map_err(|e| e.to_string())?;
    let file_bytes = file.metadata().map_err(|e| e.to_string())?.len();
    let moov = moov(&mut file, file_bytes)?;
    if child(&moov, b"mvex").is_some() {
        return Err("it is a fragmented mp4 file".into());
    }
    let movie: Mvhd = leaf(&moov)?;
    if turn(&movie.matrix)? != Turn::None {
        return Err("the movie as a whole is turned".into());
    }
    let is_video = |trak: &&[u8]| child(trak, b"mdia").is_some_and(|m| leaf::<Hdlr>(m).is_ok_and(is_video));
    let trak = children(&moov).filter(|(kind, _)| kind == b"trak").map(|(_, content)| content).find(is_video);
    track(trak.ok_or("it has no video track")?, movie.timescale, file_bytes)
}

fn is_video(handler: Hdlr) -> bool {
    handler.handler == FourCC::new(b"vide")
}

/// The content of the `moov` box, which may be at either end of the file.
fn moov(file: &mut File, file_bytes: u64) -> Result<Vec<u8>, String> {
    const CUT: &str = "it is cut short: there is no index (moov box)";
    let mut at = 0;
    for index in 0..MOST_BOXES {
        file.seek(SeekFrom::Start(at)).map_err(|e| e.to_string())?;
        let header = match Header::read_from(file) {
            Ok(header) => header,
            Err(_) if index == 0 => return Err("it is no mp4 file".into()),
            Err(_) => return Err(CUT.into()),
        };
        if index == 0 && !FIRST_KINDS.iter().any(|kind| header.kind == FourCC::new(kind)) {
            return Err("it is no mp4 file".into());
        }
        let start = file.stream_position().map_err(|e| e.to_string())?;
        let end = header.size.map_or(Some(file_bytes), |size| start.checked_add(size as u64));
        let Some(end) = end.filter(|&end| end <= file_bytes) else { return Err(CUT.into()) };
        if header.kind == FourCC::new(b"moov") {
            if end - start > MOST_HEADER_BYTES {
                return Err("its index (moov box) is larger than any video needs".into());
            }
            let mut content = Vec::new();
            file.take(end - start).read_to_end(&mut content).map_err(|e| e.to_string())?;
            return Ok(content);
        }
        at = end;
    }
    Err("there is no index (moov box) near its start".into())
}

fn track(trak: &[u8], movie_timescale: u32, file_bytes: u64) -> Result<Track, String> {
    let mdia = child(trak, b"mdia").ok_or("its video track is empty")?;
    let stbl = child(mdia, b"minf").and_then(|minf| child(minf, b"stbl")).ok_or("its video track has no index")?;
    let header: Tkhd = leaf(trak)?;
    let media: Mdhd = leaf(mdia)?;
    let (kind, content) = description(child(stbl, b"stsd").ok_or("its video track has no codec")?)?;
    let (coded_size, codec) = codec(kind, content)?;
    let Samples { samples, times } = Samples::read(stbl, file_bytes)?;
    let edits: Option<Elst> = child(trak, b"edts").and_then(|edts| optional_leaf(edts).transpose()).transpose()?;
    let edit = edits.map_or(Ok((0, i64::MAX)), |edits| edit(&edits, media.timescale, movie_timescale))?;
    Ok(Track {
        coded_size,
        turn: turn(&header.matrix)?,
        codec,
        hidden: times.iter().filter(|&&time| time < edit.0).count(),
        shown: times.iter().filter(|&&time| (edit.0..edit.1).contains(&time)).count(),
        fps: (media.duration > 0)
            .then(|| samples.len() as f64 * f64::from(media.timescale) / media.duration as f64)
            .filter(|&fps| fps > 0.0),
        samples,
    })
}

/// The only sample description of a track: its four-letter code, and its content.
///
/// [`mp4_atom::Stsd`] would read it, too, but its readers of all codecs take a tenth of this crate's compilation.
fn description(stsd: &[u8]) -> Result<([u8; 4], &[u8]), String> {
    // A version with flags and the number of descriptions stand before them.
    let descriptions: Vec<_> = stsd.get(8..).into_iter().flat_map(children).collect();
    match descriptions[..] {
        [description] => Ok(description),
        _ => Err(format!("its video track has {} codecs", descriptions.len())),
    }
}

/// Size and codec of a sample description.
fn codec(kind: [u8; 4], mut content: &[u8]) -> Result<((u32, u32), Codec), String> {
    let visual = Visual::decode(&mut content).map_err(|e| format!("its box stsd cannot be read ({e})"))?;
    let codec = match &kind {
        b"avc1" | b"avc3" => Codec::H264(h264_setup(content)?),
        b"hev1" | b"hvc1" => Codec::Other("HEVC (H.265)".into()),
        b"vp08" => Codec::Other("VP8".into()),
        b"vp09" => Codec::Other("VP9".into()),
        b"av01" => Codec::Other("AV1".into()),
        b"jpeg" => Codec::Other("Motion JPEG".into()),
        kind => return Err(format!("its codec is unknown here ({})", FourCC::new(kind))),
    };
    Ok(((visual.width.into(), visual.height.into()), codec))
}

/// The setup in the boxes of a sample description.
fn h264_setup(content: &[u8]) -> Result<H264Setup, String> {
    let avcc: Avcc = leaf(content)?;
    let sets = [&avcc.sequence_parameter_sets, &avcc.picture_parameter_sets];
    let colour = match optional_leaf(content)? {
        Some(Colr::Nclx { matrix_coefficients, full_range_flag, .. }) => Some((matrix_coefficients, full_range_flag)),
        Some(Colr::Nclc { matrix_coefficients, .. }) => Some((matrix_coefficients, false)),
        _ => None,
    };
    let parameter_sets = sets.into_iter().flatten().cloned().collect();
    Ok(H264Setup { parameter_sets, length_size: avcc.length_size, colour })
}

/// The span of media times that is shown.
fn edit(list: &Elst, media_timescale: u32, movie_timescale: u32) -> Result<(i64, i64), String> {
    // An entry without a media time is a pause before the video starts.
    let mut shown = list.entries.iter().filter_map(|entry| entry.media_time.map(|time| (time, entry)));
    let Some((start, entry)) = shown.next() else { return Ok((0, i64::MAX)) };
    if shown.next().is_some() {
        return Err("it is cut together from several pieces by an edit list".into());
    }
    let start = i64::try_from(start).map_err(|_| "its edit list begins beyond all times")?;
    if entry.segment_duration == 0 || movie_timescale == 0 {
        return Ok((start, i64::MAX));
    }
    // Rounded up. Durations are often in milliseconds, and rounding must not cut the last frame.
    let (duration, media) = (u128::from(entry.segment_duration), u128::from(media_timescale));
    let duration = (duration * media).div_ceil(u128::from(movie_timescale));
    Ok((start, start.saturating_add(i64::try_from(duration).unwrap_or(i64::MAX))))
}

/// The rotation in a transformation matrix.
fn turn(matrix: &mp4_atom::Matrix) -> Result<Turn, String> {
    match [matrix.a, matrix.b, matrix.c, matrix.d].map(i32::signum) {
        [1, 0, 0, 1] => Ok(Turn::None),
        [0, 1, -1, 0] => Ok(Turn::Quarter),
        [-1, 0, 0, -1] => Ok(Turn::Half),
        [0, -1, 1, 0] => Ok(Turn::ThreeQuarters),
        _ => Err("its header asks for frames that are mirrored or turned by other than quarter turns".into()),
    }
}
