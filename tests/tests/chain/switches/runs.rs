//! Short runs of every variant: they learn, are saved under names of their own, and are refused as one another.

use std::path::Path;

use mvfusion_model::config::Config;
use mvfusion_model::model::DeformationLevel;
use mvfusion_model::train::{TrainState, Trainer};
use mvfusion_tests::{backends, numbers};

use super::bench::Switch;
use super::{ROWS, effects};
use crate::training::{config, hash, interrupted, scene, train};

/// The configuration of a short run with switches turned.
fn turned(switch: Switch) -> Config {
    let mut config = config();
    switch(&mut config.motion);
    config
}

fn started(config: &Config) -> Trainer {
    Trainer::new(config.clone(), &scene(), &(backends()[0].device)()).expect("the run can start")
}

/// The refinement's parameters in a file, but for biases and the number of a layer.
fn stored(path: &Path) -> Vec<String> {
    let bytes = std::fs::read(path).expect("the file is there");
    let length = u64::from_le_bytes(bytes[..8].try_into().expect("eight bytes"));
    let header: serde_json::Value = serde_json::from_slice(&bytes[8..8 + length as usize]).expect("a JSON header");
    let names = header.as_object().expect("an object").keys();
    let mut names: Vec<String> = names
        .filter_map(|name| name.strip_prefix("refinement.")?.strip_suffix(".weight").map(str::to_owned))
        .map(|name| name.split_once(".layers.").map_or(name.clone(), |(mlp, _)| mlp.to_owned()))
        .collect();
    names.sort();
    names.dedup();
    names
}

#[test]
fn every_variant_learns() {
    for (name, switch, parameters) in ROWS {
        let mut trainer = started(&turned(switch));
        while let Some(loss) = trainer.step().expect("a step succeeds") {
            assert!(numbers(loss.squared_error)[0].is_finite(), "{name}");
        }
        let model = trainer.state().model.plain();
        let at = |level| numbers(model.dynamic_at(0.4, level, trainer.render_context()).means);
        let (base, refined) = (at(DeformationLevel::Base), at(DeformationLevel::Refined));
        assert!(base.iter().chain(&refined).all(|value| value.is_finite()), "{name}");
        assert_eq!(base != refined, parameters > 0, "{name}");
    }
}

#[test]
fn a_file_says_which_variant_it_holds() {
    const ENCODER: &[&str] = &["encoder.mlp"];
    const ATTENTION: &[&str] = &["attention.key", "attention.mlp", "attention.query", "attention.value"];
    const SELF_ATTENTION: &[&str] =
        &["self_attention.key", "self_attention.mlp", "self_attention.query", "self_attention.value"];
    const SPATIAL: &[&str] = &["spatial.key", "spatial.mlp", "spatial.query", "spatial.value"];
    let variants: [(Switch, Vec<&[&str]>); 9] = [
        (|_| (), vec![ATTENTION, ENCODER]),
        (effects::no_mvg, vec![ATTENTION]),
        (effects::no_mfta, vec![ENCODER]),
        (effects::neither, vec![]),
        (effects::offsets, vec![ATTENTION, &["direct.mlp"]]),
        (effects::self_attention, vec![ENCODER, SELF_ATTENTION]),
        (effects::spatial, vec![ENCODER, SPATIAL]),
        (effects::average, vec![&["average.mlp"], ENCODER]),
        (effects::convolution, vec![&["convolution.mlp", "convolution.taps"], ENCODER]),
    ];
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("state.safetensors");
    for (switch, names) in variants {
        let state = started(&turned(switch)).state().clone();
        state.save(&path).expect("the state can be saved");
        assert_eq!(stored(&path), names.concat());
    }
    // The last file is one of convolution.
    let device = (backends()[0].device)().autodiff();
    let error = TrainState::load(&path, &turned(effects::average), &device).expect_err("another variant");
    assert!(error.to_string().contains("`refinement.average.mlp.layers.0.weight` is missing"), "{error}");
    // What a run does not have is not looked for: the paper's cheaper inference, and files of runs that kept it all.
    started(&config()).state().save(&path).expect("the state can be saved");
    for switch in [effects::no_mvg, effects::no_mfta, effects::neither] {
        TrainState::load(&path, &turned(switch), &device).expect("a smaller model is read from a larger file");
    }
}

#[test]
fn variants_survive_saving_and_loading() {
    for switch in [
        effects::offsets,
        effects::self_attention,
        effects::average,
        effects::convolution,
        effects::position,
        effects::momentary,
        effects::spatial,
        effects::residual,
    ] {
        let config = turned(switch);
        let mut whole = started(&config);
        train(&mut whole);
        let resumed = interrupted(&config, &[22, 29], &scene(), &(backends()[0].device)());
        assert_eq!(hash(&resumed), hash(&whole), "{:?}", config.motion);
        assert_eq!(resumed.state().normalisers, whole.state().normalisers);
    }
}

#[test]
fn contradictions_are_refused_before_anything_is_read() {
    let contradictions: [(Switch, &str); 4] = [
        (|motion| (motion.mvg, motion.descriptor) = (false, super::DESCRIPTORS[1]), "motion.descriptor"),
        (|motion| (motion.mfta, motion.temporal) = (false, super::TEMPORALS[1]), "motion.temporal"),
        (|motion| (motion.include_self, motion.temporal) = (true, super::TEMPORALS[2]), "motion.include_self"),
        (
            |motion| {
                effects::full_window(motion);
                effects::convolution(motion);
            },
            "motion.tokens",
        ),
    ];
    for (switch, key) in contradictions {
        let started = Trainer::new(turned(switch), &scene(), &(backends()[0].device)());
        let error = started.expect_err("it is refused").to_string();
        assert!(error.starts_with(&format!("`{key}`")), "{error}");
    }
}
