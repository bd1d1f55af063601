//! Decoding of H.264 with the built-in decoder.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use h264_reader::nal::sps::{ChromaFormat, FrameMbsFlags, SeqParameterSet};
use h264_reader::rbsp::{BitReader, decode_nal};
use image::{RgbImage, imageops};
use openh264::OpenH264API;
use openh264::decoder::{DecodedYUV, Decoder, DecoderConfig, Flush};

use super::colour::Colours;
use super::flaw::{CHECK_FILE, EXTRACT, Flaw};
use super::mp4::{Codec, H264Setup, Track, Turn};
use super::samples::Sample;
use crate::files::open_file;

/// Maximum bytes of a coded frame. Uncompressed frames of 8 megapixels have 12 MB.
const MOST_SAMPLE_BYTES: u32 = 1 << 26;
const START_CODE: [u8; 4] = [0, 0, 0, 1];
/// Types of units that are needed for decoding: slices, slices of key frames, sequence and picture parameter sets.
/// Others are metadata, or layers that the decoder would misinterpret.
const KINDS: [u8; 4] = [1, 5, 7, 8];

/// Colours of a track, or the reason why it cannot be decoded here.
pub(super) fn colours(setup: &H264Setup) -> Result<Colours, String> {
    let is_sequence = |set: &&Vec<u8>| set.first().is_some_and(|byte| byte & 0x1f == 7);
    let Some(set) = setup.parameter_sets.iter().find(is_sequence) else {
        return Err("its H.264 parameters are not in the header".into());
    };
    let broken = |e: &dyn std::fmt::Debug| format!("its H.264 parameters cannot be read ({e:?})");
    let bits = decode_nal(set).map_err(|e| broken(&e))?;
    let sequence = SeqParameterSet::from_bits(BitReader::new(&bits[..])).map_err(|e| broken(&e))?;
    let chroma = &sequence.chroma_info;
    if chroma.chroma_format != ChromaFormat::YUV420 || chroma.bit_depth_luma_minus8 + chroma.bit_depth_chroma_minus8 > 0
    {
        let bits = 8 + chroma.bit_depth_luma_minus8.max(chroma.bit_depth_chroma_minus8);
        let format = chroma.chroma_format;
        return Err(format!(
            "it is H.264 with {bits} bits and {format:?}, and the built-in decoder knows 8 and YUV420"
        ));
    }
    if let FrameMbsFlags::Fields { .. } = sequence.frame_mbs_flags {
        return Err("it is interlaced, which the built-in decoder does not know".into());
    }
    let signal = sequence.vui_parameters.and_then(|vui| vui.video_signal_type);
    let (matrix, full_range) = setup.colour.unwrap_or((2, false));
    let described = signal.as_ref().and_then(|signal| signal.colour_description.as_ref());
    Ok(Colours::new(
        described.map_or(matrix, |colours| colours.matrix_coefficients.into()),
        signal.as_ref().map_or(full_range, |signal| signal.video_full_range_flag),
    ))
}

/// Passes the first `wanted` visible frames to `sink`, in display order and upright.
pub(super) fn decode(
    path: &Path,
    track: &Track,
    wanted: usize,
    sink: &mut dyn FnMut(RgbImage) -> Result<(), Flaw>,
) -> Result<(), Flaw> {
    let Codec::H264(setup) = &track.codec else { return Err(Flaw::new(path, "it is not H.264", EXTRACT)) };
    let colours = colours(setup).map_err(|reason| Flaw::new(path, reason, EXTRACT))?;
    let broken = |e: &dyn std::fmt::Display| Flaw::new(path, format!("the decoder for H.264 stops ({e})"), EXTRACT);
    // Flushing after each frame would give frames in decoding order.
    let config = DecoderConfig::new().flush_after_decode(Flush::NoFlush);
    let mut decoder = Decoder::with_api_config(OpenH264API::from_source(), config).map_err(|e| broken(&e))?;
    let mut file = open_file(path).map_err(|e| Flaw::new(path, e, CHECK_FILE))?;
    let mut decoded = 0;
    let mut pass_on = |frame: &DecodedYUV| {
        decoded += 1;
        if decoded > track.hidden && decoded <= track.hidden + wanted {
            sink(upright(colours.convert(frame), track.turn))?;
        }
        Ok(decoded >= track.hidden + wanted)
    };

    let header: Vec<u8> = setup.parameter_sets.iter().flat_map(|set| [&START_CODE[..], set].concat()).collect();
    decoder.decode(&header).map_err(|e| broken(&e))?;
    for (index, sample) in track.samples.iter().enumerate() {
        let unreadable = |reason: String| Flaw::new(path, format!("coded frame {index}: {reason}"), CHECK_FILE);
        let bytes = read(&mut file, *sample).map_err(unreadable)?;
        let units = with_start_codes(&bytes, setup.length_size.into()).map_err(unreadable)?;
        if units.is_empty() {
            continue;
        }
        let frame = decoder.decode(&units).map_err(|e| broken(&format!("coded frame {index}: {e}")))?;
        if let Some(frame) = frame
            && pass_on(&frame)?
        {
            return Ok(());
        }
    }
    for frame in decoder.flush_remaining().map_err(|e| broken(&e))? {
        pass_on(&frame)?;
    }
    Ok(())
}

fn read(file: &mut File, sample: Sample) -> Result<Vec<u8>, String> {
    if sample.bytes > MOST_SAMPLE_BYTES {
        return Err(format!("it has {} bytes", sample.bytes));
    }
    let mut bytes = vec![0; sample.bytes as usize];
    file.seek(SeekFrom::Start(sample.start)).and_then(|_| file.read_exact(&mut bytes)).map_err(|e| e.to_string())?;
    Ok(bytes)
}

/// Replaces the lengths before the units of a sample with start codes, as the decoder expects.
fn with_start_codes(mut sample: &[u8], length_size: usize) -> Result<Vec<u8>, String> {
    let mut units = Vec::with_capacity(sample.len() + 16);
    while !sample.is_empty() {
        let split = sample.split_at_checked(length_size).and_then(|(length, rest)| {
            let length = length.iter().fold(0usize, |sum, &byte| sum << 8 | usize::from(byte));
            rest.split_at_checked(length)
        });
        let (unit, rest) = split.ok_or("a unit is longer than the frame")?;
        if unit.first().is_some_and(|byte| KINDS.contains(&(byte & 0x1f))) {
            units.extend_from_slice(&START_CODE);
            units.extend_from_slice(unit);
        }
        sample = rest;
    }
    Ok(units)
}

fn upright(frame: RgbImage, turn: Turn) -> RgbImage {
    match turn {
        Turn::None => frame,
        Turn::Quarter => imageops::rotate90(&frame),
        Turn::Half => imageops::rotate180(&frame),
        Turn::ThreeQuarters => imageops::rotate270(&frame),
    }
}
