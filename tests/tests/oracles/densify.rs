//! `densify`: statistics, cloning and splitting, pruning and opacity resets of both branches.

use std::collections::BTreeMap;

use anyhow::{Context, Result};
use burn::tensor::{DType, Device, Tensor};
use glam::DVec3;
use mvfusion_model::config::OpacityReset;
use mvfusion_model::model::gaussians::{Attribute, Gaussians};
use mvfusion_model::train::densify::{Branch, BranchState, DensifyPlan, DensifyStatistics, PruneRule, ResetPlan};
use mvfusion_render::optim::AdamMoments;
use mvfusion_tests::{Array, Checklist, Tolerance, numbers, tensor};

use crate::archive::Archive;

/// From the README of the oracle.
const TOLERANCE: Tolerance = Tolerance::of_largest(1e-5);

/// Share of the extent above which a Gaussian is split, not cloned.
const CLONE_BELOW: f64 = 0.01;

/// Opacity below which a Gaussian is pruned.
const MIN_OPACITY: f64 = 0.005;

/// Foreground probability below which a dynamic Gaussian is unused.
const UNUSED: f64 = 5e-4;

/// Higher colour coefficients that our Gaussians have.
const REST: usize = 15;

/// Outputs that are not compared.
pub const LEFT_OUT: &[(&str, &str)] = &[
    ("densified.f_rest", "holds the dead coefficients alone"),
    ("prune_epoch.buf", "the trainer zeroes the buffer, not the branch"),
    ("prune_utility.buf", "the trainer zeroes the buffer, not the branch"),
    ("out.bg.densified.buf", "our static branch keeps no radii"),
    ("out.bg.prune_plain.buf", "our static branch keeps no radii"),
    ("out.bg.prune_late.buf", "our static branch keeps no radii"),
];

/// A file's branch with its moments; statistics as before the step that the file describes.
fn branch(archive: &Archive, device: &Device) -> Result<(Gaussians, BranchState)> {
    let count = archive.array("in.xyz")?.shape[0];
    let on = |device: &Device, values: &[f64]| tensor(values, [count, values.len() / count], device, DType::F32);
    let autodiff = device.clone().autodiff();
    let parameter = |name: &str| archive.find(name).map(|array| on(&autodiff, &array.values));
    let rest = archive.array("in.f_rest")?.columns(0, REST);
    let gaussians = Gaussians::from_tensors(|attribute| match attribute {
        Attribute::Means => parameter("in.xyz"),
        Attribute::ShDc => parameter("in.f_dc"),
        Attribute::ShRest => Some(on(&autodiff, &rest.values)),
        Attribute::OpacityLogits => parameter("in.opacity"),
        Attribute::LogScales => parameter("in.scaling"),
        Attribute::Quaternions => parameter("in.rotation"),
        Attribute::MaskLogits => None,
        Attribute::TimeCentres | Attribute::LogDurations | Attribute::Velocities => None,
    });
    let gaussians = gaussians.context("an attribute is missing")?;
    let mut state = BranchState::new(&gaussians);
    let plain = |name: &str| archive.array(name).map(|array| on(device, &array.values));
    state.statistics = DensifyStatistics {
        gradients: plain("in.accum")?,
        seen: plain("in.denom")?,
        foreground: plain("in.buf")?,
        radii: plain("in.buf")?.zeros_like(),
    };
    let mut moments = BTreeMap::new();
    for (attribute, name) in
        [(Attribute::Means, "xyz"), (Attribute::OpacityLogits, "opacity"), (Attribute::LogScales, "scaling")]
    {
        let first = plain(&format!("in.adam_m.{name}"))?;
        // The file has no second moments; ones show as well whether rows are kept.
        moments.insert(attribute, AdamMoments { second: first.ones_like(), first, steps: 7 });
    }
    state.optimiser.moments = moments;
    Ok((gaussians, state))
}

/// The branch whose rows may change.
fn lent<'a>(gaussians: &'a mut Gaussians, state: &'a mut BranchState) -> Branch<'a> {
    Branch { gaussians, state, motion: None, gradients: None }
}

/// A branch under comparison with the outputs under a prefix.
struct Comparison<'a> {
    checks: &'a mut Checklist,
    archive: &'a Archive,
    prefix: String,
}

impl Comparison<'_> {
    /// Compares a tensor of rows, if it is stored.
    fn rows(&mut self, name: &str, found: Tensor<2>) {
        let name = format!("{}.{name}", self.prefix);
        if let Some(expected) = self.archive.find(&name) {
            let found = Array::of(found);
            match found.values.len() == expected.values.len() {
                true => self.checks.close(&name, expected, &found.reshaped(expected.shape.clone()), TOLERANCE),
                false => self.checks.close(&name, expected, &found, TOLERANCE),
            }
        }
    }

    /// Compares everything that is stored of a branch.
    fn branch(&mut self, gaussians: &Gaussians, state: &BranchState) {
        for (name, parameter) in [
            ("xyz", &gaussians.means),
            ("f_dc", &gaussians.sh_dc),
            ("opacity", &gaussians.opacity_logits),
            ("scaling", &gaussians.log_scales),
            ("rotation", &gaussians.quaternions),
        ] {
            self.rows(name, parameter.val());
        }
        for (attribute, name) in
            [(Attribute::Means, "xyz"), (Attribute::OpacityLogits, "opacity"), (Attribute::LogScales, "scaling")]
        {
            self.rows(&format!("adam_m.{name}"), state.optimiser.moments[&attribute].first.clone());
        }
        self.rows("accum", state.statistics.gradients.clone());
    }
}

