//! `undistort`: where a straightened picture takes its pixels from, and what the reader makes of such cameras.

use std::fmt::Write;
use std::fs;
use std::path::Path;

use anyhow::{Result, ensure};
use burn::tensor::Device;
use glam::DVec2;
use image::RgbImage;
use mvfusion_data::{Distortion, Lens, ReadOptions, Scene, View, open};
use mvfusion_tests::{Array, Checklist, Tolerance};

use crate::archive::Archive;

/// Of maps, pixels; from the README of the oracle.
const MAPS: Tolerance = Tolerance::absolute(1e-3);

/// Of poses and times.
const EXACT: Tolerance = Tolerance::absolute(1e-9);

/// OpenCV looks at 9 x 9 points and counts pixel centres as borders; ours looks at every pixel edge. Their pinholes differ by
/// this share.
const PINHOLE: f64 = 0.01;

/// Outputs that are not compared.
pub const LEFT_OUT: &[(&str, &str)] = &[
    ("out.cv46.", "an OpenCV whose rule counted pixel edges on two sides alone; the later one is compared"),
    ("image_undistorted", "OpenCV's is bilinear in steps of 1/32 pixel, ours cubic; the map is compared"),
    ("roi_xywh", "ours keeps the size"),
    ("width", "ours keeps the size"),
    ("height", "ours keeps the size"),
    ("FoV", "follows from focal length and size"),
];

/// The lens and the cameras of a file. It knows no device.
pub fn check(archive: &Archive, _device: &Device) -> Result<()> {
    let mut checks = Checklist::default();
    let bent = lens_of(archive.array("out.K")?, distortion(archive)?);
    let pinhole = lens_of(archive.array("out.cv410.K_new")?, Distortion::NONE);
    compare_maps(&mut checks, archive, &bent, &pinhole)?;

    let folder = tempfile::tempdir()?;
    let names = names(archive.array("in.names_ascii")?);
    let scene = read_back(folder.path(), archive, &names)?;
    for (index, name) in names.iter().enumerate() {
        let Some(view) = view_of(&scene, name) else {
            ensure!(name.contains("clean"), "{name} is neither trained on nor held out");
            continue;
        };
        let part = |array: &Array, each: usize| array.values[each * index..each * (index + 1)].to_vec();
        // Theirs leads from the camera to the world, row by row: the columns of ours.
        let rotation = view.camera.rotation.to_cols_array().to_vec();
        let [r, t] = [archive.array("out.R")?, archive.array("out.T")?];
        checks.close(format!("{name} R"), &Array::new([9], part(r, 9)), &Array::new([9], rotation), EXACT);
        let translation = view.camera.translation.to_array().to_vec();
        checks.close(format!("{name} T"), &Array::new([3], part(t, 3)), &Array::new([3], translation), EXACT);
        checks.close_number(format!("{name} time"), archive.array("out.time")?.values[index], view.time, EXACT);
        compare_pinhole(view, &pinhole)?;
    }
    checks.finish()
}

/// The lens of a matrix, with principal points as OpenCV counts them: the first pixel's centre is 0.
fn lens_of(matrix: &Array, distortion: Distortion) -> Lens {
    let k = &matrix.values;
    Lens { focal: DVec2::new(k[0], k[4]), principal: DVec2::new(k[2], k[5]), distortion }
}

fn distortion(archive: &Archive) -> Result<Distortion> {
    let [k1, k2, p1, p2] = std::array::from_fn(|i| archive.array("in.params").map(|params| params.values[4 + i]));
    Ok(Distortion::opencv([k1?, k2?, 0.0, 0.0, 0.0, 0.0], [p1?, p2?]))
}

