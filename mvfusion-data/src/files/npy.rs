//! Tables of numbers in NumPy files, `.npy` and `.npz`. Headers are not trusted: memory is allocated only for data that
//! fits into the file.

use std::io::{BufReader, Read};
use std::ops::RangeInclusive;
use std::path::Path;

use npyz::{NpyFile, NpyHeader, Order};
use zip::ZipArchive;
use zip::result::ZipError;

use super::open::open_file;

/// The magic bytes of every `.npy` file.
const MAGIC: &[u8; 6] = b"\x93NUMPY";

/// Longest accepted header. A table's header has 118 bytes. A longer one could be nested too deeply for the stack of
/// the recursive parser.
const LONGEST_HEADER: usize = 512;

/// Maximum bytes in memory per byte of a packed file, which could unpack to a thousand times its size. Arrays of points
/// pack to a half or a third of their size.
const MOST_TIMES: u64 = 6;

/// Packed files below this size may unpack as if they had this size. A few hundred equal points pack well.
const LEAST_PACKED: u64 = 1 << 16;

/// Numbers in rows of equal length.
#[derive(Debug, PartialEq)]
pub(crate) struct Table {
    columns: usize,
    /// Row by row.
    values: Vec<f64>,
}

impl Table {
    /// The rows. Their length is one of the requested ones.
    pub(crate) fn rows(&self) -> impl Iterator<Item = &[f64]> {
        self.values.chunks_exact(self.columns)
    }
}

/// The table in an `.npy` file, of single or double precision.
///
/// # Errors
/// If the file cannot be read, or contains no table with a number of columns in `columns`.
pub(crate) fn read_npy(path: &Path, columns: RangeInclusive<usize>) -> Result<Table, String> {
    let file = open_file(path).map_err(|e| e.to_string())?;
    let room = file.metadata().map_err(|e| e.to_string())?.len();
    // Single precision becomes double.
    read_table(BufReader::new(file), columns, room.saturating_mul(2))
}

/// The table `name` in an `.npz` file.
///
/// # Errors
/// Same as [`read_npy`], and if there is no array with this name.
pub(crate) fn read_npz(path: &Path, name: &str, columns: RangeInclusive<usize>) -> Result<Table, String> {
    let file = open_file(path).map_err(|e| e.to_string())?;
    let packed = file.metadata().map_err(|e| e.to_string())?.len();
    let mut archive = ZipArchive::new(BufReader::new(file)).map_err(|e| e.to_string())?;
    let names = archive.file_names().filter_map(Result::ok).take(5).collect::<Vec<_>>().join(", ");
    let entry = archive.by_name(&format!("{name}.npy")).map_err(|error| match error {
        ZipError::FileNotFound => format!("it holds no array `{name}`, but: {names}"),
        error => error.to_string(),
    })?;
    let room = packed.max(LEAST_PACKED).saturating_mul(MOST_TIMES);
    read_table(entry, columns, room).map_err(|reason| format!("its array `{name}` is of no use: {reason}"))
}

/// The table in `reader`, which may use `room` bytes of memory.
fn read_table(mut reader: impl Read, columns: RangeInclusive<usize>, room: u64) -> Result<Table, String> {
    let header = read_header(&mut reader)?;
    let (order, kind) = (header.order(), header.dtype());
    let (rows, width) = match *header.shape() {
        [rows, width] if columns.contains(&(width as usize)) => (rows, width),
        _ => return Err(format!("its shape is {:?}, not [rows, {}]", header.shape(), shown(&columns))),
    };
    let count = u128::from(rows) * u128::from(width);
    if count.saturating_mul(size_of::<f64>() as u128) > u128::from(room) {
        return Err(format!("it announces {rows} rows of {width} numbers, which is too much for its size"));
    }
    let (rows, columns, count) = (rows as usize, width as usize, count as usize);
    let npy = NpyFile::with_header(header, reader);
    let mut values = Vec::with_capacity(count);
    match npy.try_data::<f64>() {
        Ok(data) => data.take(count).try_for_each(|value| value.map(|value| values.push(value))),
        Err(npy) => match npy.try_data::<f32>() {
            Ok(data) => data.take(count).try_for_each(|value| value.map(|value| values.push(f64::from(value)))),
            Err(_) => return Err(format!("its type is {}, not float64 or float32", kind.descr())),
        },
    }
    .map_err(|e| e.to_string())?;
    let values = match order {
        Order::C => values,
        Order::Fortran => (0..rows * columns).map(|at| values[(at % columns) * rows + at / columns]).collect(),
    };
    Ok(Table { columns, values })
}

