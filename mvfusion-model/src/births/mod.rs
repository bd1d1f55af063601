//! Gaussians that are born where a picture is wrong: clusters of error become ellipses, and ellipses Gaussians.
//!
//! The idea is that of CEM-4DGS (arXiv 2511.16112), which lets one Gaussian be born for each cluster of pixels of large
//! error instead of one for each pixel. Ours is for moments that a single camera saw: nothing tells how far away a thing
//! is, so it is put in front of what is still.

mod clusters;
mod ellipse;

use glam::{DVec2, DVec3, Vec3};
use image::RgbImage;
use mvfusion_data::{Camera, GaussianCloud, Lifetime};

use crate::gaussians::SH_C0;
use crate::random::Stream;
use clusters::{ErrorPixel, clusters};
use ellipse::Ellipse;

/// Largest difference of a channel, in `[0, 1]`, from which a pixel is wrong. Ours: 0.1, thrice what the static branch of a
/// short run misses still pixels by. CEM-4DGS: 0.038 and the worst 3 %, of a picture that is nearly right.
pub const LEAST_ERROR: f32 = 0.1;

/// Side of the square around a pixel, pixels, of which [`LEAST_SHARE`] must be wrong as well (RobustNeRF filters its
/// outliers so). It leaves out lines of a pixel; a square of 5 leaves out too much of the passers-by.
pub const PATCH: usize = 3;

/// Share of the square that must be wrong.
pub const LEAST_SHARE: f32 = 0.5;

/// What is in front of the still scene is taken to be at this share of its depth.
const IN_FRONT: f64 = 0.75;

/// Opacity at birth: an ellipse hides most of what is behind it.
const OPACITY: f32 = 0.8;

/// Depth of an ellipse along its ray, as a share of its smaller axis.
const THICKNESS: f64 = 0.5;

/// A training view beside what the static branch shows there.
#[derive(Clone, Debug)]
pub struct StillView<'a> {
    /// The camera.
    pub camera: &'a Camera,
    /// The photo.
    pub photo: &'a RgbImage,
    /// Where the photo counts, row by row; everywhere, if absent.
    pub counted: Option<Vec<bool>>,
    /// Colours of the static branch, channel by channel, row by row, in `[0, 1]`.
    pub colours: &'a [f32],
    /// Its depth along the camera's axis, row by row, world units; 0 where there is none.
    pub depths: &'a [f32],
}

impl StillView<'_> {
    /// The pixels that are wrong.
    fn errors(&self) -> Vec<ErrorPixel> {
        let (width, area) = (self.camera.width, self.depths.len());
        let pixel = |(index, pixel): (usize, &image::Rgb<u8>)| {
            let colour = Vec3::from_array(pixel.0.map(|level| f32::from(level) / 255.0));
            let still =
                Vec3::from_array(std::array::from_fn(|channel| self.colours[channel * area + index].clamp(0.0, 1.0)));
            let position = DVec2::new((index % width) as f64 + 0.5, (index / width) as f64 + 0.5);
            ErrorPixel { position, colour, error: (colour - still).abs().max_element(), index }
        };
        let pixels: Vec<ErrorPixel> = self.photo.pixels().enumerate().map(pixel).collect();
        let counts = |index: usize| self.counted.as_ref().is_none_or(|counted| counted[index]);
        let is_wrong: Vec<bool> =
            pixels.iter().map(|pixel| counts(pixel.index) && pixel.error >= LEAST_ERROR).collect();
        // A thing is wrong all over, an edge that the static branch has yet to sharpen in a line.
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

    /// How wrong the picture is: the sum of the errors of its wrong pixels.
    pub fn wrongness(&self) -> f64 {
        self.errors().iter().map(|pixel| f64::from(pixel.error)).sum()
    }

    /// Adds at most `count` Gaussians for what is wrong in this view to a cloud of degree 0 with lifetimes and without masks.
    pub fn births(&self, count: usize, lifetime: Lifetime, stream: &mut Stream, cloud: &mut GaussianCloud) {
        let found = clusters(&self.errors(), count, stream);
        for ellipse in found.iter().filter_map(|cluster| Ellipse::of(cluster)) {
            let Some(depth) = self.depth_of(&ellipse) else { continue };
            let [mean, log_scale] = [self.place(&ellipse, depth), self.log_scale(&ellipse, depth)];
            cloud.means.push(mean.as_vec3().to_array());
            cloud.sh_dc.push(((ellipse.colour - 0.5) / SH_C0 as f32).to_array());
            cloud.opacity_logits.push((OPACITY / (1.0 - OPACITY)).ln());
            cloud.log_scales.push(log_scale.as_vec3().to_array());
            cloud.quaternions.push(ellipse.rotation(self.camera));
            cloud.lifetimes.iter_mut().for_each(|lifetimes| lifetimes.push(lifetime));
        }
    }

    /// In front of what is still behind the ellipse: of the median depth of its pixels. `None` where nothing is there.
    fn depth_of(&self, ellipse: &Ellipse) -> Option<f64> {
        let mut depths: Vec<f32> = ellipse.pixels.iter().map(|&index| self.depths[index]).collect();
        depths.retain(|&depth| depth > 0.0);
        depths.sort_by(f32::total_cmp);
        depths.get(depths.len() / 2).map(|&depth| IN_FRONT * f64::from(depth))
    }

    fn place(&self, ellipse: &Ellipse, depth: f64) -> DVec3 {
        let camera = self.camera;
        let across = (ellipse.centre - DVec2::new(camera.cx, camera.cy)) / DVec2::new(camera.fx, camera.fy);
        camera.centre() + camera.rotation.transpose() * (depth * across.extend(1.0))
    }

    fn log_scale(&self, ellipse: &Ellipse, depth: f64) -> DVec3 {
        let pixel = depth / self.camera.fx;
        let [long, short] = ellipse.deviations.map(|deviation| deviation * pixel);
        DVec3::new(long.ln(), short.ln(), (THICKNESS * short).ln())
    }
}

