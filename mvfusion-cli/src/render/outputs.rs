//! The files of a rendering: one stream per layer and format.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use image::RgbImage;
use mvfusion_model::evaluation::{Layer, LayerRenderer, RenderedLayer};

use super::FileFormat;
use super::exr::{self, LayerPixels};
use super::gif::GifWriter;
use super::mark::Mark;
use super::mp4::Mp4Writer;
use crate::{atomic, run};

/// Folder of the float images.
const EXR: &str = "exr";

/// Files that can be written. Nothing has been written yet.
#[derive(Clone, Debug)]
pub struct OutputsPlan {
    folder: PathBuf,
    layers: Vec<Layer>,
    formats: Vec<FileFormat>,
}

/// Receives frames and writes their files.
pub struct Outputs {
    plan: OutputsPlan,
    size: (u32, u32),
    gifs: Vec<GifWriter>,
    videos: Vec<Mp4Writer>,
    /// Images of an earlier rendering that have not been replaced yet.
    stale: BTreeSet<PathBuf>,
}

impl OutputsPlan {
    /// The files of some layers in a folder.
    pub fn new(folder: &Path, layers: &[Layer], formats: &[FileFormat]) -> Self {
        Self { folder: folder.to_owned(), layers: layers.to_vec(), formats: formats.to_vec() }
    }

    /// Checks that nothing would be overwritten.
    ///
    /// # Errors
    /// If files of the same names exist, or `films.json` is of another program.
    pub fn check_free(&self) -> anyhow::Result<()> {
        Mark::read(&self.folder)?;
        match self.existing()?.first() {
            Some(file) => bail!(
                "{} already exists. Use --force to replace earlier renders, or choose another folder with --out.",
                file.display()
            ),
            None => Ok(()),
        }
    }

    /// Checks that only earlier renders would be overwritten or removed: folders and files that `films.json` names.
    ///
    /// # Errors
    /// If there is another file of such a name, or `films.json` is of another program.
    pub fn check_own(&self) -> anyhow::Result<()> {
        let mark = Mark::read(&self.folder)?;
        match self.existing()?.into_iter().find(|path| !mark.has(path)) {
            Some(file) => bail!(
                "{} was not written by `mvfusion render`, or by a former version of it: {} does not name it. Choose \
                 another folder with --out, or move it away.",
                file.display(),
                mark.path().display()
            ),
            None => Ok(()),
        }
    }

    /// Creates the folders, removes the half-written files of a killed process of this program, and starts the
    /// animations with frames of `size`. Files of an earlier rendering of the same layers stay until they are replaced or
    /// everything has been written.
    ///
    /// # Errors
    /// If the file system refuses.
    pub fn create(self, size: (usize, usize), fps: f64) -> anyhow::Result<Outputs> {
        let size = (u32::try_from(size.0)?, u32::try_from(size.1)?);
        let stale = self.numbered()?;
        for folder in [self.folder.clone()].into_iter().chain(self.folders()) {
            fs::create_dir_all(&folder)
                .and_then(|()| run::remove_files(&folder, atomic::is_unfinished))
                .with_context(|| format!("cannot write to the folder {}", folder.display()))?;
        }
        Mark::read(&self.folder)?.add(self.folders().into_iter().chain(self.animations()))?;
        let gifs = self.files(FileFormat::Gif).into_iter().map(|path| GifWriter::create(&path, size, fps));
        let gifs = gifs.collect::<anyhow::Result<_>>()?;
        let videos = self.files(FileFormat::Mp4).into_iter().map(|path| Mp4Writer::create(&path, size, fps));
        let videos = videos.collect::<anyhow::Result<_>>()?;
        Ok(Outputs { plan: self, size, gifs, videos, stale })
    }

    /// Whether any format needs 8-bit images.
    pub fn has_pictures(&self) -> bool {
        self.formats.iter().any(|format| *format != FileFormat::Exr)
    }

    /// The paths of the files, one line per format.
    pub fn describe(&self) -> Vec<(&'static str, String)> {
        let within = |name: &str| self.folder.join(name).display().to_string();
        let describe = |format: &FileFormat| match format {
            FileFormat::Png => ("png", within("LAYER/NNNNN.png")),
            FileFormat::Exr => ("exr", within("exr/NNNNN.exr")),
            FileFormat::Gif => ("gif", within("LAYER.gif")),
            FileFormat::Mp4 => ("mp4", within("video_LAYER.mp4")),
        };
        self.formats.iter().map(describe).collect()
    }

    fn has(&self, format: FileFormat) -> bool {
        self.formats.contains(&format)
    }

