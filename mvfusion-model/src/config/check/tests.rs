//! Which configurations are refused, and why.

use super::*;
use crate::config::{FusionWeights, Interval, StageConfig};

/// The error for a configuration with this interval and these weights.
fn refusal(interval: usize, [position, scale, rotation]: [f64; 3]) -> Option<String> {
    let mut config = Config::default();
    config.motion.interval = Interval(interval);
    config.motion.weights = FusionWeights { position, scale, rotation };
    config.check().err().map(|error| error.to_string())
}

#[test]
fn motion_is_measured_at_some_interval() {
    let said = refusal(0, [0.7, 0.2, 0.1]).expect("it is refused");
    assert!(said.starts_with("`motion.interval` is 0: give the steps"), "{said}");
    assert_eq!(refusal(1, [0.7, 0.2, 0.1]), None);
}

/// The error for a default configuration after a change.
fn refusal_of(change: impl Fn(&mut Config)) -> Option<String> {
    let mut config = Config::default();
    change(&mut config);
    config.check().err().map(|error| error.to_string())
}

#[test]
fn seeds_fit_into_their_branch_and_a_box_of_what_moves_needs_them() {
    let seeds = |count| move |config: &mut Config| config.init.motion_points = count;
    let most = Config::default().densify.dynamic.max_gaussians;
    assert_eq!(refusal_of(seeds(most)), None);
    let said = refusal_of(seeds(most + 1)).expect("it is refused");
    assert!(said.starts_with("`init.motion_points` is 90001: that is more than"), "{said}");

    let spans = |count| {
        move |config: &mut Config| {
            (config.model.grid.bounds, config.init.motion_points) = (GridBoundsRule::Motion, count)
        }
    };
    assert_eq!(refusal_of(spans(2000)), None);
    let said = refusal_of(spans(0)).expect("it is refused");
    assert!(said.starts_with("`model.grid.bounds` is motion: nobody looks for what moves"), "{said}");
}

#[test]
fn points_that_no_branch_has_room_for_are_refused() {
    for (key, slot) in [
        ("init.dynamic_points", (|config| &mut config.init.dynamic_points) as fn(&mut Config) -> &mut usize),
        ("init.dynamic_from_cloud", |config| &mut config.init.dynamic_from_cloud),
        ("init.static_points", |config| &mut config.init.static_points),
        ("init.sky_points", |config| &mut config.init.sky_points),
    ] {
        let said = refusal_of(|config| *slot(config) = 960_001).expect("it is refused");
        assert!(said.starts_with(&format!("`{key}` is 960001: that is more than `densify.")), "{said}");
    }
    assert_eq!(refusal_of(|config| config.init.sky_points = 960_000), None);
}

#[test]
fn moments_of_adam_that_diverge_are_refused() {
    let betas = |beta1, beta2| move |config: &mut Config| (config.optim.beta1, config.optim.beta2) = (beta1, beta2);
    assert_eq!(refusal_of(betas(0.9, 0.81)), None);
    assert_eq!(refusal_of(betas(0.0, 0.0)), None);
    let said = refusal_of(betas(0.9, 0.5)).expect("it is refused");
    assert!(said.starts_with("`optim.beta2` is 0.5: Adam diverges below the square of `optim.beta1`"), "{said}");
}

#[test]
fn a_value_that_the_length_of_a_run_moves_out_of_its_range_is_refused() {
    let shortened = |scale| {
        move |config: &mut Config| {
            (config.train.scale, config.train.scale_rates, config.optim.scale) = (scale, 1.0, 0.5);
        }
    };
    assert_eq!(refusal_of(shortened(0.5)), None);
    let said = refusal_of(shortened(0.4)).expect("it is refused");
    assert!(said.starts_with("`optim.scale` is 1.25: give a rate") && said.contains("`train.scale` = 0.4"), "{said}");
}

