//! Memory of a refresh of the motion statistics.

use burn::tensor::{DType, Device, Tensor};
use mvfusion_model::config::{GridConfig, MotionConfig};
use mvfusion_model::model::motion::{MotionCache, Normalisers, Trajectories};
use mvfusion_model::model::network::{DeformationConfig, DeformationNetwork, HeadChoice, ModuleInit};
use mvfusion_model::random::Stream;
use mvfusion_model::timeline::Timeline;
use mvfusion_render::grid::GridBounds;
use mvfusion_tests::{backends, tensor};

use crate::allocations::peak_during;
use crate::child;

/// Gaussians of the dynamic branch, more than twice the most that the presets allow.
const GAUSSIANS: usize = 200_000;

/// What a refresh may need beyond its cache, in bytes.
const LIMIT: usize = 300_000_000;

/// Bytes beyond the cache that a refresh holds at most.
fn refresh(network: &DeformationNetwork, means: &Tensor<2>, config: &MotionConfig) -> usize {
    let timeline = Timeline::new((0..300).map(|frame| f64::from(frame) / 300.0).collect());
    let (cache, peak) = peak_during(|| {
        let trajectories = Trajectories { network, timeline: &timeline, config, extent: 2.0, lifetimes: None };
        let statistics = trajectories.measure(means).expect("the device hands its numbers back");
        let cache = MotionCache::new(statistics, &mut Normalisers::default(), config, means);
        cache.expect("the device hands its numbers back")
    });
    let entries =
        [&cache.signatures, &cache.local, &cache.intensity].map(|table| table.dims().iter().product::<usize>());
    peak.saturating_sub(entries.iter().sum::<usize>() * size_of::<f32>())
}

/// What a refresh of 200,000 Gaussians and 64 samples needs, at most: all Gaussians with few samples, and beside them
/// one chunk with all samples.
fn need(device: &Device) -> usize {
    let stream = &mut Stream::new(1, 0);
    let config = DeformationConfig {
        layout: GridConfig::default().layout(),
        bounds: GridBounds { min: [-1.0; 3], max: [1.0; 3] },
        width: 128,
        depth: 1,
        heads: HeadChoice::ALL,
    };
    let network = config.init(&mut ModuleInit { device, dtype: DType::F32, stream });
    let values: Vec<f64> = (0..GAUSSIANS * 3).map(|_| stream.uniform(-1.0, 1.0)).collect();
    let means: Tensor<2> = tensor(&values, [GAUSSIANS, 3], device, DType::F32);
    let motion = MotionConfig::default();
    let chunk = means.clone().narrow(0, 0, motion.chunk);
    // What grows with the number of Gaussians depends on the knots, not on the samples: as many knots as by default.
    let few_samples = MotionConfig { samples: 5, knot_stride: 1, ..motion.clone() };
    refresh(&network, &means, &few_samples) + refresh(&network, &chunk, &motion)
}

#[test]
fn a_refresh_of_motion_statistics_needs_little_memory_beyond_its_cache() {
    if let Some(report) = child::report_path() {
        let need = need(&(backends()[0].device)());
        std::fs::write(report, need.to_string()).expect("the report can be written");
        return;
    }
    // In a process of its own: other tests would add to the count.
    let test = "memory::a_refresh_of_motion_statistics_needs_little_memory_beyond_its_cache";
    let need: usize = child::run_alone(test, &[]).parse().expect("the report is a number");
    assert!(need > 0 && need < LIMIT, "{need} bytes are needed, {LIMIT} allowed");
}
