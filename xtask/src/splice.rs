//! Text that a chore writes into a page, between two lines that mark its place.

/// The page with `body` between its marks, or `None` where it lacks them.
pub fn splice(page: &str, start: &str, end: &str, body: &str) -> Option<String> {
    let (before, rest) = page.split_once(start)?;
    let (_, after) = rest.split_once(end)?;
    Some(format!("{before}{start}\n{body}{end}{after}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_stands_between_the_marks_is_replaced() {
        let page = "# Page\n\n<a>\nold\n<b>\nMore.\n";
        assert_eq!(splice(page, "<a>", "<b>", "new\n").as_deref(), Some("# Page\n\n<a>\nnew\n<b>\nMore.\n"));
        assert_eq!(splice(page, "<a>", "<c>", "new\n"), None);
    }
}
