//! Births of Gaussians where renders have large errors: clusters of error pixels become ellipses, and ellipses become
//! Gaussians.
//!
//! The idea is from CEM-4DGS (arXiv 2511.16112): one Gaussian per cluster of pixels with large errors, not one per
//! pixel. Photos with distinct moments are compared once with the static branch ([`BirthRule::PHOTO`]). Videos are
//! compared repeatedly with the whole model ([`BirthRule::FILM`]). If the depth of an object is unknown, it is placed
//! in front of the static scene.

mod clusters;
mod ellipse;
mod rounds;

use glam::{Affine3A, DVec2, DVec3, Vec3};
use image::RgbImage;
use mvfusion_data::{Camera, GaussianCloud, Lifetime};

use crate::model::gaussians::SH_C0;
use crate::random::Stream;
use clusters::{ErrorPixel, clusters};
pub use ellipse::Ellipse;

/// Error threshold of pixels of photos: the largest difference of a channel, in `[0, 1]`. Ours: three times the error
/// of still pixels in the static branch of a short run.
pub const LEAST_ERROR: f32 = 0.1;

/// Side in pixels of the square around a pixel in which [`LEAST_SHARE`] must also exceed the threshold (as RobustNeRF
/// filters outliers). It excludes lines of one pixel; a square of 5 would exclude too much of the passers-by.
pub const PATCH: usize = 3;

/// Fraction of the square that must exceed the threshold.
pub const LEAST_SHARE: f32 = 0.5;

/// Assumed depth of objects in front of the static scene, as a fraction of its depth.
pub const IN_FRONT: f32 = 0.75;

/// Thickness of an ellipse along its ray, as a fraction of its smaller axis.
const THICKNESS: f64 = 0.5;

/// Determinant of a camera's colour map below which it is not inverted.
const LEAST_GAIN: f32 = 0.1;

/// The error threshold of pixels, and the opacity of the Gaussians born from them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BirthRule {
    /// Error threshold: the largest difference of a channel, in `[0, 1]`.
    pub least_error: f32,
    /// Maximum fraction of an image's pixels: those with the largest errors.
    pub worst_share: f64,
    /// Opacity at birth.
    pub opacity: f32,
}

impl BirthRule {
    /// For photos against the static branch: an ellipse hides most of what is behind it.
    pub const PHOTO: Self = Self { least_error: LEAST_ERROR, worst_share: 1.0, opacity: 0.8 };

    /// For videos against the whole model (CEM-4DGS): an ellipse makes small corrections.
    pub const FILM: Self = Self { least_error: 0.038, worst_share: 0.03, opacity: 0.1 };
}

/// A training view and the model's render of it.
#[derive(Clone, Debug)]
pub struct ComparedView<'a> {
    /// The camera.
    pub camera: &'a Camera,
    /// The photo.
    pub photo: &'a RgbImage,
    /// Pixels that the view's mask keeps, row by row; all, if absent.
    pub valid: Option<&'a [bool]>,
    /// Pixels that move, row by row; all, if absent. Gaussians are born only there.
    pub moving: Option<&'a [bool]>,
    /// The model's colours, channel by channel, row by row, in `[0, 1]`.
    pub colours: &'a [f32],
    /// The map from the scene's colours to those of the camera; the identity, if absent.
    pub exposure: Option<Affine3A>,
    /// Fallback depth along the camera's axis for new Gaussians, row by row, in world units; 0 where it is unknown.
    pub depths: &'a [f32],
    /// The rule for errors.
    pub rule: BirthRule,
}

