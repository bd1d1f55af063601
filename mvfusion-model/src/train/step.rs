//! The forward half of a step: render a batch, blend, compare.

use burn::tensor::Tensor;
use burn::tensor::activation::sigmoid;
use mvfusion_render::grid;
use mvfusion_render::profile::{Part, measure};
use mvfusion_render::splat::{SplatLayers, SplatPicture};

use super::finite::Findings;
use super::parameters::Sink;
use super::{Batch, Position, Trainer};
use crate::ModelError;
use crate::composition::{Blending, Layers};
use crate::densify::Branch;
use crate::exposure::Exposure;
use crate::loss::{LossContext, LossSchedule, MotionMasks, Pictures, light_loss, main_loss, single_loss, within};
use crate::model::{BranchPictures, Movement, Probes};

use super::Stage;

/// The losses of a step, still on the device: nothing waits for them unless somebody reads them.
#[derive(Clone, Debug)]
pub struct StepLoss {
    /// Main and light loss together.
    pub total: Tensor<1>,
    /// Mean squared error of the composed pictures, where the photos count.
    pub squared_error: Tensor<1>,
}

/// What the backward half needs of the forward half.
pub(super) struct Forward {
    /// What is minimised.
    pub total: Tensor<1>,
    /// The pictures that it was computed from, without autodiff, by branch.
    pub rendered: Vec<(&'static str, Tensor<4>)>,
    /// For the log.
    pub loss: StepLoss,
    /// Where the screen-space gradients arrive.
    pub probes: Probes,
    /// What was seen of the dynamic branch.
    pub dynamic: Sighting,
    /// What was seen of the static branch, if there is one.
    pub static_: Option<Sighting>,
}

impl Forward {
    /// What can be found in the pictures.
    pub fn pictures(&self) -> Findings {
        let mut findings = Findings::default();
        for (branch, picture) in &self.rendered {
            findings.take(format!("the picture of the {branch} branch"), picture.clone());
        }
        findings
    }
}

/// Which Gaussians of a branch a batch has seen.
#[derive(Clone, Debug)]
pub(super) struct Sighting {
    /// 1 for Gaussians visible in any view, else 0: `[N, 1]`.
    pub visible: Tensor<2>,
    /// Largest radius in any view, pixels: `[N, 1]`.
    pub radii: Tensor<2>,
    /// Highest foreground probability over the views: `[N, 1]`.
    pub foreground: Option<Tensor<2>>,
}

impl Trainer {
    /// Renders the given views and computes the losses.
    pub(super) fn forward(&self, views: &[usize], position: &Position) -> Result<Forward, ModelError> {
        let model = &self.state.model;
        let movement = position.stage.movement(self.config.model.deformation);
        let probes = Probes::new(&model.dynamic.gaussians);
        let render = |&view: &usize| {
            let photo = self.photos.get(view);
            model.render(&photo.camera, photo.time, movement, Some(&probes), &self.surroundings)
        };
        let rendered = views.iter().map(render).collect::<Result<Vec<_>, _>>()?;

        let batch = measure(Part::Photos, || self.photos.stack(views, &self.device))?;
        let exposure = self.exposure(views);
        let seen = Views { rendered: &rendered, exposure: exposure.as_ref() };
        let (total, loss) = measure(Part::Loss, || self.losses(&seen, &batch, movement, position))?;
        Ok(Forward {
            total,
            loss,
            rendered: packed(&rendered),
            probes,
            dynamic: Sighting::of(rendered.iter().map(|view| &view.dynamic), foreground(&rendered)),
            static_: model
                .static_
                .is_some()
                .then(|| Sighting::of(rendered.iter().filter_map(|view| view.static_.as_ref()), None)),
        })
    }

