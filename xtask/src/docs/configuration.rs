//! The keys of the configuration, written from the comments, ranges and defaults of its fields.

use std::fmt::Write as _;

use mvfusion_model::config::{KeyKind, KeyNotes};

use super::tables::cell;

/// A section for each table, with a row for each of its keys; the keys outside every table come first.
pub fn list(notes: &[KeyNotes]) -> String {
    let mut page = String::new();
    write_rows(&mut page, within(notes, ""));
    for table in notes.iter().filter(|notes| is_table(notes)) {
        let level = if table.key.contains('.') { "###" } else { "##" };
        _ = write!(page, "\n{level} `{}`\n{}\n\n", table.key, table.comment);
        write_rows(&mut page, within(notes, &table.key));
    }
    page
}

/// The keys of a table.
fn within<'a>(notes: &'a [KeyNotes], table: &'a str) -> impl Iterator<Item = &'a KeyNotes> {
    notes.iter().filter(move |notes| parent(&notes.key) == table && !is_table(notes))
}

fn parent(key: &str) -> &str {
    key.rsplit_once('.').map_or("", |(parent, _)| parent)
}

fn is_table(notes: &KeyNotes) -> bool {
    matches!(notes.kind, KeyKind::Table)
}

fn write_rows<'a>(page: &mut String, keys: impl Iterator<Item = &'a KeyNotes>) {
    page.push_str("| key | values | default | meaning |\n|---|---|---|---|\n");
    for notes in keys {
        let values = match &notes.kind {
            // The names stand beside their meanings.
            KeyKind::Choice(_) => "a name".to_owned(),
            kind => kind.in_words(),
        };
        let default = notes.default.as_ref().map_or("absent".to_owned(), |default| format!("`{default}`"));
        let mut meaning = vec![notes.comment.replace("\n\n", " ")];
        if let KeyKind::Choice(choices) = &notes.kind {
            meaning.extend(choices.iter().map(|choice| format!("`{}`: {}", choice.name, choice.comment)));
        }
        if let Some(least) = notes.scaled_from {
            let floor =
                if least > 1 { format!(", but not to less than {least}; a shorter one stays") } else { String::new() };
            meaning.push(format!("Scaled by `train.scale`{floor}."));
        }
        let meaning: Vec<String> = meaning.iter().map(|part| escaped(part)).collect();
        _ = writeln!(page, "| `{}` | {values} | {default} | {} |", notes.key, meaning.join("<br>"));
    }
}

/// A comment as the cell of a table.
fn escaped(comment: &str) -> String {
    format!("{}{}", cell(comment), if comment.ends_with('.') { "." } else { "" })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn notes(key: &str, kind: KeyKind) -> KeyNotes {
        let (comment, default) = (format!("Of {key} | here."), Some(2.into()));
        KeyNotes { key: key.to_owned(), comment, kind, default, sources: vec![], source_table: None, scaled_from: None }
    }

    #[test]
    fn a_table_is_a_section_with_a_row_for_each_key() {
        let notes = [notes("seed", KeyKind::Flag), notes("a", KeyKind::Table), notes("a.x", KeyKind::Text)];
        let page = list(&notes);
        assert!(page.starts_with("| key |"), "{page}");
        assert!(
            page.contains("| `seed` | true or false | `2` | Of seed \\| here. |\n\n## `a`\nOf a | here.\n"),
            "{page}"
        );
        assert!(page.ends_with("| `a.x` | a string | `2` | Of a.x \\| here. |\n"), "{page}");
    }
}
