//! Completeness check for JPEG files, from their markers (ITU-T T.81, annex B).

const START_OF_IMAGE: u8 = 0xd8;
const END_OF_IMAGE: u8 = 0xd9;

/// Whether the bytes are a JPEG file without the end of its image. The decoder silently fills the missing part with
/// grey. Data after the end is accepted, because phones store more images there. Malformed bytes are left to the
/// decoder.
pub(crate) fn is_broken_off(bytes: &[u8]) -> bool {
    bytes.starts_with(&[0xff, START_OF_IMAGE]) && !reaches_end(&bytes[2..])
}

/// Whether an end marker follows. `rest` are the bytes after the start marker. Only markers between segments count,
/// because a segment may contain a thumbnail with its own end.
fn reaches_end(mut rest: &[u8]) -> bool {
    while let Some((marker, behind)) = next_marker(rest) {
        rest = match marker {
            END_OF_IMAGE => return true,
            // Restarts among the pixels, and other markers without a segment.
            0x01 | 0xd0..=START_OF_IMAGE => behind,
            // A segment starts with its length, which includes these two bytes.
            _ => match behind {
                [high, low, ..] => behind.get(usize::from(u16::from_be_bytes([*high, *low])).max(2)..).unwrap_or(&[]),
                _ => return false,
            },
        };
    }
    false
}

/// The next marker and the bytes after it. Skips pixel data, where 0 follows every 0xff.
fn next_marker(bytes: &[u8]) -> Option<(u8, &[u8])> {
    let at = bytes.windows(2).position(|pair| pair[0] == 0xff && !matches!(pair[1], 0 | 0xff))?;
    Some((bytes[at + 1], &bytes[at + 2..]))
}

#[cfg(test)]
mod tests {
    use image::{ExtendedColorType, RgbImage};

    use super::*;

    fn photo() -> Vec<u8> {
        let image = RgbImage::from_fn(64, 48, |x, y| image::Rgb([(x * y) as u8, (37 * x) as u8, (11 * y) as u8]));
        let mut bytes = Vec::new();
        image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, 95)
            .encode(image.as_raw(), 64, 48, ExtendedColorType::Rgb8)
            .expect("coded");
        bytes
    }

    /// The photo with a small copy of itself in its header, as written by cameras.
    fn with_preview(photo: &[u8]) -> Vec<u8> {
        let length = u16::try_from(photo.len() + 2).expect("a small copy").to_be_bytes();
        [&photo[..2], &[0xff, 0xe1], &length, photo, &photo[2..]].concat()
    }

    #[test]
    fn a_photo_is_whole_and_every_part_of_it_is_not() {
        let photo = photo();
        for photo in [with_preview(&photo), photo] {
            assert!(!is_broken_off(&photo));
            for length in 2..photo.len() {
                assert!(is_broken_off(&photo[..length]), "{length} of {} bytes", photo.len());
            }
        }
    }

    #[test]
    fn what_lies_behind_the_end_does_not_matter() {
        let photo = photo();
        for behind in [&photo[..], &photo[..photo.len() / 2], b"notes of a program", &[0xff, 0xda, 0, 4, 1, 2], &[0xff]]
        {
            assert!(!is_broken_off(&[&photo, behind].concat()), "{behind:?}");
        }
    }

    #[test]
    fn restarts_fill_bytes_and_senseless_lengths_are_passed_over() {
        let pixels = [0xff, 0xda, 0, 2, 7, 0xff, 0, 0xff, 0xd3, 9, 0xff, 0xff, 0xd9];
        assert!(!is_broken_off(&[&[0xff, 0xd8][..], &pixels].concat()));
        assert!(!is_broken_off(&[&[0xff, 0xd8, 0xff, 0xe0, 0, 0][..], &pixels].concat()));
        assert!(is_broken_off(&[0xff, 0xd8, 0xff, 0xe0, 0xff, 0xff, 0xff, 0xd9]));
        assert!(is_broken_off(&[0xff, 0xd8, 0xff, 0xe0, 0]));
        assert!(!is_broken_off(b"no JPEG file"));
    }
}
