//! The differences of a sweep as the rule of its grid judges them.

use mvfusion_model::evaluation::Better;
use serde::Serialize;
use statrs::distribution::{ContinuousCDF, StudentsT};

use super::{Column, Entry, Method, Outcome, Row, State, TrainedCell};
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
    /// Whether the variant is recommended; absent while seeds lack metrics, and if too few scenes or seeds count. Harm
    /// decides as soon as every seed has the metric that shows it. So do scenes without help, if too few others are left.
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
    /// Number of seeds of which both variants have a cell.
    pub seeds: usize,
    /// Number of those of which both cells are finished.
    pub finished_seeds: usize,
    /// What follows; absent while harm is not shown and a metric has fewer than two seeds.
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
    /// Where it lies; absent with fewer than two seeds.
    #[serde(skip)]
    side: Option<Side>,
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
            None => self.obstacle().unwrap_or_else(|| "not complete".to_owned()),
        }
    }

    /// What stands in the way of a decision once all cells are finished.
    fn obstacle(&self) -> Option<String> {
        let applied = || self.scenes.iter().filter(|scene| scene.applies);
        if applied().any(|scene| scene.finished_seeds < scene.seeds) {
            return None;
        }
        let missing = |scene: &SceneVerdict| -> Vec<String> {
            let named = |interval: &Interval| format!("{} of {}", TableMetric::of(&interval.metric).label, scene.scene);
            scene.intervals.iter().filter(|interval| interval.seeds < scene.seeds).map(named).collect()
        };
        let missing: Vec<String> = applied().flat_map(missing).collect();
        Some(match missing.as_slice() {
            [] => "not decided: it needs two seeds".to_owned(),
            [one] => format!("not decided: {one} is missing"),
            several => format!("not decided: {} are missing", several.join(" and ")),
        })
    }
}

impl SceneVerdict {
    /// The intervals and what follows: `helps: PSNR +0.21 [+0.05, +0.37], ..`.
    pub(super) fn sentence(&self) -> String {
        if !self.applies {
            return "-".to_owned();
        }
        let of = |interval: &Interval| {
            let metric = TableMetric::of(&interval.metric);
            let signed = |value: f64| metric.signed(value);
            let mean = interval.mean.map_or("-".to_owned(), signed);
            let ends =
                interval.ends.map_or(String::new(), |[low, high]| format!(" [{}, {}]", signed(low), signed(high)));
            let missing = match interval.seeds < self.seeds {
                true => format!(" ({} of {} seeds)", interval.seeds, self.seeds),
                false => String::new(),
            };
            format!("{} {mean}{ends}{missing}", metric.label)
        };
        let intervals: Vec<String> = self.intervals.iter().map(of).collect();
        let effect = self.effect.map_or("not known", Effect::word);
        let provisional = self.effect.is_some() && !self.is_complete() && !self.is_harmed_for_good();
        format!("{effect}{}: {}", if provisional { " so far" } else { "" }, intervals.join("; "))
    }

    /// Whether every seed has a metric.
    fn has_all(&self, interval: &Interval) -> bool {
        interval.seeds == self.seeds
    }

    /// Whether every seed has every metric, and there are enough of them for an interval.
    fn is_complete(&self) -> bool {
        self.seeds > 1 && self.intervals.iter().all(|interval| self.has_all(interval))
    }

    /// Whether harm is shown by all seeds that there will be.
    fn is_harmed_for_good(&self) -> bool {
        self.intervals.iter().any(|interval| interval.side == Some(Side::Worse) && self.has_all(interval))
    }
}

