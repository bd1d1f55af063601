//! The Gaussians of a run at keyframes, and what each of them contributes to the training views.

use mvfusion_data::keyframes::{Keyframes, KeyframesBuilder};
use mvfusion_data::{GaussianCloud, View};
use mvfusion_model::evaluation::contributions;
use mvfusion_model::timeline::spread;

use super::budget::{self, Reduction, strongest};
use crate::export::{Exporter, Moment};
use crate::progress::{Progress, Verbosity};
use crate::run::OpenRun;

/// Training views in which contributions are measured.
const VIEWS: usize = 32;
/// Gaussians and views that determine the step of the centres.
const STEP_SAMPLES: usize = 2000;
/// Quantile of the pixel sizes, from the smallest, of which the step is a fraction.
const NEAR_QUANTILE: f64 = 0.05;
/// Steps of a centre in a pixel of the training views. Errors are at most half a step.
const STEPS_IN_PIXEL: f64 = 32.0;
/// A Gaussian that contributes less than an 8-bit level of one pixel to every measured view is left out.
const FAINTEST: f32 = 1.0 / 255.0;
/// Most dynamic Gaussians times keyframes, which bounds the memory of the player: 34 bytes of each.
const MOST_STATES: usize = 4_000_000;

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
}

impl Source {
    /// Evaluates the model at the keyframes.
    ///
    /// # Errors
    /// If the device fails.
    pub fn of(run: &OpenRun, exporter: &Exporter, verbosity: Verbosity) -> anyhow::Result<Self> {
        let degree = |cloud: GaussianCloud, degree: usize| cloud.at_degree(degree);
        let model = &exporter.model;
        let still = exporter.static_()?.map(|cloud| degree(cloud, model.static_.as_ref().map_or(0, |b| b.sh_degree)));
        let at = |time: f64| -> anyhow::Result<GaussianCloud> {
            Ok(degree(exporter.dynamic(Moment::At(time))?, model.dynamic.sh_degree))
        };
        let times = exporter.context.timeline.times();
        let first = at(times[0])?;
        let step = position_step(run, exporter.context.near, still.iter().chain([&first]));
        let chosen = spread(times.len(), (MOST_STATES / first.len().max(1)).max(2));
        let mut progress = Progress::new("keyframes", chosen.len(), verbosity);
        let mut builder = KeyframesBuilder::new(&first, step);
        for index in chosen {
            builder.push(times[index], &at(times[index])?);
            progress.advance();
        }
        progress.finish();
        let keyframes = builder.finish();

        let views: Vec<&View> = spread(run.scene.train.len(), VIEWS).into_iter().map(|i| &run.scene.train[i]).collect();
        let mut progress = Progress::new("contributions", views.len(), verbosity);
        let mut sums = [vec![0.0; still.as_ref().map_or(0, GaussianCloud::len)], vec![0.0; keyframes.count()]];
        for view in views {
            let moving = at(view.time)?;
            for (sums, cloud) in sums.iter_mut().zip([still.as_ref(), Some(&moving)]) {
                let Some(cloud) = cloud else { continue };
                let found = contributions(cloud, &view.camera, &exporter.context, &run.device.device)?;
                sums.iter_mut().zip(found).for_each(|(largest, found)| *largest = f32::max(*largest, found));
            }
            progress.advance();
        }
        progress.finish();
        let [of_static, of_dynamic] = sums;
        let static_ = still.map(|cloud| {
            let mut builder = KeyframesBuilder::new(&cloud, step);
            builder.push(times[0], &cloud);
            Branch::new(builder.finish(), of_static)
        });
        Ok(Self { static_, dynamic: Branch::new(keyframes, of_dynamic) })
    }

    /// The reductions to try, in order.
    pub fn reductions(&self) -> Vec<Reduction> {
        let branches = self.static_.iter().chain([&self.dynamic]);
        let degree = branches.map(|branch| branch.keyframes.sh_degree()).max().unwrap_or(0);
        budget::reductions(self.dynamic.keyframes.times().len(), degree)
    }

    /// The branches after a reduction, the static one first if there is one.
    pub fn reduced(&self, reduction: Reduction) -> Vec<Keyframes> {
        let Reduction { stride, sh_degree, share } = reduction;
        let reduced = |branch: &Branch| {
            branch.keyframes.reduced(&strongest(&branch.rows, &branch.contributions, share), stride, sh_degree)
        };
        self.static_.iter().chain([&self.dynamic]).map(reduced).collect()
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

/// The step of centres in world units: a fraction of the size that a pixel of the training views has at the nearer
/// Gaussians.
fn position_step<'a>(run: &OpenRun, near: f64, clouds: impl Iterator<Item = &'a GaussianCloud>) -> f64 {
    let train = &run.scene.train;
    let mut sizes = Vec::new();
    for cloud in clouds {
        for (place, index) in spread(cloud.len(), STEP_SAMPLES).into_iter().enumerate() {
            let camera = &train[place * train.len() / STEP_SAMPLES].camera;
            let centre = glam::DVec3::from_array(cloud.means[index].map(f64::from));
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
