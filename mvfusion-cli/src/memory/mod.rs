//! Refuses what does not fit into the memory of the machine and its device, before any work.

mod machine;

use anyhow::bail;
use bytesize::ByteSize;
use mvfusion_data::Scene;
use mvfusion_model::memory::{MemoryNeed, RenderNeed};
use mvfusion_model::model::Model;
use mvfusion_model::train::IMAGE_CACHE;
use mvfusion_model::{Config, ModelError};

use crate::device::OpenDevice;
use crate::render::LEAST_SIDE;
pub use machine::{Available, peak};

/// Whether a need that exceeds the memory is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MemoryRule {
    /// It is refused.
    Enforced,
    /// It is tried anyway (`--force-memory`).
    Tried,
}

impl MemoryRule {
    /// The rule that a flag asks for.
    pub fn of_flag(force_memory: bool) -> Self {
        if force_memory { Self::Tried } else { Self::Enforced }
    }
}

/// The memory of a training run with the default cache of images. `config` is not scaled.
///
/// # Errors
/// If a file of initial Gaussians cannot be used.
pub fn need_of_training(config: &Config, scene: &Scene) -> Result<MemoryNeed, ModelError> {
    MemoryNeed::of(&config.for_times_of(scene).scaled(), scene, IMAGE_CACHE)
}

/// Refuses a training that needs more memory than there is. `config` is the scaled configuration for `scene`.
///
/// # Errors
/// With the numbers, and the settings with which it would fit. Also if a file of initial Gaussians cannot be used.
pub fn check_training(
    config: &Config,
    scene: &Scene,
    image_cache: u64,
    device: &OpenDevice,
    rule: MemoryRule,
) -> anyhow::Result<()> {
    if rule == MemoryRule::Tried {
        return Ok(());
    }
    let need = MemoryNeed::of(config, scene, image_cache)?;
    if let Some(refusal) = refusal_of_training(&need, config, device, Available::on_this_machine().as_ref()) {
        bail!("{refusal} `--force-memory` tries anyway.");
    }
    Ok(())
}

/// Why a training does not fit: the numbers, and what to change. `None` if it fits.
pub fn refusal_of_training(
    need: &MemoryNeed,
    config: &Config,
    device: &OpenDevice,
    available: Option<&Available>,
) -> Option<String> {
    let (largest, remedy) = if need.parts.largest > need.parts.largest_of_pixels {
        let keys = "`densify.static.max_gaussians`, `densify.dynamic.max_gaussians` or the sizes of `model.grid`";
        (need.parts.largest, format!("Lower {keys}"))
    } else {
        (need.parts.largest_of_pixels, "Make the images smaller by `scene.downscale`".to_owned())
    };
    if let Some(buffer) = device.buffer.filter(|&buffer| largest > buffer as f64) {
        return Some(format!(
            "the training needs a buffer of {} and {} has buffers up to {}. {remedy}, or use `--device cpu`.",
            size(largest),
            device.name,
            size(buffer as f64)
        ));
    }
    let available = available?;
    let needed = need.host() + if device.computes_on_host { need.most } else { 0.0 };
    let excess = needed - available.bytes as f64;
    if excess <= 0.0 {
        return None;
    }
    let mut remedies = if device.computes_on_host { need.remedies(config, excess) } else { Vec::new() };
    remedies.iter_mut().for_each(|remedy| *remedy = format!("`--set {remedy}`"));
    if need.pictures > excess {
        remedies.push(format!("`--image-cache {}`", ((need.pictures - excess) as u64 >> 20 << 20)));
    }
    let advice = match remedies.as_slice() {
        [] => "Lower several of these, or use a machine with more memory.".to_owned(),
        remedies => format!("It fits with {}.", remedies.join(" or with ")),
    };
    Some(format!(
        "the training needs up to {}, and {}: {}. {advice}",
        size(needed),
        available.sentence(),
        parts(need, device.computes_on_host)
    ))
}