    /// The folders of numbered files.
    fn folders(&self) -> Vec<PathBuf> {
        let layers =
            self.layers.iter().filter(|_| self.has(FileFormat::Png)).map(|layer| self.folder.join(layer.name()));
        layers.chain(self.has(FileFormat::Exr).then(|| self.folder.join(EXR))).collect()
    }

    /// The animations of a format, one per layer.
    fn files(&self, format: FileFormat) -> Vec<PathBuf> {
        let name = |layer: &Layer| match format {
            FileFormat::Gif => Some(format!("{layer}.gif")),
            FileFormat::Mp4 => Some(format!("video_{layer}.mp4")),
            FileFormat::Png | FileFormat::Exr => None,
        };
        let layers = self.layers.iter().filter(|_| self.has(format));
        layers.filter_map(name).map(|name| self.folder.join(name)).collect()
    }

    /// The animations of all formats.
    fn animations(&self) -> impl Iterator<Item = PathBuf> {
        [FileFormat::Gif, FileFormat::Mp4].into_iter().flat_map(|format| self.files(format))
    }

    /// Files of an earlier rendering. Files with other names do not belong to it.
    fn existing(&self) -> anyhow::Result<Vec<PathBuf>> {
        Ok(self.numbered()?.into_iter().chain(self.animations().filter(|path| path.exists())).collect())
    }

    /// The numbered images among them.
    fn numbered(&self) -> anyhow::Result<BTreeSet<PathBuf>> {
        let mut found = BTreeSet::new();
        for folder in self.folders().into_iter().filter(|folder| folder.is_dir()) {
            let context = || format!("cannot list the folder {}", folder.display());
            for entry in fs::read_dir(&folder).with_context(context)? {
                let path = entry.with_context(context)?.path();
                if is_numbered(&path) {
                    found.insert(path);
                }
            }
        }
        Ok(found)
    }
}

impl Outputs {
    /// Writes a frame.
    ///
    /// # Errors
    /// If the device fails, or a file cannot be written.
    pub fn add(
        &mut self,
        number: usize,
        rendered: &[RenderedLayer],
        renderer: &LayerRenderer<'_>,
    ) -> anyhow::Result<()> {
        if self.plan.has(FileFormat::Exr) {
            let pixels = |layer: &RenderedLayer| Ok(LayerPixels { layer: layer.layer, values: layer.pixels()? });
            let layers: Vec<LayerPixels> = rendered.iter().map(pixels).collect::<anyhow::Result<_>>()?;
            let bytes = exr::encode(self.size.0 as usize, self.size.1 as usize, &layers)?;
            let path = self.plan.folder.join(EXR).join(format!("{number:05}.exr"));
            atomic::write_unsynced(&path, &bytes)?;
            self.stale.remove(&path);
        }
        if self.plan.has_pictures() {
            for (place, layer) in rendered.iter().enumerate() {
                self.add_picture(number, place, renderer.picture(layer)?)?;
            }
        }
        Ok(())
    }

    /// Writes the image of the layer at an index of the list.
    fn add_picture(&mut self, number: usize, place: usize, picture: RgbImage) -> anyhow::Result<()> {
        if let Some(gif) = self.gifs.get_mut(place) {
            gif.add(&picture)?;
        }
        if let Some(video) = self.videos.get_mut(place) {
            video.add(&picture)?;
        }
        if self.plan.has(FileFormat::Png) {
            let path = self.plan.folder.join(self.plan.layers[place].name()).join(format!("{number:05}.png"));
            atomic::write_png(&path, picture)?;
            self.stale.remove(&path);
        }
        Ok(())
    }

    /// Ends the animations, and removes images of an earlier rendering that were not replaced.
    ///
    /// # Errors
    /// If an animation cannot be written, or the file system refuses.
    pub fn finish(self) -> anyhow::Result<OutputsPlan> {
        self.gifs.into_iter().try_for_each(GifWriter::finish)?;
        self.videos.into_iter().try_for_each(Mp4Writer::finish)?;
        for file in &self.stale {
            fs::remove_file(file).with_context(|| format!("cannot remove {}", file.display()))?;
        }
        Ok(self.plan)
    }
}

/// Whether a file has a name such as 00012.png.
fn is_numbered(path: &Path) -> bool {
    let is = |part: Option<&std::ffi::OsStr>, test: &dyn Fn(&str) -> bool| {
        part.and_then(|part| part.to_str()).is_some_and(test)
    };
    is(path.extension(), &|ending| ending == "png" || ending == EXR)
        && is(path.file_stem(), &|stem| stem.len() >= 5 && stem.bytes().all(|byte| byte.is_ascii_digit()))
}

