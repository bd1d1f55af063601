//! Gaussians as plain values, for files.

use glam::Vec3;

use super::limits::LOG_SIZES;

/// Colour channels.
const CHANNELS: usize = 3;

/// Logit of an opacity that no rasteriser draws: 2e-9.
const TRANSPARENT: f32 = -20.0;

/// Gaussians before any activation, as stored by 3DGS. Every list has one entry per Gaussian.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GaussianCloud {
    /// Degree of the spherical harmonics.
    pub sh_degree: usize,
    /// Centres in world units.
    pub means: Vec<[f32; 3]>,
    /// Constant colour coefficients.
    pub sh_dc: Vec<[f32; 3]>,
    /// Higher colour coefficients: Gaussian by Gaussian, then coefficient by coefficient, channels fastest. Each
    /// Gaussian has [`rest_width`] values.
    pub sh_rest: Vec<f32>,
    /// Opacities as logits.
    pub opacity_logits: Vec<f32>,
    /// Scales along the axes, as natural logarithms.
    pub log_scales: Vec<[f32; 3]>,
    /// Rotations as quaternions w, x, y, z, not normalised.
    pub quaternions: Vec<[f32; 4]>,
    /// Logits of the learned mask: static, brightness, dynamic.
    pub mask_logits: Option<Vec<[f32; 3]>>,
    /// Lifetimes, if the Gaussians have any.
    pub lifetimes: Option<Vec<Lifetime>>,
}

/// The time span in which a Gaussian exists, and its motion meanwhile.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lifetime {
    /// Moment of its highest opacity, in the time of the views.
    pub centre: f32,
    /// Natural logarithm of its duration, in the same time.
    pub log_duration: f32,
    /// Velocity, in world units per unit of time.
    pub velocity: [f32; 3],
}

impl Lifetime {
    /// The numbers in the order of [`LIFETIME_FIELDS`].
    pub fn to_array(self) -> [f32; 5] {
        let [x, y, z] = self.velocity;
        [self.centre, self.log_duration, x, y, z]
    }

    /// From the numbers in the order of [`LIFETIME_FIELDS`].
    pub fn from_array([centre, log_duration, x, y, z]: [f32; 5]) -> Self {
        Self { centre, log_duration, velocity: [x, y, z] }
    }
}

/// Names of the mask's logits in files. Only this program writes them.
pub const MASK_FIELDS: [&str; 3] = ["mask_static", "mask_brightness", "mask_dynamic"];

/// Names of a lifetime's numbers in files. Only this program writes them.
pub const LIFETIME_FIELDS: [&str; 5] = ["time_centre", "log_duration", "velocity_x", "velocity_y", "velocity_z"];

/// Number of higher colour coefficients of a Gaussian at a degree, over three channels: 0, 9, 24 or 45 up to degree 3.
pub fn rest_width(sh_degree: usize) -> usize {
    CHANNELS * ((sh_degree + 1).pow(2) - 1)
}

impl GaussianCloud {
    /// Number of Gaussians.
    pub fn len(&self) -> usize {
        self.means.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.means.is_empty()
    }

    /// The higher colour coefficients of a Gaussian.
    pub fn rest(&self, index: usize) -> &[f32] {
        let width = rest_width(self.sh_degree);
        &self.sh_rest[index * width..(index + 1) * width]
    }

    /// Smallest and largest coordinate of the centres along each axis, or `None` if there are none.
    pub fn bounds(&self) -> Option<(Vec3, Vec3)> {
        let first = Vec3::from_array(*self.means.first()?);
        let wider = |(low, high): (Vec3, Vec3), mean: &[f32; 3]| {
            let mean = Vec3::from_array(*mean);
            (low.min(mean), high.max(mean))
        };
        Some(self.means.iter().fold((first, first), wider))
    }

    /// Changes the degree. New coefficients are zero; coefficients above the new degree are dropped.
    pub fn at_degree(mut self, sh_degree: usize) -> Self {
        let width = rest_width(sh_degree);
        let mut rest = Vec::with_capacity(width * self.len());
        for index in 0..self.len() {
            let old = self.rest(index);
            rest.extend((0..width).map(|place| old.get(place).copied().unwrap_or(0.0)));
        }
        (self.sh_degree, self.sh_rest) = (sh_degree, rest);
        self
    }

    /// Sets the coefficients above a degree to zero. Their number does not change.
    pub fn zero_above(self, sh_degree: usize) -> Self {
        let room = self.sh_degree;
        self.at_degree(sh_degree.min(room)).at_degree(room)
    }

