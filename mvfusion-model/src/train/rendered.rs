//! The renders of a step's training views.

use burn::tensor::Tensor;
use mvfusion_render::objective::{
    Objective, ObjectiveError, ObjectiveInputs, ObjectiveMasks, ObjectiveTerms, objective,
};
use mvfusion_render::splat::SplatPicture;

use super::Batch;
use super::densify::Visibility;
use super::finite::Findings;
use super::loss::MotionMasks;
use super::parameters::Sink;
use crate::model::composition::{Blending, BranchRenders, Composition, within};
use crate::model::exposure::Exposure;
use crate::model::{BranchPictures, Probes};

/// The renders of a step's training views, with the graph of the backward pass, and their photos. What the methods
/// return is 0 at the pixels that a view's mask excludes, like the photos.
#[derive(Debug)]
pub struct RenderedBatch {
    /// The ground truth of the views.
    pub batch: Batch,
    pub(super) views: RenderedViews,
    /// Indices of the training views.
    pub(super) shown: Vec<usize>,
    /// The leaves that receive the screen-space gradients, while densification needs them.
    pub(super) probes: Option<Probes>,
}

impl RenderedBatch {
    /// The composed renders, clamped to `[0, 1]`; in a model with one branch its unclamped renders: `[B, 3, H, W]`. The
    /// shares of the branches are those of the later stages, also in the first one.
    pub fn composed(&self) -> Tensor<4> {
        match self.views.has_static() {
            true => self.valid(self.views.composed()),
            false => self.dynamic(),
        }
    }

    /// Renders of the dynamic branch, with the cameras' exposures: `[B, 3, H, W]`.
    pub fn dynamic(&self) -> Tensor<4> {
        self.valid(self.views.dynamic())
    }

    /// Renders of the static branch, with the cameras' exposures: `[B, 3, H, W]`; `None` in a model with one branch.
    pub fn static_(&self) -> Option<Tensor<4>> {
        Some(self.valid(self.views.static_()?))
    }

    /// Share of the dynamic branch in each pixel, as in [`RenderedBatch::composed`]: `[B, 1, H, W]`; `None` in a model
    /// with one branch.
    pub fn mask(&self) -> Option<Tensor<4>> {
        self.views.has_static().then(|| self.valid(self.views.composition().mask))
    }

    /// An image that is 0 at excluded pixels.
    fn valid(&self, picture: Tensor<4>) -> Tensor<4> {
        within(picture, self.batch.valid.as_ref())
    }

    /// The renders alone, for [`Trainer::bad_loss`](super::Trainer).
    pub(super) fn plain(&self) -> PlainRenders {
        let views = self.views.rendered.iter().zip(&self.shown);
        PlainRenders { views: views.map(|(rendered, &view)| (view, packed(rendered).collect())).collect() }
    }
}

