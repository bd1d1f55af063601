//! One Markdown file: its links, its anchors, and the faults that show without other files.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use pulldown_cmark::{CodeBlockKind, Event, Options, Parser, Tag, TagEnd};

use super::tables;

/// What the checks need of a Markdown file.
#[derive(Debug, Default)]
pub struct Document {
    /// What `#anchor` may name: headings as GitHub spells them, and the `id` and `name` of HTML.
    pub anchors: BTreeSet<String>,
    /// Links and pictures, of Markdown and of HTML.
    pub links: Vec<Link>,
    /// Lines and messages.
    pub faults: Vec<(usize, String)>,
}

/// A link or a picture.
#[derive(Debug)]
pub struct Link {
    pub line: usize,
    /// As it stands in the file.
    pub target: String,
    pub kind: LinkKind,
}

/// Whether a link is followed or shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LinkKind {
    Link,
    Picture,
}

impl Document {
    /// Reads the dialect that GitHub shows.
    pub fn parse(text: &str) -> Self {
        let mut document = Self::default();
        let mut heading: Option<String> = None;
        let mut uses = BTreeMap::new();
        let options = Options::ENABLE_TABLES | Options::ENABLE_FOOTNOTES | Options::ENABLE_STRIKETHROUGH;
        for (event, range) in Parser::new_ext(text, options).into_offset_iter() {
            match event {
                Event::Start(Tag::Heading { .. }) => heading = Some(String::new()),
                Event::End(TagEnd::Heading(_)) => {
                    document.anchors.extend(heading.take().map(|words| numbered(slug(&words), &mut uses)));
                }
                Event::Text(words) | Event::Code(words) => {
                    if let Some(heading) = &mut heading {
                        heading.push_str(&words);
                    }
                }
                Event::Start(Tag::CodeBlock(CodeBlockKind::Fenced(_))) => document.fence(text, range),
                Event::Start(Tag::Table(columns)) => document.table(text, range, columns.len()),
                Event::Start(Tag::Paragraph) => document.paragraph(text, range),
                Event::Start(Tag::Link { dest_url, .. }) => document.link(text, range, &dest_url, LinkKind::Link),
                Event::Start(Tag::Image { dest_url, .. }) => document.link(text, range, &dest_url, LinkKind::Picture),
                Event::Html(code) | Event::InlineHtml(code) => document.html(text, range, &code),
                _ => {}
            }
        }
        document
    }

    fn link(&mut self, text: &str, range: Range<usize>, target: &str, kind: LinkKind) {
        self.links.push(Link { line: line_at(text, range.start), target: target.to_owned(), kind });
    }

    fn html(&mut self, text: &str, range: Range<usize>, code: &str) {
        if code.trim_start().starts_with("<!--") {
            return;
        }
        for name in ["id", "name"] {
            self.anchors.extend(attributes(code, name).map(str::to_owned));
        }
        for (name, kind) in [("href", LinkKind::Link), ("src", LinkKind::Picture)] {
            for target in attributes(code, name) {
                self.link(text, range.clone(), target, kind);
            }
        }
    }

    /// A fence that does not end before its file does, or holds a line that opens one: there, an end is missing.
    fn fence(&mut self, text: &str, range: Range<usize>) {
        let first = line_at(text, range.start);
        let mut lines = text[range].lines().map(bare).enumerate();
        let Some((_, opening)) = lines.next() else { return };
        let (mark, length) = run(opening);
        let mut closed = false;
        for (offset, line) in lines {
            let (other, other_length) = run(line);
            if other != mark || other_length < length {
                continue;
            }
            closed = line.len() == other_length;
            // Backticks further on make it a line of code in backticks.
            if !closed && !line[other_length..].contains('`') {
                self.faults.push((
                    first + offset,
                    format!(
                        "`{line}` opens a fence inside the one of line {first}: close that before, or make it longer"
                    ),
                ));
            }
        }
        if !closed {
            let end: String = std::iter::repeat_n(mark, length).collect();
            self.faults.push((first, format!("the fence does not close: add a line `{end}` after its last line")));
        }
    }

    /// A row with more or fewer cells than the header, which is shown cut off or with empty cells.
    fn table(&mut self, text: &str, range: Range<usize>, columns: usize) {
        let first = line_at(text, range.start);
        for (offset, row) in text[range].lines().map(bare).enumerate() {
            let cells = tables::cells(row);
            if cells != columns {
                let message = match row.contains('|') {
                    true => format!(
                        "the row has {cells} cells and the header {columns}: add or remove `|`, and write `\\|` within a cell"
                    ),
                    false => "the text becomes a row of the table above: put an empty line before it".to_owned(),
                };
                self.faults.push((first + offset, message));
            }
        }
    }

    /// A paragraph that was meant as a table, but whose header has not the cells of the line under it.
    fn paragraph(&mut self, text: &str, range: Range<usize>) {
        let first = line_at(text, range.start);
        let lines: Vec<_> = text[range].lines().map(bare).collect();
        for (offset, pair) in lines.windows(2).enumerate() {
            if tables::is_delimiter(pair[1]) {
                let (header, line) = (tables::cells(pair[0]), tables::cells(pair[1]));
                let message = match header == line {
                    true => "the table starts within a paragraph: put an empty line before it".to_owned(),
                    false => format!(
                        "no table is shown, for the header has {header} cells and the line under it {line}: make them equal"
                    ),
                };
                self.faults.push((first + offset, message));
            }
        }
    }
}

