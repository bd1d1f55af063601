//! Which of the paper's numbers belong to a row.

use toml::{Table, Value};

use crate::config::leaves;
use crate::sweep::grid::{PaperRow, is_same};

/// A number of the paper.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Number<'a> {
    /// The number.
    pub value: f64,
    /// Why it says nothing about ours, as its row has it.
    pub not_comparable: Option<&'a str>,
}

impl<'a> Number<'a> {
    fn of(row: &'a PaperRow, metric: &str) -> Option<Self> {
        Some(Self { value: *row.values.get(metric)?, not_comparable: row.reason_against(metric) })
    }
}

/// The paper's number for a metric of cells of a variant with some values of the swept keys. One of its rows has it at
/// most: a grid with two is refused.
pub(super) fn of_trained<'a>(
    paper: &'a [PaperRow],
    (variant, axes, values): (&str, &[String], &[String]),
    (group, metric): (&str, &str),
) -> Option<Number<'a>> {
    let fits = |row: &&PaperRow| {
        row.literature.is_none()
            && row.column == group
            && row.variant.as_deref().is_none_or(|named| named == variant)
            && agrees(&row.at, axes, values)
    };
    paper.iter().filter(fits).find_map(|row| Number::of(row, metric))
}

/// The paper's number for a metric of a method that is not trained here.
pub(super) fn of_literature<'a>(
    paper: &'a [PaperRow],
    (name, at): (&str, &Table),
    (group, metric): (&str, &str),
) -> Option<Number<'a>> {
    let fits = |row: &&PaperRow| row.literature.as_deref() == Some(name) && row.at == *at && row.column == group;
    paper.iter().filter(fits).find_map(|row| Number::of(row, metric))
}

/// The methods that are not trained here, each with where in the grid it stands, in the order of the file.
pub(super) fn literature(paper: &[PaperRow]) -> Vec<(&str, &Table)> {
    let mut methods = Vec::new();
    for method in paper.iter().filter_map(|row| Some((row.literature.as_deref()?, &row.at))) {
        if !methods.contains(&method) {
            methods.push(method);
        }
    }
    methods
}

/// The value of a dotted key, as TOML; absent where a table does not have it.
pub(super) fn at(table: &Table, key: &str) -> Option<String> {
    leaves(table).into_iter().find(|(own, _)| own == key).map(|(_, value)| value.to_string())
}

/// Whether cells with these values of the swept keys have all that `at` asks for.
fn agrees(at: &Table, axes: &[String], values: &[String]) -> bool {
    leaves(at).iter().all(|(key, wanted)| {
        let own = axes.iter().zip(values).find(|(axis, _)| *axis == key);
        own.is_some_and(|(_, value)| is_same(&parsed(value), wanted))
    })
}

/// A TOML value from its text; what is none is a string.
pub(super) fn parsed(text: &str) -> Value {
    text.parse().unwrap_or_else(|_| Value::String(text.to_owned()))
}

/// A TOML value as it is read: a string without its quotes, all else as it is written.
pub(super) fn spoken(value: &str) -> String {
    match parsed(value) {
        Value::String(text) => text,
        _ => value.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(text: &str) -> PaperRow {
        toml::from_str(text).expect("row")
    }

    #[test]
    fn values_are_compared_and_not_how_they_are_written() {
        let axes = ["motion.window".to_owned(), "loss.weight".to_owned(), "model.kind".to_owned()];
        let at = |text: &str| text.parse::<Table>().expect("table");
        let agrees = |text, values: [&str; 3]| agrees(&at(text), &axes, &values.map(str::to_owned));
        let values = ["5", "0.50", "\"full\""];
        assert!(agrees("", values));
        assert!(agrees("motion.window = 5\nloss = { weight = 0.5 }", values));
        assert!(agrees("model.kind = 'full'\nmotion.window = 5.0", values));
        assert!(!agrees("motion.window = 7", values));
        assert!(!agrees("motion.other = 5", values));
        assert!(!agrees("model.kind = 5", values));
        assert!(agrees("loss.weight = [1, 2.0]", ["5", "[1.0, 2]", "0"]));
        assert!(!agrees("loss.weight = [1]", ["5", "[1, 2]", "0"]));
    }

    #[test]
    fn a_row_belongs_to_its_variant_column_and_values() {
        let paper = [
            row("variant = 'full'\ncolumn = 'Neu3D'\nvalues = { 'composed.psnr' = 32.07 }"),
            row("column = 'Neu3D'\nvariant = 'base'\nat = { motion.window = 5 }\nvalues = { 'composed.psnr' = 31.0 }"),
            row("column = 'Neu3D'\nat = { motion.window = 5 }\nvalues = { 'mask_iou' = 0.5 }"),
            row("literature = '3DGS'\ncolumn = 'Neu3D'\nvalues = { 'composed.psnr' = 30.0 }"),
        ];
        let axes = ["motion.window".to_owned()];
        let find = |variant, value: &str, metric| {
            let number = of_trained(&paper, (variant, &axes, &[value.to_owned()]), ("Neu3D", metric));
            number.map(|number| number.value)
        };
        assert_eq!(find("full", "5", "composed.psnr"), Some(32.07));
        assert_eq!(find("full", "5", "mask_iou"), Some(0.5));
        assert_eq!(find("base", "5", "composed.psnr"), Some(31.0));
        assert_eq!(find("base", "7", "composed.psnr"), None);
        assert_eq!(of_trained(&paper, ("full", &axes, &["5".into()]), ("Other", "composed.psnr")), None);
        let methods = literature(&paper);
        assert_eq!(methods.len(), 1);
        let number = Number { value: 30.0, not_comparable: None };
        assert_eq!(of_literature(&paper, methods[0], ("Neu3D", "composed.psnr")), Some(number));
    }

    #[test]
    fn a_reason_is_that_of_the_metric_or_else_that_of_the_row() {
        let paper = [row("column = 'a'\nvalues = { mask_iou = 0.5, 'composed.psnr' = 30.0, 'composed.ssim' = 0.9 }
             not_comparable = { '*' = 'other data', mask_iou = 'not defined.' }")];
        let reason = |metric| {
            let number = of_trained(&paper, ("full", &[], &[]), ("a", metric)).expect("there is a number");
            number.not_comparable
        };
        assert_eq!(["composed.psnr", "mask_iou"].map(reason), [Some("other data"), Some("not defined")]);
        let alone = [row("column = 'a'\nvalues = { mask_iou = 0.5, 'composed.psnr' = 30.0 }
             not_comparable = { mask_iou = 'not defined' }")];
        let number = of_trained(&alone, ("full", &[], &[]), ("a", "composed.psnr"));
        assert_eq!(number, Some(Number { value: 30.0, not_comparable: None }));
    }
}
