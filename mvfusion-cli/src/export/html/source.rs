//! The Gaussians of a run at keyframes, and what each of them contributes to the training views.

use glam::DVec3;
use mvfusion_data::keyframes::{Keyframes, KeyframesBuilder, Reduction};
use mvfusion_data::{Camera, GaussianCloud, View};
use mvfusion_model::evaluation::contributions;
use mvfusion_model::model::gaussians::SH_C0;
use mvfusion_model::model::harmonics::mean_colours;
use mvfusion_model::timeline::spread;

use super::budget::{Cut, KeyframeTimes, cuts, keyframe_times, strongest};
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
/// Gaussians and views that determine the step of the centres.
const STEP_SAMPLES: usize = 2000;
/// Quantile of the pixel sizes, from the smallest, of which the step is a fraction.
const NEAR_QUANTILE: f64 = 0.05;
/// Steps of a centre in a pixel of the training views. Errors are at most half a step.
const STEPS_IN_PIXEL: f64 = 32.0;
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
        let step = position_step(run, exporter.context.near, still.iter().chain([&first]));
        let (chosen, eyes) = (keyframe_times(times, first.len()), eyes(&run.scene));
        let mut progress = Progress::new("keyframes", chosen.times.len(), verbosity);
        let mut builder = KeyframesBuilder::new(&first, step);
        let mut strength = Strength::new(run, exporter, first.len());
        let mut colours = Vec::new();
        for (place, &time) in chosen.times.iter().enumerate() {
            let cloud = at(time)?;
            builder.push(time, &cloud);
            colours.push(mean_colours(&cloud, &eyes));
            let views: Vec<&View> = run.scene.train.iter().filter(|view| view.time == time).collect();
            let count = VIEWS_OF_KEYFRAME.max(VIEWS.div_ceil(times.len())).min(views.len());
            // Evenly spaced, beginning with another one at each keyframe.
            let views = (0..count).map(|number| views[(place + number * views.len() / count) % views.len()]);
            strength.measure(&cloud, views)?;
            progress.advance();
        }
        progress.finish();
        let mut keyframes = builder.finish();
        keep_colours(&mut keyframes, &colours, &eyes);
        let dynamic = Branch::new(keyframes, strength.largest);

        let static_ = still.map(|cloud| -> anyhow::Result<Branch> {
            let mut builder = KeyframesBuilder::new(&cloud, step);
            builder.push(times[0], &cloud);
            let mut strength = Strength::new(run, exporter, cloud.len());
            let train = &run.scene.train;
            strength.measure(&cloud, spread(train.len(), VIEWS).into_iter().map(|index| &train[index]))?;
            Ok(Branch::new(builder.finish(), strength.largest))
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
    /// left out.
    fn branch_after(&self, branch: &Branch, cut: Cut) -> Keyframes {
        let rows = strongest(&branch.rows, &branch.contributions, cut.share);
        let mut reduced = branch.keyframes.reduced(&rows, cut.reduction);
        let sh_degree = branch.keyframes.sh_degree();
        if reduced.sh_degree() < sh_degree {
            let whole = branch.keyframes.reduced(&rows, Reduction { sh_degree, ..cut.reduction });
            let start = whole.times().first().copied().unwrap_or(0.0);
            let seen = |frames: &Keyframes| mean_colours(&frames.at(start), &self.eyes);
            // What is left out is the same at all keyframes.
            let shifts = shifts(&seen(&whole), &seen(&reduced));
            (0..reduced.times().len()).for_each(|keyframe| reduced.shift_base(keyframe, &shifts));
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
        keyframes.shift_base(keyframe, &shifts(wanted, &found));
    }
}

/// The shifts of constant coefficients that turn colours into others.
fn shifts(wanted: &[[f32; 3]], found: &[[f32; 3]]) -> Vec<[f32; 3]> {
    let shift = |(wanted, found): (&[f32; 3], &[f32; 3])| [0, 1, 2].map(|c| (wanted[c] - found[c]) / SH_C0 as f32);
    wanted.iter().zip(found).map(shift).collect()
}

/// Measures what the Gaussians of a branch contribute to views.
struct Strength<'a> {
    run: &'a OpenRun,
    exporter: &'a Exporter,
    /// Largest contribution of each Gaussian to a view so far.
    largest: Vec<f32>,
}

impl<'a> Strength<'a> {
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

/// The step of centres in world units: a fraction of the size that a pixel of the training views has at the nearer
/// Gaussians.
fn position_step<'a>(run: &OpenRun, near: f64, clouds: impl Iterator<Item = &'a GaussianCloud>) -> f64 {
    let train = &run.scene.train;
    let mut sizes = Vec::new();
    for cloud in clouds {
        for (place, index) in spread(cloud.len(), STEP_SAMPLES).into_iter().enumerate() {
            let camera = &train[place * train.len() / STEP_SAMPLES].camera;
            let centre = DVec3::from_array(cloud.means[index].map(f64::from));
            let depth = camera.to_camera(centre).z;
            let is_inside = camera.project(centre).is_some_and(|pixel| {
                (0.0..camera.width as f64).contains(&pixel.x) && (0.0..camera.height as f64).contains(&pixel.y)
            });
            if depth > near && is_inside {
                sizes.push(depth / camera.fx.max(camera.fy));
            }
        }
    }
    sizes.sort_by(f64::total_cmp);
    let size = sizes.get((NEAR_QUANTILE * sizes.len() as f64) as usize).copied();
    size.unwrap_or(1e-3 * run.scene.extent().max(1e-3)) / STEPS_IN_PIXEL
}
