//! A camera at one moment: its projection and its motion map.

use glam::{DMat3, DVec2, DVec3, Vec3};

use super::film::MotionFilm;
use super::moving_pixels::MotionMap;
use super::rig::{Moment, Shot};
use crate::scene::Camera;

/// A camera's view of a moment.
#[derive(Clone, Debug)]
pub(super) struct Eye<'a> {
    /// From the world to homogeneous pixels: `pixels * x + offset`.
    pixels: DMat3,
    offset: DVec3,
    /// From homogeneous pixel positions to world directions of depth 1.
    directions: DMat3,
    pub centre: DVec3,
    pub map: &'a MotionMap,
    colours: &'a [u8],
    /// Depths between which its rays search for places, world units.
    pub reach: [f64; 2],
}

impl<'a> Eye<'a> {
    /// The eyes of a moment. `reaches` belong to the rig's cameras.
    pub fn of_moment(film: &'a MotionFilm, moment: &Moment, reaches: &[[f64; 2]]) -> Vec<Self> {
        moment.shots.iter().filter_map(|shot| Self::of_shot(film, shot, reaches)).collect()
    }

    /// The eye of a shot; `None` if the film keeps no images.
    pub fn of_shot(film: &'a MotionFilm, shot: &Shot, reaches: &[[f64; 2]]) -> Option<Self> {
        let (map, colours) = film.picture(shot.view)?;
        Some(Self::new(&film.rig.cameras[shot.camera].camera, map, colours, reaches[shot.camera]))
    }

    fn new(camera: &Camera, map: &'a MotionMap, colours: &'a [u8], reach: [f64; 2]) -> Self {
        let lens = DMat3::from_cols(
            DVec3::new(camera.fx, 0.0, 0.0),
            DVec3::new(0.0, camera.fy, 0.0),
            DVec3::new(camera.cx, camera.cy, 1.0),
        );
        Self {
            pixels: lens * camera.rotation,
            offset: lens * camera.translation,
            directions: camera.rotation.transpose() * lens.inverse(),
            centre: camera.centre(),
            map,
            colours,
            reach,
        }
    }

    /// The block at the projection of a place. `None` if it is outside the image, or the block is invalid.
    #[inline]
    pub fn block(&self, place: DVec3) -> Option<usize> {
        let p = self.pixels * place + self.offset;
        if p.z <= 0.0 {
            return None;
        }
        let index = self.map.index(DVec2::new(p.x, p.y) / p.z)?;
        self.map.blocks()[index].counts().then_some(index)
    }

    /// The direction, of depth 1, through a position in pixels.
    pub fn direction(&self, position: DVec2) -> DVec3 {
        self.directions * position.extend(1.0)
    }

    /// Colour of a block in 8-bit levels.
    pub fn colour(&self, block: usize) -> Vec3 {
        let levels = &self.colours[3 * block..3 * block + 3];
        Vec3::new(f32::from(levels[0]), f32::from(levels[1]), f32::from(levels[2]))
    }
}
