//! The metrics of a protocol for pairs of images, with the networks that they need.
//!
//! A metric has one map per image. Its mean over all pixels is the metric of the whole image; its mean over a region is
//! the metric inside or outside the dynamic region. The maps are the squared errors for PSNR, and the SSIM map. For
//! LPIPS, it is the sum of all layers' maps, resized to the image (`spatial=True` of the package lpips). Its mean
//! differs slightly from LPIPS, because resizing by a fraction weights pixels unequally. The SSIM without border uses
//! the region's pixels inside the border of the image.
//!
//! Windows and receptive fields therefore extend across the region's border. The alternative would be to black out both
//! images outside the region. But black pixels count as perfect, so the metric would mainly depend on the size of the
//! region. The outline would also be an edge that neither image has.

use std::collections::BTreeMap;
use std::path::Path;

use burn::tensor::{Device, Tensor};
use image::{GrayImage, RgbImage};
use mvfusion_data::files::read_bytes;

use super::layer_scores::LayerScores;
use super::metric::Metric;
use super::metrics::lpips::{Backbone, Distance, InputRange, Lpips, LpipsVariant};
use super::metrics::{
    PixelMap, Psnr, SSIM_BORDER, TemporalScores, decibels, dissimilarity, masked_psnr, ms_ssim, psnr, squared_errors,
    ssim_map,
};
use super::protocol::{Precision, Protocol};
use crate::ModelError;
use crate::files::sha256;
use crate::tensors;
use crate::train::picture_tensor;

/// Computes the metrics of a protocol. If weights of LPIPS are missing, its metrics are absent, and
/// [`Evaluator::missing`] has the reason.
#[derive(Debug)]
pub struct Evaluator {
    protocol: Protocol,
    /// The networks that the protocol needs, or the reason why one is missing.
    networks: BTreeMap<Backbone, Result<Loaded, String>>,
}

/// A network and the hash of its file.
#[derive(Debug)]
struct Loaded {
    network: Lpips,
    sha256: String,
}

/// A render and its ground truth, both in 8 bits and as tensors `[1, 3, H, W]` in `[0, 1]`.
#[derive(Clone, Debug)]
pub struct Pair {
    /// The rounded render.
    pub picture: RgbImage,
    /// The render in full precision.
    pub exact: Tensor<4>,
    /// The photo.
    pub reference: RgbImage,
    /// The photo on the device of `exact`.
    pub reference_exact: Tensor<4>,
}

/// Masks of the regions of an image.
#[derive(Clone, Debug)]
pub struct Regions {
    /// White where something moves.
    pub dynamic: GrayImage,
    /// White where nothing moves. Invalid pixels are in neither region.
    pub still: GrayImage,
    /// White on movers, which change their position; absent if unknown.
    pub movers: Option<GrayImage>,
}

/// The metrics of a view.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ViewMetrics {
    /// Of the whole image.
    pub whole: LayerScores,
    /// Of the dynamic region; absent without one, or if it is empty.
    pub dynamic: Option<LayerScores>,
    /// Of the rest.
    pub still: Option<LayerScores>,
    /// Of the movers; absent if they are unknown, or there are none.
    pub movers: Option<LayerScores>,
    /// Of the image and the previous frame.
    pub temporal: Option<TemporalScores>,
}

impl Loaded {
    fn open(backbone: Backbone, path: &Path, device: &Device) -> Result<Self, ModelError> {
        let read = |error: std::io::Error| ModelError::File {
            action: "read",
            path: path.to_owned(),
            reason: error.to_string(),
        };
        let sha256 = sha256(&read_bytes(path, Backbone::MOST_BYTES).map_err(read)?);
        Ok(Self { network: Lpips::load(backbone, path, device)?, sha256 })
    }
}

impl Pair {
    /// A pair of a render in both precisions and a photo.
    pub fn new(picture: RgbImage, exact: Tensor<4>, reference: RgbImage) -> Self {
        let reference_exact = picture_tensor(&reference, &exact.device());
        Self { picture, exact, reference, reference_exact }
    }

