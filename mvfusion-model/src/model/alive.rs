//! The dynamic Gaussians that are alive at a moment, by their lifetimes. The others are neither deformed nor splatted.

use burn::module::Module;
use burn::tensor::{IndexingUpdateOp, Int, Tensor};
use glam::Vec3;

use crate::model::gaussians::{Attribute, Gaussians, LEAST_LOG_DURATION, MOST_LOG_DURATION};
use crate::{ModelError, tensors};

/// A Gaussian is not alive if its lifetime takes its opacity logit below this value. Its opacity is then 1e-4, a
/// thirtieth of the splat op's minimum. Offsets of the deformation, which could raise it, are ignored.
const LEAST_LOGIT: f32 = -9.0;

/// The rows of the Gaussians that are alive at a moment.
#[derive(Clone, Debug)]
pub struct AliveRows {
    rows: Tensor<1, Int>,
    /// Number of all Gaussians.
    count: usize,
}

impl AliveRows {
    /// The rows of `gaussians` that are alive at a time in `[0, 1]`; `None` if all are. With lifetimes, it waits for
    /// the device.
    ///
    /// # Errors
    /// If the device fails to return values.
    pub fn of(gaussians: &Gaussians, time: f64) -> Result<Option<Self>, ModelError> {
        // Proof: there is an entry for each time.
        Self::of_all(gaussians, &[time]).map(|mut all| all.pop().expect("one"))
    }

    /// The same for several times. It waits for the device once.
    ///
    /// # Errors
    /// If the device fails to return values.
    pub fn of_all(gaussians: &Gaussians, times: &[f64]) -> Result<Vec<Option<Self>>, ModelError> {
        if gaussians.time_centres.is_none() || times.is_empty() {
            return Ok(vec![None; times.len()]);
        }
        let logits = Tensor::cat(times.iter().map(|&time| gaussians.alive_logits(time)).collect(), 1);
        let logits: Vec<f32> = tensors::read(logits)?;
        let count = logits.len() / times.len();
        let alive_at = |index: usize| {
            let logit = |row: usize| logits[row * times.len() + index];
            let mut rows: Vec<usize> = (0..count).filter(|&row| logit(row) > LEAST_LOGIT).collect();
            // Ops do not accept an empty tensor.
            if rows.is_empty() {
                rows.push(0);
            }
            (rows.len() < count).then(|| Self { rows: tensors::rows_like(&rows, &gaussians.means.val()), count })
        };
        Ok((0..times.len()).map(alive_at).collect())
    }

    /// The rows, ascending.
    pub fn rows(&self) -> &Tensor<1, Int> {
        &self.rows
    }

    /// Scatters the values of the rows, `[n, C]`, to all Gaussians, `[N, C]`, with 0 for the others. Without autodiff.
    pub fn among_all(&self, values: Tensor<2>) -> Tensor<2> {
        let columns = values.dims()[1];
        let all = Tensor::zeros([self.count, columns], (&values.device(), values.dtype()));
        all.select_assign(0, self.rows.clone(), values, IndexingUpdateOp::Add)
    }

    /// The same for integers, `[n]` to `[N]`.
    pub fn among_all_int(&self, values: Tensor<1, Int>) -> Tensor<1, Int> {
        let all = Tensor::zeros([self.count], (&values.device(), values.dtype()));
        all.select_assign(0, self.rows.clone(), values, IndexingUpdateOp::Add)
    }
}

impl Gaussians {
    /// Centres of the Gaussians that are alive at a time in `[0, 1]`, moved by their velocities; without lifetimes, all
    /// centres.
    ///
    /// # Errors
    /// If the device fails to return values.
    pub fn centres_at(&self, time: f64) -> Result<Vec<Vec3>, ModelError> {
        let then = self.valid().at(time);
        let means: Vec<f32> = tensors::read(then.means)?;
        let centres = means.chunks_exact(3).map(Vec3::from_slice);
        Ok(centres.zip(self.alive_at(time)?).filter(|&(_, is_alive)| is_alive).map(|(centre, _)| centre).collect())
    }

    /// Which Gaussians are alive at a time in `[0, 1]`; without lifetimes, all.
    ///
    /// # Errors
    /// If the device fails to return values.
    pub(crate) fn alive_at(&self, time: f64) -> Result<Vec<bool>, ModelError> {
        if self.time_centres.is_none() {
            return Ok(vec![true; self.count()]);
        }
        let logits: Vec<f32> = tensors::read(self.alive_logits(time))?;
        Ok(logits.into_iter().map(|logit| logit > LEAST_LOGIT).collect())
    }