fn read_header(reader: &mut impl Read) -> Result<NpyHeader, String> {
    // The magic bytes, the version, and the length of the rest in two bytes or, since version 2, four.
    let mut start = [0; 12];
    reader.read_exact(&mut start[..8]).map_err(|e| e.to_string())?;
    if !start.starts_with(MAGIC) {
        return Err("it is no NumPy file".into());
    }
    let end = if start[6] == 1 { 10 } else { 12 };
    reader.read_exact(&mut start[8..end]).map_err(|e| e.to_string())?;
    let length = u32::from_le_bytes([start[8], start[9], start[10], start[11]]) as usize;
    if length > LONGEST_HEADER {
        return Err(format!("its header has {length} bytes, which no table of numbers needs"));
    }
    let mut text = vec![0; length];
    reader.read_exact(&mut text).map_err(|e| e.to_string())?;
    NpyHeader::from_reader(start[..end].chain(&text[..])).map_err(|e| e.to_string())
}

fn shown(columns: &RangeInclusive<usize>) -> String {
    match (columns.start(), columns.end()) {
        (one, other) if one == other => one.to_string(),
        (least, _) => format!("{least} or more"),
    }
}

#[cfg(test)]
mod tests {
    use std::fs::File;
    use std::io::{Cursor, Write};

    use npyz::WriterBuilder;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use zip::ZipWriter;
    use zip::write::SimpleFileOptions;

    use super::*;