    /// What the rendered views cost, with its graph and for the log.
    fn losses(
        &self,
        seen: &Views<'_>,
        batch: &Batch,
        movement: Movement,
        position: &Position,
    ) -> Result<(Tensor<1>, StepLoss), ModelError> {
        let model = &self.state.model;
        let motion = batch.motion.clone().or_else(|| self.seen_by_static_branch(seen, batch, position));
        let motion = motion.map(|motion| motion.within(batch.counted.as_ref()));
        let context = self.loss_context(batch, motion.as_ref(), position);
        let counted = batch.counted.as_ref();
        let (mut total, composed) = match &model.static_ {
            Some(static_) => {
                let blending =
                    if position.stage == Stage::Geometry { Blending::Geometry } else { Blending::Deformation };
                let still = context.static_region();
                let main = seen.pictures(Copy::Main, blending, still.as_ref()).within(counted);
                let light = seen.pictures(Copy::Light, blending, still.as_ref()).within(counted);
                let log_scales = [&model.dynamic, static_].map(|branch| branch.gaussians.log_scales.val());
                let loss = main_loss(&main, &context) + light_loss(&light, log_scales, &context);
                let loss = match self.opacity_cost(static_) {
                    Some(cost) => loss + cost,
                    None => loss,
                };
                (loss, main.composition.composed)
            }
            None => {
                let composed = within(seen.dynamic(), counted);
                (single_loss(composed.clone(), &context), composed)
            }
        };
        if movement != Movement::Still {
            total = total + self.grid_penalty()?;
        }
        let squared_error = (composed.inner() - batch.photos.clone()).powf_scalar(2.0).mean();
        let squared_error = match &batch.counted {
            // A batch that counts nowhere has no error.
            Some(counted) => squared_error / counted.clone().mean().clamp_min(f32::EPSILON),
            None => squared_error,
        };
        let loss = StepLoss { total: total.clone().inner(), squared_error };
        Ok((total, loss))
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
            motion,
            config: &config.loss,
            schedule: LossSchedule {
                geometry: position.stage == Stage::Geometry,
                step: position.step,
                total: config.train.stages.deforming(),
                densify_until: config.densify.until,
                brightness_end: config.loss.brightness_end,
            },
            extent: self.surroundings.extent,
            windows: &self.windows,
        }
    }

    /// What the static branch says of motion, once Gaussians were born where photos differ from it.
    fn seen_by_static_branch(&self, seen: &Views<'_>, batch: &Batch, position: &Position) -> Option<MotionMasks> {
        if position.stage == Stage::Geometry || !self.has_births {
            return None;
        }
        Some(MotionMasks::by_difference(&batch.photos, seen.static_()?.inner()))
    }

    /// What the cameras of the given views make of colours, where `model.exposure` asks for it.
    pub(super) fn exposure(&self, views: &[usize]) -> Option<Exposure> {
        let cameras: Vec<usize> = views.iter().map(|&view| self.photos.get(view).number).collect();
        Some(self.state.model.exposures.as_ref()?.of(&cameras))
    }

    /// What opacity costs (docs/METHOD.md, section 13).
    fn opacity_cost(&self, static_: &Branch) -> Option<Tensor<1>> {
        let (config, model) = (&self.config.loss, &self.state.model);
        let opacities = |branch: &Branch| sigmoid(branch.gaussians.opacity_logits.val());
        let cost = |branch: &Branch, weight| (weight > 0.0).then(|| opacities(branch).mean() * weight);
        let still = || {
            let stillness = model.motion.as_ref()?.stillness(&model.dynamic.gaussians, self.surroundings.extent);
            Some((opacities(&model.dynamic) * Tensor::from_inner(stillness)).mean() * config.still_opacity)
        };
        let costs = [
            cost(static_, config.static_opacity),
            cost(&model.dynamic, config.dynamic_opacity),
            (config.still_opacity > 0.0).then(still).flatten(),
        ];
        costs.into_iter().flatten().reduce(|sum, cost| sum + cost)
    }

    /// Smoothness of the HexPlane's planes (METHOD §4.4, R_grid).
    fn grid_penalty(&self) -> Result<Tensor<1>, ModelError> {
        let grid = &self.state.model.network.grid;
        let penalties = grid::regulariser::penalties(grid.planes.val(), grid.layout())?;
        let config = &self.config.loss;
        Ok(penalties.plane_smooth * config.plane_smooth
            + penalties.time_smooth * config.time_smooth
            + penalties.l1_time * config.time_l1)
    }
}

/// Which of the two equal copies of a picture is meant.
#[derive(Clone, Copy, PartialEq)]
enum Copy {
    Main,
    Light,
}

/// A layer of every view as one batch.
fn stack<V>(views: &[V], layer: impl Fn(&V) -> Tensor<3>) -> Tensor<4> {
    Tensor::cat(views.iter().map(|view| layer(view).unsqueeze_dim(0)).collect(), 0)
}

