//! Scratch.
#![allow(clippy::unwrap_used, clippy::print_stdout)]
use std::time::Instant;
use burn::tensor::{Device, Tensor, TensorData};
use glam::{DMat3, DVec3};
use mvfusion_data::Camera;
use mvfusion_render::splat::*;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

#[test]
#[ignore]
fn bench() {
    let n: usize = std::env::var("N").map_or(100_000, |x| x.parse().unwrap());
    let size: f64 = std::env::var("SIZE").map_or(0.02, |x| x.parse().unwrap());
    let f: usize = std::env::var("F").map_or(0, |x| x.parse().unwrap());
    let light = std::env::var("LIGHT").is_ok();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut u = |a: f64, b: f64| (a + (b - a) * rng.random::<f64>()) as f32;
    let device = Device::flex().autodiff();
    let t = |v: Vec<f32>, s: &[usize]| TensorData::new(v, s.to_vec());
    let means: Vec<f32> = (0..n).flat_map(|_| { let z = u(2.0, 6.0); [u(-1.1, 1.1) * z * 0.8, u(-1.1, 1.1) * z * 0.6, z] }).collect();
    let q: Vec<f32> = (0..4 * n).map(|_| u(-1.0, 1.0)).collect();
    let ls: Vec<f32> = (0..3 * n).map(|_| size.ln() as f32 + u(-0.8, 0.8)).collect();
    let o: Vec<f32> = (0..n).map(|_| u(-4.0, 2.0)).collect();
    let sh: Vec<f32> = (0..48 * n).map(|_| u(-0.3, 0.3)).collect();
    let feat: Vec<f32> = (0..f * n).map(|_| u(0.0, 1.0)).collect();
    let inputs = SplatInputs {
        means: Tensor::from_data(t(means, &[n, 3]), &device),
        quaternions: Tensor::from_data(t(q, &[n, 4]), &device),
        log_scales: Tensor::from_data(t(ls, &[n, 3]), &device),
        opacity_logits: Tensor::from_data(t(o, &[n]), &device),
        sh: Tensor::from_data(t(sh, &[n, 16, 3]), &device),
        features: (f > 0).then(|| Tensor::from_data(t(feat, &[n, f]), &device)),
        background: Tensor::zeros([3 + f], &device),
    };
    let (w, h) = (800, 600);
    let camera = Camera::centred(w, h, 500.0, DMat3::IDENTITY, DVec3::ZERO);
    let settings = SplatSettings { sh_degree: 3, ..Default::default() };
    let d = diagnose(&inputs, &camera, &settings).unwrap();
    println!("intersections {} evaluated {:.1} M contributing {:.1} M ({:.1} per pixel)", d.intersections, d.evaluated_pairs as f64 / 1e6, d.contributing_pairs as f64 / 1e6, d.contributing_pairs as f64 / (w * h) as f64);
    for _ in 0..4 {
        let a = Instant::now();
        let p = splat(inputs.clone(), None, &camera, &settings).unwrap();
        let fwd = a.elapsed().as_secs_f64();
        drop(p);
        let tr = SplatInputs { means: inputs.means.clone().require_grad(), sh: inputs.sh.clone().require_grad(), ..inputs.clone() };
        let probe = Tensor::<2>::zeros([1, 2], &device).require_grad();
        let p = splat(tr.clone(), Some(probe.clone()), &camera, &settings).unwrap();
        let l = p.main();
        let mut loss = (l.colour.clone() * l.colour).sum();
        if light { let l = p.light(); loss = loss + l.colour.powf_scalar(2.0).sum(); }
        let a = Instant::now();
        let g = loss.backward();
        let bwd = a.elapsed().as_secs_f64();
        let c = d.contributing_pairs as f64 / 1e6;
        println!("forward {:.1} ms = {:.0} M/s   backward {:.1} ms = {:.0} M/s", fwd * 1e3, c / fwd, bwd * 1e3, c / bwd);
        drop(g);
    }
}