/// Refuses to render frames that need more memory than there is.
///
/// # Errors
/// With the numbers, and a size that would fit.
pub fn check_rendering(
    model: &Model,
    config: &Config,
    size: (usize, usize),
    layers: usize,
    device: &OpenDevice,
    rule: MemoryRule,
) -> anyhow::Result<()> {
    if rule == MemoryRule::Tried {
        return Ok(());
    }
    let need = RenderNeed::of(model, config, size, layers);
    if let Some(refusal) = refusal_of_rendering(&need, size, layers, device, Available::on_this_machine().as_ref()) {
        bail!("{refusal} `--force-memory` tries anyway.");
    }
    Ok(())
}

fn refusal_of_rendering(
    need: &RenderNeed,
    (width, height): (usize, usize),
    layers: usize,
    device: &OpenDevice,
    available: Option<&Available>,
) -> Option<String> {
    let too_large = |needed: f64, limit: String, frame: f64| {
        let side = |side: usize| (side as f64 * need.share(frame).sqrt()) as usize / LEAST_SIDE * LEAST_SIDE;
        let (width_, height_) = (side(width), side(height));
        let advice = match width_.min(height_) {
            0 => "Render fewer `--layers`, or use a machine with more memory.".to_owned(),
            _ => format!("It fits with `--size {width_}x{height_}`; fewer `--layers` need less, too."),
        };
        format!("a frame of {width}x{height} pixels in {layers} layers needs {}, and {limit}. {advice}", size(needed))
    };
    if let Some(buffer) = device.buffer.filter(|&buffer| need.largest > buffer as f64) {
        let limit = format!("{} has buffers up to {}", device.name, size(buffer as f64));
        return Some(too_large(need.largest, limit, need.frame * buffer as f64 / need.largest));
    }
    let available = available.filter(|_| device.computes_on_host)?;
    let (needed, bytes) = (need.model + need.frame, available.bytes as f64);
    (needed > bytes).then(|| too_large(needed, available.sentence(), bytes - need.model))
}

/// The parts of a need that are worth a word, the largest first, with their keys.
fn parts(need: &MemoryNeed, on_host: bool) -> String {
    let of_steps = [
        ("static Gaussians (`densify.static.max_gaussians`)", need.parts.static_),
        ("dynamic Gaussians (`densify.dynamic.max_gaussians`, `model.width`)", need.parts.dynamic),
        ("the planes (`model.grid.resolution`, `model.grid.multipliers`, `model.grid.features`)", need.parts.planes),
        (
            "the networks (`model.width`, `motion.hidden`, `motion.attention_width`, `motion.samples`, `motion.chunk`)",
            need.parts.network,
        ),
        ("the pixels of a step (`train.batch_size`, `scene.downscale`)", need.parts.pixels),
    ];
    let of_host = [("decoded images (`--image-cache`)", need.pictures), ("detecting motion", need.film)];
    let mut parts: Vec<_> = if on_host { of_steps.to_vec() } else { Vec::new() };
    parts.extend(of_host);
    parts.sort_by(|a, b| b.1.total_cmp(&a.1));
    let all: f64 = parts.iter().map(|part| part.1).sum();
    let large = parts.iter().filter(|part| part.1 > 0.05 * all);
    large.map(|(what, bytes)| format!("{} for {what}", size(*bytes))).collect::<Vec<_>>().join(", ")
}

/// Bytes for people.
pub(crate) fn size(bytes: f64) -> String {
    ByteSize(bytes as u64).to_string()
}

#[cfg(test)]
mod tests {
    use mvfusion_data::{BuiltinOptions, builtin};

    use super::*;

    fn cpu() -> OpenDevice {
        crate::device::open("cpu").expect("this build has a CPU device")
    }

    fn available(bytes: u64) -> Available {
        Available { bytes, limit: "of memory are free".to_owned() }
    }

