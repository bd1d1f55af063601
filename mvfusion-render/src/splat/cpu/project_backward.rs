//! Gradients of the projection: from the records of the tiles to the raw parameters of one Gaussian per lane.

#![allow(clippy::needless_range_loop, reason = "closures over vectors are compiled without the instruction set")]

use mvfusion_kernels::sh::coefficient_count;
use mvfusion_kernels::splat::{COLOUR_CHANNELS, PROJECTED_LEN, ProjectedGradient, gradient_record, projected_row};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use super::cloud::Cloud;
use super::lanes::Lane;
use super::project::{Direction, GAUSSIANS_PER_JOB, Geometry, load_coefficients, scaled, sigmoid};
use super::sh;
use super::view::View;
use crate::simd::{Lanes, MAX_LANES, Number, Rows, Wide, cross, dot, to_rows};
use crate::splat::settings::Antialias;
use crate::splat::tensors::{SplatSizes, SplatTensors};

/// Gaussians whose records are summed together: one or more vectors. The records are scattered in memory and load
/// faster together.
const SUMMED: usize = MAX_LANES;

/// The positions of each Gaussian's records, see [`super::tiles::Bins`].
#[derive(Clone, Copy)]
pub(crate) struct RecordIndex<'a> {
    /// `[N, 2]`: start and number of each Gaussian's entries in `slots`.
    pub spans: &'a [i32],
    /// Rows of the records.
    pub slots: &'a [i32],
}

impl<'a> RecordIndex<'a> {
    /// The two parts of the `slots` of `count` Gaussians.
    pub fn of(slots: &'a [i32], count: usize) -> Self {
        let (spans, slots) = slots.split_at(2 * count);
        Self { spans, slots }
    }
}

/// Sums the records of each Gaussian in the order of its tiles and backpropagates the sum through the projection.
///
/// The gradient of the probe is the statistic in normalised device coordinates. The gradient of the background belongs
/// to no Gaussian and is left empty.
pub(crate) fn project_backward<T: Lane>(
    cloud: &Cloud<T>,
    view: &View<T>,
    projected: &[[T; PROJECTED_LEN]],
    index: RecordIndex,
    records: &[T],
) -> SplatTensors<Vec<T>> {
    let count = cloud.len();
    let mut gradients = cloud.sizes.columns().map(|columns| vec![T::zero(); count * columns]);
    let source = RecordSource { cloud, view, projected: projected.as_flattened(), index, records };
    let arch = Arch::new();
    jobs(&mut gradients, &cloud.sizes).into_par_iter().for_each(|job| arch.dispatch(GradientJob { source, job }));
    gradients
}

/// The rows of consecutive Gaussians in each gradient.
pub(super) struct Job<'a, T> {
    /// Index of the first Gaussian.
    pub first: usize,
    pub rows: SplatTensors<&'a mut [T]>,
}

/// Splits the gradients into jobs of [`GAUSSIANS_PER_JOB`] Gaussians.
pub(super) fn jobs<'a, T>(gradients: &'a mut SplatTensors<Vec<T>>, sizes: &SplatSizes) -> Vec<Job<'a, T>> {
    let (count, columns) = (sizes.count, sizes.columns());
    let mut rest = gradients.each_mut().map(Vec::as_mut_slice);
    let job = |first: usize| {
        let take = GAUSSIANS_PER_JOB.min(count - first);
        // Proof: each gradient has all its columns for every Gaussian.
        let rows = rest
            .each_mut()
            .zip(columns)
            .map(|(rest, columns)| rest.split_off_mut(..take * columns).expect("the rows are there"));
        Job { first, rows }
    };
    (0..count).step_by(GAUSSIANS_PER_JOB).map(job).collect()
}

/// The data that all jobs share.
#[derive(Clone, Copy)]
pub(super) struct RecordSource<'a, T> {
    pub cloud: &'a Cloud<'a, T>,
    pub view: &'a View<T>,
    /// Rows of [`PROJECTED_LEN`] numbers.
    pub projected: &'a [T],
    pub index: RecordIndex<'a>,
    pub records: &'a [T],
}

