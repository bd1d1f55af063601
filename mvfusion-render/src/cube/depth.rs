//! The visible Gaussians of the frames of a batch in order of depth. The frames are sorted together, because a sort
//! consists of many short launches.

use std::sync::Arc;

use burn_cubecl::tensor::CubeTensor;
use mvfusion_kernels::cube::tiles::{begin_pairs, collect_visible, counts_by_depth, frame_keys, mark_visible};

use super::frame::ProjectedFrame;
use super::gpu::{CUBE, Flat, Gpu};
use super::scan::{RunningSums, running_sums};
use super::sort::{Keyed, bits_of, sort};

/// Bits of a depth's sort key.
const DEPTH_BITS: usize = 32;

/// Sorts the Gaussians of some frames, at least one, by frame and depth. Returns where the pairs of each Gaussian and its
/// tiles begin in that order, `[N]`, of which the numbers of visible Gaussians are valid.
pub(super) fn sort_by_depth(frames: &[Arc<ProjectedFrame>]) -> CubeTensor {
    let gpu = &frames[0].frame.gpu;
    let mut count = 0;
    let first = |own: &Arc<ProjectedFrame>| {
        count += own.frame.count();
        count - own.frame.count()
    };
    let firsts: Vec<usize> = frames.iter().map(first).collect();
    let (marks, touched) = (gpu.naturals(count), gpu.naturals(count));
    for (ProjectedFrame { frame, projected }, first) in frames.iter().map(Arc::as_ref).zip(&firsts) {
        mark_visible::launch(
            &gpu.client,
            gpu.units(frame.count()),
            CUBE,
            projected.touched.clone().flat(),
            marks.clone().flat(),
            touched.clone().flat(),
            *first as u32,
            frame.count() as u32,
        );
    }
    let RunningSums { before: ranks, total: visible } = running_sums(gpu, &marks, count);
    let [keys, ids] = [(); 2].map(|()| gpu.naturals(count));
    for (ProjectedFrame { frame, projected }, first) in frames.iter().map(Arc::as_ref).zip(&firsts) {
        collect_visible::launch(
            &gpu.client,
            gpu.units(frame.count()),
            CUBE,
            projected.records.clone().flat(),
            projected.touched.clone().flat(),
            ranks.clone().flat(),
            keys.clone().flat(),
            ids.clone().flat(),
            *first as u32,
            frame.count() as u32,
        );
    }
    let by_depth = sort(gpu, keys, Some(ids), &visible, count, DEPTH_BITS);
    let ids = if frames.len() > 1 { sort_by_frame(gpu, by_depth, &visible, &firsts, count) } else { by_depth }.numbers;
    let counts = marks;
    counts_by_depth::launch(
        &gpu.client,
        gpu.units(count),
        CUBE,
        ids.clone().flat(),
        touched.flat(),
        visible.clone().flat(),
        counts.clone().flat(),
        count as u32,
    );
    let begins = gpu.naturals(count);
    begin_pairs::launch(
        &gpu.client,
        gpu.units(count),
        CUBE,
        ids.flat(),
        running_sums(gpu, &counts, count).before.flat(),
        visible.flat(),
        begins.clone().flat(),
    );
    begins
}

/// Sorts by frame what is sorted by depth. The sort is stable.
fn sort_by_frame(gpu: &Gpu, by_depth: Keyed, visible: &CubeTensor, firsts: &[usize], count: usize) -> Keyed {
    let frames = firsts.len();
    frame_keys::launch(
        &gpu.client,
        gpu.units(count),
        CUBE,
        by_depth.numbers.clone().flat(),
        gpu.upload(&firsts.iter().map(|first| *first as u32).collect::<Vec<u32>>()).flat(),
        visible.clone().flat(),
        by_depth.keys.clone().flat(),
        frames as u32,
    );
    sort(gpu, by_depth.keys, Some(by_depth.numbers), visible, count, bits_of(frames))
}
