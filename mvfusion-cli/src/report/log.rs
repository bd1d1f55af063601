//! Reader of `metrics.jsonl`, the log of a training.

use serde::Deserialize;

use super::curve::{Mark, Point};

/// A line. Numbers that were not finite are absent.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct LogLine {
    /// Steps done in the whole run.
    pub step: usize,
    /// Name of the stage.
    pub stage: String,
    /// Step within the stage, from 1.
    pub stage_step: usize,
    /// Loss.
    #[serde(default)]
    pub loss: Option<f64>,
    /// PSNR of the step's batch, dB.
    #[serde(default)]
    pub psnr: Option<f64>,
    /// Numbers of Gaussians.
    #[serde(default)]
    pub gaussians: Counts,
    /// Steps per second.
    #[serde(default)]
    pub steps_per_second: Option<f64>,
}

/// Numbers of Gaussians.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(default)]
pub struct Counts {
    /// Of the static branch.
    #[serde(rename = "static")]
    pub static_: Option<f64>,
    /// Of the dynamic branch.
    pub dynamic: Option<f64>,
}

/// The lines of a training.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Log {
    /// The readable lines, by step.
    pub lines: Vec<LogLine>,
    /// Number of unreadable lines.
    pub unreadable: usize,
}

impl Log {
    /// Reads the lines. A truncated line, for example after a full disk, does not affect the others.
    pub fn parse(text: &str) -> Self {
        let mut log = Self::default();
        for line in text.lines().filter(|line| !line.trim().is_empty()) {
            match serde_json::from_str(line) {
                Ok(line) => log.lines.push(line),
                Err(_) => log.unreadable += 1,
            }
        }
        log.lines.sort_by_key(|line| line.step);
        log
    }

    /// A curve. Absent values are gaps.
    pub fn curve(&self, value: impl Fn(&LogLine) -> Option<f64>) -> Vec<Point> {
        let point = |line: &LogLine| Point { x: line.step as f64, y: value(line).unwrap_or(f64::NAN) };
        self.lines.iter().map(point).collect()
    }

    /// The starts of the stages that have a line.
    pub fn stages(&self) -> Vec<Mark> {
        let mut marks: Vec<Mark> = Vec::new();
        for line in &self.lines {
            if marks.last().is_none_or(|mark| mark.name != line.stage) {
                marks.push(Mark { x: line.step.saturating_sub(line.stage_step) as f64, name: line.stage.clone() });
            }
        }
        marks
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = r#"
{"step":4,"stage":"geometry","stage_step":4,"loss":1.5,"psnr":10.0,"gaussians":{"dynamic":3},"steps_per_second":2.0}
{"step":8,"stage":"refinement","stage_step":2,"loss":null,"gaussians":{"static":5,"dynamic":3}}
{"step":12,"stage":"refi"#;

    #[test]
    fn a_line_that_was_cut_short_costs_no_other() {
        let log = Log::parse(TEXT);
        assert_eq!((log.lines.len(), log.unreadable), (2, 1));
        assert_eq!(log.lines[1].gaussians, Counts { static_: Some(5.0), dynamic: Some(3.0) });
        let loss = log.curve(|line| line.loss);
        assert_eq!(loss[0], Point { x: 4.0, y: 1.5 });
        assert!(loss[1].y.is_nan());
    }

    #[test]
    fn stages_begin_where_their_first_lines_say() {
        let mark = |x, name: &str| Mark { x, name: name.to_owned() };
        assert_eq!(Log::parse(TEXT).stages(), [mark(0.0, "geometry"), mark(6.0, "refinement")]);
        assert!(Log::parse("\n\n").stages().is_empty());
    }
}
