//! The whole model: branches, deformation network, and motion-aware refinement.

pub mod alive;
pub mod composition;
mod crop;
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
use crate::model::exposure::Exposures;
use crate::model::gaussians::{Behind, Gaussians, RawGaussians, splat_frames};
use crate::model::motion::{MotionCache, MotionRefinement, RefinedFeature, RefinementConfig, Substitutes};
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
    pub behind: Behind,
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
    /// Foreground probability of the dynamic Gaussians at this time, without autodiff: `[N, 1]`; only with a mask.
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

    /// All dynamic Gaussians at a time, with lifetimes and deformation. Refinement falls back to the base deformation
    /// until motion was measured.
    pub fn dynamic_at(&self, time: f64, level: DeformationLevel, context: &RenderContext) -> RawGaussians {
        self.rows_at(None, time, level, context)
    }

    /// The same for the rows that are alive.
    pub(crate) fn rows_at(
        &self,
        alive: Option<&AliveRows>,
        time: f64,
        level: DeformationLevel,
        context: &RenderContext,
    ) -> RawGaussians {
        let of_rows = |gaussians: RawGaussians| match alive {
            Some(alive) => gaussians.select(alive.rows()),
            None => gaussians,
        };
        let gaussians = of_rows(self.dynamic.at(time));
        if level == DeformationLevel::Still {
            return gaussians;
        }
        let means = self.means_of(alive);
        let refined = match level {
            DeformationLevel::Still | DeformationLevel::Base => None,
            DeformationLevel::Refined => self
                .refine(alive, context, |config| self.refinement.offsets(&self.network, means.clone(), time, config)),
        };
        let offsets = match refined {
            Some(offsets) => offsets,
            None => {
                let feature = self.network.feature(means.clone(), crate::tensors::scalar_like(&means, time));
                self.network.decode(feature)
            }
        };
        gaussians.deformed(offsets)
    }

    /// The refined feature of the rows that are alive; `None` until motion was measured.
    pub(crate) fn refined_feature(
        &self,
        alive: Option<&AliveRows>,
        time: f64,
        context: &RenderContext,
    ) -> Option<RefinedFeature> {
        let means = self.means_of(alive);
        self.refine(alive, context, |config| self.refinement.feature(&self.network, means, time, config))
    }

    /// The mean entropy of MFTA's attention over the rows that are alive, in nats: `[1]`. `None` without attention, or
    /// until motion was measured.
    pub(crate) fn attention_entropy(
        &self,
        alive: Option<&AliveRows>,
        time: f64,
        context: &RenderContext,
    ) -> Option<Tensor<1>> {
        let means = self.means_of(alive);
        self.refine(alive, context, |config| self.refinement.entropy(&self.network, means, time, config)).flatten()
    }

    /// Canonical centres of the rows that are alive, or of all.
    fn means_of(&self, alive: Option<&AliveRows>) -> Tensor<2> {
        match alive {
            Some(alive) => self.dynamic.means.val().select(0, alive.rows().clone()),
            None => self.dynamic.means.val(),
        }
    }

    /// Evaluates the refinement of the rows that are alive; `None` until motion was measured.
    fn refine<T>(
        &self,
        alive: Option<&AliveRows>,
        context: &RenderContext,
        evaluate: impl FnOnce(&RefinementConfig<'_>) -> T,
    ) -> Option<T> {
        let cache = self.motion.clone()?;
        let (cache, substitutes) = match alive {
            Some(alive) => (cache.select(alive.rows()), self.substitutes.select(alive.rows())),
            None => (cache, self.substitutes.clone()),
        };
        let RenderContext { timeline, extent, .. } = context;
        let config = RefinementConfig { timeline, cache: &cache, extent: *extent, substitutes: &substitutes };
        Some(evaluate(&config))
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
        let (mut frames, mut foregrounds) = (Vec::new(), Vec::new());
        for ((camera, time), alive) in views.iter().zip(&alive) {
            let (frame, foreground) = self.dynamic_frame(camera, *time, alive.as_ref(), level, probes, context);
            frames.push(frame);
            foregrounds.push(foreground);
            frames.extend(self.static_frame(camera, probes.map(|probes| probes.static_.clone()), context));
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

    /// The frame of the dynamic branch, and the foreground probability of all its Gaussians.
    fn dynamic_frame(
        &self,
        camera: &Camera,
        time: f64,
        alive: Option<&AliveRows>,
        level: DeformationLevel,
        probes: Option<&Probes>,
        context: &RenderContext,
    ) -> (SplatFrame, Option<Tensor<2>>) {
        let moved = self.rows_at(alive, time, level, context);
        let foreground = moved.foreground_probability();
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
        (moved.into_frame(features, probe, camera, &settings, context.behind), foreground)
    }

    /// The frame of the static branch, if there is one.
    fn static_frame(&self, camera: &Camera, probe: Option<Tensor<2>>, context: &RenderContext) -> Option<SplatFrame> {
        let branch = self.static_.as_ref()?;
        let settings = context.splat_settings(branch.sh_degree, false);
        Some(branch.canonical().into_frame(None, probe, camera, &settings, context.behind))
    }

    /// Renders the static branch, if there is one.
    pub(crate) fn static_picture(
        &self,
        camera: &Camera,
        context: &RenderContext,
    ) -> Result<Option<SplatPicture>, ModelError> {
        Ok(splat_frames(self.static_frame(camera, None, context).into_iter().collect())?.pop())
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
