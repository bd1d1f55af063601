//! Visibility of the points in the cameras, and the agreement of their colours with the photos.

use glam::{DMat3, DVec2, DVec3, Vec3};
use image::RgbImage;

use super::origin::PointsOrigin;
use super::problem::median;
use super::rig::spread;
use crate::scene::{Camera, PointCloud};

/// Maximum number of points to project. More points change the fractions by less than a percent.
const POINTS: usize = 2000;
/// Number of points that must be in a photo for a comparison of colours.
const ENOUGH: usize = 30;
/// Standard deviation of colours in `[0, 1]` below which they are too uniform to compare.
const ALIKE: f64 = 0.02;

/// The points, or an evenly spaced sample of them.
pub(super) struct Cloud {
    positions: Vec<DVec3>,
    /// Empty if colours are meaningless.
    colours: Vec<Vec3>,
}

impl Cloud {
    pub(super) fn of(points: &PointCloud, origin: PointsOrigin) -> Self {
        let chosen = spread(points.len(), POINTS);
        let positions = chosen.iter().map(|&i| points.positions[i].as_dvec3()).collect();
        let colours = match origin {
            PointsOrigin::Measured => chosen.iter().map(|&i| points.colours[i]).collect(),
            PointsOrigin::Random => Vec::new(),
        };
        Self { positions, colours }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    pub(super) fn positions(&self) -> &[DVec3] {
        &self.positions
    }
}

/// A view that represents its camera.
pub(super) struct Witness<'a> {
    pub(super) camera: &'a Camera,
    /// Name of the view.
    pub(super) name: &'a str,
    /// Its photo, downscaled; absent if photos are not decoded or this one cannot be decoded.
    pub(super) picture: Option<&'a RgbImage>,
}

/// A change of all cameras that undoes a possible mistake.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Warp {
    /// Applied to camera coordinates. It may be a reflection.
    pub(super) axes: DMat3,
    /// Whether the pose is inverted.
    pub(super) inverted: bool,
    /// Applied to the points.
    pub(super) world: DMat3,
    /// Factor of the cameras' distances from the origin.
    pub(super) scale: f64,
}

impl Warp {
    pub(super) const NONE: Self = Self { axes: DMat3::IDENTITY, inverted: false, world: DMat3::IDENTITY, scale: 1.0 };

    pub(super) fn of(&self, camera: &Camera) -> Camera {
        let (rotation, translation) = match self.inverted {
            false => (camera.rotation, camera.translation),
            true => (camera.rotation.transpose(), camera.centre()),
        };
        let (rotation, translation) = (self.axes * rotation * self.world, self.scale * (self.axes * translation));
        Camera { rotation, translation, ..*camera }
    }
}

/// The agreement of points and photos.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Fit {
    /// Fraction of the points within a camera's image, as the median over the cameras.
    pub(super) seen: f64,
    /// Correlation of the points' colours with the pixels at their projections, as the median over the photos.
    pub(super) agreement: Option<f64>,
}

/// The fit of points, cameras and photos after a warp; `None` without points or cameras.
pub(super) fn fit(cloud: &Cloud, witnesses: &[Witness<'_>], warp: &Warp) -> Option<Fit> {
    if cloud.is_empty() {
        return None;
    }
    let cameras: Vec<Camera> = witnesses.iter().map(|witness| warp.of(witness.camera)).collect();
    let seen = cameras.iter().map(|camera| share_seen(cloud, camera)).collect();
    let photos: Vec<(&Camera, &RgbImage)> =
        witnesses.iter().zip(&cameras).filter_map(|(witness, camera)| Some((camera, witness.picture?))).collect();
    let agreements: Vec<f64> =
        photos.iter().filter_map(|(camera, picture)| agreement(cloud, camera, picture)).collect();
    // A few photos that happen to see points do not represent the others.
    let agreement = if 2 * agreements.len() > photos.len() { median(agreements) } else { None };
    Some(Fit { seen: median(seen)?, agreement })
}

fn share_seen(cloud: &Cloud, camera: &Camera) -> f64 {
    let seen = cloud.positions.iter().filter(|&&point| pixel(camera, point).is_some()).count();
    seen as f64 / cloud.positions.len() as f64
}

/// The pixel position of a point; `None` if it is outside of the image.
pub(super) fn pixel(camera: &Camera, point: DVec3) -> Option<DVec2> {
    let size = DVec2::new(camera.width as f64, camera.height as f64);
    camera.project(point).filter(|pixel| pixel.cmpge(DVec2::ZERO).all() && pixel.cmplt(size).all())
}

/// Correlation of the points' colours with those of the photo, over the points inside it. It combines the three
/// channels, each about its own mean, so exposure and white balance do not matter. `None` if the colours are
/// meaningless or too few points are inside.
pub(super) fn agreement(cloud: &Cloud, camera: &Camera, photo: &RgbImage) -> Option<f64> {
    let scale = DVec2::new(f64::from(photo.width()), f64::from(photo.height()))
        / DVec2::new(camera.width as f64, camera.height as f64);
    let pair = |(&point, &colour): (&DVec3, &Vec3)| {
        let at = (pixel(camera, point)? * scale).as_uvec2();
        let photo = photo.get_pixel_checked(at.x, at.y)?.0.map(|channel| f64::from(channel) / 255.0);
        Some([colour.as_dvec3(), DVec3::from_array(photo)])
    };
    let pairs: Vec<[DVec3; 2]> = cloud.positions.iter().zip(&cloud.colours).filter_map(pair).collect();
    if pairs.len() < ENOUGH {
        return None;
    }
    let count = pairs.len() as f64;
    let mean = |side: usize| pairs.iter().map(|pair| pair[side]).sum::<DVec3>() / count;
    let means = [mean(0), mean(1)];
    let product = |a: usize, b: usize| {
        pairs.iter().map(|pair| (pair[a] - means[a]).dot(pair[b] - means[b])).sum::<f64>() / (3.0 * count)
    };
    let deviations = [product(0, 0).sqrt(), product(1, 1).sqrt()];
    (deviations[0] > ALIKE && deviations[1] > ALIKE).then(|| product(0, 1) / (deviations[0] * deviations[1]))
}
