//! Files that were changed without their checksum.

use std::fs::{self, File, OpenOptions};
use std::io::{Seek, SeekFrom, Write};

use super::{BYTES, Specimen, config};
use crate::device::flex;
use crate::random::Stream;
use crate::train::{Checkpoint, TrainState, TrainedModel};

/// Changed bytes after the header, and lengths to which the file is cut.
const FLIPS: usize = 5000;
const CUTS: usize = 500;

/// Length of the JSON header with the number before it.
fn head() -> usize {
    8 + u64::from_le_bytes(BYTES[..8].try_into().expect("eight bytes")) as usize
}

#[test]
fn a_changed_byte_is_always_noticed() {
    let specimen = Specimen::new();
    specimen.write(&BYTES);
    let mut file = OpenOptions::new().write(true).open(&specimen.path).expect("opened");
    let mut put = |place: usize, byte: u8| {
        file.seek(SeekFrom::Start(place as u64)).and_then(|_| file.write_all(&[byte])).expect("written");
    };
    let mut stream = Stream::new(7, 0);
    let others: Vec<usize> = (0..FLIPS).map(|_| head() + stream.index(BYTES.len() - head())).collect();
    for place in (0..head()).chain(others) {
        // A byte that differs by anything from 1 to 255.
        put(place, BYTES[place] ^ (1 + stream.index(255) as u8));
        let error = Checkpoint::open(&specimen.path).err();
        let said = error.unwrap_or_else(|| panic!("the change of byte {place} is not noticed")).to_string();
        assert!(said.contains("tried.safetensors"), "{said}");
        put(place, BYTES[place]);
    }
    Checkpoint::open(&specimen.path).expect("the file is whole again");
}

#[test]
fn a_file_that_was_cut_is_always_noticed() {
    let specimen = Specimen::new();
    let path = specimen.write(&BYTES);
    let (mut stream, file) = (Stream::new(8, 0), OpenOptions::new().write(true).open(path).expect("opened"));
    let mut lengths: Vec<usize> = (0..CUTS).map(|_| stream.index(BYTES.len())).chain([0, 1, 7, 8, 9, head()]).collect();
    lengths.sort_unstable_by(|a, b| b.cmp(a));
    for length in lengths {
        file.set_len(length as u64).expect("cut");
        let said = Checkpoint::open(path).expect_err("it is refused").to_string();
        assert!(said.contains("tried.safetensors"), "{said}");
    }
}

#[test]
fn damage_is_told_with_both_checksums() {
    let (specimen, mut bytes) = (Specimen::new(), BYTES.clone());
    *bytes.last_mut().expect("not empty") ^= 1;
    let said = specimen.refusal(&bytes).expect("it is refused");
    let written = String::from_utf8(BYTES[35..99].to_vec()).expect("digits");
    assert!(said.contains(&format!("its SHA-256 was written as {written} and is now ")), "{said}");
}

#[test]
fn more_bytes_than_were_written_are_noticed() {
    let specimen = Specimen::new();
    let said = specimen.refusal(&[BYTES.as_slice(), &[0; 4]].concat()).expect("it is refused");
    assert!(said.contains("damaged"), "{said}");
}

#[test]
fn what_is_read_and_written_again_is_the_same_file() {
    let specimen = Specimen::new();
    let state = TrainState::load(specimen.write(&BYTES), &config(), &flex().autodiff()).expect("it is whole");
    state.save(&specimen.path).expect("saved");
    assert!(fs::read(&specimen.path).expect("read") == *BYTES);
}

#[test]
fn what_is_no_file_is_not_read() {
    let folder = tempfile::tempdir().expect("folder");
    let said = Checkpoint::open(folder.path()).expect_err("it is refused").to_string();
    assert!(said.contains("it is no file"), "{said}");
    let said = Checkpoint::open(&folder.path().join("absent")).expect_err("it is refused").to_string();
    assert!(said.starts_with("cannot read ") && said.contains("absent"), "{said}");
    #[cfg(unix)]
    assert!(Checkpoint::open("/dev/zero".as_ref()).is_err_and(|error| error.to_string().contains("it is no file")));
    // A length beyond all memory is not believed.
    let huge = folder.path().join("huge.safetensors");
    let mut file = File::create(&huge).expect("created");
    file.write_all(&(1u64 << 40).to_le_bytes()).expect("written");
    // Sparse where the file system can: it has no 2 TB.
    if file.set_len(2 << 40).is_ok() {
        let said = Checkpoint::open(&huge).expect_err("it is refused").to_string();
        assert!(said.contains("its header has 1099511627776 bytes"), "{said}");
    }
}

#[test]
fn a_state_with_a_number_that_is_not_finite_does_not_replace_one_without() {
    let specimen = Specimen::new();
    let device = flex().autodiff();
    let mut state = TrainState::load(specimen.write(&BYTES), &config(), &device).expect("it is whole");
    state.dynamic.statistics.seen = state.dynamic.statistics.seen.clone() / 0.0;
    let said = state.save(&specimen.path).expect_err("it is refused").to_string();
    assert!(said.contains("of `statistics.dynamic.seen` is not finite"), "{said}");
    TrainedModel::load(&specimen.path, &config(), &flex()).expect("the old file is whole");
}
