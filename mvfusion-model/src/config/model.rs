//! Size of the deformation network.

use mvfusion_render::grid::GridLayout;
use serde::{Deserialize, Serialize};

use super::keys::{keys, leaves};

/// The branches and the deformation network (METHOD §2, §9).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ModelConfig {
    /// Which branches there are.
    pub branches: Branches,
    /// What is seen where no Gaussian is.
    pub background: Background,
    /// Whom a pixel belongs to that no dynamic Gaussian covers.
    pub uncovered: Uncovered,
    /// Whether the dynamic Gaussians move at all; switched off for comparison only.
    pub deformation: bool,
    /// Whether opacities change over time (4DGS' `no_do`, inverted).
    pub deform_opacity: bool,
    /// Whether colours change over time (4DGS' `no_dshs`, inverted).
    pub deform_sh: bool,
    /// Width `H` of trunk and heads (DeGauss: 128).
    pub width: usize,
    /// Linear layers of the trunk; 0 and 1 both mean one (METHOD §2.2).
    pub depth: usize,
    /// The HexPlane grid.
    pub grid: GridConfig,
    /// Highest degree of the spherical harmonics (3DGS: 3).
    pub sh_degree: usize,
    /// Whether each dynamic Gaussian has a moment, a duration and a velocity of its own beside the deformation. Ours, as
    /// Spacetime Gaussians and FreeTimeGS have it: what a deformation cannot carry, such as a ball that flies a tenth of
    /// the room from frame to frame. Off in the paper's presets.
    pub lifetime: bool,
    /// Whether every training camera has an affine map of colours of its own, as 3DGS' exposure compensation, learned beside
    /// the scene. A held-out camera sees their mean. For rigs whose cameras differ in gain or white balance.
    pub exposure: bool,
    /// Gaussians nearer to a camera than this share of the capture's near bound are not drawn; where there is no bound, or
    /// 3DGS' 0.2 units are more, those hold. 0 leaves 3DGS' rule alone.
    pub near_share: f64,
}

/// Which branches a model has.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Branches {
    /// A static and a dynamic one, blended by a learned mask (DeGauss, MVFusion-GS).
    Both,
    /// A dynamic one alone, which shows the whole scene (4DGS, METHOD §9).
    Dynamic,
}

/// Whom a pixel belongs to that no dynamic Gaussian covers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Uncovered {
    /// Half to each branch, and the static one at half its brightness (DeGauss: near black in every channel of the
    /// mask; METHOD §1.2). So dynamic Gaussians have to cover the whole picture.
    Undecided,
    /// The static branch, as it is. Ours: so dynamic Gaussians can be where something moves.
    Static,
}

impl Uncovered {
    /// Mask probabilities behind all Gaussians, one for each [`MaskChannel`](crate::model::mask::MaskChannel).
    pub fn masks(self) -> [f64; 3] {
        /// Near black (METHOD §1.2).
        const NOTHING: f64 = 1e-7;
        match self {
            Self::Undecided => [NOTHING; 3],
            // A brightness of a half leaves the static branch as it is (METHOD §1.3, step 3).
            Self::Static => [1.0, 0.5, NOTHING],
        }
    }
}

/// The colour behind all Gaussians.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Background {
    /// Near black (DeGauss: 1e-7; METHOD §1.3).
    Black,
    /// White (4DGS).
    White,
}

impl Background {
    /// Level of every colour channel.
    pub fn level(self) -> f64 {
        match self {
            Self::Black => 1e-7,
            Self::White => 1.0,
        }
    }
}

impl Default for ModelConfig {
    fn default() -> Self {
        Self {
            branches: Branches::Both,
            background: Background::Black,
            uncovered: Uncovered::Undecided,
            deformation: true,
            deform_opacity: true,
            deform_sh: true,
            width: 128,
            depth: 1,
            grid: GridConfig::default(),
            sh_degree: 3,
            lifetime: false,
            exposure: false,
            near_share: 0.9,
        }
    }
}

/// The HexPlane grid (METHOD §2.1; numbers of DeGauss' Neu3D config).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GridConfig {
    /// Features a plane and scale.
    pub features: usize,
    /// Cells along x, y, z and time at scale 1. The upper half of those in time is read (METHOD §2.1).
    pub resolution: [usize; 4],
    /// What the cells in time go by (4DGS, DeGauss: `"fixed"`).
    pub time_rows: TimeRows,
    /// What the grid spans.
    pub bounds: GridBoundsRule,
    /// Factors of the spatial resolution, one a scale; time keeps its resolution.
    pub multipliers: Vec<usize>,
}

/// What the number of cells in time goes by.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TimeRows {
    /// `resolution[3]`, whatever the scene.
    Fixed,
    /// The distinct times of the training views. Photos: eight for each, of which four are read, or `resolution[3]` if
    /// that is more, so that unrelated moments share no cells. Video: two for each frame, of which one is read, or
    /// `resolution[3]` if that is less. Ours. A run writes the number that it found into its configuration, as
    /// `"fixed"`.
    ByTimes,
}

/// What the HexPlane grid spans. What lies outside is clamped and moves as the border does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GridBoundsRule {
    /// The dynamic branch before the first step, without a margin (DeGauss).
    Cloud,
    /// What moves, with a margin, where `init.motion_points` finds it; else as `cloud`. Ours: cells are of use where
    /// something moves, and a room is a hundred times as large.
    Motion,
}

impl Default for GridConfig {
    fn default() -> Self {
        Self {
            features: 16,
            bounds: GridBoundsRule::Cloud,
            resolution: [64, 64, 64, 150],
            time_rows: TimeRows::Fixed,
            multipliers: vec![1, 2, 4],
        }
    }
}

impl GridConfig {
    /// The layout of the planes in memory.
    pub fn layout(&self) -> GridLayout {
        GridLayout { features: self.features, resolution: self.resolution, multipliers: self.multipliers.clone() }
    }
}

keys!(ModelConfig {
    branches: ANY,
    background: ANY,
    uncovered: ANY,
    deformation: ANY,
    deform_opacity: ANY,
    deform_sh: ANY,
    width: FROM_1.saying("a network needs at least one unit"),
    depth: ANY,
    grid: ANY,
    sh_degree: ANY,
    lifetime: ANY,
    exposure: ANY,
    near_share: SHARE,
});

keys!(GridConfig {
    features: FROM_1.saying("a plane needs at least one feature"),
    resolution: ANY,
    time_rows: ANY,
    bounds: ANY,
    multipliers: ANY,
});

leaves!(Branches, Background, Uncovered, TimeRows, GridBoundsRule);
