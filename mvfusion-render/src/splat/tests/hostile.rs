//! Inputs that are empty, huge, invalid or outside the view.

use super::*;
use crate::test_support::{for_each_device, numbers};

fn render(scene: &Scene, device: &Device, camera: &Camera) -> (Vec<f64>, Vec<i64>) {
    let inputs = scene.inputs(device, DType::F32);
    let picture = splat(inputs, None, camera, &settings(SplatRules::inria())).expect("shapes fit");
    (numbers(picture.packed), indices(picture.radii))
}

fn assert_background(scene: &Scene, packed: &[f64], pixels: usize) {
    let planes: Vec<f64> = scene.background.iter().map(|&x| f64::from(x as f32)).chain([0.0, 0.0]).collect();
    for (k, value) in packed.iter().enumerate() {
        assert_eq!(*value, planes[k / pixels % planes.len()], "number {k}");
    }
}

#[test]
fn no_gaussians_leave_the_background() {
    for_each_device(|device| {
        let scene = Scene::random(1, 0);
        let (packed, radii) = render(&scene, &device, &camera());
        assert_background(&scene, &packed, 37 * 29);
        assert!(radii.is_empty());
    });
}

#[test]
fn no_gaussians_have_no_gradients_but_the_background_has() {
    for_each_device(|device| {
        let numbers = gradients::all_numbers(&Scene::random(1, 0), &device.autodiff(), DType::F32);
        assert!(numbers[1..7].iter().all(Vec::is_empty));
        assert!(numbers[7].iter().all(|&x| x != 0.0));
    });
}

#[test]
fn gaussians_behind_the_camera_leave_no_trace() {
    for_each_device(|device| {
        let mut scene = Scene::random(2, 30);
        scene.means.chunks_mut(3).for_each(|mean| mean[2] = -mean[2]);
        let (packed, radii) = render(&scene, &device, &camera());
        assert_background(&scene, &packed, 37 * 29);
        assert!(radii.iter().all(|&r| r == 0));
        let numbers = gradients::all_numbers(&scene, &device.autodiff(), DType::F32);
        assert!(numbers[1..7].iter().flatten().all(|&x| x == 0.0));
    });
}

