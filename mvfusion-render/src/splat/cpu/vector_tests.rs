//! The projection of several Gaussians per vector against that of one Gaussian at a time, and both against double
//! precision.

use mvfusion_kernels::splat::{PROJECTED_LEN, channel_count, gradient_record};
use pulp::{Scalar, WithSimd};

use super::cloud::Cloud;
use super::lanes::Lane;
use super::project::{ProjectionJob, Projections, project};
use super::project_backward::{GradientJob, RecordIndex, RecordSource, jobs, project_backward};
use super::view::View;
use crate::simd::MAX_LANES;
use crate::splat::tensors::{SplatSizes, SplatTensors};
use crate::splat::tests::{FEATURES, Scene, camera, rule_sets};
use crate::splat::{SplatRules, SplatSettings, Statistic};
use crate::test_support::random;

/// Coefficients of degree 3 and a surplus row.
const COEFFICIENTS: usize = 17;
/// Some hundred roundings in single precision, relative to the largest number of a column.
const TOLERANCE: f64 = 3e-5;

/// Gaussians, every third of which is culled for one reason or another.
fn scene(count: usize) -> Scene {
    let mut scene = Scene::random(11, count);
    scene.sh = random(12, 3 * COEFFICIENTS * count).into_iter().map(|u| u - 0.5).collect();
    for i in (1..count).step_by(3) {
        match i % 5 {
            0 => scene.means[3 * i + 2] = -3.0,
            1 => scene.means[3 * i] = f64::NAN,
            2 => scene.means[3 * i] = 500.0,
            3 => scene.quaternions[4 * i..4 * i + 4].fill(0.0),
            _ => scene.features[FEATURES * i] = f64::INFINITY,
        }
    }
    scene
}

fn values<T: Lane>(scene: &Scene) -> SplatTensors<Vec<T>> {
    let of = |values: &[f64]| values.iter().map(|&x| T::of(x)).collect();
    SplatTensors {
        means: of(&scene.means),
        quaternions: of(&scene.quaternions),
        log_scales: of(&scene.log_scales),
        opacity_logits: of(&scene.opacity_logits),
        sh: of(&scene.sh),
        features: of(&scene.features),
        background: of(&scene.background),
        probe: Vec::new(),
    }
}

fn cloud<'a, T: Lane>(values: &'a SplatTensors<Vec<T>>) -> Cloud<'a, T> {
    let sizes = SplatSizes { count: values.opacity_logits.len(), coefficients: COEFFICIENTS, features: FEATURES };
    Cloud { values: values.each_ref().map(Vec::as_slice), sizes }
}

fn view<T: Lane>(rules: SplatRules, sh_degree: usize) -> View<T> {
    View::new(&camera(), &SplatSettings { rules, sh_degree, statistic: Statistic::ColourAndDepth })
}

/// Up to two random records of each visible Gaussian.
struct Records {
    spans: Vec<i32>,
    slots: Vec<i32>,
    numbers: Vec<f64>,
}

impl Records {
    fn random<T>(projections: &Projections<T>) -> Self {
        let (mut spans, mut next) = (Vec::new(), 0);
        for (i, radii) in projections.radii.chunks(2).enumerate() {
            let count = if radii[0] > 0 { (i % 4).min(2) as i32 } else { 0 };
            spans.extend([next, count]);
            next += count;
        }
        let record_len = gradient_record::len(channel_count(FEATURES));
        let numbers = random(13, next as usize * record_len).into_iter().map(|u| u - 0.5).collect();
        Self { spans, slots: (0..next).rev().collect(), numbers }
    }

    fn index(&self) -> RecordIndex<'_> {
        RecordIndex { spans: &self.spans, slots: &self.slots }
    }

    fn gradients<T: Lane>(
        &self,
        cloud: &Cloud<T>,
        view: &View<T>,
        projections: &Projections<T>,
    ) -> SplatTensors<Vec<T>> {
        let numbers: Vec<T> = self.numbers.iter().map(|&x| T::of(x)).collect();
        project_backward(cloud, view, projections.records.as_chunks().0, self.index(), &numbers)
    }
}

/// One Gaussian after another, without vector instructions.
fn project_singly(cloud: &Cloud<f32>, view: &View<f32>) -> Projections<f32> {
    let (mut records, mut radii) = (vec![0.0; cloud.len() * PROJECTED_LEN], vec![0; cloud.len() * 2]);
    let (record_rows, radius_rows) = (records.as_chunks_mut().0, radii.as_chunks_mut().0);
    let job = ProjectionJob { cloud, view, first: 0, records: record_rows, radii: radius_rows };
    job.with_simd(Scalar::new());
    Projections { records, radii }
}

