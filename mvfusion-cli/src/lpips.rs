//! The folder of the LPIPS weights: which one a command uses, and who named it.

use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use etcetera::BaseStrategy;
use mvfusion_model::evaluation::{Backbone, Protocol};
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

/// The value of `--lpips-weights` as it is kept.
///
/// # Errors
/// If the folder has no weights of a network that the protocol needs, or the path has no absolute form.
pub fn of_option(option: &Path, protocol: Protocol) -> anyhow::Result<PathBuf> {
    if !is_none(option) {
        check_option(option, &protocol.lpips().map(|variant| variant.backbone).collect())?;
    }
    kept(option).with_context(|| format!("cannot use the path {}", option.display()))
}

/// Rejects a folder that `--lpips-weights` names if it has no weights of any of the networks.
///
/// # Errors
/// With the files that were looked for.
pub fn check_option(folder: &Path, networks: &BTreeSet<Backbone>) -> anyhow::Result<()> {
    if !folder.exists() {
        bail!("--lpips-weights {}: there is no such folder", folder.display());
    }
    let missing = missing(folder, networks);
    if !networks.is_empty() && missing.len() == networks.len() {
        let (folder, files) = (folder.display(), files_of(&missing));
        bail!("--lpips-weights {folder}: found no {files} or equivalent (docs/evaluation.md)");
    }
    Ok(())
}

/// Those of the networks whose weights are not in a folder.
pub fn missing(folder: &Path, networks: &BTreeSet<Backbone>) -> Vec<Backbone> {
    networks.iter().copied().filter(|network| network.file_in(folder).is_none()).collect()
}

/// The files of networks, in the words that follow "no".
pub fn files_of(networks: &[Backbone]) -> String {
    let files = networks.iter().map(|network| format!("lpips_{}_f32.safetensors", network.name()));
    files.collect::<Vec<_>>().join(" and no ")
}

/// Whether a folder has the weights of any network.
pub fn has_weights(folder: &Path) -> bool {
    Backbone::ALL.iter().any(|backbone| backbone.file_in(folder).is_some())
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
    default.filter(|folder| has_weights(folder)).map(|folder| LpipsFolder { folder, named_by: NamedBy::Default })
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
    fn an_option_names_a_folder_with_weights_that_the_protocol_needs_or_none() {
        let folder = tempfile::tempdir().expect("folder");
        let given = |protocol| of_option(folder.path(), protocol).map_err(|error| error.to_string());
        let said = given(Protocol::Mvfusion).expect_err("nothing is in the folder");
        let files = "found no lpips_alex_f32.safetensors and no lpips_vgg_f32.safetensors or equivalent";
        assert!(said.starts_with("--lpips-weights ") && said.contains(files), "{said}");
        std::fs::write(folder.path().join("lpips_alex.safetensors"), b"").expect("written");
        assert_eq!(given(Protocol::Mvfusion).as_deref(), Ok(folder.path()));
        let said = given(Protocol::ThreeDgs).expect_err("it needs another network");
        assert!(said.contains("found no lpips_vgg_f32.safetensors or"), "{said}");
        assert_eq!(of_option(Path::new("none"), Protocol::Mvfusion).expect("none"), Path::new("none"));
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
