//! Trials of the splat for GPUs alone: equal bits of equal calls, and covariances beyond single precision.

use super::*;

/// Renders a scene twice, and compares every bit. No sum of the splat depends on the order in which units run.
pub fn render_twice(scene: &Scene, device: &Device) -> Result<()> {
    same_bits(&render(scene, device)?, &render(scene, device)?)
}

/// Renders scenes with one call, and compares every bit with what a call for each gives.
pub fn render_together(scenes: &[&Scene], device: &Device) -> Result<()> {
    for (scene, together) in scenes.iter().zip(render_all(scenes, device)?) {
        same_bits(&together, &render(scene, device)?).context(scene.name)?;
    }
    Ok(())
}

fn same_bits(first: &Rendered, second: &Rendered) -> Result<()> {
    let bits = |array: &Array| array.values.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
    ensure!(bits(&first.picture) == bits(&second.picture), "the pictures differ");
    ensure!(bits(&first.radii) == bits(&second.radii), "the radii differ");
    for ((name, first), (_, second)) in first.gradients.iter().zip(&second.gradients) {
        ensure!(bits(first) == bits(second), "the gradients of {name} differ");
    }
    Ok(())
}

/// Gaussians whose covariance single precision cannot hold.
const NEEDLES: Scene = Scene {
    name: "needles",
    count: 60,
    size: [67, 45],
    features: 0,
    degree: 0,
    rules: SplatRules::inria,
    statistic: Statistic::AllChannels,
    crowd: Crowd::Needles,
};

/// Compares the gradients of needles, also of antialiased ones.
pub fn compare_needles(device: &Device, reference: &Device) -> Result<()> {
    for rules in [SplatRules::inria, antialiased] {
        let scene = Scene { rules, ..NEEDLES };
        let (found, wanted) = (render(&scene, device)?, render(&scene, reference)?);
        let mut checks = Checklist::default();
        for ((name, found), (_, wanted)) in found.gradients.iter().zip(&wanted.gradients) {
            checks.close(name, wanted, found, Tolerance::of_largest(1e-2));
        }
        checks.finish()?;
    }
    Ok(())
}
