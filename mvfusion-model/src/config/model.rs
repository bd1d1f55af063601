//! The branches and the deformation network.

use mvfusion_render::grid::GridLayout;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::keys::{keys, leaves};

/// The branches and the deformation network (METHOD §2, §9).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ModelConfig {
    /// The branches of the model.
    pub branches: Branches,
    /// The colour behind all Gaussians.
    pub background: Background,
    /// The branch of pixels that no dynamic Gaussian covers.
    pub uncovered: Uncovered,
    /// Whether the dynamic Gaussians are deformed; off only for comparisons.
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
    /// Whether each dynamic Gaussian also has a moment, a duration and a velocity, as in Spacetime Gaussians and
    /// FreeTimeGS. Ours: for motion that a deformation cannot represent, such as a ball that flies a tenth of the room
    /// per frame. Off in the paper's presets.
    pub lifetime: bool,
    /// Whether every training camera has an affine colour map, learned together with the scene, as in the exposure
    /// compensation of 3DGS. A held-out camera uses their mean. For rigs whose cameras differ in gain or white balance.
    /// Ours.
    pub exposure: bool,
    /// Gaussians nearer to a camera than this fraction of the capture's near bound are not drawn. The minimum is the
    /// 0.2 units of 3DGS, which also apply without a near bound. 0 means only the rule of 3DGS. Ours.
    pub near_share: f64,
}

/// The branches of a model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Branches {
    /// A static and a dynamic branch, blended by a learned mask (DeGauss, MVFusion-GS).
    Both,
    /// Only a dynamic branch, which shows the whole scene (4DGS, METHOD §9).
    Dynamic,
}

/// The branch of pixels that no dynamic Gaussian covers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Uncovered {
    /// Half to each branch, with the static branch at half its brightness (DeGauss: near black in every channel of the
    /// mask; METHOD §1.2). Dynamic Gaussians must therefore cover the whole image.
    Undecided,
    /// The unchanged static branch. Ours: dynamic Gaussians can then stay where something moves.
    Static,
}

impl Uncovered {
    /// Mask probabilities behind all Gaussians, one for each [`MaskChannel`](crate::model::mask::MaskChannel).
    pub fn masks(self) -> [f64; 3] {
        /// Near black (METHOD §1.2).
        const NOTHING: f64 = 1e-7;
        match self {
            Self::Undecided => [NOTHING; 3],
            // A brightness control of 0.5 leaves the static branch unchanged (METHOD §1.3, step 3).
            Self::Static => [1.0, 0.5, NOTHING],
        }
    }
}

/// The colour behind all Gaussians.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
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

/// The HexPlane grid (METHOD §2.1; values of DeGauss' Neu3D config).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct GridConfig {
    /// Features per plane and scale.
    pub features: usize,
    /// Cells along x, y, z and time at scale 1. Only the upper half in time is read (METHOD §2.1).
    pub resolution: [usize; 4],
    /// The rule for the number of cells in time (4DGS, DeGauss: `"fixed"`).
    pub time_rows: TimeRows,
    /// The box of the HexPlane grid.
    pub bounds: GridBoundsRule,
    /// Factor of the spatial resolution at each scale; the time resolution does not change.
    pub multipliers: Vec<usize>,
}

/// The rule for the number of cells in time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum TimeRows {
    /// `resolution[3]`, whatever the scene.
    Fixed,
    /// By the number of distinct times of the training views. Photos: eight cells per time, of which four are read, but
    /// at least `resolution[3]`, so that unrelated moments share no cells. Video: two cells per frame, of which one is
    /// read, but at most `resolution[3]`. Ours. A run writes the result into its configuration, as `"fixed"`.
    ByTimes,
}

/// The box of the HexPlane grid. Points outside are clamped and move like its border.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum GridBoundsRule {
    /// The dynamic branch before the first step, without a margin (DeGauss).
    Cloud,
    /// The region of detected motion (`init.motion_points`), with a margin; without detected motion, like `cloud`.
    /// Ours: only cells in moving regions are useful, and a room is a hundred times as large.
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
    width: WIDTH.saying("a network needs at least one unit"),
    depth: FROM_0.to(64.0),
    grid: ANY,
    sh_degree: FROM_0.to(3.0).saying("spherical harmonics go up to degree 3"),
    lifetime: ANY,
    exposure: ANY,
    near_share: SHARE,
});

keys!(GridConfig {
    features: FROM_1.to(512.0).saying("a plane needs at least one feature"),
    resolution: FROM_1.from(2.0).to(65_536.0).saying("every axis needs at least two cells"),
    time_rows: ANY,
    bounds: ANY,
    multipliers: FROM_1.to(1024.0).saying("give at least one factor, each at least 1"),
});

leaves!(Branches, Background, Uncovered, TimeRows, GridBoundsRule);