impl ComparedView<'_> {
    /// The pixels with large errors.
    fn errors(&self) -> Vec<ErrorPixel> {
        let (width, area) = (self.camera.width, self.depths.len());
        let pixel = |(index, pixel): (usize, &image::Rgb<u8>)| {
            let colour = Vec3::from_array(pixel.0.map(|level| f32::from(level) / 255.0));
            let shown =
                Vec3::from_array(std::array::from_fn(|channel| self.colours[channel * area + index].clamp(0.0, 1.0)));
            let position = DVec2::new((index % width) as f64 + 0.5, (index / width) as f64 + 0.5);
            ErrorPixel { position, colour, error: (colour - shown).abs().max_element(), index }
        };
        let pixels: Vec<ErrorPixel> = self.photo.pixels().enumerate().map(pixel).collect();
        let among = |mask: Option<&[bool]>, pixel: &ErrorPixel| mask.is_none_or(|mask| mask[pixel.index]);
        let is_valid = |pixel: &&ErrorPixel| among(self.valid, pixel);
        // What a mask excludes is never learned, so its errors are the largest.
        let least = self.least_error(pixels.iter().filter(is_valid).map(|pixel| pixel.error));
        let is_wrong = |pixel: &ErrorPixel| is_valid(&pixel) && among(self.moving, pixel) && pixel.error >= least;
        let is_wrong: Vec<bool> = pixels.iter().map(is_wrong).collect();
        // A missing object has errors all over. An edge that is not sharp yet has errors along a line.
        let among_wrong = |pixel: &ErrorPixel| {
            let reach = PATCH / 2;
            let (x, y) = (pixel.index % width, pixel.index / width);
            let rows = y.saturating_sub(reach)..(y + reach + 1).min(self.camera.height);
            let columns = x.saturating_sub(reach)..(x + reach + 1).min(width);
            let wrong = rows.flat_map(|row| columns.clone().map(move |column| row * width + column));
            wrong.filter(|&index| is_wrong[index]).count() as f32 >= LEAST_SHARE * (PATCH * PATCH) as f32
        };
        pixels.iter().filter(|pixel| is_wrong[pixel.index] && among_wrong(pixel)).copied().collect()
    }

    /// The error threshold.
    fn least_error(&self, errors: impl Iterator<Item = f32>) -> f32 {
        let BirthRule { least_error, worst_share, .. } = self.rule;
        if worst_share >= 1.0 {
            return least_error;
        }
        let mut sorted: Vec<f32> = errors.collect();
        sorted.sort_by(|a, b| b.total_cmp(a));
        let worst = sorted.get((worst_share * sorted.len() as f64) as usize).copied();
        least_error.max(worst.unwrap_or(0.0))
    }

    /// The sum of the errors of all pixels above the threshold.
    pub fn wrongness(&self) -> f64 {
        self.errors().iter().map(|pixel| f64::from(pixel.error)).sum()
    }

    /// At most `count` ellipses that cover the large errors.
    pub fn ellipses(&self, count: usize, stream: &mut Stream) -> Vec<Ellipse> {
        clusters(&self.errors(), count, stream).iter().filter_map(|cluster| Ellipse::of(cluster)).collect()
    }

    /// The fallback position of an ellipse, at the median depth of its pixels. `None` if that is unknown.
    pub fn place(&self, ellipse: &Ellipse) -> Option<DVec3> {
        let mut depths: Vec<f32> = ellipse.pixels.iter().map(|&index| self.depths[index]).collect();
        depths.retain(|&depth| depth > 0.0);
        depths.sort_by(f32::total_cmp);
        let depth = f64::from(*depths.get(depths.len() / 2)?);
        let camera = self.camera;
        let across = (ellipse.centre - DVec2::new(camera.cx, camera.cy)) / DVec2::new(camera.fx, camera.fy);
        Some(camera.centre() + camera.rotation.transpose() * (depth * across.extend(1.0)))
    }

    /// Adds the Gaussian of an ellipse at a point on its ray to a cloud of SH degree 0 with lifetimes and without
    /// masks.
    pub fn add_to(&self, cloud: &mut GaussianCloud, ellipse: &Ellipse, place: DVec3, lifetime: Lifetime) {
        let opacity = self.rule.opacity;
        let depth = self.camera.to_camera(place).z;
        cloud.means.push(place.as_vec3().to_array());
        cloud.sh_dc.push(((self.own_colour(ellipse.colour) - 0.5) / SH_C0 as f32).to_array());
        cloud.opacity_logits.push((opacity / (1.0 - opacity)).ln());
        cloud.log_scales.push(self.log_scale(ellipse, depth).as_vec3().to_array());
        cloud.quaternions.push(ellipse.rotation(self.camera));
        cloud.lifetimes.iter_mut().for_each(|lifetimes| lifetimes.push(lifetime));
    }

    /// The scene's colour that the camera shows as `seen`.
    fn own_colour(&self, seen: Vec3) -> Vec3 {
        match self.exposure.filter(|map| map.matrix3.determinant() >= LEAST_GAIN) {
            Some(map) => map.inverse().transform_point3(seen).clamp(Vec3::ZERO, Vec3::ONE),
            None => seen,
        }
    }

    fn log_scale(&self, ellipse: &Ellipse, depth: f64) -> DVec3 {
        // Along the ellipse's axes; the focal lengths of x and y are nearly equal.
        let pixel = depth / (self.camera.fx * self.camera.fy).sqrt();
        let [long, short] = ellipse.deviations.map(|deviation| deviation * pixel);
        DVec3::new(long.ln(), short.ln(), (THICKNESS * short).ln())
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, Mat3};
    use image::Rgb;

    use super::*;

    const SIZE: (usize, usize) = (40, 30);
    const LIFE: Lifetime = Lifetime { centre: 0.25, log_duration: -5.0, velocity: [0.0; 3] };

    fn camera() -> Camera {
        Camera::centred(SIZE.0, SIZE.1, 40.0, DMat3::IDENTITY, DVec3::ZERO)
    }

    /// A grey room four units away, with a red bar only in the photo.
    fn photo() -> RgbImage {
        RgbImage::from_fn(40, 30, |x, y| match (10..26).contains(&x) && (12..16).contains(&y) {
            true => Rgb([255, 0, 0]),
            false => Rgb([128; 3]),
        })
    }

    fn view<'a>(camera: &'a Camera, photo: &'a RgbImage, colours: &'a [f32], depths: &'a [f32]) -> ComparedView<'a> {
        let rule = BirthRule::PHOTO;
        ComparedView { camera, photo, valid: None, moving: None, colours, exposure: None, depths, rule }
    }

    fn births(view: &ComparedView<'_>, count: usize) -> GaussianCloud {
        let mut cloud = GaussianCloud { lifetimes: Some(Vec::new()), ..GaussianCloud::default() };
        for ellipse in view.ellipses(count, &mut Stream::new(1, 0)) {
            if let Some(place) = view.place(&ellipse) {
                view.add_to(&mut cloud, &ellipse, place, LIFE);
            }
        }
        cloud
    }

    #[test]
    fn what_is_wrong_becomes_a_gaussian_of_its_place_colour_and_shape() {
        let (camera, photo) = (camera(), photo());
        let (colours, depths) = (vec![128.0 / 255.0; 3 * 1200], vec![3.0; 1200]);
        let view = view(&camera, &photo, &colours, &depths);
        let cloud = births(&view, 1);
        assert_eq!((cloud.len(), cloud.lifetimes.as_deref()), (1, Some([LIFE].as_slice())));
        let mean = Vec3::from_array(cloud.means[0]);
        // At the given depth, on the ray through (18, 14).
        assert!(mean.distance(Vec3::new(-2.0 / 40.0 * 3.0, -1.0 / 40.0 * 3.0, 3.0)) < 1e-5, "{mean}");
        let red = cloud.sh_dc[0].map(|dc| 0.5 + SH_C0 as f32 * dc);
        assert!((red[0] - 1.0).abs() < 1e-5 && red[1].abs() < 1e-5, "{red:?}");
        // A bar of 16 by 4 pixels without its corners, whose neighbourhoods have errors in less than half: the sums of
        // squares are 64 times 21.25 and 1.25 minus four times 7.5^2 and 1.5^2.
        let scale = cloud.log_scales[0].map(|log| f64::from(log.exp()));
        let deviations = [1135.0, 71.0].map(|squares: f64| (squares / 60.0 + 1.0 / 12.0).sqrt());
        for (scale, deviation) in scale.iter().zip(deviations) {
            assert!((scale - deviation * 3.0 / 40.0).abs() < 1e-4, "{scale} for {deviation} pixels");
        }
    }

    #[test]
    fn several_clusters_share_out_what_is_wrong() {
        let (camera, photo) = (camera(), photo());
        let (colours, depths) = (vec![128.0 / 255.0; 3 * 1200], vec![3.0; 1200]);
        let view = view(&camera, &photo, &colours, &depths);
        let cloud = births(&view, 4);
        assert_eq!(cloud.len(), 4);
        assert_eq!(births(&view, 4), cloud, "a seed says all");
        assert!((view.wrongness() - 60.0 * 128.0 / 255.0).abs() < 0.01, "{}", view.wrongness());
    }

    #[test]
    fn of_a_film_the_worst_pixels_are_wrong() {
        let (camera, mut photo) = (camera(), photo());
        // A block with a smaller error, far below the worst 3 % (36 pixels of 1200).
        (20..30).flat_map(|y| (0..10).map(move |x| (x, y))).for_each(|(x, y)| photo.put_pixel(x, y, Rgb([150; 3])));
        let (colours, depths) = (vec![128.0 / 255.0; 3 * 1200], vec![3.0; 1200]);
        let view = |rule| ComparedView { rule, ..view(&camera, &photo, &colours, &depths) };
        let places = |rule| view(rule).ellipses(9, &mut Stream::new(1, 0)).len();
        let all = BirthRule { worst_share: 1.0, ..BirthRule::FILM };
        assert!(view(all).errors().len() > 150 && places(all) > 0);
        assert_eq!(view(BirthRule::FILM).errors().len(), 60, "the bar without its corners");
        assert!(view(BirthRule { least_error: 0.6, ..all }).errors().is_empty());
    }

    #[test]
    fn what_a_mask_excludes_is_not_among_the_worst() {
        let (camera, mut photo) = (camera(), photo());
        // The worst fifth of the picture, and none of it counts.
        (20..30).flat_map(|y| (0..24).map(move |x| (x, y))).for_each(|(x, y)| photo.put_pixel(x, y, Rgb([0, 255, 0])));
        let (mut colours, depths) = (vec![128.0 / 255.0; 3 * 1200], vec![3.0; 1200]);
        (0..1200).filter(|index| index / 40 >= 20).for_each(|index| colours[1200 + index] = 0.0);
        let view = ComparedView { rule: BirthRule::FILM, ..view(&camera, &photo, &colours, &depths) };
        let bar = |view: &ComparedView<'_>| view.errors().iter().filter(|pixel| pixel.index / 40 < 20).count();
        assert_eq!((bar(&view), view.errors().is_empty()), (0, false));
        let kept: Vec<bool> = (0..1200).map(|index| index / 40 < 20).collect();
        assert_eq!(bar(&ComparedView { valid: Some(&kept), ..view }), 60, "the bar without its corners");
        // Where things move is no excuse to look for smaller errors.
        assert_eq!(ComparedView { moving: Some(&kept), ..view }.errors().len(), 0);
    }

    #[test]
    fn a_camera_with_another_gain_gives_birth_to_the_colours_of_the_scene() {
        let (camera, photo) = (camera(), photo());
        let (colours, depths) = (vec![128.0 / 255.0; 3 * 1200], vec![3.0; 1200]);
        let colour_of = |exposure| {
            let view = ComparedView { exposure: Some(exposure), ..view(&camera, &photo, &colours, &depths) };
            births(&view, 1).sh_dc[0].map(|dc| 0.5 + SH_C0 as f32 * dc)
        };
        let gain = Affine3A::from_mat3_translation(Mat3::from_diagonal(Vec3::new(1.25, 1.0, 0.8)), Vec3::Y * -0.125);
        let expected = Vec3::new(0.8, 0.125, 0.0);
        let found = Vec3::from_array(colour_of(gain));
        assert!(found.distance(expected) < 1e-5, "{found}");
        let flat = Affine3A::from_mat3(Mat3::from_diagonal(Vec3::new(1.0, 1.0, 0.01)));
        assert!(Vec3::from_array(colour_of(flat)).distance(Vec3::X) < 1e-5, "it is left as it is");
    }

    #[test]
    fn where_nothing_is_wrong_or_counts_nothing_is_born() {
        let (camera, photo) = (camera(), photo());
        let depths = vec![3.0; 1200];
        let right: Vec<f32> = (0..3)
            .flat_map(|channel| {
                photo.pixels().map(move |pixel| f32::from(pixel.0[channel]) / 255.0).collect::<Vec<_>>()
            })
            .collect();
        assert!(births(&view(&camera, &photo, &right, &depths), 9).is_empty());
        let (grey, nowhere) = (vec![0.5; 3 * 1200], [false; 1200]);
        let masked = ComparedView { valid: Some(&nowhere), ..view(&camera, &photo, &grey, &depths) };
        assert!(births(&masked, 9).is_empty());
        assert!(births(&view(&camera, &photo, &grey, &[0.0; 1200]), 9).is_empty());
    }
}
