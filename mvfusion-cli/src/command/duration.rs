//! How long a training would take, as `check` predicts it.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::Duration;

use anyhow::{anyhow, bail};
use mvfusion_data::Scene;
use mvfusion_model::Config;
use mvfusion_model::duration::{RunTime, StageTime};
use mvfusion_model::evaluation::Protocol;
use mvfusion_model::memory::MemoryNeed;
use serde::Serialize;

use super::score;
use crate::clock::spoken;
use crate::memory::Available;
use crate::{device, lpips};

/// Time for the measurement. A user waits for it.
const BUDGET: Duration = Duration::from_secs(20);

/// The predicted time of a run, and what it holds for.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Predicted {
    #[serde(flatten)]
    time: RunTime,
    /// The device, as `--device` names it.
    device: String,
    /// CPU threads.
    threads: usize,
}

impl Predicted {
    /// Trains a few steps. `config` is not scaled yet.
    ///
    /// # Errors
    /// If the run could not be trained here, or the time does not suffice. A panic of a driver is an error, too.
    pub fn measure(config: &Config, scene: &Scene, memory: &MemoryNeed, device: &str) -> anyhow::Result<Self> {
        let measured = catch_unwind(AssertUnwindSafe(|| Self::measured(config, scene, memory, device)));
        measured.unwrap_or_else(|_| Err(anyhow!("the device failed")))
    }

    fn measured(config: &Config, scene: &Scene, memory: &MemoryNeed, device: &str) -> anyhow::Result<Self> {
        let device = device::open(device)?;
        let needed = memory.host() + if device.computes_on_host { memory.start } else { 0.0 };
        if let Some(available) = Available::on_this_machine().filter(|available| needed > available.bytes as f64) {
            bail!("the first steps already need more than the memory: {}", available.sentence());
        }
        let config = config.for_times_of(scene).scaled();
        let weights = lpips::find(config.eval.lpips_weights.as_deref())?;
        let evaluator = score::evaluator(Protocol::Mvfusion, weights.as_ref(), &device.device)?;
        let time = RunTime::predict(&config, scene, &device.device, &evaluator, BUDGET)?;
        let time = time.ok_or_else(|| anyhow!("even the first steps take longer than {} s", BUDGET.as_secs()))?;
        Ok(Self { time, device: device.name, threads: rayon::current_num_threads() })
    }

    /// The prediction in two lines, of which `indent` begins the second.
    pub fn sentence(&self, indent: &str) -> String {
        let RunTime { seconds, stages, evaluation, .. } = &self.time;
        let threads = if self.threads == 1 { "1 thread".to_owned() } else { format!("{} threads", self.threads) };
        let steps: usize = stages.iter().map(|stage| stage.steps).sum();
        let training: f64 = stages.iter().map(StageTime::seconds).sum();
        let last = stages.last().map_or(String::new(), |last| {
            let of_static = if last.static_ == 0 { String::new() } else { format!(" and {} static", last.static_) };
            format!(", if the last stage has {} dynamic{of_static} Gaussians", last.dynamic)
        });
        format!(
            "about {} on this machine ({}, {threads})\n{indent}{} for {steps} steps, {} for the evaluation{last}",
            spoken(*seconds),
            self.device,
            spoken(training),
            spoken(*evaluation),
        )
    }
}

#[cfg(test)]
mod tests {
    use mvfusion_model::train::Stage;

    use super::*;

    #[test]
    fn a_prediction_is_said_with_what_it_holds_for() {
        let stage = StageTime {
            stage: Stage::Refinement,
            steps: 20_000,
            seconds_per_step: 0.9,
            dynamic: 9000,
            static_: 40_000,
        };
        let time =
            RunTime { seconds: 18_120.0, start: 20.0, stages: vec![stage], evaluation: 100.0, measured_share: 1.0 };
        let said = Predicted { time, device: "flex".to_owned(), threads: 16 }.sentence("    ");
        assert_eq!(
            said,
            "about 5 h 02 min on this machine (flex, 16 threads)\n    5 h 00 min for 20000 steps, 1 min 40 s for the \
             evaluation, if the last stage has 9000 dynamic and 40000 static Gaussians"
        );
    }
}
