//! Selection of blending kernels that fit into a device's shared memory.

use burn_cubecl::CubeDevice;
use mvfusion_kernels::cube::backward_kind::{BlendBackwardKind, CountedChannels};

use super::gpu::TilePlan;

/// Whether a device has enough shared memory to blend this many channels, forward and backward.
pub(crate) fn fits_shared_memory(device: &CubeDevice, channels: usize) -> bool {
    let statistic = Some(CountedChannels::All);
    let kind = |span, memory| BlendBackwardKind::fitting(span, channels, statistic, memory);
    fitting(TilePlan::of(device), kind).is_some()
}

/// The kernel for the first of the plan's memory sizes into which one fits.
pub(super) fn fitting<T>(plan: TilePlan, kind: impl Fn(usize, usize) -> Option<T>) -> Option<T> {
    plan.memory.into_iter().find_map(|memory| kind(plan.span, memory))
}

#[cfg(test)]
mod tests {
    use mvfusion_kernels::splat::channel_count;

    use super::*;

    #[test]
    fn sixteen_kibibytes_hold_the_blending_of_43_features_on_hardware() {
        let hardware = TilePlan { span: 4, memory: [16 << 10; 2] };
        let fits = |features: usize| {
            let channels = channel_count(features);
            let kind = |span, memory| BlendBackwardKind::fitting(span, channels, Some(CountedChannels::All), memory);
            fitting(hardware, kind).is_some()
        };
        assert!((0..=43).all(fits) && !fits(44));
    }
}