    const TABLE: [f64; 6] = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0];

    fn written<T: npyz::AutoSerialize>(shape: &[u64], order: Order, values: Vec<T>) -> Vec<u8> {
        let mut bytes = Vec::new();
        let options = npyz::WriteOptions::new().default_dtype().order(order).shape(shape);
        let mut writer = options.writer(&mut bytes).begin_nd().expect("npy");
        writer.extend(values).expect("written");
        writer.finish().expect("written");
        bytes
    }

    fn read(bytes: &[u8], columns: RangeInclusive<usize>) -> Result<Table, String> {
        read_table(bytes, columns, 2 * bytes.len() as u64)
    }

    #[test]
    fn a_table_is_read_whatever_its_precision_and_order() {
        let expected = Table { columns: 3, values: TABLE.to_vec() };
        assert_eq!(read(&written(&[2, 3], Order::C, TABLE.to_vec()), 3..=3).expect("read"), expected);
        assert_eq!(read(&written(&[2, 3], Order::C, TABLE.map(|v| v as f32).to_vec()), 3..=9).expect("read"), expected);
        let turned = vec![1.0, 4.0, 2.0, 5.0, 3.0, 6.0];
        let table = read(&written(&[2, 3], Order::Fortran, turned), 3..=3).expect("read");
        assert_eq!(table.rows().collect::<Vec<_>>(), [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]);
        assert_eq!(read(&written::<f64>(&[0, 3], Order::C, vec![]), 3..=3).expect("read").rows().count(), 0);
    }

    #[test]
    fn what_is_no_such_table_is_refused() {
        let whole = written(&[2, 3], Order::C, TABLE.to_vec());
        for (bytes, part) in [
            (written(&[3, 2], Order::C, TABLE.to_vec()), "its shape is [3, 2], not [rows, 3]"),
            (written(&[6], Order::C, TABLE.to_vec()), "its shape is [6]"),
            (written(&[2, 3], Order::C, vec![1i32; 6]), "float64 or float32"),
            (b"no array at all".to_vec(), "no NumPy file"),
            (whole[..7].to_vec(), ""),
            (whole[..40].to_vec(), ""),
            (whole[..whole.len() - 1].to_vec(), ""),
        ] {
            let reason = read(&bytes, 3..=3).expect_err(part);
            assert!(reason.contains(part), "{reason}");
        }
    }

    #[test]
    fn headers_that_lie_are_not_believed() {
        let head =
            |text: String| [&b"\x93NUMPY\x01\x00"[..], &(text.len() as u16).to_le_bytes(), text.as_bytes()].concat();
        let shaped = |shape: &str| head(format!("{{'descr': '<f8', 'fortran_order': False, 'shape': ({shape}), }}\n"));
        for shape in ["1000000000000, 3", "6148914691236517206, 3", "18446744073709551615, 3"] {
            let reason = read(&shaped(shape), 3..=3).expect_err(shape);
            assert!(reason.contains("announces"), "{reason}");
        }
        let largest = "18446744073709551615, 18446744073709551615";
        assert!(read(&shaped(largest), 6..=usize::MAX).expect_err(largest).contains("announces"));
        assert!(read(&shaped("-1, 3"), 3..=3).is_err());
        assert!(read(&shaped("1, 3"), 3..=3).is_err());
        assert!(read(&head("(".repeat(LONGEST_HEADER)), 3..=3).is_err());
        assert!(read(&head("(".repeat(60_000)), 3..=3).expect_err("long").contains("60000 bytes"));
        let endless = [&b"\x93NUMPY\x02\x00"[..], &u32::MAX.to_le_bytes()].concat();
        assert!(read(&endless, 3..=3).expect_err("long").contains("4294967295 bytes"));
    }

    #[test]
    fn a_table_is_found_in_an_archive_by_name() {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("points.npz");
        let mut archive = ZipWriter::new(File::create(&path).expect("file"));
        archive.start_file("data.npy", SimpleFileOptions::default()).expect("entry");
        archive.write_all(&written(&[2, 3], Order::C, TABLE.to_vec())).expect("written");
        archive.start_file("seg.npy", SimpleFileOptions::default()).expect("entry");
        archive.finish().expect("written");
        assert_eq!(read_npz(&path, "data", 3..=3).expect("read").values, TABLE);
        assert!(read_npz(&path, "data", 7..=7).expect_err("shape").contains("`data`"));
        assert!(read_npz(&path, "seg", 3..=3).is_err());
        let reason = read_npz(&path, "points", 3..=3).expect_err("name");
        assert!(reason.contains("no array `points`, but: data.npy, seg.npy"), "{reason}");
        std::fs::write(&path, "no archive").expect("written");
        assert!(read_npz(&path, "data", 3..=3).is_err());
    }

    #[test]
    fn an_archive_may_not_unpack_to_many_times_its_size() {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("bomb.npz");
        let mut archive = ZipWriter::new(File::create(&path).expect("file"));
        archive.start_file("data.npy", SimpleFileOptions::default()).expect("entry");
        archive.write_all(&written(&[100_000, 7], Order::C, vec![0.0f64; 700_000])).expect("written");
        archive.finish().expect("written");
        let reason = read_npz(&path, "data", 6..=9).expect_err("refused");
        assert!(reason.contains("announces 100000 rows of 7 numbers"), "{reason}");
    }

    #[test]
    fn damaged_files_never_panic() {
        /// Damaged files of each kind; some thousand reach every branch of the parsers.
        const ROUNDS: usize = 1500;
        let table = written(&[2, 3], Order::C, TABLE.to_vec());
        let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
        archive.start_file("data.npy", SimpleFileOptions::default()).expect("entry");
        archive.write_all(&table).expect("written");
        let archive = archive.finish().expect("written").into_inner();
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("points");
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let mut taken = 0;
        for round in 0..ROUNDS {
            let mut file = if round % 2 == 0 { table.clone() } else { archive.clone() };
            for _ in 0..random.random_range(1..4) {
                let place = random.random_range(0..file.len());
                match random.random_range(0..3) {
                    0 => file[place] = random.random(),
                    1 => drop(file.remove(place)),
                    _ => file[place] ^= 1 << random.random_range(0..8),
                }
            }
            std::fs::write(&path, &file).expect("written");
            taken += usize::from(read_npy(&path, 3..=3).is_ok()) + usize::from(read_npz(&path, "data", 3..=3).is_ok());
        }
        assert!(taken > 0 && taken < ROUNDS, "some damage does no harm, other does: {taken}");
    }
}
