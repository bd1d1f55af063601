//! What the metrics are, in the words of docs/evaluation.md, and why one may be absent.

use std::collections::BTreeMap;

use mvfusion_model::evaluation::{Backbone, InputRange, Metric, Protocol};

use crate::run::LpipsWeights;

/// What a metric is, in a sentence.
pub(super) fn meaning(metric: Metric) -> &'static str {
    match metric {
        Metric::Psnr => "PSNR in dB of pictures rounded to 8 bits, all pixels and channels",
        Metric::PsnrExact => "PSNR in dB of pictures as rendered",
        Metric::Ssim => {
            "SSIM, 11-pixel Gaussian window of sigma 1.5, zeros outside the picture, mean of the map (3DGS)"
        }
        Metric::SsimValid => "SSIM without the 5 outermost pixels (scikit-image, torchmetrics, nerfbaselines)",
        Metric::MsSsim => "MS-SSIM of pytorch-msssim, five scales",
        Metric::DSsim => "(1 - MS-SSIM) / 2",
        Metric::Lpips(variant) => match (variant.backbone, variant.range) {
            (Backbone::Alex, InputRange::Signed) => "LPIPS v0.1 by AlexNet, fed [-1, 1] as it should be",
            (Backbone::Vgg, InputRange::Signed) => "LPIPS v0.1 by VGG-16, fed [-1, 1] as it should be",
            (Backbone::Alex, InputRange::Raw) => {
                "LPIPS v0.1 by AlexNet, fed [0, 1] as by the code of 3DGS\u{2019} descendants"
            }
            (Backbone::Vgg, InputRange::Raw) => "LPIPS v0.1 by VGG-16, fed [0, 1] as by the code of 3DGS",
        },
    }
}

/// Why no layer has a metric; `lpips` is what the networks were given, as far as the run has noted it.
pub(super) fn why_absent(metric: Metric, lpips: &BTreeMap<String, LpipsWeights>) -> String {
    match metric {
        Metric::MsSsim | Metric::DSsim => "of pictures of more than 160 pixels a side".to_owned(),
        Metric::Lpips(variant) => why_no_lpips(variant.backbone, lpips.get(variant.backbone.name())),
        _ => "not written by this run\u{2019}s version".to_owned(),
    }
}

fn why_no_lpips(backbone: Backbone, weights: Option<&LpipsWeights>) -> String {
    match (weights, backbone) {
        // A network that was there has been shown pictures that it shrinks to nothing.
        (Some(LpipsWeights::WeightsSha256(_)), Backbone::Alex) => "of pictures of at least 31 pixels a side".to_owned(),
        (Some(LpipsWeights::WeightsSha256(_)), Backbone::Vgg) => "of pictures of at least 16 pixels a side".to_owned(),
        (Some(LpipsWeights::Absent(reason)), _) => format!("{reason}, see docs/evaluation.md"),
        (None, _) => "by networks whose weights were not given, see docs/evaluation.md".to_owned(),
    }
}

/// The protocol that a run followed, by what its metrics are said to mean; where that is of another version, the one of
/// the same name, and where there is none, this program's own, which names every metric.
pub(super) fn protocol_of(statement: &str) -> Protocol {
    let named = |protocol: &Protocol| {
        let rest = statement.strip_prefix(protocol.name());
        rest.is_some_and(|rest| rest.starts_with(['-', ':']))
    };
    Protocol::ALL.into_iter().find(named).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use mvfusion_model::evaluation::LpipsVariant;

    use super::*;

    #[test]
    fn lpips_is_absent_for_want_of_weights_or_of_pixels() {
        let given = LpipsWeights::WeightsSha256("0".to_owned());
        let missing = LpipsWeights::Absent("/weights has no such file".to_owned());
        let lpips = BTreeMap::from([("alex".to_owned(), given.clone()), ("vgg".to_owned(), missing)]);
        let why = |variant, lpips: &BTreeMap<String, LpipsWeights>| why_absent(Metric::Lpips(variant), lpips);
        assert_eq!(why(LpipsVariant::ALEX, &lpips), "of pictures of at least 31 pixels a side");
        assert_eq!(why(LpipsVariant::VGG_RAW, &lpips), "/weights has no such file, see docs/evaluation.md");
        let lpips = BTreeMap::from([("vgg".to_owned(), given)]);
        assert_eq!(why(LpipsVariant::VGG, &lpips), "of pictures of at least 16 pixels a side");
        // A run of a version that did not note it.
        assert!(why(LpipsVariant::ALEX_RAW, &lpips).contains("weights were not given"));
    }

    #[test]
    fn protocols_are_known_by_what_they_say() {
        for protocol in Protocol::ALL {
            assert_eq!(protocol_of(protocol.statement()), protocol);
        }
        assert_eq!(protocol_of("mvfusion-1: an older sentence"), Protocol::Mvfusion);
        assert_eq!(protocol_of("3dgs: an older sentence"), Protocol::ThreeDgs);
        assert_eq!(protocol_of("<script>"), Protocol::Mvfusion);
    }

    #[test]
    fn every_metric_means_something_else() {
        let mut meanings: Vec<&str> = Metric::ALL.into_iter().map(meaning).collect();
        meanings.sort_unstable();
        meanings.dedup();
        assert_eq!(meanings.len(), Metric::ALL.len());
    }
}
