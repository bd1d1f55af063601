//! Files that are either whole or not there: written beside their place, then renamed.

use std::io::Write;
use std::path::Path;

use anyhow::Context;
use image::{DynamicImage, ImageFormat};
pub(crate) use mvfusion_model::files::{beside, is_unfinished, sync_folder};
use serde::Serialize;
use tempfile::NamedTempFile;

/// Writes a file and waits until it is on the disk.
///
/// # Errors
/// If the file cannot be written; then whatever stood there before still does.
pub fn write(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    put(path, |file| {
        file.write_all(bytes)?;
        Ok(file.as_file().sync_all()?)
    })?;
    sync_folder(path);
    Ok(())
}

/// Writes a file without waiting for the disk: one of many, each of which can be made again.
///
/// # Errors
/// As [`write()`].
pub fn write_unsynced(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    put(path, |file| Ok(file.write_all(bytes)?))
}

/// Writes a value as indented JSON, numbers in full precision.
///
/// # Errors
/// As [`write()`].
pub fn write_json(path: &Path, value: &impl Serialize) -> anyhow::Result<()> {
    let mut text = serde_json::to_string_pretty(value).with_context(|| format!("cannot write {}", path.display()))?;
    text.push('\n');
    write(path, text.as_bytes())
}

/// Writes a picture as PNG, as [`write_unsynced`] does.
///
/// # Errors
/// As [`write()`].
pub fn write_png(path: &Path, picture: impl Into<DynamicImage>) -> anyhow::Result<()> {
    let picture = picture.into();
    put(path, |file| Ok(picture.save_with_format(file.path(), ImageFormat::Png)?))
}

/// Puts a file in its place, after `fill` has written it.
fn put(path: &Path, fill: impl FnOnce(&mut NamedTempFile) -> anyhow::Result<()>) -> anyhow::Result<()> {
    let attempt = || -> anyhow::Result<()> {
        let mut file = beside(path)?;
        fill(&mut file)?;
        file.persist(path)?;
        Ok(())
    };
    attempt().with_context(|| format!("cannot write {}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_replaced_and_nothing_is_left_beside_it() {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("a.json");
        write(&path, b"old").expect("written");
        write_json(&path, &[0.1f64]).expect("written");
        assert_eq!(std::fs::read_to_string(&path).expect("read"), "[\n  0.1\n]\n");
        assert_eq!(std::fs::read_dir(folder.path()).expect("listed").count(), 1);
    }

    #[test]
    fn the_error_names_the_file() {
        let error = write(Path::new("no/such/folder/a.json"), b"").expect_err("refused");
        assert!(format!("{error:#}").starts_with("cannot write no/such/folder/a.json: "), "{error:#}");
    }
}
