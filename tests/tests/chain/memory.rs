//! Memory of a refresh of the motion statistics.

use burn::tensor::{DType, Tensor};
use mvfusion_model::config::{GridConfig, MotionConfig};
use mvfusion_model::motion::{MotionCache, Normalisers, Trajectories};
use mvfusion_model::network::{DeformationConfig, DeformationNetwork, LayerInit, Masks};
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

/// Fewer samples than the default: memory that grows with the number of Gaussians does not depend on them.
const FEW_SAMPLES: usize = 4;

/// Bytes beyond the cache that a refresh holds at most.
fn refresh(network: &DeformationNetwork, means: &Tensor<2>, samples: usize) -> usize {
    let timeline = Timeline::new((0..300).map(|frame| f64::from(frame) / 300.0).collect());
    let config = MotionConfig { samples, ..MotionConfig::default() };
    let (cache, peak) = peak_during(|| {
        let trajectories = Trajectories { network, timeline: &timeline, config: &config, extent: 2.0 };
        let statistics = trajectories.measure(means).expect("the device hands its numbers back");
        MotionCache::new(statistics, &mut Normalisers::default(), &config, means)
    });
    let entries = [&cache.signatures, &cache.local, &cache.intensity].map(|table| table.dims().iter().product::<usize>());
    peak.saturating_sub(entries.iter().sum::<usize>() * size_of::<f32>())
}

/// What a refresh of 200,000 Gaussians and 64 samples needs, at most: all Gaussians with few samples, and beside them
/// one chunk with all samples.
fn need(device: &burn::tensor::Device) -> usize {
    let stream = &mut Stream::new(1, 0);
    let config = DeformationConfig {
        layout: GridConfig::default().layout(),
        bounds: GridBounds { max: [1.0; 3], min: [-1.0; 3] },
        width: 128,
        depth: 1,
        masks: Masks::Predicted,
    };
    let network = config.init(&mut LayerInit { device, dtype: DType::F32, stream });
    let values: Vec<f64> = (0..GAUSSIANS * 3).map(|_| stream.uniform(-1.0, 1.0)).collect();
    let means: Tensor<2> = tensor(&values, [GAUSSIANS, 3], device, DType::F32);
    let motion = MotionConfig::default();
    let chunk = means.clone().narrow(0, 0, motion.chunk);
    refresh(&network, &means, FEW_SAMPLES) + refresh(&network, &chunk, motion.samples)
}

#[test]
fn a_refresh_of_motion_statistics_needs_little_memory_beyond_its_cache() {
    if let Some(report) = child::report_path() {
        let needs: Vec<usize> = backends().iter().map(|backend| need(&(backend.device)())).collect();
        std::fs::write(report, serde_json::to_string(&needs).expect("numbers serialise")).expect("a report is written");
        return;
    }
    // In a process of its own: other tests would add to the count.
    let test = "memory::a_refresh_of_motion_statistics_needs_little_memory_beyond_its_cache";
    let needs: Vec<usize> = serde_json::from_str(&child::run_alone(test, &[])).expect("the report holds numbers");
    assert_eq!(needs.len(), backends().len());
    assert!(needs.iter().all(|&need| need > 0 && need < LIMIT), "bytes needed: {needs:?}, allowed: {LIMIT}");
}
