//! The picture terms of the objective. CPU twin: `objective/cpu.rs`.

use std::ops::Range;

use burn::backend::ops::FloatTensorOps;
use burn::backend::tensor::FloatTensor;
use burn::tensor::Shape;
use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;
use mvfusion_kernels::cube::UNITS;
use mvfusion_kernels::cube::objective::{
    Normalisation, ObjectiveKind, ObjectiveWeightsLaunch, PICTURES, SUMS, objective_finish, objective_prepare,
};
use mvfusion_kernels::splat::COLOUR_CHANNELS;

use super::gpu::{CUBE, Flat, Gpu, single};
use super::window::{Planes, similarity_and_adjoint};
use crate::objective::op::{ObjectiveAdjoint, ObjectiveGradients, ObjectiveOps, ObjectivePlan, ObjectiveTensors};
use crate::objective::{MaskNormalisation, ObjectiveTerms};
use crate::window::Window;
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
            similarity: terms.compares_with_photo(),
            structure: terms.compares_branches(),
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
        let picture =
            |tensor: &CubeTensor, number: usize| Planes { tensor: tensor.clone(), first: number * COLOUR_CHANNELS };
        let similar = self.kind.similarity.then(|| {
            let pair = [&pictures, &photos].map(|tensor| picture(tensor, 0));
            self.compare(pair, PICTURES, picture(&prepared, 0), &terms.ssim, Similarity::Ssim)
        });
        let structured = self.kind.structure.then(|| {
            let branches = [0, 1].map(|number| picture(&pictures, number));
            self.compare(branches, 1, picture(&prepared, PICTURES), &terms.structure, Similarity::Structure)
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

    /// Compares so many pictures with others; `v_map` are the cotangents of the maps.
    fn compare(
        &self,
        pair: [Planes; 2],
        pictures: usize,
        v_map: Planes,
        window: &Window,
        kind: Similarity,
    ) -> Compared {
        let v_map = self.kind.wanted.then_some(v_map);
        let (map, v_picture) = similarity_and_adjoint(pair, pictures * COLOUR_CHANNELS, v_map, window, kind);
        Compared { map, v_picture: v_picture.unwrap_or_else(|| self.gpu.floats([1])) }
    }

    fn finish(
        self,
        prepared: CubeTensor,
        similar: Compared,
        structured: Compared,
    ) -> (CubeTensor, ObjectiveGradients<CubeBackend>) {
        let (gpu, [height, width]) = (&self.gpu, self.plan.size);
        let cubes = self.pixels().div_ceil(UNITS);
        let sums = gpu.floats([cubes, self.kind.sums()]);
        let tensors = self.tensors.clone();
        let room = |wanted: bool, shape: Shape| if wanted { gpu.floats(shape) } else { gpu.floats([1]) };
        let v_dynamic = room(self.kind.wanted, tensors.dynamic.meta.shape().clone());
        let v_static = room(self.kind.wanted, tensors.static_.meta.shape().clone());
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
                weights(&self.plan.terms, self.plan.size),
                height as u32,
                width as u32,
                cubes as u32,
                self.kind,
            );
        }
        let sums = gpu.sum_rows(sums);
        let part = |range: Range<usize>| CubeBackend::float_slice(sums.clone(), &[range.into()]);
        let (values, exposure) = match self.kind.sums() {
            SUMS => (sums.clone(), gpu.floats([1])),
            end => {
                let shape = self.tensors.exposure.meta.shape().clone();
                (part(0..SUMS), CubeBackend::float_reshape(part(SUMS..end), shape))
            }
        };
        let scale = gpu.upload_floats(&[1.0, 1.0 / (COLOUR_CHANNELS * self.pixels()) as f32]);
        let values = CubeBackend::float_mul(values, scale);
        (values, ObjectiveGradients { dynamic: v_dynamic, static_: v_static, exposure })
    }
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
