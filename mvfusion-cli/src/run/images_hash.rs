//! A quick hash of the images of a training, by which a resumed run notices another scene.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{self, Read, Seek, SeekFrom};
use std::path::Path;

use anyhow::Context;
use mvfusion_data::files::open_file;
use mvfusion_data::{Picture, PictureSource, View};
use mvfusion_model::files::sha256;
use rayon::prelude::*;

/// Bytes that are read at either end of a file.
const END: u64 = 4096;

/// SHA-256 of what tells the images of some views, and their masks of valid pixels, from others. No image is decoded.
///
/// It covers the number and order of the views; the size of each image in pixels; the length of its file, and the
/// first and last 4096 bytes; and of a video the index of the frame. A PNG ends with a checksum of all its pixels.
/// In other formats, a change in the middle of a file that keeps its length goes unnoticed. Names and paths do not
/// count, so a scene may move. Images in memory are those of a built-in scene, which the configuration determines: of
/// them, only the size counts.
///
/// # Errors
/// If a file cannot be read.
pub fn images_hash(views: &[View]) -> anyhow::Result<String> {
    let masks = views.iter().filter_map(|view| view.mask.as_ref()).map(|mask| &mask.picture);
    let paths: BTreeSet<&Path> =
        views.iter().map(|view| &view.image).chain(masks).filter_map(source).map(PictureSource::path).collect();
    let files = paths.into_par_iter().map(|path| {
        let hash = file_hash(path).with_context(|| format!("cannot read the image {}", path.display()))?;
        Ok((path, hash))
    });
    let files = files.collect::<anyhow::Result<BTreeMap<&Path, String>>>()?;
    let mut text = String::new();
    for view in views {
        text.push_str(&line(&view.image, &files));
        if let Some(mask) = &view.mask {
            text.push_str(&format!("mask {} {}", mask.inverted, line(&mask.picture, &files)));
        }
    }
    Ok(sha256(text.as_bytes()))
}

/// Where an image lies; `None` in memory.
fn source(picture: &Picture) -> Option<&PictureSource> {
    match picture {
        Picture::Memory(_) => None,
        Picture::File(file) => Some(&file.source),
    }
}

/// An image in a line: its size and its file.
fn line(picture: &Picture, files: &BTreeMap<&Path, String>) -> String {
    let (width, height) = picture.size();
    let file = source(picture).map_or("in memory".to_owned(), |source| {
        let file = files.get(source.path()).map_or("", String::as_str);
        match source {
            PictureSource::Image(_) => file.to_owned(),
            PictureSource::Frame { index, .. } => format!("{file} {index}"),
        }
    });
    format!("{width}x{height} {file}\n")
}

/// SHA-256 of the length and both ends of a file.
fn file_hash(path: &Path) -> io::Result<String> {
    let mut file = open_file(path)?;
    let length = file.metadata()?.len();
    let mut bytes = length.to_le_bytes().to_vec();
    (&mut file).take(END).read_to_end(&mut bytes)?;
    file.seek(SeekFrom::Start(length.saturating_sub(END)))?;
    file.take(END).read_to_end(&mut bytes)?;
    Ok(sha256(&bytes))
}

#[cfg(test)]
mod tests {
    use std::fs;

    use mvfusion_data::{BuiltinOptions, Mask, builtin};

    use super::*;

    const SIZE: (u32, u32) = (64, 48);

    /// A view for each file of a folder.
    fn views(folder: &Path, files: [&str; 2]) -> Vec<View> {
        let scene = builtin::builtin(&BuiltinOptions { width: 16, height: 16, frames: 2, ..Default::default() });
        let in_folder = |(view, name): (View, &str)| View { image: Picture::file(folder.join(name), SIZE), ..view };
        scene.test.into_iter().zip(files).map(in_folder).collect()
    }

    fn hash(views: &[View]) -> String {
        images_hash(views).expect("read")
    }

    #[test]
    fn a_moved_scene_is_the_same_and_other_bytes_or_another_order_are_not() {
        let [old, new] = [0; 2].map(|_| tempfile::tempdir().expect("folder"));
        let long = vec![7; 3 * END as usize];
        for folder in [&old, &new] {
            fs::write(folder.path().join("a"), &long).expect("written");
            fs::write(folder.path().join("b"), "short").expect("written");
        }
        let own = hash(&views(old.path(), ["a", "b"]));
        assert_eq!(own, hash(&views(new.path(), ["a", "b"])));
        assert_ne!(own, hash(&views(new.path(), ["b", "a"])));
        for place in [0, long.len() - 1] {
            let mut other = long.clone();
            other[place] = 8;
            fs::write(new.path().join("a"), other).expect("written");
            assert_ne!(own, hash(&views(new.path(), ["a", "b"])), "{place}");
        }
        fs::write(new.path().join("a"), &long[1..]).expect("written");
        assert_ne!(own, hash(&views(new.path(), ["a", "b"])), "a shorter file");
        let error = images_hash(&views(new.path(), ["a", "absent"])).expect_err("no file");
        assert!(format!("{error:#}").contains("absent"), "{error:#}");
    }

    #[test]
    fn masks_of_valid_pixels_count() {
        let folder = tempfile::tempdir().expect("folder");
        for name in ["a", "b", "mask"] {
            fs::write(folder.path().join(name), name).expect("written");
        }
        let with_mask = |inverted| {
            let mut views = views(folder.path(), ["a", "b"]);
            views[0].mask = Some(Mask { picture: Picture::file(folder.path().join("mask"), SIZE), inverted });
            hash(&views)
        };
        assert_ne!(with_mask(false), hash(&views(folder.path(), ["a", "b"])));
        assert_ne!(with_mask(false), with_mask(true));
    }
}
