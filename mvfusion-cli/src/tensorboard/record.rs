//! TFRecord: the frame around each event of a file.
//!
//! | bytes | contents |
//! |---|---|
//! | 8 | the length of the data, little endian |
//! | 4 | masked CRC-32C of the length |
//! | length | the data |
//! | 4 | masked CRC-32C of the data |

use crc::{CRC_32_ISCSI, Crc};

const CRC_32C: Crc<u32> = Crc::<u32>::new(&CRC_32_ISCSI);

/// Added to a checksum, so that a record of records has other checksums than its parts.
const MASK: u32 = 0xa282_ead8;

/// The data in its frame.
pub fn framed(data: &[u8]) -> Vec<u8> {
    let length = (data.len() as u64).to_le_bytes();
    let mut record = Vec::with_capacity(data.len() + 16);
    record.extend(length);
    record.extend(masked_crc(&length));
    record.extend(data);
    record.extend(masked_crc(data));
    record
}

fn masked_crc(data: &[u8]) -> [u8; 4] {
    CRC_32C.checksum(data).rotate_right(15).wrapping_add(MASK).to_le_bytes()
}

/// The data of all whole records at the beginning of a file.
#[cfg(test)]
pub fn whole(mut bytes: &[u8]) -> Vec<Vec<u8>> {
    let mut found = Vec::new();
    while let Some((length, _)) = bytes.split_first_chunk::<8>() {
        let end = 12 + u64::from_le_bytes(*length) as usize;
        let Some(record) = bytes.get(..end + 4) else { break };
        let data = record[12..end].to_vec();
        assert_eq!(record, framed(&data), "a record with a wrong checksum");
        found.push(data);
        bytes = &bytes[end + 4..];
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_checksum_is_that_of_rfc_3720() {
        assert_eq!(CRC_32C.checksum(b"123456789"), 0xe306_9283);
        assert_eq!(CRC_32C.checksum(&[0; 32]), 0x8a91_36aa);
        assert_eq!(CRC_32C.checksum(&[0xff; 32]), 0x62a8_ab43);
    }

    #[test]
    fn a_record_begins_as_in_the_files_of_tensorflow() {
        // Its files begin with a version, whose message has 24 bytes.
        let record = framed(&[0; 24]);
        assert_eq!(record[..12], [0x18, 0, 0, 0, 0, 0, 0, 0, 0xa3, 0x7f, 0x4b, 0x22]);
        assert_eq!(record.len(), 12 + 24 + 4);
        assert_eq!(
            whole(&[&record[..], &record[..39]].concat()),
            [vec![0; 24]],
            "half a record at the end is left out"
        );
    }
}
