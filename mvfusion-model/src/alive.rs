//! Which dynamic Gaussians are there at a moment, by their lifetimes. The others are neither moved nor splatted.

use burn::module::Module;
use burn::tensor::{IndexingUpdateOp, Int, Tensor};
use glam::Vec3;

use crate::gaussians::{Attribute, Gaussians};
use crate::{ModelError, tensors};

/// A Gaussian whose opacity logit is below this by its lifetime is not there: its opacity is 1e-4, a fortieth of what the
/// splat op draws, so that the offset of a deformation that learns nothing of it does not bring it back.
const LEAST_LOGIT: f32 = -9.0;

/// Gaussians are selected only if at least this share of them can be left out: below it, copying costs more than it saves.
const WORTH_SELECTING: f64 = 0.1;

/// The rows of the Gaussians that are there at a moment.
#[derive(Clone, Debug)]
pub struct AliveRows {
    rows: Tensor<1, Int>,
    /// Number of all Gaussians.
    count: usize,
}

impl AliveRows {
    /// Those of `gaussians` at a time in `[0, 1]`; `None` where all are, or so many that they are not worth selecting. Waits
    /// for the device where there are lifetimes.
    ///
    /// # Errors
    /// If the device cannot hand its numbers back.
    pub fn of(gaussians: &Gaussians, time: f64) -> Result<Option<Self>, ModelError> {
        if gaussians.time_centres.is_none() {
            return Ok(None);
        }
        let logits: Vec<f32> = tensors::read(gaussians.alive_logits(time))?;
        let mut rows: Vec<usize> = (0..logits.len()).filter(|&row| logits[row] > LEAST_LOGIT).collect();
        // An empty tensor is of no use to an op.
        if rows.is_empty() {
            rows.push(0);
        }
        let count = logits.len();
        if (rows.len() as f64) > (1.0 - WORTH_SELECTING) * count as f64 {
            return Ok(None);
        }
        let rows = tensors::rows_like(&rows, &gaussians.means.val());
        Ok(Some(Self { rows, count }))
    }

    /// The rows, ascending.
    pub fn rows(&self) -> &Tensor<1, Int> {
        &self.rows
    }

    /// Numbers of the rows, `[n, C]`, among those of all Gaussians, `[N, C]`: 0 for the others. Without autodiff.
    pub fn among_all(&self, values: Tensor<2>) -> Tensor<2> {
        let columns = values.dims()[1];
        let all = Tensor::zeros([self.count, columns], (&values.device(), values.dtype()));
        all.select_assign(0, self.rows.clone(), values, IndexingUpdateOp::Add)
    }

    /// The same for whole numbers, `[n]` to `[N]`.
    pub fn among_all_int(&self, values: Tensor<1, Int>) -> Tensor<1, Int> {
        let all = Tensor::zeros([self.count], &values.device());
        all.select_assign(0, self.rows.clone(), values, IndexingUpdateOp::Add)
    }
}

impl Gaussians {
    /// Centres of those that are there at a time in `[0, 1]`, where their velocities take them; all where there are no
    /// lifetimes.
    ///
    /// # Errors
    /// If the device cannot hand its numbers back.
    pub fn centres_at(&self, time: f64) -> Result<Vec<Vec3>, ModelError> {
        let then = self.valid().at(time);
        let means: Vec<f32> = tensors::read(then.means)?;
        let centres = means.chunks_exact(3).map(Vec3::from_slice);
        if self.time_centres.is_none() {
            return Ok(centres.collect());
        }
        let logits: Vec<f32> = tensors::read(then.opacity_logits)?;
        Ok(centres.zip(logits).filter(|&(_, logit)| logit > LEAST_LOGIT).map(|(centre, _)| centre).collect())
    }

    /// Opacity logits as the lifetimes have them at a time, without autodiff: `[N, 1]`.
    fn alive_logits(&self, time: f64) -> Tensor<2> {
        let plain = |attribute| self.plain(attribute);
        let logits = self.opacity_logits.val().inner();
        match plain(Attribute::TimeCentres).zip(plain(Attribute::LogDurations)) {
            Some((centres, durations)) => logits - ((-centres + time) * (-durations).exp()).powf_scalar(2.0),
            None => logits,
        }
    }
}
