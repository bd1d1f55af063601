//! Files that are either whole or not there: written beside their place, then renamed.

use std::ffi::OsStr;
use std::io::Write;
use std::path::Path;

use anyhow::Context;
use image::{DynamicImage, ImageFormat};
use serde::Serialize;
use tempfile::NamedTempFile;

/// Prefix and suffix of temporary files. The prefix names the program, because they lie in folders of users as well.
const UNFINISHED: [&str; 2] = [".mvfusion-", ".part"];

/// Whether a file of this name is the rest of a file that this program was writing when it was killed.
pub(crate) fn is_unfinished(name: &OsStr) -> bool {
    let name = name.as_encoded_bytes();
    name.starts_with(UNFINISHED[0].as_bytes()) && name.ends_with(UNFINISHED[1].as_bytes())
}

/// A temporary file in the folder of `path`, with the permissions of an ordinary new file. It is later renamed to
/// `path`.
///
/// # Errors
/// If the folder is not writable.
pub(crate) fn beside(path: &Path) -> std::io::Result<NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(UNFINISHED[0]).suffix(UNFINISHED[1]);
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // By default, only the owner can read temporary files. The umask still applies.
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    builder.tempfile_in(folder)
}

/// Writes a file and waits until it is on the disk.
///
/// # Errors
/// If the file cannot be written; then whatever stood there before still does.
pub fn write(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    put(path, |file| {
        file.write_all(bytes)?;
        Ok(file.as_file().sync_all()?)
    })
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
    fn a_half_written_file_is_known_by_its_name_here_and_in_the_folders_of_runs() {
        let folder = tempfile::tempdir().expect("folder");
        let file = beside(&folder.path().join("a.gif")).expect("made");
        let name = file.path().file_name().expect("a name");
        assert!(is_unfinished(name) && mvfusion_model::files::is_unfinished(name), "{}", name.display());
        assert!(!is_unfinished(OsStr::new(".thesis.part")), "a file of somebody else");
    }

    #[test]
    fn the_error_names_the_file() {
        let error = write(Path::new("no/such/folder/a.json"), b"").expect_err("refused");
        assert!(format!("{error:#}").starts_with("cannot write no/such/folder/a.json: "), "{error:#}");
    }
}
