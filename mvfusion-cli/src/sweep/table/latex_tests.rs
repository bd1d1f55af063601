//! Tests of the LaTeX.

use super::super::specimen::{ablation, cell, group, index, windows};
use super::*;

/// Columns that a line of a tabular fills.
fn width(line: &str) -> usize {
    let fields = line.trim_end().trim_end_matches("\\\\").replace("\\&", "");
    let spans = |field: &str| match field.trim().strip_prefix("\\multicolumn{") {
        Some(rest) => rest.split('}').next().and_then(|span| span.parse().ok()).expect("a span"),
        None => 1,
    };
    fields.split(" & ").map(spans).sum()
}

/// That braces are balanced, mathematics ends where it began, and all lines fill the tabular.
fn check(text: &str) {
    let bare = text.replace("\\{", "").replace("\\}", "").replace("\\$", "").replace("\\\\", "");
    let mut depth = 0i32;
    for letter in bare.chars() {
        depth += i32::from(letter == '{') - i32::from(letter == '}');
        assert!(depth >= 0, "{text}");
    }
    assert_eq!(depth, 0, "{text}");
    assert!(bare.lines().all(|line| line.matches('$').count() % 2 == 0), "{text}");
    assert!(bare.is_ascii(), "{text}");
    for environment in ["table", "tabular"] {
        for edge in ["begin", "end"] {
            assert_eq!(text.matches(&format!("\\{edge}{{{environment}}}")).count(), 1, "{text}");
        }
    }
    let spec = text.split("\\begin{tabular}{").nth(1).and_then(|rest| rest.split('}').next()).expect("columns");
    let lines: Vec<&str> = text.lines().filter(|line| line.ends_with("\\\\")).collect();
    assert!(lines.iter().all(|line| width(line) == spec.len()), "{text}");
    for rule in text.split("\\cmidrule(lr){").skip(1) {
        let ends = rule.split('}').next().and_then(|range| range.split_once('-')).expect("a range");
        let [first, last] = [ends.0, ends.1].map(|end| end.parse::<usize>().expect("a column"));
        assert!(1 <= first && first <= last && last <= spec.len(), "{text}");
    }
}

#[test]
fn the_table_is_as_in_a_paper() {
    let (mut index, outcomes) = ablation();
    index.columns[0].metrics.truncate(1);
    index.columns[1].metrics.remove(0);
    let text = Table::of(&index, &outcomes).latex();
    check(&text);
    insta::assert_snapshot!(text, @r"
    % Needs \usepackage{booktabs}.
    \begin{table}[t]
    \centering
    \caption{Ablation of MVG \& MFTA}
    \label{tab:ablation-50-}
    \small
    \begin{tabular}{lccc}
    \toprule
     & \multicolumn{2}{c}{Mean} & \multicolumn{1}{c}{Video} \\
    \cmidrule(lr){2-3} \cmidrule(lr){4-4}
    method & PSNR (dB) $\uparrow$ & paper & dynamic Gaussians $\downarrow$ \\
    \midrule
    3DGS\_2023 &  & 30.50 &  \\
    \midrule
    w/o MVG\textbar{}MFTA & 27.50 $\pm$ 0.71 (2 of 3 seeds) &  & \textbf{12,346} $\pm$ 1 \\
    full & 29.00 $\pm$ 1.00 & 32.07 ($-$3.07)$^\dagger$ & \textbf{12,346} $\pm$ 1 \\
    broken & -- & 31.52 & \textbf{12,346} $\pm$ 1 \\
    \bottomrule
    \end{tabular}
    \par\smallskip
    {\footnotesize
    3 seeds: mean $\pm$ sample standard deviation (n - 1) over seeds of the means over the scenes of a column.
    Bold: the best of those trained here.
    paper: the number that the paper gives, and in brackets ours minus that.
    $^\dagger$ not comparable: built-in scene; train.scale = 0.3.
    2 of 18 cells failed, 1 is not finished.\par}
    \end{table}
    ");
}

#[test]
fn every_table_is_well_formed() {
    let (ablation, outcomes) = ablation();
    check(&Table::of(&ablation, &outcomes).latex());
    let (windows, outcomes) = windows();
    check(&Table::of(&windows, &outcomes).latex());
    check(&Table::of(&windows, &[]).latex());
    let mut odd = index(&["a{b}", "c_d"], vec![group("50% & $x$ [1]", &[], &["what^is~this", "mask_iou"])], "");
    check(&Table::of(&odd, &[]).latex());
    odd.cells = vec![cell("s", "\\input{x} & {", &["[1, 2]", "'*'"], 0), cell("s", "}", &["'#'", "1"], 0)];
    odd.title = "A {brace, a \\ and --flags".into();
    check(&Table::of(&odd, &[]).latex());
    odd.columns.clear();
    check(&Table::of(&odd, &[]).latex());
}

#[test]
fn letters_with_a_meaning_lose_it() {
    assert_eq!(escaped("a_b & 50% #1 $x$ {y}"), "a\\_b \\& 50\\% \\#1 \\$x\\$ \\{y\\}");
    assert_eq!(escaped("~^\\"), "\\textasciitilde{}\\textasciicircum{}\\textbackslash{}");
    assert_eq!(escaped("[1] * --x\n<y>"), "{[}1{]} {*} -{}-x \\textless{}y\\textgreater{}");
    assert_eq!(label("ablation_50% {x}"), "ablation-50---x-");
}

#[test]
fn negative_numbers_have_a_minus() {
    assert_eq!(with_minus("-0.50"), "$-$0.50");
    assert_eq!(with_minus("32.07 (-3.96)"), "32.07 ($-$3.96)");
    assert_eq!(with_minus("-"), "-");
}
