//! The Gaussians of a run at keyframes, and what each of them contributes to the training views.

use glam::DVec3;
use mvfusion_data::keyframes::{Keyframes, KeyframesBuilder, Reduction};
use mvfusion_data::{Camera, GaussianCloud, View};
use mvfusion_model::evaluation::contributions;
use mvfusion_model::model::gaussians::SH_C0;
use mvfusion_model::model::harmonics::mean_colours;
use mvfusion_model::timeline::spread;

use super::budget::{Cut, KeyframeTimes, cuts, keyframe_times, strongest};
use super::position_step::position_step;
use crate::export::{Exporter, Moment, eyes};
use crate::progress::{Progress, Verbosity};
use crate::run::OpenRun;

/// Training views in which the contributions of static Gaussians are measured, and least number for dynamic ones.
const VIEWS: usize = 48;
/// Least number of views of each keyframe, because a Gaussian may live only then.
const VIEWS_OF_KEYFRAME: usize = 3;
/// Longest side of the images in which contributions are measured. Gaussians that are smaller than their pixels seem
/// larger then, so that none is taken for too faint.
const LONGEST_SIDE: usize = 320;
/// A Gaussian that contributes less than an 8-bit level of one pixel to every measured view is left out.
const FAINTEST: f32 = 1.0 / 255.0;

/// The Gaussians of a branch with what each of them contributes.
struct Branch {
    keyframes: Keyframes,
    /// Rows that can be seen.
    rows: Vec<usize>,
    /// Largest contribution of each Gaussian to a measured view.
    contributions: Vec<f32>,
}

/// What a page is made of.
pub(super) struct Source {
    static_: Option<Branch>,
    dynamic: Branch,
    /// Times of the keyframes of the dynamic branch.
    times: KeyframeTimes,
    /// Centres of training cameras.
    eyes: Vec<DVec3>,
}

impl Source {
    /// Evaluates the model at the keyframes.
    ///
    /// # Errors
    /// If the device fails.
    pub fn of(run: &OpenRun, exporter: &Exporter, verbosity: Verbosity) -> anyhow::Result<Self> {
        let model = &exporter.model;
        let static_degree = model.static_.as_ref().map_or(0, |branch| branch.sh_degree);
        let still = exporter.static_()?.map(|cloud| cloud.at_degree(static_degree));
        let at = |time: f64| -> anyhow::Result<GaussianCloud> {
            Ok(exporter.dynamic(Moment::At(time))?.at_degree(model.dynamic.sh_degree))
        };
        let times = exporter.context.timeline.times();
        let first = at(times[0])?;
        let step = position_step(&run.scene, exporter.context.near, still.iter().chain([&first]));
        let (chosen, eyes) = (keyframe_times(times, first.len()), eyes(&run.scene));
        let mut progress = Progress::new("keyframes", chosen.times.len(), verbosity);
        let mut builder = KeyframesBuilder::new(&first, step);
        let mut measured = Contributions::new(run, exporter, first.len());
        let mut colours = Vec::new();
        for (place, &time) in chosen.times.iter().enumerate() {
            let cloud = at(time)?;
            builder.push(time, &cloud);
            colours.push(mean_colours(&cloud, &eyes));
            let views: Vec<&View> = run.scene.train.iter().filter(|view| view.time == time).collect();
            let count = VIEWS_OF_KEYFRAME.max(VIEWS.div_ceil(times.len())).min(views.len());
            // Evenly spaced, beginning with another one at each keyframe.
            let views = (0..count).map(|number| views[(place + number * views.len() / count) % views.len()]);
            measured.measure(&cloud, views)?;
            progress.advance();
        }
        progress.finish();
        let mut keyframes = builder.finish();
        keep_colours(&mut keyframes, &colours, &eyes);
        let dynamic = Branch::new(keyframes, measured.largest);

        let static_ = still.map(|cloud| -> anyhow::Result<Branch> {
            let mut builder = KeyframesBuilder::new(&cloud, step);
            builder.push(times[0], &cloud);
            let mut keyframes = builder.finish();
            keep_colours(&mut keyframes, &[mean_colours(&cloud, &eyes)], &eyes);
            let mut measured = Contributions::new(run, exporter, cloud.len());
            let train = &run.scene.train;
            measured.measure(&cloud, spread(train.len(), VIEWS).into_iter().map(|index| &train[index]))?;
            Ok(Branch::new(keyframes, measured.largest))
        });
        Ok(Self { static_: static_.transpose()?, dynamic, times: chosen, eyes })
    }

