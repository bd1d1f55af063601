//! HexPlane: a spatio-temporal feature field from six planes (METHOD §2.1).

use burn::module::{Module, Param};
use burn::tensor::Tensor;
use mvfusion_render::grid::{self, GridBounds, GridLayout};

use super::ModuleInit;

/// Six planes (xy, xz, xt, yz, yt, zt) at several scales. A feature is the product of the six bilinear look-ups at a point
/// and time; the scales are concatenated.
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
    /// A field over `bounds`: spatial planes from `U(0.1, 0.5)`, time planes all one.
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

    /// A field of given planes, `[cells, features]`.
    pub fn from_planes(planes: Param<Tensor<2>>, layout: GridLayout, bounds: GridBounds) -> Self {
        Self { planes, layout, bounds }
    }

    /// Where the planes lie in memory.
    pub fn layout(&self) -> &GridLayout {
        &self.layout
    }

    /// The box that the planes span; points outside are held at its border.
    pub fn bounds(&self) -> &GridBounds {
        &self.bounds
    }

    /// Features `[N, scales * features]` of points `[N, 3]` at times `[N, 1]`, or `[1, 1]` for one time for all.
    ///
    /// # Panics
    /// If planes or arguments do not have these shapes, or the features are more than a buffer of the device holds.
    pub fn forward(&self, points: Tensor<2>, times: Tensor<2>) -> Tensor<2> {
        // Proof: the planes are made by `layout` and the points by our own branches. What is left is a buffer that the
        // device does not have: that ends the run here, with the op's advice, as in `Gpu::room`.
        grid::look_up(self.planes.val(), points, times, &self.bounds, &self.layout)
            .unwrap_or_else(|error| panic!("HexPlane: {error}"))
    }
}