/// Judges every difference among the rows, which are made from these cells.
pub(super) fn of(rule: &Rule, rows: &[Row], columns: &[Column], cells: &[TrainedCell]) -> Vec<Verdict> {
    let judged = rows.iter().filter_map(|row| match &row.method {
        Method::Difference { variant, minus, values } => Some((row, variant, minus, values)),
        Method::Trained { .. } | Method::Literature(_) => None,
    });
    let verdict = |(row, variant, minus, values): (&Row, &String, &String, &Vec<String>)| {
        let on_scene = |scene: &RuleScene| {
            let of = |variant: &str| {
                let is_own = |(cell, _): &&TrainedCell| {
                    cell.variant == variant && cell.values == *values && cell.scene == scene.scene
                };
                cells.iter().filter(is_own).copied().collect::<Vec<TrainedCell>>()
            };
            on_scene(rule, scene, (row, columns), &pairs(&of(variant), &of(minus)))
        };
        let scenes: Vec<SceneVerdict> = rule.scenes.iter().map(on_scene).collect();
        let applied = || scenes.iter().filter(|scene| scene.applies);
        let can_help = |scene: &&SceneVerdict| !scene.is_complete() || scene.effect == Some(Effect::Helps);
        let recommended = if scenes.iter().any(SceneVerdict::is_harmed_for_good) {
            Some(false)
        } else if applied().count() < rule.least_helped {
            // Only harm could decide.
            None
        } else if applied().filter(can_help).count() < rule.least_helped {
            Some(false)
        } else {
            // Harm by all seeds was decided above, so help is all that is left to count.
            applied().all(SceneVerdict::is_complete).then_some(true)
        };
        Verdict { variant: variant.clone(), minus: minus.clone(), values: values.clone(), recommended, scenes }
    };
    judged.map(verdict).collect()
}

/// Whether both cells are finished, for each seed of which there are two.
fn pairs(own: &[TrainedCell], others: &[TrainedCell]) -> Vec<bool> {
    let is_finished = |outcome: &Outcome| matches!(outcome, Outcome::Metrics(_));
    let pair = |(cell, outcome): &TrainedCell| {
        let (_, other) = others.iter().find(|(other, _)| other.seed == cell.seed)?;
        Some(is_finished(outcome) && is_finished(other))
    };
    own.iter().filter_map(pair).collect()
}

fn on_scene(rule: &Rule, of: &RuleScene, (row, columns): (&Row, &[Column]), pairs: &[bool]) -> SceneVerdict {
    let shown = |name: &String| {
        let is_of_scene = |column: &Column| column.scenes == [of.scene.clone()] && column.metric.name == *name;
        columns.iter().zip(&row.entries).find(|(column, _)| is_of_scene(column))
    };
    let found: Vec<(&Column, &Entry)> = of.metrics.iter().filter_map(shown).collect();
    let intervals: Vec<Interval> =
        found.iter().map(|(column, entry)| interval(&column.metric, entry, rule.confidence)).collect();
    // A missing metric may hide help, but not harm.
    let sides: Vec<Option<Side>> = intervals.iter().map(|interval| interval.side).collect();
    let effect = match sides.iter().copied().collect::<Option<Vec<Side>>>() {
        _ if sides.contains(&Some(Side::Worse)) => Some(Effect::Harms),
        Some(sides) if !sides.is_empty() && sides.iter().all(|side| *side == Side::Better) => Some(Effect::Helps),
        Some(_) => Some(Effect::Undecided),
        None => None,
    };
    SceneVerdict {
        scene: of.scene.clone(),
        intervals,
        applies: found.iter().any(|(_, entry)| entry.state != State::Unknown),
        seeds: pairs.len(),
        finished_seeds: pairs.iter().filter(|is_finished| **is_finished).count(),
        effect,
    }
}

/// The t-interval of the mean of an entry's differences.
fn interval(metric: &TableMetric, entry: &Entry, confidence: f64) -> Interval {
    let seeds = entry.seeds.len();
    let ends = entry.spread.and_then(|spread| {
        let freedom = (seeds - 1) as f64;
        let quantile = StudentsT::new(0.0, 1.0, freedom).ok()?.inverse_cdf(0.5 + 0.5 * confidence);
        let half = quantile * spread.deviation? / (seeds as f64).sqrt();
        Some([spread.mean - half, spread.mean + half])
    });
    let mean = entry.spread.map(|spread| spread.mean);
    Interval { metric: metric.name.clone(), seeds, mean, ends, side: side(metric.better, ends) }
}

/// The side of 0 on which an interval lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Side {
    Better,
    Worse,
    Both,
}

fn side(better: Option<Better>, ends: Option<[f64; 2]>) -> Option<Side> {
    let [low, high] = ends?;
    let (is_above, is_below) = (low > 0.0, high < 0.0);
    Some(match better? {
        Better::Higher if is_above => Side::Better,
        Better::Lower if is_below => Side::Better,
        _ if is_above || is_below => Side::Worse,
        _ => Side::Both,
    })
}

#[cfg(test)]
mod tests;
