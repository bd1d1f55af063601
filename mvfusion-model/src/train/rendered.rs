//! The renders of a step's training views.

use burn::tensor::Tensor;
use mvfusion_render::splat::{SplatPicture, SplatPlanes};

use super::Batch;
use super::densify::Visibility;
use super::finite::Findings;
use super::loss::Pictures;
use super::parameters::Sink;
use crate::model::composition::{Blending, BranchRenders, Composition};
use crate::model::exposure::Exposure;
use crate::model::{BranchPictures, Probes};

/// The renders of a step's training views, with the graph of the backward pass, and their photos.
#[derive(Debug)]
pub struct RenderedBatch {
    /// The ground truth of the views.
    pub batch: Batch,
    pub(super) views: RenderedViews,
    /// Indices of the training views.
    pub(super) shown: Vec<usize>,
    /// The leaves that receive the screen-space gradients.
    pub(super) probes: Probes,
}

impl RenderedBatch {
    /// The composed renders, clamped to `[0, 1]`; in a model with one branch its unclamped renders: `[B, 3, H, W]`.
    pub fn composed(&self) -> Tensor<4> {
        match self.views.has_static() {
            true => self.views.composed(),
            false => self.views.dynamic(),
        }
    }

    /// Renders of the dynamic branch, with the cameras' exposures: `[B, 3, H, W]`.
    pub fn dynamic(&self) -> Tensor<4> {
        self.views.dynamic()
    }

    /// Renders of the static branch, with the cameras' exposures: `[B, 3, H, W]`; `None` in a model with one branch.
    pub fn static_(&self) -> Option<Tensor<4>> {
        self.views.static_()
    }

    /// Share of the dynamic branch in each pixel: `[B, 1, H, W]`; `None` in a model with one branch.
    pub fn mask(&self) -> Option<Tensor<4>> {
        self.views.has_static().then(|| self.views.composition().mask)
    }

    /// The findings for all renders. `describe` names a training view.
    pub(super) fn findings(&self, describe: impl Fn(usize) -> String) -> Findings {
        let mut findings = Findings::default();
        for (rendered, &view) in self.views.rendered.iter().zip(&self.shown) {
            for (branch, picture) in packed(rendered) {
                findings.take(format!("the picture of the {branch} branch for {}", describe(view)), picture);
            }
        }
        findings
    }
}

/// Selects one of the two equal copies of a render.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum PictureCopy {
    Main,
    Light,
}

/// A layer of every view as one batch.
fn stack<V>(views: &[V], layer: impl Fn(&V) -> Tensor<3>) -> Tensor<4> {
    Tensor::cat(views.iter().map(|view| layer(view).unsqueeze_dim(0)).collect(), 0)
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

    /// One copy of every view of two branches, stacked and blended. Where `still` (`[B, 1, H, W]`) is 0, the colours of
    /// the static branch have no gradient. Otherwise, gradients through a nearly closed mask, or from the window of an
    /// adjacent still pixel, would preserve a stain. Pixels where `valid` (`[B, 1, H, W]`) is 0 are black and in no mask.
    pub fn pictures(&self, copy: PictureCopy, blending: Blending, [still, valid]: [Option<&Tensor<4>>; 2]) -> Pictures {
        let layers = |picture: &SplatPicture| match copy {
            PictureCopy::Main => picture.main(),
            PictureCopy::Light => picture.light(),
        };
        let dynamic: Vec<SplatPlanes> = self.rendered.iter().map(|view| layers(&view.dynamic)).collect();
        let static_: Vec<SplatPlanes> =
            self.rendered.iter().filter_map(|view| view.static_.as_ref().map(layers)).collect();
        // Proof: a model with a static branch has mask logits in its dynamic branch, and `Model::render` splats them.
        let mask =
            |view: &SplatPlanes| view.features.clone().expect("the dynamic branch is always splatted with its mask");
        let blend = BranchRenders {
            dynamic: self.exposed(stack(&dynamic, |view| view.colour.clone())),
            static_: self.exposed(stack(&static_, |view| view.colour.clone())),
            mask: stack(&dynamic, mask),
        };
        let blend = match still {
            Some(still) => blend.with_static_learning(still.clone()),
            None => blend,
        };
        Pictures {
            composition: blend.compose_within(blending, valid),
            dynamic_depth: stack(&dynamic, |view| view.depth.clone()),
            static_depth: stack(&static_, |view| view.depth.clone()),
        }
    }

    /// Views of two branches, blended as in the later stages.
    fn composition(&self) -> Composition {
        self.pictures(PictureCopy::Main, Blending::Deformation, [None; 2]).composition
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