/// The gradients of a job.
pub(super) struct GradientJob<'a, T> {
    pub source: RecordSource<'a, T>,
    pub job: Job<'a, T>,
}

impl<T: Lane> WithSimd for GradientJob<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { source, mut job } = self;
        let record_len = gradient_record::len(source.cloud.channels());
        let mut sums = vec![T::zero(); SUMMED * record_len];
        for group in Rows::blocks(job.rows.opacity_logits.len(), SUMMED) {
            let mut seen = [false; SUMMED];
            for (i, record) in sums.chunks_exact_mut(record_len).take(group.count).enumerate() {
                seen[i] = source.sum_records(job.first + group.first + i, record);
            }
            for block in Rows::blocks(group.count, Wide::<S, T>::LANES) {
                let seen = &seen[block.first..block.first + block.count];
                if seen.contains(&true) {
                    let sums = Sums { records: &sums[block.first * record_len..], count: block.count };
                    let at = group.first + block.first;
                    let rows = Rows { first: job.first + at, count: block.count };
                    let gradients = source.pull_back(simd, rows, sums);
                    source.write(&mut job, at, seen, &gradients, sums);
                }
            }
        }
    }
}

/// The summed records of the Gaussians of a vector.
#[derive(Clone, Copy)]
struct Sums<'a, T> {
    /// Rows of `gradient_record::len(channels)` numbers.
    records: &'a [T],
    count: usize,
}

impl<T: Lane> Sums<'_, T> {
    /// `C` fields of the records.
    #[inline(always)]
    fn load<S: Simd, const C: usize>(&self, simd: S, channels: usize, from: usize) -> [Wide<S, T>; C] {
        Rows { first: 0, count: self.count }.load(simd, self.records, gradient_record::len(channels), from)
    }
}

