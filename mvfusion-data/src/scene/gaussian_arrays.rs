//! Gaussians as activated arrays, for programs that compute with them.

use super::activation::{sigmoid, unit_quaternion};
use super::gaussian_cloud::GaussianCloud;

/// The constant function of the spherical harmonics, `1 / (2 sqrt(pi))`.
const SH_C0: f32 = 0.282_094_8;

/// Values with a name, row by row. The first axis counts Gaussians.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedArray {
    /// Its name in files and in Python.
    pub name: &'static str,
    /// Its shape.
    pub shape: Vec<usize>,
    /// As many values as the shape says.
    pub values: Vec<f32>,
}

impl GaussianCloud {
    /// The Gaussians as arrays, after activation:
    ///
    /// | name | shape | contents |
    /// |---|---|---|
    /// | `means` | `[N, 3]` | centres in world units |
    /// | `quaternions` | `[N, 4]` | rotations w, x, y, z of length 1 |
    /// | `scales` | `[N, 3]` | standard deviations along the axes in world units |
    /// | `opacities` | `[N]` | 0 to 1 |
    /// | `sh` | `[N, K, 3]` | spherical harmonics in the order and with the signs of 3DGS, `K = (degree + 1)²`; RGB last |
    /// | `colours` | `[N, 3]` | `0.5 + 0.2820948 sh[:, 0]`, the part that does not depend on the direction, not clamped |
    /// | `masks` | `[N, 3]` | probabilities of the mask: static, brightness, dynamic; if there is a mask |
    /// | `time_centres` | `[N]` | times of the highest opacity; like the next two, only if Gaussians have lifetimes |
    /// | `durations` | `[N]` | in the time of the views, 0 to 1 |
    /// | `velocities` | `[N, 3]` | world units per unit of time |
    pub fn to_arrays(&self) -> Vec<NamedArray> {
        let count = self.len();
        let array = |name: &'static str, row: &[usize], values: Vec<f32>| NamedArray {
            name,
            shape: [&[count], row].concat(),
            values,
        };
        let activated = |logits: &mut dyn Iterator<Item = f32>| logits.map(|logit| sigmoid(logit) as f32).collect();
        let unit = |&quaternion: &[f32; 4]| unit_quaternion(quaternion).map(|part| part as f32);
        let coefficients = (self.sh_degree + 1).pow(2);
        let sh = self.sh_dc.iter().enumerate().flat_map(|(row, dc)| dc.iter().chain(self.rest(row))).copied();
        let mut arrays = vec![
            array("means", &[3], self.means.as_flattened().to_vec()),
            array("quaternions", &[4], self.quaternions.iter().flat_map(unit).collect()),
            array("scales", &[3], self.log_scales.as_flattened().iter().map(|log| log.exp()).collect()),
            array("opacities", &[], activated(&mut self.opacity_logits.iter().copied())),
            array("sh", &[coefficients, 3], sh.collect()),
            array("colours", &[3], self.sh_dc.as_flattened().iter().map(|dc| 0.5 + SH_C0 * dc).collect()),
        ];
        if let Some(masks) = &self.mask_logits {
            arrays.push(array("masks", &[3], activated(&mut masks.as_flattened().iter().copied())));
        }
        if let Some(lifetimes) = &self.lifetimes {
            arrays.push(array("time_centres", &[], lifetimes.iter().map(|life| life.centre).collect()));
            arrays.push(array("durations", &[], lifetimes.iter().map(|life| life.log_duration.exp()).collect()));
            arrays.push(array("velocities", &[3], lifetimes.iter().flat_map(|life| life.velocity).collect()));
        }
        arrays
    }
}

#[cfg(test)]
mod tests {
    use super::super::gaussian_cloud::Lifetime;
    use super::*;

    fn cloud() -> GaussianCloud {
        GaussianCloud {
            sh_degree: 1,
            means: vec![[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]],
            sh_dc: vec![[0.0, 1.0, -1.0], [0.5; 3]],
            sh_rest: (10..28).map(|value| value as f32).collect(),
            opacity_logits: vec![0.0, 3.0],
            log_scales: vec![[0.0, 1.0, -1.0], [2.0; 3]],
            quaternions: vec![[0.0, 3.0, 0.0, 4.0], [0.0; 4]],
            mask_logits: Some(vec![[0.0; 3], [-3.0, 0.0, 3.0]]),
            lifetimes: Some(vec![Lifetime { centre: 0.5, log_duration: 0.0, velocity: [7.0, 8.0, 9.0] }; 2]),
        }
    }

    fn values(cloud: &GaussianCloud, name: &str) -> (Vec<usize>, Vec<f32>) {
        let found = cloud.to_arrays().into_iter().find(|array| array.name == name).expect(name);
        (found.shape, found.values)
    }

    #[test]
    fn values_are_activated_and_have_as_many_rows_as_there_are_gaussians() {
        let cloud = cloud();
        for array in cloud.to_arrays() {
            assert_eq!(array.shape[0], 2, "{}", array.name);
            assert_eq!(array.shape.iter().product::<usize>(), array.values.len(), "{}", array.name);
        }
        assert_eq!(values(&cloud, "quaternions").1, [0.0, 0.6, 0.0, 0.8, 1.0, 0.0, 0.0, 0.0]);
        assert_eq!(values(&cloud, "scales").1[..2], [1.0, 1.0_f32.exp()]);
        assert_eq!(values(&cloud, "opacities"), (vec![2], vec![0.5, sigmoid(3.0) as f32]));
        assert_eq!(values(&cloud, "masks").1[3..], [-3.0, 0.0, 3.0].map(|logit| sigmoid(logit) as f32));
        assert_eq!(values(&cloud, "durations").1, [1.0, 1.0]);
    }

    #[test]
    fn colours_have_the_channel_last_and_the_constant_part_first() {
        let (shape, sh) = values(&cloud(), "sh");
        assert_eq!(shape, [2, 4, 3]);
        assert_eq!(sh[..6], [0.0, 1.0, -1.0, 10.0, 11.0, 12.0]);
        assert_eq!(sh[12..16], [0.5, 0.5, 0.5, 19.0]);
        assert_eq!(values(&cloud(), "colours").1[..3], [0.5, 0.5 + SH_C0, 0.5 - SH_C0]);
    }

    #[test]
    fn what_a_cloud_has_not_is_left_out() {
        let plain = GaussianCloud { mask_logits: None, lifetimes: None, ..cloud() };
        let names: Vec<&str> = plain.to_arrays().iter().map(|array| array.name).collect();
        assert_eq!(names, ["means", "quaternions", "scales", "opacities", "sh", "colours"]);
    }
}
