//! The numbers at the end of the names of frames. Frames of several cameras with the same number show the same moment.

use std::cmp::Ordering;
use std::collections::BTreeSet;
use std::fmt;
use std::path::Path;

use crate::error::DataError;

/// The number at the end of a name, as it is written: `0003`. It may have any number of digits, and is compared by its
/// value.
#[derive(Clone, Debug)]
pub(crate) struct FrameNumber(String);

impl FrameNumber {
    /// The text before the number of a name, and the number; `None` if the name does not end in one.
    pub(crate) fn split(name: &str) -> (&str, Option<Self>) {
        let text = name.trim_end_matches(|c: char| c.is_ascii_digit());
        let digits = &name[text.len()..];
        (text, (!digits.is_empty()).then(|| Self(digits.to_owned())))
    }

    /// The next number, written with as many digits; `None` for numbers beyond 64 bits.
    pub(crate) fn next(&self) -> Option<Self> {
        let value = self.0.parse::<u64>().ok()?.checked_add(1)?;
        Some(Self(format!("{value:0width$}", width = self.0.len())))
    }

    /// What orders numbers by their value: the number of digits, then the digits.
    fn key(&self) -> (usize, &str) {
        let digits = self.0.trim_start_matches('0');
        (digits.len(), digits)
    }
}

impl fmt::Display for FrameNumber {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl PartialEq for FrameNumber {
    fn eq(&self, other: &Self) -> bool {
        self.key() == other.key()
    }
}

impl Eq for FrameNumber {}

impl PartialOrd for FrameNumber {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for FrameNumber {
    fn cmp(&self, other: &Self) -> Ordering {
        self.key().cmp(&other.key())
    }
}

/// The place of each name in temporal order. Numbers are compared by value, so that `frame_9.png` precedes
/// `frame_10.png`; names that do not differ otherwise keep their order.
pub(crate) fn places_in_time<'a>(names: impl Iterator<Item = &'a str>) -> Vec<usize> {
    let keys: Vec<_> = names.map(natural_key).collect();
    let mut order: Vec<usize> = (0..keys.len()).collect();
    order.sort_by(|&a, &b| keys[a].cmp(&keys[b]));
    let mut places = vec![0; order.len()];
    for (place, index) in order.into_iter().enumerate() {
        places[index] = place;
    }
    places
}

/// What orders names: in turn a text, the number of digits of the number after it, and these digits.
fn natural_key(name: &str) -> Vec<(&str, usize, &str)> {
    let mut key = Vec::new();
    let mut rest = name;
    while !rest.is_empty() {
        let (text, tail) = rest.split_at(rest.find(|c: char| c.is_ascii_digit()).unwrap_or(rest.len()));
        let (digits, tail) = tail.split_at(tail.find(|c: char| !c.is_ascii_digit()).unwrap_or(tail.len()));
        let digits = digits.trim_start_matches('0');
        key.push((text, digits.len(), digits));
        rest = tail;
    }
    key
}

/// A list of frames: those of a camera, or of a file of cameras.
#[derive(Clone, Copy, Debug)]
pub(crate) struct NumberedFrames<'a> {
    /// Its name, for messages.
    pub(crate) name: &'a str,
    /// The numbers of all its frames, ascending.
    pub(crate) numbers: &'a [FrameNumber],
}

impl<'a> NumberedFrames<'a> {
    /// The numbers of the first `limit` frames, which are used.
    pub(crate) fn used(&self, limit: usize) -> &'a [FrameNumber] {
        &self.numbers[..self.numbers.len().min(limit)]
    }

    /// The used numbers that another list lacks.
    fn lacking_in(&self, other: &Self, limit: usize) -> Vec<&'a FrameNumber> {
        let known: BTreeSet<&FrameNumber> = other.numbers.iter().collect();
        self.used(limit).iter().filter(|number| !known.contains(number)).collect()
    }
}

