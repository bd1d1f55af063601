//! The folder of the LPIPS weights: which one a command uses, and who named it.

use std::ffi::OsStr;
use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use etcetera::BaseStrategy;
use mvfusion_model::evaluation::Backbone;
use serde::{Deserialize, Serialize};

/// The environment variable that names a folder.
pub const VARIABLE: &str = "MVFUSION_LPIPS";

/// Stands for no folder, in the option, the key and the variable.
const NONE: &str = "none";

/// The default folder within the data folder of the user.
const DEFAULT: [&str; 2] = ["mvfusion", "lpips"];

/// A folder with weights.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct LpipsFolder {
    /// The folder.
    pub folder: PathBuf,
    /// Who named it.
    pub named_by: NamedBy,
}

/// Who named a folder, from the strongest to the weakest.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum NamedBy {
    /// `--lpips-weights` or `eval.lpips_weights`.
    Setting,
    /// [`VARIABLE`].
    Variable,
    /// Nobody: it is the default folder.
    Default,
}

impl fmt::Display for LpipsFolder {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.folder.display())?;
        match self.named_by {
            NamedBy::Setting => Ok(()),
            NamedBy::Variable => write!(f, " (from {VARIABLE})"),
            NamedBy::Default => write!(f, " (the default folder)"),
        }
    }
}

/// Whether a setting stands for no folder. A folder of that name is `./none`.
pub fn is_none(setting: &Path) -> bool {
    setting == NONE
}

/// A setting as it is kept: absolute, so that it holds in any current folder.
///
/// # Errors
/// If the path has no absolute form.
pub fn kept(setting: &Path) -> io::Result<PathBuf> {
    if is_none(setting) { Ok(setting.to_owned()) } else { std::path::absolute(setting) }
}

/// The folder that `train` and `eval` look into by themselves; `None` where the system does not tell the user's.
pub fn default_folder() -> Option<PathBuf> {
    let strategy = etcetera::base_strategy::choose_native_strategy().ok()?;
    Some(DEFAULT.iter().fold(strategy.data_dir(), |folder, name| folder.join(name)))
}

/// The folder for a setting, or else of the environment, or else the default one if it contains weights.
///
/// # Errors
/// If a path has no absolute form.
pub fn find(setting: Option<&Path>) -> io::Result<Option<LpipsFolder>> {
    let variable = std::env::var_os(VARIABLE);
    let Some(found) = choose(setting, variable.as_deref(), default_folder()) else { return Ok(None) };
    Ok(Some(LpipsFolder { folder: std::path::absolute(found.folder)?, ..found }))
}

fn choose(setting: Option<&Path>, variable: Option<&OsStr>, default: Option<PathBuf>) -> Option<LpipsFolder> {
    let named =
        |folder: &Path, named_by| (!is_none(folder)).then(|| LpipsFolder { folder: folder.to_owned(), named_by });
    if let Some(setting) = setting {
        return named(setting, NamedBy::Setting);
    }
    if let Some(variable) = variable.filter(|variable| !variable.is_empty()) {
        return named(Path::new(variable), NamedBy::Variable);
    }
    let has_weights = |folder: &PathBuf| Backbone::ALL.iter().any(|backbone| backbone.file_in(folder).is_some());
    default.filter(has_weights).map(|folder| LpipsFolder { folder, named_by: NamedBy::Default })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_setting_beats_the_variable_and_that_beats_the_default_folder() {
        let default = tempfile::tempdir().expect("folder");
        let folder = Some(default.path().to_owned());
        let chosen = |setting: Option<&str>, variable: Option<&str>| {
            choose(setting.map(Path::new), variable.map(OsStr::new), folder.clone())
                .map(|found| (found.folder.display().to_string(), found.named_by))
        };
        assert_eq!(chosen(None, None), None, "nothing is in the folder");
        std::fs::write(default.path().join("lpips_vgg_f16.safetensors"), b"").expect("written");
        let by_default = Some((default.path().display().to_string(), NamedBy::Default));
        assert_eq!(chosen(None, None), by_default);
        assert_eq!(chosen(None, Some("")), by_default);
        assert_eq!(chosen(None, Some("b")), Some(("b".into(), NamedBy::Variable)));
        assert_eq!(chosen(Some("a"), Some("b")), Some(("a".into(), NamedBy::Setting)));
    }

    #[test]
    fn none_switches_all_weaker_ones_off() {
        let default = tempfile::tempdir().expect("folder");
        std::fs::write(default.path().join("lpips_alex_f32.safetensors"), b"").expect("written");
        let chosen = |setting: Option<&str>, variable: Option<&str>| {
            choose(setting.map(Path::new), variable.map(OsStr::new), Some(default.path().to_owned()))
        };
        assert_eq!(chosen(Some("none"), Some("b")), None);
        assert_eq!(chosen(None, Some("none")), None);
        assert!(chosen(Some("./none"), None).is_some());
        assert_eq!(kept(Path::new("none")).expect("kept"), Path::new("none"));
        assert!(kept(Path::new("./none")).expect("kept").is_absolute());
    }
}
