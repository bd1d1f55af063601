//! What stands in for the output of a motion-aware module, to see what the output is worth.

use burn::tensor::{Int, Tensor};
use serde::{Deserialize, Serialize};

use crate::random::Stream;
use crate::tensors;

/// A motion-aware module.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MotionModule {
    /// The motion-variance feature.
    Mvg,
    /// The temporal feature.
    Mfta,
}

/// What stands in for the output `[N, H]` of a module. Without gradient; for evaluation.
#[derive(Clone, Debug)]
pub enum Substitute {
    /// The same at all times: `[1, H]` for all Gaussians, or `[N, H]` for each of them.
    Fixed(Box<Tensor<2>>),
    /// The output of another Gaussian at the same time.
    Shuffled,
}

/// The substitutes of both modules; without one, a module computes its own output.
#[derive(Clone, Debug, Default)]
pub struct Substitutes {
    /// Of MVG.
    pub mvg: Option<Substitute>,
    /// Of MFTA.
    pub mfta: Option<Substitute>,
}

impl MotionModule {
    /// Both modules.
    pub const ALL: [Self; 2] = [Self::Mvg, Self::Mfta];

    /// Name in files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Mvg => "mvg",
            Self::Mfta => "mfta",
        }
    }
}

impl Substitute {
    /// Seed of the permutations.
    const SEED: u64 = 0;

    /// The same features at all times: `[1, H]` for all Gaussians, or `[N, H]` for each of them.
    pub fn fixed(features: Tensor<2>) -> Self {
        Self::Fixed(Box::new(features))
    }

    /// What stands in for the output of `count` Gaussians.
    fn output(&self, count: usize, own: impl FnOnce() -> Tensor<2>) -> Tensor<2> {
        match self {
            Self::Fixed(features) if features.dims()[0] == 1 => features.as_ref().clone().repeat(&[count, 1]),
            Self::Fixed(features) => features.as_ref().clone(),
            Self::Shuffled => {
                let own = own();
                // Round a random circle, so that no Gaussian has its own output, unless it is alone.
                let circle = Stream::new(Self::SEED, 0).permutation(count);
                let mut rows = vec![0; count];
                circle.iter().zip(circle.iter().cycle().skip(1)).for_each(|(&row, &next)| rows[row] = next);
                let rows = tensors::rows_like(&rows, &own);
                own.select(0, rows)
            }
        }
    }

    fn select(self, rows: &Tensor<1, Int>) -> Self {
        match self {
            Self::Fixed(features) if features.dims()[0] > 1 => Self::fixed(features.select(0, rows.clone())),
            other => other,
        }
    }
}

impl Substitutes {
    /// Whether each module computes its own output.
    pub fn is_empty(&self) -> bool {
        self.mvg.is_none() && self.mfta.is_none()
    }

    /// One module's substitute.
    pub fn of(module: MotionModule, substitute: Substitute) -> Self {
        match module {
            MotionModule::Mvg => Self { mvg: Some(substitute), mfta: None },
            MotionModule::Mfta => Self { mvg: None, mfta: Some(substitute) },
        }
    }

    /// Those of the given Gaussians, in that order.
    pub fn select(&self, rows: &Tensor<1, Int>) -> Self {
        let select = |substitute: &Option<Substitute>| substitute.clone().map(|substitute| substitute.select(rows));
        Self { mvg: select(&self.mvg), mfta: select(&self.mfta) }
    }

    /// The output of a module, or what stands in for it.
    pub(super) fn output(&self, module: MotionModule, count: usize, own: impl FnOnce() -> Tensor<2>) -> Tensor<2> {
        let substitute = match module {
            MotionModule::Mvg => &self.mvg,
            MotionModule::Mfta => &self.mfta,
        };
        match substitute {
            Some(substitute) => substitute.output(count, own),
            None => own(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_support::{for_each_device, values};

    #[test]
    fn a_substitute_stands_in_for_its_module_alone() {
        for_each_device(|device| {
            let own = || Tensor::<2>::from_data([[1.0f32], [2.0], [3.0], [4.0], [5.0]], &device);
            let fixed = Substitutes::of(MotionModule::Mvg, Substitute::fixed(Tensor::from_data([[7.0f32]], &device)));
            let seen = |substitutes: &Substitutes, module| values(substitutes.output(module, 5, own));
            assert_eq!(seen(&fixed, MotionModule::Mvg), [7.0; 5]);
            assert_eq!(seen(&fixed, MotionModule::Mfta), [1.0, 2.0, 3.0, 4.0, 5.0]);

            let shuffled = seen(&Substitutes::of(MotionModule::Mfta, Substitute::Shuffled), MotionModule::Mfta);
            let mut sorted = shuffled.clone();
            sorted.sort_by(f64::total_cmp);
            assert_eq!(sorted, [1.0, 2.0, 3.0, 4.0, 5.0]);
            assert!(shuffled.iter().zip(&sorted).all(|(shuffled, own)| shuffled != own), "{shuffled:?}");

            let each = Substitutes::of(MotionModule::Mvg, Substitute::fixed(own()));
            let rows = Tensor::from_data([3i32, 0], &device);
            let found = each.select(&rows).output(MotionModule::Mvg, 2, || unreachable!("it has a substitute"));
            assert_eq!(values(found), [4.0, 1.0]);
        });
    }
}
