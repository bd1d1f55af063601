//! The cells of a table's row, as GitHub counts them.

/// A text as it can stand in a cell.
pub fn cell(text: &str) -> String {
    text.trim_end_matches('.').replace('|', "\\|")
}

/// Number of cells of a row. A `|` ends a cell even within backticks, unless it is written `\|`.
pub fn cells(row: &str) -> usize {
    let row = row.trim();
    let row = row.strip_prefix('|').unwrap_or(row);
    let mut count = 1;
    let mut characters = row.chars().peekable();
    while let Some(c) = characters.next() {
        match c {
            '\\' => _ = characters.next(),
            // The last one ends the row.
            '|' if characters.peek().is_some() => count += 1,
            _ => {}
        }
    }
    count
}

/// Whether a line is the one under a table's header: `|---|:---:|`.
pub fn is_delimiter(line: &str) -> bool {
    line.contains('|') && line.contains('-') && line.chars().all(|c| matches!(c, '|' | '-' | ':' | ' '))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_counted_with_and_without_outer_bars() {
        for (row, count) in [("| a | b |", 2), ("a | b", 2), ("| a |", 1), ("| | b | |", 3), ("a", 1)] {
            assert_eq!(cells(row), count, "{row}");
        }
    }

    #[test]
    fn only_an_escaped_bar_stays_in_its_cell() {
        assert_eq!(cells(r"| `splat\|net` | b |"), 2);
        assert_eq!(cells("| `splat|net` | b |"), 3);
        assert_eq!(cells(r"| a \\| b |"), 2);
    }

    #[test]
    fn a_rule_and_text_are_no_line_under_a_header() {
        assert!(is_delimiter("|---|:---:|"));
        assert!(is_delimiter("--- | ---"));
        assert!(!is_delimiter("---"));
        assert!(!is_delimiter("| a - b |"));
    }
}
