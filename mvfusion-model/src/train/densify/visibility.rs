//! The visibility of Gaussians in a batch.

use burn::tensor::Tensor;
use mvfusion_render::splat::SplatPicture;

/// The visibility of a branch's Gaussians in a batch. Without autodiff.
#[derive(Clone, Debug)]
pub struct Visibility {
    /// 1 for Gaussians visible in any view, otherwise 0: `[N, 1]`.
    pub visible: Tensor<2>,
    /// Largest radius in any view, in pixels: `[N, 1]`.
    pub radii: Tensor<2>,
    /// Highest foreground probability over the views: `[N, 1]`; only for a dynamic branch with a mask.
    pub foreground: Option<Tensor<2>>,
}

impl Visibility {
    /// The visibility from the renders of a branch, one per view, and the highest foreground probability.
    pub(in crate::train) fn of<'a>(
        pictures: impl Iterator<Item = &'a SplatPicture>,
        foreground: Option<Tensor<2>>,
    ) -> Self {
        let radii = pictures.map(|picture| picture.radii.clone()).reduce(Tensor::max_pair);
        // Proof: `Config::check` rejects an empty batch.
        let radii: Tensor<2> = radii.expect("a batch holds a view").float().unsqueeze_dim(1);
        Self { visible: radii.clone().greater_elem(0).float(), radii, foreground }
    }
}