fn gradients_singly(
    cloud: &Cloud<f32>,
    view: &View<f32>,
    projections: &Projections<f32>,
    records: &Records,
) -> SplatTensors<Vec<f32>> {
    let mut gradients = cloud.sizes.columns().map(|columns| vec![0.0; cloud.len() * columns]);
    let numbers: Vec<f32> = records.numbers.iter().map(|&x| x as f32).collect();
    let source =
        RecordSource { cloud, view, projected: &projections.records, index: records.index(), records: &numbers };
    for job in jobs(&mut gradients, &cloud.sizes) {
        GradientJob { source, job }.with_simd(Scalar::new());
    }
    gradients
}

fn bits(numbers: &[f32]) -> Vec<u32> {
    numbers.iter().map(|x| x.to_bits()).collect()
}

#[test]
fn a_vector_of_gaussians_gives_the_bits_of_one_at_a_time_whatever_their_number() {
    for rules in rule_sets() {
        for degree in 0..=3 {
            let view = view(rules, degree);
            for count in 1..=2 * MAX_LANES + 1 {
                let values = values::<f32>(&scene(count));
                let cloud = cloud(&values);
                let (found, wanted) = (project(&cloud, &view), project_singly(&cloud, &view));
                assert_eq!(found.radii, wanted.radii, "{count} Gaussians");
                assert_eq!(bits(&found.records), bits(&wanted.records), "{count} Gaussians");
                let records = Records::random(&found);
                let gradients = records.gradients(&cloud, &view, &found);
                let wanted = gradients_singly(&cloud, &view, &wanted, &records);
                let pairs = gradients.zip(wanted).map(|(a, b)| bits(&a) == bits(&b));
                assert!(pairs.into_array().into_iter().all(|equal| equal), "{count} Gaussians: {pairs:?}");
            }
        }
    }
}

#[test]
fn culled_gaussians_leave_no_trace_beside_visible_ones() {
    let count = 2 * MAX_LANES + 1;
    let values = values::<f32>(&scene(count));
    let (cloud, view) = (cloud(&values), view(SplatRules::gsplat(), 3));
    let projections = project(&cloud, &view);
    let gradients = Records::random(&projections).gradients(&cloud, &view, &projections);
    for i in 0..count {
        let culled = projections.radii[2 * i..2 * i + 2] == [0, 0];
        assert!(culled || i % 3 != 1, "Gaussian {i} is broken");
        if culled {
            let record = &projections.records[PROJECTED_LEN * i..][..PROJECTED_LEN];
            assert!(record.iter().all(|&x| x == 0.0), "Gaussian {i}");
            let rows = gradients.each_ref().zip(cloud.sizes.columns()).map(|(g, columns)| &g[columns * i..][..columns]);
            assert!(rows.into_array().into_iter().flatten().all(|&x| x == 0.0), "Gaussian {i}");
        }
    }
    let seen = projections.radii.chunks(2).filter(|radii| radii[0] > 0).count();
    assert!(seen > count / 3, "only {seen} Gaussians are visible");
    let all = gradients.into_array().into_iter().flatten().chain(projections.records);
    assert!(all.into_iter().all(f32::is_finite));
}

/// Asserts that the columns of two matrices agree, each relative to its largest number.
fn assert_columns_close(found: &[f32], wanted: &[f64], columns: usize, what: &str) {
    assert_eq!(found.len(), wanted.len(), "{what}");
    for column in 0..columns {
        let wanted = wanted.iter().skip(column).step_by(columns);
        let largest = wanted.clone().fold(0.0f64, |largest, x| largest.max(x.abs()));
        for (i, (&a, &b)) in found.iter().skip(column).step_by(columns).zip(wanted).enumerate() {
            assert!((f64::from(a) - b).abs() <= TOLERANCE * largest, "{what}, column {column} of {i}: {a}, not {b}");
        }
    }
}

#[test]
fn single_precision_agrees_with_double_precision() {
    for rules in rule_sets() {
        let scene = scene(60);
        let (single, double) = (values::<f32>(&scene), values::<f64>(&scene));
        let (single, double) = (cloud(&single), cloud(&double));
        let (single_view, double_view) = (view(rules, 3), view(rules, 3));
        let (found, wanted) = (project(&single, &single_view), project(&double, &double_view));
        assert_eq!(found.radii, wanted.radii);
        assert_columns_close(&found.records, &wanted.records, PROJECTED_LEN, "records");
        let records = Records::random(&wanted);
        let found = records.gradients(&single, &single_view, &found);
        let wanted = records.gradients(&double, &double_view, &wanted);
        let parts = found.zip(wanted).zip(single.sizes.columns()).zip(SplatTensors::NAMES);
        parts.map(|(((found, wanted), columns), name)| assert_columns_close(&found, &wanted, columns, name));
    }
}