impl<T: Lane> RecordSource<'_, T> {
    /// Sums the records of a Gaussian. Returns false if it has none.
    #[inline(always)]
    fn sum_records(&self, index: usize, record: &mut [T]) -> bool {
        let [begin, count] = [self.index.spans[2 * index], self.index.spans[2 * index + 1]].map(|x| x as usize);
        record.fill(T::zero());
        for &slot in &self.index.slots[begin..begin + count] {
            let part = &self.records[slot as usize * record.len()..][..record.len()];
            for (sum, &value) in record.iter_mut().zip(part) {
                *sum += value;
            }
        }
        count > 0
    }

    /// The gradients of Gaussians from their summed records.
    #[inline(always)]
    fn pull_back<S: Simd>(&self, simd: S, rows: Rows, sums: Sums<T>) -> Gradients<S, T> {
        let (cloud, view, channels) = (self.cloud, self.view, self.cloud.channels());
        let geometry = Geometry::of(simd, cloud, view, rows);
        let mut v_head = ProjectedGradient::from_row(&sums.load(simd, channels, 0));

        let [logit] = rows.load(simd, cloud.values.opacity_logits, 1, 0);
        let logit_opacity = sigmoid(logit);
        let whitening = geometry.whitening(view.dilation);
        if view.antialias == Antialias::Compensated {
            let v_compensation = v_head.opacity * logit_opacity;
            let v_whitened = geometry.compensation_gradient(v_compensation, &whitening);
            for entry in 0..3 {
                v_head.whitened[entry] = v_head.whitened[entry] + v_whitened[entry];
            }
        }
        let shape = geometry.shape_gradient(v_head.whitened, &whitening);
        let [v_depth] = sums.load(simd, channels, gradient_record::depth(channels));
        let v_point = geometry.point_gradient(simd, view, v_head.centre, v_depth, &shape);

        let colour: [_; COLOUR_CHANNELS] = rows.load(simd, self.projected, PROJECTED_LEN, projected_row::RED);
        let mut v_colour: [_; COLOUR_CHANNELS] = sums.load(simd, channels, gradient_record::RED);
        for channel in 0..COLOUR_CHANNELS {
            v_colour[channel] = colour[channel].value(0.0).less(colour[channel]).or_zero(v_colour[channel]);
        }
        let direction = Direction::between(simd, cloud, view, rows);
        let sh = load_coefficients(simd, cloud, view.sh_degree, rows);
        let v_unit = sh::direction_gradient(view.sh_degree, direction.unit, sh.as_flattened(), v_colour);
        let along = dot(direction.unit, v_unit);
        let mut mean = v_unit;
        for axis in 0..3 {
            let column = Wide::splat_each(simd, [0, 1, 2].map(|row| view.rotation[row][axis]));
            mean[axis] = dot(column, v_point) + (v_unit[axis] - direction.unit[axis] * along) / direction.distance;
        }
        let [x, y] = v_head.statistic;
        Gradients {
            valid: geometry.valid.to_lanes(),
            mean,
            quaternion: shape.quaternion,
            log_scales: shape.log_scales,
            // The difference from 1 of an opaque Gaussian has no digits left in single precision.
            opacity_logit: v_head.opacity * geometry.compensation(view.antialias) * logit_opacity * sigmoid(-logit),
            basis: sh::basis(view.sh_degree, direction.unit),
            colour: v_colour,
            probe: [x.times(view.width as f64 / 2.0), y.times(view.height as f64 / 2.0)],
        }
    }

    /// Writes the rows of the Gaussians that are seen, from row `at` of the job on.
    #[inline(always)]
    fn write<S: Simd>(&self, job: &mut Job<T>, at: usize, seen: &[bool], gradients: &Gradients<S, T>, sums: Sums<T>) {
        let (means, quaternions) = (to_rows(gradients.mean), to_rows(gradients.quaternion));
        let (log_scales, opacity_logits) = (to_rows(gradients.log_scales), gradients.opacity_logit.to_lanes());
        let (basis, colours, probe) = (to_rows(gradients.basis), to_rows(gradients.colour), to_rows(gradients.probe));
        let (sizes, sh_count) = (&self.cloud.sizes, coefficient_count(self.view.sh_degree));
        let records = sums.records.chunks_exact(gradient_record::len(sizes.channels()));
        for (lane, (&seen, record)) in seen.iter().zip(records).enumerate() {
            if !(seen && gradients.valid[lane]) {
                continue;
            }
            let (i, rows) = (at + lane, &mut job.rows);
            rows.means[3 * i..3 * i + 3].copy_from_slice(&means[lane]);
            rows.quaternions[4 * i..4 * i + 4].copy_from_slice(&quaternions[lane]);
            rows.log_scales[3 * i..3 * i + 3].copy_from_slice(&log_scales[lane]);
            rows.opacity_logits[i] = opacity_logits[lane];
            rows.probe[2 * i..2 * i + 2].copy_from_slice(&probe[lane]);
            let sh = rows.sh[3 * sizes.coefficients * i..].as_chunks_mut::<3>().0;
            for (row, value) in sh.iter_mut().zip(basis[lane]).take(sh_count) {
                *row = colours[lane].map(|v| v * value);
            }
            rows.features[sizes.features * i..sizes.features * (i + 1)]
                .copy_from_slice(&record[gradient_record::FEATURES..gradient_record::depth(sizes.channels())]);
        }
    }
}

/// The gradients of one Gaussian per lane.
struct Gradients<S: Simd, T: Lanes> {
    valid: [bool; MAX_LANES],
    mean: [Wide<S, T>; 3],
    quaternion: [Wide<S, T>; 4],
    log_scales: [Wide<S, T>; 3],
    opacity_logit: Wide<S, T>,
    /// The gradient of the coefficients is the outer product of the basis and the gradient of the colour.
    basis: [Wide<S, T>; sh::MAX_COEFFICIENTS],
    colour: [Wide<S, T>; COLOUR_CHANNELS],
    probe: [Wide<S, T>; 2],
}

