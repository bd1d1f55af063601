//! `motion_stats` and `normaliser`: trajectory statistics and their normalisation over several refreshes.

use anyhow::Result;
use burn::tensor::{DType, Device, Tensor};
use mvfusion_model::config::{FusionWeights, MotionConfig};
use mvfusion_model::model::motion::{
    MotionCache, MovingNormaliser, Normalisers, SIGNATURE_WIDTH, Trajectories, TrajectoryStatistics,
};
use mvfusion_model::model::network::DeformationNetwork;
use mvfusion_model::timeline::{Timeline, spread, strided};
use mvfusion_tests::{Array, Checklist, Tolerance, tensor};

use crate::archive::Archive;
use crate::network::deformation;

/// Of descriptors before normalisation; from the README of the oracle.
const RAW: Tolerance = Tolerance::of_largest(5e-5).plus(1e-7);

/// Of normalised descriptors.
const NORMALISED: Tolerance = Tolerance::absolute(2e-4);

/// Of times, which are given in double precision.
const TIMES: Tolerance = Tolerance::absolute(1e-12);

/// Of the state of the normaliser on given descriptors.
const STATE: Tolerance = Tolerance::of_largest(1e-5);

/// Of what the normaliser makes of given descriptors.
const GIVEN_NORMALISED: Tolerance = Tolerance::absolute(2e-5);

/// Knots of the coarser dictionary in the file.
const FEW_KNOTS: usize = 10;

/// Outputs that are not compared.
pub const LEFT_OUT: &[(&str, &str)] = &[
    ("out.theta", "an intermediate; its mean and variance are part of V_raw"),
    ("out.iso", "an intermediate; its mean and variance are part of V_raw"),
    ("out.aniso", "an intermediate; its mean and variance are part of V_raw"),
];

/// A file's network and settings.
struct Setting {
    network: DeformationNetwork,
    timeline: Timeline,
    config: MotionConfig,
    extent: f64,
}

impl Setting {
    fn read(archive: &Archive, device: &Device) -> Result<Self> {
        let config = MotionConfig {
            samples: archive.count("in.K")?,
            window: archive.count("in.w")?,
            knot_stride: archive.count("in.stride")?,
            // A chunk that does not divide the number of Gaussians.
            chunk: 5,
            ..MotionConfig::default()
        };
        Ok(Self {
            network: deformation(archive, device)?,
            timeline: Timeline::new(archive.array("in.train_times")?.values.clone()),
            config,
            extent: archive.number("in.ext")?,
        })
    }

    /// The statistics of the given centres.
    fn measure(&self, means: &Tensor<2>, config: &MotionConfig) -> Result<TrajectoryStatistics> {
        let trajectories = Trajectories {
            network: &self.network,
            timeline: &self.timeline,
            config,
            extent: self.extent,
            lifetimes: None,
        };
        Ok(trajectories.measure(means)?)
    }
}

/// The statistics of a file.
pub fn check(archive: &Archive, device: &Device) -> Result<()> {
    let setting = Setting::read(archive, device)?;
    let mut checks = Checklist::default();
    check_times(&mut checks, archive, &setting)?;
    check_raw(&mut checks, archive, &setting, device)?;
    check_refreshes(&mut checks, archive, &setting, device)?;
    checks.finish()
}

fn check_times(checks: &mut Checklist, archive: &Archive, setting: &Setting) -> Result<()> {
    let (timeline, config) = (&setting.timeline, &setting.config);
    let list = |times: Vec<f64>| Array::list(times);
    checks.close("unique_times", archive.array("out.unique_times")?, &list(timeline.times().to_vec()), TIMES);
    let samples = timeline.sample_indices(config.samples);
    checks.same("sample_index", &archive.counts("out.sample_index")?, &samples);
    let times: Vec<f64> = samples.iter().map(|&index| timeline.times()[index]).collect();
    checks.close("sample_times", archive.array("out.sample_times")?, &list(times.clone()), TIMES);
    let chosen = strided(samples.len(), config.knot_stride);
    checks.same("knot_sample_index", &archive.counts("out.knot_sample_index")?, &chosen);
    let knot_times = chosen.iter().map(|&knot| times[knot]).collect();
    checks.close("knot_times", archive.array("out.knot_times")?, &list(knot_times), TIMES);
    let few = spread(samples.len(), FEW_KNOTS);
    checks.same("knot10_sample_index", &archive.counts("out.knot10_sample_index")?, &few);
    let nearest: Vec<usize> =
        archive.array("in.query_times")?.values.iter().map(|&time| timeline.nearest(time)).collect();
    checks.same("nearest_index", &archive.counts("out.nearest_index")?, &nearest);
    Ok(())
}

