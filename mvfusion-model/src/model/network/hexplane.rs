//! HexPlane: a spatio-temporal feature field of six planes (METHOD §2.1).

use burn::module::{Module, Param};
use burn::tensor::Tensor;
use mvfusion_render::grid::{self, GridBounds, GridLayout};

use super::ModuleInit;

/// Six planes (xy, xz, xt, yz, yt, zt) at several scales. A feature is the product of the six bilinear interpolations
/// at a point and time; the scales are concatenated.
#[derive(Module, Debug)]
pub struct HexPlane {
    /// All planes, cell by cell: `[cells, features]`.
    pub planes: Param<Tensor<2>>,
    #[module(skip)]
    layout: GridLayout,
    #[module(skip)]
    bounds: GridBounds,
}

impl HexPlane {
    /// A field over `bounds`, with spatial planes from `U(0.1, 0.5)` and time planes of ones.
    pub fn new(layout: GridLayout, bounds: GridBounds, init: &mut ModuleInit<'_>) -> Self {
        let mut values = vec![1.0; layout.cells() * layout.features];
        for plane in layout.planes().iter().filter(|plane| !plane.is_time()) {
            let first = plane.first_cell * layout.features;
            let count = plane.width * plane.height * layout.features;
            values[first..first + count].iter_mut().for_each(|v| *v = init.stream.uniform(0.1, 0.5));
        }
        let planes = init.parameter(values, [layout.cells(), layout.features]);
        Self { planes, layout, bounds }
    }

    /// A field with given planes, `[cells, features]`.
    pub fn from_planes(planes: Param<Tensor<2>>, layout: GridLayout, bounds: GridBounds) -> Self {
        Self { planes, layout, bounds }
    }

    /// The layout of the planes in memory.
    pub fn layout(&self) -> &GridLayout {
        &self.layout
    }

    /// The box of the planes; points outside are clamped to its border.
    pub fn bounds(&self) -> &GridBounds {
        &self.bounds
    }

    /// Features `[N, scales * features]` of points `[N, 3]` at times `[N, 1]`, or at one time `[1, 1]`.
    ///
    /// # Panics
    /// If planes or arguments do not have these shapes, or the features do not fit into a buffer of the device.
    pub fn forward(&self, points: Tensor<2>, times: Tensor<2>) -> Tensor<2> {
        // Proof: the planes follow `layout`, the box is finite, and the points are centres `[N, 3]` of our own branches.
        // `Checkpoint` checks all three for a file. The remaining error is a buffer that is too large for the device. It
        // ends the run with the op's advice, as in `Gpu::room`.
        grid::look_up(self.planes.val(), points, times, &self.bounds, &self.layout)
            .unwrap_or_else(|error| panic!("HexPlane: {error}"))
    }
}