/// Gradients through the covariance.
struct ShapeGradient<S: Simd, T: Lanes> {
    quaternion: [Wide<S, T>; 4],
    log_scales: [Wide<S, T>; 3],
    /// With respect to the Jacobian times the camera's rotation.
    jacobian: [[Wide<S, T>; 3]; 2],
}

/// `W` of [`ProjectedGradient::whitened`], and `W F` for the rows `F` of the undilated covariance `F Fᵀ`.
struct Whitening<S: Simd, T: Lanes> {
    /// `√curve_x`.
    along: Wide<S, T>,
    slope: Wide<S, T>,
    /// `√curve_y`.
    across: Wide<S, T>,
    /// At most one in absolute value.
    rows: [[Wide<S, T>; 3]; 2],
}

/// Cut to -1 and 1, which only rounding exceeds.
#[inline(always)]
fn bounded<S: Simd, T: Lanes>(x: Wide<S, T>) -> Wide<S, T> {
    x.at_least(x.value(-1.0)).at_most(x.value(1.0))
}

impl<S: Simd, T: Lane> Geometry<S, T> {
    /// The whitening of the covariance, see [`ProjectedGradient::whitened`].
    #[inline(always)]
    fn whitening(&self, dilation: T) -> Whitening<S, T> {
        let [_, xy, yy] = self.covariance;
        let [first, second] = [scaled(self.spread[0], self.scales), scaled(self.spread[1], self.scales)];
        let inverse = yy.value(1.0) / yy;
        let (along, across) = ((yy / self.determinant).sqrt(), inverse.sqrt());
        // `first + slope second` would cancel for a long, thin Gaussian: it is `second x (first x second) / yy` and the
        // dilation's share.
        let normal = cross(first, second);
        let sheared = cross(second, [normal[0] * inverse, normal[1] * inverse, normal[2] * inverse]);
        let dilated = inverse * dilation;
        let mut rows = [sheared, second];
        for j in 0..3 {
            rows[0][j] = bounded(along * (sheared[j] + dilated * first[j]));
            rows[1][j] = bounded(across * second[j]);
        }
        Whitening { along, slope: -xy * inverse, across, rows }
    }

    /// Gradient of the whitened covariance through the compensation of the opacity, zero at its lower bound. With
    /// `k = sqrt(sharp / det)`, `dk = k / 2 (d ln sharp - d ln det)`; for the whitened rows `G`, the gradients of the
    /// logarithms are the inverse of `G Gᵀ`, whose determinant is `k²`, and the identity.
    #[inline(always)]
    fn compensation_gradient(&self, v_compensation: Wide<S, T>, whitening: &Whitening<S, T>) -> [Wide<S, T>; 3] {
        let ratio = self.sharp_determinant / self.determinant;
        let scale = v_compensation.times(0.5) * ratio.sqrt();
        let [first, second] = whitening.rows;
        let sharp = scale / ratio;
        let gradient = [
            sharp * dot(second, second) - scale,
            sharp.times(-2.0) * dot(first, second),
            sharp * dot(first, first) - scale,
        ];
        let (bounded, zero) = (self.compensation_is_bounded(), scale.value(0.0));
        [bounded.select(zero, gradient[0]), bounded.select(zero, gradient[1]), bounded.select(zero, gradient[2])]
    }

