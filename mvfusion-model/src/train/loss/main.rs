//! The main loss, which also drives densification, with tensor operations. Training computes the same terms by
//! [`objective`](mvfusion_render::objective); this form is the reference for it.

use burn::tensor::Tensor;
use mvfusion_render::objective::constants::{DYNAMIC, GEOMETRY_DARKENING, SURELY_DYNAMIC, SURELY_STATIC};

use super::terms::{above, behind, dssim, edge_variation, l1, likeness, masked_dssim};
use super::{LossContext, Pictures};
use crate::model::composition::within;

/// The main loss without the grid's regularisers, a scalar `[1]`.
pub fn main_loss(pictures: &Pictures, context: &LossContext<'_>) -> Tensor<1> {
    let picture_terms = if context.schedule.geometry {
        geometry_terms(pictures, context)
    } else {
        l1(pictures.composition.composed.clone(), context.photos.clone()) * context.config.main
    };
    [depth_terms(pictures, context), branch_terms(pictures, context)]
        .into_iter()
        .flatten()
        .fold(picture_terms, |sum, term| sum + term)
}

/// First stage: each branch must match the photo on its own.
fn geometry_terms(pictures: &Pictures, context: &LossContext<'_>) -> Tensor<1> {
    let (config, photos) = (context.config, context.photos);
    let blend = &pictures.composition;
    let still_lit = blend.lit.clone().detach();
    let mixed = if config.geometry_mean {
        blend.dynamic.clone() * 0.5 + still_lit * 0.5
    } else {
        blend.mask.clone() * blend.dynamic.clone() + blend.static_mask.clone() * still_lit
    };
    let window = &context.windows.ssim;
    let darkened = photos.clone() * GEOMETRY_DARKENING;
    let (colour, structure) = match context.dynamic_region() {
        Some(moving) => {
            let moving = Tensor::from_inner(moving);
            let structure = masked_dssim(blend.dynamic.clone(), photos.clone(), moving.clone(), window);
            (l1(mixed * moving.clone(), darkened * moving), structure)
        }
        None => (l1(mixed, darkened), dssim(blend.dynamic.clone(), photos.clone(), window)),
    };
    let (still_colour, still_structure) = match context.static_region() {
        Some(still) => {
            let still = Tensor::from_inner(still);
            let structure = masked_dssim(blend.lit.clone(), photos.clone(), still.clone(), window);
            (l1(blend.lit.clone() * still.clone(), photos.clone() * still), structure)
        }
        None => (l1(blend.lit.clone(), photos.clone()), dssim(blend.lit.clone(), photos.clone(), window)),
    };
    (colour + still_colour) * config.main + (still_structure + structure) * config.geometry_dssim
}

/// Depth order of the branches and smoothness of the background's depth (METHOD §4.4, terms 1 to 3).
fn depth_terms(pictures: &Pictures, context: &LossContext<'_>) -> Option<Tensor<1>> {
    let (config, mask) = (context.config, &pictures.composition.mask);
    let front = pictures.dynamic_depth.clone();
    let back = pictures.static_depth.clone().detach();
    let mut terms = Vec::new();
    if config.depth_back > 0.0 {
        let indicator = within(above(mask, SURELY_DYNAMIC), context.valid);
        let back = if config.depth_back_detached { back.clone() } else { pictures.static_depth.clone() };
        terms.push(behind(front.clone(), back, indicator, context.extent) * config.depth_back);
    }
    if config.depth_forward > 0.0 {
        // Invalid pixels are in no mask, so they would count as surely static.
        let indicator = within(-above(mask, SURELY_STATIC) + 1.0, context.valid);
        terms.push(behind(back, front, indicator, context.extent) * config.depth_forward);
    }
    if config.depth_smooth > 0.0 {
        let depth = pictures.static_depth.clone() / context.extent;
        terms.push(edge_variation(depth, context.photos) * config.depth_smooth);
    }
    terms.into_iter().reduce(|sum, term| sum + term)
}

/// Each branch against the photo inside its mask (METHOD §4.4, terms 4 and 5).
fn branch_terms(pictures: &Pictures, context: &LossContext<'_>) -> Option<Tensor<1>> {
    let (config, photos, blend) = (context.config, context.photos, &pictures.composition);
    let mut terms = Vec::new();
    if config.penalize_dynamic > 0.0 {
        let alike = likeness(
            blend.dynamic.clone(),
            blend.lit.clone().detach(),
            within(above(&blend.mask, DYNAMIC), context.valid),
            &context.windows.structure,
        );
        terms.push(alike * config.penalize_dynamic);
    }
    if config.branch_dssim > 0.0 || config.branch_l1 > 0.0 {
        let dynamic_answers = match context.dynamic_region() {
            Some(moving) => above(&blend.mask, DYNAMIC).max_pair(moving),
            None => above(&blend.mask, config.dynamic_above),
        };
        let mut static_answers = above(&blend.static_mask, config.static_above);
        if let Some(still) = context.static_region() {
            static_answers = static_answers * still;
        }
        let branches = [(&blend.dynamic, dynamic_answers), (&blend.lit, static_answers)];
        for (picture, answers) in branches {
            let indicator = within(answers.clone(), context.valid);
            let structure = masked_dssim(picture.clone(), photos.clone(), indicator, &context.windows.ssim);
            let colour = l1(picture.clone() * answers.clone(), photos.clone() * answers);
            terms.push(structure * config.branch_dssim + colour * config.branch_l1);
        }
    }
    terms.into_iter().reduce(|sum, term| sum + term)
}
