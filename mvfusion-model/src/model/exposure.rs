//! Affine colour maps of the training cameras.
//!
//! The cameras of a real rig differ in white balance and gain. Without these maps, the spherical harmonics learn the
//! differences as view dependence, and a held-out camera renders a mixture of them. 3DGS calls this exposure
//! compensation and has one map per photo.

use burn::module::{Module, Param};
use burn::tensor::{DType, Device, Tensor, TensorData};

use crate::tensors::{from_data_like, rows_like};

/// One affine colour map per training camera. The mean over the cameras is the identity, so held-out cameras render the
/// scene's own colours.
#[derive(Module, Debug)]
pub struct Exposures {
    /// Departures from the identity, before their mean is subtracted: `[cameras, 3, 4]`, one row per channel, the
    /// offset last.
    pub departures: Param<Tensor<3>>,
}

impl Exposures {
    /// The identity for this many cameras.
    pub fn new(cameras: usize, device: &Device, dtype: DType) -> Self {
        Self::from_departures(Tensor::zeros([cameras, 3, 4], (device, dtype)))
    }

    /// Maps that depart from the identity by these values, `[cameras, 3, 4]`, minus their mean.
    pub fn from_departures(departures: Tensor<3>) -> Self {
        Self { departures: Param::from_tensor(departures) }
    }

    /// The maps of some cameras: `[B, 3, 4]`.
    pub fn of(&self, cameras: &[usize]) -> Exposure {
        let departures = self.departures.val();
        let mean = departures.clone().mean_dim(0);
        let identity = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
        let identity: Tensor<3> = from_data_like(TensorData::new(identity.to_vec(), [1, 3, 4]), &departures);
        let rows = rows_like(cameras, &departures);
        Exposure((departures - mean).select(0, rows) + identity)
    }
}

/// The maps of a batch of views: `[B, 3, 4]`.
#[derive(Clone, Debug)]
pub struct Exposure(Tensor<3>);

impl Exposure {
    /// The scene's colours `[B, 3, H, W]`, mapped for the cameras of the views.
    pub fn of_colours(&self, colours: Tensor<4>) -> Tensor<4> {
        // No matrix product: a GPU's may round its operands to TF32.
        let column = |k: usize| self.0.clone().narrow(2, k, 1).unsqueeze_dim::<4>(3);
        let [red, green, blue] = [0, 1, 2].map(|k| column(k) * colours.clone().narrow(1, k, 1));
        red + green + blue + column(3)
    }

    /// The map of one of the views: `[3, 4]`.
    pub(crate) fn of_view(&self, view: usize) -> Tensor<2> {
        self.0.clone().narrow(0, view, 1).reshape([3, 4])
    }

    /// The same without autodiff.
    pub fn inner(self) -> Self {
        Self(self.0.inner())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::OptimConfig;
    use crate::random::Stream;
    use crate::test_support::{for_each_device, picture, values};
    use crate::train::optim::ModuleOptimiser;

    /// Departures of three cameras that add up to 0: a gain, its opposite, a mixture of channels with an offset.
    fn departures() -> Vec<f64> {
        let gain = [0.2, 0.0, 0.0, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 0.0, -0.1, 0.0];
        let mixture = [0.0, 0.1, 0.0, 0.05, -0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, -0.05];
        let opposite: Vec<f64> = gain.iter().zip(mixture).map(|(gain, mixture)| -gain - mixture).collect();
        [gain.to_vec(), opposite, mixture.to_vec()].concat()
    }

    fn exposures(departures: &[f64], device: &Device) -> Exposures {
        let data = TensorData::new(departures.to_vec(), [3, 3, 4]).convert_dtype(DType::F32);
        Exposures::from_departures(Tensor::from_data(data, device).autodiff())
    }

    #[test]
    fn a_camera_maps_colours_and_a_shift_of_all_cameras_changes_nothing() {
        for_each_device(|device| {
            let colours = picture(&mut Stream::new(1, 0), [2, 3], &device);
            let seen = |departures: &[f64]| {
                let colours = Tensor::cat(vec![colours.clone(), colours.clone()], 0).autodiff();
                values(exposures(departures, &device).of(&[2, 0]).of_colours(colours).inner())
            };
            let plain = values(colours.clone());
            let (own, shifted) = (departures(), departures().iter().map(|value| value + 0.3).collect::<Vec<_>>());
            let found = seen(&own);
            for (pixel, channel) in (0..6).flat_map(|pixel| (0..3).map(move |channel| (pixel, channel))) {
                let of = |camera: usize, view: usize| {
                    let row = &own[camera * 12 + channel * 4..][..4];
                    let mixed: f64 = (0..3).map(|other| row[other] * plain[other * 6 + pixel]).sum();
                    let expected = plain[channel * 6 + pixel] + mixed + row[3];
                    let got = found[view * 18 + channel * 6 + pixel];
                    assert!((got - expected).abs() < 1e-6, "camera {camera}: {got} instead of {expected}");
                };
                of(2, 0);
                of(0, 1);
            }
            for (a, b) in found.iter().zip(seen(&shifted)) {
                assert!((a - b).abs() < 1e-6, "{a} became {b}");
            }
        });
    }

    #[test]
    fn what_cameras_make_of_colours_is_learned() {
        for_each_device(|device| {
            let mut stream = Stream::new(2, 0);
            let colours = Tensor::cat((0..3).map(|_| picture(&mut stream, [4, 5], &device)).collect(), 0);
            let seen = |exposures: &Exposures| exposures.of(&[0, 1, 2]).of_colours(colours.clone().autodiff());
            let photos = seen(&exposures(&departures(), &device)).inner();
            let mut learned = Exposures::new(3, &device.clone().autodiff(), DType::F32);
            let error =
                |learned: &Exposures| (seen(learned) - Tensor::from_inner(photos.clone())).powf_scalar(2.0).mean();
            let before = values(error(&learned).inner())[0];
            let mut optimiser = ModuleOptimiser::default();
            for _ in 0..150 {
                let mut gradients = error(&learned).backward();
                learned = optimiser.step("exposures", learned, &mut gradients, 5e-3, &OptimConfig::default());
            }
            let after = values(error(&learned).inner())[0];
            assert!(after < 0.01 * before, "the mean squared error fell from {before} to {after}");
        });
    }
}
