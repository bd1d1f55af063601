//! Images and points as a COLMAP model stores them.

use glam::Vec3;

use crate::scene::{PointCloud, check_place};

/// An image as the file stores it.
#[derive(Clone, Debug)]
pub(crate) struct ImageRecord {
    pub(super) name: String,
    /// Number of its camera.
    pub(super) camera: u32,
    /// w, x, y, z. Rotates from the world to the camera.
    pub(super) quaternion: [f64; 4],
    /// From the world to the camera, in world units.
    pub(super) translation: [f64; 3],
}

/// Adds a point with 8 bits per colour channel.
pub(super) fn push_point(points: &mut PointCloud, position: [f64; 3], colour: [u8; 3]) -> Result<(), String> {
    let narrow = Vec3::from_array(position.map(|v| v as f32));
    check_place(narrow).map_err(|reason| format!("point {} (from 0) {reason}", points.len()))?;
    points.push(narrow, Vec3::from_array(colour.map(|v| f32::from(v) / 255.0)));
    Ok(())
}