/// Where each pixel of the straightened picture comes from.
fn compare_maps(checks: &mut Checklist, archive: &Archive, bent: &Lens, pinhole: &Lens) -> Result<()> {
    let wanted = [archive.array("out.cv410.map_x")?, archive.array("out.cv410.map_y")?];
    let [height, width] = wanted[0].shape[..] else { anyhow::bail!("a map has two axes") };
    let pixels = (0..height * width).map(|at| DVec2::new((at % width) as f64, (at / width) as f64));
    let sources: Option<Vec<DVec2>> =
        pixels.map(|pixel| pinhole.direction_of(pixel).map(|direction| bent.pixel_of(direction))).collect();
    let sources = sources.ok_or_else(|| anyhow::anyhow!("a pinhole has a direction for every pixel"))?;
    for (name, wanted, axis) in [("map_x", wanted[0], 0), ("map_y", wanted[1], 1)] {
        let found = Array::new([height, width], sources.iter().map(|source| source[axis]).collect());
        checks.close(name, wanted, &found, MAPS);
    }
    Ok(())
}

/// The scene as a photo collection on disk, read back.
fn read_back(folder: &Path, archive: &Archive, names: &[String]) -> Result<Scene> {
    let model = folder.join("sparse/0");
    fs::create_dir_all(&model)?;
    fs::create_dir_all(folder.join("images"))?;
    let [height, width, _] = archive.array("in.image_small")?.shape[..] else {
        anyhow::bail!("a picture has three axes")
    };
    for name in names {
        RgbImage::new(width as u32, height as u32).save(folder.join("images").join(name))?;
    }
    let [full_width, full_height] = [0, 1].map(|axis| archive.array("in.full_size").map(|size| size.values[axis]));
    let (full_width, full_height) = (full_width?, full_height?);
    let params = &archive.array("in.params")?.values;
    // DeGauss ignores the principal point, and takes the middle for pixel centres at 0: ours at 0.5 are half a pixel on.
    let middle = |full: f64, small: usize| full * (0.5 + 0.5 / small as f64);
    let (cx, cy) = (middle(full_width, width), middle(full_height, height));
    let rest = params[4..].iter().map(|k| format!(" {k}")).collect::<String>();
    let camera = format!("1 OPENCV {full_width} {full_height} {} {} {cx} {cy}{rest}\n", params[0], params[1]);
    fs::write(model.join("cameras.txt"), camera)?;
    let mut images = String::new();
    for (index, name) in names.iter().enumerate() {
        let q = &archive.array("in.qvec")?.values[4 * index..4 * index + 4];
        let t = &archive.array("in.tvec")?.values[3 * index..3 * index + 3];
        let pose = q.iter().chain(t).map(|v| format!("{v} ")).collect::<String>();
        writeln!(images, "{} {pose}1 {name}\n", index + 1)?;
    }
    fs::write(model.join("images.txt"), images)?;
    fs::write(model.join("points3D.txt"), "")?;
    Ok(open(folder, &ReadOptions::default())?)
}

fn view_of<'a>(scene: &'a Scene, name: &str) -> Option<&'a View> {
    let name = name.trim_end_matches(".png");
    scene.train.iter().chain(&scene.test).find(|view| view.name == name)
}

/// The pinhole of the reader is nearly that of OpenCV.
fn compare_pinhole(view: &View, theirs: &Lens) -> Result<()> {
    let camera = &view.camera;
    let off = [
        camera.fx / theirs.focal.x - 1.0,
        camera.fy / theirs.focal.y - 1.0,
        (camera.cx - 0.5 - theirs.principal.x) / camera.width as f64,
        (camera.cy - 0.5 - theirs.principal.y) / camera.height as f64,
    ];
    ensure!(off.iter().all(|off| off.abs() < PINHOLE), "{}: the pinhole is off by {off:?}", view.name);
    Ok(())
}

/// The names, codes padded with zeros.
fn names(codes: &Array) -> Vec<String> {
    let [_, length] = codes.shape[..] else { return Vec::new() };
    let name = |row: &[f64]| row.iter().filter(|code| **code > 0.0).map(|code| *code as u8 as char).collect();
    codes.values.chunks_exact(length).map(name).collect()
}
