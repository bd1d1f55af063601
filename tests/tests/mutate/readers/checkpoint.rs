//! The state of a training in a file.

use std::path::Path;

use mvfusion_cli::{config, run};
use mvfusion_model::train::{TrainState, TrainedModel};
use mvfusion_tests::backends;

use super::run::finished;
use super::{Answer, Room, Target, Targets, answer};
use crate::mutation::Kind;

/// The readers of this file.
pub const READERS: &[(&str, Targets)] = &[("checkpoint", checkpoints)];

/// The memory of a state: bytes, numbers and tensors of the same size, and the networks before they are filled.
const STATE: Room = Room { times: 20, fixed: 16 << 20 };

fn checkpoints(place: &Path) -> Vec<Target> {
    let run = finished(place);
    let config = config::read(&run.join(run::CONFIG)).expect("a configuration").scaled();
    let file = run.join(run::CHECKPOINTS).join(run::FINAL);
    let device = (backends()[0].device)();
    let path = file.clone();
    // To go on with a training, and to look at its model.
    let read = move || -> Answer {
        let state = TrainState::load(&path, &config, &device.clone().autodiff());
        answer(TrainedModel::load(&path, &config, &device)).and(answer(state))
    };
    assert_eq!(read(), Ok(Ok(())), "a sound checkpoint");
    vec![Target { file, kind: Kind::Safetensors, room: STATE, others: 0, read: Box::new(read) }]
}
