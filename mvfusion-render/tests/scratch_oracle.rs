//! Scratch.
#![allow(clippy::unwrap_used, clippy::print_stdout)]
use std::collections::HashMap;
use burn::tensor::{DType, Device, Tensor, TensorData};
use glam::{DMat3, DVec3};
use mvfusion_data::Camera;
use mvfusion_render::splat::*;

struct Scene(HashMap<String, (Vec<usize>, Vec<f64>)>);
impl Scene {
    fn load(name: &str) -> Self {
        let dir = format!("/tmp/oracle/{name}");
        Scene(std::fs::read_to_string(format!("{dir}/shapes.txt")).unwrap().lines().map(|l| {
            let mut w = l.split(' ');
            let k = w.next().unwrap().to_string();
            let shape: Vec<usize> = w.filter(|x| !x.is_empty()).map(|x| x.parse().unwrap()).collect();
            let b = std::fs::read(format!("{dir}/{k}.bin")).unwrap();
            let v = b.chunks(8).map(|c| f64::from_le_bytes(c.try_into().unwrap())).collect();
            (k, (shape, v))
        }).collect())
    }
    fn v(&self, k: &str) -> &[f64] { &self.0[k].1 }
    fn t<const D: usize>(&self, k: &str, d: &Device, t: DType) -> Tensor<D> {
        let (s, v) = &self.0[k];
        Tensor::from_data(TensorData::new(v.clone(), s.clone()).convert_dtype(t), (d, t))
    }
}
fn num<const D: usize>(t: Tensor<D>) -> Vec<f64> { t.into_data().iter::<f64>().collect() }
fn worst(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    let m = b.iter().fold(0.0f64, |m, x| m.max(x.abs()));
    a.iter().zip(b).fold(0.0f64, |m, (x, y)| if (x - y).abs() > m || (x-y).is_nan() { (x - y).abs() } else { m }) / m
}

