//! The differences of a sweep as the rule of its grid judges them.

use mvfusion_model::evaluation::Better;
use serde::Serialize;
use statrs::distribution::{ContinuousCDF, StudentsT};

use super::{Column, Entry, Method, Row, State};
use crate::sweep::grid::{Rule, RuleScene};
use crate::sweep::metric::TableMetric;

/// A judged difference.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Verdict {
    /// The variant that is judged.
    pub variant: String,
    /// The variant that it is compared with.
    pub minus: String,
    /// Their values of the swept keys, as TOML.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub values: Vec<String>,
    /// The scenes of the rule.
    pub scenes: Vec<SceneVerdict>,
    /// Whether the variant is recommended; absent until every seed has every metric, and if too few scenes count.
    pub recommended: Option<bool>,
}

/// The effect on a scene.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SceneVerdict {
    /// The scene.
    pub scene: String,
    /// The metrics that decide, each with its interval.
    pub intervals: Vec<Interval>,
    /// Whether the variants have any of these metrics. A model with one branch has none of the static branch, and a grid may
    /// exclude the scene.
    pub applies: bool,
    /// What follows; absent with fewer than two seeds.
    pub effect: Option<Effect>,
}

/// A confidence interval of the mean of paired differences.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Interval {
    /// Name of the metric.
    pub metric: String,
    /// Number of seeds that both variants have.
    pub seeds: usize,
    /// Mean of the differences; absent without a seed.
    pub mean: Option<f64>,
    /// The ends of the interval; absent with fewer than two seeds.
    pub ends: Option<[f64; 2]>,
}

/// The effect of a variant on a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Effect {
    /// Better in every metric.
    Helps,
    /// Worse in at least one metric.
    Harms,
    /// Neither is shown.
    Undecided,
}

impl Effect {
    /// In a word.
    pub(super) fn word(self) -> &'static str {
        match self {
            Self::Helps => "helps",
            Self::Harms => "harms",
            Self::Undecided => "no difference shown",
        }
    }
}

impl Verdict {
    /// Whether the variant is recommended, in words.
    pub(super) fn recommendation(&self, rule: &Rule) -> String {
        let (count, needed) = (self.scenes.iter().filter(|scene| scene.applies).count(), rule.least_helped);
        match self.recommended {
            Some(true) => "yes".to_owned(),
            Some(false) => "no".to_owned(),
            None if count < needed => format!("not decided: {count} of the {needed} scenes that it needs"),
            None => "not complete".to_owned(),
        }
    }
}

impl SceneVerdict {
    /// The intervals and what follows: `helps: PSNR +0.21 [+0.05, +0.37], ..`. `seeds` is the number of all seeds.
    pub(super) fn sentence(&self, seeds: usize) -> String {
        if !self.applies {
            return "-".to_owned();
        }
        let of = |interval: &Interval| {
            let metric = TableMetric::of(&interval.metric);
            let signed = |value: f64| metric.signed(value);
            let mean = interval.mean.map_or("-".to_owned(), signed);
            let ends =
                interval.ends.map_or(String::new(), |[low, high]| format!(" [{}, {}]", signed(low), signed(high)));
            let missing = match interval.seeds < seeds {
                true => format!(" ({} of {seeds} seeds)", interval.seeds),
                false => String::new(),
            };
            format!("{} {mean}{ends}{missing}", metric.label)
        };
        let intervals: Vec<String> = self.intervals.iter().map(of).collect();
        let effect = self.effect.map_or("not known", Effect::word);
        format!("{effect}: {}", intervals.join("; "))
    }
}

/// Judges every difference among the rows.
pub(super) fn of(rule: &Rule, rows: &[Row], columns: &[Column], seeds: &[u64]) -> Vec<Verdict> {
    let judged = rows.iter().filter_map(|row| match &row.method {
        Method::Difference { variant, minus, values } => Some((row, variant, minus, values)),
        Method::Trained { .. } | Method::Literature(_) => None,
    });
    let verdict = |(row, variant, minus, values): (&Row, &String, &String, &Vec<String>)| {
        let scenes: Vec<SceneVerdict> = rule.scenes.iter().map(|scene| on_scene(rule, scene, row, columns)).collect();
        let applied = || scenes.iter().filter(|scene| scene.applies);
        let is_complete = applied().flat_map(|scene| &scene.intervals).all(|interval| interval.seeds == seeds.len());
        let count = |effect| scenes.iter().filter(|scene| scene.effect == Some(effect)).count();
        let harms = count(Effect::Harms) > 0;
        let is_recommended = count(Effect::Helps) >= rule.least_helped && !harms;
        // With fewer scenes, only harm could decide.
        let can_decide = harms || applied().count() >= rule.least_helped;
        Verdict {
            variant: variant.clone(),
            minus: minus.clone(),
            values: values.clone(),
            recommended: (is_complete && seeds.len() > 1 && can_decide).then_some(is_recommended),
            scenes,
        }
    };
    judged.map(verdict).collect()
}

