//! The film of a report: the held-out views in several layers, in the order of their times, as small images.

mod section;

use std::path::Path;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use image::codecs::jpeg::JpegEncoder;
use image::imageops::FilterType;
use image::{ImageFormat, ImageReader};
use mvfusion_data::files::read_bytes;
use mvfusion_model::evaluation::Layer;
use mvfusion_model::timeline::spread;
use rayon::prelude::*;

use super::album::{names, view_name};
use super::files::RunFiles;
use crate::run::{self, MOST_OF_PICTURE, PictureKind};

pub(super) use section::section;

/// The layers of a film, in the order of its choices.
const KINDS: [PictureKind; 7] = [
    PictureKind::GroundTruth,
    PictureKind::Model(Layer::Composed),
    PictureKind::Model(Layer::Static),
    PictureKind::Model(Layer::Dynamic),
    PictureKind::Model(Layer::Mask),
    PictureKind::Model(Layer::Depth),
    PictureKind::Model(Layer::Motion),
];

/// Maximum number of frames.
const MOST_FRAMES: usize = 60;
/// Maximum widths of the images, largest first. The first width that keeps the film below [`BUDGET`] is used. If none
/// does, frames are left out.
const WIDTHS: [u32; 4] = [480, 320, 240, 160];
/// Maximum size of all images of the film in the page, in bytes.
pub(super) const BUDGET: usize = 8_000_000;
/// Images from which the size of all is estimated.
const TRIED: usize = 3;
/// JPEG quality of the images.
const QUALITY: u8 = 82;

/// A frame.
#[derive(Debug)]
pub(super) struct FilmFrame {
    /// Name of the view.
    pub name: String,
    /// Its time, if known.
    pub time: Option<f64>,
    /// PSNR of the composed render, if known.
    pub psnr: Option<f64>,
    /// The images as data URIs, by kind. One that cannot be read is left out.
    pub images: Vec<(PictureKind, String)>,
}

/// A film; without frames if the run has no layers.
#[derive(Debug)]
pub(super) struct Film {
    /// The frames, by camera and time.
    pub frames: Vec<FilmFrame>,
    /// The kinds that some frame has.
    pub kinds: Vec<PictureKind>,
    /// Width and height of the first image.
    pub size: [u32; 2],
    /// Number of held-out views with layers.
    pub in_folder: usize,
}

impl Film {
    /// Chooses and reads the frames.
    pub fn read(files: &RunFiles) -> Self {
        let renders = files.folder.join(run::RENDERS).join("test");
        let kinds: Vec<PictureKind> =
            KINDS.into_iter().filter(|kind| !names(&renders.join(kind.folder())).is_empty()).collect();
        let mut rendered = names(&renders.join(Layer::Composed.name()));
        sort_by_camera_and_time(files, &mut rendered);
        let in_folder = rendered.len();
        let chosen: Vec<String> =
            spread(in_folder, MOST_FRAMES).into_iter().map(|index| rendered[index].clone()).collect();
        let width = WIDTHS.into_iter().find(|&width| estimate(&renders, &kinds, &chosen, width) <= BUDGET);
        let width = width.unwrap_or(WIDTHS[WIDTHS.len() - 1]);
        let mut frames: Vec<FilmFrame> =
            chosen.par_iter().map(|file| frame(files, &renders, &kinds, file, width)).collect();
        let bytes = |frames: &[FilmFrame]| frames.iter().map(FilmFrame::bytes).sum::<usize>();
        while bytes(&frames) > BUDGET && frames.len() > 1 {
            let fitting = (frames.len() * BUDGET / bytes(&frames)).clamp(1, frames.len() - 1);
            let kept = spread(frames.len(), fitting);
            let mut index = 0;
            frames.retain(|_| {
                index += 1;
                kept.contains(&(index - 1))
            });
        }
        let size = size(&renders, &chosen).unwrap_or([16, 9]);
        Self { frames, kinds, size, in_folder }
    }
}

impl FilmFrame {
    fn bytes(&self) -> usize {
        self.images.iter().map(|(_, uri)| uri.len()).sum()
    }
}

/// Sorts files of views by the camera and the time of the view, or by time alone if every view has a camera of its own.
/// Views of which neither is known stay in the order of their files.
fn sort_by_camera_and_time(files: &RunFiles, rendered: &mut [String]) {
    let Ok(scene) = &files.scene else { return };
    let is_moving = scene.cameras.iter().filter(|camera| camera.is_held_out).all(|camera| camera.views == 1);
    rendered.sort_by_cached_key(|file| {
        let view = index(file).and_then(|index| scene.held_out.get(index));
        let camera = view.filter(|_| !is_moving).map(|view| view.camera);
        // Times are not negative, and the bits of such floats are in the order of their values.
        (camera, view.map(|view| view.time.max(0.0).to_bits()), file.clone())
    });
}

/// The index of a view from the name of its files.
fn index(file: &str) -> Option<usize> {
    file.trim_end_matches(".png").parse().ok()
}

fn frame(files: &RunFiles, renders: &Path, kinds: &[PictureKind], file: &str, width: u32) -> FilmFrame {
    let image = |&kind: &PictureKind| Some((kind, small(&renders.join(kind.folder()).join(file), width)?));
    let scores = files.per_view.as_ref().ok().and_then(|per_view| per_view.test.get(file));
    let view = files.scene.as_ref().ok().and_then(|scene| scene.held_out.get(index(file)?));
    FilmFrame {
        name: view_name(files, file),
        time: view.map(|view| view.time),
        psnr: scores.and_then(|view| view.scores.composed.psnr),
        images: kinds.iter().filter_map(image).collect(),
    }
}

