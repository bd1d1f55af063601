//! What the dynamic regions of a table were taken from: metrics of one region by different masks differ by several
//! decibels, so that none stands without the name of its masks.

use std::collections::BTreeMap;

use mvfusion_model::evaluation::RegionSource;

use super::{Column, Outcome, Table, TrainedCell};

/// Whether a metric is of the training views, if it is one of a region that masks decide about.
fn is_of_training(name: &str) -> Option<bool> {
    let (is_training, rest) = match name.strip_prefix("training_views.") {
        Some(rest) => (true, rest),
        None => (false, name),
    };
    let regions = ["dynamic_region.", "still_region.", "dynamic_minus_still"];
    regions.iter().any(|region| rest.starts_with(region)).then_some(is_training)
}

/// The scenes of the columns that show a metric of a region, by what their regions were taken from.
pub(super) fn sources(columns: &[Column], cells: &[TrainedCell]) -> BTreeMap<RegionSource, Vec<String>> {
    let mut sources: BTreeMap<RegionSource, Vec<String>> = BTreeMap::new();
    for column in columns {
        let Some(is_training) = is_of_training(&column.metric.name) else { continue };
        for (cell, outcome) in cells.iter().filter(|(cell, _)| column.scenes.contains(&cell.scene)) {
            let Outcome::Metrics(metrics) = outcome else { continue };
            let source = if is_training { metrics.training_regions } else { metrics.regions };
            let Some(scenes) = source.map(|source| sources.entry(source).or_default()) else { continue };
            if !scenes.contains(&cell.scene) {
                scenes.push(cell.scene.clone());
            }
        }
    }
    sources
}

impl Table {
    /// Which masks the regions were taken from, of which scenes.
    pub(super) fn region_note(&self) -> Option<String> {
        let of =
            |(source, scenes): (&RegionSource, &Vec<String>)| format!("{} ({})", source.words(), scenes.join(", "));
        let sources: Vec<String> = self.regions.iter().map(of).collect();
        (!sources.is_empty()).then(|| format!("Dynamic and still regions: {}.", sources.join("; ")))
    }
}

#[cfg(test)]
mod tests {
    use super::super::CellMetrics;
    use super::super::specimen::{cell, group, index};
    use super::*;

    #[test]
    fn a_table_with_metrics_of_regions_names_their_masks_by_scene() {
        let metrics = |regions, training_regions| {
            let numbers = [("dynamic_region.psnr".to_owned(), 20.0)].into();
            Outcome::Metrics(CellMetrics { numbers, regions, training_regions, ..CellMetrics::default() })
        };
        let columns = |metric: &str| vec![group("a", &["video", "steak", "casual"], &["composed.psnr", metric])];
        let note = |metric: &str| {
            let mut index = index(&[], columns(metric), "");
            index.cells = ["video", "steak", "casual", "video"].map(|scene| cell(scene, "", &[], 0)).into();
            let (exact, deviation) = (Some(RegionSource::TrueMasks), Some(RegionSource::TemporalDeviation));
            let outcomes = [(exact, None), (deviation, None), (None, exact), (exact, None)]
                .map(|(test, training)| metrics(test, training));
            Table::of(&index, &outcomes).region_note()
        };
        let test = "Dynamic and still regions: true masks (video); temporal deviation (steak).";
        assert_eq!(note("dynamic_region.psnr").as_deref(), Some(test));
        assert_eq!(note("dynamic_minus_still_psnr").as_deref(), Some(test));
        let training = "Dynamic and still regions: true masks (casual).";
        assert_eq!(note("training_views.still_region.ssim").as_deref(), Some(training));
        assert_eq!(note("mask_iou"), None);
    }
}
