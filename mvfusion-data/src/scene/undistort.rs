//! Undistortion of an image to the image of a pinhole camera.
//!
//! The pinhole has the image's size, and its field of view is within that of the lens, so every pixel of the new image
//! is known. This is OpenCV's `getOptimalNewCameraMatrix` with alpha 0 (METHOD §5.2). Departure: OpenCV samples 9 x 9
//! points of the border, inverts the lens by five fixed-point steps, and crops a row and a column. Here, every pixel edge
//! of the border is used, the inverse is exact, and the size stays. For strong lenses, five steps are pixels off.

use glam::DVec2;
use image::{GrayImage, Luma, Rgb, RgbImage};

use super::lens::{Distortion, Lens};

/// Half the widest field of view of a pinhole, as a tangent. At 80° a pixel in the corner covers thirty times less than
/// one in the middle.
const WIDEST: f64 = 5.67;

/// The pinhole whose image of `width` by `height` pixels is within the field of view of `lens` at the same size. `None`
/// if the lens shows nothing in front of the camera.
pub(crate) fn pinhole_within(lens: &Lens, width: u32, height: u32) -> Option<Lens> {
    if lens.distortion.is_none() {
        return Some(*lens);
    }
    let (w, h) = (f64::from(width), f64::from(height));
    let seen = |x: f64, y: f64| lens.direction_of(DVec2::new(x, y));
    let rows = || (0..=height).map(f64::from);
    let columns = || (0..=width).map(f64::from);
    let left = rows().filter_map(|y| seen(0.0, y)).map(|p| p.x).reduce(f64::max);
    let right = rows().filter_map(|y| seen(w, y)).map(|p| p.x).reduce(f64::min);
    let top = columns().filter_map(|x| seen(x, 0.0)).map(|p| p.y).reduce(f64::max);
    let bottom = columns().filter_map(|x| seen(x, h)).map(|p| p.y).reduce(f64::min);
    // If a fisheye sees nothing at an edge of the image, the edge is beyond the widest field of view. A perspective
    // lens sees something at every edge, unless its coefficients do not belong to the image.
    if [left, right, top, bottom].contains(&None) && matches!(lens.distortion, Distortion::Perspective { .. }) {
        return None;
    }
    let [left, top] = [left, top].map(|edge| edge.unwrap_or(-WIDEST).max(-WIDEST));
    let [right, bottom] = [right, bottom].map(|edge| edge.unwrap_or(WIDEST).min(WIDEST));
    if !(left < right && top < bottom) {
        return None;
    }
    let focal = DVec2::new(w / (right - left), h / (bottom - top));
    Some(Lens { focal, principal: -focal * DVec2::new(left, top), distortion: Distortion::NONE })
}

/// Undistorts an image from `lens` to `pinhole`. Both are for the image's size.
pub(crate) fn straighten(image: &RgbImage, lens: &Lens, pinhole: &Lens) -> RgbImage {
    let (width, height) = image.dimensions();
    let mut straight = RgbImage::new(width, height);
    for (y, row) in straight.chunks_exact_mut(3 * width as usize).enumerate() {
        for (x, pixel) in row.chunks_exact_mut(3).enumerate() {
            let at = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
            let Some(direction) = pinhole.direction_of(at) else { continue };
            pixel.copy_from_slice(&cubic(image, lens.pixel_of(direction)).0);
        }
    }
    straight
}

/// Undistorts a mask without interpolation.
pub(crate) fn straighten_mask(mask: &GrayImage, lens: &Lens, pinhole: &Lens) -> GrayImage {
    let (width, height) = mask.dimensions();
    GrayImage::from_fn(width, height, |x, y| {
        let direction = pinhole.direction_of(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5));
        let Some(at) = direction.map(|direction| lens.pixel_of(direction)) else { return Luma([0]) };
        let place = |at: f64, size: u32| at.floor().clamp(0.0, f64::from(size - 1)) as u32;
        *mask.get_pixel(place(at.x, width), place(at.y, height))
    })
}

/// The colour at a pixel position, by Catmull-Rom cubic interpolation. Beyond the border, the border's colour is
/// repeated.
fn cubic(image: &RgbImage, at: DVec2) -> Rgb<u8> {
    // A few pixels outside, only the border matters. Further out, positions would overflow the integers.
    let size = DVec2::new(f64::from(image.width()), f64::from(image.height()));
    let at = at.clamp(DVec2::splat(-2.0), size + 2.0);
    let (x, y) = (at.x - 0.5, at.y - 0.5);
    let (weights_x, weights_y) = (cubic_weights(x - x.floor()), cubic_weights(y - y.floor()));
    let (first_x, first_y) = (x.floor() as i64 - 1, y.floor() as i64 - 1);
    let mut sums = [0.0; 3];
    for (j, weight_y) in (0i64..).zip(weights_y) {
        let row = (first_y + j).clamp(0, i64::from(image.height()) - 1) as u32;
        for (i, weight_x) in (0i64..).zip(weights_x) {
            let column = (first_x + i).clamp(0, i64::from(image.width()) - 1) as u32;
            let Rgb(colour) = image.get_pixel(column, row);
            for (sum, &channel) in sums.iter_mut().zip(colour) {
                *sum += weight_x * weight_y * f64::from(channel);
            }
        }
    }
    Rgb(sums.map(|sum| sum.round().clamp(0.0, 255.0) as u8))
}

