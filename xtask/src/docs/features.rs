//! The list of Cargo features, written from the comments of the manifests.

use std::fmt::Write as _;

use super::Fault;
use super::packages::{Feature, Package};

/// These repeat the features of what they build, for themselves.
const NOT_LISTED: [&str; 2] = ["mvfusion-tests", "xtask"];

/// The rows of a table: feature, packages that have it, comment.
pub fn list(packages: &[Package]) -> String {
    let mut names: Vec<&str> = Vec::new();
    let listed = || features(packages).filter(|(package, _)| !NOT_LISTED.contains(&package.name.as_str()));
    for (_, feature) in listed() {
        if !names.contains(&feature.name.as_str()) {
            names.push(&feature.name);
        }
    }
    let mut list = "| feature | crates | what it adds |\n|---|---|---|\n".to_owned();
    for name in names {
        let all: Vec<_> = listed().filter(|(_, feature)| feature.name == name).collect();
        let default = if all.iter().any(|(_, feature)| feature.default) { " (default)" } else { "" };
        let crates: Vec<_> = all.iter().map(|(package, _)| format!("`{}`", package.name)).collect();
        let comment = all.first().map_or("", |(_, feature)| &feature.comment);
        _ = writeln!(list, "| `{name}`{default} | {} | {} |", crates.join(", "), super::tables::cell(comment));
    }
    list
}

fn features(packages: &[Package]) -> impl Iterator<Item = (&Package, &Feature)> {
    packages.iter().flat_map(|package| package.features.iter().map(move |feature| (package, feature)))
}

/// Features without a comment, or with one that contradicts that of the same feature elsewhere.
pub fn faults(packages: &[Package]) -> Vec<Fault> {
    let mut faults = Vec::new();
    for (package, feature) in features(packages) {
        let (first, model) =
            features(packages).find(|(_, other)| other.name == feature.name).unwrap_or((package, feature));
        let message = if feature.comment.is_empty() {
            format!("the feature `{}` has no comment: write above it what it adds", feature.name)
        } else if feature.comment != model.comment {
            format!("the feature `{}` is described otherwise in {}: make the comments equal", feature.name, first.name)
        } else {
            continue;
        };
        faults.push(Fault { path: package.folder.join("Cargo.toml"), line: feature.line, message });
    }
    faults
}

#[cfg(test)]
mod tests {
    use super::super::packages::parse;
    use super::*;

    fn packages(manifests: &[&str]) -> Vec<Package> {
        manifests.iter().map(|manifest| parse("folder".into(), manifest).expect("a manifest")).collect()
    }

    #[test]
    fn features_are_listed_with_their_comment_in_the_order_of_the_manifest() {
        let manifest = "[package]\nname = \"a\"\n[features]\ndefault = [\"z\"]\n# Adds z,\n# or more.\nz = []\n# Adds b.\nb = []\n";
        let other = "[package]\nname = \"c\"\n[features]\n# Adds b.\nb = []\n";
        let packages = packages(&[manifest, other]);
        assert_eq!(faults(&packages), []);
        let rows: Vec<_> = list(&packages).lines().skip(2).map(str::to_owned).collect();
        assert_eq!(rows, ["| `z` (default) | `a` | Adds z, or more |", "| `b` | `a`, `c` | Adds b |"]);
    }

    #[test]
    fn a_feature_without_a_comment_is_found() {
        let packages = packages(&["[package]\nname = \"a\"\n[features]\n# Of the first.\nx = []\n\ny = []\n"]);
        let faults = faults(&packages);
        assert_eq!(faults.len(), 1);
        assert_eq!(faults[0].line, 7);
        assert!(faults[0].message.contains("`y` has no comment"), "{}", faults[0]);
    }

    #[test]
    fn two_comments_for_one_feature_are_found() {
        let manifests =
            ["a", "b"].map(|name| format!("[package]\nname = \"{name}\"\n[features]\n# Of {name}.\nx = []\n"));
        let faults = faults(&packages(&[&manifests[0], &manifests[1]]));
        assert_eq!(faults.len(), 1);
        assert!(faults[0].message.contains("described otherwise in a"), "{}", faults[0]);
    }
}
