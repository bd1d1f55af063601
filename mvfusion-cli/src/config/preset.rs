//! The presets that ship inside the program.

use crate::failure::UsageError;

use super::keys::nearest;

/// A named configuration to start from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Preset {
    /// Its name, for `--preset`.
    pub name: &'static str,
    /// Its purpose, in one line.
    pub purpose: &'static str,
    /// The preset that it builds on; `None` for the defaults of all keys.
    pub base: Option<&'static str>,
    /// The TOML text with the differences from the base.
    pub text: &'static str,
}

/// A preset with the TOML of its name.
macro_rules! preset {
    ($name:literal, $purpose:literal, $base:expr) => {
        Preset {
            name: $name,
            purpose: $purpose,
            base: $base,
            text: include_str!(concat!("../../presets/", $name, ".toml")),
        }
    };
}

/// All presets. A base comes before the presets that build on it.
pub const PRESETS: &[Preset] = &[
    preset!("quickstart", "the built-in scenes in a few minutes on a CPU", None),
    preset!(
        "quickstart-degauss",
        "the same without MVG and MFTA: our base, DeGauss with additions",
        Some("quickstart")
    ),
    preset!("quickstart-4dgs", "the same with only the dynamic branch: 4DGS", Some("quickstart")),
    preset!("quickstart-4dgs-motion", "4DGS with motion-aware refinement plugged in", Some("quickstart-4dgs")),
    preset!("neu3d", "multi-camera video in the layout of Neu3D, at the paper's full length", None),
    preset!("neu3d-degauss", "the same with DeGauss", Some("neu3d")),
    preset!("neu3d-4dgs", "the same with 4DGS", Some("neu3d")),
    preset!("neu3d-4dgs-motion", "4DGS with motion-aware refinement plugged in", Some("neu3d-4dgs")),
    preset!("onthego-indoor", "photos of a static scene with passers-by: NeRF On-the-go, indoors", None),
    preset!("onthego-indoor-degauss", "the same with DeGauss", Some("onthego-indoor")),
    preset!("onthego-outdoor", "NeRF On-the-go, outdoors", Some("onthego-indoor")),
    preset!("onthego-outdoor-degauss", "the same with DeGauss", Some("onthego-outdoor")),
    preset!("robustnerf", "photos of a scene with moved objects: RobustNeRF", Some("onthego-indoor")),
    preset!("robustnerf-degauss", "the same with DeGauss", Some("robustnerf")),
    preset!("hypernerf", "video of one or two moving cameras: HyperNeRF", Some("neu3d")),
    preset!("hypernerf-degauss", "the same with DeGauss", Some("hypernerf")),
    preset!("hypernerf-4dgs", "the same with 4DGS", Some("hypernerf")),
    preset!("hypernerf-4dgs-motion", "4DGS with motion-aware refinement plugged in", Some("hypernerf-4dgs")),
    preset!("dnerf", "synthetic objects of D-NeRF, with 4DGS", Some("neu3d-4dgs")),
    preset!("dnerf-motion", "4DGS with motion-aware refinement plugged in", Some("dnerf")),
];

impl Preset {
    /// This preset and all presets that it builds on, the most basic first.
    pub fn lineage(&'static self) -> Vec<&'static Self> {
        let base = |preset: &&'static Self| PRESETS.iter().find(|other| Some(other.name) == preset.base);
        let mut lineage: Vec<_> = std::iter::successors(Some(self), base).collect();
        lineage.reverse();
        lineage
    }

    /// The preset of a name.
    ///
    /// # Errors
    /// [`UsageError`] that lists all names.
    pub fn find(name: &str) -> Result<&'static Self, UsageError> {
        PRESETS.iter().find(|preset| preset.name == name).ok_or_else(|| {
            let names = PRESETS.iter().map(|preset| preset.name);
            let meant = nearest(name, names.clone()).map_or(String::new(), |near| format!(" Did you mean `{near}`?"));
            let all = names.collect::<Vec<_>>().join(", ");
            UsageError::new(format!("unknown preset `{name}`.{meant} The presets are: {all}."))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_base_stands_before_what_builds_on_it() {
        for (index, preset) in PRESETS.iter().enumerate() {
            let earlier = |base| PRESETS[..index].iter().any(|other| other.name == base);
            assert!(preset.base.is_none_or(earlier), "{}", preset.name);
        }
    }
}
