//! The observations of a COLMAP model: where each photo shows each point. The readers have no use for them.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use anyhow::{Context, Result, ensure};
use glam::{DVec2, DVec3};
use mvfusion_data::Scene;

/// Distances in pixels between the points of a binary model, projected by the cameras of the scene, and where they were
/// seen.
pub fn distances(model: &Path, scene: &Scene) -> Result<Vec<f64>> {
    let points = points(&fs::read(model.join("points3D.bin"))?)?;
    let bytes = fs::read(model.join("images.bin"))?;
    let mut reader = Reader(&bytes);
    let mut distances = Vec::new();
    for _ in 0..reader.count()? {
        // Number of the image, pose, number of the camera.
        reader.skip(4 + 7 * 8 + 4)?;
        let name = reader.text()?;
        let name = Path::new(&name).with_extension("").to_string_lossy().into_owned();
        let view = scene.train.iter().chain(&scene.test).find(|view| view.name == name);
        for _ in 0..reader.count()? {
            let seen = DVec2::new(reader.number()?, reader.number()?);
            let point = reader.count()?;
            let (Some(view), Some(place)) = (view, points.get(&point)) else { continue };
            let projected = view.camera.project(*place).context("a point that was seen is in front")?;
            distances.push(projected.distance(seen));
        }
    }
    ensure!(reader.0.is_empty(), "the file goes on");
    Ok(distances)
}

fn points(bytes: &[u8]) -> Result<BTreeMap<u64, DVec3>> {
    let mut reader = Reader(bytes);
    let mut points = BTreeMap::new();
    for _ in 0..reader.count()? {
        let id = reader.count()?;
        points.insert(id, DVec3::new(reader.number()?, reader.number()?, reader.number()?));
        // Colour, error, track.
        reader.skip(3 + 8)?;
        let track = reader.count()?;
        reader.skip(8 * track as usize)?;
    }
    Ok(points)
}

/// Little-endian numbers, one after the other.
struct Reader<'a>(&'a [u8]);

impl Reader<'_> {
    fn take<const N: usize>(&mut self) -> Result<[u8; N]> {
        let (taken, rest) = self.0.split_first_chunk().context("the file ends early")?;
        self.0 = rest;
        Ok(*taken)
    }

    fn skip(&mut self, bytes: usize) -> Result<()> {
        self.0 = self.0.get(bytes..).context("the file ends early")?;
        Ok(())
    }

    fn count(&mut self) -> Result<u64> {
        Ok(u64::from_le_bytes(self.take()?))
    }

    fn number(&mut self) -> Result<f64> {
        Ok(f64::from_le_bytes(self.take()?))
    }

    fn text(&mut self) -> Result<String> {
        let length = self.0.iter().position(|&byte| byte == 0).context("a name has no end")?;
        let text = String::from_utf8(self.0[..length].to_vec())?;
        self.skip(length + 1)?;
        Ok(text)
    }
}