    /// The input of SSIM and LPIPS.
    fn seen(&self, precision: Precision) -> [Tensor<4>; 2] {
        let picture = match precision {
            Precision::Full => self.exact.clone(),
            Precision::EightBit => picture_tensor(&self.picture, &self.exact.device()),
        };
        [picture, self.reference_exact.clone()]
    }
}

/// The LPIPS distances of an image, by variant.
type Distances = Vec<(LpipsVariant, Distance)>;

/// The maps of an image, whose means are its metrics.
struct Maps<'a> {
    pair: &'a Pair,
    squared_errors: PixelMap,
    ssim: PixelMap,
    lpips: Distances,
}

impl Evaluator {
    /// An evaluator without networks and LPIPS.
    pub fn without_lpips(protocol: Protocol) -> Self {
        let reason = "no folder of weights was given";
        let networks = wanted(protocol).map(|backbone| (backbone, Err(reason.to_owned()))).collect();
        Self { protocol, networks }
    }

    /// An evaluator on `device`, with the protocol's networks whose weights are in a folder. [`Backbone::file_in`]
    /// lists their file names.
    ///
    /// # Errors
    /// If the folder does not exist, or a file in it cannot be read or is invalid.
    pub fn with_lpips(protocol: Protocol, weights: &Path, device: &Device) -> Result<Self, ModelError> {
        std::fs::read_dir(weights).map_err(|error| ModelError::File {
            action: "read",
            path: weights.to_owned(),
            reason: error.to_string(),
        })?;
        let network = |backbone: Backbone| match backbone.file_in(weights) {
            Some(path) => Loaded::open(backbone, &path, device).map(Ok),
            None => {
                Ok(Err(format!("{} has no lpips_{}_f32.safetensors or the like", weights.display(), backbone.name())))
            }
        };
        let networks = wanted(protocol).map(|backbone| Ok((backbone, network(backbone)?)));
        Ok(Self { protocol, networks: networks.collect::<Result<_, ModelError>>()? })
    }

    /// The protocol of the metrics.
    pub fn protocol(&self) -> Protocol {
        self.protocol
    }

    /// The loaded networks, each with the SHA-256 of its weights file.
    pub fn weights(&self) -> impl Iterator<Item = (Backbone, &str)> {
        self.networks.iter().filter_map(|(&backbone, network)| Some((backbone, network.as_ref().ok()?.sha256.as_str())))
    }

    /// The missing networks of the protocol, each with the reason.
    pub fn missing(&self) -> impl Iterator<Item = (Backbone, &str)> {
        self.networks.iter().filter_map(|(&backbone, network)| Some((backbone, network.as_ref().err()?.as_str())))
    }

    /// The metrics of a pair: for the whole image, by region, and relative to the frame `before`.
    ///
    /// # Errors
    /// If the device fails to return values.
    pub fn metrics(
        &self,
        pair: &Pair,
        before: Option<&Pair>,
        regions: Option<&Regions>,
    ) -> Result<ViewMetrics, ModelError> {
        let [picture, reference] = pair.seen(self.protocol.precision());
        let (lpips, temporal) = self.perceive(pair, before.filter(|_| self.protocol.compares_frames()))?;
        let maps = Maps {
            pair,
            squared_errors: squared_errors(pair.exact.clone(), pair.reference_exact.clone())?,
            ssim: ssim_map(picture.clone(), reference.clone())?,
            lpips,
        };
        let ms_ssim = ms_ssim(picture, reference)?;
        let part = |mask: &GrayImage| maps.part(mask);
        Ok(ViewMetrics {
            whole: LayerScores { ms_ssim, d_ssim: ms_ssim.map(dissimilarity), ..maps.whole()? },
            dynamic: regions.map(|regions| part(&regions.dynamic)).transpose()?.flatten(),
            still: regions.map(|regions| part(&regions.still)).transpose()?.flatten(),
            movers: regions.and_then(|regions| regions.movers.as_ref()).map(part).transpose()?.flatten(),
            temporal,
        })
    }