/// All that happens to the rows of both branches.
pub fn check(archive: &Archive, device: &Device) -> Result<()> {
    let mut checks = Checklist::default();
    for name in ["fg", "bg"] {
        check_densify(&mut checks, archive, device, name)?;
        check_prune(&mut checks, archive, device, name)?;
        check_reset(&mut checks, archive, device, name)?;
    }
    checks.finish()
}

fn check_densify(checks: &mut Checklist, archive: &Archive, device: &Device, name: &str) -> Result<()> {
    let (mut gaussians, mut state) = branch(archive, device)?;
    let count = gaussians.count();
    let screen = archive.tensor::<2>("in.vs_grad", device)?.narrow(1, 0, 2);
    let visible: Tensor<2> = tensor(&archive.array("in.visible")?.values, [count, 1], device, DType::F32);
    state.statistics.record(screen, visible);
    let out = format!("out.{name}");
    let mut compare = Comparison { checks, archive, prefix: out.clone() };
    compare.rows("stats.accum", state.statistics.gradients.clone());
    compare.rows("stats.denom", state.statistics.seen.clone());
    compare.rows("mean_grad", state.statistics.mean_gradients());

    let gradients = numbers(state.statistics.mean_gradients());
    let axes = numbers(gaussians.log_scales.val().max_dim(1).exp());
    let clone_size = CLONE_BELOW * archive.number("in.ext")?;
    let plan = DensifyPlan::new(&gradients, &axes, archive.number("in.tau")?, clone_size);
    let chosen = |rows: &[usize]| (0..count).map(|row| rows.contains(&row)).collect::<Vec<_>>();
    checks.same(format!("{out}.clone_mask"), &archive.flags(&format!("{out}.clone_mask"))?, &chosen(&plan.cloned));
    checks.same(format!("{out}.split_mask"), &archive.flags(&format!("{out}.split_mask"))?, &chosen(&plan.split));
    let origin = format!("{out}.densified.origin");
    checks.same(&origin, &archive.counts(&origin)?, &plan.sources());

    let normals: Vec<DVec3> = archive
        .array("in.split_eps")?
        .values
        .chunks_exact(3)
        .take(2 * plan.split.len())
        .map(DVec3::from_slice)
        .collect();
    let map = lent(&mut gaussians, &mut state).grow(&plan, &normals)?;
    checks.same("sources", &[Some(plan.sources())], &[map.map(|map| map.sources().to_vec())]);
    let mut compare = Comparison { checks, archive, prefix: format!("{out}.densified") };
    compare.branch(&gaussians, &state);
    if name == "fg" {
        compare.rows("buf", state.statistics.foreground.clone());
    }
    Ok(())
}

fn check_prune(checks: &mut Checklist, archive: &Archive, device: &Device, name: &str) -> Result<()> {
    // `epoch` differs from `plain` in what the trainer does to the buffer, `late` not at all.
    for (variant, min_foreground) in [("plain", None), ("epoch", None), ("late", None), ("utility", Some(UNUSED))] {
        let prefix = format!("out.{name}.prune_{variant}");
        let removed = format!("{prefix}.removed");
        if !archive.has(&removed) {
            continue;
        }
        let (mut gaussians, mut state) = branch(archive, device)?;
        let count = gaussians.count();
        let rule = PruneRule { min_opacity: MIN_OPACITY, min_foreground, max_radius: None, max_scale: None };
        let map = lent(&mut gaussians, &mut state).prune(&rule)?;
        let kept = map.map_or_else(|| (0..count).collect(), |map| map.sources().to_vec());
        let found: Vec<bool> = (0..count).map(|row| !kept.contains(&row)).collect();
        checks.same(&removed, &archive.flags(&removed)?, &found);
        let mut compare = Comparison { checks, archive, prefix };
        compare.branch(&gaussians, &state);
        if (name, variant) == ("fg", "plain") {
            compare.rows("buf", state.statistics.foreground.clone());
        }
    }
    Ok(())
}

fn check_reset(checks: &mut Checklist, archive: &Archive, device: &Device, name: &str) -> Result<()> {
    let order = archive.counts("in.reset_order")?;
    let share = if name == "fg" { 0.5 } else { 0.7 };
    for (variant, share) in [("reset", share), ("reset_full", 1.0)] {
        let (mut gaussians, mut state) = branch(archive, device)?;
        let plan = ResetPlan::from_order(&order, share);
        lent(&mut gaussians, &mut state).reset_opacity(&plan, OpacityReset::Quirk)?;
        let prefix = format!("out.{name}.{variant}");
        if variant == "reset" {
            let selected = format!("{prefix}.selected");
            checks.same(&selected, &archive.flags(&selected)?, &plan.selected);
            let moments = &state.optimiser.moments[&Attribute::OpacityLogits];
            for (part, moment) in [("adam_m_absmax", &moments.first), ("adam_v_absmax", &moments.second)] {
                let key = format!("{prefix}.{part}");
                checks.close_number(&key, archive.number(&key)?, Array::of(moment.clone()).largest(), TOLERANCE);
            }
        }
        let logits = gaussians.opacity_logits.val().inner();
        let mut compare = Comparison { checks, archive, prefix };
        compare.rows("opacity_raw", logits.clone());
        compare.rows("opacity_act", burn::tensor::activation::sigmoid(logits));
    }
    Ok(())
}
