use super::*;
use crate::sweep::grid::Difference;
use crate::sweep::index::Index;
use crate::sweep::table::specimen::{cell, group, index, metrics};
use crate::sweep::table::{CellMetrics, Table};

/// PSNR and LPIPS of a base and a variant for each seed, on two scenes; `None` did not finish.
fn sweep(psnr: [f64; 4], lpips: [f64; 4], other: Option<f64>) -> (Index, Vec<Outcome>) {
    let columns = ["a", "b"].map(|scene| group(scene, &[scene], &["composed.psnr", "composed.lpips_alex"]));
    let mut index = index(&[], columns.to_vec(), "");
    index.differences = vec![Difference { variant: "form".into(), minus: "base".into() }];
    let scenes = ["a", "b"].map(|scene| RuleScene {
        scene: scene.to_owned(),
        metrics: vec!["composed.psnr".to_owned(), "composed.lpips_alex".to_owned()],
    });
    index.rule = Some(Rule { confidence: 0.95, least_helped: 1, scenes: scenes.to_vec() });
    let mut outcomes = Vec::new();
    for seed in 0..4 {
        let drift = seed as f64;
        for (variant, own) in [("base", [0.0, 0.0]), ("form", [psnr[seed], lpips[seed]])] {
            for scene in ["a", "b"] {
                index.cells.push(cell(scene, variant, &[], seed as u64));
                let own = if scene == "a" { Some(own) } else { other.map(|other| [other * own[0], 0.0]) };
                outcomes.push(own.map_or(Outcome::Unfinished, |[psnr, lpips]| {
                    metrics(&[("composed.psnr", 30.0 + drift + psnr), ("composed.lpips_alex", 0.2 + lpips)])
                }));
            }
        }
    }
    (index, outcomes)
}

fn table(psnr: [f64; 4], lpips: [f64; 4], other: Option<f64>) -> Table {
    let (index, outcomes) = sweep(psnr, lpips, other);
    Table::of(&index, &outcomes)
}

/// Takes a metric from the cells of a scene.
fn forget(index: &Index, outcomes: &mut [Outcome], scene: &str, metric: &str) {
    for (cell, outcome) in index.cells.iter().zip(outcomes) {
        if let Outcome::Metrics(CellMetrics { numbers, .. }) = outcome
            && cell.scene == scene
        {
            numbers.remove(metric);
        }
    }
}

const BETTER: [f64; 4] = [1.0, 1.1, 0.9, 1.0];
const SHARPER: [f64; 4] = [-0.1, -0.11, -0.1, -0.1];

#[test]
fn the_interval_is_that_of_students_distribution() {
    let table = table([1.0, 2.0, 3.0, 4.0], [-0.1; 4], Some(0.0));
    let interval = &table.verdicts[0].scenes[0].intervals[0];
    // Mean 2.5, deviation sqrt(5 / 3), and the quantile 3.182446 of three degrees of freedom.
    let half = 3.182_446 * (5.0f64 / 3.0).sqrt() / 2.0;
    let [low, high] = interval.ends.expect("four seeds");
    assert!((low - (2.5 - half)).abs() < 1e-5 && (high - (2.5 + half)).abs() < 1e-5, "{interval:?}");
    assert_eq!((interval.seeds, interval.mean), (4, Some(2.5)));
}

#[test]
fn a_form_helps_if_every_metric_is_better_and_harms_if_one_is_worse() {
    let effect = |psnr, lpips| table(psnr, lpips, Some(0.0)).verdicts[0].scenes[0].effect;
    let (better, worse, unclear) = ([1.0, 1.1, 0.9, 1.0], [-1.0, -1.1, -0.9, -1.0], [1.0, -1.0, 1.0, -1.0]);
    let (sharper, softer) = ([-0.1, -0.11, -0.1, -0.1], [0.1, 0.11, 0.1, 0.1]);
    assert_eq!(effect(better, sharper), Some(Effect::Helps));
    assert_eq!(effect(better, softer), Some(Effect::Harms));
    assert_eq!(effect(worse, sharper), Some(Effect::Harms));
    assert_eq!(effect(unclear, sharper), Some(Effect::Undecided));
    assert_eq!(effect(better, [0.01, -0.01, 0.01, -0.01]), Some(Effect::Undecided));
}

#[test]
fn the_table_states_the_rule_and_what_follows_from_it() {
    let text = table([1.0, 1.1, 0.9, 1.0], [-0.1, -0.11, -0.1, -0.1], None).markdown();
    assert!(text.contains("excludes 0 on the better side in every metric"), "{text}");
    let row = text.lines().find(|line| line.starts_with("| form - base") && line.contains("helps")).expect("a row");
    let fields: Vec<&str> = row.split('|').map(str::trim).collect();
    let of_b = "not known: PSNR - (0 of 4 seeds); LPIPS-alex - (0 of 4 seeds)";
    assert_eq!(fields[2], "helps: PSNR +1.00 \\[+0.87, +1.13\\]; LPIPS-alex -0.1025 \\[-0.1105, -0.0945\\]");
    assert_eq!((fields[3], fields[4]), (of_b, "not complete"));
}

