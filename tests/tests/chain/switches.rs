//! The ablation switches: each changes what it says and nothing else.

mod bench;
mod effects;
mod runs;

use burn::module::Module;
use mvfusion_model::config::{Descriptor, MotionConfig, Temporal};
use mvfusion_model::model::motion::MotionRefinement;
use mvfusion_model::model::network::{HeadChoice, Mlp};
use mvfusion_tests::{backends, numbers};

use bench::{ATTENTION, Bench, HIDDEN, Switch, WIDTH, defaults, with};
use effects::{
    average, convolution, momentary, neither, no_mfta, no_mvg, offsets, position, residual, self_attention, signed,
    sines, spatial, velocities,
};

/// Every kind of what MVG is shown.
const DESCRIPTORS: [Descriptor; 4] =
    [Descriptor::Variances, Descriptor::PositionVariance, Descriptor::Offsets, Descriptor::Momentary];

/// Every kind of what MFTA makes of tokens.
const TEMPORALS: [Temporal; 5] =
    [Temporal::Cross, Temporal::SelfAttention, Temporal::Average, Temporal::Convolution, Temporal::Spatial];

/// Parameters of a linear layer.
const fn linear(inputs: usize, outputs: usize) -> usize {
    (inputs + 1) * outputs
}

/// Width of a token, `H + 11`.
const TOKEN: usize = WIDTH + 11;

/// Parameters of an MLP behind `inputs`.
const fn mlp(inputs: usize) -> usize {
    linear(inputs, HIDDEN) + linear(HIDDEN, WIDTH)
}

/// MVG: 14 numbers, each beside its sines and cosines in four octaves.
const ENCODER: usize = mlp(14 * 9);
/// MFTA: query, key, value and MLP.
const CROSS: usize = attention(TOKEN);

/// MFTA with tokens of this width.
const fn attention(token: usize) -> usize {
    3 * linear(token, ATTENTION) + mlp(ATTENTION)
}

/// The rows of the paper's tables that differ in modules, and our forms: name, switches, parameters of the refinement.
const ROWS: [(&str, Switch, usize); 18] = [
    ("full model", |_| (), ENCODER + CROSS),
    ("w/o MVG & MFTA", neither, 0),
    ("w/o MVG", no_mvg, CROSS),
    ("position variance only", position, ENCODER + CROSS),
    ("w/o MFTA", no_mfta, ENCODER),
    ("self-attention", self_attention, ENCODER + CROSS),
    ("direct deformation magnitude", offsets, mlp(62) + CROSS),
    ("temporal averaging", average, ENCODER + mlp(TOKEN)),
    ("temporal convolution", convolution, ENCODER + linear(3 * TOKEN, ATTENTION) + mlp(ATTENTION)),
    ("six octaves", |motion| motion.octaves = 6, mlp(14 * 13) + CROSS),
    ("momentary", momentary, mlp(17 * 9) + CROSS),
    ("signed offset", signed, ENCODER + attention(TOKEN + 1)),
    ("sines of the offset", sines, ENCODER + attention(TOKEN + 9)),
    ("velocities", velocities, ENCODER + CROSS),
    ("velocities with sines", |motion| (velocities(motion), sines(motion)).0, ENCODER + attention(TOKEN + 9)),
    ("residual", residual, ENCODER + CROSS + 2 * TOKEN),
    ("spatial", spatial, ENCODER + CROSS),
    ("spatial with offsets", |motion| (spatial(motion), signed(motion)).0, ENCODER + attention(TOKEN + 3)),
];

fn bench() -> Bench {
    Bench::new(&(backends()[0].device)())
}

#[test]
fn a_variant_has_the_parameters_that_it_should() {
    let bench = bench();
    for (name, switch, expected) in ROWS {
        assert_eq!(bench.fresh(&with(switch)).0.num_params(), expected, "{name}");
    }
    let heads = HeadChoice { opacity: true, sh: false, masks: false };
    let bench = Bench::with_heads(heads, &(backends()[0].device)());
    let direct = with(|motion| (motion.descriptor, motion.mfta) = (Descriptor::Offsets, false));
    assert_eq!(bench.fresh(&direct).0.num_params(), mlp(11), "heads that are absent show nothing");
}

#[test]
fn every_variant_starts_as_the_base_deformation() {
    for backend in backends() {
        let bench = Bench::new(&(backend.device)());
        let base = bench.base();
        for (name, switch, _) in ROWS {
            let motion = with(switch);
            let (refinement, _) = bench.fresh(&motion);
            let refined = numbers(bench.refined(&refinement, bench.measure(&motion), &motion).joined());
            assert_eq!(refined, base, "{}: {name}", backend.name);
        }
    }
}

#[test]
fn a_switch_of_one_module_leaves_the_start_of_the_other_alone() {
    let bench = bench();
    let first = |refinement: &MotionRefinement| {
        let weights = |mlp: &Mlp| numbers(mlp.layers[0].weight.val());
        let guidance = refinement.guidance.as_ref().map(|module| weights(module.mlp()));
        (guidance, refinement.temporal.as_ref().map(|module| weights(module.mlp())))
    };
    let (full, behind) = bench.fresh(&defaults());
    assert!(first(&full).0.is_some() && first(&full).1.is_some());
    for descriptor in DESCRIPTORS {
        for temporal in TEMPORALS {
            let made = |mvg, mfta| bench.fresh(&MotionConfig { mvg, mfta, descriptor, temporal, ..defaults() });
            let (both, stream) = made(true, true);
            assert_eq!(stream, behind);
            assert_eq!(first(&made(true, false).0), (first(&both).0, None));
            assert_eq!(first(&made(false, true).0), (None, first(&both).1));
            let alone = |motion| first(&bench.fresh(&motion).0);
            assert_eq!(first(&both).0, alone(MotionConfig { descriptor, ..defaults() }).0);
            assert_eq!(first(&both).1, alone(MotionConfig { temporal, ..defaults() }).1);
        }
    }
}

#[test]
fn a_module_that_is_removed_is_as_one_that_was_never_there() {
    let bench = bench();
    for temporal in TEMPORALS {
        let on = MotionConfig { temporal, ..defaults() };
        let mut refinement = bench.awake(&on);
        refinement.temporal = None;
        let kept = numbers(bench.refined(&refinement, bench.measure(&on), &on).joined());
        assert_eq!(kept, bench.outcome(&with(|motion| motion.mfta = false)), "{temporal:?}");
        assert_ne!(kept, bench.outcome(&on), "{temporal:?}");
    }
}
