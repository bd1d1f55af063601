//! The whole model: branches, deformation network, and motion-aware refinement.

pub mod alive;
pub mod composition;
mod crop;
mod deformed;
pub mod exposure;
pub mod gaussians;
pub mod harmonics;
pub mod mask;
mod moment;
pub mod motion;
pub mod network;
pub mod rows;

use burn::module::Module;
use burn::tensor::Tensor;
use mvfusion_data::Camera;
use mvfusion_render::splat::{SplatFrame, SplatPicture, SplatRules, SplatSettings, Statistic};

use crate::ModelError;
use crate::config::MotionConfig;
use crate::model::alive::AliveRows;
use crate::model::deformed::Rows;
pub(crate) use crate::model::deformed::moments_together;
use crate::model::exposure::Exposures;
use crate::model::gaussians::{BackgroundLevels, Gaussians, RawGaussians, splat_frames};
use crate::model::motion::{MotionCache, MotionRefinement, Substitutes};
use crate::model::network::DeformationNetwork;
use crate::timeline::Timeline;

pub use crop::{Crop, CropError, Kept, OrientedBox};
pub use moment::Moment;

/// Everything that is learned, and the measured motion descriptors.
#[derive(Module, Debug)]
pub struct Model {
    /// Dynamic Gaussians.
    pub dynamic: Gaussians,
    /// Static Gaussians; `None` in a model with one branch.
    pub static_: Option<Gaussians>,
    /// The deformation of the dynamic Gaussians.
    pub network: DeformationNetwork,
    /// The refinement of the deformation by motion statistics and neighbouring frames.
    pub refinement: MotionRefinement,
    /// The colour maps of the training cameras, with `model.exposure`. Renders use the scene's own colours, so only
    /// training applies the maps.
    pub exposures: Option<Exposures>,
    /// Motion descriptors of the dynamic Gaussians, once they were measured. They are not learned; the refinement reads
    /// them.
    #[module(skip)]
    pub motion: Option<MotionCache>,
    /// What stands in for the outputs of the motion-aware modules, in an evaluation of their worth.
    #[module(skip)]
    pub substitutes: Substitutes,
}

/// The data of the scene and the run that a model needs to render a time.
#[derive(Clone, Debug)]
pub struct RenderContext {
    /// The times of the training views.
    pub timeline: Timeline,
    /// The scene's extent.
    pub extent: f64,
    /// Settings of the motion statistics.
    pub motion: MotionConfig,
    /// Whether the gradient of the mask channels enters densification.
    pub mask_gradient: bool,
    /// Near plane in world units.
    pub near: f64,
    /// The background behind all Gaussians.
    pub background: BackgroundLevels,
}

/// The level of deformation of the dynamic Gaussians.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DeformationLevel {
    /// No deformation: canonical Gaussians.
    Still,
    /// The deformation network.
    Base,
    /// The deformation network with motion-aware refinement.
    Refined,
}

/// The renders of the branches from one camera at one time.
#[derive(Clone, Debug)]
pub struct BranchPictures {
    /// Dynamic branch: colour, alpha, depth, and mask features if there is a static branch.
    pub dynamic: SplatPicture,
    /// Static branch: colour, alpha, depth.
    pub static_: Option<SplatPicture>,
    /// Foreground probability of the dynamic Gaussians at this time, without autodiff: `[N, 1]`; only with a mask and
    /// probes.
    pub foreground: Option<Tensor<2>>,
}

/// The leaves that receive the screen-space gradients, one per branch.
#[derive(Clone, Debug)]
pub struct Probes {
    /// Probe of the dynamic branch.
    pub dynamic: Tensor<2>,
    /// Probe of the static branch.
    pub static_: Tensor<2>,
}

impl Probes {
    /// New probes with the device and dtype of the dynamic Gaussians.
    ///
    /// With lifetimes, each view has different dynamic Gaussians, so their probe has one row per Gaussian.
    pub fn new(dynamic: &Gaussians) -> Self {
        let like = dynamic.means.val();
        let leaf = |rows| Tensor::zeros([rows, 2], (&like.device().inner(), like.dtype())).autodiff().require_grad();
        let rows = if dynamic.time_centres.is_some() { dynamic.count() } else { 1 };
        Self { dynamic: leaf(rows), static_: leaf(1) }
    }
}

impl Model {
    /// The model without autodiff, for evaluation: [`Module::valid`]. Shares its memory.
    pub fn plain(&self) -> Self {
        self.valid()
    }

    /// The same model without MFTA: the paper's cheaper inference. `None` if MFTA has no effect at that level.
    pub fn without_mfta(&self, level: DeformationLevel) -> Option<Self> {
        let has_effect =
            level == DeformationLevel::Refined && self.refinement.temporal.is_some() && self.motion.is_some();
        has_effect.then(|| {
            let mut model = self.clone();
            model.refinement.temporal = None;
            model
        })
    }

