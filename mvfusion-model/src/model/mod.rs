//! The whole model: two branches, the deformation network, the motion-aware refinement.

pub mod alive;
pub mod composition;
pub mod exposure;
pub mod gaussians;
pub mod mask;
pub mod motion;
pub mod network;
pub mod rows;

use burn::module::Module;
use burn::tensor::Tensor;
use mvfusion_data::Camera;
use mvfusion_render::splat::{SplatPicture, SplatRules, SplatSettings, Statistic};

use crate::ModelError;
use crate::config::MotionConfig;
use crate::model::alive::AliveRows;
use crate::model::exposure::Exposures;
use crate::model::gaussians::{Behind, Gaussians, RawGaussians};
use crate::model::motion::{MotionCache, MotionRefinement, RefinementConfig};
use crate::model::network::DeformationNetwork;
use crate::timeline::Timeline;

/// What is learned, and nothing else.
#[derive(Module, Debug)]
pub struct Model {
    /// Gaussians that move.
    pub dynamic: Gaussians,
    /// Gaussians that do not; none in a model of one branch.
    pub static_: Option<Gaussians>,
    /// How the dynamic Gaussians move.
    pub network: DeformationNetwork,
    /// How motion statistics and neighbouring frames correct that.
    pub refinement: MotionRefinement,
    /// What the training cameras make of colours, where `model.exposure` asks for it. Pictures of the model are in the
    /// colours that all cameras agree on, so only training makes use of it.
    pub exposures: Option<Exposures>,
    /// Motion descriptors of the dynamic Gaussians, once they were measured: not learned, but what the refinement reads.
    #[module(skip)]
    pub motion: Option<MotionCache>,
}

/// What a model needs to know of the scene and the run to render a time.
#[derive(Clone, Debug)]
pub struct RenderContext {
    /// The times of the training views.
    pub timeline: Timeline,
    /// The scene's extent.
    pub extent: f64,
    /// How motion is measured.
    pub motion: MotionConfig,
    /// Whether the gradient of the mask channels counts for densification.
    pub mask_gradient: bool,
    /// Depth before which nothing is drawn, world units.
    pub near: f64,
    /// What is seen where no Gaussian is.
    pub behind: Behind,
}

/// How far the dynamic Gaussians are moved.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DeformationLevel {
    /// Not at all: canonical Gaussians.
    Still,
    /// By the deformation network.
    Base,
    /// By the deformation network under motion-aware refinement.
    Refined,
}

/// The branches as seen from one camera at one time.
#[derive(Clone, Debug)]
pub struct BranchPictures {
    /// Dynamic branch: colour, alpha, depth, and mask features where there is a static branch to be blended with.
    pub dynamic: SplatPicture,
    /// Static branch: colour, alpha, depth.
    pub static_: Option<SplatPicture>,
    /// Foreground probability of the dynamic Gaussians at this time, without autodiff: `[N, 1]`; where there is a mask.
    pub foreground: Option<Tensor<2>>,
}

/// The leaves through which the screen-space gradients leave the backward pass, one a branch.
#[derive(Clone, Debug)]
pub struct Probes {
    /// Of the dynamic branch.
    pub dynamic: Tensor<2>,
    /// Of the static branch.
    pub static_: Tensor<2>,
}

impl Probes {
    /// Fresh probes on the device and in the dtype of the dynamic Gaussians.
    ///
    /// The dynamic one has a row for each Gaussian where views see different ones of them, by their lifetimes.
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

    /// The same model but for MFTA: the paper's cheaper inference. `None` where MFTA has no effect at that level anyway.
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

    /// The dynamic Gaussians at a time: alive by their lifetimes, moved by the network. Refinement falls back to the base
    /// deformation until motion was measured.
    pub fn dynamic_at(&self, time: f64, level: DeformationLevel, context: &RenderContext) -> RawGaussians {
        self.rows_at(None, time, level, context)
    }

    /// The same for some of them.
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
        let means = match alive {
            Some(alive) => self.dynamic.means.val().select(0, alive.rows().clone()),
            None => self.dynamic.means.val(),
        };
        let cache = self.motion.clone().map(|cache| match alive {
            Some(alive) => cache.select(alive.rows()),
            None => cache,
        });
        let offsets = match (level, &cache) {
            (DeformationLevel::Still, _) => return gaussians,
            (DeformationLevel::Refined, Some(cache)) => {
                let config = RefinementConfig { timeline: &context.timeline, cache, extent: context.extent };
                self.refinement.offsets(&self.network, means, time, &config)
            }
            _ => {
                let feature = self.network.feature(means.clone(), crate::tensors::scalar_like(&means, time));
                self.network.decode(feature)
            }
        };
        gaussians.deformed(offsets)
    }

    /// Renders the branches.
    ///
    /// # Errors
    /// If the splat op refuses its input.
    pub fn render(
        &self,
        camera: &Camera,
        time: f64,
        level: DeformationLevel,
        probes: Option<&Probes>,
        context: &RenderContext,
    ) -> Result<BranchPictures, ModelError> {
        let alive = AliveRows::of(&self.dynamic, time)?;
        let moved = self.rows_at(alive.as_ref(), time, level, context);
        let mut foreground = moved.foreground_probability();
        let features = moved.mask_features();
        let settings = context.splat_settings(self.dynamic.sh_degree, context.mask_gradient);
        let probe = probes.map(|probes| match &alive {
            Some(alive) => probes.dynamic.clone().select(0, alive.rows().clone()),
            None => probes.dynamic.clone(),
        });
        let mut dynamic = moved.splat(features, probe, camera, &settings, context.behind)?;
        if let Some(alive) = &alive {
            dynamic.radii = alive.among_all_int(dynamic.radii);
            foreground = foreground.map(|probability| alive.among_all(probability));
        }

        let static_ = self.static_picture(camera, probes.map(|p| p.static_.clone()), context)?;
        Ok(BranchPictures { dynamic, static_, foreground })
    }

    /// Renders the static branch, if there is one.
    pub(crate) fn static_picture(
        &self,
        camera: &Camera,
        probe: Option<Tensor<2>>,
        context: &RenderContext,
    ) -> Result<Option<SplatPicture>, ModelError> {
        let Some(branch) = &self.static_ else { return Ok(None) };
        let settings = context.splat_settings(branch.sh_degree, false);
        let still = branch.canonical();
        Ok(Some(still.splat(None, probe, camera, &settings, context.behind)?))
    }
}

impl RenderContext {
    /// Settings of a branch's splat.
    pub(crate) fn splat_settings(&self, sh_degree: usize, mask_gradient: bool) -> SplatSettings {
        let statistic = if mask_gradient { Statistic::AllChannels } else { Statistic::ColourAndDepth };
        let rules = SplatRules { near: self.near, ..SplatRules::inria() };
        SplatSettings { rules, sh_degree, statistic }
    }
}