fn on_scene(rule: &Rule, of: &RuleScene, row: &Row, columns: &[Column]) -> SceneVerdict {
    let shown = |name: &String| {
        let is_of_scene = |column: &Column| column.scenes == [of.scene.clone()] && column.metric.name == *name;
        columns.iter().zip(&row.entries).find(|(column, _)| is_of_scene(column))
    };
    let found: Vec<(&Column, &Entry)> = of.metrics.iter().filter_map(shown).collect();
    let intervals: Vec<Interval> =
        found.iter().map(|(column, entry)| interval(&column.metric.name, entry, rule.confidence)).collect();
    let sides = found.iter().zip(&intervals).map(|((column, _), interval)| side(column.metric.better, interval));
    let sides: Option<Vec<Side>> = sides.collect();
    let effect = sides.map(|sides| match () {
        () if sides.contains(&Side::Worse) => Effect::Harms,
        () if !sides.is_empty() && sides.iter().all(|side| *side == Side::Better) => Effect::Helps,
        () => Effect::Undecided,
    });
    let applies = found.iter().any(|(_, entry)| entry.state != State::Unknown);
    SceneVerdict { scene: of.scene.clone(), intervals, applies, effect }
}

/// The t-interval of the mean of an entry's differences.
fn interval(metric: &str, entry: &Entry, confidence: f64) -> Interval {
    let seeds = entry.seeds.len();
    let ends = entry.spread.and_then(|spread| {
        let freedom = (seeds - 1) as f64;
        let quantile = StudentsT::new(0.0, 1.0, freedom).ok()?.inverse_cdf(0.5 + 0.5 * confidence);
        let half = quantile * spread.deviation? / (seeds as f64).sqrt();
        Some([spread.mean - half, spread.mean + half])
    });
    Interval { metric: metric.to_owned(), seeds, mean: entry.spread.map(|spread| spread.mean), ends }
}

/// The side of 0 on which an interval lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Side {
    Better,
    Worse,
    Both,
}

fn side(better: Option<Better>, interval: &Interval) -> Option<Side> {
    let [low, high] = interval.ends?;
    let (is_above, is_below) = (low > 0.0, high < 0.0);
    Some(match better? {
        Better::Higher if is_above => Side::Better,
        Better::Lower if is_below => Side::Better,
        _ if is_above || is_below => Side::Worse,
        _ => Side::Both,
    })
}

#[cfg(test)]
mod tests {
    use super::super::specimen::{cell, group, index, metrics};
    use super::super::{Outcome, Table};
    use super::*;
    use crate::sweep::grid::Difference;

    /// PSNR and LPIPS of a base and a variant for each seed, on two scenes; `None` did not finish.
    fn table(psnr: [f64; 4], lpips: [f64; 4], other: Option<f64>) -> Table {
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
        Table::of(&index, &outcomes)
    }

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
        let recommended = |other| table([1.0, 1.1, 0.9, 1.0], [-0.1, -0.11, -0.1, -0.1], other).verdicts[0].recommended;
        assert_eq!(recommended(Some(0.0)), Some(true));
        assert_eq!(recommended(Some(-1.0)), Some(false), "it harms the other scene");
        assert_eq!(recommended(None), None);
        let mut table = table([1.0, 1.1, 0.9, 1.0], [-0.1, -0.11, -0.1, -0.1], None);
        let rule = table.rule.clone().expect("it has one");
        table.rows.iter_mut().flat_map(|row| &mut row.entries[2..]).for_each(|entry| entry.state = State::Unknown);
        let verdicts = of(&rule, &table.rows, &table.columns, &table.seeds);
        assert_eq!(verdicts[0].recommended, Some(true), "a scene without any of the metrics does not count");
        let strict = Rule { least_helped: 2, ..rule.clone() };
        let verdict = &of(&strict, &table.rows, &table.columns, &table.seeds)[0];
        assert_eq!(verdict.recommended, None);
        assert_eq!(verdict.recommendation(&strict), "not decided: 1 of the 2 scenes that it needs");
        // Without LPIPS, nothing is known of the first scene.
        table.rows.iter_mut().for_each(|row| row.entries[1] = Entry { state: State::Unknown, ..Entry::default() });
        let verdict = &of(&rule, &table.rows, &table.columns, &table.seeds)[0];
        assert_eq!((verdict.scenes[0].applies, verdict.scenes[0].effect, verdict.recommended), (true, None, None));
    }

    #[test]
    fn no_difference_is_no_recommendation() {
        assert_eq!(table([0.0; 4], [0.0; 4], Some(0.0)).verdicts[0].recommended, Some(false));
    }
}
