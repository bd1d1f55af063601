//! Series of runs in which one factor grows and all else stays.

use std::str::FromStr;

use anyhow::{Context, Result, ensure};
use clap::ValueEnum;
use mvfusion_data::builtin::{BuiltinKind, builtin};
use mvfusion_data::{BuiltinOptions, Scene};

use super::scene::SceneSize;

/// Frames of each camera, where they do not vary. More of them do not change a step, but take long to draw.
const FRAMES: usize = 4;

/// What varies in a series.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Factor {
    /// Gaussians of both branches together, in the proportion of the first scene.
    Gaussians,
    /// Size of the images, as WIDTHxHEIGHT.
    Pixels,
    /// Frames of each camera of the video.
    Frames,
    /// Photos with passers-by, each of its own moment.
    Images,
}

/// A run to measure: a built-in scene and numbers of Gaussians.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Run {
    /// Dynamic Gaussians.
    pub dynamic: usize,
    /// Static Gaussians.
    pub still: usize,
    /// The scene.
    pub scene: BuiltinOptions,
}

impl Run {
    /// A run on a short video.
    pub fn new(size: &SceneSize, still: usize) -> Self {
        let &SceneSize { count, width, height } = size;
        let scene = BuiltinOptions { width, height, frames: FRAMES, ..BuiltinOptions::default() };
        Self { dynamic: count, still, scene }
    }

    /// Makes the scene.
    pub fn scene(&self) -> Scene {
        builtin(&self.scene)
    }

    /// The run in words.
    pub fn name(&self) -> String {
        let Self { dynamic, still, scene } = self;
        let images = match scene.kind {
            BuiltinKind::Casual => format!("{} photos", scene.photos),
            _ => format!("{} frames", scene.frames),
        };
        format!("{still} static and {dynamic} dynamic Gaussians, {}x{}, {images}", scene.width, scene.height)
    }
}

impl Factor {
    /// Heading of its column and axis.
    pub fn title(self) -> &'static str {
        match self {
            Self::Gaussians => "Gaussians",
            Self::Pixels => "pixels",
            Self::Frames => "frames",
            Self::Images => "images",
        }
    }

    /// The values of a series that none were given for.
    fn values(self) -> &'static [&'static str] {
        match self {
            Self::Gaussians => &["5000", "10000", "20000", "50000", "100000", "200000"],
            Self::Pixels => &["160x120", "320x240", "640x480", "1352x1014"],
            Self::Frames => &["24", "75", "150", "300"],
            Self::Images => &["24", "60", "150", "300"],
        }
    }

    /// The runs of a series that starts from `first`, each with its value on the axis.
    pub fn series(self, first: &Run, values: &[String]) -> Result<Vec<(f64, Run)>> {
        let defaults = || self.values().iter().map(|value| (*value).to_owned()).collect();
        let values: Vec<String> = if values.is_empty() { defaults() } else { values.to_vec() };
        values.iter().map(|value| self.run(first, value)).collect()
    }

    fn run(self, first: &Run, value: &str) -> Result<(f64, Run)> {
        let number = || {
            let number = value.parse::<usize>().with_context(|| format!("`{value}` is no number"))?;
            ensure!(number > 0, "there is nothing to measure with {} = 0", self.title());
            Ok(number)
        };
        let mut run = *first;
        let x = match self {
            Self::Gaussians => {
                let all = number()?;
                run.dynamic = (all * first.dynamic / (first.dynamic + first.still)).max(1);
                run.still = all - run.dynamic;
                all
            }
            Self::Pixels => {
                // Read as a scene is, whose number of Gaussians is not used.
                let size = SceneSize::from_str(&format!("1@{value}"));
                let size = size.with_context(|| format!("`{value}` is no size; write WIDTHxHEIGHT, as 320x240"))?;
                (run.scene.width, run.scene.height) = (size.width, size.height);
                size.width * size.height
            }
            Self::Frames => {
                run.scene.frames = number()?;
                run.scene.frames
            }
            Self::Images => {
                run.scene.kind = BuiltinKind::Casual;
                run.scene.photos = number()?;
                run.scene.photos
            }
        };
        Ok((x as f64, run))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn first() -> Run {
        Run::new(&SceneSize { count: 4000, width: 160, height: 120 }, 12_000)
    }

    #[test]
    fn one_factor_varies_and_the_others_stay() {
        for &factor in Factor::value_variants() {
            let series = factor.series(&first(), &[]).expect("the defaults are valid");
            assert!(series.is_sorted_by(|a, b| a.0 < b.0), "{factor:?}");
            for (_, run) in series {
                let Run { dynamic, still, scene } = run;
                assert_eq!(
                    (dynamic, still) != (4000, 12_000),
                    factor == Factor::Gaussians && dynamic + still != 16_000
                );
                assert!((scene.width, scene.height) == (160, 120) || factor == Factor::Pixels);
                assert!(scene.frames == FRAMES || factor == Factor::Frames);
                assert_eq!(scene.kind == BuiltinKind::Casual, factor == Factor::Images);
            }
        }
    }

    #[test]
    fn values_are_read_as_their_factor_is_counted() {
        let read = |factor: Factor, value: &str| factor.series(&first(), &[value.to_owned()]).map(|series| series[0]);
        let (x, run) = read(Factor::Gaussians, "800").expect("a number");
        assert_eq!((x, run.dynamic, run.still), (800.0, 200, 600));
        let (x, run) = read(Factor::Pixels, "32x24").expect("a size");
        assert_eq!((x, run.scene.width, run.scene.height), (768.0, 32, 24));
        for (factor, value) in [(Factor::Pixels, "768"), (Factor::Frames, "0"), (Factor::Images, "many")] {
            assert!(read(factor, value).is_err(), "{value}");
        }
    }
}