    /// The distances of the protocol's networks.
    fn perceive(&self, pair: &Pair, before: Option<&Pair>) -> Result<(Distances, Option<TemporalScores>), ModelError> {
        let precision = self.protocol.precision();
        let mut distances = Vec::new();
        let mut temporal = TemporalScores::default();
        for variant in self.protocol.lpips() {
            let Some(Ok(Loaded { network, .. })) = self.networks.get(&variant.backbone) else { continue };
            // Flicker is measured only with the networks' intended input range.
            let before = before.filter(|_| variant.range == InputRange::Signed);
            let mut pictures = pair.seen(precision).to_vec();
            let mut pairs = vec![(0, 1)];
            if let Some(before) = before {
                pictures.extend(before.seen(precision));
                pairs.extend([(0, 2), (1, 3)]);
            }
            let found = network.distances(Tensor::cat(pictures, 0), variant.range, &pairs);
            let mut found = found.into_iter().flatten();
            distances.extend(found.next().map(|distance| (variant, distance)));
            if let (Some(pictures), Some(photos)) = (found.next(), found.next()) {
                note(&mut temporal, variant.backbone, number(&pictures)?, number(&photos)?);
            }
        }
        Ok((distances, (temporal != TemporalScores::default()).then_some(temporal)))
    }
}

/// The networks that a protocol needs, without duplicates.
fn wanted(protocol: Protocol) -> impl Iterator<Item = Backbone> {
    Backbone::ALL.into_iter().filter(move |&backbone| protocol.lpips().any(|variant| variant.backbone == backbone))
}

/// LPIPS on the host.
fn number(distance: &Distance) -> Result<f64, ModelError> {
    Ok(tensors::read::<1, f64>(distance.value())?.into_iter().sum())
}

/// Records the distances of two consecutive renders and of their photos.
fn note(temporal: &mut TemporalScores, backbone: Backbone, pictures: f64, photos: f64) {
    let (flicker, consecutive) = match backbone {
        Backbone::Alex => (&mut temporal.t_lpips_alex, &mut temporal.consecutive_lpips_alex),
        Backbone::Vgg => (&mut temporal.t_lpips_vgg, &mut temporal.consecutive_lpips_vgg),
    };
    *flicker = Some((pictures - photos).abs());
    *consecutive = Some(pictures);
}

impl Maps<'_> {
    fn whole(&self) -> Result<LayerScores, ModelError> {
        let mut scores = LayerScores {
            psnr: psnr(&self.pair.picture, &self.pair.reference),
            psnr_exact: decibels(self.squared_errors.mean()),
            ssim: Some(self.ssim.mean()),
            ssim_valid: self.ssim.inner_mean(SSIM_BORDER),
            ..LayerScores::default()
        };
        for (variant, distance) in &self.lpips {
            *Metric::Lpips(*variant).place(&mut scores) = Some(number(distance)?);
        }
        Ok(scores)
    }

    /// The metrics where a mask is white; `None` if it is black everywhere. The SSIM without border excludes the
    /// image's border, which may leave no pixels. MS-SSIM multiplies the means of whole scales, so a region has none.
    fn part(&self, mask: &GrayImage) -> Result<Option<LayerScores>, ModelError> {
        let Some(squared_error) = self.squared_errors.mean_over(mask) else { return Ok(None) };
        let eight_bit: Psnr = masked_psnr(&self.pair.picture, &self.pair.reference, mask);
        let mut scores = LayerScores {
            psnr: eight_bit,
            psnr_exact: decibels(squared_error),
            ssim: self.ssim.mean_over(mask),
            ssim_valid: self.ssim.inner_mean_over(SSIM_BORDER, mask),
            ..LayerScores::default()
        };
        let size = [mask.height() as usize, mask.width() as usize];
        for (variant, distance) in &self.lpips {
            let map = PixelMap::read(distance.spatial(size))?;
            *Metric::Lpips(*variant).place(&mut scores) = map.mean_over(mask);
        }
        Ok(Some(scores))
    }
}

#[cfg(test)]
mod tests {
    use image::Luma;

    use super::*;
    use crate::evaluation::quantise;
    use crate::random::Stream;
    use crate::test_support::{for_each_device, picture};

    /// Large enough for AlexNet.
    const SIZE: [usize; 2] = [33, 40];

