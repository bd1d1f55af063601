//! What each switch changes in what comes out, and what it does not.

use mvfusion_model::config::{
    Activation, Descriptor, FusionWeights, Interval, MotionConfig, Normalisation, Refinement, Spread, Temporal,
    TokenMode, TokenOffset, TokenValues,
};
use mvfusion_model::model::motion::SIGNATURE_WIDTH;

use super::bench::{Switch, defaults, disturbed, with};
use super::{DESCRIPTORS, bench};

pub fn no_mvg(motion: &mut MotionConfig) {
    motion.mvg = false;
}

pub fn no_mfta(motion: &mut MotionConfig) {
    motion.mfta = false;
}

pub fn neither(motion: &mut MotionConfig) {
    (motion.mvg, motion.mfta) = (false, false);
}

pub fn position(motion: &mut MotionConfig) {
    motion.descriptor = Descriptor::PositionVariance;
}

pub fn offsets(motion: &mut MotionConfig) {
    motion.descriptor = Descriptor::Offsets;
}

pub fn self_attention(motion: &mut MotionConfig) {
    motion.temporal = Temporal::SelfAttention;
}

pub fn average(motion: &mut MotionConfig) {
    motion.temporal = Temporal::Average;
}

pub fn convolution(motion: &mut MotionConfig) {
    motion.temporal = Temporal::Convolution;
}

pub fn sum(motion: &mut MotionConfig) {
    motion.refinement = Refinement::Sum;
}

pub fn full_window(motion: &mut MotionConfig) {
    motion.tokens = TokenMode::FullWindow;
}

pub fn momentary(motion: &mut MotionConfig) {
    motion.descriptor = Descriptor::Momentary;
}

pub fn signed(motion: &mut MotionConfig) {
    motion.token_offset = TokenOffset::Signed;
}

pub fn sines(motion: &mut MotionConfig) {
    motion.token_offset = TokenOffset::Sines;
}

pub fn velocities(motion: &mut MotionConfig) {
    motion.values = TokenValues::Velocities;
}

pub fn residual(motion: &mut MotionConfig) {
    motion.residual = true;
}

pub fn spatial(motion: &mut MotionConfig) {
    motion.temporal = Temporal::Spatial;
}

