//! The tensors of the splat op by name, and the sizes that determine their shapes.

use mvfusion_kernels::splat::{COLOUR_CHANNELS, background_channels, channel_count};

/// Defines [`SplatTensors`] and the methods that treat all its fields alike, so that each field is listed once.
macro_rules! splat_tensors {
    ($($(#[$doc:meta])* $field:ident,)*) => {
        /// One `T` for each tensor of the op: the tensor on some backend, its values, its gradient, its shape or its
        /// name. `N` is the number of Gaussians.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub(crate) struct SplatTensors<T> {
            $($(#[$doc])* pub $field: T,)*
        }

        /// Number of the op's tensors.
        pub(crate) const TENSORS: usize = [$(stringify!($field)),*].len();

        impl SplatTensors<&'static str> {
            /// The names of the fields, which errors use.
            pub const NAMES: Self = Self { $($field: stringify!($field),)* };
        }

        impl<T> SplatTensors<T> {
            /// Takes the fields from an array, in their order.
            pub fn from_array([$($field),*]: [T; TENSORS]) -> Self {
                Self { $($field,)* }
            }

            /// Returns the fields as an array, in their order.
            pub fn into_array(self) -> [T; TENSORS] {
                [$(self.$field),*]
            }

            /// Borrows each field.
            pub fn each_ref(&self) -> SplatTensors<&T> {
                SplatTensors { $($field: &self.$field,)* }
            }

            /// Borrows each field mutably.
            pub fn each_mut(&mut self) -> SplatTensors<&mut T> {
                SplatTensors { $($field: &mut self.$field,)* }
            }

            /// Applies `f` to each field, in their order.
            pub fn map<U>(self, mut f: impl FnMut(T) -> U) -> SplatTensors<U> {
                SplatTensors { $($field: f(self.$field),)* }
            }

            /// Pairs each field with the same field of `other`.
            pub fn zip<U>(self, other: SplatTensors<U>) -> SplatTensors<(T, U)> {
                SplatTensors { $($field: (self.$field, other.$field),)* }
            }
        }
    };
}

splat_tensors! {
    /// Centres in world coordinates, `[N, 3]`.
    means,
    /// Rotations w, x, y, z of any nonzero norm, `[N, 4]`.
    quaternions,
    /// Logarithms of the standard deviations along the axes, `[N, 3]`.
    log_scales,
    /// Opacities before the sigmoid, `[N]`.
    opacity_logits,
    /// SH coefficients of the colours, `[N, coefficients, 3]`.
    sh,
    /// Extra channels, `[N, features]`; without features, the tensor is a placeholder of two values.
    features,
    /// Background, `[3 + features]`.
    background,
    /// The carrier of the statistic. Its values, `[1, 2]` or `[N, 2]`, are not read; its gradient, `[N, 2]`, is the
    /// statistic.
    probe,
}

/// The sizes that determine the shapes of the tensors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct SplatSizes {
    /// Number of Gaussians.
    pub count: usize,
    /// Stored coefficients per Gaussian; those above the rendered degree are not read.
    pub coefficients: usize,
    /// Extra features per Gaussian.
    pub features: usize,
}

impl SplatSizes {
    /// Blended channels: colour, features, depth.
    pub fn channels(&self) -> usize {
        channel_count(self.features)
    }

    /// The shapes of the tensors and of their gradients; a probe may have one row instead of `count`.
    pub fn shapes(&self) -> SplatTensors<Vec<usize>> {
        let Self { count, coefficients, features } = *self;
        SplatTensors {
            means: vec![count, 3],
            quaternions: vec![count, 4],
            log_scales: vec![count, 3],
            opacity_logits: vec![count],
            sh: vec![count, coefficients, COLOUR_CHANNELS],
            features: vec![count, features],
            background: vec![background_channels(self.channels())],
            probe: vec![count, 2],
        }
    }

    /// Values per Gaussian in each tensor: none in the background, which all Gaussians share.
    pub fn columns(&self) -> SplatTensors<usize> {
        SplatTensors { background: 0, ..self.shapes().map(|shape| shape[1..].iter().product()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZES: SplatSizes = SplatSizes { count: 7, coefficients: 4, features: 2 };

    #[test]
    fn arrays_have_the_order_of_the_fields() {
        let names = SplatTensors::NAMES.into_array();
        let order = ["means", "quaternions", "log_scales", "opacity_logits", "sh", "features", "background", "probe"];
        assert_eq!(names, order);
        assert_eq!(SplatTensors::from_array(names), SplatTensors::NAMES);
        assert_eq!(names.len(), TENSORS);
    }

    #[test]
    fn each_field_keeps_its_place() {
        let lengths = SplatTensors::NAMES.map(str::len);
        assert_eq!((lengths.means, lengths.log_scales, lengths.probe), (5, 10, 5));
        let mut pairs = SplatTensors::NAMES.zip(lengths);
        assert!(pairs.each_ref().into_array().into_iter().all(|(name, length)| name.len() == *length));
        *pairs.each_mut().sh = ("colour", 6);
        assert_eq!((pairs.sh, pairs.features), (("colour", 6), ("features", 8)));
    }

    #[test]
    fn a_gaussian_has_as_many_numbers_as_a_row_of_each_tensor() {
        let columns = SplatTensors {
            means: 3,
            quaternions: 4,
            log_scales: 3,
            opacity_logits: 1,
            sh: 12,
            features: 2,
            background: 0,
            probe: 2,
        };
        assert_eq!(SIZES.columns(), columns);
        assert_eq!((SIZES.channels(), SIZES.shapes().background), (6, vec![5]));
    }
}