    /// Opacity logits at a time, including lifetimes, without autodiff: `[N, 1]`.
    fn alive_logits(&self, time: f64) -> Tensor<2> {
        let plain = |attribute| self.plain(attribute);
        let logits = self.opacity_logits.val().inner();
        match plain(Attribute::TimeCentres).zip(plain(Attribute::LogDurations)) {
            Some((centres, durations)) => {
                let durations = durations.clamp(LEAST_LOG_DURATION, MOST_LOG_DURATION);
                logits - ((-centres + time) * (-durations).exp()).powf_scalar(2.0)
            }
            None => logits,
        }
    }
}

#[cfg(test)]
mod tests {
    use burn::tensor::DType;
    use glam::Vec3;
    use mvfusion_data::{Lifetime, PointCloud};

    use super::*;
    use crate::initial::{Masking, cloud_on, gaussians_of};
    use crate::test_support::{for_each_device, values};

    /// Four Gaussians of opacity 0.1 at the origin: two that live for a tenth around 0.2 and 0.7 and travel along x,
    /// and two permanent ones.
    fn gaussians(device: &burn::tensor::Device) -> Gaussians {
        let points = PointCloud { positions: vec![Vec3::ZERO; 4], colours: vec![Vec3::ONE; 4] };
        let life = |centre, duration: f32| Lifetime { centre, log_duration: duration.ln(), velocity: [2.0, 0.0, 0.0] };
        let lifetimes = Some(vec![life(0.2, 0.1), life(0.7, 0.1), life(0.5, 1e3), life(0.5, 1e3)]);
        let cloud = mvfusion_data::GaussianCloud { lifetimes, ..cloud_on(&points, &[1.0; 4], 0.1) };
        gaussians_of(&cloud, Masking::Absent, 0, &device.clone().autodiff(), DType::F32)
    }

    #[test]
    fn a_gaussian_is_most_opaque_at_its_moment_and_travels() {
        for_each_device(|device| {
            let at = gaussians(&device).at(0.3);
            let logit = (0.1f64 / 0.9).ln();
            let logits = values(at.opacity_logits.inner());
            assert!(
                (logits[0] - (logit - 1.0)).abs() < 1e-4 && (logits[1] - (logit - 16.0)).abs() < 1e-3,
                "{logits:?}"
            );
            assert!((logits[2] - logit).abs() < 1e-5, "{logits:?}");
            let means = values(at.means.inner());
            assert!((means[0] - 0.2).abs() < 1e-6 && (means[3] + 0.8).abs() < 1e-6, "{means:?}");
        });
    }

    #[test]
    fn lifetimes_have_the_gradients_of_finite_differences() {
        for_each_device(|device| {
            let gaussians = gaussians(&device);
            // Sum of x and logits: d/dc = -v + 2 (t - c) / w^2, d/d ln w = 2 ((t - c) / w)^2, d/dv = t - c.
            let at = gaussians.at(0.25);
            let gradients = (at.means.narrow(1, 0, 1).sum() + at.opacity_logits.sum()).backward();
            let of = |attribute| {
                let parameter = gaussians.attribute(attribute).expect("it has lifetimes").val();
                values(parameter.grad(&gradients).expect("it took part"))
            };
            let near = |found: f64, expected: f64| assert!((found - expected).abs() < 1e-3, "{found}, not {expected}");
            near(of(Attribute::TimeCentres)[0], -2.0 + 2.0 * 0.05 / 0.01);
            near(of(Attribute::LogDurations)[0], 2.0 * 0.25);
            near(of(Attribute::Velocities)[0], 0.05);
        });
    }

    #[test]
    fn those_that_are_not_there_are_left_out() {
        for_each_device(|device| {
            let gaussians = gaussians(&device);
            let alive = AliveRows::of(&gaussians, 0.2).expect("the device answers").expect("one is not there");
            let found = alive.among_all(Tensor::ones([3, 1], &device));
            assert_eq!(values(found), [1.0, 0.0, 1.0, 1.0]);
            let whole = alive.among_all_int(Tensor::from_data([7, 8, 9], &device));
            assert_eq!(values(whole.float().unsqueeze::<2>()), [7.0, 0.0, 8.0, 9.0]);
        });
    }

    #[test]
    fn without_lifetimes_all_are_there() {
        for_each_device(|device| {
            let mut gaussians = gaussians(&device);
            gaussians.time_centres = None;
            assert!(AliveRows::of(&gaussians, 0.2).expect("the device answers").is_none());
        });
    }
}
