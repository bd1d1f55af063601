//! The objective as one op against its form with tensor operations.

use burn::tensor::{DType, Device, Tensor, TensorData};
use mvfusion_render::objective::{ObjectiveInputs, ObjectiveMasks, objective};

use super::light::light_picture_loss;
use super::{LossContext, LossSchedule, MotionMasks, MotionWitness, Pictures, Windows, main_loss};
use crate::config::LossConfig;
use crate::model::composition::{Blending, BranchRenders};
use crate::model::exposure::Exposures;
use crate::random::Stream;
use crate::test_support::{for_each_device, values};

/// Rounding in f64, of the largest value.
const EXACT: f64 = 1e-9;

/// In f32, similarities lose digits where large numbers of both signs cancel.
const SINGLE: f64 = 3e-4;

/// A step's losses, and a picture's size.
struct Case {
    name: &'static str,
    size: [usize; 2],
    geometry: bool,
    config: LossConfig,
    /// Who saw the motion, if any is known.
    seen_by: Option<MotionWitness>,
    /// Whether some pixels are invalid.
    masked: bool,
    exposed: bool,
}

impl Default for Case {
    fn default() -> Self {
        let config = LossConfig::default();
        Self { name: "", size: [13, 37], geometry: false, config, seen_by: None, masked: false, exposed: false }
    }
}

/// Every term has a weight, and motion is used wherever it can be.
fn every_term() -> LossConfig {
    LossConfig {
        geometry_mean: false,
        dynamic_where_moving: true,
        static_where_still: true,
        mask_motion: 0.3,
        mask_still: 0.2,
        depth_back_detached: false,
        depth_smooth: 1.0,
        penalize_dynamic: 0.5,
        brightness: 0.1,
        entropy: 0.4,
        ..LossConfig::default()
    }
}

/// Nothing but the main L1 terms.
fn l1_alone() -> LossConfig {
    LossConfig {
        geometry_dssim: 0.0,
        composed_dssim: 0.0,
        branch_dssim: 0.0,
        branch_l1: 0.0,
        depth_back: 0.0,
        depth_forward: 0.0,
        depth_smooth: 0.0,
        penalize_dynamic: 0.0,
        brightness: 0.0,
        brightness_explicit: 0.0,
        entropy: 0.0,
        ..LossConfig::default()
    }
}

fn cases() -> Vec<Case> {
    let camera = Some(MotionWitness::StillCamera);
    vec![
        Case { name: "geometry", geometry: true, ..Case::default() },
        Case {
            name: "geometry with every term",
            geometry: true,
            config: every_term(),
            seen_by: camera,
            masked: true,
            exposed: true,
            ..Case::default()
        },
        Case { name: "deformation", ..Case::default() },
        Case {
            name: "deformation with every term",
            config: every_term(),
            seen_by: camera,
            masked: true,
            exposed: true,
            ..Case::default()
        },
        Case {
            name: "motion that the static branch shows",
            config: every_term(),
            seen_by: Some(MotionWitness::StaticBranch),
            ..Case::default()
        },
        Case { name: "L1 alone", config: l1_alone(), ..Case::default() },
        Case { name: "one row", size: [1, 7], masked: true, ..Case::default() },
        Case { name: "one column", size: [9, 1], config: every_term(), seen_by: camera, ..Case::default() },
        Case { name: "one pixel", size: [1, 1], geometry: true, ..Case::default() },
    ]
}

/// A case's tensors on a device.
struct View {
    /// Packed renders, `[1, planes, H, W]`; both copies of an op's render are made of one.
    dynamic: Tensor<4>,
    static_: Tensor<4>,
    exposures: Exposures,
    photo: Tensor<4>,
    valid: Option<Tensor<4>>,
    motion: Option<MotionMasks>,
}

