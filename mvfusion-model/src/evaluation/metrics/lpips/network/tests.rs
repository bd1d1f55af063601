//! Small random networks against loops over all values.

use burn::tensor::Device;

use super::*;
use crate::evaluation::metrics::lpips::layout::{Backbone, ConvolutionLayout, StageLayout};
use crate::evaluation::metrics::lpips::source::Noise;
use crate::random::Stream;
use crate::test_support::{for_each_device, picture, values};

/// Tolerance of means: single precision through a few layers, on values of size one.
const MEANS: f64 = 2e-5;

/// Tolerance of single pixels: if all features of a pixel are small, rounding changes their direction.
const PIXELS: f64 = 1e-3;

/// A convolution of the small network: channels in and out, kernel, stride, padding.
type Layer = [usize; 5];

/// Two stages like VGG's, which can be computed in bands, and two like AlexNet's; each with the side of its pooling
/// window.
const STAGES: [(&[Layer], Option<usize>); 4] = [
    (&[[3, 4, 3, 1, 1], [4, 5, 3, 1, 1]], Some(2)),
    (&[[5, 4, 5, 1, 2]], Some(2)),
    (&[[4, 6, 3, 2, 0]], Some(3)),
    (&[[6, 3, 3, 1, 1]], None),
];

/// A feature map on the host.
#[derive(Clone)]
struct Plane {
    channels: usize,
    height: usize,
    width: usize,
    values: Vec<f64>,
}

impl Plane {
    fn of(tensor: Tensor<4>) -> Self {
        let [_, channels, height, width] = tensor.dims();
        Self { channels, height, width, values: values(tensor) }
    }

    fn at(&self, channel: usize, y: usize, x: usize) -> f64 {
        self.values[(channel * self.height + y) * self.width + x]
    }

    /// A map of the given size from its value at each channel and pixel.
    fn made(channels: usize, height: usize, width: usize, value: impl Fn(usize, usize, usize) -> f64) -> Self {
        let plane = height * width;
        let values = (0..channels * plane).map(|i| value(i / plane, i % plane / width, i % width)).collect();
        Self { channels, height, width, values }
    }

    fn convolved(&self, convolution: &Conv2d) -> Self {
        let [outputs, inputs, kernel, _] = convolution.weight.dims();
        let [_, stride, padding] = along_rows(convolution);
        let weight = values(convolution.weight.val());
        let bias = values(convolution.bias.as_ref().expect("a bias").val());
        let size = |side: usize| (side + 2 * padding - kernel) / stride + 1;
        Self::made(outputs, size(self.height), size(self.width), |output, y, x| {
            let mut sum = bias[output];
            for (input, v, u) in
                (0..inputs * kernel * kernel).map(|i| (i / (kernel * kernel), i / kernel % kernel, i % kernel))
            {
                let (y, x) = ((y * stride + v).wrapping_sub(padding), (x * stride + u).wrapping_sub(padding));
                if y < self.height && x < self.width {
                    sum += weight[((output * inputs + input) * kernel + v) * kernel + u] * self.at(input, y, x);
                }
            }
            sum.max(0.0)
        })
    }

    fn pooled(&self, side: usize) -> Self {
        let size = |length: usize| (length - side) / 2 + 1;
        Self::made(self.channels, size(self.height), size(self.width), |channel, y, x| {
            let window = (0..side * side).map(|i| self.at(channel, 2 * y + i / side, 2 * x + i % side));
            window.fold(f64::MIN, f64::max)
        })
    }

    /// Weighted squared difference of unit vectors at each pixel.
    fn distance(&self, other: &Self, weight: &[f64]) -> Self {
        let length = |plane: &Self, y, x| (0..plane.channels).map(|c| plane.at(c, y, x).powi(2)).sum::<f64>().sqrt();
        Self::made(1, self.height, self.width, |_, y, x| {
            let (own, others) = (length(self, y, x) + 1e-10, length(other, y, x) + 1e-10);
            let squared = |c: usize| (self.at(c, y, x) / own - other.at(c, y, x) / others).powi(2);
            weight.iter().enumerate().map(|(c, weight)| weight * squared(c)).sum()
        })
    }

    fn mean(&self) -> f64 {
        self.values.iter().sum::<f64>() / self.values.len() as f64
    }
}

fn network(stream: &mut Stream, device: &Device) -> Lpips {
    let layout = |(layers, pool): (&[Layer], Option<usize>)| StageLayout {
        convolutions: layers
            .iter()
            .enumerate()
            .map(|(number, &[inputs, outputs, kernel, stride, padding])| ConvolutionLayout {
                number,
                channels: [inputs, outputs],
                kernel,
                stride,
                padding,
            })
            .collect(),
        pool,
    };
    Lpips::build(&STAGES.map(layout), &mut Noise { stream, device }).expect("noise is always there")
}

