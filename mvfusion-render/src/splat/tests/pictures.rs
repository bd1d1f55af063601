//! The content of rendered images.

use super::*;
use crate::test_support::{for_each_device, numbers};

/// Rounding of sums of a few dozen terms in double precision.
const EXACT: f64 = 1e-11;
/// Single against double precision, for colours of about 1 and depths below 5.
const SINGLE: f64 = 2e-5;

/// The image by definition, pixel by pixel over all Gaussians in order of depth: colour, features, alpha, depth.
fn by_definition(scene: &Scene, seen: &SplatDiagnosis, camera: &Camera, rules: &SplatRules) -> Vec<f64> {
    let mut order: Vec<usize> = (0..scene.count).filter(|&i| seen.radii[i][0] > 0).collect();
    order.sort_by(|&a, &b| seen.depths[a].total_cmp(&seen.depths[b]).then(a.cmp(&b)));
    let (pixels, channels) = (camera.width * camera.height, 3 + FEATURES + 2);
    let mut picture = vec![0.0; channels * pixels];
    for pixel in 0..pixels {
        let (x, y) = (pixel % camera.width, pixel / camera.width);
        let mut light = 1.0;
        let mut sums = vec![0.0; channels];
        for &i in &order {
            let d = [x as f64 + 0.5 - seen.means2d[i][0], y as f64 + 0.5 - seen.means2d[i][1]];
            let [a, b, c] = seen.conics[i];
            let sigma = 0.5 * (a * d[0] * d[0] + c * d[1] * d[1]) + b * d[0] * d[1];
            let alpha = (seen.opacities[i] * (-sigma).exp()).min(rules.alpha_clamp);
            if !in_rectangle(seen, i, [x, y], rules) || alpha < 1.0 / 255.0 {
                continue;
            }
            if light * (1.0 - alpha) < 1e-4 {
                break;
            }
            let values = seen.colours[i].iter().chain(&scene.features[FEATURES * i..FEATURES * (i + 1)]);
            sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += alpha * light * value);
            sums[channels - 1] += alpha * light * seen.depths[i];
            light *= 1.0 - alpha;
        }
        sums.iter_mut().zip(&scene.background).for_each(|(sum, colour)| *sum += light * colour);
        sums[channels - 2] = 1.0 - light;
        sums.iter().enumerate().for_each(|(channel, sum)| picture[channel * pixels + pixel] = *sum);
    }
    picture
}

/// Whether the tile of a pixel is in the Gaussian's rectangle, by METHOD §8. gsplat's rectangle contains everything
/// visible.
fn in_rectangle(seen: &SplatDiagnosis, i: usize, pixel: [usize; 2], rules: &SplatRules) -> bool {
    if rules.extent == SplatRules::gsplat().extent {
        return true;
    }
    (0..2).all(|axis| {
        let (centre, radius) = (seen.means2d[i][axis] - 0.5, f64::from(seen.radii[i][axis]));
        let tile = (pixel[axis] / 16) as f64;
        tile >= ((centre - radius) / 16.0).trunc() && tile < ((centre + radius + 15.0) / 16.0).trunc()
    })
}

/// Image sizes: multiples of a tile's, other sizes, and sizes smaller than a tile.
const SIZES: [[usize; 2]; 5] = [[37, 29], [48, 16], [1, 1], [47, 2], [17, 33]];

#[test]
fn a_picture_is_what_the_rules_say() {
    for_each_device(|device| {
        for (seed, [width, height]) in SIZES.into_iter().enumerate() {
            let (scene, camera) = (Scene::random(seed as u64, 60), Camera { width, height, ..camera() });
            let inputs = scene.inputs(&device, DType::F64);
            for rules in rule_sets() {
                let seen = diagnose(&inputs, &camera, &settings(rules)).expect("shapes fit");
                let picture = splat(inputs.clone(), None, &camera, &settings(rules)).expect("shapes fit");
                let expected = by_definition(&scene, &seen, &camera, &rules);
                for (copy, found) in numbers(picture.packed).chunks(expected.len()).enumerate() {
                    let worst = found.iter().zip(&expected).fold(0.0f64, |m, (a, b)| m.max((a - b).abs()));
                    assert!(worst < EXACT, "copy {copy} of {width} x {height} is wrong by {worst} under {rules:?}");
                }
            }
        }
    });
}

