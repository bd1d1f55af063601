//! `mvfusion synth`.

use std::io::Write;

use mvfusion_data::camera_path::LONGEST_SIDE;
use mvfusion_data::{BuiltinKind, BuiltinOptions, Capture, builtin};

use crate::args::SynthArgs;
use crate::progress::Talk;
use crate::render::LEAST_SIDE;
use crate::scene;

/// Writes a built-in scene in a layout of the field, with its ground truth beside it.
///
/// # Errors
/// If something lies in the folder, or a file cannot be written.
pub fn synth(args: &SynthArgs, talk: Talk, out: &mut dyn Write) -> anyhow::Result<()> {
    let kind = match args.layout.capture() {
        Capture::Video => BuiltinKind::Video,
        Capture::Photos => BuiltinKind::Casual,
    };
    let (width, height) = args.size;
    let defaults = BuiltinOptions::of_kind(kind);
    let options = BuiltinOptions {
        seed: args.seed,
        width,
        height,
        frames: args.frames.map_or(defaults.frames, usize::from),
        photos: args.photos.map_or(defaults.photos, usize::from),
        ..defaults
    };
    let scene = builtin::builtin(&options);
    talk.note(&format!("scene:  {}", scene::describe(&scene)));
    mvfusion_data::write::write(&scene, args.layout, &args.out)?;
    writeln!(out, "{}", args.out.display())?;
    Ok(())
}

/// Takes the size of pictures, `160x120`.
///
/// # Errors
/// If it is none, or one that cannot be rendered.
pub fn parse_size(text: &str) -> Result<(usize, usize), String> {
    let side = |text: &str| text.parse().ok().filter(|side: &usize| (LEAST_SIDE..=LONGEST_SIDE).contains(side));
    let sides = text.split_once('x').and_then(|(width, height)| Some((side(width)?, side(height)?)));
    let complaint = || format!("a size is written as 160x120, and each side has {LEAST_SIDE} to {LONGEST_SIDE} pixels");
    sides.ok_or_else(complaint)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_have_bounds() {
        assert_eq!([parse_size("16x120"), parse_size("16384x16")], [Ok((16, 120)), Ok((16_384, 16))]);
        for bad in ["15x120", "160x15", "16385x16", "16x16385", "160", "160x", "-160x120", "axb"] {
            let error = parse_size(bad).expect_err("refused");
            assert!(error.contains("160x120") && error.contains("16 to 16384 pixels"), "{bad}: {error}");
        }
    }
}
