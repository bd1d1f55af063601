//! What this program was built from.

use std::fmt::Write;
use std::sync::LazyLock;

use serde::{Deserialize, Serialize};

/// Version of Burn that the workspace pins; a test compares it with the manifest.
pub const BURN: &str = "0.22.1";

/// A build of the program.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Program {
    /// Its version.
    pub version: String,
    /// The revision of its sources; absent if it was built without a repository.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub git: Option<GitRevision>,
    /// The cargo features that it was built with.
    pub features: Vec<String>,
}

/// A revision of the sources.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct GitRevision {
    /// The last commit that changed a source of the program.
    pub commit: String,
    /// Whether sources differed from it when they were compiled.
    #[serde(default)]
    pub dirty: bool,
}

impl Program {
    /// This build.
    pub fn this() -> Self {
        Self {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            git: git(),
            features: features().into_iter().map(str::to_owned).collect(),
        }
    }
}

/// The revision of this build, if it is known.
pub fn git() -> Option<GitRevision> {
    let commit = option_env!("MVFUSION_GIT_COMMIT")?.to_owned();
    Some(GitRevision { commit, dirty: option_env!("MVFUSION_GIT_DIRTY") == Some("true") })
}

/// The cargo features of this build, in the order of the manifest.
pub fn features() -> Vec<&'static str> {
    ALL_FEATURES.into_iter().filter_map(|(name, is_on)| is_on.then_some(name)).collect()
}

/// All features but `default`, and whether this build has them; a test compares the names with the manifest.
const ALL_FEATURES: [(&str, bool); 9] = [
    ("viewer", cfg!(feature = "viewer")),
    ("flex", cfg!(feature = "flex")),
    ("ndarray", cfg!(feature = "ndarray")),
    ("wgpu", cfg!(feature = "wgpu")),
    ("vulkan", cfg!(feature = "vulkan")),
    ("metal", cfg!(feature = "metal")),
    ("cuda", cfg!(feature = "cuda")),
    ("cuda-cpp", cfg!(feature = "cuda-cpp")),
    ("h264", cfg!(feature = "h264")),
];

/// The answer to `--version`.
pub fn long_version() -> &'static str {
    static TEXT: LazyLock<String> = LazyLock::new(|| {
        let Program { version, git, features } = Program::this();
        let mut text = version;
        let git = match git {
            Some(GitRevision { commit, dirty: true }) => format!("{commit}, with local changes"),
            Some(GitRevision { commit, dirty: false }) => commit,
            None => "unknown".to_owned(),
        };
        let target = format!("{} {}", std::env::consts::ARCH, std::env::consts::OS);
        let lines = [("git", git), ("features", features.join(", ")), ("burn", BURN.to_owned()), ("target", target)];
        for (name, value) in lines {
            // Proof: a string takes whatever is written.
            let _ = write!(text, "\n{name:10}{value}");
        }
        text
    });
    &TEXT
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_version_of_burn_is_the_one_that_the_workspace_pins() {
        let manifest = include_str!("../../Cargo.toml");
        assert!(manifest.contains(&format!("burn = {{ version = \"={BURN}\"")));
    }

    #[test]
    fn every_feature_of_the_manifest_is_known() {
        let manifest: toml::Table = include_str!("../Cargo.toml").parse().expect("TOML");
        let features = manifest["features"].as_table().expect("a table");
        let mut named: Vec<&str> = features.keys().map(String::as_str).filter(|name| *name != "default").collect();
        let mut known: Vec<&str> = ALL_FEATURES.into_iter().map(|(name, _)| name).collect();
        named.sort_unstable();
        known.sort_unstable();
        assert_eq!(named, known);
    }

    #[test]
    fn the_long_version_names_features_and_revision() {
        let text = long_version();
        assert!(text.starts_with(concat!(env!("CARGO_PKG_VERSION"), "\ngit       ")), "{text}");
        assert!(text.contains(&features().join(", ")), "{text}");
        if let Some(GitRevision { commit, .. }) = git() {
            assert!(commit.len() >= 40 && text.contains(&commit), "{text}");
        }
    }
}
