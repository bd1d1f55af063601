//! The presets that ship inside the program.

use crate::failure::UsageError;

use super::keys::nearest;

/// A named configuration to start from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Preset {
    /// Its name, for `--preset`.
    pub name: &'static str,
    /// What it is for, a line.
    pub purpose: &'static str,
    /// The TOML: what differs from the defaults.
    pub text: &'static str,
}

/// All presets.
pub const PRESETS: &[Preset] = &[
    Preset {
        name: "quickstart",
        purpose: "the built-in scenes in a few minutes on a CPU",
        text: include_str!("../../presets/quickstart.toml"),
    },
    Preset {
        name: "neu3d",
        purpose: "multi-camera video in the layout of Neu3D, at the paper's full length",
        text: include_str!("../../presets/neu3d.toml"),
    },
];

impl Preset {
    /// The preset of a name.
    ///
    /// # Errors
    /// [`UsageError`] with the names there are.
    pub fn find(name: &str) -> Result<&'static Self, UsageError> {
        PRESETS.iter().find(|preset| preset.name == name).ok_or_else(|| {
            let names = PRESETS.iter().map(|preset| preset.name);
            let meant = nearest(name, names.clone()).map_or(String::new(), |near| format!("; the nearest is `{near}`"));
            let all = names.collect::<Vec<_>>().join(", ");
            UsageError::new(format!("there is no preset `{name}`{meant}. The presets are: {all}."))
        })
    }
}
