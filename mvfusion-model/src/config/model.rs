//! Size of the deformation network.

use mvfusion_render::grid::GridLayout;
use serde::{Deserialize, Serialize};

/// The deformation network (METHOD §2).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ModelConfig {
    /// Whether the dynamic Gaussians move at all; switched off for comparison only.
    pub deformation: bool,
    /// Width `H` of trunk and heads (DeGauss: 128).
    pub width: usize,
    /// Linear layers of the trunk; 0 and 1 both mean one (METHOD §2.2).
    pub depth: usize,
    /// The HexPlane grid.
    pub grid: GridConfig,
    /// Highest degree of the spherical harmonics (3DGS: 3).
    pub sh_degree: usize,
    /// Gaussians nearer to a camera than this share of the capture's near bound are not drawn; where there is no bound, or
    /// 3DGS' 0.2 units are more, those hold. 0 leaves 3DGS' rule alone.
    pub near_share: f64,
}

impl Default for ModelConfig {
    fn default() -> Self {
        Self { deformation: true, width: 128, depth: 1, grid: GridConfig::default(), sh_degree: 3, near_share: 0.9 }
    }
}

/// The HexPlane grid (METHOD §2.1; numbers of DeGauss' Neu3D config).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GridConfig {
    /// Features a plane and scale.
    pub features: usize,
    /// Cells along x, y, z and time at scale 1.
    pub resolution: [usize; 4],
    /// Factors of the spatial resolution, one a scale; time keeps its resolution.
    pub multipliers: Vec<usize>,
}

impl Default for GridConfig {
    fn default() -> Self {
        Self { features: 16, resolution: [64, 64, 64, 150], multipliers: vec![1, 2, 4] }
    }
}

impl GridConfig {
    /// The layout of the planes in memory.
    pub fn layout(&self) -> GridLayout {
        GridLayout { features: self.features, resolution: self.resolution, multipliers: self.multipliers.clone() }
    }
}
