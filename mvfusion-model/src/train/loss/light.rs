//! The light loss, which does not drive densification, with tensor operations. As for the main loss, training computes
//! the terms over pixels by [`objective`](mvfusion_render::objective).

use burn::tensor::Tensor;
use mvfusion_render::scales::{self, ScaleRule};

use super::terms::{dssim, entropy, l1, scale_rule};
use super::{LossContext, Pictures};
use crate::model::composition::within;

/// The light loss, a scalar `[1]`; `log_scales` are those of both branches, `[N, 3]` each.
pub fn light_loss(pictures: &Pictures, log_scales: [Tensor<2>; 2], context: &LossContext<'_>) -> Tensor<1> {
    let loss = light_picture_loss(pictures, context);
    match scale_loss(log_scales, context) {
        Some(cost) => loss + cost,
        None => loss,
    }
}

/// The terms over pixels.
pub(super) fn light_picture_loss(pictures: &Pictures, context: &LossContext<'_>) -> Tensor<1> {
    let (config, schedule, photos) = (context.config, &context.schedule, context.photos);
    let blend = &pictures.composition;
    let mut loss = dssim(blend.composed.clone(), photos.clone(), &context.windows.ssim) * config.composed_dssim;

    let brightness_weight = config.brightness + schedule.brightness_weight();
    let away_from_one = within(blend.brightness.clone() - 1.0, context.valid);
    loss = loss + away_from_one.abs().mean() * brightness_weight;

    let explicit = schedule.explicit_weight(config.brightness_explicit);
    if explicit > 0.0 {
        let lit = (blend.static_.clone().detach() * blend.brightness.clone()).clamp(0.0, 1.0);
        loss = loss + l1(lit, photos.clone()) * explicit;
    }
    if schedule.entropy() && config.entropy > 0.0 {
        loss = loss + entropy(blend.mask.clone()) * config.entropy;
    }
    let has_weight = config.mask_motion > 0.0 || config.mask_still > 0.0;
    if let Some(motion) = context.sure_motion().filter(|_| has_weight) {
        let [moving, still] = [motion.moving.clone(), motion.still.clone()].map(Tensor::from_inner);
        let closed = (-blend.mask.clone() + 1.0) * moving * config.mask_motion;
        loss = loss + (closed + blend.mask.clone() * still * config.mask_still).mean();
    }
    loss
}

/// The terms that bound the size and the elongation of the Gaussians, from the log-scales of both branches, `[N, 3]`
/// each; `None` if none has a weight.
pub(crate) fn scale_loss(log_scales: [Tensor<2>; 2], context: &LossContext<'_>) -> Option<Tensor<1>> {
    let config = context.config;
    let spiky = if context.schedule.spiky() { config.spiky } else { 0.0 };
    let rule = ScaleRule { large: config.large, spiky, ..scale_rule(context.extent) };
    let is_due = rule.large > 0.0 || rule.spiky > 0.0;
    let [dynamic, static_] = log_scales;
    is_due.then(|| scales::cost(dynamic, rule) + scales::cost(static_, rule))
}
