//! Gradients of the projection: from the records of the tiles to the raw parameters.

use mvfusion_kernels::sh::coefficient_count;
use mvfusion_kernels::splat::{PROJECTED_LEN, Projected, ProjectedGradient, gradient_record};
use rayon::prelude::*;

use super::cloud::Cloud;
use super::lanes::Lane;
use super::project::{Direction, GAUSSIANS_PER_JOB, Geometry, dot, sigmoid};
use super::sh;
use super::view::View;
use crate::splat::settings::Antialias;
use crate::splat::tensors::{SplatSizes, SplatTensors};

/// Gaussians whose records are summed together. The records are scattered in memory and load faster together.
const SUMMED: usize = 16;

/// The positions of each Gaussian's records, see [`super::tiles::Bins`].
#[derive(Clone, Copy)]
pub(crate) struct RecordIndex<'a> {
    pub spans: &'a [i32],
    pub slots: &'a [i32],
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
    let source = RecordSource { cloud, view, projected, index, records };
    jobs(&mut gradients, &cloud.sizes).into_par_iter().for_each(|job| source.run(job));
    gradients
}

/// The rows of consecutive Gaussians in each gradient.
struct Job<'a, T> {
    /// Index of the first Gaussian.
    first: usize,
    rows: SplatTensors<&'a mut [T]>,
}

/// Splits the gradients into jobs of [`GAUSSIANS_PER_JOB`] Gaussians.
fn jobs<'a, T>(gradients: &'a mut SplatTensors<Vec<T>>, sizes: &SplatSizes) -> Vec<Job<'a, T>> {
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

struct RecordSource<'a, T> {
    cloud: &'a Cloud<'a, T>,
    view: &'a View<T>,
    projected: &'a [[T; PROJECTED_LEN]],
    index: RecordIndex<'a>,
    records: &'a [T],
}

impl<T: Lane> RecordSource<'_, T> {
    fn run(&self, mut job: Job<T>) {
        let record_len = gradient_record::len(self.cloud.channels());
        let (count, mut sums) = (job.rows.opacity_logits.len(), vec![T::zero(); SUMMED * record_len]);
        for begin in (0..count).step_by(SUMMED) {
            let mut seen = [false; SUMMED];
            let group = begin..count.min(begin + SUMMED);
            for ((i, seen), record) in group.clone().zip(&mut seen).zip(sums.chunks_exact_mut(record_len)) {
                *seen = self.sum_records(job.first + i, record);
            }
            for ((i, seen), record) in group.zip(seen).zip(sums.chunks_exact(record_len)) {
                if seen {
                    self.pull_back(&mut job, i, record);
                }
            }
        }
    }

    /// Sums the records of a Gaussian. Returns false if it has none.
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

    /// Writes the gradients of Gaussian `i` of the job.
    fn pull_back(&self, job: &mut Job<T>, i: usize, record: &[T]) {
        let (cloud, view, index, rows) = (self.cloud, self.view, job.first + i, &mut job.rows);
        let Some(geometry) = Geometry::of(cloud, view, index) else { return };
        let mut v_head = ProjectedGradient::from_row(&std::array::from_fn(|place| record[place]));
        let depth = gradient_record::depth(cloud.channels());

        let logit = cloud.values.opacity_logits[index];
        let logit_opacity = sigmoid(logit);
        let compensation = geometry.compensation(view.antialias);
        // The difference from 1 of an opaque Gaussian has no digits left in single precision.
        rows.opacity_logits[i] = v_head.opacity * compensation * logit_opacity * sigmoid(-logit);
        if view.antialias == Antialias::Compensated && !geometry.compensation_is_bounded() {
            let v_compensation = v_head.opacity * logit_opacity;
            geometry.add_compensation_gradient(v_compensation, view.dilation, &mut v_head.covariance);
        }
        let shape = geometry.shape_gradient(v_head.covariance);
        rows.quaternions[4 * i..4 * i + 4].copy_from_slice(&shape.quaternion);
        rows.log_scales[3 * i..3 * i + 3].copy_from_slice(&shape.log_scales);

        let v_point = geometry.point_gradient(view, v_head.centre, record[depth], &shape);
        let colour = Projected::from_row(&self.projected[index]).colour;
        let v_colour: [T; 3] = std::array::from_fn(|channel| {
            if colour[channel] > T::zero() { record[gradient_record::RED + channel] } else { T::zero() }
        });
        let v_offset = self.colour_gradient(index, v_colour, &mut rows.sh[3 * cloud.sizes.coefficients * i..]);
        for (axis, v_mean) in rows.means[3 * i..3 * i + 3].iter_mut().enumerate() {
            let column = [0, 1, 2].map(|row| view.rotation[row][axis]);
            *v_mean = dot(column, v_point) + v_offset[axis];
        }
        rows.features[cloud.sizes.features * i..cloud.sizes.features * (i + 1)]
            .copy_from_slice(&record[gradient_record::FEATURES..depth]);
        let half_size = [view.width, view.height].map(|size| T::of(size as f64 / 2.0));
        let [x, y] = v_head.statistic;
        rows.probe[2 * i..2 * i + 2].copy_from_slice(&[x * half_size[0], y * half_size[1]]);
    }

    /// Writes the gradient of the coefficients, and returns the gradient of the mean through the direction.
    fn colour_gradient(&self, index: usize, v_colour: [T; 3], v_sh: &mut [T]) -> [T; 3] {
        let degree = self.view.sh_degree;
        let direction = Direction::between(self.cloud, self.view, index);
        let basis = sh::basis(degree, direction.unit);
        let rows = v_sh.as_chunks_mut::<3>().0.iter_mut().take(coefficient_count(degree));
        for (row, value) in rows.zip(basis) {
            *row = v_colour.map(|v| v * value);
        }
        let v_unit = sh::direction_gradient(degree, direction.unit, self.cloud.sh_of(index), v_colour);
        let along = dot(direction.unit, v_unit);
        std::array::from_fn(|i| (v_unit[i] - direction.unit[i] * along) / direction.distance)
    }
}

