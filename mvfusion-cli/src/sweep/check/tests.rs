//! Compares the metric names that grids may use with those of an evaluation.

use image::{GrayImage, Luma, Rgb, RgbImage};
use mvfusion_model::evaluation::{
    AttentionFigures, Evaluator, LayerScores, ModuleFigures, Pair, Protocol, RefinementFigures, Regions, Scores,
    SmallMoversRecall, TemporalScores, ViewMetrics,
};
use mvfusion_model::train::picture_tensor;

use super::*;
use crate::device;
use crate::run::{self, RenderSpeed};
use crate::sweep::folder::metrics;

/// Large enough for MS-SSIM, which needs more than 160 pixels.
const SIDE: u32 = 176;

/// What an evaluator without networks says of two pictures that differ everywhere, and of their halves.
fn view_metrics() -> ViewMetrics {
    let device = device::open("cpu").expect("there is one").device;
    let picture = |shift: u32| {
        RgbImage::from_fn(SIDE, SIDE, |x, y| Rgb([x * 7 + y * 3 + shift, x + y * 5 + shift, x * y + shift].map(byte)))
    };
    let half = |is_left: bool| {
        GrayImage::from_fn(SIDE, SIDE, |x, _| Luma([if (x < SIDE / 2) == is_left { u8::MAX } else { 0 }]))
    };
    let shown = picture(9);
    let exact = picture_tensor(&shown, &device);
    let pair = Pair::new(shown, exact, picture(0));
    let regions = Regions { dynamic: half(true), still: half(false), movers: Some(half(true)) };
    Evaluator::without_lpips(Protocol::Mvfusion).metrics(&pair, None, Some(&regions)).expect("judged")
}

fn byte(number: u32) -> u8 {
    (number % 256) as u8
}

/// With what networks would say, which look at parts as at whole pictures.
fn with_lpips(scores: LayerScores) -> LayerScores {
    let some = Some(0.5);
    LayerScores { lpips_alex: some, lpips_vgg: some, lpips_alex_raw: some, lpips_vgg_raw: some, ..scores }
}

#[test]
fn the_names_that_are_known_are_those_of_a_run_that_has_everything() {
    let ViewMetrics { whole, dynamic, still, movers, .. } = view_metrics();
    let temporal = TemporalScores {
        t_lpips_alex: Some(0.5),
        t_lpips_vgg: Some(0.5),
        consecutive_lpips_alex: Some(0.5),
        consecutive_lpips_vgg: Some(0.5),
    };
    let scores = Scores {
        composed: with_lpips(whole),
        static_: Some(with_lpips(whole)),
        dynamic_region: dynamic.map(with_lpips),
        still_region: still.map(with_lpips),
        composed_shows: None,
        region_source: None,
        dynamic_minus_still_psnr: Some(-9.5),
        movers: movers.map(with_lpips),
        small_movers: Some(SmallMoversRecall { recall: 0.5, components: 3 }),
        mask_iou: Some(0.5),
        temporal: Some(temporal),
    };
    let mut results = run::specimen(scores);
    results.training_views = Some(scores);
    results.speed =
        Some(RenderSpeed { width: 8, height: 8, warm_up: 1, frames: 1, fps: 60.0, fps_without_mfta: Some(70.0) });
    let module = ModuleFigures {
        norm: 0.5,
        constant: 0.5,
        over_gaussians: 0.25,
        over_time: 0.25,
        active: Some(0.5),
        silent: Some(0.25),
    };
    results.refinement = Some(RefinementFigures {
        mvg: Some(module),
        mfta: Some(module),
        attention: Some(AttentionFigures { entropy: 0.5, uniform_entropy: 0.7 }),
    });
    let given: BTreeSet<String> = metrics(&results).into_keys().collect();
    let known: BTreeSet<String> = metric::all().into_iter().map(|metric| metric.name).collect();
    assert_eq!(known, given);
}
