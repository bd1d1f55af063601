//! Renders a PLY file of 3DGS from one camera.
//!
//! `cargo run -p mvfusion-model --example render_ply -- [scene.ply [picture.png]]`. Without a file, it renders three
//! Gaussians that it writes itself.
#![allow(clippy::print_stdout, reason = "an example shows what it found")]

use std::error::Error;
use std::path::{Path, PathBuf};

use burn::tensor::DType;
use glam::DVec3;
use mvfusion_data::{Camera, read_gaussians};
use mvfusion_model::device;
use mvfusion_model::evaluation::quantise;
use mvfusion_model::initial::{Masking, gaussians_of};
use mvfusion_model::model::gaussians::BackgroundLevels;
use mvfusion_render::splat::{SplatRules, SplatSettings};

/// A row of each Gaussian: centre, colour coefficients, opacity logit, log-scales, quaternion `wxyz`.
const SAMPLE: &str = "ply
format ascii 1.0
element vertex 3
property float x\nproperty float y\nproperty float z
property float f_dc_0\nproperty float f_dc_1\nproperty float f_dc_2
property float opacity
property float scale_0\nproperty float scale_1\nproperty float scale_2
property float rot_0\nproperty float rot_1\nproperty float rot_2\nproperty float rot_3
end_header
-1 0 0   1.7 -1.7 -1.7   3   -1 -2 -1   1 0 0 0
 0 0 1   -1.7 1.7 -1.7   3   -1 -1 -2   1 0 0 0.4
 1 0 0   -1.7 -1.7 1.7   3   -2 -1 -1   1 0 0 0
";

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args_os().skip(1).map(PathBuf::from);
    let folder = tempfile::tempdir()?;
    let path = match arguments.next() {
        Some(path) => path,
        None => {
            let path = folder.path().join("sample.ply");
            std::fs::write(&path, SAMPLE)?;
            path
        }
    };
    let picture = arguments.next().unwrap_or_else(|| folder.path().join("picture.png"));
    render(&path, &picture)
}

fn render(path: &Path, picture: &Path) -> Result<(), Box<dyn Error>> {
    let cloud = read_gaussians(path)?;
    let (least, most) = cloud.bounds().ok_or("the file holds no Gaussian")?;
    let (centre, size) = ((least + most) / 2.0, (most - least).length().max(1.0));

    // A camera before the cloud, looking along +z with y down (OpenCV).
    let eye = centre.as_dvec3() - DVec3::Z * f64::from(size) * 1.5;
    let camera = Camera::centred(320, 240, 300.0, glam::DMat3::IDENTITY, eye);

    let device = device::flex();
    let gaussians = gaussians_of(&cloud, Masking::Absent, cloud.sh_degree, &device, DType::F32);
    let settings = SplatSettings { rules: SplatRules::inria(), sh_degree: cloud.sh_degree, ..SplatSettings::default() };
    let background = BackgroundLevels { grey: 0.0, masks: [0.0; 3] };
    let rendered = gaussians.canonical().splat(None, None, &camera, &settings, background)?;

    let image = quantise(rendered.main().colour.unsqueeze_dim(0))?;
    image.save(picture)?;
    println!("{} Gaussians of degree {} rendered to {}", cloud.len(), cloud.sh_degree, picture.display());
    Ok(())
}