/// An image as a data URI of a JPEG of at most this width; `None` if it cannot be read.
fn small(path: &Path, width: u32) -> Option<String> {
    let bytes = read_bytes(path, MOST_OF_PICTURE).ok()?;
    let picture = ImageReader::with_format(std::io::Cursor::new(bytes), ImageFormat::Png).decode().ok()?;
    let picture = match picture.width() > width {
        true => picture.resize(width, u32::MAX, FilterType::Triangle),
        false => picture,
    };
    let mut jpeg = Vec::new();
    picture.into_rgb8().write_with_encoder(JpegEncoder::new_with_quality(&mut jpeg, QUALITY)).ok()?;
    Some(format!("data:image/jpeg;base64,{}", STANDARD.encode(jpeg)))
}

/// About how many bytes a film of this width has.
fn estimate(renders: &Path, kinds: &[PictureKind], files: &[String], width: u32) -> usize {
    let tried = spread(files.len(), TRIED);
    let bytes = |&index: &usize| -> usize {
        let each = kinds.iter().filter_map(|kind| small(&renders.join(kind.folder()).join(&files[index]), width));
        each.map(|uri| uri.len()).sum()
    };
    tried.par_iter().map(bytes).sum::<usize>() * files.len() / tried.len().max(1)
}

/// Width and height of the first image that can be read.
fn size(renders: &Path, files: &[String]) -> Option<[u32; 2]> {
    let folder = renders.join(Layer::Composed.name());
    let found = files.iter().find_map(|file| image::image_dimensions(folder.join(file)).ok());
    found.map(|(width, height)| [width, height])
}

#[cfg(test)]
mod tests {
    use image::{Rgb, RgbImage};

    use super::*;
    use crate::run::{HeldOutView, SceneCamera, SceneFile};

    /// A run with this many views in two layers, whose times run backwards.
    fn run(views: usize, side: u32, noise: bool) -> tempfile::TempDir {
        let folder = tempfile::tempdir().expect("folder");
        for layer in ["gt", "composed"] {
            let layers = folder.path().join("renders/test").join(layer);
            std::fs::create_dir_all(&layers).expect("made");
            for view in 0..views {
                let level =
                    |x: u32, y: u32, k: u32| if noise { x * x * k + y * y * 31 + x * y * 7 } else { view as u32 };
                let picture = RgbImage::from_fn(side, side, |x, y| Rgb([1, 5, 9].map(|k| level(x, y, k) as u8)));
                picture.save(layers.join(format!("{view:05}.png"))).expect("saved");
            }
        }
        std::fs::write(folder.path().join("config.toml"), "seed = 1\n").expect("written");
        folder
    }

    fn scene(folder: &Path, views: usize) {
        let camera = SceneCamera {
            name: "cam00".into(),
            is_held_out: true,
            position: [0.0; 3],
            axes: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            half_size: [0.5; 2],
            times: [0.0, 1.0],
            views,
        };
        let view = |index: usize| HeldOutView { name: index.to_string(), time: 1.0 - index as f64 / 100.0, camera: 0 };
        let file = SceneFile {
            extent: 1.0,
            centre: [0.0; 3],
            points: None,
            cameras: vec![camera],
            held_out: (0..views).map(view).collect(),
        };
        std::fs::write(folder.join(run::SCENE), serde_json::to_string(&file).expect("JSON")).expect("written");
    }

    fn film(folder: &tempfile::TempDir) -> Film {
        Film::read(&RunFiles::read(folder.path()).expect("read"))
    }

    #[test]
    fn frames_run_in_the_order_of_time_and_some_are_left_out_of_many() {
        let folder = run(MOST_FRAMES + 5, 8, false);
        let unknown = film(&folder);
        assert_eq!((unknown.frames.len(), unknown.in_folder, unknown.size), (MOST_FRAMES, MOST_FRAMES + 5, [8, 8]));
        assert_eq!((unknown.frames[0].name.as_str(), unknown.frames[0].time), ("00000", None));
        scene(folder.path(), MOST_FRAMES + 5);
        let known = film(&folder);
        assert_eq!(known.frames[0].name, format!("{:05}", MOST_FRAMES + 4));
        assert!(known.frames.is_sorted_by(|a, b| a.time < b.time));
        assert!(known.kinds.iter().map(|kind| kind.folder()).eq(["gt", "composed"]));
    }

    #[test]
    fn a_film_keeps_its_budget_whatever_the_images() {
        let folder = run(MOST_FRAMES, 500, true);
        let found = film(&folder);
        let bytes: usize = found.frames.iter().map(FilmFrame::bytes).sum();
        assert!(bytes <= BUDGET && found.frames.len() > 10, "{bytes} bytes, {} frames", found.frames.len());
    }

    #[test]
    fn an_image_that_cannot_be_read_costs_its_place_alone() {
        let folder = run(3, 8, false);
        std::fs::write(folder.path().join("renders/test/gt/00001.png"), "no image").expect("written");
        let found = film(&folder);
        let images: Vec<usize> = found.frames.iter().map(|frame| frame.images.len()).collect();
        assert_eq!(images, [2, 1, 2]);
        let empty = tempfile::tempdir().expect("folder");
        std::fs::write(empty.path().join("config.toml"), "seed = 1\n").expect("written");
        assert!(film(&empty).frames.is_empty());
    }
}