    /// Gradient through `covariance = F Fᵀ + dilation`, `F = jacobian * rotation * diag(scales)`.
    #[inline(always)]
    fn shape_gradient(&self, [v_xx, v_xy, v_yy]: [Wide<S, T>; 3], whitening: &Whitening<S, T>) -> ShapeGradient<S, T> {
        let zero = v_xx.value(0.0);
        let (v_xx, v_yy) = (v_xx.times(2.0), v_yy.times(2.0));
        let Whitening { along, slope, across, rows: [first, second] } = *whitening;
        let (mut v_spread, mut log_scales) = ([[zero; 3]; 2], [zero; 3]);
        for j in 0..3 {
            let v_first = v_xx * first[j] + v_xy * second[j];
            let v_second = v_xy * first[j] + v_yy * second[j];
            log_scales[j] = first[j] * v_first + second[j] * v_second;
            v_spread[0][j] = along * v_first * self.scales[j];
            v_spread[1][j] = (along * slope * v_first + across * v_second) * self.scales[j];
        }
        let (mut v_rotation, mut v_jacobian) = ([[zero; 3]; 3], [[zero; 3]; 2]);
        for i in 0..3 {
            for j in 0..3 {
                v_rotation[i][j] = self.jacobian[0][i] * v_spread[0][j] + self.jacobian[1][i] * v_spread[1][j];
            }
            for axis in 0..2 {
                v_jacobian[axis][i] = dot(self.rotation[i], v_spread[axis]);
            }
        }
        ShapeGradient { quaternion: self.quaternion_gradient(v_rotation), log_scales, jacobian: v_jacobian }
    }

    /// Gradient through the rotation matrix and the normalisation of the quaternion.
    ///
    /// `R v = v + 2 (w a × v + a × (a × v))` with `a = (x, y, z)`. The code uses the antisymmetric and the symmetric
    /// part of the matrix's gradient.
    #[inline(always)]
    fn quaternion_gradient(&self, v: [[Wide<S, T>; 3]; 3]) -> [Wide<S, T>; 4] {
        let [w, x, y, z] = self.quaternion;
        let axis = [x, y, z];
        let twist = [v[2][1] - v[1][2], v[0][2] - v[2][0], v[1][0] - v[0][1]];
        let twice_trace = (v[0][0] + v[1][1] + v[2][2]).times(2.0);
        let mut v_unit = [dot(axis, twist).times(2.0); 4];
        for i in 0..3 {
            let symmetric = dot([v[i][0] + v[0][i], v[i][1] + v[1][i], v[i][2] + v[2][i]], axis);
            v_unit[i + 1] = (w * twist[i] + (symmetric - twice_trace * axis[i])).times(2.0);
        }
        let along = v_unit[0] * w + v_unit[1] * x + v_unit[2] * y + v_unit[3] * z;
        let mut gradient = v_unit;
        for i in 0..4 {
            gradient[i] = (v_unit[i] - self.quaternion[i] * along) / self.quaternion_norm;
        }
        gradient
    }

    /// Gradient of the mean in camera coordinates: through the centre, the depth and the Jacobian.
    #[inline(always)]
    fn point_gradient(
        &self,
        simd: S,
        view: &View<T>,
        v_centre: [Wide<S, T>; 2],
        v_depth: Wide<S, T>,
        shape: &ShapeGradient<S, T>,
    ) -> [Wide<S, T>; 3] {
        let depth = self.point[2];
        let guarded = depth + view.depth_guard;
        let forward = Wide::splat_each(simd, view.rotation[2]);
        let focal = Wide::splat_each(simd, view.focal);
        let mut v_point = [depth.value(0.0), depth.value(0.0), v_depth];
        for axis in 0..2 {
            let zoom = focal[axis] / guarded;
            v_point[axis] = v_point[axis] + zoom * v_centre[axis];
            v_point[2] = v_point[2] - zoom * self.point[axis] / guarded * v_centre[axis];
            // jacobian = focal / z (rotation row - tangent * rotation's last row)
            let zoom = focal[axis] / depth;
            v_point[2] = v_point[2] - dot(shape.jacobian[axis], self.jacobian[axis]) / depth;
            let v_tangent = -zoom * dot(shape.jacobian[axis], forward);
            let free = self.tangents_free[axis];
            v_point[axis] = v_point[axis] + free.or_zero(v_tangent / depth);
            v_point[2] = v_point[2] - free.or_zero(v_tangent * self.tangents[axis] / depth);
        }
        v_point
    }
}
