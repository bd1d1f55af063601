//! `table.md`: the table for people, as GitHub shows it.

use std::ops::Range;

use super::{Column, Entry, Row, Table};

/// Columns that one table can have; more than these do not fit beside one another.
const WIDE: usize = 12;

impl Table {
    /// The table in Markdown, its columns aligned for those who read the file as it is. A table with many columns is
    /// split by their groups.
    pub fn markdown(&self) -> String {
        let mut text = format!("# {}\n\n", escaped(&self.title));
        if !self.about.is_empty() {
            text += &format!("{}\n\n", escaped(self.about.trim()));
        }
        text += &self.markdown_tables();
        text += &self.markdown_verdicts();
        let notes = self.notes();
        if !notes.is_empty() {
            text.push('\n');
            text.extend(notes.iter().map(|note| format!("- {}\n", escaped(note))));
        }
        text
    }

    /// The table alone, without heading and notes.
    fn markdown_tables(&self) -> String {
        if self.columns.len() <= WIDE {
            return self.markdown_block(0..self.columns.len(), true);
        }
        let mut first = 0;
        let mut blocks = Vec::new();
        for group in self.columns.chunk_by(|a, b| a.group_index == b.group_index) {
            let block = self.markdown_block(first..first + group.len(), false);
            blocks.push(format!("**{}**\n\n{block}", escaped(&group[0].group)));
            first += group.len();
        }
        blocks.join("\n")
    }

    /// The differences as the grid's rule judges them; nothing without a rule.
    fn markdown_verdicts(&self) -> String {
        let Some(rule) = &self.rule else { return String::new() };
        let confidence = 1e2 * rule.confidence;
        let text = format!(
            "\n**Verdict.** A difference helps a scene if the {confidence} % t-interval of its mean over seeds excludes \
             0 on the better side in every metric below, and harms it if an interval excludes 0 on the worse side. A \
             scene of which the variants have no such metric does not count. A variant that helps at least {} of the {} scenes and harms none is recommended.\n\n",
            rule.least_helped,
            rule.scenes.len()
        );
        let mut rows = vec![vec!["difference".to_owned()]];
        rows[0].extend(rule.scenes.iter().map(|scene| escaped(&scene.scene)));
        rows[0].push("recommended".to_owned());
        for verdict in &self.verdicts {
            let values = verdict.values.iter().map(|value| format!(", {value}")).collect::<String>();
            let mut row = vec![escaped(&format!("{} - {}{values}", verdict.variant, verdict.minus))];
            row.extend(verdict.scenes.iter().map(|scene| escaped(&scene.sentence())));
            row.push(verdict.recommendation(rule));
            rows.push(row);
        }
        let columns = rows[0].len();
        text + &aligned(&rows, columns)
    }

    /// The table of some columns; their heads name their groups or not.
    fn markdown_block(&self, columns: Range<usize>, names_groups: bool) -> String {
        let labels = self.headings.len();
        let heads = self.markdown_heads(&self.columns[columns.clone()], names_groups);
        let rows: Vec<Vec<String>> =
            std::iter::once(heads).chain(self.rows.iter().map(|row| self.markdown_row(row, columns.clone()))).collect();
        aligned(&rows, labels)
    }

    fn markdown_heads(&self, columns: &[Column], names_groups: bool) -> Vec<String> {
        let mut heads: Vec<String> = self.headings.iter().map(|heading| escaped(heading)).collect();
        for column in columns {
            let group = if names_groups { column.group.as_str() } else { "" };
            heads.push(escaped(format!("{group} {}", column.metric.heading()).trim()));
            heads.extend(column.paper_decimals.map(|_| "paper".to_owned()));
        }
        heads
    }

    fn markdown_row(&self, row: &Row, columns: Range<usize>) -> Vec<String> {
        let mut fields: Vec<String> = row.labels.iter().map(|label| escaped(label)).collect();
        for (column, entry) in self.columns[columns.clone()].iter().zip(&row.entries[columns]) {
            fields.push(self.markdown_field(column, entry));
            fields.extend(column.paper_decimals.map(|_| column.paper_field(entry)));
        }
        fields
    }

    fn markdown_field(&self, column: &Column, entry: &Entry) -> String {
        let field = self.field(column, entry);
        if field.is_best { format!("**{}**{}", field.text, field.rest) } else { field.text + &field.rest }
    }
}

/// Rows of as many fields as a table in Markdown, the first one being its head. The first `labels` columns are aligned to
/// the left, the others to the right.
fn aligned(rows: &[Vec<String>], labels: usize) -> String {
    let width = |place: usize| rows.iter().map(|row| row[place].chars().count()).max().unwrap_or(0).max(3);
    let widths: Vec<usize> = (0..rows[0].len()).map(width).collect();
    let line = |row: &Vec<String>| {
        let fields = row.iter().zip(&widths).enumerate();
        let padded = fields.map(|(place, (text, width))| match place < labels {
            true => format!(" {text:width$} |"),
            false => format!(" {text:>width$} |"),
        });
        format!("|{}\n", padded.collect::<String>())
    };
    let rules = widths.iter().enumerate().map(|(place, width)| match place < labels {
        true => format!(":{}|", "-".repeat(width + 1)),
        false => format!("{}:|", "-".repeat(width + 1)),
    });
    let rules = format!("|{}\n", rules.collect::<String>());
    std::iter::once(line(&rows[0])).chain([rules]).chain(rows[1..].iter().map(line)).collect()
}