/// Name of the broken value, and a function that breaks it.
type Break = (&'static str, fn(&mut Scene));

/// Ways to break the first Gaussian.
const BREAKS: [Break; 9] = [
    ("mean is NaN", |scene| scene.means[1] = f64::NAN),
    ("mean is infinite", |scene| scene.means[2] = f64::INFINITY),
    ("quaternion is zero", |scene| scene.quaternions[..4].fill(0.0)),
    ("quaternion is NaN", |scene| scene.quaternions[3] = f64::NAN),
    ("scale is infinite", |scene| scene.log_scales[0] = f64::INFINITY),
    ("scale overflows", |scene| scene.log_scales[..3].fill(200.0)),
    ("opacity is NaN", |scene| scene.opacity_logits[0] = f64::NAN),
    ("colour is NaN", |scene| scene.sh[4] = f64::NAN),
    ("feature is infinite", |scene| scene.features[1] = f64::INFINITY),
];

#[test]
fn a_broken_gaussian_is_culled_and_the_others_do_not_notice() {
    for_each_device(|device| {
        let whole = Scene::random(3, 20);
        let mut hidden = whole.clone();
        hidden.means[2] = -5.0;
        let expected = render(&hidden, &device, &camera());
        let expected_gradients = gradients::all_numbers(&hidden, &device.clone().autodiff(), DType::F32);
        for (name, damage) in BREAKS {
            let mut broken = whole.clone();
            damage(&mut broken);
            assert!(render(&broken, &device, &camera()) == expected, "{name}");
            let gradients = gradients::all_numbers(&broken, &device.clone().autodiff(), DType::F32);
            assert!(gradients == expected_gradients, "{name}");
        }
    });
}

#[test]
fn a_rule_out_of_its_range_is_refused() {
    let inria = SplatRules::inria();
    let broken = [
        ("near", SplatRules { near: -0.1, ..inria }),
        ("near", SplatRules { near: f64::NAN, ..inria }),
        ("far", SplatRules { far: f64::NAN, ..inria }),
        ("depth_guard", SplatRules { depth_guard: -1.0, ..inria }),
        ("dilation", SplatRules { dilation: -0.3, ..inria }),
        ("stop", SplatRules { stop: Stop::Below(0.0), ..inria }),
        ("extent", SplatRules { extent: Extent::PerAxis { sigmas: 0.0 }, ..inria }),
        ("alpha_clamp", SplatRules { alpha_clamp: 1.0, ..inria }),
    ];
    for_each_device(|device| {
        for (name, rules) in broken {
            let inputs = Scene::random(1, 1).inputs(&device, DType::F32);
            match splat(inputs, None, &camera(), &settings(rules)) {
                Err(SplatError::Rule { rule, .. }) => assert_eq!(rule, name),
                other => panic!("{name}: {other:?}"),
            }
        }
    });
}

/// Without dilation, the determinant is that of the sharp ellipse, which can be finite where the variance is not.
#[test]
fn a_variance_that_overflows_along_one_axis_culls_the_gaussian() {
    let camera = Camera::centred(37, 29, 34.0, DMat3::IDENTITY, DVec3::ZERO);
    let rules = SplatRules { dilation: 0.0, ..SplatRules::inria() };
    for_each_device(|device| {
        let mut scene = Scene::random(5, 1);
        scene.means.copy_from_slice(&[0.0, 0.0, 3.0]);
        scene.quaternions.copy_from_slice(&[1.0, 0.0, 0.0, 0.0]);
        scene.log_scales.copy_from_slice(&[43.5, -6.0, -50.0]);
        let picture = splat(scene.inputs(&device, DType::F32), None, &camera, &settings(rules)).expect("shapes fit");
        assert_background(&scene, &numbers(picture.packed), 37 * 29);
        assert_eq!(indices(picture.radii), [0]);
    });
}

#[test]
fn extreme_numbers_give_finite_pictures_and_gradients() {
    for_each_device(|device| {
        let mut scene = Scene::random(4, 8);
        scene.log_scales[..3].fill(12.0);
        scene.log_scales[3..6].fill(-60.0);
        scene.log_scales[6..9].copy_from_slice(&[9.0, -9.0, -9.0]);
        scene.opacity_logits[3] = 80.0;
        scene.opacity_logits[4] = -200.0;
        scene.means[17] = 0.25;
        scene.means[18] = 1e6;
        scene.quaternions[28..32].iter_mut().for_each(|q| *q *= 1e-8);
        let all = gradients::all_numbers(&scene, &device.autodiff(), DType::F32);
        assert!(all.iter().flatten().all(|x| x.is_finite()));
    });
}

/// Single precision against double precision, where the covariance's larger eigenvalue is 1e12 to 1e20 times the other.
#[test]
fn the_scales_of_a_long_thin_gaussian_have_gradients_in_single_precision() {
    for_each_device(|device| {
        let mut scene = Scene::random(8, 6);
        for (index, scales) in scene.log_scales.chunks_mut(3).enumerate() {
            scales.copy_from_slice(&[10.0 + 1.5 * index as f64, -4.0, -6.0]);
        }
        let device = device.autodiff();
        let [found, wanted] = [DType::F32, DType::F64].map(|dtype| gradients::all_numbers(&scene, &device, dtype));
        let largest = wanted[3].iter().fold(0f64, |largest, v| largest.max(v.abs()));
        for (found, wanted) in found[3].iter().zip(&wanted[3]) {
            assert!((found - wanted).abs() < 1e-3 * largest, "{found} for {wanted}");
        }
    });
}

#[test]
fn wrong_arguments_are_named() {
    for_each_device(|device| {
        let good = Scene::random(6, 4).inputs(&device, DType::F32);
        let refused = |inputs: SplatInputs| {
            splat(inputs, None, &camera(), &settings(SplatRules::inria())).expect_err("it is wrong").to_string()
        };
        let wrong = |shape: [usize; 2]| Tensor::<2>::zeros(shape, &device);
        assert!(refused(SplatInputs { means: wrong([4, 2]), ..good.clone() }).contains("`means`"));
        assert!(refused(SplatInputs { quaternions: wrong([4, 3]), ..good.clone() }).contains("`quaternions`"));
        assert!(refused(SplatInputs { log_scales: wrong([5, 3]), ..good.clone() }).contains("`log_scales`"));
        let few = Tensor::<3>::zeros([4, 4, 3], &device);
        assert!(refused(SplatInputs { sh: few, ..good.clone() }).contains("`sh`"));
        assert!(refused(SplatInputs { features: Some(wrong([3, 2])), ..good.clone() }).contains("`features`"));
        assert!(refused(SplatInputs { features: None, ..good.clone() }).contains("`background`"));
        let double = good.opacity_logits.clone().cast(DType::F64);
        assert!(refused(SplatInputs { opacity_logits: double, ..good.clone() }).contains("`opacity_logits`"));

        let high = SplatSettings { sh_degree: 4, ..settings(SplatRules::inria()) };
        assert_eq!(splat(good.clone(), None, &camera(), &high).expect_err("too high"), SplatError::Degree(4));
        let nothing = Camera { width: 0, ..camera() };
        let refused = splat(good.clone(), None, &nothing, &settings(SplatRules::inria())).expect_err("no pixels");
        assert_eq!(refused, SplatError::Size { width: 0, height: 29 });
        // Either one row, or one row per Gaussian.
        let probe = Tensor::<2>::zeros([3, 2], &device);
        let refused = splat(good, Some(probe), &camera(), &settings(SplatRules::inria())).expect_err("wrong probe");
        assert!(refused.to_string().contains("`probe`"));
    });
}

#[cfg(all(feature = "flex", feature = "ndarray"))]
#[test]
fn tensors_on_two_devices_are_refused_by_name() {
    let [own, other] = crate::test_support::two_devices();
    let scene = Scene::random(6, 4);
    let (good, elsewhere) = (scene.inputs(&own, DType::F32), scene.inputs(&other, DType::F32));
    let refused = |inputs: SplatInputs, probe: Option<Tensor<2>>| {
        splat(inputs, probe, &camera(), &settings(SplatRules::inria())).expect_err("two devices")
    };
    let colours = SplatInputs { sh: elsewhere.sh.clone(), ..good.clone() };
    assert_eq!(refused(colours, None), SplatError::OtherDevice { argument: "sh" });
    let features = SplatInputs { features: elsewhere.features.clone(), ..good.clone() };
    assert_eq!(refused(features, None), SplatError::OtherDevice { argument: "features" });
    // The others are compared with the first.
    let means = SplatInputs { means: elsewhere.means.clone(), ..good.clone() };
    assert_eq!(refused(means, None), SplatError::OtherDevice { argument: "quaternions" });
    let probe = Tensor::<2>::zeros([1, 2], &other.autodiff());
    let said = refused(good, Some(probe));
    assert_eq!(said.to_string(), "`probe` is on another device than `means`: move all arguments to one device");
}

#[test]
fn tensors_with_and_without_autodiff_are_on_one_device() {
    for_each_device(|device| {
        let scene = Scene::random(6, 4);
        let plain = scene.inputs(&device, DType::F32);
        let tracked = scene.inputs(&device.autodiff(), DType::F32);
        let mixed = SplatInputs { means: tracked.means, ..plain };
        splat(mixed, None, &camera(), &settings(SplatRules::inria())).expect("one device");
    });
}

#[test]
fn tensors_beyond_the_buffers_of_a_device_are_refused_by_name() {
    let camera = camera();
    let picture = 4 * 2 * 7 * (camera.width * camera.height) as u64;
    let few = SplatSizes { count: 10, coefficients: 1, features: 2 };
    assert_eq!(check_buffers(few, &camera, picture), Ok(()));
    let refused = check_buffers(few, &camera, picture - 1).expect_err("one byte is missing").to_string();
    assert!(refused.contains("picture") && refused.contains("`--device cpu`"), "{refused}");
    let many = SplatSizes { count: 1 << 20, coefficients: 16, features: 0 };
    let refused = check_buffers(many, &camera, 128 << 20).expect_err("16 M rows do not fit").to_string();
    assert!(refused.contains("spherical harmonics") && refused.contains("201326592"), "{refused}");
}