/// LPIPS by loops, and the map of each stage.
fn slow(network: &Lpips, pictures: [&Tensor<4>; 2], range: InputRange) -> Vec<Plane> {
    let fed = |picture: &Tensor<4>| {
        let plane = Plane::of(picture.clone());
        Plane::made(3, plane.height, plane.width, |c, y, x| {
            let value = plane.at(c, y, x);
            let value = if range == InputRange::Signed { 2.0 * value - 1.0 } else { value };
            (value - [-0.030, -0.088, -0.188][c]) / [0.458, 0.448, 0.450][c]
        })
    };
    let [mut a, mut b] = pictures.map(fed);
    let mut maps = Vec::new();
    for (stage, (_, pool)) in network.stages.iter().zip(STAGES) {
        for convolution in &stage.convolutions {
            [a, b] = [a.convolved(convolution), b.convolved(convolution)];
        }
        maps.push(a.distance(&b, &values(stage.weight.val())));
        if let Some(side) = pool {
            [a, b] = [a.pooled(side), b.pooled(side)];
        }
    }
    maps
}

/// A map by bilinear interpolation between pixel centres.
fn enlarged(map: &Plane, height: usize, width: usize) -> Plane {
    let place = |to: usize, large: usize, small: usize| {
        let at = ((to as f64 + 0.5) * small as f64 / large as f64 - 0.5).clamp(0.0, (small - 1) as f64);
        (at as usize, (at as usize + 1).min(small - 1), at.fract())
    };
    Plane::made(1, height, width, |_, y, x| {
        let (top, bottom, down) = place(y, height, map.height);
        let (left, right, along) = place(x, width, map.width);
        let row = |y: usize| map.at(0, y, left) * (1.0 - along) + map.at(0, y, right) * along;
        row(top) * (1.0 - down) + row(bottom) * down
    })
}

fn assert_close(found: &[f64], wanted: &[f64], tolerance: f64, what: &str) {
    assert_eq!(found.len(), wanted.len(), "{what}");
    let worst = found.iter().zip(wanted).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(worst < tolerance, "{what}: off by {worst}");
}

#[test]
fn a_network_is_its_definition() {
    for_each_device(|device| {
        let mut stream = Stream::new(5, 0);
        let network = network(&mut stream, &device);
        for size in [[28, 28], [29, 41]] {
            let pictures = [0; 3].map(|_| picture(&mut stream, size, &device));
            for range in [InputRange::Signed, InputRange::Raw] {
                let batch = Tensor::cat(pictures.to_vec(), 0);
                let found = network.distances(batch, range, &[(0, 2), (1, 1)]).expect("large enough");
                let wanted = slow(&network, [&pictures[0], &pictures[2]], range);
                for (map, wanted) in found[0].maps.iter().zip(&wanted) {
                    assert_close(&values(map.clone()), &wanted.values, PIXELS, &format!("map at {size:?}, {range:?}"));
                }
                let total: f64 = wanted.iter().map(Plane::mean).sum();
                assert_close(&values(found[0].value()), &[total], MEANS, "value");
                let [height, width] = size;
                let large: Vec<Plane> = wanted.iter().map(|map| enlarged(map, height, width)).collect();
                let sum: Vec<f64> = (0..height * width).map(|i| large.iter().map(|map| map.values[i]).sum()).collect();
                assert_close(&values(found[0].spatial(size)), &sum, PIXELS, "enlarged map");
                assert_eq!(values(found[1].value()), [0.0], "a picture is like itself");
            }
        }
    });
}

#[test]
fn bands_change_nothing() {
    for_each_device(|device| {
        let mut stream = Stream::new(6, 0);
        let network = network(&mut stream, &device);
        let pairs = [(0, 1)];
        for height in [8, 9, 21] {
            let size = [height, 13];
            let pictures = Tensor::cat([0; 2].map(|_| picture(&mut stream, size, &device)).to_vec(), 0);
            let stage = &network.stages[0];
            let whole = stage.forward(pictures.clone(), &pairs, usize::MAX);
            for budget in [1, 4 * 4 * 2 * 13 * 5] {
                let cut = stage.forward(pictures.clone(), &pairs, budget);
                assert_close(&values(cut.maps[0].clone()), &values(whole.maps[0].clone()), PIXELS, "map");
                assert_close(&values(cut.pooled), &values(whole.pooled.clone()), MEANS, "features");
            }
        }
    });
}

#[test]
fn bands_cover_all_rows_and_begin_at_even_ones() {
    assert_eq!(bands(9, 4), [0..4, 4..9]);
    assert_eq!(bands(10, 5), [0..4, 4..8, 8..10]);
    assert_eq!(bands(3, 0), std::iter::once(0..3).collect::<Vec<_>>());
    assert_eq!(bands(1, 8), std::iter::once(0..1).collect::<Vec<_>>());
}

#[test]
fn pictures_that_shrink_to_nothing_have_no_distance() {
    for (backbone, least) in [(Backbone::Alex, 31), (Backbone::Vgg, 16)] {
        for_each_device(|device| {
            let network = Lpips::random(backbone, &mut Stream::new(7, 0), &device);
            let distances = |side: usize| {
                let pictures = Tensor::zeros([2, 3, side, 40], &device);
                network.distances(pictures, InputRange::Signed, &[(0, 1)])
            };
            assert!(distances(least - 1).is_none(), "{backbone:?}");
            assert_eq!(values(distances(least).expect("large enough")[0].value()), [0.0]);
        });
    }
}