#[test]
fn oracle() {
    for dtype in [DType::F64, DType::F32] {
        for name in ["s00_tiny_sh0", "s01_sh0", "s03_sh2", "s04_sh3", "s05_edge_sh3", "s07_ties_sh1", "s08_antialias_sh1"] {
            for clamp in ["a999", "a990"] { run(name, clamp, dtype); }
        }
    }
}
fn run(name: &str, clamp: &str, dtype: DType) {
    let s = Scene::load(name);
    let device = Device::flex().autodiff();
    let (w, h) = (s.v("width")[0] as usize, s.v("height")[0] as usize);
    let cams = s.0["viewmats"].0[0];
    let n = s.0["means"].0[0];
    let inputs = SplatInputs {
        means: s.t::<2>("means", &device, dtype).require_grad(),
        quaternions: s.t::<2>("quats", &device, dtype).require_grad(),
        log_scales: s.t::<2>("log_scales", &device, dtype).require_grad(),
        opacity_logits: s.t::<1>("logit_opacities", &device, dtype).require_grad(),
        sh: s.t::<3>("sh", &device, dtype).require_grad(),
        features: None,
        background: s.t::<1>("background", &device, dtype).require_grad(),
    };
    let mut rules = SplatRules::gsplat();
    rules.alpha_clamp = if clamp == "a999" { 0.999 } else { 0.99 };
    if name.contains("antialias") { rules.antialias = Antialias::Compensated; }
    let settings = SplatSettings { rules, sh_degree: s.v("sh_degree")[0] as usize, statistic: Statistic::ColourAndDepth };
    let v_image = s.t::<4>("v_image", &device, dtype);
    let v_alpha = s.t::<3>("v_alpha", &device, dtype);
    let v_depth = s.t::<3>("v_depth", &device, dtype);
    let mut loss = Tensor::<1>::zeros([1], (&device, dtype));
    let mut probes = vec![];
    let (mut e_img, mut e_alpha, mut e_depth, mut radii_bad, mut frag) = (0f64, 0f64, 0f64, 0, 0);
    let mut e_conic = 0f64;
    for c in 0..cams {
        let m = &s.v("viewmats")[16 * c..16 * c + 16];
        let k = &s.v("Ks")[9 * c..9 * c + 9];
        let camera = Camera { width: w, height: h, fx: k[0], fy: k[4], cx: k[2], cy: k[5],
            rotation: DMat3::from_cols(DVec3::new(m[0], m[4], m[8]), DVec3::new(m[1], m[5], m[9]), DVec3::new(m[2], m[6], m[10])),
            translation: DVec3::new(m[3], m[7], m[11]) };
        let probe = Tensor::<2>::zeros([1, 2], (&device, dtype)).require_grad();
        let p = splat(inputs.clone(), Some(probe.clone()), &camera, &settings).unwrap();
        probes.push(probe);
        let l = p.main();
        let img = num(l.colour.clone().permute([1, 2, 0]));
        let (al, de) = (num(l.alpha.clone()), num(l.depth.clone()));
        let px = w * h;
        let fr = &s.v(&format!("{clamp}_fragile"))[c * px..];
        let rdepth = s.v(&format!("{clamp}_depth_acc"));
        let dmax = rdepth.iter().fold(0f64, |m, x| m.max(*x));
        for i in 0..px {
            if fr[i] != 0.0 { frag += 1; continue; }
            for j in 0..3 { e_img = e_img.max((img[3 * i + j] - s.v(&format!("{clamp}_image"))[3 * (c * px + i) + j]).abs()); }
            e_alpha = e_alpha.max((al[i] - s.v(&format!("{clamp}_alpha"))[c * px + i]).abs());
            e_depth = e_depth.max((de[i] - rdepth[c * px + i]).abs() / dmax);
        }
        let d = diagnose(&inputs, &camera, &settings).unwrap();
        for i in 0..n {
            let r = &s.v("radii")[2 * (c * n + i)..][..2];
            if d.radii[i] != [r[0] as i32, r[1] as i32] { radii_bad += 1; if radii_bad < 4 { println!("radius {i} {:?} {r:?}", d.radii[i]); } }
            if d.radii[i][0] > 0 && r[0] > 0.0 { for j in 0..3 {
                let q = &s.v("conics")[3 * (c * n + i)..][..3];
                let m = q.iter().fold(0f64, |m, x| m.max(x.abs()));
                e_conic = e_conic.max((d.conics[i][j] - q[j]).abs() / m);
            } }
        }
        let vi = v_image.clone().slice([c..c + 1]).reshape([h, w, 3]).permute([2, 0, 1]);
        let va = v_alpha.clone().slice([c..c + 1]);
        let vd = v_depth.clone().slice([c..c + 1]);
        loss = loss + (l.colour * vi).sum() + (l.alpha * va).sum() + (l.depth * vd).sum();
    }
    let e_loss = (num(loss.clone())[0] / s.v(&format!("{clamp}_loss"))[0] - 1.0).abs();
    let g = loss.backward();
    println!("{name} {clamp} {dtype:?}: image {e_img:.1e} alpha {e_alpha:.1e} depth {e_depth:.1e} fragile {frag} radii wrong {radii_bad} conic {e_conic:.1e} loss {e_loss:.1e}");
    let pr = |k: &str, a: Vec<f64>| print!("   {k} {:.1e}", worst(&a, s.v(&format!("{clamp}_grad_{k}"))));
    pr("means", num(inputs.means.grad(&g).unwrap()));
    pr("quats", num(inputs.quaternions.grad(&g).unwrap()));
    pr("log_scales", num(inputs.log_scales.grad(&g).unwrap()));
    pr("logit_opacities", num(inputs.opacity_logits.grad(&g).unwrap()));
    pr("sh", num(inputs.sh.grad(&g).unwrap()));
    pr("background", num(inputs.background.grad(&g).unwrap()));
    let m2: Vec<f64> = probes.iter().flat_map(|p| num(p.grad(&g).unwrap())).enumerate().map(|(i, x)| x / if i % 2 == 0 { 0.5 * w as f64 } else { 0.5 * h as f64 }).collect();
    pr("means2d", m2);
    println!();
}
