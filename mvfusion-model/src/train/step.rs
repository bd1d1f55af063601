//! The forward half of a step: render, blend, losses.

use burn::tensor::Tensor;
use mvfusion_render::activation::sigmoid;
use mvfusion_render::device::is_gpu;
use mvfusion_render::grid;
use mvfusion_render::profile::{Part, measure};

use super::loss::{LossContext, LossSchedule, MotionMasks, scale_loss, single_loss};
use super::rendered::{RenderedBatch, RenderedViews};
use super::{Batch, Losses, Position, Stage, Trainer};
use crate::ModelError;
use crate::model::composition::within;
use crate::model::exposure::Exposure;
use crate::model::gaussians::Gaussians;
use crate::model::{DeformationLevel, Probes};

impl Trainer {
    /// Renders training views, given by their indices, at their times.
    ///
    /// # Errors
    /// [`ModelError::Views`] if there is none, or the scene does not have one of them. If a photo cannot be read, or
    /// the splat op rejects its input.
    pub fn render_batch(&self, views: &[usize], position: &Position) -> Result<RenderedBatch, ModelError> {
        self.photos.check(views)?;
        let model = &self.state.model;
        let level = position.stage.level(self.config.model.deformation);
        let probes = position.densifies(&self.config.densify).then(|| Probes::new(&model.dynamic));
        let photos = || measure(Part::Photos, || self.photos.stack(views, &self.device));
        // A GPU gets the photos while it renders. On a CPU, they may still be decoded meanwhile.
        let early = is_gpu(&self.device.clone().inner()).then(photos).transpose()?;
        let moment = |&view: &usize| {
            let view = self.photos.get(view);
            (view.camera, view.time)
        };
        let moments: Vec<_> = views.iter().map(moment).collect();
        let rendered = model.render_all(&moments, level, probes.as_ref(), &self.context)?;
        let batch = early.map_or_else(photos, Ok)?;
        let (shown, exposure) = (views.to_vec(), self.exposure(views));
        Ok(RenderedBatch { batch, views: RenderedViews { rendered, exposure }, shown, probes })
    }

    /// The loss of a step (METHOD §4.4): main loss, light loss, and the penalties of the HexPlane grid.
    ///
    /// # Errors
    /// If the grid op rejects its input.
    pub fn losses(&self, rendered: &RenderedBatch, position: &Position) -> Result<Losses, ModelError> {
        let level = position.stage.level(self.config.model.deformation);
        measure(Part::Loss, || self.losses_of(&rendered.views, &rendered.batch, level, position))
    }

    fn losses_of(
        &self,
        seen: &RenderedViews,
        batch: &Batch,
        level: DeformationLevel,
        position: &Position,
    ) -> Result<Losses, ModelError> {
        let model = &self.state.model;
        let motion = batch.motion.clone().or_else(|| self.seen_by_static_branch(seen, batch, position));
        let motion = motion.map(|motion| motion.within(batch.valid.as_ref()));
        let context = self.loss_context(batch, motion.as_ref(), position);
        let (mut total, squared_error) = match &model.static_ {
            Some(static_) => {
                let found = seen.objective(batch, motion.as_ref(), &context.objective_terms())?;
                let log_scales = [&model.dynamic, static_].map(|branch| branch.log_scales.val());
                let costs = [scale_loss(log_scales, &context), self.opacity_cost(static_)];
                (costs.into_iter().flatten().fold(found.loss, |loss, cost| loss + cost), found.squared_error)
            }
            None => {
                let composed = within(seen.dynamic(), batch.valid.as_ref());
                let error = composed.clone().inner() - batch.photos.clone();
                (single_loss(composed, &context), error.powf_scalar(2.0).mean())
            }
        };
        if level != DeformationLevel::Still {
            total = total + self.grid_penalty()?;
        }
        let squared_error = match &batch.valid {
            // A batch without valid pixels has no error.
            Some(valid) => squared_error / valid.clone().mean().clamp_min(f32::EPSILON),
            None => squared_error,
        };
        Ok(Losses { total, squared_error })
    }

    fn loss_context<'a>(
        &'a self,
        batch: &'a Batch,
        motion: Option<&'a MotionMasks>,
        position: &Position,
    ) -> LossContext<'a> {
        let config = &self.config;
        LossContext {
            photos: &batch.photos,
            valid: batch.valid.as_ref(),
            motion,
            config: &config.loss,
            schedule: LossSchedule {
                geometry: position.stage == Stage::Geometry,
                step: position.step,
                total: config.train.stages.deforming(),
                densify_until: config.densify.until.0,
                brightness_end: config.loss.brightness_end,
            },
            extent: self.context.extent,
            windows: &self.windows,
        }
    }

    /// The motion implied by the static branch, once Gaussians were born where photos differ from it.
    fn seen_by_static_branch(&self, seen: &RenderedViews, batch: &Batch, position: &Position) -> Option<MotionMasks> {
        if position.stage == Stage::Geometry || !self.has_births {
            return None;
        }
        let static_ = within(seen.static_()?.inner(), batch.valid.as_ref());
        Some(MotionMasks::by_difference(&batch.photos, static_))
    }

    /// The exposures of the given views' cameras, with `model.exposure`.
    pub(super) fn exposure(&self, views: &[usize]) -> Option<Exposure> {
        let cameras: Vec<usize> = views.iter().map(|&view| self.photos.get(view).number).collect();
        Some(self.state.model.exposures.as_ref()?.of(&cameras))
    }

    /// The opacity penalties (docs/METHOD.md, section 13).
    fn opacity_cost(&self, static_: &Gaussians) -> Option<Tensor<1>> {
        let (config, model) = (&self.config.loss, &self.state.model);
        let opacities = |branch: &Gaussians| sigmoid(branch.opacity_logits.val());
        let cost = |branch: &Gaussians, weight| (weight > 0.0).then(|| opacities(branch).mean() * weight);
        let still = || {
            let stillness = model.motion.as_ref()?.stillness(&model.dynamic, self.context.extent);
            Some((opacities(&model.dynamic) * Tensor::from_inner(stillness)).mean() * config.still_opacity)
        };
        let costs = [
            cost(static_, config.static_opacity),
            cost(&model.dynamic, config.dynamic_opacity),
            (config.still_opacity > 0.0).then(still).flatten(),
        ];
        costs.into_iter().flatten().reduce(|sum, cost| sum + cost)
    }

    /// The penalties of the HexPlane's planes (METHOD §4.4, R_grid).
    fn grid_penalty(&self) -> Result<Tensor<1>, ModelError> {
        let grid = &self.state.model.network.grid;
        let config = &self.config.loss;
        let weights = [config.plane_smooth, config.time_smooth, config.time_l1];
        Ok(grid::regulariser::weighted_penalty(grid.planes.val(), grid.layout(), weights)?)
    }
}
