//! The whole model: two branches, the deformation network, the motion-aware refinement.

use burn::module::Module;
use burn::tensor::Tensor;
use mvfusion_data::Camera;
use mvfusion_render::splat::{SplatPicture, SplatRules, SplatSettings, Statistic};

use crate::ModelError;
use crate::alive::AliveRows;
use crate::config::MotionConfig;
use crate::densify::Branch;
use crate::exposure::Exposures;
use crate::gaussians::{Behind, Gaussians, RawGaussians};
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
    /// What the training cameras make of colours, where `model.exposure` asks for it. Pictures of the model are in the
    /// colours that all cameras agree on, so only training makes use of it.
    pub exposures: Option<Exposures>,
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
    /// What is seen where no Gaussian is.
    pub behind: Behind,
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
    /// The model without autodiff, for evaluation. Shares its memory.
    pub fn plain(&self) -> Self {
        let branch = |branch: &Branch| Branch { gaussians: branch.gaussians.valid(), ..branch.clone() };
        Self {
            dynamic: branch(&self.dynamic),
            static_: self.static_.as_ref().map(branch),
            network: self.network.valid(),
            refinement: self.refinement.valid(),
            exposures: self.exposures.as_ref().map(|exposures| exposures.valid()),
            motion: self.motion.clone(),
        }
    }

    /// The branches by name, the dynamic one first.
    pub fn branches(&self) -> impl Iterator<Item = (&'static str, &Branch)> {
        std::iter::once(("dynamic", &self.dynamic)).chain(self.static_.iter().map(|branch| ("static", branch)))
    }

    /// The dynamic Gaussians at a time: alive by their lifetimes, moved by the network. Refinement falls back to the base deformation until motion was measured.
    pub fn dynamic_at(&self, time: f64, movement: Movement, surroundings: &Surroundings) -> RawGaussians {
        self.rows_at(None, time, movement, surroundings)
    }

    /// The same for some of them.
    pub(crate) fn rows_at(
        &self,
        alive: Option<&AliveRows>,
        time: f64,
        movement: Movement,
        surroundings: &Surroundings,
    ) -> RawGaussians {
        let of_rows = |gaussians: RawGaussians| match alive {
            Some(alive) => gaussians.select(alive.rows()),
            None => gaussians,
        };
        let gaussians = of_rows(self.dynamic.gaussians.at(time));
        let means = match alive {
            Some(alive) => self.dynamic.gaussians.means.val().select(0, alive.rows().clone()),
            None => self.dynamic.gaussians.means.val(),
        };
        let cache = self.motion.clone().map(|cache| match alive {
            Some(alive) => cache.select(alive.rows()),
            None => cache,
        });
        let offsets = match (movement, &cache) {
            (Movement::Still, _) => return gaussians,
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
        movement: Movement,
        probes: Option<&Probes>,
        surroundings: &Surroundings,
    ) -> Result<BranchPictures, ModelError> {
        let alive = AliveRows::of(&self.dynamic.gaussians, time)?;
        let moved = self.rows_at(alive.as_ref(), time, movement, surroundings);
        let mut foreground = moved.foreground_probability();
        let features = moved.mask_features();
        let settings = surroundings.splat_settings(self.dynamic.sh_degree, surroundings.mask_gradient);
        let probe = probes.map(|probes| match &alive {
            Some(alive) => probes.dynamic.clone().select(0, alive.rows().clone()),
            None => probes.dynamic.clone(),
        });
        let mut dynamic = moved.splat(features, probe, camera, &settings, surroundings.behind)?;
        if let Some(alive) = &alive {
            dynamic.radii = alive.among_all_int(dynamic.radii);
            foreground = foreground.map(|probability| alive.among_all(probability));
        }

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
        Ok(Some(still.splat(None, probe, camera, &settings, surroundings.behind)?))
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