#[cfg(test)]
mod tests {
    use glam::DMat3;
    use image::Rgb;

    use super::*;

    const SIZE: (usize, usize) = (40, 30);
    const LIFE: Lifetime = Lifetime { centre: 0.25, log_duration: -5.0, velocity: [0.0; 3] };

    fn camera() -> Camera {
        Camera::centred(SIZE.0, SIZE.1, 40.0, DMat3::IDENTITY, DVec3::ZERO)
    }

    /// A grey room four units away with a red bar in the photo alone.
    fn photo() -> RgbImage {
        RgbImage::from_fn(40, 30, |x, y| match (10..26).contains(&x) && (12..16).contains(&y) {
            true => Rgb([255, 0, 0]),
            false => Rgb([128; 3]),
        })
    }

    fn view<'a>(camera: &'a Camera, photo: &'a RgbImage, colours: &'a [f32], depths: &'a [f32]) -> StillView<'a> {
        StillView { camera, photo, counted: None, colours, depths }
    }

    fn births(view: &StillView<'_>, count: usize) -> GaussianCloud {
        let mut cloud = GaussianCloud { lifetimes: Some(Vec::new()), ..GaussianCloud::default() };
        view.births(count, LIFE, &mut Stream::new(1, 0), &mut cloud);
        cloud
    }

    #[test]
    fn what_is_wrong_becomes_a_gaussian_of_its_place_colour_and_shape() {
        let (camera, photo) = (camera(), photo());
        let (colours, depths) = (vec![128.0 / 255.0; 3 * 1200], vec![4.0; 1200]);
        let view = view(&camera, &photo, &colours, &depths);
        let cloud = births(&view, 1);
        assert_eq!((cloud.len(), cloud.lifetimes.as_deref()), (1, Some([LIFE].as_slice())));
        let mean = Vec3::from_array(cloud.means[0]);
        // Three quarters of the way, on the ray through (18, 14).
        assert!(mean.distance(Vec3::new(-2.0 / 40.0 * 3.0, -1.0 / 40.0 * 3.0, 3.0)) < 1e-5, "{mean}");
        let red = cloud.sh_dc[0].map(|dc| 0.5 + SH_C0 as f32 * dc);
        assert!((red[0] - 1.0).abs() < 1e-5 && red[1].abs() < 1e-5, "{red:?}");
        // A bar of 16 by 4 pixels without its corners, of whose neighbourhoods less than a half is wrong: the sums of
        // squares are 64 times 21.25 and 1.25 less four times 7.5^2 and 1.5^2.
        let scale = cloud.log_scales[0].map(|log| f64::from(log.exp()));
        let deviations = [1135.0, 71.0].map(|squares: f64| (squares / 60.0 + 1.0 / 12.0).sqrt());
        for (scale, deviation) in scale.iter().zip(deviations) {
            assert!((scale - deviation * 3.0 / 40.0).abs() < 1e-4, "{scale} for {deviation} pixels");
        }
    }

    #[test]
    fn several_clusters_share_out_what_is_wrong() {
        let (camera, photo) = (camera(), photo());
        let (colours, depths) = (vec![128.0 / 255.0; 3 * 1200], vec![4.0; 1200]);
        let view = view(&camera, &photo, &colours, &depths);
        let cloud = births(&view, 4);
        assert_eq!(cloud.len(), 4);
        assert_eq!(births(&view, 4), cloud, "a seed says all");
        assert!((view.wrongness() - 60.0 * 128.0 / 255.0).abs() < 0.01, "{}", view.wrongness());
    }

    #[test]
    fn where_nothing_is_wrong_or_counts_nothing_is_born() {
        let (camera, photo) = (camera(), photo());
        let depths = vec![4.0; 1200];
        let right: Vec<f32> = (0..3)
            .flat_map(|channel| {
                photo.pixels().map(move |pixel| f32::from(pixel.0[channel]) / 255.0).collect::<Vec<_>>()
            })
            .collect();
        assert!(births(&view(&camera, &photo, &right, &depths), 9).is_empty());
        let grey = vec![0.5; 3 * 1200];
        let masked = StillView { counted: Some(vec![false; 1200]), ..view(&camera, &photo, &grey, &depths) };
        assert!(births(&masked, 9).is_empty());
        assert!(births(&view(&camera, &photo, &grey, &[0.0; 1200]), 9).is_empty());
    }
}