fn check_raw(checks: &mut Checklist, archive: &Archive, setting: &Setting, device: &Device) -> Result<()> {
    let means = archive.tensor::<2>("in.xyz", device)?;
    let count = means.dims()[0];
    let statistics = setting.measure(&means, &setting.config)?;
    checks.close("V_raw", archive.array("out.V_raw")?, &signatures(&statistics), RAW);
    checks.close("e_knots_raw", archive.array("out.e_knots_raw")?, &local(&statistics), RAW);

    let position = statistics.position_only();
    let name = "out.V_positiononly_raw";
    checks.close(name, archive.array(name)?, &signatures(&position), RAW);
    let name = "out.intensity_position_only";
    checks.close(name, archive.array(name)?, &Array::list(position.intensities()), RAW);

    let few = MotionConfig { knots: FEW_KNOTS, ..setting.config.clone() };
    let few = setting.measure(&means, &few)?;
    checks.close("e_knots10_raw", archive.array("out.e_knots10_raw")?, &local(&few), RAW);

    let every_sample = MotionConfig { knot_stride: 1, ..setting.config.clone() };
    let every_sample = setting.measure(&means, &every_sample)?;
    checks.close("e_all_raw", archive.array("out.e_all_raw")?, &local(&every_sample), RAW);
    for (name, weights) in [
        ("out.intensity_supplement_weights", FusionWeights { position: 0.7, scale: 0.1, rotation: 0.2 }),
        ("out.intensity_position_only", FusionWeights { position: 1.0, scale: 0.0, rotation: 0.0 }),
    ] {
        let weighted = setting.measure(&means, &MotionConfig { weights, ..setting.config.clone() })?;
        checks.close(name, archive.array(name)?, &Array::list(weighted.intensities()), RAW);
    }

    let samples = setting.timeline.sample_indices(setting.config.samples);
    let some = archive.counts("out.some_index")?;
    let (mut displacements, mut log_scales) = (vec![0.0; count * some.len() * 3], vec![0.0; count * some.len() * 3]);
    for (place, &sample) in some.iter().enumerate() {
        let time = setting.timeline.times()[samples[sample]];
        let time = tensor(&[time], [1, 1], device, DType::F32);
        let offsets = setting.network.decode(setting.network.feature(means.clone(), time));
        let found = [Array::of(offsets.means() / setting.extent), Array::of(offsets.log_scales())];
        for (all, found) in [&mut displacements, &mut log_scales].into_iter().zip(found) {
            for (row, values) in found.values.chunks_exact(3).enumerate() {
                let begin = (row * some.len() + place) * 3;
                all[begin..begin + 3].copy_from_slice(values);
            }
        }
    }
    let shape = [count, some.len(), 3];
    for (name, values) in [("out.dpos_over_ext.some", displacements), ("out.dlogscale.some", log_scales)] {
        checks.close(name, archive.array(name)?, &Array::new(shape, values), RAW);
    }
    Ok(())
}

/// Refreshes with changing numbers of Gaussians, through the cache that training uses.
fn check_refreshes(checks: &mut Checklist, archive: &Archive, setting: &Setting, device: &Device) -> Result<()> {
    let mut normalisers = Normalisers::default();
    let mut last = None;
    for (refresh, count) in archive.counts("in.refresh_n")?.into_iter().enumerate() {
        let shift = archive.tensor::<2>(&format!("in.refresh_shift{refresh}"), device)?;
        let means = archive.tensor::<2>("in.xyz", device)?.narrow(0, 0, count) + shift;
        let statistics = setting.measure(&means, &setting.config)?;
        let mut compare = |name: &str, found: Array, tolerance| -> Result<()> {
            let name = format!("out.r{refresh}.{name}");
            checks.close(&name, archive.array(&name)?, &found, tolerance);
            Ok(())
        };
        compare("V_raw", signatures(&statistics), RAW)?;
        compare("e_raw", local(&statistics), RAW)?;
        let cache = MotionCache::new(statistics, &mut normalisers, &setting.config, &means)?;
        compare("V_norm", Array::of(cache.signatures.clone()), NORMALISED)?;
        compare("e_norm", Array::of(cache.local.clone()), NORMALISED)?;
        compare("mu_V", Array::list(normalisers.signatures.means.clone()), RAW)?;
        compare("var_V", Array::list(normalisers.signatures.variances.clone()), RAW)?;
        compare("mu_e", Array::list(normalisers.local.means.clone()), RAW)?;
        compare("var_e", Array::list(normalisers.local.variances.clone()), RAW)?;
        last = Some(cache);
    }
    let Some(cache) = last else { return Ok(()) };
    let columns = archive.array("in.query_times")?.values.iter().map(|&time| cache.local_at(time)).collect();
    checks.close("e_query", archive.array("out.e_query")?, &Array::of(Tensor::cat(columns, 1)), NORMALISED);
    Ok(())
}

fn signatures(statistics: &TrajectoryStatistics) -> Array {
    Array::new([statistics.len(), SIGNATURE_WIDTH], statistics.signatures.clone())
}

fn local(statistics: &TrajectoryStatistics) -> Array {
    Array::new([statistics.len(), statistics.knot_times.len()], statistics.local.clone())
}

/// The normaliser alone, on given descriptors. It knows no device.
pub fn check_normaliser(archive: &Archive, _device: &Device) -> Result<()> {
    let config = MotionConfig::default();
    let mut checks = Checklist::default();
    for (input, output, mean, variance, columns) in
        [("V", "V_norm", "mu", "var", SIGNATURE_WIDTH), ("e", "e_norm", "mu_e", "var_e", 1)]
    {
        let mut normaliser = MovingNormaliser::default();
        for refresh in 0..archive.count("in.n_refresh")? {
            let given = archive.array(&format!("in.{input}{refresh}"))?;
            normaliser.update(&given.values, columns, &config);
            let found = normaliser.normalise(&given.values, &config);
            let mut compare = |name: &str, found: Array, tolerance| -> Result<()> {
                let name = format!("out.{name}{refresh}");
                checks.close(&name, archive.array(&name)?, &found, tolerance);
                Ok(())
            };
            compare(output, Array::new(given.shape.clone(), found), GIVEN_NORMALISED)?;
            compare(mean, Array::list(normaliser.means.clone()), STATE)?;
            compare(variance, Array::list(normaliser.variances.clone()), STATE)?;
        }
    }
    checks.finish()
}
