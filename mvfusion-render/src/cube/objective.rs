//! The picture terms of the objective. CPU twin: `objective/cpu.rs`.

use burn::backend::ops::FloatTensorOps;
use burn::backend::tensor::FloatTensor;
use burn::tensor::Shape;
use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;
use mvfusion_kernels::cube::UNITS;
use mvfusion_kernels::cube::objective::{
    COMPARISONS, Normalisation, ObjectiveKind, ObjectiveWeightsLaunch, PICTURES, SUMS, objective_finish,
    objective_prepare,
};
use mvfusion_kernels::splat::COLOUR_CHANNELS;

use super::gpu::{CUBE, Flat, Gpu, single};
use super::window::similarity_and_adjoint;
use crate::objective::op::{ObjectiveAdjoint, ObjectiveGradients, ObjectiveOps, ObjectivePlan, ObjectiveTensors};
use crate::objective::{MaskNormalisation, ObjectiveTerms};
use crate::window::Window;
use crate::window::op::{Pair, WindowOps};
use crate::window::similarity::Similarity;

impl ObjectiveOps for CubeBackend {
    fn objective(tensors: ObjectiveTensors<Self>, plan: ObjectivePlan) -> FloatTensor<Self> {
        Pass::new(tensors, plan, false).run().0
    }
}

impl ObjectiveAdjoint for CubeBackend {
    fn objective_with_gradients(
        tensors: ObjectiveTensors<Self>,
        plan: ObjectivePlan,
    ) -> (FloatTensor<Self>, ObjectiveGradients<Self>) {
        Pass::new(tensors, plan, true).run()
    }
}

/// One view.
struct Pass {
    gpu: Gpu,
    tensors: ObjectiveTensors<CubeBackend>,
    plan: ObjectivePlan,
    kind: ObjectiveKind,
}

/// A comparison's map, and the cotangent of its first picture; placeholders without the comparison.
struct Compared {
    map: CubeTensor,
    v_picture: CubeTensor,
}

impl Pass {
    fn new(tensors: ObjectiveTensors<CubeBackend>, plan: ObjectivePlan, wanted: bool) -> Self {
        let gpu = Gpu::of(&tensors.dynamic);
        let ObjectiveTensors { dynamic, static_, exposure, photo, valid, moving, around } = tensors;
        let tensors = ObjectiveTensors {
            dynamic: single(dynamic),
            static_: single(static_),
            exposure: single(exposure),
            photo: single(photo),
            valid: single(valid),
            moving: single(moving),
            around: single(around),
        };
        let terms = &plan.terms;
        let kind = ObjectiveKind {
            normalisation: match terms.normalisation {
                MaskNormalisation::Geometry => Normalisation::Geometry,
                MaskNormalisation::GeometryUnclamped => Normalisation::GeometryUnclamped,
                MaskNormalisation::Deformation => Normalisation::Deformation,
            },
            exposed: plan.exposed,
            masked: plan.masked,
            dynamic_region: terms.dynamic_region,
            static_region: terms.static_region,
            geometry: terms.geometry.is_some(),
            geometry_mean: terms.geometry.as_ref().is_some_and(|geometry| geometry.mean),
            depth_back_detached: terms.depth_back_detached,
            entropy: terms.entropy > 0.0,
            smooth: terms.depth_smooth > 0.0,
            similarity: terms.branch_similarity() || terms.composed_dssim > 0.0,
            structure: terms.likeness > 0.0,
            wanted,
        };
        Self { gpu, tensors, plan, kind }
    }

    fn pixels(&self) -> usize {
        self.plan.size[0] * self.plan.size[1]
    }

    /// Pictures of so many planes.
    fn planes(&self, count: usize) -> CubeTensor {
        self.gpu.floats([1, count, self.plan.size[0], self.plan.size[1]])
    }

    fn run(self) -> (CubeTensor, ObjectiveGradients<CubeBackend>) {
        let [pictures, photos] = [(); 2].map(|()| self.planes(PICTURES * COLOUR_CHANNELS));
        let prepared = self.planes(self.kind.prepared());
        self.prepare(&pictures, &photos, &prepared);
        let terms = &self.plan.terms;
        let similar = self.kind.similarity.then(|| {
            let pair = Pair { a: pictures.clone(), b: photos };
            self.compare(pair, &prepared, [0, PICTURES], &terms.ssim, Similarity::Ssim)
        });
        let structured = self.kind.structure.then(|| {
            let [a, b] = [0, 1].map(|picture| colours(&pictures, [picture, picture + 1]));
            let structure = [PICTURES, COMPARISONS];
            self.compare(Pair { a, b }, &prepared, structure, &terms.structure, Similarity::Structure)
        });
        let [similar, structured] = [similar, structured].map(|compared| {
            compared.unwrap_or_else(|| Compared { map: self.gpu.floats([1]), v_picture: self.gpu.floats([1]) })
        });
        self.finish(prepared, similar, structured)
    }

    fn prepare(&self, pictures: &CubeTensor, photos: &CubeTensor, prepared: &CubeTensor) {
        let tensors = self.tensors.clone();
        // SAFETY: excess units do nothing, and the others read and write their own pixel; masks and exposure are read only
        // if they are there.
        unsafe {
            objective_prepare::launch_unchecked(
                &self.gpu.client,
                self.gpu.units(self.pixels()),
                CUBE,
                tensors.dynamic.flat(),
                tensors.static_.flat(),
                tensors.exposure.flat(),
                tensors.photo.flat(),
                tensors.valid.flat(),
                tensors.moving.flat(),
                tensors.around.flat(),
                pictures.clone().flat(),
                photos.clone().flat(),
                prepared.clone().flat(),
                weights(&self.plan.terms, self.plan.size),
                self.pixels() as u32,
                self.kind,
            );
        }
    }