fn cubic_weights(t: f64) -> [f64; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [-0.5 * t3 + t2 - 0.5 * t, 1.5 * t3 - 2.5 * t2 + 1.0, -1.5 * t3 + 2.0 * t2 + 0.5 * t, 0.5 * t3 - 0.5 * t2]
}

#[cfg(test)]
mod opencv;

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: (u32, u32) = (96, 64);

    fn barrel() -> Lens {
        let distortion = Distortion::opencv([-0.15, 0.02, 0.0, 0.0, 0.0, 0.0], [1e-3, -5e-4]);
        Lens { focal: DVec2::new(70.0, 71.0), principal: DVec2::new(47.0, 33.0), distortion }
    }

    /// A smooth image on the plane at distance one.
    fn colour(point: DVec2) -> [f64; 3] {
        [
            128.0 + 90.0 * (7.0 * point.x).sin(),
            128.0 + 90.0 * (6.0 * point.y).cos(),
            128.0 + 60.0 * (5.0 * (point.x + point.y)).sin(),
        ]
    }

    fn taken_through(lens: &Lens) -> RgbImage {
        RgbImage::from_fn(SIZE.0, SIZE.1, |x, y| {
            let point = lens.direction_of(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5)).expect("seen");
            Rgb(colour(point).map(|c| c.round() as u8))
        })
    }

    #[test]
    fn a_straightened_picture_is_the_one_that_a_pinhole_takes() {
        let fisheye = Distortion::Fisheye {
            radial: [0.05, -0.01, 0.0, 0.0, 0.0, 0.0],
            tangential: [0.0; 2],
            prism: [0.0; 4],
            shifted_last: false,
        };
        for lens in [barrel(), Lens { distortion: fisheye, ..barrel() }] {
            let pinhole = pinhole_within(&lens, SIZE.0, SIZE.1).expect("sees something");
            let found = straighten(&taken_through(&lens), &lens, &pinhole);
            let wanted = taken_through(&pinhole);
            let worst = found.iter().zip(wanted.iter()).map(|(a, b)| a.abs_diff(*b)).max();
            assert!(worst <= Some(2), "{worst:?} levels off");
        }
    }

    #[test]
    fn a_pinhole_sees_as_much_as_it_can_of_what_the_lens_shows() {
        let lens = barrel();
        let pinhole = pinhole_within(&lens, SIZE.0, SIZE.1).expect("sees something");
        let (w, h) = (f64::from(SIZE.0), f64::from(SIZE.1));
        let mut reach = [f64::INFINITY; 4];
        for i in 0..=32 {
            let t = f64::from(i) / 32.0;
            for edge in [DVec2::new(t * w, 0.0), DVec2::new(t * w, h), DVec2::new(0.0, t * h), DVec2::new(w, t * h)] {
                let source = lens.pixel_of(pinhole.direction_of(edge).expect("a pinhole"));
                let room = [source.x, source.y, w - source.x, h - source.y];
                assert!(room.iter().all(|&room| room > -0.05), "{edge} comes from {source}");
                for (reach, room) in reach.iter_mut().zip(room) {
                    *reach = reach.min(room);
                }
            }
        }
        assert!(reach.iter().all(|&room| room < 0.3), "{reach:?} pixels of the border were given away");
    }

    #[test]
    fn coefficients_that_are_no_lens_give_no_pinhole() {
        for k1 in [-5.0, 1e300] {
            let distortion = Distortion::opencv([k1, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0; 2]);
            assert_eq!(pinhole_within(&Lens { distortion, ..barrel() }, SIZE.0, SIZE.1), None, "{k1}");
        }
    }

    #[test]
    fn places_far_outside_show_the_border() {
        let image = taken_through(&barrel());
        for (at, corner) in [
            (DVec2::splat(f64::INFINITY), (95, 63)),
            (DVec2::splat(f64::NEG_INFINITY), (0, 0)),
            (DVec2::new(-1.6, 1e300), (0, 63)),
        ] {
            assert_eq!(cubic(&image, at), *image.get_pixel(corner.0, corner.1), "{at}");
        }
    }

    #[test]
    fn a_pinhole_stays_what_it_is() {
        let lens = Lens { distortion: Distortion::NONE, ..barrel() };
        assert_eq!(pinhole_within(&lens, SIZE.0, SIZE.1), Some(lens));
        let image = taken_through(&lens);
        assert_eq!(straighten(&image, &lens, &lens), image);
    }
}
