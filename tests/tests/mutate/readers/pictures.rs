//! Images, masks and videos.

use std::fs;
use std::path::{Path, PathBuf};

use image::{DynamicImage, ImageFormat, Rgb, RgbImage, RgbaImage};
use mvfusion_data::{ExifOrientation, Layout, Picture, PictureFile, PictureSource, ReadOptions, attach_masks, open};

use super::scenes::write_scene;
use super::{Answer, Room, Target, Targets, answer, answer_of, bytes_below};
use crate::mutation::Kind;

/// The readers of this file.
pub const READERS: &[(&str, Targets)] =
    &[("png", png), ("jpeg", jpeg), ("exr", exr), ("masks", masks), ("video", videos)];

/// What decoders may hold: an image of half a gigabyte is refused, and a smaller one may be held in two forms.
const DECODERS: Room = Room { times: 64, fixed: 3 << 29 };

/// Width and height of the images.
const SIZE: (u32, u32) = (24, 18);

/// A tiny video of 60 x 44 pixels.
const VIDEO: &[u8] = include_bytes!("../../../../mvfusion-data/tests-data/bframes.mp4");

fn photo() -> RgbImage {
    RgbImage::from_fn(SIZE.0, SIZE.1, |x, y| Rgb([x, y, x * y].map(|v| (v * 37 % 251) as u8)))
}

fn png(place: &Path) -> Vec<Target> {
    let photo = DynamicImage::ImageRgb8(photo());
    let clear = RgbaImage::from_fn(SIZE.0, SIZE.1, |x, y| image::Rgba([9, 8, x as u8, y as u8]));
    let images = [photo.clone(), DynamicImage::ImageLuma16(photo.to_luma16()), DynamicImage::ImageRgba8(clear)];
    images.iter().enumerate().map(|(number, image)| decoding(saved(place, number, "png", image), Kind::Png)).collect()
}

fn jpeg(place: &Path) -> Vec<Target> {
    let photo = DynamicImage::ImageRgb8(photo());
    let images = [photo.clone(), DynamicImage::ImageLuma8(photo.to_luma8())];
    let target = |(number, image): (usize, &DynamicImage)| {
        // Stored turned by a quarter; the segment turns it back.
        let file = saved(place, number, "jpg", &image.rotate270());
        let bytes = fs::read(&file).expect("read");
        // A big-endian TIFF header and a directory of one entry: the orientation 6.
        let tiff = b"Exif\0\0MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0";
        let segment = [&[0xff, 0xe1][..], &(tiff.len() as u16 + 2).to_be_bytes(), tiff].concat();
        fs::write(&file, [&bytes[..2], &segment, &bytes[2..]].concat()).expect("written");
        decoding(file, Kind::Jpeg)
    };
    images.iter().enumerate().map(target).collect()
}

fn exr(place: &Path) -> Vec<Target> {
    let image = DynamicImage::ImageRgba32F(DynamicImage::ImageRgb8(photo()).to_rgba32f());
    vec![decoding(saved(place, 0, "exr", &image), Kind::Plain)]
}

fn saved(place: &Path, number: usize, extension: &str, image: &DynamicImage) -> PathBuf {
    let file = place.join(format!("{number}.{extension}"));
    let format = ImageFormat::from_extension(extension).expect("a format");
    image.save_with_format(&file, format).expect("written");
    file
}

/// Decoding an image, turned as its metadata ask for.
fn decoding(file: PathBuf, kind: Kind) -> Target {
    let source = PictureSource::Image(file.clone());
    let (width, height, backdrop) = (SIZE.0, SIZE.1, Some([0; 3]));
    let exif = ExifOrientation::Applied;
    let picture = Picture::File(PictureFile { source, width, height, backdrop, lenses: None, exif });
    picture.rgb().expect("a sound file");
    let read = move || {
        answer_of(picture.rgb(), |image| match image.dimensions() == SIZE {
            true => Ok(()),
            false => Err(format!("an image of {:?}", image.dimensions())),
        })
    };
    Target { file, kind, room: DECODERS, others: 0, read: Box::new(read) }
}

/// Masks of what moves, attached to a scene.
fn masks(place: &Path) -> Vec<Target> {
    let folder = place.join("scene");
    write_scene(Layout::Colmap, &folder, (16, 16));
    let scene = open(&folder, &ReadOptions::default()).expect("a sound scene");
    let masks = place.join("masks");
    fs::create_dir(&masks).expect("made");
    let mask = DynamicImage::ImageRgb8(RgbImage::from_fn(16, 16, |x, _| Rgb([if x < 5 { 255 } else { 0 }; 3])));
    let names: Vec<String> = scene.train.iter().map(|view| view.name.clone()).collect();
    let kinds = [("png", Kind::Png, mask.clone()), ("jpg", Kind::Jpeg, DynamicImage::ImageLuma8(mask.to_luma8()))];
    let target = |(name, (extension, kind, mask)): (&String, (&str, Kind, DynamicImage))| {
        let file = masks.join(format!("{name}.{extension}"));
        mask.save(&file).expect("written");
        let (scene, masks) = (scene.clone(), masks.clone());
        let read = move || -> Answer {
            let mut scene = scene.clone();
            attach_masks(&mut scene, &masks).map_err(|error| error.to_string())?;
            let attached = scene.train.iter().filter_map(|view| view.truth.dynamic_mask.as_ref());
            answer(attached.map(|mask| mask.mask()).collect::<Result<Vec<_>, _>>())
        };
        Target { file, kind, room: DECODERS, others: 0, read: Box::new(read) }
    };
    names.iter().zip(kinds).map(target).collect()
}

/// The video of a camera, decoded to its second frame.
fn videos(place: &Path) -> Vec<Target> {
    let folder = place.join("scene");
    write_scene(Layout::Neu3d, &folder, (60, 44));
    fs::remove_dir_all(folder.join("cam00")).expect("removed");
    let file = folder.join("cam00.mp4");
    fs::write(&file, VIDEO).expect("written");
    let others = bytes_below(&folder);
    let read = move || -> Answer {
        let options = ReadOptions { frames: Some(2), ..ReadOptions::default() };
        let scene = open(&folder, &options).map_err(|error| error.to_string())?;
        answer(scene.test.iter().map(|view| view.image.rgb()).collect::<Result<Vec<_>, _>>())
    };
    assert_eq!(read(), Ok(Ok(())), "a sound video");
    vec![Target { file, kind: Kind::Mp4, room: DECODERS, others, read: Box::new(read) }]
}
