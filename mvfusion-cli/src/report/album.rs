//! The images that the report of a run shows: their views, kinds and sizes.

use std::path::Path;

use mvfusion_model::evaluation::Layer;
use mvfusion_model::timeline;
use rayon::prelude::*;

use super::files::{Found, Missing, RunFiles};
use super::picture::{Embedded, embed};
use crate::run::{self, PictureKind};

/// Maximum number of views.
const MOST_VIEWS: usize = 12;

/// Number of views if the run has no strips.
const VIEWS: usize = 6;

/// Maximum widths of the images, largest first. The first width that keeps the page below [`BUDGET`] is used, otherwise
/// the last resort.
const WIDTHS: [u32; 3] = [960, 640, 480];
const LAST_RESORT: u32 = 320;

/// Maximum size of all images in the page, in bytes.
const BUDGET: usize = 14_000_000;

/// Factor by which a strip may be wider than an image, because it has several panels.
const STRIP: u32 = 2;

/// An image of a view.
#[derive(Debug)]
pub(super) struct ViewPicture {
    /// Its contents.
    pub kind: PictureKind,
    /// The image.
    pub picture: Found<Embedded>,
}

/// A view.
#[derive(Debug)]
pub(super) struct AlbumView {
    /// Its index in the album, which is part of the ids of its images.
    pub number: usize,
    /// Its name.
    pub name: String,
    /// Ground truth and layers that the run has.
    pub images: Vec<ViewPicture>,
    /// Heat maps that the run has.
    pub heat_maps: Vec<ViewPicture>,
}

/// All images of the report.
#[derive(Debug)]
pub(super) struct Album {
    /// The views.
    pub views: Vec<AlbumView>,
    /// Strips with the names of their views, if there are no layers.
    pub strips: Vec<(String, Found<Embedded>)>,
    /// Maximum width of the images.
    pub widest: u32,
    /// Number of views with images in the folder.
    pub in_folder: usize,
}

impl Album {
    /// Chooses and reads the images: every layer of the views that have a strip, or the strips if there are no layers.
    pub fn read(files: &RunFiles) -> Self {
        let mut albums = WIDTHS.into_iter().map(|widest| Self::at(files, widest));
        let fitting = albums.find(|album| album.bytes() <= BUDGET);
        fitting.unwrap_or_else(|| Self::at(files, LAST_RESORT))
    }

    fn at(files: &RunFiles, widest: u32) -> Self {
        let renders = files.folder.join(run::RENDERS).join("test");
        let (strips, rendered) = (names(&files.folder.join(run::STRIPS)), names(&renders.join(Layer::Composed.name())));
        let in_folder = rendered.len().max(strips.len());
        let with_layers: Vec<String> = strips.iter().filter(|name| rendered.contains(name)).cloned().collect();
        let chosen = match with_layers.is_empty() {
            true => spread(rendered, VIEWS),
            false => spread(with_layers, MOST_VIEWS),
        };
        let views: Vec<AlbumView> =
            chosen.iter().enumerate().map(|(number, name)| view(files, &renders, number, name, widest)).collect();
        let strips = if views.is_empty() { read_strips(files, spread(strips, MOST_VIEWS), widest) } else { Vec::new() };
        Self { views, strips, widest, in_folder }
    }

    fn bytes(&self) -> usize {
        let of_views = self.views.iter().flat_map(|view| view.images.iter().chain(&view.heat_maps));
        let pictures = of_views.map(|shown| &shown.picture).chain(self.strips.iter().map(|(_, strip)| strip));
        pictures.flatten().map(|picture| picture.uri.len()).sum()
    }
}

/// The PNG files of a folder, by name; none if it cannot be listed.
pub(super) fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let names = entries.filter_map(|entry| entry.file_name().into_string().ok());
    let mut names: Vec<String> = names.filter(|name| name.ends_with(".png")).collect();
    names.sort();
    names
}

fn spread(names: Vec<String>, most: usize) -> Vec<String> {
    timeline::spread(names.len(), most).into_iter().map(|index| names[index].clone()).collect()
}

