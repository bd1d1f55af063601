//! `table.tex`: the table for a paper, in the manner of booktabs.

use super::{Entry, Row, Table};

impl Table {
    /// The table in LaTeX; it needs the package booktabs.
    pub fn latex(&self) -> String {
        let spec = "l".repeat(self.headings.len()) + &"c".repeat(self.metric_columns());
        // A tabular must have a column, even if there is nothing to put into it.
        let spec = if spec.is_empty() { "l" } else { &spec };
        let is_alike = |a: &Row, b: &Row| std::mem::discriminant(&a.method) == std::mem::discriminant(&b.method);
        let block = |rows: &[Row]| rows.iter().map(|row| self.latex_row(row)).collect::<String>();
        let blocks: Vec<String> = self.rows.chunk_by(is_alike).map(block).collect();
        let body = blocks.join("\\midrule\n");
        let notes: Vec<String> = self.notes().iter().map(|note| escaped(note)).collect();
        let notes = match notes.is_empty() {
            true => String::new(),
            false => format!("\\par\\smallskip\n{{\\footnotesize\n{}\\par}}\n", notes.join("\n")),
        };
        format!(
            "% Needs \\usepackage{{booktabs}}.\n\\begin{{table}}[t]\n\\centering\n\\caption{{{}}}\n\\label{{tab:{}}}\n\
             \\small\n\\begin{{tabular}}{{{spec}}}\n\\toprule\n{}{}\\midrule\n{body}\\bottomrule\n\
             \\end{{tabular}}\n{notes}\\end{{table}}\n",
            escaped(&self.title),
            label(&self.name),
            self.latex_groups(),
            self.latex_heads(),
        )
    }

    /// Columns behind the labels.
    fn metric_columns(&self) -> usize {
        self.columns.iter().map(|column| 1 + usize::from(column.paper_decimals.is_some())).sum()
    }

    /// The line with the groups' headings, and rules that say how far each reaches.
    fn latex_groups(&self) -> String {
        let (mut heads, mut rules) = (vec![String::new(); self.headings.len()], Vec::new());
        let mut first = self.headings.len() + 1;
        for group in self.columns.chunk_by(|a, b| a.group_index == b.group_index) {
            let span: usize = group.iter().map(|column| 1 + usize::from(column.paper_decimals.is_some())).sum();
            heads.push(format!("\\multicolumn{{{span}}}{{c}}{{{}}}", escaped(&group[0].group)));
            rules.push(format!("\\cmidrule(lr){{{first}-{}}}", first + span - 1));
            first += span;
        }
        if rules.is_empty() { String::new() } else { format!("{}{}\n", line(&heads), rules.join(" ")) }
    }

    fn latex_heads(&self) -> String {
        let mut heads: Vec<String> = self.headings.iter().map(|heading| escaped(heading)).collect();
        for column in &self.columns {
            heads.push(escaped(&column.metric.heading()));
            heads.extend(column.paper_decimals.map(|_| "paper".to_owned()));
        }
        line(&heads)
    }

    fn latex_row(&self, row: &Row) -> String {
        let mut fields: Vec<String> = row.labels.iter().map(|label| escaped(label)).collect();
        for (column, entry) in self.columns.iter().zip(&row.entries) {
            fields.push(self.latex_field(column, entry));
            fields.extend(column.paper_decimals.map(|_| with_minus(&escaped(&column.paper_field(entry)))));
        }
        line(&fields)
    }

    fn latex_field(&self, column: &super::Column, entry: &Entry) -> String {
        let field = self.field(column, entry);
        let metric = if field.text == "-" { "--".to_owned() } else { with_minus(&escaped(&field.text)) };
        let metric = if field.is_best { format!("\\textbf{{{metric}}}") } else { metric };
        metric + &escaped(&field.rest)
    }
}

/// Fields as a line of a tabular.
fn line(fields: &[String]) -> String {
    format!("{} \\\\\n", fields.join(" & "))
}

/// A sign as in mathematics where a hyphen would be read, also in front of a number in brackets.
fn with_minus(number: &str) -> String {
    let is_negative =
        |text: &str| text.strip_prefix('-').is_some_and(|rest| rest.starts_with(|c: char| c.is_ascii_digit()));
    let number = if is_negative(number) { number.replacen('-', "$-$", 1) } else { number.to_owned() };
    number.replace("(-", "($-$")
}

/// A name that can be referred to: letters, digits and what LaTeX leaves alone.
fn label(name: &str) -> String {
    let is_plain = |letter: char| letter.is_ascii_alphanumeric() || matches!(letter, '-' | ':' | '.');
    name.chars().map(|letter| if is_plain(letter) { letter } else { '-' }).collect()
}

/// A text as LaTeX shows it letter by letter, in a line of a table.
fn escaped(text: &str) -> String {
    let mut escaped = String::new();
    let mut last = ' ';
    for letter in text.chars() {
        match letter {
            '_' | '&' | '%' | '#' | '$' | '{' | '}' => escaped.extend(['\\', letter]),
            '~' => escaped.push_str("\\textasciitilde{}"),
            '^' => escaped.push_str("\\textasciicircum{}"),
            '\\' => escaped.push_str("\\textbackslash{}"),
            '<' => escaped.push_str("\\textless{}"),
            '>' => escaped.push_str("\\textgreater{}"),
            '|' => escaped.push_str("\\textbar{}"),
            // Behind the end of a line these would be an argument of it, and two hyphens would become a dash.
            '[' | ']' | '*' => escaped.extend(['{', letter, '}']),
            '-' if last == '-' => escaped.push_str("{}-"),
            '\u{b1}' => escaped.push_str("$\\pm$"),
            '\u{d7}' => escaped.push_str("$\\times$"),
            '\u{2020}' => escaped.push_str("$^\\dagger$"),
            '\u{2191}' => escaped.push_str("$\\uparrow$"),
            '\u{2193}' => escaped.push_str("$\\downarrow$"),
            '\u{2192}' => escaped.push_str("$\\to$"),
            '\u{2264}' => escaped.push_str("$\\leq$"),
            '\u{2265}' => escaped.push_str("$\\geq$"),
            letter if letter.is_control() => escaped.push(' '),
            letter => escaped.push(letter),
        }
        last = letter;
    }
    escaped
}

#[cfg(test)]
#[path = "latex_tests.rs"]
mod tests;