#[cfg(test)]
mod tests {
    use super::super::mark::MARK;
    use super::*;

    /// What stands in the files of an earlier rendering.
    const OLD: &[u8] = b"old";

    fn plan(folder: &Path) -> OutputsPlan {
        OutputsPlan::new(folder, &[Layer::Mask], &[FileFormat::Png, FileFormat::Gif])
    }

    /// Writes files of an earlier rendering.
    fn write(folder: &Path, names: &[&str]) {
        for path in names.iter().map(|name| folder.join(name)) {
            fs::create_dir_all(path.parent().expect("a folder")).expect("made");
            fs::write(path, OLD).expect("written");
        }
    }

    #[test]
    fn what_was_rendered_before_is_found_and_what_others_put_there_is_left_alone() {
        let folder = tempfile::tempdir().expect("folder");
        let plan = plan(folder.path());
        plan.check_free().expect("nothing is there");
        write(folder.path(), &["mask/notes.png", "mask/1.png", "composed/00000.png", "composed.gif"]);
        plan.check_free().expect("nothing of this rendering is there");
        write(folder.path(), &["mask/00007.png", "mask.gif"]);
        let error = plan.check_free().expect_err("refused").to_string();
        assert!(error.contains("00007.png") && error.contains("--force") && error.contains("--out"), "{error}");
    }

    #[test]
    fn images_that_were_not_rendered_are_not_replaced() {
        let folder = tempfile::tempdir().expect("folder");
        write(folder.path(), &["mask/00007.png"]);
        let error = plan(folder.path()).check_own().expect_err("masks of a data set").to_string();
        assert!(error.contains("00007.png") && error.contains(MARK) && error.contains("--out"), "{error}");

        let folder = tempfile::tempdir().expect("folder");
        let mut outputs = plan(folder.path()).create((16, 16), 30.0).expect("made");
        outputs.add_picture(0, 0, RgbImage::new(16, 16)).expect("added");
        drop(outputs);
        plan(folder.path()).check_own().expect("ours, although it was not finished");
        write(folder.path(), &["depth/00000.png"]);
        let others = OutputsPlan::new(folder.path(), &[Layer::Mask, Layer::Depth], &[FileFormat::Png]);
        assert!(others.check_own().expect_err("refused").to_string().contains("depth"));

        fs::write(folder.path().join(MARK), "{}").expect("written");
        for refused in [plan(folder.path()).check_own(), plan(folder.path()).check_free()] {
            assert!(refused.expect_err("of another program").to_string().contains("no list of renders"));
        }
    }

    #[test]
    fn half_written_files_are_removed_if_they_are_ours() {
        let folder = tempfile::tempdir().expect("folder");
        let (ours, others) = (["mask/.mvfusion-x7Gh1s.part", ".mvfusion-x7Gh1s.part"], [".film.part", "mask/.a.part"]);
        write(folder.path(), &[ours, others].concat());
        drop(plan(folder.path()).create((16, 16), 30.0).expect("made"));
        let is_there = |name: &str| folder.path().join(name).exists();
        assert_eq!((ours.map(is_there), others.map(is_there)), ([false; 2], [true; 2]));
    }

    #[test]
    fn old_files_stay_until_the_new_ones_are_whole() {
        let folder = tempfile::tempdir().expect("folder");
        let others = ["mask/notes.png", "composed/00001.png", "composed.gif"];
        let ours = ["mask/00000.png", "mask/00001.png", "mask.gif"];
        write(folder.path(), &[others, ours].concat());
        let is_old = |name: &&str| fs::read(folder.path().join(name)).is_ok_and(|bytes| bytes == OLD);

        let mut outputs = plan(folder.path()).create((16, 16), 30.0).expect("made");
        outputs.add_picture(0, 0, RgbImage::new(16, 16)).expect("added");
        drop(outputs);
        assert_eq!(ours.each_ref().map(is_old), [false, true, true], "a rendering that failed");

        let mut outputs = plan(folder.path()).create((16, 16), 30.0).expect("made");
        outputs.add_picture(0, 0, RgbImage::new(16, 16)).expect("added");
        assert!(is_old(&"mask/00001.png"), "it goes last");
        outputs.finish().expect("finished");
        let there = ours.map(|name| folder.path().join(name).exists());
        assert_eq!(there, [true, false, true], "a film of one frame");
        assert!(!ours.iter().any(is_old) && others.iter().all(is_old));
    }
}