/// GitHub's anchor of a heading: lower case, without punctuation, with `-` for spaces.
pub fn slug(heading: &str) -> String {
    let kept = |c: char| c.is_alphanumeric() || matches!(c, '_' | '-' | ' ');
    let words: String = heading.trim().to_lowercase().chars().filter(|&c| kept(c)).collect();
    words.replace(' ', "-")
}

/// The second heading of a slug has `-1` behind it, and so on.
fn numbered(slug: String, uses: &mut BTreeMap<String, usize>) -> String {
    let before = uses.entry(slug.clone()).or_default();
    *before += 1;
    match *before {
        1 => slug,
        count => format!("{slug}-{}", count - 1),
    }
}

/// The values of `name="…"` in a piece of HTML.
fn attributes<'a>(code: &'a str, name: &str) -> impl Iterator<Item = &'a str> {
    let start = format!(" {name}=\"");
    code.match_indices(&start)
        .map(|(at, start)| &code[at + start.len()..])
        .filter_map(|rest| rest.split_once('"').map(|(value, _)| value))
        .collect::<Vec<_>>()
        .into_iter()
}

/// A line without indentation and without the marks of a quotation.
fn bare(line: &str) -> &str {
    line.trim_start_matches([' ', '\t', '>']).trim_end()
}

/// The mark of a fence, and how often it stands at the start of a line: at least three times, or it is none.
fn run(line: &str) -> (char, usize) {
    let mark = line.chars().next().unwrap_or(' ');
    let length = line.chars().take_while(|&c| c == mark).count();
    if matches!(mark, '`' | '~') && length >= 3 { (mark, length) } else { (' ', 0) }
}

fn line_at(text: &str, offset: usize) -> usize {
    1 + text[..offset].matches('\n').count()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn assert_fault(text: &str, line: usize, expected: &str) {
        let faults = Document::parse(text).faults;
        assert_eq!(faults.len(), 1, "{faults:?}");
        assert_eq!(faults[0].0, line, "{faults:?}");
        assert!(faults[0].1.contains(expected), "{faults:?}");
    }

    #[test]
    fn sound_fences_and_tables_pass() {
        let text = "# A\n```sh\nls\n```\n\n````\n```toml\na = 1\n```\n````\n\n1. list\n   ~~~\n   ```\n   ~~~\n\n> ```\n> a\n> ```\n\n\
                    | a | b |\n|---|---|\n| 1 | `x\\|y` |\n\n    a | b |\n    |---|\n";
        assert_eq!(Document::parse(text).faults, []);
    }

    #[test]
    fn a_fence_that_does_not_close_is_found() {
        assert_fault("text\n\n```sh\nls\n", 3, "the fence does not close: add a line ```");
        assert_fault("````\nls\n```\n", 1, "add a line ````");
        assert_fault("- item\n  ```\n  ls\n\ntext\n", 2, "does not close");
        assert_fault("```", 1, "does not close");
    }

    #[test]
    fn a_fence_that_opens_inside_another_is_found() {
        assert_fault("```sh\nls\n\n```toml\na = 1\n```\n", 4, "inside the one of line 1");
    }

    #[test]
    fn a_row_of_another_width_than_the_header_is_found() {
        assert_fault("| a | b |\n|---|---|\n| 1 | 2 |\n| 1 |\n", 4, "the row has 1 cells and the header 2");
        assert_fault("| a | b |\n|---|---|\n| 1 | `x|y` |\n", 3, "the row has 3 cells and the header 2");
        assert_fault("> | a | b |\n> |---|---|\n> | 1 |\n", 3, "the row has 1 cells");
    }

    #[test]
    fn text_that_follows_a_table_at_once_is_found() {
        assert_fault("| a | b |\n|---|---|\n| 1 | 2 |\nText.\n", 4, "becomes a row of the table");
    }

    #[test]
    fn a_table_that_is_none_is_found() {
        assert_fault("| a | b | c |\n|---|---|\n| 1 | 2 |\n", 1, "the header has 3 cells and the line under it 2");
    }

    #[test]
    fn anchors_are_spelt_as_on_github() {
        let text = "# The `--set` layers, in §4.7!\n## Größe & Maß\n## a_b-c\n## a_b-c\nSetext [link](x.md)\n---\n<a id=\"own\"></a>\n";
        let anchors = Document::parse(text).anchors;
        let expected = ["a_b-c", "a_b-c-1", "größe--maß", "own", "setext-link", "the---set-layers-in-47"];
        assert_eq!(anchors.into_iter().collect::<Vec<_>>(), expected);
    }

    #[test]
    fn headings_in_code_are_no_anchors() {
        assert!(Document::parse("```\n# A comment\n```\n").anchors.is_empty());
    }
}
