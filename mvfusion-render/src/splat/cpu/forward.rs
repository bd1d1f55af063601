//! The whole forward pass: project, bin, blend, and pack the image.

use mvfusion_kernels::splat::{TILE, alpha_plane, depth_channel, plane_count};
use rayon::prelude::*;

use super::blend::{Blended, Tally, TileSource, blend};
use super::cloud::Cloud;
use super::lanes::{HALVES, LANES, Lane};
use super::project::{Projections, project};
use super::tiles::{Bins, bin};
use super::view::View;
use crate::splat::SplatError;

/// A rendered image and the state for the backward pass.
pub(crate) struct Forward<T, K> {
    /// `[2, channels + 1, height, width]`: colour, features, alpha, depth; both copies are equal.
    pub picture: Vec<T>,
    /// `[N]`, the larger of the two radii.
    pub radii: Vec<i32>,
    pub projections: Projections<T>,
    pub bins: Bins,
    pub blended: Blended<T>,
    /// Tallies of the tiles.
    pub tallies: Vec<K>,
    /// The error if an index cannot count the pairs of a Gaussian and a tile; the lists and the image are then empty.
    pub refused: Option<SplatError>,
}

/// Renders.
pub(crate) fn forward<T: Lane, K: Tally>(cloud: &Cloud<T>, view: &View<T>) -> Forward<T, K> {
    let projections = project(cloud, view);
    let (bins, refused) = match bin(&projections, view) {
        Ok(bins) => (bins, None),
        Err(error) => (Bins::none(cloud.len(), view.tile_count()), Some(error)),
    };
    let source = TileSource {
        cloud: *cloud,
        view,
        records: projections.records.as_chunks().0,
        sorted: &bins.sorted,
        starts: &bins.starts,
    };
    let (blended, tallies) = blend(&source);
    let radii = projections.radii.as_chunks::<2>().0.iter().map(|r| r[0].max(r[1])).collect();
    let picture = lay_out(&blended, cloud.channels(), view);
    Forward { picture, radii, projections, bins, blended, tallies, refused }
}

/// Packs the tiles into an image.
fn lay_out<T: Lane>(blended: &Blended<T>, channels: usize, view: &View<T>) -> Vec<T> {
    let (width, height, columns) = (view.width, view.height, view.grid()[0]);
    let mut picture = vec![T::zero(); 2 * plane_count(channels) * height * width];
    picture.par_chunks_mut(width).enumerate().for_each(|(line, row)| {
        let (plane, y) = (line / height % plane_count(channels), line % height);
        let is_alpha = plane == alpha_plane(channels);
        let channel = if plane < alpha_plane(channels) { plane } else { depth_channel(channels) };
        let segment = |index: usize| {
            let (tile, half) = (y / TILE * columns + index / HALVES, index % HALVES);
            let source =
                if is_alpha { &blended.transmittance[tile] } else { &blended.channels[tile * channels + channel] };
            let lanes = source[half * TILE + y % TILE];
            if is_alpha { lanes.map(|t| T::one() - t) } else { lanes }
        };
        let (whole, rest) = row.as_chunks_mut::<LANES>();
        let count = whole.len();
        whole.iter_mut().enumerate().for_each(|(index, pixels)| *pixels = segment(index));
        if !rest.is_empty() {
            rest.copy_from_slice(&segment(count)[..rest.len()]);
        }
    });
    picture
}
