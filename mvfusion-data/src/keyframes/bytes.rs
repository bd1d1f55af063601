//! Integers as compressed bytes, and back.
//!
//! Each column of each track is stored Gaussian by Gaussian, its keyframes in order. A number is stored as the
//! difference to the keyframe before. At the first keyframe, it is stored as it is, or as the difference to the
//! Gaussian before if the quantity is smooth in space. Differences `d` become `2 d` if they are not negative and
//! `-2 d - 1` otherwise, so that small ones have small numbers. All lowest bytes of a column come first, then all
//! second bytes, and so on. The result is a zlib stream.

use std::io::{Read, Write};

use flate2::Compression;
use flate2::read::ZlibDecoder;
use flate2::write::ZlibEncoder;

use super::layout::{BranchLayout, DecodeError, TrackLayout};
use super::{Keyframes, Track, UniformQuantizer};

/// The bytes of branches, one after the other, and their descriptions.
///
/// # Errors
/// If compressing fails.
pub fn encode(branches: &[&Keyframes]) -> std::io::Result<(Vec<BranchLayout>, Vec<u8>)> {
    let mut stream = ZlibEncoder::new(Vec::new(), Compression::default());
    let mut layouts = Vec::new();
    for branch in branches {
        let mut tracks = Vec::new();
        for track in &branch.tracks {
            let numbers: Vec<Vec<u32>> = track.columns.iter().map(|c| differences(track, c, branch.count)).collect();
            let largest = numbers.iter().flatten().max().copied().unwrap_or(0);
            let bytes = (u32::BITS - largest.leading_zeros()).div_ceil(8).max(1) as usize;
            for column in &numbers {
                for place in 0..bytes {
                    let plane: Vec<u8> = column.iter().map(|number| (number >> (8 * place)) as u8).collect();
                    stream.write_all(&plane)?;
                }
            }
            tracks.push(TrackLayout {
                name: track.quantity,
                columns: track.columns.len(),
                keyframes: if track.quantity.moves() { branch.times.len() } else { 1 },
                offset: track.quantizer.offset,
                step: track.quantizer.step,
                bytes,
                chained: track.quantity.is_smooth_in_space(),
            });
        }
        let (count, sh_degree, times) = (branch.count, branch.sh_degree, branch.times.clone());
        layouts.push(BranchLayout { count, sh_degree, times, tracks });
    }
    Ok((layouts, stream.finish()?))
}

/// The differences of a column, Gaussian by Gaussian, none of them negative any more.
fn differences(track: &Track, column: &[i32], count: usize) -> Vec<u32> {
    let keyframes = column.len() / count.max(1);
    let mut numbers = Vec::with_capacity(column.len());
    for row in 0..count {
        let mut before = if track.quantity.is_smooth_in_space() && row > 0 { column[row - 1] } else { 0 };
        for k in 0..keyframes {
            let value = column[k * count + row];
            let difference = value - before;
            numbers.push(((difference << 1) ^ (difference >> 31)) as u32);
            before = value;
        }
    }
    numbers
}

/// The branches of [`encode`].
///
/// # Errors
/// If the bytes are damaged or do not belong to the descriptions.
pub fn decode(layouts: &[BranchLayout], bytes: &[u8]) -> Result<Vec<Keyframes>, DecodeError> {
    let mut needed = 0usize;
    for layout in layouts {
        needed = needed.checked_add(layout.size()?).ok_or_else(DecodeError::too_large)?;
    }
    let mut planes = Vec::new();
    // A short stream may have any length when it is unpacked.
    ZlibDecoder::new(bytes).take((needed as u64).saturating_add(1)).read_to_end(&mut planes)?;
    if planes.len() != needed {
        return Err(DecodeError::Length { needed });
    }
    let mut rest = planes.as_slice();
    let mut branches = Vec::new();
    for layout in layouts {
        let mut tracks = Vec::new();
        for track in &layout.tracks {
            let (own, after) = rest.split_at(track.columns * track.bytes * track.keyframes * layout.count);
            rest = after;
            let width = track.bytes * track.keyframes * layout.count;
            let columns = (0..track.columns).map(|c| column(track, &own[c * width..][..width], layout.count)).collect();
            tracks.push(Track {
                quantity: track.name,
                quantizer: UniformQuantizer { offset: track.offset, step: track.step },
                columns,
            });
        }
        let (count, sh_degree, times) = (layout.count, layout.sh_degree, layout.times.clone());
        branches.push(Keyframes { count, sh_degree, times, tracks });
    }
    Ok(branches)
}

/// A column from its bytes.
fn column(track: &TrackLayout, planes: &[u8], count: usize) -> Vec<i32> {
    let numbers = track.keyframes * count;
    let mut column = vec![0i32; numbers];
    let mut first = 0;
    for row in 0..count {
        let mut value: i32 = if track.chained { first } else { 0 };
        for k in 0..track.keyframes {
            let place = row * track.keyframes + k;
            let byte = |byte: usize| u32::from(planes[byte * numbers + place]) << (8 * byte);
            let number: u32 = (0..track.bytes).map(byte).sum();
            value = value.wrapping_add(((number >> 1) as i32) ^ -((number & 1) as i32));
            column[k * count + row] = value;
            if k == 0 {
                first = value;
            }
        }
    }
    column
}
