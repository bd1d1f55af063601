//! The packages of the workspace, as their manifests describe them.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use toml::de::DeTable;

use super::text;

/// A member of the workspace.
#[derive(Debug)]
pub struct Package {
    pub name: String,
    /// From the root.
    pub folder: PathBuf,
    pub features: Vec<Feature>,
}

/// A line of the table `[features]`, `default` excepted.
#[derive(Debug)]
pub struct Feature {
    pub name: String,
    /// In the manifest, from one.
    pub line: usize,
    /// The comment above it.
    pub comment: String,
    pub default: bool,
}

/// The packages in the order of the workspace's manifest, but what a plain `cargo build` makes first.
pub fn all(root: &Path) -> Result<Vec<Package>> {
    let manifest = text(root, Path::new("Cargo.toml"))?;
    let manifest = DeTable::parse(&manifest).context("Cargo.toml is not TOML")?.into_inner();
    let members = |key: &str| -> Option<Vec<String>> {
        let list = manifest.get("workspace")?.get_ref().get(key)?.get_ref().as_array()?;
        list.iter().map(|member| Some(member.get_ref().as_str()?.to_owned())).collect()
    };
    let mut folders = members("default-members").unwrap_or_default();
    let others = members("members").context("Cargo.toml has no list `workspace.members`")?;
    folders.extend(others.into_iter().filter(|other| !folders.contains(other)).collect::<Vec<_>>());
    folders.into_iter().map(|folder| read(root, folder.into())).collect()
}

fn read(root: &Path, folder: PathBuf) -> Result<Package> {
    let path = folder.join("Cargo.toml");
    let manifest = text(root, &path)?;
    parse(folder, &manifest).with_context(|| format!("{} cannot be read as a package's manifest", path.display()))
}

/// Reads a manifest.
pub fn parse(folder: PathBuf, manifest: &str) -> Result<Package> {
    let table = DeTable::parse(manifest).context("it is not TOML")?.into_inner();
    let name = table.get("package").and_then(|package| package.get_ref().get("name")?.get_ref().as_str());
    let name = name.context("it has no `package.name`")?.to_owned();
    let Some(listed) = table.get("features").and_then(|features| features.get_ref().as_table()) else {
        return Ok(Package { name, folder, features: Vec::new() });
    };
    let default = listed.get("default").and_then(|default| default.get_ref().as_array());
    let is_default =
        |name: &str| default.is_some_and(|list| list.iter().any(|entry| entry.get_ref().as_str() == Some(name)));
    let lines: Vec<_> = manifest.lines().collect();
    let mut features: Vec<_> = listed
        .keys()
        .filter(|key| key.get_ref() != "default")
        .map(|key| {
            let name = key.get_ref().to_string();
            let line = 1 + manifest[..key.span().start].matches('\n').count();
            Feature { line, comment: comment(&lines[..line - 1]), default: is_default(&name), name }
        })
        .collect();
    features.sort_by_key(|feature| feature.line);
    Ok(Package { name, folder, features })
}

/// The comment that ends the lines, as one line.
fn comment(lines: &[&str]) -> String {
    let start = lines.iter().rposition(|line| !line.starts_with('#')).map_or(0, |before| before + 1);
    let words: Vec<_> = lines[start..].iter().map(|line| line.trim_start_matches('#').trim()).collect();
    words.join(" ")
}
