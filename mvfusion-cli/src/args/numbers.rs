//! Parsers of numbers on the command line, whose messages have an example.

use std::num::NonZeroUsize;

use bytesize::ByteSize;

/// Parses a number of things of which there is at least one.
pub(super) fn parse_count(text: &str) -> Result<NonZeroUsize, String> {
    text.parse().map_err(|_| "expected a whole number, 1 or more, such as 4".to_owned())
}

/// Parses an amount of memory.
pub(super) fn parse_bytes(text: &str) -> Result<ByteSize, String> {
    text.parse().map_err(|_| "expected a number of bytes, such as 512MB or 2GiB".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_read_or_refused_with_an_example() {
        assert_eq!(parse_count("4").map(usize::from), Ok(4));
        for bad in ["0", "-1", "many", "1.5"] {
            assert!(parse_count(bad).is_err_and(|said| said.ends_with("such as 4")), "{bad}");
        }
        assert_eq!(parse_bytes("2GiB"), Ok(ByteSize::gib(2)));
        assert_eq!(parse_bytes("0"), Ok(ByteSize(0)));
        for bad in ["lots", "-1MB", "3 bananas"] {
            assert!(parse_bytes(bad).is_err_and(|said| said.contains("512MB")), "{bad}");
        }
    }
}
