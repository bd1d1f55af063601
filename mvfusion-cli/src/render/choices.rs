//! Values of command line options.

use std::num::NonZeroUsize;

use clap::ValueEnum;
use mvfusion_data::camera_path::{FRAME_RATES, LONGEST_SIDE, MOST_ENTRIES};
use mvfusion_data::can_write_videos;
use mvfusion_model::config::FusionWeights;
use mvfusion_model::evaluation::Layer;
use mvfusion_model::model::{DeformationLevel, Model};

use super::views::LEAST_SIDE;
use crate::failure::UsageError;
use crate::progress::Verbosity;

/// A requested layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LayerChoice {
    /// All layers of the model.
    All,
    /// This one.
    One(Layer),
}

/// A file format.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum FileFormat {
    /// One 8-bit image per layer and frame
    Png,
    /// One image per frame, with all layers as floats
    Exr,
    /// One animation per layer
    Gif,
    /// One video per layer
    Mp4,
}

impl FileFormat {
    /// The formats to write: those in `asked`, or a default for this number of frames.
    ///
    /// # Errors
    /// If videos are requested and ffmpeg is missing.
    pub fn choose(asked: &[Self], frames: usize, verbosity: Verbosity) -> Result<Vec<Self>, UsageError> {
        if asked.contains(&Self::Mp4) && !can_write_videos() {
            return Err(UsageError::new(
                "--format mp4 needs ffmpeg, which was not found. Install it, or use gif or png.",
            ));
        }
        if !asked.is_empty() {
            return Ok(Self::value_variants().iter().copied().filter(|format| asked.contains(format)).collect());
        }
        if frames == 1 {
            return Ok(vec![Self::Png]);
        }
        let mut formats = vec![Self::Png, Self::Gif];
        if can_write_videos() {
            formats.push(Self::Mp4);
        } else {
            verbosity.note("note:   no mp4 is written, because ffmpeg was not found");
        }
        Ok(formats)
    }
}

/// Parses the name of a layer, with hyphens or underscores, or `all`.
///
/// # Errors
/// If there is no such layer.
pub fn parse_layer(text: &str) -> Result<LayerChoice, String> {
    if text == "all" {
        return Ok(LayerChoice::All);
    }
    let names = || Layer::ALL.map(Layer::name).join(", ");
    let layer = Layer::of_name(&text.replace('-', "_"));
    layer.map(LayerChoice::One).ok_or_else(|| format!("expected all, {}", names()))
}

/// The requested layers of a model, each once; the usual ones if none is requested.
pub fn chosen_layers(asked: &[LayerChoice], model: &Model, level: DeformationLevel) -> Vec<Layer> {
    if asked.is_empty() {
        return Layer::usual(model, level);
    }
    let mut layers = Vec::new();
    for choice in asked {
        match choice {
            LayerChoice::One(layer) => layers.push(*layer),
            LayerChoice::All => layers.extend(Layer::ALL.iter().filter(|layer| layer.lacking(model, level).is_none())),
        }
    }
    let mut seen = Vec::new();
    layers.retain(|layer| {
        let new = !seen.contains(layer);
        seen.push(*layer);
        new
    });
    layers
}

/// Parses a time, 0 to 1.
///
/// # Errors
/// If the text is not valid.
pub fn parse_time(text: &str) -> Result<f64, String> {
    let time = text.parse().ok().filter(|time| (0.0..=1.0).contains(time));
    time.ok_or_else(|| "expected a number from 0 to 1".to_owned())
}

/// Parses a frame rate.
///
/// # Errors
/// If the text is not valid.
pub fn parse_fps(text: &str) -> Result<f64, String> {
    let fps = text.parse().ok().filter(|fps: &f64| FRAME_RATES.contains(fps));
    let (least, most) = FRAME_RATES.into_inner();
    fps.ok_or_else(|| format!("expected a number between {least} and {most}"))
}

/// Parses a number of frames.
///
/// # Errors
/// If the text is not valid, or the number is larger than a camera path may have.
pub fn parse_frames(text: &str) -> Result<NonZeroUsize, String> {
    let frames = text.parse().ok().filter(|frames: &NonZeroUsize| frames.get() <= MOST_ENTRIES);
    frames.ok_or_else(|| format!("expected a whole number from 1 to {MOST_ENTRIES}"))
}

