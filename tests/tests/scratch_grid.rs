//! Temporary: the grid and window ops against the method oracles, with the worst error of each array printed.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a scratch test, to become libtest-mimic trials")]

use std::collections::BTreeMap;
use std::path::PathBuf;

use burn::tensor::{DType, Device, Tensor, TensorData};
use mvfusion_render::grid::regulariser::penalties;
use mvfusion_render::grid::{GridBounds, GridLayout, look_up};
use mvfusion_render::window::{Window, ssim_map, structure_map};

struct Array {
    shape: Vec<usize>,
    values: Vec<f64>,
}

type Oracle = BTreeMap<String, Array>;

fn oracle(name: &str) -> Option<Oracle> {
    let path = PathBuf::from(std::env::var_os("MVFUSION_ORACLES")?).join("oracle_method").join(name);
    let mut archive = npyz::npz::NpzArchive::open(path).unwrap();
    let names: Vec<String> = archive.array_names().map(str::to_owned).collect();
    let read = |name: String| {
        let array = archive.by_name(&name).unwrap().unwrap();
        assert_eq!(array.order(), npyz::Order::C);
        let shape = array.shape().iter().map(|&n| n as usize).collect();
        let values = match array.dtype().descr().as_str() {
            "'<f4'" => array.into_vec::<f32>().unwrap().into_iter().map(f64::from).collect(),
            "'<f8'" => array.into_vec::<f64>().unwrap(),
            "'<i8'" => array.into_vec::<i64>().unwrap().into_iter().map(|x| x as f64).collect(),
            other => panic!("{name}: {other}"),
        };
        (name, Array { shape, values })
    };
    Some(names.into_iter().map(read).collect())
}

fn layout(oracle: &Oracle, features: usize) -> GridLayout {
    let ints = |name: &str| -> Vec<usize> { oracle[name].values.iter().map(|&x| x as usize).collect() };
    GridLayout { features, resolution: ints("in.resolution").try_into().unwrap(), multipliers: ints("in.multires") }
}

/// `[F, height, width]` planes, as `[cells, F]`.
fn planes(oracle: &Oracle, prefix: &str, layout: &GridLayout) -> Vec<f64> {
    let mut out = vec![0.0; layout.cells() * layout.features];
    for plane in layout.planes() {
        let Some(array) = oracle.get(&format!("{prefix}plane_s{}_p{}", plane.scale, plane.pair)) else { continue };
        assert_eq!(array.shape, [layout.features, plane.height, plane.width]);
        for (i, value) in array.values.iter().enumerate() {
            let (feature, cell) = (i / plane.cells(), i % plane.cells());
            out[(plane.first_cell + cell) * layout.features + feature] = *value;
        }
    }
    out
}

fn tensor<const D: usize>(values: &[f64], shape: [usize; D], device: &Device, dtype: DType) -> Tensor<D> {
    Tensor::from_data(TensorData::new(values.to_vec(), shape), (device, dtype))
}

fn numbers<const D: usize>(tensor: Tensor<D>) -> Vec<f64> {
    tensor.cast(DType::F64).into_data().try_into_vec().unwrap()
}

/// Compares, and says how near the worst error comes to the tolerance.
fn compare(what: &str, found: &[f64], wanted: &[f64], relative: f64, absolute: f64) {
    assert_eq!(found.len(), wanted.len(), "{what}");
    let largest = wanted.iter().fold(0.0f64, |largest, x| largest.max(x.abs()));
    let worst = found.iter().zip(wanted).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    let allowed = relative * largest + absolute;
    println!("{what:60} worst {worst:9.2e} of max {largest:9.2e}, {:6.2} % of the tolerance", 100.0 * worst / allowed);
    assert!(worst <= allowed, "{what}: {worst} > {allowed}");
}

fn devices() -> Vec<(&'static str, Device)> {
    let mut devices = Vec::new();
    #[cfg(feature = "flex")]
    devices.push(("flex", mvfusion_render::device::flex().autodiff()));
    #[cfg(feature = "ndarray")]
    devices.push(("ndarray", mvfusion_render::device::ndarray().autodiff()));
    devices
}

fn hexplane(name: &str, backend: &str, device: &Device, dtype: DType) {
    let Some(oracle) = oracle(name) else { return };
    let layout = layout(&oracle, oracle["in.plane_s0_p0"].shape[0]);
    let aabb = &oracle["in.aabb"].values;
    let bounds = GridBounds { max: aabb[..3].try_into().unwrap(), min: aabb[3..].try_into().unwrap() };
    let count = oracle["in.xyz"].shape[0];
    let grid = tensor(&planes(&oracle, "in.", &layout), [layout.cells(), layout.features], device, dtype).require_grad();
    let points = tensor(&oracle["in.xyz"].values, [count, 3], device, dtype).require_grad();
    let times = tensor(&oracle["in.t"].values, [count, 1], device, dtype).require_grad();
    let cotangent = tensor(&oracle["in.cot"].values, [count, layout.feature_count()], device, dtype);
    let features = look_up(grid.clone(), points.clone(), times.clone(), &bounds, &layout).unwrap();
    let gradients = (features.clone() * cotangent).sum().backward();
    let label = |part: &str| format!("{name} {backend} {dtype:?} {part}");
    let check = |part: &str, found: Vec<f64>, wanted: &[f64]| compare(&label(part), &found, wanted, 5e-5, 1e-6);
    check("feat", numbers(features.inner()), &oracle["out.feat"].values);
    check("grad.xyz", numbers(points.grad(&gradients).unwrap()), &oracle["out.grad.xyz"].values);
    check("grad.t", numbers(times.grad(&gradients).unwrap()), &oracle["out.grad.t"].values);
    check("grad.planes", numbers(grid.grad(&gradients).unwrap()), &planes(&oracle, "out.grad.", &layout));
}

