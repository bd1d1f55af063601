//! The images of an evaluation: one file per layer, and strips of layers side by side.

use std::cell::Cell;
use std::path::{Path, PathBuf};

use image::{DynamicImage, GenericImage, RgbImage};
use mvfusion_data::View;
use mvfusion_model::config::EvalConfig;
use mvfusion_model::evaluation::{DepthRange, Layer, ViewPictures};
use mvfusion_model::model::Model;
use mvfusion_model::timeline;

use super::files::{PANELS, RENDERS, STRIPS, picture_file};
use super::folder::place;
use super::picture_kind::PictureKind;
use crate::atomic;

/// The panels of a strip of a model, from left to right.
pub fn legend(model: &Model) -> String {
    let branches = model.static_.as_ref().map(|_| [Layer::Static, Layer::Dynamic, Layer::Mask].map(Layer::name));
    let motion = model.motion.as_ref().map(|_| Layer::Motion.label());
    let first = [PictureKind::GroundTruth.label(), Layer::Composed.name()];
    first.into_iter().chain(branches.into_iter().flatten()).chain(motion).collect::<Vec<_>>().join(", ")
}

/// White pixels between two panels of a strip.
const GAP: u32 = 4;

/// Writes the images of held-out views to a run folder.
#[derive(Clone, Debug)]
pub struct PicturesWriter {
    run: PathBuf,
    /// Whether every layer is written to a file.
    layers: bool,
    /// The views with a strip.
    strips: Vec<usize>,
    /// The scale of all depth images: that of the first one, so that they can be compared.
    depths: Cell<Option<DepthRange>>,
}

impl PicturesWriter {
    /// A writer for `views` held-out views. The configuration selects the images.
    pub fn new(run: &Path, config: &EvalConfig, views: usize) -> Self {
        let strips = timeline::spread(views, config.strips);
        Self { run: run.to_owned(), layers: config.pictures, strips, depths: Cell::new(None) }
    }

    /// An example strip: the middle one, if there is any.
    pub fn strip_to_see(&self) -> Option<PathBuf> {
        let middle = self.strips.get(self.strips.len() / 2)?;
        Some(self.run.join(STRIPS).join(picture_file(*middle)))
    }

    /// The files of the strips, which exist once their views have been written.
    pub fn strips(&self) -> impl Iterator<Item = PathBuf> {
        self.strips.iter().map(|&index| self.run.join(STRIPS).join(picture_file(index)))
    }

    /// Whether every layer is written to a file.
    pub fn writes_layers(&self) -> bool {
        self.layers
    }

    /// Whether the view with this index has a strip.
    pub fn makes_strip(&self, index: usize) -> bool {
        self.strips.contains(&index)
    }