impl View {
    fn new(case: &Case, device: &Device, dtype: DType) -> Self {
        let [height, width] = case.size;
        let mut stream = Stream::new(5, 0);
        let mut planes = |count: usize, [low, high]: [f64; 2]| {
            let numbers: Vec<f64> = (0..count * height * width).map(|_| low + (high - low) * stream.unit()).collect();
            Tensor::<4>::from_data(TensorData::new(numbers, [1, count, height, width]), (device, dtype))
        };
        // Colours beyond both ends of their range are clamped; controls lie on both sides of the brightness' knee.
        let render = |colours: Tensor<4>, rest: Vec<Tensor<4>>| Tensor::cat([vec![colours], rest].concat(), 1);
        let dynamic = {
            let (colours, mask, alpha) = (planes(3, [-0.2, 1.2]), planes(3, [0.0, 1.0]), planes(1, [0.0, 1.0]));
            render(colours, vec![mask, alpha, planes(1, [1.0, 4.0])])
        };
        let static_ = {
            let (colours, alpha) = (planes(3, [-0.2, 1.2]), planes(1, [0.0, 1.0]));
            render(colours, vec![alpha, planes(1, [1.0, 4.0])])
        };
        let threshold = |noise: Tensor<4>, least: f64| noise.greater_elem(least).float().cast(dtype);
        let valid = threshold(planes(1, [0.0, 1.0]), 0.2);
        let moving = threshold(planes(1, [0.0, 1.0]), 0.7);
        let around = moving.clone().max_pair(threshold(planes(1, [0.0, 1.0]), 0.7));
        let (photo, valid) = (planes(3, [0.0, 1.0]), case.masked.then_some(valid));
        let photo = match &valid {
            Some(valid) => photo * valid.clone(),
            None => photo,
        };
        let motion = case.seen_by.map(|seen_by| MotionMasks::new(moving, around, seen_by).within(valid.as_ref()));
        let departures: Vec<f64> = (0..12).map(|_| 0.2 * (stream.unit() - 0.5)).collect();
        let departures = [departures.clone(), departures.iter().map(|value| -value).collect()].concat();
        let departures = Tensor::from_data(TensorData::new(departures, [2, 3, 4]), (device, dtype));
        Self {
            dynamic: dynamic.autodiff().require_grad(),
            static_: static_.autodiff().require_grad(),
            exposures: Exposures::from_departures(departures.autodiff().require_grad()),
            photo,
            valid,
            motion,
        }
    }

    fn context<'a>(&'a self, case: &'a Case, windows: &'a Windows) -> LossContext<'a> {
        LossContext {
            photos: &self.photo,
            valid: self.valid.as_ref(),
            motion: self.motion.as_ref(),
            config: &case.config,
            schedule: LossSchedule {
                geometry: case.geometry,
                step: 20,
                total: 10,
                densify_until: 400,
                brightness_end: 0.5,
            },
            extent: 2.0,
            windows,
        }
    }

    /// The main loss and the light loss with tensor operations.
    fn references(&self, case: &Case, context: &LossContext<'_>) -> [Tensor<1>; 2] {
        let colours = |render: &Tensor<4>| {
            let colours = render.clone().narrow(1, 0, 3);
            if case.exposed { self.exposures.of(&[0]).of_colours(colours) } else { colours }
        };
        let layers = BranchRenders {
            dynamic: colours(&self.dynamic),
            static_: colours(&self.static_),
            mask: self.dynamic.clone().narrow(1, 3, 3),
        };
        let layers = match context.static_region() {
            Some(still) => layers.with_static_learning(still),
            None => layers,
        };
        let blending = if case.geometry { Blending::Geometry } else { Blending::Deformation };
        let pictures = Pictures {
            composition: layers.compose_within(blending, self.valid.as_ref()),
            dynamic_depth: self.dynamic.clone().narrow(1, 7, 1),
            static_depth: self.static_.clone().narrow(1, 4, 1),
        };
        [main_loss(&pictures, context), light_picture_loss(&pictures, context)]
    }

    /// The loss by the op, of both copies of the dynamic and of the static render.
    fn fused(&self, case: &Case, context: &LossContext<'_>, [dynamic, static_]: [Tensor<4>; 2]) -> Tensor<1> {
        let [height, width] = case.size;
        let mask = |mask: &Tensor<4>| mask.clone().reshape([1, height, width]);
        let inputs = ObjectiveInputs {
            dynamic,
            static_,
            exposure: case.exposed.then(|| self.exposures.of(&[0]).of_view(0)),
            photo: self.photo.clone().reshape([3, height, width]),
            masks: ObjectiveMasks {
                valid: self.valid.as_ref().map(mask),
                moving: self.motion.as_ref().map(|motion| mask(&motion.moving)),
                around: self.motion.as_ref().map(|motion| mask(&motion.around)),
            },
        };
        objective(inputs, &context.objective_terms()).expect("the shapes match").loss
    }

    /// The loss, and the gradients of renders and exposures.
    fn results(&self, loss: Tensor<1>) -> Vec<(&'static str, Vec<f64>)> {
        let mut gradients = loss.clone().backward();
        let of = |gradient: Option<Tensor<4>>| values(gradient.expect("it took part"));
        let departures = self.exposures.departures.val().grad_remove(&mut gradients);
        vec![
            ("loss", values(loss.inner())),
            ("dynamic", of(self.dynamic.grad(&gradients))),
            ("static", of(self.static_.grad(&gradients))),
            ("exposures", departures.map(values).unwrap_or_default()),
        ]
    }
}

