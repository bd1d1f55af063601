//! The sources that a comment names for a default: the paper, another program, a section, a reading, or ourselves.

/// Words by which a comment names a source.
const WORDS: [&str; 11] =
    ["3DGS", "4DGS", "CEM", "DeGauss", "FreeTimeGS", "LLFF", "METHOD", "Ours", "Spacetime", "paper", "supplement"];

/// What a comment says of sources: whole sentences, or the parentheses of a sentence that names none outside them.
pub(super) fn sources(comment: &str) -> Vec<&str> {
    let mut found = Vec::new();
    for sentence in sentences(comment) {
        let (outside, inside) = parentheses(sentence);
        match outside.into_iter().any(names_a_source) {
            true => found.push(sentence),
            false => found.extend(inside.into_iter().filter(|text| names_a_source(text))),
        }
    }
    found
}

/// Whether a text names a source, such as `DeGauss` or the reading `A9c`.
fn names_a_source(text: &str) -> bool {
    let is_reading = |word: &str| {
        let number =
            word.strip_prefix('A').unwrap_or_default().trim_end_matches(|letter: char| letter.is_ascii_lowercase());
        !number.is_empty() && number.bytes().all(|byte| byte.is_ascii_digit())
    };
    let known = |word: &str| WORDS.iter().any(|known| known.eq_ignore_ascii_case(word)) || is_reading(word);
    text.split(|letter: char| !letter.is_alphanumeric()).any(known)
}

/// The sentences of a text. A full stop within parentheses or a word ends none.
fn sentences(text: &str) -> Vec<&str> {
    let (mut depth, mut start, mut found) = (0_usize, 0, Vec::new());
    for (place, letter) in text.char_indices() {
        match letter {
            '(' => depth += 1,
            ')' => depth = depth.saturating_sub(1),
            '.' if depth == 0 && text[place + 1..].chars().next().is_none_or(char::is_whitespace) => {
                found.push(text[start..place].trim());
                start = place + 1;
            }
            _ => {}
        }
    }
    found.push(text[start..].trim());
    found.retain(|sentence| !sentence.is_empty());
    found
}

/// The parts of a sentence outside its parentheses, and the texts within them.
fn parentheses(sentence: &str) -> (Vec<&str>, Vec<&str>) {
    let (mut depth, mut start, mut outside, mut inside) = (0_usize, 0, Vec::new(), Vec::new());
    for (place, letter) in sentence.char_indices() {
        match (letter, depth) {
            ('(', 0) => {
                (depth, start) = (1, {
                    outside.push(&sentence[start..place]);
                    place + 1
                })
            }
            ('(', _) => depth += 1,
            (')', 1) => {
                (depth, start) = (0, {
                    inside.push(&sentence[start..place]);
                    place + 1
                })
            }
            (')', _) => depth = depth.saturating_sub(1),
            _ => {}
        }
    }
    outside.push(&sentence[start..]);
    (outside, inside)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_source_is_a_sentence_or_what_stands_in_parentheses() {
        let comment = "Views per step (DeGauss: 2 for video, 4 for photos). Not a source (nothing). Ours: a reason.";
        assert_eq!(sources(comment), ["DeGauss: 2 for video, 4 for photos", "Ours: a reason"]);
        assert_eq!(sources("Half window, `w` (A7, A8). In 0.5 s. The Apaper."), ["A7, A8"]);
        assert_eq!(sources("DeGauss: a hundredth (f(x)) of `rate`."), ["DeGauss: a hundredth (f(x)) of `rate`"]);
        assert!(sources("Number of checkpoints. At least 1.").is_empty());
    }
}
