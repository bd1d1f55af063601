//! Definitions of the metrics, as in docs/evaluation.md, and the reasons why one may be absent.

use std::collections::BTreeMap;

use mvfusion_model::evaluation::{Backbone, InputRange, Metric, Protocol};

use crate::run::LpipsWeights;

/// The definition of a metric, in one sentence.
pub(super) fn meaning(metric: Metric) -> &'static str {
    match metric {
        Metric::Psnr => "PSNR in dB of renders rounded to 8 bits, over all pixels and channels",
        Metric::PsnrExact => "PSNR in dB of unrounded renders",
        Metric::Ssim => "SSIM with an 11-pixel Gaussian window of sigma 1.5 and zero padding, mean of the map (3DGS)",
        Metric::SsimValid => "SSIM without the 5 outermost pixels (scikit-image, torchmetrics, nerfbaselines)",
        Metric::MsSsim => "MS-SSIM as in pytorch-msssim, five scales",
        Metric::DSsim => "(1 - MS-SSIM) / 2",
        Metric::Lpips(variant) => match (variant.backbone, variant.range) {
            (Backbone::Alex, InputRange::Signed) => "LPIPS v0.1 with AlexNet, inputs in [-1, 1] as intended",
            (Backbone::Vgg, InputRange::Signed) => "LPIPS v0.1 with VGG-16, inputs in [-1, 1] as intended",
            (Backbone::Alex, InputRange::Raw) => {
                "LPIPS v0.1 with AlexNet, inputs in [0, 1] as in the code of 3DGS\u{2019} descendants"
            }
            (Backbone::Vgg, InputRange::Raw) => "LPIPS v0.1 with VGG-16, inputs in [0, 1] as in the code of 3DGS",
        },
    }
}

/// Why no layer has a metric. `lpips` contains the weights of the networks, if the run recorded them.
pub(super) fn why_absent(metric: Metric, lpips: &BTreeMap<String, LpipsWeights>) -> String {
    match metric {
        Metric::MsSsim | Metric::DSsim => "needs images of more than 160 pixels on each side".to_owned(),
        Metric::Lpips(variant) => why_no_lpips(variant.backbone, lpips.get(variant.backbone.name())),
        _ => "not written by this run\u{2019}s version".to_owned(),
    }
}

fn why_no_lpips(backbone: Backbone, weights: Option<&LpipsWeights>) -> String {
    match (weights, backbone) {
        // The weights were given, so the images are too small for the network.
        (Some(LpipsWeights::WeightsSha256(_)), Backbone::Alex) => {
            "needs images of at least 31 pixels on each side".to_owned()
        }
        (Some(LpipsWeights::WeightsSha256(_)), Backbone::Vgg) => {
            "needs images of at least 16 pixels on each side".to_owned()
        }
        (Some(LpipsWeights::Absent(reason)), _) => format!("{reason}, see docs/evaluation.md"),
        (None, _) => "the network weights were not given, see docs/evaluation.md".to_owned(),
    }
}

/// The protocol of a run, from its statement. A statement of another version selects the protocol of the same name. An
/// unknown name selects this program's own protocol, which has every metric.
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
        assert_eq!(why(LpipsVariant::ALEX, &lpips), "needs images of at least 31 pixels on each side");
        assert_eq!(why(LpipsVariant::VGG_RAW, &lpips), "/weights has no such file, see docs/evaluation.md");
        let lpips = BTreeMap::from([("vgg".to_owned(), given)]);
        assert_eq!(why(LpipsVariant::VGG, &lpips), "needs images of at least 16 pixels on each side");
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