    fn pair(stream: &mut Stream, device: &Device) -> Pair {
        let [exact, photo] = [0; 2].map(|_| picture(stream, SIZE, device));
        let rounded = |picture: &Tensor<4>| quantise(picture.clone()).expect("numbers");
        Pair::new(rounded(&exact), exact, rounded(&photo))
    }

    /// An evaluator with a random AlexNet and no VGG-16.
    fn evaluator(protocol: Protocol, device: &Device) -> Evaluator {
        let mut evaluator = Evaluator::without_lpips(protocol);
        let network = Lpips::random(Backbone::Alex, &mut Stream::new(1, 0), device);
        evaluator.networks.insert(Backbone::Alex, Ok(Loaded { network, sha256: String::new() }));
        evaluator
    }

    #[test]
    fn without_weights_metrics_are_absent_and_the_reason_is_told() {
        let evaluator = Evaluator::without_lpips(Protocol::ThreeDgs);
        let missing: Vec<_> = evaluator.missing().collect();
        assert!(matches!(missing[..], [(Backbone::Vgg, reason)] if reason.contains("no folder")), "{missing:?}");
        for_each_device(|device| {
            let pair = pair(&mut Stream::new(2, 0), &device);
            let metrics = evaluator.metrics(&pair, Some(&pair), None).expect("numbers");
            assert_eq!((metrics.whole.lpips_vgg_raw, metrics.temporal), (None, None));
            assert!(metrics.whole.ssim.is_some() && metrics.dynamic.is_none());
        });
    }

    #[test]
    fn a_folder_without_a_network_leaves_it_out_and_no_folder_is_an_error() {
        let folder = tempfile::tempdir().expect("folder");
        for_each_device(|device| {
            let evaluator = Evaluator::with_lpips(Protocol::Mvfusion, folder.path(), &device).expect("a folder");
            let missing: Vec<_> = evaluator.missing().collect();
            assert_eq!(missing.len(), 2);
            assert!(missing[1].1.contains("lpips_vgg"), "{missing:?}");
            let nowhere = folder.path().join("nowhere");
            let said =
                Evaluator::with_lpips(Protocol::Mvfusion, &nowhere, &device).expect_err("no such folder").to_string();
            assert!(said.contains("nowhere"), "{said}");
        });
    }

    #[test]
    fn both_regions_together_are_the_picture() {
        let [height, width] = SIZE.map(|side| side as u32);
        let left = |x: u32| x < 12;
        let part = |is_in: fn(u32) -> bool| {
            GrayImage::from_fn(width, height, |x, _| Luma([if is_in(x) { u8::MAX } else { 0 }]))
        };
        let regions = Regions { dynamic: part(|x| x < 12), still: part(|x| x >= 12), movers: None };
        let share_of = |columns: std::ops::Range<u32>| {
            columns.clone().filter(|&x| left(x)).count() as f64 / f64::from(columns.end - columns.start)
        };
        let border = SSIM_BORDER as u32;
        let (share, inner_share) = (share_of(0..width), share_of(border..width - border));
        for_each_device(|device| {
            let pair = pair(&mut Stream::new(3, 0), &device);
            let metrics = evaluator(Protocol::Mvfusion, &device).metrics(&pair, None, Some(&regions)).expect("numbers");
            let (dynamic, still) = (metrics.dynamic.expect("white"), metrics.still.expect("white"));
            let error = |psnr: Option<f64>| 10f64.powf(-psnr.expect("they differ") / 10.0);
            for (metrics, share) in [
                ([dynamic.ssim, still.ssim, metrics.whole.ssim], share),
                ([dynamic.ssim_valid, still.ssim_valid, metrics.whole.ssim_valid], inner_share),
                ([dynamic, still, metrics.whole].map(|scores| Some(error(scores.psnr_exact))), share),
                ([dynamic, still, metrics.whole].map(|scores| Some(error(scores.psnr))), share),
            ] {
                let [inside, outside, whole] = metrics.map(|metric| metric.expect("known"));
                let together = share * inside + (1.0 - share) * outside;
                assert!((together - whole).abs() < 1e-6, "{inside} and {outside} are {together}, not {whole}");
            }
            assert!(dynamic.lpips_alex.is_some() && dynamic.lpips_vgg.is_none() && dynamic.ms_ssim.is_none());
            assert!(metrics.movers.is_none(), "nobody knows them");
            let movers = Some(regions.still.clone());
            let nothing = Regions { dynamic: GrayImage::new(width, height), movers, ..regions.clone() };
            let metrics = evaluator(Protocol::Mvfusion, &device).metrics(&pair, None, Some(&nothing)).expect("numbers");
            assert!(metrics.dynamic.is_none() && metrics.still.is_some() && metrics.movers == metrics.still);
        });
    }