    /// Compares two pictures. `comparisons` are the first of `prepared`, and one past the last.
    fn compare(
        &self,
        pair: Pair<CubeBackend>,
        prepared: &CubeTensor,
        comparisons: [usize; 2],
        window: &Window,
        kind: Similarity,
    ) -> Compared {
        if !self.kind.wanted {
            let map = CubeBackend::window_similarity(pair.a, pair.b, window.clone(), kind);
            return Compared { map, v_picture: self.gpu.floats([1]) };
        }
        let (map, v_picture) = similarity_and_adjoint(pair, colours(prepared, comparisons), window, kind);
        Compared { map, v_picture }
    }

    fn finish(
        self,
        prepared: CubeTensor,
        similar: Compared,
        structured: Compared,
    ) -> (CubeTensor, ObjectiveGradients<CubeBackend>) {
        let (gpu, [height, width]) = (&self.gpu, self.plan.size);
        let cubes = self.pixels().div_ceil(UNITS);
        let sums = gpu.floats([cubes, SUMS]);
        let tensors = self.tensors.clone();
        let room = |wanted: bool, shape: Shape| if wanted { gpu.floats(shape) } else { gpu.floats([1]) };
        let v_dynamic = room(self.kind.wanted, tensors.dynamic.meta.shape().clone());
        let v_static = room(self.kind.wanted, tensors.static_.meta.shape().clone());
        let v_exposed = room(self.kind.exposed, Shape::from([1, 2 * COLOUR_CHANNELS, height, width]));
        // SAFETY: excess units do nothing, and the others write their own pixel and read it and its neighbours within the
        // picture; masks, exposure and comparisons are read only if they are there.
        unsafe {
            objective_finish::launch_unchecked(
                &gpu.client,
                gpu.cubes(cubes),
                CUBE,
                tensors.dynamic.flat(),
                tensors.static_.flat(),
                tensors.exposure.flat(),
                tensors.photo.flat(),
                prepared.flat(),
                similar.map.flat(),
                structured.map.flat(),
                similar.v_picture.flat(),
                structured.v_picture.flat(),
                sums.clone().flat(),
                v_dynamic.clone().flat(),
                v_static.clone().flat(),
                v_exposed.clone().flat(),
                weights(&self.plan.terms, self.plan.size),
                height as u32,
                width as u32,
                cubes as u32,
                self.kind,
            );
        }
        let scale = gpu.upload_floats(&[1.0, 1.0 / (COLOUR_CHANNELS * self.pixels()) as f32]);
        let values = CubeBackend::float_mul(gpu.sum_rows(sums), scale);
        let exposure = match self.kind.exposed {
            true => self.exposure_gradient(v_exposed),
            false => v_exposed,
        };
        (values, ObjectiveGradients { dynamic: v_dynamic, static_: v_static, exposure })
    }

    /// The gradient of the exposure from the cotangents of the exposed colours.
    fn exposure_gradient(&self, v_exposed: CubeTensor) -> CubeTensor {
        let flat =
            |picture: CubeTensor| CubeBackend::float_reshape(picture, Shape::from([COLOUR_CHANNELS, self.pixels()]));
        let copy = |picture: &CubeTensor| {
            CubeBackend::float_slice(picture.clone(), &[(0..1).into(), (0..COLOUR_CHANNELS).into()])
        };
        let branches = [&self.tensors.dynamic, &self.tensors.static_];
        let parts = branches.into_iter().enumerate().map(|(branch, rendered)| {
            let v_colours = flat(colours(&v_exposed, [branch, branch + 1]));
            let rendered = CubeBackend::float_transpose(flat(copy(rendered)));
            let offset = CubeBackend::float_sum_dim(v_colours.clone(), 1);
            CubeBackend::float_cat(vec![CubeBackend::float_matmul(v_colours, rendered), offset], 1)
        });
        // Proof: there are two branches.
        parts.reduce(CubeBackend::float_add).expect("two branches")
    }
}

/// The colours from one picture to before another of `[1, pictures * 3, H, W]`.
fn colours(pictures: &CubeTensor, [first, end]: [usize; 2]) -> CubeTensor {
    let planes = COLOUR_CHANNELS * first..COLOUR_CHANNELS * end;
    single(CubeBackend::float_slice(pictures.clone(), &[(0..1).into(), planes.into()]))
}

/// The weights of the terms, divided by the number of values in their means.
fn weights(terms: &ObjectiveTerms, [height, width]: [usize; 2]) -> ObjectiveWeightsLaunch {
    let over = |weight: f64, count: usize| if count > 0 { (weight / count as f64) as f32 } else { 0.0 };
    let scalar = |weight: f64| over(weight, height * width);
    let colour = |weight: f64| over(weight, COLOUR_CHANNELS * height * width);
    let geometry = terms.geometry.as_ref();
    let smooth = terms.depth_smooth / terms.extent;
    ObjectiveWeightsLaunch::new(
        colour(terms.composed_l1),
        colour(geometry.map_or(0.0, |geometry| geometry.l1)),
        colour(geometry.map_or(0.0, |geometry| geometry.dssim)),
        scalar(terms.depth_back),
        scalar(terms.depth_forward),
        over(smooth, height * (width - 1)),
        over(smooth, (height - 1) * width),
        colour(terms.likeness),
        colour(terms.branch_dssim),
        colour(terms.branch_l1),
        colour(terms.composed_dssim),
        scalar(terms.brightness),
        colour(terms.explicit_brightness),
        scalar(terms.entropy),
        scalar(terms.mask_motion),
        scalar(terms.mask_still),
        terms.dynamic_above as f32,
        terms.static_above as f32,
        (1.0 / terms.extent) as f32,
    )
}
