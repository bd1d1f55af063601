//! Tests of the drawing.

use super::super::specimen::windows;
use super::super::{Table, plots};
use super::*;

fn drawn() -> String {
    let (index, outcomes) = windows();
    plots::of(&Table::of(&index, &outcomes))[0].svg()
}

fn single(name: &str, points: Vec<Point>) -> Plot {
    Plot {
        file: "a.svg".into(),
        title: "<A> & \"B\"".into(),
        x_title: "key".into(),
        y_title: "PSNR (dB)".into(),
        series: vec![Series { name: name.to_owned(), points }],
    }
}

#[test]
fn the_drawing_stands_by_itself() {
    let svg = drawn();
    assert!(svg.starts_with("<svg xmlns=\"http://www.w3.org/2000/svg\""), "{svg}");
    assert!(svg.contains("viewBox=\"0 0 640 416\"") && svg.contains("<style>"), "{svg}");
    for text in [">motion.window<", ">PSNR (dB) \u{2191}<", ">Neu3D<", ">the paper, in the same colours<"] {
        assert!(svg.contains(text), "{text}: {svg}");
    }
    assert_eq!(svg, drawn());
}

#[test]
fn every_swept_value_has_a_tick_a_dot_and_a_bar() {
    let svg = drawn();
    let ticks = |svg: &str| svg.matches("text-anchor=\"middle\">").count();
    // Three values and the title of the axis; that of the metrics is turned, which stands behind its anchor.
    assert_eq!(ticks(&svg), 4, "{svg}");
    for tick in [">3<", ">5<", ">9<"] {
        assert!(svg.contains(tick), "{tick}: {svg}");
    }
    assert_eq!(svg.matches("class=\"spread\"").count(), 3);
    // Three values, and the legend.
    assert_eq!(svg.matches("class=\"dot\" fill=\"#0072b2\"").count(), 4);
    assert_eq!(svg.matches("class=\"hollow\" stroke=\"#0072b2\"").count(), 2);
    assert_eq!(svg.matches("class=\"grid\"").count(), svg.matches("text-anchor=\"end\"").count());
}

#[test]
fn names_are_text_and_nothing_else() {
    let point = Point { x: 1.0, spread: Some(Spread { mean: 2.0, deviation: None }), paper: None, is_comparable: true };
    let svg = single("</text><script>&\u{7}", vec![point]).svg();
    assert!(svg.contains("&lt;/text&gt;&lt;script&gt;&amp; <"), "{svg}");
    assert!(svg.contains("&lt;A&gt; &amp; "), "{svg}");
    assert!(!svg.contains("<script") && !svg.contains('\u{7}'), "{svg}");
    assert_eq!(clean(&"x".repeat(200)).chars().count(), MOST_LETTERS);
}

#[test]
fn gaps_and_equal_metrics_leave_no_number_that_is_none() {
    let spread = |mean| Some(Spread { mean, deviation: Some(0.0) });
    for means in [[spread(1.0), None, spread(1.0)], [None, spread(0.0), None], [None; 3]] {
        let point = |(x, spread)| Point { x: f64::from(x), spread, paper: None, is_comparable: true };
        let svg = single("a", (0..3).zip(means).map(point).collect()).svg();
        assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
    }
}

#[test]
fn lines_of_the_same_colour_have_other_marks() {
    let marks = [0, COLOURS.len(), 2 * COLOURS.len()].map(|index| dot(index, [1.0, 2.0]).into_string());
    assert!(marks.iter().all(|mark| mark.contains(COLOURS[0])), "{marks:?}");
    assert!(marks[0] != marks[1] && marks[1] != marks[2] && marks[0] != marks[2], "{marks:?}");
}

#[test]
fn labels_do_not_run_into_each_other() {
    let frame = frame(scale::axis(&[1.0, 1.01, 40.0]), Axis::linear([0.0].into_iter()));
    let ticks = scale::ticks(&frame.x, &[1.0, 1.01, 40.0]);
    let written: Vec<bool> = with_room(ticks, &frame).into_iter().map(|(_, has_room)| has_room).collect();
    assert_eq!(written, [true, false, true]);
}