    /// Gaussians whose sizes and opacities every program can represent. Logarithms of sizes are clamped to -87 to 20.7: a
    /// Gaussian of a billion units looks as a larger one. Where the variance overflows, the rasteriser leaves the Gaussian
    /// out, so it becomes transparent. A deformation that diverged gives such sizes. Logits of opacities are at least -87: a
    /// Gaussian whose lifetime is far away may have -1e9.
    pub fn with_values_in_range(mut self) -> Self {
        let [least, most] = LOG_SIZES;
        for (scales, opacity) in self.log_scales.iter_mut().zip(&mut self.opacity_logits) {
            if scales.iter().any(|scale| !(2.0 * scale).exp().is_finite()) {
                *opacity = opacity.min(TRANSPARENT);
            }
            *opacity = opacity.max(least);
            // NaN becomes the least size.
            *scales = scales.map(|scale| scale.max(least).min(most));
        }
        self
    }

    /// These Gaussians followed by those of `other`, at the higher of their degrees. Masks and lifetimes are dropped,
    /// because both clouds would need them.
    pub fn joined(self, other: Self) -> Self {
        let degree = self.sh_degree.max(other.sh_degree);
        let (mut all, other) = (self.at_degree(degree), other.at_degree(degree));
        all.means.extend(other.means);
        all.sh_dc.extend(other.sh_dc);
        all.sh_rest.extend(other.sh_rest);
        all.opacity_logits.extend(other.opacity_logits);
        all.log_scales.extend(other.log_scales);
        all.quaternions.extend(other.quaternions);
        (all.mask_logits, all.lifetimes) = (None, None);
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `count` Gaussians of a degree whose higher coefficients count up from 1.
    fn cloud(count: usize, sh_degree: usize) -> GaussianCloud {
        GaussianCloud {
            sh_degree,
            means: vec![[1.0, 2.0, 3.0]; count],
            sh_dc: vec![[0.0; 3]; count],
            sh_rest: (0..count * rest_width(sh_degree)).map(|place| place as f32 + 1.0).collect(),
            opacity_logits: vec![0.5; count],
            log_scales: vec![[-1.0; 3]; count],
            quaternions: vec![[1.0, 0.0, 0.0, 0.0]; count],
            mask_logits: Some(vec![[0.0; 3]; count]),
            lifetimes: None,
        }
    }

    #[test]
    fn a_higher_degree_adds_zeros_and_a_lower_one_drops_the_last() {
        let one = cloud(2, 1);
        let two = one.clone().at_degree(2);
        assert_eq!(two.rest(1)[..10], [10.0, 11.0, 12.0, 13.0, 14.0, 15.0, 16.0, 17.0, 18.0, 0.0]);
        assert_eq!((two.sh_rest.len(), two.clone().at_degree(1)), (48, one.clone()));
        assert!(one.at_degree(0).sh_rest.is_empty());
        let zeroed = cloud(2, 2).zero_above(1);
        assert_eq!((zeroed.sh_degree, zeroed.rest(0)[8], zeroed.rest(0)[9]), (2, 9.0, 0.0));
    }

    #[test]
    fn sizes_and_opacities_out_of_range_are_clamped_and_what_the_rasteriser_leaves_out_is_transparent() {
        let mut wild = cloud(5, 0);
        wild.log_scales =
            vec![[-100.0, 0.0, 20.0], [30.0; 3], [0.0, 79.0, 0.0], [0.0, f32::INFINITY, 0.0], [f32::NAN; 3]];
        wild.opacity_logits[1] = -7e4;
        let tame = wild.clone().with_values_in_range();
        let [least, most] = LOG_SIZES;
        let expected = [[least, 0.0, 20.0], [most; 3], [0.0, most, 0.0], [0.0, most, 0.0], [least; 3]];
        assert_eq!(tame.log_scales, expected);
        assert_eq!(tame.opacity_logits, [0.5, least, TRANSPARENT, TRANSPARENT, TRANSPARENT]);
        let plain = cloud(2, 1);
        assert_eq!(plain.clone().with_values_in_range(), plain);
    }

    #[test]
    fn joined_gaussians_stand_one_after_the_other_at_the_higher_degree() {
        let all = cloud(1, 0).joined(cloud(2, 1));
        assert_eq!((all.len(), all.sh_degree, all.mask_logits.is_none()), (3, 1, true));
        assert_eq!((all.rest(0), all.rest(1)[0]), ([0.0; 9].as_slice(), 1.0));
        assert_eq!(all.quaternions.len(), 3);
    }

    #[test]
    fn the_bounds_are_those_of_the_centres() {
        let mut two = cloud(2, 0);
        two.means[1] = [-1.0, 5.0, 3.0];
        assert_eq!(two.bounds(), Some((Vec3::new(-1.0, 2.0, 3.0), Vec3::new(1.0, 5.0, 3.0))));
        assert_eq!(GaussianCloud::default().bounds(), None);
    }
}
