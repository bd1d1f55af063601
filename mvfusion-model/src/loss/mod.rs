//! The training objective: a main loss that also drives densification, and a light loss that does not (METHOD §4.4);
//! or the single loss of a model of one branch (§9).

mod light;
mod main;
mod schedule;
mod single;
pub mod terms;

pub use light::light_loss;
pub use main::main_loss;
pub use schedule::LossSchedule;
pub use single::single_loss;

use burn::tensor::Tensor;
use burn::tensor::module::avg_pool2d;
use burn::tensor::ops::AvgPoolOptions;
use mvfusion_render::window::Window;

use crate::births::{LEAST_ERROR, LEAST_SHARE, PATCH};
use crate::composition::Composition;

/// One copy of a batch's pictures: the op renders each twice, one for each loss.
#[derive(Clone, Debug)]
pub struct Pictures {
    /// The blended pictures.
    pub composition: Composition,
    /// Accumulated depth of the dynamic branch, world units: `[B, 1, H, W]`.
    pub dynamic_depth: Tensor<4>,
    /// Accumulated depth of the static branch: `[B, 1, H, W]`.
    pub static_depth: Tensor<4>,
}

impl Pictures {
    /// The pictures with their colours black where the photos do not count (`[B, 1, H, W]`: 1 where they do), as the photos
    /// are there: no comparison with a photo sees what is drawn there. Terms that compare with none (order of depths, entropy of
    /// the mask, brightness) hold everywhere.
    pub fn within(self, counted: Option<&Tensor<4>>) -> Self {
        let blend = self.composition;
        let composition = Composition {
            composed: within(blend.composed, counted),
            dynamic: within(blend.dynamic, counted),
            static_: within(blend.static_, counted),
            lit: within(blend.lit, counted),
            ..blend
        };
        Self { composition, ..self }
    }
}

/// A picture, black where the photos do not count.
pub fn within(picture: Tensor<4>, counted: Option<&Tensor<4>>) -> Tensor<4> {
    match counted {
        // The mask is a constant of the graph.
        Some(counted) => picture * Tensor::from_inner(counted.clone()),
        None => picture,
    }
}

/// Where something was seen to move in a batch: `[B, 1, H, W]` each, 1 there and 0 elsewhere, without autodiff.
#[derive(Clone, Debug)]
pub struct MotionMasks {
    /// The pixels that move.
    pub moving: Tensor<4>,
    /// The same, grown by some pixels: an edge is a blend of both branches.
    pub around: Tensor<4>,
    /// 1 where nothing moves, neither there nor around.
    pub still: Tensor<4>,
    /// What says so.
    pub seen_by: MotionWitness,
}

/// What says that something moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MotionWitness {
    /// A camera that stands still, whose pixels differ from their median over time.
    StillCamera,
    /// The static branch, from which a photo differs. It may differ as well because that branch has yet to learn, so it
    /// learns there all the same, and the mask is left to the picture.
    StaticBranch,
}

impl MotionMasks {
    /// Where photos `[B, 3, H, W]` differ from what the static branch shows there, by the rule of [`births`](crate::births).
    pub fn by_difference(photos: &Tensor<4>, static_: Tensor<4>) -> Self {
        let difference = (photos.clone() - static_.clamp(0.0, 1.0)).abs().max_dim(1);
        let dtype = difference.dtype();
        let wrong = difference.greater_equal_elem(LEAST_ERROR).float().cast(dtype);
        let reach = PATCH / 2;
        // Pixels outside of the picture count as right, as they do for births.
        let square =
            AvgPoolOptions::new([PATCH; 2]).with_stride([1; 2]).with_padding([reach; 2]).with_count_include_pad(true);
        let share = avg_pool2d(wrong.clone(), square);
        let moving = wrong * share.greater_equal_elem(LEAST_SHARE).float().cast(dtype);
        Self::new(moving.clone(), moving, MotionWitness::StaticBranch)
    }

    /// From the pixels that move and those around them.
    pub fn new(moving: Tensor<4>, around: Tensor<4>, seen_by: MotionWitness) -> Self {
        Self { still: -around.clone() + 1.0, moving, around, seen_by }
    }

    /// Without the pixels that do not count (`[B, 1, H, W]`: 1 where they do): they neither move nor stand still.
    pub fn within(self, counted: Option<&Tensor<4>>) -> Self {
        let Some(counted) = counted else { return self };
        let [moving, around, still] = [self.moving, self.around, self.still].map(|mask| mask * counted.clone());
        Self { moving, around, still, ..self }
    }
}

/// What the losses compare with, and where training stands.
#[derive(Clone, Debug)]
pub struct LossContext<'a> {
    /// The photos, black where they do not count: `[B, 3, H, W]` in `[0, 1]`.
    pub photos: &'a Tensor<4>,
    /// Where something was seen to move; absent if nothing is known.
    pub motion: Option<&'a MotionMasks>,
    /// Weights.
    pub config: &'a crate::config::LossConfig,
    /// Where training stands.
    pub schedule: LossSchedule,
    /// The scene's extent.
    pub extent: f64,
    /// The windows of the structural terms.
    pub windows: &'a Windows,
}

impl LossContext<'_> {
    /// 1 where the dynamic branch learns whatever its mask says, if the configuration leaves that to motion and it is known.
    fn dynamic_region(&self) -> Option<Tensor<4>> {
        self.motion.filter(|_| self.config.dynamic_where_moving).map(|motion| motion.around.clone())
    }

    /// 1 where the static branch may learn, likewise.
    pub(crate) fn static_region(&self) -> Option<Tensor<4>> {
        let motion = self.sure_motion().filter(|_| self.config.static_where_still)?;
        Some(motion.still.clone())
    }

    /// Motion that was seen by other means than the branches themselves.
    fn sure_motion(&self) -> Option<&MotionMasks> {
        self.motion.filter(|motion| motion.seen_by == MotionWitness::StillCamera)
    }
}

/// The two Gaussian windows of the structural terms.
#[derive(Clone, Debug)]
pub struct Windows {
    /// 11 pixels, sigma 1.5: SSIM.
    pub ssim: Window,
    /// 5 pixels, sigma 1.5: the structure comparison of the two branches.
    pub structure: Window,
}

impl Default for Windows {
    fn default() -> Self {
        Self { ssim: Window::gaussian(11, 1.5), structure: Window::gaussian(5, 1.5) }
    }
}