    #[test]
    fn protocols_that_leave_out_the_border_know_the_ssim_of_a_region_inside_it() {
        let [height, width] = SIZE.map(|side| side as u32);
        let part = |is_in: fn(u32, u32) -> bool| {
            GrayImage::from_fn(width, height, |x, y| Luma([if is_in(x, y) { u8::MAX } else { 0 }]))
        };
        let regions = Regions { dynamic: part(|x, y| x < 9 && y == 7), still: part(|x, _| x < 5), movers: None };
        for_each_device(|device| {
            let pair = pair(&mut Stream::new(6, 0), &device);
            for protocol in [Protocol::DeGauss, Protocol::NerfBaselines] {
                let metrics = Evaluator::without_lpips(protocol).metrics(&pair, None, Some(&regions)).expect("numbers");
                let (dynamic, still) = (metrics.dynamic.expect("white"), metrics.still.expect("white"));
                // Four pixels of the row are inside the border.
                let [picture, reference] = pair.seen(protocol.precision());
                let map = ssim_map(picture, reference).expect("numbers");
                let wanted = map.mean_over(&part(|x, y| (5..9).contains(&x) && y == 7)).expect("white");
                let [all, found] = [dynamic.ssim, dynamic.ssim_valid].map(|ssim| ssim.expect("known"));
                assert!((found - wanted).abs() < 1e-6, "{}: {found} instead of {wanted}", protocol.name());
                assert!((all - found).abs() > 1e-6, "the border makes no difference");
                assert!(still.ssim.is_some() && still.ssim_valid.is_none(), "nothing of it lies inside the border");
            }
        });
    }

    #[test]
    fn flicker_is_what_the_pictures_change_beyond_the_photos() {
        for_each_device(|device| {
            let mut stream = Stream::new(4, 0);
            let [now, other] = [0; 2].map(|_| pair(&mut stream, &device));
            let evaluator = evaluator(Protocol::Mvfusion, &device);
            let temporal = |before: &Pair| evaluator.metrics(&now, Some(before), None).expect("numbers").temporal;
            let still = temporal(&now).expect("AlexNet is there");
            assert_eq!((still.t_lpips_alex, still.consecutive_lpips_alex), (Some(0.0), Some(0.0)));
            assert_eq!(still.t_lpips_vgg, None);
            // The renders change, the photos do not.
            let before =
                Pair { reference: now.reference.clone(), reference_exact: now.reference_exact.clone(), ..other };
            let moved = temporal(&before).expect("AlexNet is there");
            assert!(moved.t_lpips_alex > Some(0.0) && moved.t_lpips_alex == moved.consecutive_lpips_alex, "{moved:?}");
        });
    }

    #[test]
    fn a_protocol_of_8_bits_does_not_see_less_than_a_level() {
        for_each_device(|device| {
            let reference = pair(&mut Stream::new(5, 0), &device).reference;
            let almost = picture_tensor(&reference, &device) + 0.0015;
            let pair = Pair::new(quantise(almost.clone()).expect("numbers"), almost, reference);
            let whole = |protocol| evaluator(protocol, &device).metrics(&pair, None, None).expect("numbers").whole;
            let (rounded, exact) = (whole(Protocol::NerfBaselines), whole(Protocol::Mvfusion));
            assert_eq!((rounded.psnr, rounded.lpips_alex), (None, Some(0.0)));
            assert!(exact.psnr_exact.is_some() && exact.lpips_alex > Some(0.0));
        });
    }
}