    #[test]
    #[cfg(feature = "flex")]
    fn what_does_not_fit_is_refused_with_numbers_and_settings_that_would_fit() {
        let scene = builtin::builtin(&BuiltinOptions { width: 64, height: 48, frames: 2, ..Default::default() });
        let mut config = Config::default();
        let need = |config: &Config| MemoryNeed::of(config, &scene, 1 << 30).expect("no files are needed");
        let refusal =
            |config: &Config, bytes| refusal_of_training(&need(config), config, &cpu(), Some(&available(bytes)));
        assert_eq!(refusal(&config, 64 << 30), None);
        let said = refusal(&config, 3 << 30).expect("refused");
        for part in
            ["needs up to", "3.0 GiB of memory are free", "`--set densify.static.max_gaussians=", "static Gaussians"]
        {
            assert!(said.contains(part), "`{part}` is missing: {said}");
        }
        config.train.batch_size = 4096;
        let said = refusal(&config, 4 << 30).expect("refused");
        assert!(said.contains("train.batch_size=") && said.contains("scene.downscale="), "{said}");
        assert_eq!(
            refusal_of_training(&need(&config), &config, &cpu(), None),
            None,
            "where nothing is known of memory"
        );
    }

    #[test]
    #[cfg(feature = "flex")]
    fn a_frame_that_does_not_fit_is_refused_with_a_size_that_does() {
        let need = RenderNeed { model: 1e8, frame: 4e9, largest: 1e9 };
        let refusal =
            |device: &OpenDevice, bytes| refusal_of_rendering(&need, (4000, 2000), 6, device, Some(&available(bytes)));
        assert_eq!(refusal(&cpu(), 5_000_000_000), None);
        let said = refusal(&cpu(), 1_100_000_000).expect("refused");
        for part in ["4000x2000 pixels in 6 layers", "needs 3.8 GiB", "1.0 GiB of memory are free", "`--size 2000x992`"]
        {
            assert!(said.contains(part), "`{part}` is missing: {said}");
        }
        assert!(refusal(&cpu(), 90_000_000).expect("refused").contains("Render fewer `--layers`"));
        let gpu = OpenDevice { buffer: Some(250_000_000), computes_on_host: false, ..cpu() };
        let said = refusal(&gpu, 1).expect("refused");
        assert!(said.contains("buffers up to 238.4 MiB") && said.contains("`--size 2000x992`"), "{said}");
    }

    #[test]
    #[cfg(feature = "flex")]
    fn a_gpu_is_asked_for_its_largest_buffer_and_the_host_for_images_alone() {
        let scene = builtin::builtin(&BuiltinOptions { width: 64, height: 48, frames: 2, ..Default::default() });
        let config = Config::default();
        let need = MemoryNeed::of(&config, &scene, 1 << 30).expect("no files are needed");
        let gpu = |buffer| OpenDevice { buffer: Some(buffer), computes_on_host: false, ..cpu() };
        let refused = |need: &MemoryNeed, buffer, bytes| {
            refusal_of_training(need, &config, &gpu(buffer), Some(&available(bytes)))
        };
        let refusal = |buffer, bytes| refused(&need, buffer, bytes);
        assert_eq!(refusal(1 << 30, 1 << 30), None);
        let said = refusal(64 << 20, 1 << 30).expect("refused");
        assert!(said.contains("buffers up to 64.0 MiB") && said.contains("max_gaussians"), "{said}");
        assert!(refusal(1 << 30, 10 << 20).expect("refused").contains("10.0 MiB of memory are free"));

        let (mut large, parts) = (need, need.parts);
        large.parts.largest_of_pixels = 2.0 * parts.largest;
        let said = refused(&large, parts.largest as u64 + 1, 1 << 30).expect("refused");
        assert!(said.contains("`scene.downscale`") && !said.contains("max_gaussians"), "{said}");
    }
}