    /// Writes a layer of a view, if layers are written to files.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write_layer(&self, index: usize, layer: Layer, picture: &RgbImage) -> anyhow::Result<()> {
        match self.layers {
            true => self.write_kind(index, PictureKind::Model(layer), picture.clone()),
            false => Ok(()),
        }
    }

    fn write_kind(&self, index: usize, kind: PictureKind, picture: impl Into<DynamicImage>) -> anyhow::Result<()> {
        atomic::write_png(&place(&self.run, &[RENDERS, "test", kind.folder(), &picture_file(index)])?, picture)
    }

    /// Writes the selected images of a view.
    ///
    /// # Errors
    /// If a photo cannot be read or a file cannot be written.
    pub fn write(&self, index: usize, view: &View, pictures: &ViewPictures) -> anyhow::Result<()> {
        if self.layers {
            self.write_layers(index, view, pictures)?;
        }
        if self.makes_strip(index) {
            let photo = view.image.rgb()?;
            let mut panels = vec![&*photo, &pictures.composed];
            if let Some(layers) = &pictures.branches {
                panels.extend([&layers.static_, &layers.dynamic, &layers.mask]);
            }
            panels.extend(&pictures.motion);
            self.write_panels(pictures)?;
            atomic::write_png(&place(&self.run, &[STRIPS, &picture_file(index)])?, side_by_side(&panels)?)?;
        }
        Ok(())
    }

    /// Writes what the panels of the strips show, for their captions.
    fn write_panels(&self, pictures: &ViewPictures) -> anyhow::Result<()> {
        let branches = pictures.branches.as_ref().map(|_| [Layer::Static, Layer::Dynamic, Layer::Mask]);
        let layers = branches.into_iter().flatten().chain(pictures.motion.as_ref().map(|_| Layer::Motion));
        let first = [PictureKind::GroundTruth, PictureKind::Model(Layer::Composed)];
        let labels: Vec<&str> =
            first.into_iter().chain(layers.map(PictureKind::Model)).map(PictureKind::label).collect();
        atomic::write_json(&place(&self.run, &[STRIPS, PANELS])?, &labels)
    }

    fn write_layers(&self, index: usize, view: &View, pictures: &ViewPictures) -> anyhow::Result<()> {
        let write = |layer: Layer, picture: &RgbImage| self.write_layer(index, layer, picture);
        write(Layer::Composed, &pictures.composed)?;
        let (depth, range) = pictures.depth(self.depths.get())?;
        self.depths.set(Some(range));
        write(Layer::Depth, &depth)?;
        if let Some(branches) = &pictures.branches {
            write(Layer::Static, &branches.static_)?;
            write(Layer::Dynamic, &branches.dynamic)?;
            write(Layer::Mask, &branches.mask)?;
            let [masked_static, masked_dynamic] = branches.masked()?;
            write(Layer::MaskedStatic, &masked_static)?;
            write(Layer::MaskedDynamic, &masked_dynamic)?;
        }
        if let Some(motion) = &pictures.motion {
            write(Layer::Motion, motion)?;
        }
        self.write_kind(index, PictureKind::GroundTruth, (*view.image.rgb()?).clone())?;
        if let Some(background) = &view.truth.background {
            self.write_kind(index, PictureKind::TrueBackground, (*background.rgb()?).clone())?;
        }
        if let Some(mask) = &view.truth.dynamic_mask {
            self.write_kind(index, PictureKind::TrueMask, mask.mask()?)?;
        }
        Ok(())
    }
}

/// Images in a row, tops aligned, with white gaps.
fn side_by_side(panels: &[&RgbImage]) -> anyhow::Result<RgbImage> {
    let height = panels.iter().map(|panel| panel.height()).max().unwrap_or(0);
    let gaps = GAP * panels.len().saturating_sub(1) as u32;
    let width = panels.iter().map(|panel| panel.width()).sum::<u32>() + gaps;
    let mut strip = RgbImage::from_pixel(width, height, image::Rgb([255; 3]));
    let mut left = 0;
    for panel in panels {
        strip.copy_from(*panel, left, 0)?;
        left += panel.width() + GAP;
    }
    Ok(strip)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_stand_side_by_side_with_gaps() {
        let grey = |level, width| RgbImage::from_pixel(width, 2, image::Rgb([level; 3]));
        let strip = side_by_side(&[&grey(10, 3), &grey(20, 2)]).expect("made");
        assert_eq!(strip.dimensions(), (3 + GAP + 2, 2));
        let level = |x| strip.get_pixel(x, 1).0[0];
        assert_eq!([level(0), level(2), level(3), level(6), level(7), level(8)], [10, 10, 255, 255, 20, 20]);
    }

    #[test]
    fn strips_are_spread_over_all_views() {
        let config = EvalConfig { strips: 3, ..Default::default() };
        let writer = PicturesWriter::new(Path::new("run"), &config, 25);
        assert_eq!(writer.strips, [0, 12, 24]);
        assert_eq!(writer.strip_to_see(), Some("run/strips/00012.png".into()));
        let none = EvalConfig { strips: 0, ..config };
        assert_eq!(PicturesWriter::new(Path::new("run"), &none, 25).strip_to_see(), None);
    }
}