/// The rendered pictures with all their layers, without autodiff.
fn packed(rendered: &[BranchPictures]) -> Vec<(&'static str, Tensor<4>)> {
    let of = |branch, picture: &SplatPicture| (branch, picture.packed.clone().inner());
    let static_ = |view: &BranchPictures| view.static_.as_ref().map(|picture| of("static", picture));
    rendered.iter().flat_map(|view| std::iter::once(of("dynamic", &view.dynamic)).chain(static_(view))).collect()
}

/// Highest foreground probability of the dynamic Gaussians over the views.
fn foreground(rendered: &[BranchPictures]) -> Option<Tensor<2>> {
    rendered.iter().filter_map(|view| view.foreground.clone()).reduce(Tensor::max_pair)
}

/// Rendered views, and what their cameras make of colours.
pub(super) struct Views<'a> {
    pub rendered: &'a [BranchPictures],
    pub exposure: Option<&'a Exposure>,
}

impl Views<'_> {
    /// Colours of the views as their cameras see them: `[B, 3, H, W]`.
    fn exposed(&self, colours: Tensor<4>) -> Tensor<4> {
        match self.exposure {
            Some(exposure) => exposure.of_colours(colours),
            None => colours,
        }
    }

    /// The colours of the dynamic branch.
    fn dynamic(&self) -> Tensor<4> {
        self.exposed(stack(self.rendered, |view| view.dynamic.main().colour))
    }

    /// The colours of the static branch; `None` in a model without one.
    pub fn static_(&self) -> Option<Tensor<4>> {
        let pictures: Option<Vec<_>> = self.rendered.iter().map(|view| view.static_.as_ref()).collect();
        Some(self.exposed(stack(&pictures?, |picture| picture.main().colour)))
    }

    /// One copy of every view of two branches, stacked and blended. Where `still` (`[B, 1, H, W]`) is 0, no loss reaches the
    /// colours of the static branch: neither what little the mask lets through, nor the window of a still pixel beside what
    /// moves. Either would keep a stain alive.
    fn pictures(&self, copy: Copy, blending: Blending, still: Option<&Tensor<4>>) -> Pictures {
        let layers = |picture: &SplatPicture| match copy {
            Copy::Main => picture.main(),
            Copy::Light => picture.light(),
        };
        let dynamic: Vec<SplatLayers> = self.rendered.iter().map(|view| layers(&view.dynamic)).collect();
        let static_: Vec<SplatLayers> =
            self.rendered.iter().filter_map(|view| view.static_.as_ref().map(layers)).collect();
        // Proof: a model with a static branch has mask logits in its dynamic one, and `Model::render` splats them.
        let mask =
            |view: &SplatLayers| view.features.clone().expect("the dynamic branch is always splatted with its mask");
        let blend = Layers {
            dynamic: self.exposed(stack(&dynamic, |view| view.colour.clone())),
            static_: self.exposed(stack(&static_, |view| view.colour.clone())),
            mask: stack(&dynamic, mask),
        };
        let blend = match still {
            Some(still) => blend.with_static_learning(still.clone()),
            None => blend,
        };
        Pictures {
            composition: blend.compose(blending),
            dynamic_depth: stack(&dynamic, |view| view.depth.clone()),
            static_depth: stack(&static_, |view| view.depth.clone()),
        }
    }

    /// The blended pictures of views of two branches: `[B, 3, H, W]`.
    pub fn composed(&self) -> Tensor<4> {
        self.pictures(Copy::Main, Blending::Deformation, None).composition.composed
    }
}

/// Depth and alpha of the dynamic branch and of the static one, `[1, H, W]` each.
pub(super) fn shown_depths(view: &BranchPictures) -> [[Tensor<3>; 2]; 2] {
    let layers = |picture: &SplatPicture| {
        let layers = picture.main();
        [layers.depth, layers.alpha]
    };
    // Proof: only models of two branches are asked.
    [layers(&view.dynamic), layers(view.static_.as_ref().expect("the model has a static branch"))]
}

impl Sighting {
    fn of<'a>(pictures: impl Iterator<Item = &'a SplatPicture>, foreground: Option<Tensor<2>>) -> Self {
        let radii = pictures.map(|picture| picture.radii.clone()).reduce(Tensor::max_pair);
        // Proof: `Config::check` refuses a batch without a view.
        let radii: Tensor<2> = radii.expect("a batch holds a view").float().unsqueeze_dim(1);
        Self { visible: radii.clone().greater_elem(0).float(), radii, foreground }
    }
}
