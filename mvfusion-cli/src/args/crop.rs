//! The box that a render or an export is cut down to.

use clap::Args;
use glam::{DQuat, DVec3};
use mvfusion_model::ModelError;
use mvfusion_model::model::{CropError, DeformationLevel, Model, OrientedBox, RenderContext};

use crate::failure::UsageError;
use crate::progress::Verbosity;

/// The box that a render or an export is cut down to.
#[derive(Clone, Debug, Default, Args)]
pub struct CropArgs {
    /// Keep only Gaussians in a box with this centre, in the world coordinates of the cameras and of exported files
    ///
    /// A static Gaussian is kept if its centre lies in the box; a dynamic one, if its centre does at a training time at
    /// which it is alive.
    #[arg(long, value_name = "X,Y,Z", alias = "crop-center", value_parser = parse_vector, allow_hyphen_values = true)]
    #[arg(requires = "crop_size")]
    pub crop_centre: Option<DVec3>,
    /// Lengths of the edges of that box
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_size, requires = "crop_centre")]
    pub crop_size: Option<DVec3>,
    /// Rotation of that box about the world's x axis, then y, then z, in degrees
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_vector, allow_hyphen_values = true)]
    #[arg(requires = "crop_centre")]
    pub crop_rotation: Option<DVec3>,
}

impl CropArgs {
    /// The box, if there is one.
    pub fn region(&self) -> Option<OrientedBox> {
        let angles = self.crop_rotation.unwrap_or_default().map(f64::to_radians);
        let rotation = DQuat::from_rotation_z(angles.z) * DQuat::from_rotation_y(angles.y);
        let rotation = rotation * DQuat::from_rotation_x(angles.x);
        Some(OrientedBox { centre: self.crop_centre?, size: self.crop_size?, rotation })
    }

    /// The part of a model in the box; without a box, the model. Prints what is kept.
    ///
    /// # Errors
    /// If no Gaussian lies in the box, or the device fails.
    pub fn crop(
        &self,
        model: Model,
        level: DeformationLevel,
        context: &RenderContext,
        verbosity: Verbosity,
    ) -> anyhow::Result<Model> {
        let Some(region) = self.region() else { return Ok(model) };
        let crop = model.crop(&region, level, context).map_err(|error| match error {
            CropError::Empty { .. } => {
                anyhow::Error::from(UsageError::new(format!("{error}. Change --crop-centre or --crop-size.")))
            }
            CropError::Model(error) => ModelError::into(error),
        })?;
        for branch in crop.kept {
            verbosity.note(&format!("crop:   {} of {} {} Gaussians", branch.kept, branch.all, branch.branch));
        }
        Ok(crop.model)
    }
}

/// Parses three numbers.
fn parse_vector(text: &str) -> Result<DVec3, String> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|number| number.trim().parse().ok()).collect();
    let vector = numbers.and_then(|numbers| <[f64; 3]>::try_from(numbers).ok()).map(DVec3::from_array);
    vector.filter(|vector| vector.is_finite()).ok_or_else(|| "expected three numbers such as 0.5,-1,2".to_owned())
}

/// Parses three positive lengths.
fn parse_size(text: &str) -> Result<DVec3, String> {
    let size = parse_vector(text).ok().filter(|size| size.min_element() > 0.0);
    size.ok_or_else(|| "expected three lengths above 0, such as 2,2,1.5".to_owned())
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Debug, Parser)]
    struct Line {
        #[command(flatten)]
        crop: CropArgs,
    }

    fn region(line: &[&str]) -> Option<OrientedBox> {
        Line::try_parse_from([&["program"], line].concat()).expect("a command line").crop.region()
    }

    #[test]
    fn a_box_has_a_centre_a_size_and_perhaps_a_rotation() {
        assert_eq!(region(&[]), None);
        let place = ["--crop-centre", "-1,2,0", "--crop-size", "2,4,1"];
        let plain = region(&place).expect("a box");
        assert_eq!((plain.centre, plain.size), (DVec3::new(-1.0, 2.0, 0.0), DVec3::new(2.0, 4.0, 1.0)));
        assert_eq!(plain.rotation, DQuat::IDENTITY);
        // About x, y becomes z; then z stays z.
        let turned = region(&[place.as_slice(), &["--crop-rotation", "90,0,90"]].concat()).expect("a box");
        assert!((turned.rotation * DVec3::Y).abs_diff_eq(DVec3::Z, 1e-12));
        assert!((turned.rotation * DVec3::X).abs_diff_eq(DVec3::Y, 1e-12));
    }

    #[test]
    fn half_a_box_and_what_is_no_vector_are_refused() {
        for line in [
            ["--crop-centre", "0,0,0"].as_slice(),
            &["--crop-size", "1,1,1"],
            &["--crop-rotation", "0,0,45"],
            &["--crop-centre", "0,0", "--crop-size", "1,1,1"],
            &["--crop-centre", "0,0,nan", "--crop-size", "1,1,1"],
            &["--crop-centre", "0,0,0", "--crop-size", "1,0,1"],
        ] {
            assert!(Line::try_parse_from([&["program"], line].concat()).is_err(), "{line:?}");
        }
    }
}
