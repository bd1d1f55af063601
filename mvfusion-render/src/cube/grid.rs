//! HexPlane interpolation. CPU twin: `grid/cpu.rs`.

use burn::backend::TensorMetadata;
use burn::backend::ops::FloatTensorOps;
use burn::backend::tensor::FloatTensor;
use burn::tensor::Shape;
use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;
use mvfusion_kernels::cube::atomic::{ExchangedSum, NativeSum};
use mvfusion_kernels::cube::grid::{GridBoxLaunch, SCALE_LAYOUT, look_up, look_up_backward, sum_places};
use mvfusion_kernels::cube::maths::TripleLaunch;

use super::gpu::{CUBE, Flat, Gpu, adds_floats, single};
use crate::grid::cpu::{lower_ends, slopes};
use crate::grid::op::{GridAdjoint, GridOps, LookUp};
use crate::grid::{GridBounds, GridLayout};

impl GridOps for CubeBackend {
    fn grid_look_up(
        planes: FloatTensor<Self>,
        points: FloatTensor<Self>,
        times: FloatTensor<Self>,
        bounds: GridBounds,
        layout: GridLayout,
    ) -> FloatTensor<Self> {
        let query = Query::new(LookUp { planes, points, times }, &bounds, &layout);
        let found = query.gpu.floats([query.count, layout.feature_count()]);
        if query.count > 0 {
            // SAFETY: cells are clamped to the axes in `layout`, and rows to `count`.
            unsafe {
                look_up::launch_unchecked(
                    &query.gpu.client,
                    query.gpu.units(query.count * layout.feature_count()),
                    CUBE,
                    query.planes.clone().flat(),
                    query.points.clone().flat(),
                    query.times.clone().flat(),
                    query.layout.clone().flat(),
                    found.clone().flat(),
                    query.grid(),
                    query.count as u32,
                    query.scales as u32,
                    query.features as u32,
                    query.time_step(),
                );
            }
        }
        found
    }
}

impl GridAdjoint for CubeBackend {
    fn grid_look_up_backward(
        inputs: LookUp<Self>,
        v_features: FloatTensor<Self>,
        bounds: GridBounds,
        layout: GridLayout,
    ) -> LookUp<Self> {
        let time_shape = inputs.times.shape();
        let query = Query::new(inputs, &bounds, &layout);
        let (gpu, count) = (&query.gpu, query.count);
        let planes = gpu.zero_floats(query.planes.shape());
        let (points, times) = (gpu.floats([count, 3]), gpu.floats([count, 1]));
        if count > 0 {
            let lanes = gpu.lanes(query.features, count * query.scales);
            let parts = query.scales * lanes;
            let v_places = gpu.floats([count * parts, 4]);
            let launch = if adds_floats(&gpu.client) {
                look_up_backward::launch_unchecked::<NativeSum>
            } else {
                look_up_backward::launch_unchecked::<ExchangedSum>
            };
            // SAFETY: as in the forward pass; each unit writes its own rows of `v_places`.
            unsafe {
                launch(
                    &gpu.client,
                    gpu.units(count * parts),
                    CUBE,
                    query.planes.clone().flat(),
                    query.points.clone().flat(),
                    query.times.clone().flat(),
                    query.layout.clone().flat(),
                    single(v_features).flat(),
                    planes.clone().flat(),
                    v_places.clone().flat(),
                    query.grid(),
                    count as u32,
                    query.scales as u32,
                    query.features as u32,
                    lanes as u32,
                    query.time_step(),
                );
            }
            sum_places::launch(
                &gpu.client,
                gpu.units(count),
                CUBE,
                v_places.flat(),
                points.clone().flat(),
                times.clone().flat(),
                query.grid(),
                count as u32,
                parts as u32,
            );
        }
        let times = if times.shape() == time_shape {
            times
        } else {
            CubeBackend::float_reshape(gpu.sum_rows(times), Shape::from([1, 1]))
        };
        LookUp { planes, points, times }
    }
}

/// The arguments of an interpolation as kernel arguments.
struct Query {
    gpu: Gpu,
    planes: CubeTensor,
    points: CubeTensor,
    times: CubeTensor,
    /// See [`mvfusion_kernels::cube::grid`].
    layout: CubeTensor,
    bounds: GridBounds,
    count: usize,
    scales: usize,
    features: usize,
}

impl Query {
    fn new(inputs: LookUp<CubeBackend>, bounds: &GridBounds, layout: &GridLayout) -> Self {
        let gpu = Gpu::of(&inputs.planes);
        let scales = layout.multipliers.len();
        let mut numbers = Vec::with_capacity(scales * SCALE_LAYOUT);
        for (scale, planes) in layout.planes().chunks(6).enumerate() {
            numbers.extend(layout.axes(scale).map(|cells| cells as u32));
            numbers.extend(planes.iter().map(|plane| plane.first_cell as u32));
        }
        Self {
            layout: gpu.upload(&numbers),
            count: inputs.points.shape()[0],
            planes: single(inputs.planes),
            points: single(inputs.points),
            times: single(inputs.times),
            bounds: *bounds,
            scales,
            features: layout.features,
            gpu,
        }
    }

    fn grid(&self) -> GridBoxLaunch {
        let triple = |numbers: [f64; 3]| {
            let [x, y, z] = numbers.map(|number| number as f32);
            TripleLaunch::new(x, y, z)
        };
        GridBoxLaunch::new(triple(self.bounds.max), triple(lower_ends(&self.bounds)), triple(slopes(&self.bounds)))
    }

    /// Distance from one point's time to the next.
    fn time_step(&self) -> u32 {
        u32::from(self.times.shape().num_elements() > 1)
    }
}