#[test]
fn a_contradiction_that_follows_from_the_length_of_a_run_names_the_scale() {
    let shortened = |scale| {
        move |config: &mut Config| {
            (config.loss.still_opacity, config.train.scale) = (0.1, scale);
            config.train.stages = StageConfig::of([2000, 3000, 4]);
        }
    };
    assert_eq!(refusal_of(shortened(1.0)), None);
    assert_eq!(refusal_of(shortened(0.5)), None);
    let mut former = Config::default();
    shortened(0.1)(&mut former);
    former.check_of_run().expect("a run of a former version can be opened");
    let said = refusal_of(shortened(0.1)).expect("no step of the last stage is left");
    assert!(said.starts_with("`loss.still_opacity` is 0.1: motion is measured"), "{said}");
    assert!(said.contains("it follows from `train.scale` = 0.1"), "{said}");
}

#[test]
fn what_has_no_effect_with_one_branch_is_refused() {
    type Change = fn(&mut Config);
    let keys: [(&str, Change); 4] = [
        ("init.motion_points", |config| config.init.motion_points = 2000),
        ("init.photo_points", |config| config.init.photo_points = 1000),
        ("densify.births_interval", |config| config.densify.births_interval = Interval(300)),
        ("model.grid.bounds", |config| config.model.grid.bounds = GridBoundsRule::Motion),
    ];
    for (key, set) in keys {
        let with = |branches| {
            move |config: &mut Config| {
                (config.model.branches, config.model.lifetime) = (branches, true);
                set(config);
                if branches == Branches::Both && config.model.grid.bounds == GridBoundsRule::Motion {
                    config.init.motion_points = 2000;
                }
            }
        };
        assert_eq!(refusal_of(with(Branches::Both)), None, "{key}");
        let said = refusal_of(with(Branches::Dynamic)).expect("it is refused");
        assert!(said.starts_with(&format!("`{key}` is ")) && said.contains("a model of one branch"), "{said}");
        // Former versions trained with it.
        let mut former = Config::default();
        with(Branches::Dynamic)(&mut former);
        former.init.motion_points = 2000;
        former.check_of_run().expect("its runs can be opened");
    }
}

#[test]
fn still_gaussians_are_not_sorted_out_with_lifetimes_for_the_reason_of_the_trajectory() {
    for (trajectory, reason) in
        [(Trajectory::Deformation, "of the deformation alone"), (Trajectory::Lifetime, "while a Gaussian is there")]
    {
        let said = refusal_of(|config| {
            (config.model.lifetime, config.motion.trajectory) = (true, trajectory);
            config.motion.still = StillRule::Prune;
        });
        let said = said.expect("it is refused");
        assert!(said.starts_with("`motion.still` is ") && said.contains(reason), "{said}");
    }
}

#[test]
fn travel_is_added_only_to_an_intensity_of_its_unit() {
    let with = |lifetime, trajectory, in_extents, spread| {
        refusal_of(move |config| {
            (config.loss.still_opacity, config.model.lifetime) = (0.1, lifetime);
            (config.motion.trajectory, config.motion.in_extents, config.motion.spread) =
                (trajectory, in_extents, spread);
        })
    };
    let other_units = [(false, Spread::Variance), (true, Spread::Deviation), (false, Spread::Deviation)];
    assert_eq!(with(true, Trajectory::Deformation, true, Spread::Variance), None);
    for (in_extents, spread) in other_units {
        let said = with(true, Trajectory::Deformation, in_extents, spread).expect("it is refused");
        assert!(said.starts_with("`loss.still_opacity` is 0.1:") && said.contains("`motion.in_extents"), "{said}");
        assert_eq!(with(true, Trajectory::Lifetime, in_extents, spread), None, "the intensity has the travel");
        assert_eq!(with(false, Trajectory::Deformation, in_extents, spread), None, "nothing travels");
    }
}

#[test]
fn gaussians_of_one_photo_need_lifetimes() {
    let births =
        |lifetime| move |config: &mut Config| (config.init.photo_points, config.model.lifetime) = (1000, lifetime);
    assert_eq!(refusal_of(births(true)), None);
    let said = refusal_of(births(false)).expect("it is refused");
    assert!(said.starts_with("`init.photo_points` is 1000:") && said.contains("model.lifetime"), "{said}");
    let said = refusal_of(|config| config.densify.births_interval = Interval(920)).expect("it is refused");
    assert!(said.starts_with("`densify.births_interval` is 920:") && said.contains("model.lifetime"), "{said}");
}