fn regularisers(name: &str, backend: &str, device: &Device, dtype: DType) {
    let Some(oracle) = oracle(name) else { return };
    let layout = layout(&oracle, oracle["in.plane_s0_p0"].shape[0]);
    let values = planes(&oracle, "in.", &layout);
    let label = |part: &str| format!("{name} {backend} {dtype:?} {part}");
    let check = |part: &str, found: Vec<f64>, wanted: &[f64]| compare(&label(part), &found, wanted, 2e-6, 1e-12);
    let run = |weights: [f64; 3]| {
        let grid = tensor(&values, [layout.cells(), layout.features], device, dtype).require_grad();
        let terms = penalties(grid.clone(), &layout).unwrap();
        let total = terms.plane_smooth.clone() * weights[0]
            + terms.time_smooth.clone() * weights[1]
            + terms.l1_time.clone() * weights[2];
        let gradients = total.clone().backward();
        (terms, numbers(total.inner()), numbers(grid.grad(&gradients).unwrap()))
    };
    let weights = ["in.w_plane", "in.w_time", "in.w_l1"].map(|weight| oracle[weight].values[0]);
    let (terms, total, gradient) = run(weights);
    check("plane_smooth", numbers(terms.plane_smooth.inner()), &oracle["out.plane_smooth"].values);
    check("time_smooth", numbers(terms.time_smooth.inner()), &oracle["out.time_smooth"].values);
    check("l1_time", numbers(terms.l1_time.inner()), &oracle["out.l1_time"].values);
    check("total", total, &oracle["out.total"].values);
    check("grad.total", gradient, &planes(&oracle, "out.grad.total.", &layout));
    check("grad.plane_smooth", run([1.0, 0.0, 0.0]).2, &planes(&oracle, "out.grad.plane_smooth.", &layout));
    check("grad.time_smooth", run([0.0, 1.0, 0.0]).2, &planes(&oracle, "out.grad.time_smooth.", &layout));
}

fn image_ops(name: &str, backend: &str, device: &Device, dtype: DType) {
    let Some(oracle) = oracle(name) else { return };
    let shape: [usize; 4] = oracle["in.a"].shape.clone().try_into().unwrap();
    let a = tensor(&oracle["in.a"].values, shape, device, dtype).require_grad();
    let b = tensor(&oracle["in.b"].values, shape, device, dtype);
    let cotangent = tensor(&oracle["in.cot"].values, shape, device, dtype);
    let label = |part: &str| format!("{name} {backend} {dtype:?} {part}");
    for (size, wanted) in [(11, "out.window11"), (5, "out.window5")] {
        let weights = Window::gaussian(size, 1.5);
        let weights: Vec<f64> = weights.weights().iter().map(|&weight| f64::from(weight)).collect();
        let square: Vec<f64> = weights.iter().flat_map(|row| weights.iter().map(move |column| row * column)).collect();
        compare(&label(wanted), &square, &oracle[wanted].values, 1e-6, 0.0);
    }
    let ssim = ssim_map(a.clone(), b.clone(), &Window::gaussian(11, 1.5));
    compare(&label("ssim_map"), &numbers(ssim.clone().inner()), &oracle["out.ssim_map"].values, 0.0, 1e-4);
    let mean = ssim.mean();
    let gradients = mean.backward();
    compare(&label("ssim"), &numbers(mean.inner()), &oracle["out.ssim"].values, 0.0, 1e-5);
    let gradient = numbers(a.grad(&gradients).unwrap());
    compare(&label("grad.ssim.a"), &gradient, &oracle["out.grad.ssim.a"].values, 5e-5, 0.0);
    let structure = structure_map(a.clone(), b, &Window::gaussian(5, 1.5));
    compare(&label("structure_map"), &numbers(structure.clone().inner()), &oracle["out.structure_map"].values, 0.0, 1e-4);
    let gradients = (structure * cotangent).sum().backward();
    let gradient = numbers(a.grad(&gradients).unwrap());
    compare(&label("grad.structure.a"), &gradient, &oracle["out.grad.structure.a"].values, 5e-5, 0.0);
}

#[test]
fn ops_meet_the_oracles() {
    for (backend, device) in &devices() {
        for dtype in [DType::F32, DType::F64] {
            for seed in 0..2 {
                hexplane(&format!("hexplane_seed{seed}.npz"), backend, device, dtype);
                regularisers(&format!("regularisers_seed{seed}.npz"), backend, device, dtype);
                image_ops(&format!("image_ops_seed{seed}.npz"), backend, device, dtype);
            }
        }
    }
}
