//! The whole backward pass: blending, then projection.

use super::blend::TileSource;
use super::blend_backward::{BlendGradientSource, blend_backward};
use super::cloud::Cloud;
use super::lanes::{LANES, Lane, SEGMENTS};
use super::project_backward::{RecordIndex, project_backward};
use super::view::View;
use crate::splat::Statistic;
use crate::splat::tensors::SplatTensors;

/// The state that the forward pass saved, in the layout of the tensors.
#[derive(Clone, Copy)]
pub(crate) struct Saved<'a, T> {
    /// See [`super::project::Projections`].
    pub records: &'a [T],
    /// See [`super::tiles::Bins`].
    pub sorted: &'a [i32],
    pub starts: &'a [i32],
    pub slots: &'a [i32],
    /// See [`super::blend::Blended`].
    pub transmittance: &'a [T],
    pub last: &'a [i32],
}

/// Backpropagates the cotangent `[2, channels + 1, height, width]` of the packed image to the inputs.
pub(crate) fn backward<T: Lane>(
    cloud: &Cloud<T>,
    view: &View<T>,
    saved: Saved<T>,
    v_picture: &[T],
    statistic: Option<Statistic>,
) -> SplatTensors<Vec<T>> {
    let records = saved.records.as_chunks().0;
    let source = BlendGradientSource {
        tiles: TileSource { cloud: *cloud, view, records, sorted: saved.sorted, starts: saved.starts },
        transmittance: saved.transmittance.as_chunks::<LANES>().0.as_chunks::<SEGMENTS>().0,
        last: saved.last.as_chunks::<LANES>().0.as_chunks::<SEGMENTS>().0,
        v_picture,
        statistic,
    };
    let blended = blend_backward(&source);
    let index = RecordIndex::of(saved.slots, cloud.len());
    let gradients = project_backward(cloud, view, records, index, &blended.records);
    SplatTensors { background: blended.background, ..gradients }
}