#[test]
fn single_precision_is_close_to_double() {
    for_each_device(|device| {
        let scene = Scene::random(5, 200);
        let [double, single] = [DType::F64, DType::F32].map(|dtype| {
            let inputs = scene.inputs(&device, dtype);
            let picture = splat(inputs, None, &camera(), &settings(SplatRules::inria())).expect("shapes fit");
            (numbers(picture.packed), indices(picture.radii))
        });
        assert_eq!(double.1, single.1);
        let worst = double.0.iter().zip(&single.0).fold(0.0f64, |worst, (a, b)| worst.max((a - b).abs()));
        assert!(worst < SINGLE, "{worst}");
    });
}

#[test]
fn the_layers_are_slices_of_the_packed_picture() {
    for_each_device(|device| {
        let inputs = Scene::random(1, 20).inputs(&device, DType::F32);
        let picture = splat(inputs.clone(), None, &camera(), &settings(SplatRules::inria())).expect("shapes fit");
        let layers = picture.light();
        assert_eq!(layers.colour.dims(), [3, 29, 37]);
        assert_eq!(layers.features.expect("there are features").dims(), [FEATURES, 29, 37]);
        assert_eq!((layers.alpha.dims(), layers.depth.dims()), ([1, 29, 37], [1, 29, 37]));
        assert_eq!(numbers(picture.main().depth), numbers(layers.depth));

        let background = inputs.background.clone().narrow(0, 0, 3);
        let plain = SplatInputs { features: None, background, ..inputs };
        let plain = splat(plain, None, &camera(), &settings(SplatRules::inria())).expect("shapes fit");
        assert!(plain.main().features.is_none());
        assert_eq!(numbers(plain.main().colour), numbers(picture.main().colour));
        assert_eq!(numbers(plain.main().depth), numbers(picture.main().depth));
    });
}

#[test]
fn ties_in_depth_are_drawn_in_order_of_index() {
    for_each_device(|device| {
        let mut scene = Scene::random(2, 2);
        let straight_on = Camera::centred(16, 16, 20.0, DMat3::IDENTITY, DVec3::ZERO);
        scene.means = [0.0, 0.0, 3.0].repeat(2);
        scene.log_scales = vec![-1.0; 6];
        scene.opacity_logits = vec![6.0; 2];
        scene.sh = vec![0.0; scene.sh.len()];
        scene.features = vec![1.0, 0.0, 0.0, 1.0];
        let inputs = scene.inputs(&device, DType::F32);
        let layers = splat(inputs, None, &straight_on, &settings(SplatRules::inria())).expect("shapes fit").main();
        let features = numbers(layers.features.expect("there are features"));
        let middle = 8 * 16 + 8;
        assert!(features[middle] > 0.9 && features[256 + middle] < 0.1, "the first Gaussian covers the second");
    });
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    for_each_device(|device| {
        let device = device.autodiff();
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads start");
            // Enough for chunks of other lengths with other numbers of threads.
            pool.install(|| gradients::all_numbers(&Scene::random(3, 9000), &device, DType::F32))
        };
        let one = run(1);
        for threads in [2, 3, 7] {
            assert!(one == run(threads), "{threads} threads differ from one");
        }
    });
}

#[cfg(all(feature = "flex", feature = "ndarray"))]
#[test]
fn flex_and_ndarray_agree_to_the_bit() {
    let scene = Scene::random(4, 300);
    let [flex, ndarray] = [crate::device::flex(), crate::device::ndarray()]
        .map(|device| gradients::all_numbers(&scene, &device.autodiff(), DType::F32));
    assert!(flex == ndarray);
}
