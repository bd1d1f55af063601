//! Which blending kernels fit the memory that the units of a device share.

use burn_cubecl::CubeDevice;
use mvfusion_kernels::cube::backward_kind::{BlendBackwardKind, CountedChannels};

use super::gpu::TilePlan;

/// Whether the units of a device share enough memory to blend so many channels, there and back.
pub(crate) fn fits_shared_memory(device: &CubeDevice, channels: usize) -> bool {
    let statistic = Some(CountedChannels::All);
    let kind = |span, memory| BlendBackwardKind::fitting(span, channels, statistic, memory);
    fitting(TilePlan::of(device), kind).is_some()
}

/// The first of the plan's sizes of memory in which something fits.
pub(super) fn fitting<T>(plan: TilePlan, kind: impl Fn(usize, usize) -> Option<T>) -> Option<T> {
    plan.memory.into_iter().find_map(|memory| kind(plan.span, memory))
}

#[cfg(test)]
mod tests {
    use mvfusion_kernels::splat::channel_count;

    use super::*;

    #[test]
    fn sixteen_kibibytes_hold_the_blending_of_47_features_on_hardware() {
        let hardware = TilePlan { span: 4, memory: [16 << 10; 2] };
        let fits = |features: usize| {
            let channels = channel_count(features);
            let kind = |span, memory| BlendBackwardKind::fitting(span, channels, Some(CountedChannels::All), memory);
            fitting(hardware, kind).is_some()
        };
        assert!((0..=47).all(fits) && !fits(48));
    }
}