/// Gradients through the covariance.
struct ShapeGradient<T> {
    quaternion: [T; 4],
    log_scales: [T; 3],
    /// With respect to the Jacobian times the camera's rotation.
    jacobian: [[T; 3]; 2],
}

impl<T: Lane> Geometry<T> {
    /// Adds the gradient of the covariance through the compensation of the opacity. With `k = sqrt(sharp / det)`,
    /// `dk = k / 2 (d ln sharp - d ln det)`.
    fn add_compensation_gradient(&self, v_compensation: T, dilation: T, v_covariance: &mut [T; 3]) {
        let half = T::of(0.5);
        let scale = half * v_compensation * (self.sharp_determinant / self.determinant).sqrt();
        let [xx, xy, yy] = self.covariance;
        let (sharp, full) = (scale / self.sharp_determinant, scale / self.determinant);
        v_covariance[0] += sharp * (yy - dilation) - full * yy;
        v_covariance[1] += T::of(-2.0) * xy * (sharp - full);
        v_covariance[2] += sharp * (xx - dilation) - full * xx;
    }

    /// Gradient through `covariance = F Fᵀ + dilation`, `F = jacobian * rotation * diag(scales)`.
    fn shape_gradient(&self, [v_xx, v_xy, v_yy]: [T; 3]) -> ShapeGradient<T> {
        let two = T::of(2.0);
        let scaled = self.spread.map(|row| [row[0] * self.scales[0], row[1] * self.scales[1], row[2] * self.scales[2]]);
        let v_scaled: [[T; 3]; 2] = [
            std::array::from_fn(|j| two * v_xx * scaled[0][j] + v_xy * scaled[1][j]),
            std::array::from_fn(|j| v_xy * scaled[0][j] + two * v_yy * scaled[1][j]),
        ];
        let v_spread = v_scaled.map(|row| [row[0] * self.scales[0], row[1] * self.scales[1], row[2] * self.scales[2]]);
        let v_rotation: [[T; 3]; 3] = std::array::from_fn(|i| {
            std::array::from_fn(|j| self.jacobian[0][i] * v_spread[0][j] + self.jacobian[1][i] * v_spread[1][j])
        });
        ShapeGradient {
            quaternion: self.quaternion_gradient(v_rotation),
            log_scales: std::array::from_fn(|j| scaled[0][j] * v_scaled[0][j] + scaled[1][j] * v_scaled[1][j]),
            jacobian: v_spread.map(|row| self.rotation.map(|r| dot(r, row))),
        }
    }

    /// Gradient through the rotation matrix and the normalisation of the quaternion.
    ///
    /// `R v = v + 2 (w a × v + a × (a × v))` with `a = (x, y, z)`. The code uses the antisymmetric and the symmetric
    /// part of the matrix's gradient.
    fn quaternion_gradient(&self, v: [[T; 3]; 3]) -> [T; 4] {
        let two = T::of(2.0);
        let [w, x, y, z] = self.quaternion;
        let axis = [x, y, z];
        let twist = [v[2][1] - v[1][2], v[0][2] - v[2][0], v[1][0] - v[0][1]];
        let trace = v[0][0] + v[1][1] + v[2][2];
        let symmetric = |i: usize| {
            let row: [T; 3] = std::array::from_fn(|j| v[i][j] + v[j][i]);
            dot(row, axis) - two * trace * axis[i]
        };
        let v_unit = [
            two * dot(axis, twist),
            two * (w * twist[0] + symmetric(0)),
            two * (w * twist[1] + symmetric(1)),
            two * (w * twist[2] + symmetric(2)),
        ];
        let along: T = v_unit.iter().zip(self.quaternion).map(|(&v, q)| v * q).sum();
        std::array::from_fn(|i| (v_unit[i] - self.quaternion[i] * along) / self.quaternion_norm)
    }

    /// Gradient of the mean in camera coordinates: through the centre, the depth and the Jacobian.
    fn point_gradient(&self, view: &View<T>, v_centre: [T; 2], v_depth: T, shape: &ShapeGradient<T>) -> [T; 3] {
        let depth = self.point[2];
        let guarded = depth + view.depth_guard;
        let mut v_point = [T::zero(), T::zero(), v_depth];
        for axis in 0..2 {
            let zoom = view.focal[axis] / guarded;
            v_point[axis] += zoom * v_centre[axis];
            v_point[2] -= zoom * self.point[axis] / guarded * v_centre[axis];
            // jacobian = focal / z (rotation row - tangent * rotation's last row)
            let zoom = view.focal[axis] / depth;
            v_point[2] -= dot(shape.jacobian[axis], self.jacobian[axis]) / depth;
            let v_tangent = -zoom * dot(shape.jacobian[axis], view.rotation[2]);
            if self.tangents_free[axis] {
                v_point[axis] += v_tangent / depth;
                v_point[2] -= v_tangent * self.tangents[axis] / depth;
            }
        }
        v_point
    }
}