/// The renders of a batch without autodiff, so that they outlive the backward pass.
pub(super) struct PlainRenders {
    /// Each view's index and its branches with all their layers.
    views: Vec<(usize, Vec<(&'static str, Tensor<4>)>)>,
}

impl PlainRenders {
    /// The findings for all renders. `describe` names a training view.
    pub fn findings(self, describe: impl Fn(usize) -> String) -> Findings {
        let mut findings = Findings::default();
        for (view, branches) in self.views {
            for (branch, picture) in branches {
                findings.take(format!("the picture of the {branch} branch for {}", describe(view)), picture);
            }
        }
        findings
    }
}

/// A layer of every view as one batch.
fn stack<V>(views: &[V], layer: impl Fn(&V) -> Tensor<3>) -> Tensor<4> {
    Tensor::cat(views.iter().map(|view| layer(view).unsqueeze_dim(0)).collect(), 0)
}

/// A view's part of a batch `[B, C, H, W]`: `[C, H, W]`.
fn layer_of(batch: &Tensor<4>, view: usize) -> Tensor<3> {
    let [_, channels, height, width] = batch.dims();
    batch.clone().narrow(0, view, 1).reshape([channels, height, width])
}

/// The renders of a view with all their layers, without autodiff.
fn packed(rendered: &BranchPictures) -> impl Iterator<Item = (&'static str, Tensor<4>)> {
    let of = |branch, picture: &SplatPicture| (branch, picture.packed.clone().inner());
    let static_ = rendered.static_.as_ref().map(|picture| of("static", picture));
    std::iter::once(of("dynamic", &rendered.dynamic)).chain(static_)
}

/// Highest foreground probability of the dynamic Gaussians over the views.
fn foreground(rendered: &[BranchPictures]) -> Option<Tensor<2>> {
    rendered.iter().filter_map(|view| view.foreground.clone()).reduce(Tensor::max_pair)
}

/// Rendered views, and the exposures of their cameras.
#[derive(Debug)]
pub(super) struct RenderedViews {
    pub rendered: Vec<BranchPictures>,
    pub exposure: Option<Exposure>,
}

impl RenderedViews {
    fn has_static(&self) -> bool {
        self.rendered.iter().all(|view| view.static_.is_some())
    }

    /// Colours of the views with the exposures of their cameras: `[B, 3, H, W]`.
    fn exposed(&self, colours: Tensor<4>) -> Tensor<4> {
        match &self.exposure {
            Some(exposure) => exposure.of_colours(colours),
            None => colours,
        }
    }

    /// The colours of the dynamic branch.
    pub(super) fn dynamic(&self) -> Tensor<4> {
        self.exposed(stack(&self.rendered, |view| view.dynamic.main().colour))
    }

    /// The colours of the static branch; `None` in a model with one branch.
    pub fn static_(&self) -> Option<Tensor<4>> {
        let pictures: Option<Vec<_>> = self.rendered.iter().map(|view| view.static_.as_ref()).collect();
        Some(self.exposed(stack(&pictures?, |picture| picture.main().colour)))
    }

    /// The objective of views of two branches, over all of them. `motion` is that of the batch, or what the static branch
    /// shows instead.
    ///
    /// # Errors
    /// If the op rejects its input.
    pub fn objective(
        &self,
        batch: &Batch,
        motion: Option<&MotionMasks>,
        terms: &ObjectiveTerms,
    ) -> Result<Objective, ObjectiveError> {
        let of = |(index, view): (usize, &BranchPictures)| {
            let mask = |mask: &Tensor<4>| layer_of(mask, index);
            let inputs = ObjectiveInputs {
                dynamic: view.dynamic.packed.clone(),
                // Proof: this is only called for models with two branches.
                static_: view.static_.as_ref().expect("the model has a static branch").packed.clone(),
                exposure: self.exposure.as_ref().map(|exposure| exposure.of_view(index)),
                photo: layer_of(&batch.photos, index),
                masks: ObjectiveMasks {
                    valid: batch.valid.as_ref().map(mask),
                    moving: motion.map(|motion| mask(&motion.moving)),
                    around: motion.map(|motion| mask(&motion.around)),
                },
            };
            objective(inputs, terms)
        };
        let found = self.rendered.iter().enumerate().map(of).collect::<Result<Vec<_>, _>>()?;
        let mean = |of: fn(&Objective) -> &Tensor<1>| {
            let sum = found.iter().map(|view| of(view).clone()).reduce(|sum, view| sum + view);
            // Proof: a step shows at least one view.
            sum.expect("a view") / found.len() as f64
        };
        Ok(Objective { loss: mean(|view| &view.loss), squared_error: mean(|view| &view.squared_error) })
    }

    /// Views of two branches, blended as in the later stages.
    fn composition(&self) -> Composition {
        let views = || self.rendered.iter().map(|view| view.dynamic.main());
        // Proof: a model with a static branch has mask logits in its dynamic branch, and `Model::render` splats them.
        let masks: Vec<_> = views().map(|view| view.features.expect("the dynamic branch has a mask")).collect();
        let layers = BranchRenders {
            dynamic: self.dynamic(),
            // Proof: this is only called for models with two branches.
            static_: self.static_().expect("the model has a static branch"),
            mask: stack(&masks, Tensor::clone),
        };
        layers.compose(Blending::Deformation)
    }

    /// The composed renders of views of two branches: `[B, 3, H, W]`.
    pub fn composed(&self) -> Tensor<4> {
        self.composition().composed
    }

    /// The visible dynamic Gaussians.
    pub fn dynamic_visibility(&self) -> Visibility {
        Visibility::of(self.rendered.iter().map(|view| &view.dynamic), foreground(&self.rendered))
    }

    /// The visible static Gaussians; `None` in a model with one branch.
    pub fn static_visibility(&self) -> Option<Visibility> {
        let pictures = || self.rendered.iter().filter_map(|view| view.static_.as_ref());
        self.has_static().then(|| Visibility::of(pictures(), None))
    }
}

/// Depth and alpha of the dynamic and the static branch, `[1, H, W]` each.
pub(super) fn shown_depths(view: &BranchPictures) -> [[Tensor<3>; 2]; 2] {
    let layers = |picture: &SplatPicture| {
        let layers = picture.main();
        [layers.depth, layers.alpha]
    };
    // Proof: this is only called for models with two branches.
    [layers(&view.dynamic), layers(view.static_.as_ref().expect("the model has a static branch"))]
}