    /// The branches by name, the dynamic one first.
    pub fn branches(&self) -> impl Iterator<Item = (&'static str, &Gaussians)> {
        std::iter::once(("dynamic", &self.dynamic)).chain(self.static_.iter().map(|branch| ("static", branch)))
    }

    /// Renders the branches.
    ///
    /// # Errors
    /// If the splat op rejects its input.
    pub fn render(
        &self,
        camera: &Camera,
        time: f64,
        level: DeformationLevel,
        probes: Option<&Probes>,
        context: &RenderContext,
    ) -> Result<BranchPictures, ModelError> {
        // Proof: there are pictures for each view.
        self.render_all(&[(*camera, time)], level, probes, context).map(|mut views| views.pop().expect("one"))
    }

    /// Renders the branches from several cameras, each at its time. The device is waited for as often as for one.
    ///
    /// # Errors
    /// If the splat op rejects its input.
    pub fn render_all(
        &self,
        views: &[(Camera, f64)],
        level: DeformationLevel,
        probes: Option<&Probes>,
        context: &RenderContext,
    ) -> Result<Vec<BranchPictures>, ModelError> {
        let times: Vec<f64> = views.iter().map(|&(_, time)| time).collect();
        let alive = AliveRows::of_all(&self.dynamic, &times)?;
        let moments: Vec<Rows<'_>> = alive.iter().map(Option::as_ref).zip(times).collect();
        let moved = self.rows_at_each(&moments, level, context);
        let still = self.static_.as_ref().map(Gaussians::canonical);
        let (mut frames, mut foregrounds) = (Vec::new(), Vec::new());
        for (((camera, _), alive), moved) in views.iter().zip(&alive).zip(moved) {
            let (frame, foreground) = self.dynamic_frame(camera, moved, alive.as_ref(), probes, context);
            frames.push(frame);
            foregrounds.push(foreground);
            let probe = probes.map(|probes| probes.static_.clone());
            frames.extend(still.clone().and_then(|still| self.static_frame(still, camera, probe, context)));
        }
        let mut pictures = splat_frames(frames)?.into_iter();
        let views = alive.into_iter().zip(foregrounds).map(|(alive, foreground)| {
            // Proof: each view has a dynamic frame, and a static one if the model has that branch.
            let mut dynamic = pictures.next().expect("a dynamic picture");
            let static_ = self.static_.as_ref().and_then(|_| pictures.next());
            if let Some(alive) = &alive {
                dynamic.radii = alive.among_all_int(dynamic.radii);
            }
            BranchPictures { dynamic, static_, foreground }
        });
        Ok(views.collect())
    }

    /// The frame of the dynamic branch, whose Gaussians that are alive have `moved`, and with probes the foreground
    /// probability of all its Gaussians.
    fn dynamic_frame(
        &self,
        camera: &Camera,
        moved: RawGaussians,
        alive: Option<&AliveRows>,
        probes: Option<&Probes>,
        context: &RenderContext,
    ) -> (SplatFrame, Option<Tensor<2>>) {
        let foreground = probes.and_then(|_| moved.foreground_probability());
        let features = moved.mask_features();
        let settings = context.splat_settings(self.dynamic.sh_degree, context.mask_gradient);
        let probe = probes.map(|probes| match alive {
            Some(alive) => probes.dynamic.clone().select(0, alive.rows().clone()),
            None => probes.dynamic.clone(),
        });
        let foreground = match alive {
            Some(alive) => foreground.map(|probability| alive.among_all(probability)),
            None => foreground,
        };
        (moved.into_frame(features, probe, camera, &settings, context.background), foreground)
    }

    /// The frame of the static branch, if there is one, with its `canonical` Gaussians.
    fn static_frame(
        &self,
        canonical: RawGaussians,
        camera: &Camera,
        probe: Option<Tensor<2>>,
        context: &RenderContext,
    ) -> Option<SplatFrame> {
        let settings = context.splat_settings(self.static_.as_ref()?.sh_degree, false);
        Some(canonical.into_frame(None, probe, camera, &settings, context.background))
    }

    /// Renders the static branch, if there is one.
    pub(crate) fn static_picture(
        &self,
        camera: &Camera,
        context: &RenderContext,
    ) -> Result<Option<SplatPicture>, ModelError> {
        let canonical = self.static_.as_ref().map(Gaussians::canonical);
        let frame = canonical.and_then(|canonical| self.static_frame(canonical, camera, None, context));
        Ok(splat_frames(frame.into_iter().collect())?.pop())
    }
}

impl RenderContext {
    /// Splat settings of a branch.
    pub(crate) fn splat_settings(&self, sh_degree: usize, mask_gradient: bool) -> SplatSettings {
        let statistic = if mask_gradient { Statistic::AllChannels } else { Statistic::ColourAndDepth };
        let rules = SplatRules { near: self.near, ..SplatRules::inria() };
        SplatSettings { rules, sh_degree, statistic }
    }
}
