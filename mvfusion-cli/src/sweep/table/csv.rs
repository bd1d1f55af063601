//! `table.csv` and `seeds.csv`: a line for each metric of each row, and one for each seed of it, for other programs.

use csv::{Terminator, WriterBuilder};

use super::{Column, Entry, SeedMean, Table};

/// The columns behind the labels in `table.csv`.
const HEADER: [&str; 8] = ["column", "metric", "mean", "deviation", "seeds", "paper", "difference", "comparable"];

/// The columns behind the labels in `seeds.csv`.
const SEED_HEADER: [&str; 4] = ["column", "metric", "seed", "value"];

impl Table {
    /// The table as RFC 4180 has it, in long form and full precision; what is absent is empty.
    pub fn csv(&self) -> String {
        let line = |column: &Column, entry: &Entry| {
            let number = |value: Option<f64>| value.map_or(String::new(), |value| value.to_string());
            vec![vec![
                column.group.clone(),
                column.metric.name.clone(),
                number(entry.spread.map(|spread| spread.mean)),
                number(entry.spread.and_then(|spread| spread.deviation)),
                entry.spread.map_or(String::new(), |_| entry.seeds.len().to_string()),
                number(entry.paper),
                number(entry.difference()),
                entry.is_comparable().map_or(String::new(), |is| is.to_string()),
            ]]
        };
        self.lines(&HEADER, line)
    }

    /// What the means are taken over, in the same form: the value of each seed, of those that were trained here.
    pub fn seeds_csv(&self) -> String {
        let lines = |column: &Column, entry: &Entry| {
            let line = |of: &SeedMean| {
                vec![column.group.clone(), column.metric.name.clone(), of.seed.to_string(), of.mean.to_string()]
            };
            entry.seeds.iter().map(line).collect()
        };
        self.lines(&SEED_HEADER, lines)
    }

    /// The header, and what `of` makes of each entry, each line behind its row's labels.
    fn lines(&self, header: &[&str], of: impl Fn(&Column, &Entry) -> Vec<Vec<String>>) -> String {
        let write = || -> anyhow::Result<String> {
            let mut lines = WriterBuilder::new().flexible(true).terminator(Terminator::CRLF).from_writer(Vec::new());
            lines.write_record(self.headings.iter().map(String::as_str).chain(header.iter().copied()))?;
            for row in &self.rows {
                for (column, entry) in self.columns.iter().zip(&row.entries) {
                    for fields in of(column, entry) {
                        lines.write_record(row.labels.iter().chain(&fields))?;
                    }
                }
            }
            Ok(String::from_utf8(lines.into_inner().map_err(|error| error.into_error())?)?)
        };
        // Proof: memory takes whatever is written, and every field is text.
        write().unwrap_or_else(|error| panic!("{error}"))
    }
}

#[cfg(test)]
mod tests {
    use super::super::specimen::{ablation, cell, group, index, metrics};
    use super::*;

    #[test]
    fn a_line_has_one_metric_in_full() {
        let (index, outcomes) = ablation();
        let text = Table::of(&index, &outcomes).csv();
        let lines: Vec<&str> = text.split_terminator("\r\n").collect();
        assert_eq!(lines.len(), 1 + 4 * 5);
        assert_eq!(lines[0], "method,column,metric,mean,deviation,seeds,paper,difference,comparable");
        assert_eq!(lines[1], "3DGS_2023,Mean,composed.psnr,,,,30.5,,");
        assert_eq!(lines[6], "w/o MVG|MFTA,Mean,composed.psnr,27.5,0.7071067811865476,2,,,");
        assert_eq!(lines[8], "w/o MVG|MFTA,Mean,mask_iou,,,,,,");
        assert_eq!(lines[11], "full,Mean,composed.psnr,29,1,3,32.07,-3.0700000000000003,false");
        assert_eq!(lines[15], "full,Video,gaussians.dynamic,12346,1,3,,,");
    }

    #[test]
    fn a_mean_is_that_of_its_seeds_lines() {
        let (index, outcomes) = ablation();
        let table = Table::of(&index, &outcomes);
        let text = table.seeds_csv();
        let lines: Vec<&str> = text.split_terminator("\r\n").collect();
        assert_eq!(lines[0], "method,column,metric,seed,value");
        let of = |row: &str| -> Vec<f64> {
            let values = lines.iter().filter_map(|line| line.strip_prefix(row)?.rsplit_once(','));
            values.map(|(_, value)| value.parse().expect("a number")).collect()
        };
        assert_eq!(of("w/o MVG|MFTA,Mean,composed.psnr,"), [27.0, 28.0]);
        assert!(of("3DGS_2023,Mean,composed.psnr,").is_empty());
    }

    #[test]
    fn fields_are_quoted_where_they_must_be() {
        let mut index = index(&["key"], vec![group("A, \"B\"", &[], &["composed.psnr"])], "");
        index.cells = vec![cell("s", "", &["\"x\\ny\""], 0), cell("s", "", &["[1, 2]"], 0)];
        let table = Table::of(&index, &[metrics(&[("composed.psnr", 20.0)])]);
        assert_eq!(
            table.csv(),
            "key,column,metric,mean,deviation,seeds,paper,difference,comparable\r\n\
             \"x\ny\",\"A, \"\"B\"\"\",composed.psnr,20,,1,,,\r\n\
             \"[1, 2]\",\"A, \"\"B\"\"\",composed.psnr,,,,,,\r\n"
        );
    }

    #[test]
    fn a_number_is_comparable_where_no_cell_says_otherwise() {
        let paper = "
            [[paper]]
            column = 'A'
            values = { 'composed.psnr' = 21.0 }
            ";
        let mut index = index(&[], vec![group("A", &[], &["composed.psnr"])], paper);
        index.cells = vec![cell("s", "", &[], 0)];
        let table = Table::of(&index, &[metrics(&[("composed.psnr", 20.0)])]);
        assert!(table.csv().ends_with("\r\nA,composed.psnr,20,,1,21,-1,true\r\n"), "{}", table.csv());
    }
}