/// A text as Markdown shows it letter by letter, in one line.
fn escaped(text: &str) -> String {
    let mut escaped = String::new();
    let mut letters = text.chars().peekable();
    while let Some(letter) = letters.next() {
        // Elsewhere an ampersand stands for itself.
        let starts_entity =
            letter == '&' && letters.peek().is_some_and(|next| next.is_ascii_alphanumeric() || *next == '#');
        match letter {
            '\\' | '|' | '*' | '_' | '`' | '<' | '[' | ']' | '~' | '$' => escaped.extend(['\\', letter]),
            '&' if starts_entity => escaped.push_str("\\&"),
            letter if letter.is_control() => escaped.push(' '),
            letter => escaped.push(letter),
        }
    }
    escaped
}

#[cfg(test)]
mod tests {
    use super::super::specimen::{ablation, group, windows};
    use super::*;

    #[test]
    fn the_table_reads_well() {
        let (index, outcomes) = windows();
        insta::assert_snapshot!(Table::of(&index, &outcomes).markdown(), @"
        # Ablation of MVG & MFTA

        What each part brings.

        | motion.window | Neu3D PSNR (dB) ↑ |         paper |  Neu3D LPIPS-alex ↓ |
        |:--------------|------------------:|--------------:|--------------------:|
        | 9             |      31.12 ± 0.18 | 31.90 (-0.77) | **0.0500** ± 0.0000 |
        | 3             |      30.12 ± 0.18 |               | **0.0500** ± 0.0000 |
        | 5             |  **31.62** ± 0.18 | 32.07 (-0.45) | **0.0500** ± 0.0000 |

        - 2 seeds: mean ± sample standard deviation (n - 1) over seeds of the means over the scenes of a column.
        - Bold: the best of those trained here.
        - paper: the number that the paper gives, and in brackets ours minus that.
        ");
    }

    #[test]
    fn literature_best_and_dagger_are_shown() {
        let (mut index, outcomes) = ablation();
        index.columns[0].metrics.truncate(1);
        index.columns[1].metrics.remove(0);
        insta::assert_snapshot!(Table::of(&index, &outcomes).markdown(), @r"
        # Ablation of MVG & MFTA

        What each part brings.

        | method        |            Mean PSNR (dB) ↑ |          paper | Video dynamic Gaussians ↓ |
        |:--------------|----------------------------:|---------------:|--------------------------:|
        | 3DGS\_2023    |                             |          30.50 |                           |
        | w/o MVG\|MFTA | 27.50 ± 0.71 (2 of 3 seeds) |                |            **12,346** ± 1 |
        | full          |                29.00 ± 1.00 | 32.07 (-3.07)† |            **12,346** ± 1 |
        | broken        |                           - |          31.52 |            **12,346** ± 1 |

        - 3 seeds: mean ± sample standard deviation (n - 1) over seeds of the means over the scenes of a column.
        - Bold: the best of those trained here.
        - paper: the number that the paper gives, and in brackets ours minus that.
        - † not comparable: built-in scene; train.scale = 0.3.
        - 2 of 18 cells failed, 1 is not finished.
        ");
    }

    #[test]
    fn a_table_of_many_columns_is_split_by_their_groups() {
        let (mut index, outcomes) = windows();
        let psnr = |title: &str| group(title, &[], &["composed.psnr"]);
        index.columns = (0..=WIDE).map(|column| psnr(&format!("group {column}"))).collect();
        index.paper.clear();
        let text = Table::of(&index, &outcomes).markdown();
        assert!(text.contains("\n**group 1**\n\n| motion.window |      PSNR (dB) \u{2191} |\n"), "{text}");
        assert_eq!(text.matches("| motion.window |").count(), WIDE + 1);
        index.columns.pop();
        assert_eq!(Table::of(&index, &outcomes).markdown().matches("| motion.window |").count(), 1);
    }

    #[test]
    fn letters_with_a_meaning_lose_it() {
        assert_eq!(escaped("a|b * `c` <d>\n_e_"), "a\\|b \\* \\`c\\` \\<d> \\_e\\_");
        assert_eq!(escaped("MVG & MFTA &lt; $x$"), "MVG & MFTA \\&lt; \\$x\\$");
    }

    #[test]
    fn every_line_of_the_table_has_as_many_fields() {
        let (index, outcomes) = ablation();
        let text = Table::of(&index, &outcomes).markdown().replace("\\|", "");
        let fields: Vec<usize> =
            text.lines().filter(|line| line.starts_with('|')).map(|line| line.matches('|').count()).collect();
        assert_eq!(fields, [9; 6]);
    }
}
