//! The purpose and the time of a photo, from its name.

/// The purpose of a photo.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Purpose {
    Test,
    Train,
    Neither,
}

/// Words that define a photo's purpose. The first one found in the file's name decides; within a longer word, as in
/// `extracted`, they mean nothing.
const KEYWORDS: [(&str, Purpose); 3] =
    [("extra", Purpose::Test), ("clutter", Purpose::Train), ("clean", Purpose::Neither)];

/// The purpose that a file's name defines, and the text after the word that defines it.
pub(super) fn purpose(name: &str) -> Option<(&str, Purpose)> {
    let file = name.rsplit('/').next().unwrap_or(name);
    let tail_of = |word: &str| {
        let mut tails = file.match_indices(word).map(|(start, _)| &file[start + word.len()..]);
        tails.find(|tail| !tail.starts_with(|c: char| c.is_alphabetic()))
    };
    KEYWORDS.into_iter().find_map(|(word, purpose)| tail_of(word).map(|tail| (tail, purpose)))
}

/// The number right after the word, if it fits into 32 bits.
pub(super) fn number(name: &str) -> Option<u32> {
    let (tail, _) = purpose(name)?;
    let end = tail.find(|c: char| !c.is_ascii_digit()).unwrap_or(tail.len());
    tail[..end].parse().ok()
}
