//! An image to render on a GPU: its Gaussians, its view, and both as kernel arguments.

use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;
use mvfusion_kernels::cube::maths::{PairLaunch, TripleLaunch};
use mvfusion_kernels::cube::view::{BlendRulesLaunch, ProjectionKind, ViewLaunch};

use super::gpu::{Gpu, single};
use crate::splat::cpu::view::View;
use crate::splat::op::{SplatPlan, SplatPrimitives};
use crate::splat::tensors::{SplatSizes, SplatTensors};
use crate::splat::{Antialias, Extent};

/// One image to render or to backpropagate.
pub(super) struct Frame {
    pub gpu: Gpu,
    pub tensors: SplatTensors<CubeTensor>,
    pub sizes: SplatSizes,
    pub view: View<f32>,
}

/// Projected Gaussians.
#[derive(Clone)]
pub(super) struct Projected {
    /// `[N, PROJECTED_LEN]`.
    pub records: CubeTensor,
    /// `[N, 2]`.
    pub radii: CubeTensor,
    /// `[N]`, the larger radius.
    pub largest: CubeTensor,
    /// `[N]`, number of tiles that each Gaussian touches.
    pub touched: CubeTensor,
}

/// A frame whose Gaussians are projected.
pub(super) struct ProjectedFrame {
    pub frame: Frame,
    pub projected: Projected,
}

impl Frame {
    pub fn new(inputs: SplatPrimitives<CubeBackend>, plan: &SplatPlan) -> Self {
        Self {
            gpu: Gpu::of(&inputs.means),
            tensors: inputs.map(single),
            sizes: plan.sizes,
            view: View::new(&plan.camera, &plan.settings),
        }
    }

    /// Number of Gaussians.
    pub fn count(&self) -> usize {
        self.sizes.count
    }

    /// Blended channels: colour, features, depth.
    pub fn channels(&self) -> usize {
        self.sizes.channels()
    }

    pub fn kind(&self) -> ProjectionKind {
        ProjectionKind {
            square: self.is_square(),
            compensated: self.view.antialias == Antialias::Compensated,
            degree: self.view.sh_degree,
        }
    }

    /// Whether tiles are computed from one radius.
    pub fn is_square(&self) -> bool {
        matches!(self.view.extent, Extent::Square { .. })
    }

    /// The camera and the projection rules as a kernel argument.
    pub fn view(&self) -> ViewLaunch {
        let view = &self.view;
        let pair = |[x, y]: [f32; 2]| PairLaunch::new(x, y);
        let triple = |[x, y, z]: [f32; 3]| TripleLaunch::new(x, y, z);
        let [right, down, forward] = view.rotation;
        let sigmas = match view.extent {
            Extent::Square { sigmas } | Extent::PerAxis { sigmas } => sigmas as f32,
        };
        ViewLaunch::new(
            view.width as u32,
            view.height as u32,
            pair(view.focal),
            pair(view.principal),
            triple(right),
            triple(down),
            triple(forward),
            triple(view.translation),
            triple(view.centre),
            pair(view.tangent_low),
            pair(view.tangent_high),
            view.near,
            finite(view.far),
            view.depth_guard,
            view.dilation,
            sigmas,
        )
    }

    pub fn rules(&self) -> BlendRulesLaunch {
        let view = &self.view;
        BlendRulesLaunch::new(view.alpha_clamp, finite(view.gradient_clamp), view.stop)
    }
}

/// Replaces infinity by the largest finite number, because a shader may assume that floats are finite.
fn finite(number: f32) -> f32 {
    number.min(f32::MAX)
}