#[test]
fn a_recommendation_waits_for_every_seed_and_bears_no_harm() {
    let recommended = |other| table(BETTER, SHARPER, other).verdicts[0].recommended;
    assert_eq!(recommended(Some(0.0)), Some(true));
    assert_eq!(recommended(Some(-1.0)), Some(false), "it harms the other scene");
    assert_eq!(recommended(None), None);
    let (mut index, mut outcomes) = sweep(BETTER, SHARPER, Some(0.0));
    for metric in ["composed.psnr", "composed.lpips_alex"] {
        forget(&index, &mut outcomes, "b", metric);
    }
    let verdict = |index: &Index, outcomes: &[Outcome]| Table::of(index, outcomes).verdicts[0].clone();
    let alone = verdict(&index, &outcomes);
    assert_eq!(alone.recommended, Some(true), "a scene without any of the metrics does not count");
    let rule = index.rule.clone().expect("it has one");
    let strict = Rule { least_helped: 2, ..rule.clone() };
    index.rule = Some(strict.clone());
    let of_two = verdict(&index, &outcomes);
    assert_eq!(of_two.recommended, None);
    assert_eq!(of_two.recommendation(&strict), "not decided: 1 of the 2 scenes that it needs");
    // One scene without help is enough where the rule asks for both, whatever the other will yield.
    let (mut unclear, open) = sweep([1.0, -1.0, 1.0, -1.0], SHARPER, None);
    assert_eq!(verdict(&unclear, &open).recommended, None);
    unclear.rule = Some(strict);
    assert_eq!(verdict(&unclear, &open).recommended, Some(false));
    // Without LPIPS, nothing is known of the first scene.
    index.rule = Some(rule.clone());
    forget(&index, &mut outcomes, "a", "composed.lpips_alex");
    let blurred = verdict(&index, &outcomes);
    assert_eq!((blurred.scenes[0].applies, blurred.scenes[0].effect, blurred.recommended), (true, None, None));
    assert_eq!(blurred.recommendation(&rule), "not decided: LPIPS-alex of a is missing");
}

#[test]
fn harm_is_shown_without_the_other_metrics_of_the_scene() {
    let (index, mut outcomes) = sweep(BETTER.map(|psnr| -psnr), SHARPER, None);
    forget(&index, &mut outcomes, "a", "composed.lpips_alex");
    let verdict = &Table::of(&index, &outcomes).verdicts[0];
    assert_eq!((verdict.scenes[0].effect, verdict.recommended), (Some(Effect::Harms), Some(false)));
    assert!(verdict.scenes[0].sentence().starts_with("harms: "), "{}", verdict.scenes[0].sentence());
    // One seed to go could still widen the interval.
    outcomes[0] = Outcome::Unfinished;
    let verdict = &Table::of(&index, &outcomes).verdicts[0];
    assert_eq!((verdict.scenes[0].effect, verdict.recommended), (Some(Effect::Harms), None));
    assert!(verdict.scenes[0].sentence().starts_with("harms so far: "), "{}", verdict.scenes[0].sentence());
    assert_eq!(verdict.recommendation(index.rule.as_ref().expect("it has one")), "not complete");
}

#[test]
fn a_seed_that_the_grid_leaves_out_is_not_waited_for() {
    let (mut index, mut outcomes) = sweep(BETTER, SHARPER, Some(0.0));
    let kept: Vec<bool> = index.cells.iter().map(|cell| cell.seed != 3 || cell.variant != "form").collect();
    let (mut of_cells, mut of_outcomes) = (kept.iter(), kept.iter());
    index.cells.retain(|_| of_cells.next() == Some(&true));
    outcomes.retain(|_| of_outcomes.next() == Some(&true));
    let table = Table::of(&index, &outcomes);
    let verdict = &table.verdicts[0];
    assert_eq!((verdict.scenes[0].seeds, table.seeds.len(), verdict.recommended), (3, 4, Some(true)));
    assert!(!verdict.scenes[0].sentence().contains("seeds"), "{}", verdict.scenes[0].sentence());
}

#[test]
fn one_seed_is_not_enough() {
    let (mut index, outcomes) = sweep(BETTER, SHARPER, Some(0.0));
    index.cells.truncate(4);
    let verdict = &Table::of(&index, &outcomes[..4]).verdicts[0];
    assert_eq!(verdict.recommended, None);
    let rule = index.rule.as_ref().expect("it has one");
    assert_eq!(verdict.recommendation(rule), "not decided: it needs two seeds");
}

#[test]
fn no_difference_is_no_recommendation() {
    assert_eq!(table([0.0; 4], [0.0; 4], Some(0.0)).verdicts[0].recommended, Some(false));
}