/// Checks that the first `limit` frames of two lists have the same numbers. `everywhere` names all lists, for the
/// remedy.
///
/// # Errors
/// [`DataError::Disagreement`] that names the first frame that one list lacks.
pub(crate) fn check_numbers(
    folder: &Path,
    [one, other]: [NumberedFrames<'_>; 2],
    limit: usize,
    everywhere: &str,
) -> Result<(), DataError> {
    if one.used(limit) == other.used(limit) {
        return Ok(());
    }
    let (lacking, lacking_in_one) = (one.lacking_in(&other, limit), other.lacking_in(&one, limit));
    let is_both = !lacking.is_empty() && !lacking_in_one.is_empty();
    let (poor, rich, lacking) = match lacking.first().is_some_and(|a| lacking_in_one.first().is_none_or(|b| a < b)) {
        true => (other, one, lacking),
        false => (one, other, lacking_in_one),
    };
    let Some(&number) = lacking.first() else { return Ok(()) };
    let (more, them, remove) = match lacking.len() - 1 {
        0 => (String::new(), "it", format!("frame {number}")),
        more => (format!(" and lacks {more} more"), "them", "the frames of these numbers".to_owned()),
    };
    let mut advice = format!("Add {them}, or remove {remove} from {everywhere}");
    if rich.numbers.starts_with(poor.numbers) {
        advice += &format!("; or read fewer frames with `--set scene.frames={}`", poor.numbers.len());
    } else if is_both {
        advice += ". Frames of one moment need the same number: if one of the two only counts from another number, \
                   rename its frames";
    }
    Err(DataError::Disagreement {
        folder: folder.to_owned(),
        first: format!("{} has no frame {number}{more}", poor.name),
        second: format!("{} has {them}", rich.name),
        advice,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbers(names: &[&str]) -> Vec<FrameNumber> {
        names.iter().map(|name| FrameNumber::split(name).1.expect("a number")).collect()
    }

    fn compared(one: &[&str], other: &[&str], limit: usize) -> Result<(), String> {
        let (one, other) = (numbers(one), numbers(other));
        let lists =
            [NumberedFrames { name: "cam00", numbers: &one }, NumberedFrames { name: "cam02", numbers: &other }];
        check_numbers(Path::new("scene"), lists, limit, "every camera").map_err(|error| error.to_string())
    }

    #[test]
    fn places_in_time_follow_the_numbers_in_names() {
        let names = ["f_1.png", "f_10.png", "f_9.png", "f_0011_b.png", "f_11.png", "e_12.png", "g.png"];
        assert_eq!(places_in_time(names.into_iter()), [1, 3, 2, 5, 4, 0, 6]);
        assert_eq!(places_in_time(["a", "a"].into_iter()), [0, 1]);
        assert!(places_in_time(std::iter::empty()).is_empty());
    }

    #[test]
    fn numbers_are_compared_by_value_and_shown_as_they_are_written() {
        let sorted = numbers(&["f_0", "f_007", "f_9", "f_10", "f_0011", "f_123456789012345678901234567890"]);
        assert!(sorted.is_sorted() && sorted[1] == numbers(&["7"])[0]);
        assert_eq!((sorted[1].to_string(), sorted[1].next().expect("8").to_string()), ("007".into(), "008".into()));
        assert_eq!(FrameNumber::split("cover"), ("cover", None));
        assert!(sorted[5].next().is_none());
    }

    #[test]
    fn a_missing_frame_is_named_whichever_camera_lacks_it() {
        let said = "scene: cam02 has no frame 0001, but cam00 has it. Add it, or remove frame 0001 from every camera";
        assert_eq!(compared(&["0000", "0001", "0002"], &["0000", "0002"], 9), Err(said.into()));
        let said = compared(&["0000", "0002"], &["0000", "0001", "0002"], 9).expect_err("refused");
        assert!(said.contains("cam00 has no frame 0001, but cam02 has it"), "{said}");
        let said = compared(&["1", "2", "3", "4"], &["1"], 9).expect_err("refused");
        assert!(said.contains("cam02 has no frame 2 and lacks 2 more, but cam00 has them. Add them"), "{said}");
    }

    #[test]
    fn fewer_frames_are_proposed_only_where_the_last_ones_are_missing() {
        let said = compared(&["0", "1", "2"], &["0", "1"], 9).expect_err("refused");
        assert!(said.contains("`--set scene.frames=2`"), "{said}");
        let said = compared(&["0", "1", "3"], &["0", "2", "3"], 9).expect_err("refused");
        assert!(said.contains("cam02 has no frame 1,") && !said.contains("scene.frames"), "{said}");
        assert!(said.contains("rename"), "{said}");
    }

    #[test]
    fn only_frames_that_are_used_matter() {
        assert_eq!(compared(&["0", "1", "2", "4"], &["0", "1", "2", "3"], 3), Ok(()));
        assert!(compared(&["0", "1", "2"], &["0", "2", "3"], 2).is_err());
        // The frame is there, but the other camera would use another one in its place.
        assert!(compared(&["0", "1"], &["0", "1", "2"], 2).is_ok());
    }

    #[test]
    fn gaps_and_offsets_that_all_cameras_share_are_fine() {
        assert_eq!(compared(&["7", "8", "12"], &["frame_0007", "frame_0008", "frame_0012"], 9), Ok(()));
    }
}
