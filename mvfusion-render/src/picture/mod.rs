//! Images of bytes as planes of numbers.
//!
//! A GPU gets the bytes, and unpacks them. As numbers, they would take four times as long to reach it, and the host would
//! compute them while the GPU waits.

pub(crate) mod op;

use burn::tensor::{Device, Tensor, TensorData};

use crate::device::is_gpu;

/// Bytes `[H, W, C]` as planes `[1, C, H, W]` in `[0, 1]`, without autodiff.
///
/// # Panics
/// If there is another number of bytes.
pub fn planes(bytes: &[u8], [height, width, channels]: [usize; 3], device: &Device) -> Tensor<4> {
    assert_eq!(bytes.len(), height * width * channels, "an image of {height}x{width} with {channels} channels");
    let device = device.clone().inner();
    let shape = [1, channels, height, width];
    if is_gpu(&device) {
        return op::unpack(bytes, shape, &device);
    }
    Tensor::from_data(TensorData::new(unpacked(bytes, channels), shape), &device)
}

/// The planes of interleaved channels, one after another.
fn unpacked(bytes: &[u8], channels: usize) -> Vec<f32> {
    let plane = |channel: usize| bytes.iter().skip(channel).step_by(channels);
    let mut planes = Vec::with_capacity(bytes.len());
    (0..channels).for_each(|channel| planes.extend(plane(channel).map(|&byte| f32::from(byte) / f32::from(u8::MAX))));
    planes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_support::{for_each_device, numbers};

    #[test]
    fn planes_come_one_after_another() {
        let bytes = [0, 255, 51, 102, 153, 204];
        for_each_device(|device| {
            let planes = planes(&bytes, [1, 2, 3], &device);
            assert_eq!(planes.dims(), [1, 3, 1, 2]);
            let wanted = [0.0, 102.0, 255.0, 153.0, 51.0, 204.0].map(|level: f32| f64::from(level / 255.0));
            assert_eq!(numbers(planes), wanted);
        });
    }

    #[test]
    fn words_hold_the_same_bytes() {
        // Seven bytes are not whole words.
        let bytes: Vec<u8> = (0..=255).chain(0..7).collect();
        for_each_device(|device| {
            let wanted = unpacked(&bytes, 1).into_iter().map(f64::from).collect::<Vec<_>>();
            assert_eq!(numbers(op::unpack(&bytes, [1, 1, 1, bytes.len()], &device)), wanted);
        });
    }
}
