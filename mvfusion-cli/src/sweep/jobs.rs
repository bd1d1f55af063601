//! How many cells run at a time on this machine, and with how many threads each.

use std::collections::BTreeMap;

use super::index::Cell;
use super::plan::Plan;
use crate::device;
use crate::memory::{Available, need_of_training};

/// Cells at a time, unless `--jobs` is given.
///
/// On a CPU, a cell for each thread finishes more of them in an hour (docs/performance.md, "Cells side by side"), as far
/// as the memory suffices for the largest one. Cells run one after the other on a GPU, where frame rates are measured, and
/// where the free memory is unknown.
pub fn default_jobs(plan: &Plan, to_do: &[&Cell], device: &str, threads: usize) -> usize {
    let is_alone = plan.index.wanted.speed_frames > 0 || device::wants_gpu(device).unwrap_or(true);
    if is_alone || threads == 1 {
        return 1;
    }
    let fitting = |available: Available| (available.bytes as f64 / largest_need(plan, to_do)) as usize;
    Available::on_this_machine().map_or(1, fitting).clamp(1, threads)
}

/// The most memory that a cell needs on a CPU, in bytes, at least 1. What cannot be read is left to the cell, which says
/// so.
fn largest_need(plan: &Plan, to_do: &[&Cell]) -> f64 {
    // Only the seeds of a variant with the same values of the grid surely have the same scene.
    let mut scenes = BTreeMap::new();
    let mut largest = 1.0f64;
    for (cell, config) in plan.index.cells.iter().zip(&plan.configs).filter(|(cell, _)| to_do.contains(cell)) {
        let scene =
            scenes.entry((&cell.scene, &cell.variant, &cell.values)).or_insert_with(|| config.open_scene().ok());
        if let Some(need) = scene.as_ref().and_then(|scene| need_of_training(config, scene).ok()) {
            largest = largest.max(need.host() + need.most);
        }
    }
    largest
}

/// Threads of each of some cells.
pub(super) fn share(threads: usize, cells: usize) -> usize {
    (threads / cells.max(1)).max(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_cell_has_a_thread_and_a_lonely_one_has_all() {
        assert_eq!(
            [(8, 8), (8, 3), (8, 1), (2, 5), (8, 0)].map(|(threads, cells)| share(threads, cells)),
            [1, 2, 8, 1, 8]
        );
    }
}