    /// The cuts to try, in order.
    pub fn cuts(&self) -> Vec<Cut> {
        let branches = self.static_.iter().chain([&self.dynamic]);
        let degree = branches.map(|branch| branch.keyframes.sh_degree()).max().unwrap_or(0);
        cuts(&self.times, degree)
    }

    /// The branches after a cut, the static one first if there is one.
    pub fn after(&self, cut: Cut) -> Vec<Keyframes> {
        self.static_.iter().chain([&self.dynamic]).map(|branch| self.branch_after(branch, cut)).collect()
    }

    /// A branch after a cut. Constant colours take over the mean, over the training cameras, of the colours that are
    /// left out or rounded away, at each keyframe.
    fn branch_after(&self, branch: &Branch, cut: Cut) -> Keyframes {
        let rows = strongest(&branch.rows, &branch.contributions, cut.share);
        let mut reduced = branch.keyframes.reduced(&rows, cut.reduction);
        let sh_degree = branch.keyframes.sh_degree();
        if reduced.sh_degree() < sh_degree || cut.reduction.step_factor > 1 {
            let whole = branch.keyframes.reduced(&rows, Reduction { step_factor: 1, sh_degree, ..cut.reduction });
            let seen = |&time: &f64| mean_colours(&whole.at(time), &self.eyes);
            let wanted: Vec<_> = whole.times().iter().map(seen).collect();
            keep_colours(&mut reduced, &wanted, &self.eyes);
        }
        reduced
    }
}

impl Branch {
    fn new(keyframes: Keyframes, contributions: Vec<f32>) -> Self {
        let mut rows = keyframes.visible_rows();
        rows.retain(|&row| contributions[row] >= FAINTEST);
        if rows.is_empty() && keyframes.count() > 0 {
            rows.push(0);
        }
        Self { keyframes, rows, contributions }
    }
}

/// Shifts the constant colours at each keyframe so that each Gaussian has the mean colour of `wanted` there, over the
/// training cameras. The higher coefficients, which are the same at all keyframes, would give it another one.
fn keep_colours(keyframes: &mut Keyframes, wanted: &[Vec<[f32; 3]>], eyes: &[DVec3]) {
    for (keyframe, wanted) in wanted.iter().enumerate() {
        let found = mean_colours(&keyframes.at(keyframes.times()[keyframe]), eyes);
        let shift = |(wanted, found): (&[f32; 3], &[f32; 3])| [0, 1, 2].map(|c| (wanted[c] - found[c]) / SH_C0 as f32);
        let shifts: Vec<_> = wanted.iter().zip(&found).map(shift).collect();
        keyframes.shift_sh_dc(keyframe, &shifts);
    }
}

/// Measures what the Gaussians of a branch contribute to views.
struct Contributions<'a> {
    run: &'a OpenRun,
    exporter: &'a Exporter,
    /// Largest contribution of each Gaussian to a view so far.
    largest: Vec<f32>,
}

impl<'a> Contributions<'a> {
    fn new(run: &'a OpenRun, exporter: &'a Exporter, count: usize) -> Self {
        Self { run, exporter, largest: vec![0.0; count] }
    }