#[test]
fn the_objective_is_that_of_tensor_operations() {
    for_each_device(|device| {
        let dtypes: &[(DType, f64)] = match mvfusion_render::device::is_gpu(&device) {
            true => &[(DType::F32, SINGLE)],
            false => &[(DType::F64, EXACT), (DType::F32, SINGLE)],
        };
        for (case, &(dtype, tolerance)) in cases().iter().flat_map(|case| dtypes.iter().map(move |dtype| (case, dtype)))
        {
            let (view, windows) = (View::new(case, &device, dtype), Windows::default());
            let context = view.context(case, &windows);
            let [main, light] = view.references(case, &context);
            let wanted = view.results(main + light);
            let both = [&view.dynamic, &view.static_].map(|render| Tensor::cat(vec![render.clone(); 2], 0));
            let found = view.results(view.fused(case, &context, both));
            for ((part, wanted), (_, found)) in wanted.iter().zip(&found) {
                assert_eq!(found.len(), wanted.len(), "{}, {part}", case.name);
                let largest = wanted.iter().fold(0.0f64, |largest, x| largest.max(x.abs()));
                let worst = found.iter().zip(wanted).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                assert!(
                    worst <= tolerance * largest,
                    "{}, {part} in {dtype:?}: off by {worst}, the largest is {largest}",
                    case.name
                );
            }
        }
    });
}

#[test]
fn the_copies_of_a_render_have_the_gradients_of_their_own_loss() {
    for_each_device(|device| {
        let (dtype, tolerance) = match mvfusion_render::device::is_gpu(&device) {
            true => (DType::F32, SINGLE),
            false => (DType::F64, EXACT),
        };
        for case in &cases() {
            let (view, windows) = (View::new(case, &device, dtype), Windows::default());
            let context = view.context(case, &windows);
            // Of the main loss and of the light loss, each with respect to the dynamic and the static render.
            let wanted = [true, false].map(|is_main| {
                // A backward pass consumes what both losses share, so each has its own forward pass.
                let [main, light] = view.references(case, &context);
                let gradients = if is_main { main } else { light }.backward();
                [&view.dynamic, &view.static_].map(|render| values(render.grad(&gradients).expect("it took part")))
            });
            let copies = [&view.dynamic, &view.static_]
                .map(|render| [(); 2].map(|()| render.clone().inner().autodiff().require_grad()));
            let both = copies.each_ref().map(|copies| Tensor::cat(copies.to_vec(), 0));
            let gradients = view.fused(case, &context, both).backward();
            let found = copies.map(|copies| copies.map(|copy| values(copy.grad(&gradients).expect("it took part"))));
            for (render, name) in ["dynamic", "static"].into_iter().enumerate() {
                let of_render = wanted.iter().flat_map(|of_loss| &of_loss[render]);
                let largest = of_render.fold(0.0f64, |largest, x| largest.max(x.abs()));
                for (copy, loss) in ["main", "light"].into_iter().enumerate() {
                    let (found, wanted) = (&found[render][copy], &wanted[copy][render]);
                    assert_eq!(found.len(), wanted.len(), "{}, {name}", case.name);
                    let worst = found.iter().zip(wanted).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                    assert!(
                        worst <= tolerance * largest,
                        "{}, {name}, {loss} loss: off by {worst}, the largest is {largest}",
                        case.name
                    );
                }
            }
        }
    });
}
