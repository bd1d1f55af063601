//! The whole model: two branches, the deformation network, the motion-aware refinement.

use burn::module::Module;
use burn::tensor::Tensor;
use mvfusion_data::Camera;
use mvfusion_render::splat::{SplatPicture, SplatRules, SplatSettings, Statistic};

use crate::ModelError;
use crate::config::MotionConfig;
use crate::densify::Branch;
use crate::gaussians::RawGaussians;
use crate::motion::{MotionCache, MotionRefinement, RefinementConfig};
use crate::network::DeformationNetwork;
use crate::timeline::Timeline;

/// All that is learned, with what training keeps about the Gaussians.
#[derive(Clone, Debug)]
pub struct Model {
    /// Gaussians that move.
    pub dynamic: Branch,
    /// Gaussians that do not; none in a model of one branch.
    pub static_: Option<Branch>,
    /// How the dynamic Gaussians move.
    pub network: DeformationNetwork,
    /// How motion statistics and neighbouring frames correct that.
    pub refinement: MotionRefinement,
    /// Motion descriptors of the dynamic Gaussians, once they were measured.
    pub motion: Option<MotionCache>,
}

/// What a model needs to know of the scene and the run to render a time.
#[derive(Clone, Debug)]
pub struct Surroundings {
    /// The times of the training views.
    pub timeline: Timeline,
    /// The scene's extent.
    pub extent: f64,
    /// Switches of the motion modules.
    pub motion: MotionConfig,
    /// Whether the gradient of the mask channels counts for densification.
    pub mask_gradient: bool,
    /// Depth before which nothing is drawn, world units.
    pub near: f64,
    /// Level of the colour channels behind all Gaussians.
    pub background: f64,
}

/// How far the dynamic Gaussians are moved.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Movement {
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
    /// Fresh probes on the device and in the dtype of `like`.
    pub fn new(like: &Tensor<2>) -> Self {
        let leaf = || Tensor::zeros([1, 2], (&like.device().inner(), like.dtype())).autodiff().require_grad();
        Self { dynamic: leaf(), static_: leaf() }
    }
}

impl Model {
    /// The model without autodiff, for evaluation. Shares its memory.
    pub fn plain(&self) -> Self {
        let branch = |branch: &Branch| Branch { gaussians: branch.gaussians.valid(), ..branch.clone() };
        Self {
            dynamic: branch(&self.dynamic),
            static_: self.static_.as_ref().map(branch),
            network: self.network.valid(),
            refinement: self.refinement.valid(),
            motion: self.motion.clone(),
        }
    }

    /// The branches by name, the dynamic one first.
    pub fn branches(&self) -> impl Iterator<Item = (&'static str, &Branch)> {
        std::iter::once(("dynamic", &self.dynamic)).chain(self.static_.iter().map(|branch| ("static", branch)))
    }

    /// The dynamic Gaussians at a time. Refinement falls back to the base deformation until motion was measured.
    pub fn dynamic_at(&self, time: f64, movement: Movement, surroundings: &Surroundings) -> RawGaussians {
        let canonical = self.dynamic.gaussians.canonical();
        let means = canonical.means.clone();
        let offsets = match (movement, &self.motion) {
            (Movement::Still, _) => return canonical,
            (Movement::Refined, Some(cache)) => {
                let config = RefinementConfig {
                    motion: &surroundings.motion,
                    timeline: &surroundings.timeline,
                    cache,
                    extent: surroundings.extent,
                };
                self.refinement.offsets(&self.network, means, time, &config)
            }
            _ => {
                let feature = self.network.feature(means.clone(), crate::tensors::scalar_like(&means, time));
                self.network.decode(feature)
            }
        };
        canonical.deformed(offsets)
    }

    /// Renders the branches.
    ///
    /// # Errors
    /// If the splat op refuses its input.
    pub fn render(
        &self,
        camera: &Camera,
        time: f64,
        movement: Movement,
        probes: Option<&Probes>,
        surroundings: &Surroundings,
    ) -> Result<BranchPictures, ModelError> {
        let background = surroundings.background;
        let moved = self.dynamic_at(time, movement, surroundings);
        let foreground = moved.foreground_probability();
        let features = moved.mask_features();
        let settings = surroundings.splat_settings(self.dynamic.sh_degree, surroundings.mask_gradient);
        let dynamic = moved.splat(features, probes.map(|p| p.dynamic.clone()), camera, &settings, background)?;

        let static_ = self.static_picture(camera, probes.map(|p| p.static_.clone()), surroundings)?;
        Ok(BranchPictures { dynamic, static_, foreground })
    }

    /// Renders the static branch, if there is one.
    pub(crate) fn static_picture(
        &self,
        camera: &Camera,
        probe: Option<Tensor<2>>,
        surroundings: &Surroundings,
    ) -> Result<Option<SplatPicture>, ModelError> {
        let Some(branch) = &self.static_ else { return Ok(None) };
        let settings = surroundings.splat_settings(branch.sh_degree, false);
        let still = branch.gaussians.canonical();
        Ok(Some(still.splat(None, probe, camera, &settings, surroundings.background)?))
    }
}

impl Surroundings {
    /// The same but for MFTA: the paper's cheaper inference. `None` where the model makes no use of it anyway.
    pub fn without_mfta(&self, model: &Model, movement: Movement) -> Option<Self> {
        let is_used = movement == Movement::Refined && self.motion.mfta && model.motion.is_some();
        let motion = MotionConfig { mfta: false, ..self.motion.clone() };
        is_used.then(|| Self { motion, ..self.clone() })
    }

    /// Settings of a branch's splat.
    pub(crate) fn splat_settings(&self, sh_degree: usize, mask_gradient: bool) -> SplatSettings {
        let statistic = if mask_gradient { Statistic::AllChannels } else { Statistic::ColourAndDepth };
        let rules = SplatRules { near: self.near, ..SplatRules::inria() };
        SplatSettings { rules, sh_degree, statistic }
    }
}