/// Parses an image size, `160x120`.
///
/// # Errors
/// If the text is not valid, or the size cannot be rendered.
pub fn parse_size(text: &str) -> Result<(usize, usize), String> {
    let side = |text: &str| text.parse().ok().filter(|side: &usize| (LEAST_SIDE..=LONGEST_SIDE).contains(side));
    let sides = text.split_once('x').and_then(|(width, height)| Some((side(width)?, side(height)?)));
    let complaint = || format!("expected a size such as 160x120, with sides of {LEAST_SIDE} to {LONGEST_SIDE} pixels");
    sides.ok_or_else(complaint)
}

/// Parses the weights of the motion intensity, `0.7,0.2,0.1` for position, scale and rotation.
///
/// # Errors
/// If the text is not valid.
pub fn parse_weights(text: &str) -> Result<FusionWeights, String> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|number| number.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[position, scale, rotation])
            if [position, scale, rotation].iter().all(|weight| weight.is_finite() && *weight >= 0.0)
                && position + scale + rotation > 0.0 =>
        {
            Ok(FusionWeights { position, scale, rotation })
        }
        _ => Err(
            "expected weights such as 0.7,0.2,0.1 for position, scale and rotation; none may be negative, and not all 0"
                .to_owned(),
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_are_three_numbers_not_below_zero() {
        let weights = FusionWeights { position: 1.0, scale: 0.5, rotation: 0.0 };
        assert_eq!(parse_weights("1, 0.5,0"), Ok(weights));
        for bad in ["1,2", "1,2,3,4", "1,-2,3", "0,0,0", "a,b,c", "1,nan,0", "inf,0,0"] {
            assert!(parse_weights(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn layers_are_named_with_hyphens_or_underscores() {
        let masked = Ok(LayerChoice::One(Layer::MaskedStatic));
        assert_eq!([parse_layer("masked-static"), parse_layer("masked_static")], [masked.clone(), masked]);
        assert_eq!(parse_layer("all"), Ok(LayerChoice::All));
        assert!(parse_layer("gt").is_err_and(|error| error.contains("scale_variance")));
    }

    #[test]
    fn sizes_have_bounds() {
        assert_eq!([parse_size("16x120"), parse_size("16384x16")], [Ok((16, 120)), Ok((16_384, 16))]);
        for bad in ["15x120", "160x15", "16385x16", "16x16385", "160", "160x", "-160x120", "axb"] {
            let error = parse_size(bad).expect_err("refused");
            assert!(error.contains("160x120") && error.contains("16 to 16384 pixels"), "{bad}: {error}");
        }
    }

    #[test]
    fn moments_and_rates_have_bounds() {
        assert_eq!((parse_time("0.25"), parse_fps("29.97")), (Ok(0.25), Ok(29.97)));
        assert!(["1.01", "-0.1", "nan", ""].iter().all(|bad| parse_time(bad).is_err()));
        for bad in ["0", "-1", "inf", "nan", "1e300", "1e-300", "240.5", "x"] {
            assert_eq!(parse_fps(bad), Err("expected a number between 0.1 and 240".to_owned()), "{bad}");
        }
    }

    #[test]
    fn a_film_has_a_frame_and_no_more_than_an_hour() {
        assert_eq!(
            [parse_frames("1"), parse_frames("108000")].map(|frames| frames.map(usize::from)),
            [Ok(1), Ok(108_000)]
        );
        for bad in ["0", "-1", "1.5", "108001", "1e3", "many", "99999999999999999999"] {
            assert_eq!(parse_frames(bad), Err("expected a whole number from 1 to 108000".to_owned()), "{bad}");
        }
    }

    #[test]
    fn a_single_frame_is_a_picture_and_what_is_asked_for_is_written() {
        let choose =
            |asked: &[FileFormat], frames| FileFormat::choose(asked, frames, Verbosity::SILENT).expect("chosen");
        assert_eq!(choose(&[], 1), [FileFormat::Png]);
        assert_eq!(choose(&[], 2)[..2], [FileFormat::Png, FileFormat::Gif]);
        assert_eq!(choose(&[FileFormat::Exr], 9), [FileFormat::Exr]);
        let twice = [FileFormat::Gif, FileFormat::Png, FileFormat::Gif];
        assert_eq!(choose(&twice, 9), [FileFormat::Png, FileFormat::Gif]);
    }
}