#[test]
fn what_follows_from_motion_needs_a_stage_that_measures_it_and_births_need_the_first_stage() {
    type Change = fn(&mut Config);
    let keys: [(&str, Change); 3] = [
        ("motion.still", |config| config.motion.still = StillRule::Prune),
        ("loss.still_opacity", |config| config.loss.still_opacity = 0.1),
        ("densify.motion_power", |config| config.densify.motion_power = 0.5),
    ];
    for (key, set) in keys {
        assert_eq!(refusal_of(set), None);
        let unmeasured: [Change; 2] =
            [|config| config.model.deformation = false, |config| config.train.stages.refinement.0 = 0];
        for change in unmeasured {
            let said = refusal_of(|config| {
                set(config);
                change(config);
            });
            assert!(said.is_some_and(|said| said.starts_with(&format!("`{key}` is "))), "{key}");
        }
    }
    let births = |stages| {
        move |config: &mut Config| {
            (config.init.photo_points, config.model.lifetime) = (1000, true);
            config.train.stages = StageConfig::of(stages);
        }
    };
    assert_eq!(refusal_of(births([1, 1, 1])), None);
    let said = refusal_of(births([0, 1, 1])).expect("it is refused");
    assert!(said.starts_with("`init.photo_points` is 1000:") && said.contains("train.stages.geometry"), "{said}");
}

#[test]
fn numbers_of_seeds_and_lifetimes_are_in_range() {
    type Slot = fn(&mut Config) -> &mut f64;
    let above_0: [(&str, Slot); 4] = [
        ("init.motion_duration", |config| &mut config.init.motion_duration),
        ("init.photo_duration", |config| &mut config.init.photo_duration),
        // A rate that starts above 0 cannot decay to 0 log-linearly.
        ("optim.velocity.end", |config| &mut config.optim.velocity.end),
        ("optim.exposure.end", |config| &mut config.optim.exposure.end),
    ];
    let from_0: [(&str, Slot); 7] = [
        ("optim.velocity.start", |config| &mut config.optim.velocity.start),
        ("optim.exposure.start", |config| &mut config.optim.exposure.start),
        ("loss.mask_motion", |config| &mut config.loss.mask_motion),
        ("loss.still_opacity", |config| &mut config.loss.still_opacity),
        ("train.lonely_visits", |config| &mut config.train.lonely_visits),
        ("optim.time_centre", |config| &mut config.optim.time_centre),
        ("optim.duration", |config| &mut config.optim.duration),
    ];
    let refused = |key: &str, slot: Slot, bad: f64| {
        let said = refusal_of(|config| *slot(config) = bad).unwrap_or_default();
        assert!(said.starts_with(&format!("`{key}` is {bad}: ")), "{key} = {bad}: {said}");
    };
    for (key, slot) in above_0.into_iter().chain(from_0) {
        [-0.1, f64::NAN, f64::INFINITY].into_iter().for_each(|bad| refused(key, slot, bad));
        assert_eq!(refusal_of(|config| *slot(config) = 0.5), None, "{key}");
    }
    above_0.into_iter().for_each(|(key, slot)| refused(key, slot, 0.0));
    from_0.into_iter().for_each(|(key, slot)| assert_eq!(refusal_of(|config| *slot(config) = 0.0), None, "{key}"));
}

#[test]
fn weights_of_the_intensity_are_numbers_not_below_zero() {
    for (key, place) in [("position", 0), ("scale", 1), ("rotation", 2)] {
        for bad in [-0.1, f64::NAN, f64::INFINITY] {
            let mut weights = [0.7, 0.2, 0.1];
            weights[place] = bad;
            let said = refusal(2000, weights).expect("it is refused");
            assert!(said.starts_with(&format!("`motion.weights.{key}` is {bad}: give a number")), "{said}");
        }
    }
    for good in [[1.0, 0.0, 0.0], [0.8, 0.0, 0.2], [0.8, 0.2, 0.0], [0.0; 3], [7.0, 2.0, 4.0]] {
        assert_eq!(refusal(2000, good), None, "{good:?}");
    }
}