    fn measure<'v>(&mut self, cloud: &GaussianCloud, views: impl Iterator<Item = &'v View>) -> anyhow::Result<()> {
        for view in views {
            let Camera { width, height, .. } = view.camera;
            let shrunk = (LONGEST_SIDE as f64 / width.max(height) as f64).min(1.0);
            let side = |pixels: usize| ((shrunk * pixels as f64).round() as usize).max(1);
            let camera = view.camera.resized(side(width), side(height));
            let area = (width * height) as f32 / (camera.width * camera.height) as f32;
            let found = contributions(cloud, &camera, &self.exporter.context, &self.run.device.device)?;
            self.largest.iter_mut().zip(found).for_each(|(largest, found)| *largest = largest.max(area * found));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use mvfusion_data::rest_width;

    use super::*;

    /// Opaque Gaussians of degree 1 whose higher coefficients change with time. The first one is brighter than white.
    fn cloud(time: f32) -> GaussianCloud {
        let count = 3;
        GaussianCloud {
            sh_degree: 1,
            means: (0..count).map(|i| [i as f32 + time, 0.5, 0.0]).collect(),
            sh_dc: (0..count).map(|i| [3.0 - i as f32, 1.0, 0.5]).collect(),
            sh_rest: (0..count * rest_width(1)).map(|i| 0.2 * time * (i as f32).cos()).collect(),
            opacity_logits: vec![2.0; count],
            log_scales: vec![[-3.0; 3]; count],
            quaternions: vec![[1.0, 0.0, 0.0, 0.0]; count],
            mask_logits: None,
            lifetimes: None,
        }
    }

    const TIMES: [f64; 3] = [0.0, 0.5, 1.0];

    fn keyframes() -> Keyframes {
        let mut builder = KeyframesBuilder::new(&cloud(0.0), 1e-3);
        TIMES.iter().for_each(|&time| builder.push(time, &cloud(time as f32)));
        builder.finish()
    }

    /// Asserts that mean colours are those of [`cloud`] up to some roundings of the constant coefficients.
    fn assert_colours(frames: &Keyframes, eyes: &[DVec3], roundings: f32) {
        let bound = roundings * 0.29 * 0.5 / 128.0;
        for time in TIMES {
            let pairs = mean_colours(&frames.at(time), eyes).into_iter().zip(mean_colours(&cloud(time as f32), eyes));
            for (found, wanted) in pairs {
                let off = found.iter().zip(wanted).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
                assert!(off <= bound, "{found:?}, not {wanted:?}, at {time}");
            }
        }
    }

    #[test]
    fn gaussians_keep_their_mean_colours_at_all_keyframes_even_above_white_and_with_fewer_degrees() {
        let eyes = [DVec3::new(4.0, 1.0, 2.0), DVec3::new(-3.0, 0.5, -6.0)];
        let mut frames = keyframes();
        let wanted: Vec<_> = TIMES.iter().map(|&time| mean_colours(&cloud(time as f32), &eyes)).collect();
        assert!(wanted[0][0][0] > 1.1);
        keep_colours(&mut frames, &wanted, &eyes);
        assert_colours(&frames, &eyes, 1.0);
        let source = Source {
            static_: None,
            dynamic: Branch::new(frames, vec![1.0; 3]),
            times: KeyframeTimes { times: TIMES.to_vec(), trained: 1 },
            eyes: eyes.to_vec(),
        };
        let reduction = Reduction { step_factor: 1, stride: 1, sh_degree: 0 };
        let [flat] = &source.after(Cut { reduction, share: 1.0 })[..] else { panic!("one branch") };
        assert_eq!(flat.sh_degree(), 0);
        assert_colours(flat, &eyes, 2.0);
    }

    #[test]
    fn gaussians_that_no_view_shows_are_left_out() {
        let rows = |contributions: [f32; 3]| Branch::new(keyframes(), contributions.to_vec()).rows;
        assert_eq!(rows([0.5 / 255.0, 2.0 / 255.0, 1.0]), [1, 2]);
        assert_eq!(rows([0.0; 3]), [0], "no op takes an empty tensor");
    }
}
