//! Files of other versions, for other configurations and scenes, and models that another training starts from.

use super::parts::Parts;
use super::{BYTES, DONE, Specimen, config, refusal_of, scene};
use crate::config::{Branches, Config};
use crate::device::flex;
use crate::train::{Checkpoint, TrainState, Trainer, parameter_hash};

/// The same state as the first version wrote it.
fn first_version() -> Parts {
    let mut parts = Parts::of(&BYTES);
    parts.metadata.clear();
    let header = parts.header.as_object_mut().expect("an object");
    for field in ["grid_layout", "bad_steps"] {
        header.remove(field).expect("a field of this version");
    }
    parts
}

#[test]
fn a_file_of_the_first_version_is_still_read() {
    let specimen = Specimen::new();
    let hash = |bytes: &[u8]| {
        let state = TrainState::load(specimen.write(bytes), &config(), &flex().autodiff()).expect("it is read");
        assert_eq!(state.completed, DONE);
        parameter_hash(&state.model).expect("the device hands its numbers back")
    };
    assert_eq!(hash(&first_version().without_checksum()), hash(&BYTES));
}

#[test]
fn a_file_of_the_first_version_is_checked_like_the_others() {
    let (specimen, mut parts) = (Specimen::new(), first_version());
    let last = parts.tensors["static.sh_dc"].bytes.len() - 4;
    parts.tensor("static.sh_dc").bytes[last..].copy_from_slice(&f32::NAN.to_le_bytes());
    let said = specimen.refusal(&parts.without_checksum()).expect("it is refused");
    assert!(said.contains("`static.sh_dc` is not finite"), "{said}");
}

#[test]
fn a_newer_version_is_refused_by_name() {
    let (specimen, mut parts) = (Specimen::new(), Parts::of(&BYTES));
    parts.metadata.insert("schema".to_owned(), "3".to_owned());
    parts.header = serde_json::json!({"quite": "another"});
    for bytes in [parts.bytes(), parts.without_checksum()] {
        let said = specimen.refusal(&bytes).expect("it is refused");
        assert!(said.contains("schema 3") && said.contains("up to schema 2"), "{said}");
    }
}

#[test]
fn a_file_that_has_lost_its_checksum_or_its_number_is_refused() {
    let (specimen, parts) = (Specimen::new(), Parts::of(&BYTES));
    let said = specimen.refusal(&parts.without_checksum()).expect("it is refused");
    assert!(said.contains("`schema` is 2, but its checksum is not at the beginning"), "{said}");
    let mut numberless = parts.clone();
    numberless.metadata.clear();
    let said = specimen.refusal(&numberless.bytes()).expect("it is refused");
    assert!(said.contains("no `schema`"), "{said}");
    for number in ["two", "-1", "", "1"] {
        let mut parts = parts.clone();
        parts.metadata.insert("schema".to_owned(), number.to_owned());
        let said = specimen.refusal(&parts.bytes()).unwrap_or_else(|| panic!("the schema {number} is accepted"));
        assert!(said.contains("`schema`"), "{said}");
    }
}

/// A change of the configuration, and what the refusal says.
type Change = (fn(&mut Config), &'static str);

#[test]
fn another_configuration_is_refused_with_both_values() {
    let specimen = Specimen::new();
    let path = specimen.write(&BYTES);
    let changes: [Change; 8] = [
        (|config| config.model.sh_degree = 0, "`dynamic.sh_rest` has the shape [10, 9] instead of [10, 0]"),
        (|config| config.model.grid.resolution = [4, 3, 5, 6], "`model.grid.resolution` = [4, 3, 5, 6]"),
        (|config| config.model.width = 5, "`network.trunk.layers.0.weight` has the shape [4, 4] instead of [4, 5]"),
        (|config| config.model.branches = Branches::Dynamic, "`sh_degrees` has 2 branches, the configuration 1"),
        (|config| config.model.lifetime = false, "`dynamic."),
        (|config| config.model.exposure = false, "`exposures.departures`"),
        (|config| config.motion.hidden = 5, "`refinement."),
        (|config| config.train.stages.refinement.0 = 0, "`completed` is 5, but the training has 4 steps"),
    ];
    for (change, words) in changes {
        let mut config = config();
        change(&mut config);
        let said = refusal_of(path, &config).unwrap_or_else(|| panic!("{words}: accepted"));
        assert!(said.contains(words), "{words}: {said}");
    }
}

#[test]
fn a_state_does_not_continue_on_a_scene_with_other_views_or_cameras() {
    let specimen = Specimen::new();
    let device = flex().autodiff();
    let state = || TrainState::load(specimen.write(&BYTES), &config(), &device).expect("it is whole");
    let refusal = |views: usize| {
        let mut scene = scene();
        scene.train.truncate(views);
        Trainer::with_state(config(), &scene, &device, state()).err().map(|error| error.to_string())
    };
    assert_eq!(refusal(usize::MAX), None);
    assert!(refusal(2).is_some_and(|said| said.contains("it has 2 training views, the state view")));
}

#[test]
fn a_training_starts_from_the_weights_of_another() {
    let (specimen, mut other) = (Specimen::new(), config());
    (other.seed, other.train.stages) = (9, crate::config::StageConfig::of([1, 1, 1]));
    // Shorter than the training of the checkpoint, which resuming would refuse.
    let checkpoint = Checkpoint::open(specimen.write(&BYTES)).expect("it is whole");
    assert_eq!(checkpoint.steps(), DONE);
    let weights = checkpoint.weights(&other, &flex().autodiff()).expect("it fits");
    let hash = parameter_hash(&weights.model).expect("the device hands its numbers back");
    let state = TrainState::with_weights(weights, &other, &scene());
    assert!(state.completed == 0 && state.optimiser.moments.is_empty());
    assert_eq!(parameter_hash(&state.model).expect("the device hands its numbers back"), hash);
    let mut trainer = Trainer::with_state(other, &scene(), &flex().autodiff(), state).expect("it can start");
    while trainer.step().expect("a step succeeds").is_some() {}
    assert_ne!(parameter_hash(&trainer.state().model).expect("the device hands its numbers back"), hash);
}