fn view(files: &RunFiles, renders: &Path, number: usize, file: &str, widest: u32) -> AlbumView {
    let read = |kinds: &[PictureKind]| -> Vec<ViewPicture> {
        // A kind without any image is not missing. For example, a model with one branch has no mask.
        let is_present = |kind: &PictureKind| renders.join(kind.folder()).is_dir();
        let present: Vec<PictureKind> = kinds.iter().copied().filter(is_present).collect();
        let picture = |kind: PictureKind| {
            let name = format!("{}/test/{}/{file}", run::RENDERS, kind.folder());
            ViewPicture { kind, picture: embed(&renders.join(kind.folder()).join(file), &name, widest) }
        };
        present.into_par_iter().map(picture).collect()
    };
    let (images, heat_maps) = (read(&PictureKind::IMAGES), read(&PictureKind::HEAT_MAPS));
    AlbumView { number, name: view_name(files, file), images, heat_maps }
}

fn read_strips(files: &RunFiles, strips: Vec<String>, widest: u32) -> Vec<(String, Found<Embedded>)> {
    let folder = files.folder.join(run::STRIPS);
    let strip = |file: String| {
        let picture = embed(&folder.join(&file), &format!("{}/{file}", run::STRIPS), STRIP * widest);
        (view_name(files, &file), picture)
    };
    strips.into_par_iter().map(strip).collect()
}

/// The name of the view whose images have this file name.
pub(super) fn view_name(files: &RunFiles, file: &str) -> String {
    let known = files.per_view.as_ref().ok().and_then(|per_view| per_view.test.get(file));
    known.map_or_else(|| file.trim_end_matches(".png").to_owned(), |view| view.view.clone())
}

/// Why there are no sliders, for a run whose evaluation wrote no layers.
pub(super) fn without_layers(files: &RunFiles) -> Missing {
    let unwanted = files.config.as_ref().is_ok_and(|config| !config.eval.pictures);
    Missing::new(match unwanted {
        true => "The run was evaluated with eval.pictures=false, so it has no layers to compare.",
        false => "The run has no images of its layers (renders/test). `mvfusion eval RUN --write` writes them.",
    })
}

#[cfg(test)]
mod tests {
    use image::{Rgb, RgbImage};

    use super::*;

    /// A run's folder with pictures of these layers, and strips, of this many views.
    fn run(layers: &[&str], views: usize, strips: &[usize]) -> (tempfile::TempDir, RunFiles) {
        let folder = tempfile::tempdir().expect("folder");
        let save = |path: std::path::PathBuf| {
            std::fs::create_dir_all(path.parent().expect("a folder")).expect("made");
            RgbImage::from_pixel(8, 6, Rgb([90, 20, 10])).save(path).expect("saved");
        };
        for layer in layers {
            (0..views).for_each(|k| save(folder.path().join(format!("renders/test/{layer}/{k:05}.png"))));
        }
        strips.iter().for_each(|k| save(folder.path().join(format!("strips/{k:05}.png"))));
        std::fs::write(folder.path().join("config.toml"), "[eval]\npictures = false\n").expect("written");
        let files = RunFiles::read(folder.path()).expect("read");
        (folder, files)
    }

    #[test]
    fn views_with_a_strip_are_shown_in_all_their_layers() {
        let (folder, files) = run(&["gt", "composed", "motion"], 9, &[2, 7]);
        std::fs::remove_file(folder.path().join("renders/test/gt/00007.png")).expect("removed");
        let album = Album::read(&files);
        let names: Vec<&str> = album.views.iter().map(|view| view.name.as_str()).collect();
        assert_eq!((names, album.in_folder, album.widest), (vec!["00002", "00007"], 9, 960));
        assert!(album.strips.is_empty());
        let folders = |view: &AlbumView| view.images.iter().map(|shown| shown.kind.folder()).collect::<Vec<_>>();
        assert_eq!(folders(&album.views[0]), ["gt", "composed"]);
        assert_eq!(album.views[0].heat_maps.len(), 1);
        let gone = album.views[1].images[0].picture.as_ref().expect_err("a lack");
        assert_eq!(gone.to_string(), "The file renders/test/gt/00007.png is missing.");
    }

    #[test]
    fn without_strips_some_views_are_shown_and_without_layers_the_strips() {
        let (_folder, files) = run(&["composed"], 30, &[]);
        assert_eq!(Album::read(&files).views.len(), VIEWS);
        let (_folder, files) = run(&[], 0, &[0, 1, 2]);
        let album = Album::read(&files);
        assert_eq!((album.views.len(), album.strips.len()), (0, 3));
        assert!(without_layers(&files).to_string().contains("eval.pictures=false"));
        let (_folder, files) = run(&["composed"], 40, &(0..40).collect::<Vec<_>>());
        assert_eq!(Album::read(&files).views.len(), MOST_VIEWS);
    }
}