/// A switch turned from a starting point, and whether another picture comes out.
type Effect = (&'static str, Switch, Switch, bool);

const EFFECTS: [Effect; 45] = [
    ("mvg", |_| (), no_mvg, true),
    ("mfta", |_| (), no_mfta, true),
    ("position variance", |_| (), position, true),
    ("offsets", |_| (), offsets, true),
    ("self-attention", |_| (), self_attention, true),
    ("average", |_| (), average, true),
    ("convolution", |_| (), convolution, true),
    ("sum", |_| (), sum, true),
    ("masks", |_| (), |motion| motion.refine_masks = false, true),
    ("sum, masks", sum, |motion| motion.refine_masks = false, true),
    ("deviation", |_| (), |motion| motion.spread = Spread::Deviation, true),
    ("weights", |_| (), |motion| motion.weights.scale = 0.9, true),
    ("samples", |_| (), |motion| motion.samples = 6, true),
    ("sample stride", |_| (), |motion| motion.sample_stride = 2, true),
    ("knot stride", |_| (), |motion| motion.knot_stride = 2, true),
    ("window", |_| (), |motion| motion.window = 3, true),
    ("full window", |_| (), full_window, true),
    ("include self", |_| (), |motion| motion.include_self = true, true),
    ("full window, self-attention", self_attention, full_window, true),
    ("full window, average", average, full_window, true),
    ("momentary", |_| (), momentary, true),
    ("signed offset", |_| (), signed, true),
    ("sines", |_| (), sines, true),
    ("velocities", |_| (), velocities, true),
    ("residual", |_| (), residual, true),
    ("SiLU", |_| (), |motion| motion.activation = Activation::Silu, true),
    ("quantiles", |_| (), |motion| motion.normalisation = Normalisation::Quantiles, true),
    ("spatial", |_| (), spatial, true),
    ("neighbours in space", spatial, |motion| motion.neighbours = 3, true),
    ("neighbours in time", |_| (), |motion| motion.neighbours = 3, false),
    ("window in space", |motion| (spatial(motion), no_mvg(motion)).0, |motion| motion.window = 3, false),
    ("no MVG, momentary knots", no_mvg, |motion| motion.knot_stride = 2, false),
    // What training alone looks at.
    ("interval", |_| (), |motion| motion.interval = Interval(100), false),
    ("neighbour gradient", |_| (), |motion| motion.neighbour_gradient = true, false),
    ("decay, first measurement", |_| (), |motion| motion.decay = 0.5, false),
    // Without MVG there are no statistics, in the tokens neither.
    ("no MVG, samples", no_mvg, |motion| motion.samples = 6, false),
    ("no MVG, weights", no_mvg, |motion| motion.weights.scale = 0.9, false),
    ("no MVG, quantiles", no_mvg, |motion| motion.normalisation = Normalisation::Quantiles, false),
    ("no MVG, spread", no_mvg, |motion| motion.spread = Spread::Deviation, false),
    ("no MVG, window", no_mvg, |motion| motion.window = 3, true),
    // Without MFTA there are no tokens. The window is then that of the local variance alone.
    ("no MFTA, full window", no_mfta, full_window, false),
    ("no MFTA, include self", no_mfta, |motion| motion.include_self = true, false),
    ("no MFTA, heads", no_mfta, |motion| motion.heads = 4, false),
    ("neither, window", neither, |motion| motion.window = 3, false),
    ("position variance, weights", position, |motion| motion.weights.scale = 0.9, false),
];

#[test]
fn a_switch_changes_what_comes_out_or_does_not() {
    let bench = bench();
    for (name, start, turn, changes) in EFFECTS {
        let before = with(start);
        let mut after = before.clone();
        turn(&mut after);
        let (before, after) = (bench.outcome(&before), bench.outcome(&after));
        assert!(before.iter().chain(&after).all(|value| value.is_finite()), "{name}");
        assert_eq!(before != after, changes, "{name}");
    }
}

#[test]
fn a_chunk_changes_rounding_alone() {
    /// Rows in other company meet other instructions; the normaliser enlarges what they round off.
    const ROUNDING: f64 = 1e-4;
    let bench = bench();
    let (five, three) = (bench.outcome(&defaults()), bench.outcome(&with(|motion| motion.chunk = 3)));
    let largest = five.iter().fold(0.0, |largest: f64, value| largest.max(value.abs()));
    let apart = five.iter().zip(&three).fold(0.0, |apart: f64, (a, b)| apart.max((a - b).abs()));
    assert!(apart <= ROUNDING * largest, "{apart} of {largest}");
}

#[test]
fn a_descriptor_shows_mvg_what_it_says() {
    let bench = bench();
    let mean_and_position = 0..6;
    let rotation_scale_and_intensity = 6..SIGNATURE_WIDTH;
    let sees = |motion: &MotionConfig, columns| {
        let statistics = bench.measure(motion);
        bench.outcome_of(statistics.clone(), motion) != bench.outcome_of(disturbed(statistics, columns), motion)
    };
    for (descriptor, sees_position, sees_rest) in [
        (Descriptor::Variances, true, true),
        (Descriptor::PositionVariance, true, false),
        (Descriptor::Offsets, false, false),
        (Descriptor::Momentary, true, true),
    ] {
        let motion = MotionConfig { descriptor, ..defaults() };
        assert_eq!(sees(&motion, mean_and_position.clone()), sees_position, "{descriptor:?}");
        assert_eq!(sees(&motion, rotation_scale_and_intensity.clone()), sees_rest, "{descriptor:?}");
    }

    // The local variance stays in the tokens of every descriptor; raw offsets alone come without it.
    for descriptor in DESCRIPTORS {
        for (mfta, sees_local) in [(true, true), (false, descriptor != Descriptor::Offsets)] {
            let motion = MotionConfig { descriptor, mfta, ..defaults() };
            let statistics = bench.measure(&motion);
            let mut other = statistics.clone();
            other.local.iter_mut().enumerate().for_each(|(place, value)| *value += 0.1 * (place * place) as f64);
            let outcome = |statistics| bench.outcome_of(statistics, &motion);
            assert_eq!(outcome(statistics) != outcome(other), sees_local, "{descriptor:?}, {mfta}");
        }
    }
}

#[test]
fn weights_change_the_intensity_alone() {
    let bench = bench();
    let statistics = bench.measure(&defaults());
    let third = FusionWeights { position: 1.0 / 3.0, scale: 1.0 / 3.0, rotation: 1.0 / 3.0 };
    let other = bench.measure(&MotionConfig { weights: third, ..defaults() });
    assert_ne!(statistics.intensities(), other.intensities());
    let pairs = statistics.signatures.iter().zip(&other.signatures);
    let mut rest = pairs.enumerate().filter(|(place, _)| place % SIGNATURE_WIDTH != SIGNATURE_WIDTH - 1);
    assert!(rest.all(|(_, (a, b))| a == b));
    assert_eq!(statistics.local, other.local);
}

#[test]
fn once_measured_the_window_is_the_distance_of_tokens_alone() {
    let bench = bench();
    let statistics = bench.measure(&defaults());
    for mfta in [true, false] {
        let of = |window| bench.outcome_of(statistics.clone(), &MotionConfig { window, mfta, ..defaults() });
        assert_eq!(of(1) != of(4), mfta);
    }
}
