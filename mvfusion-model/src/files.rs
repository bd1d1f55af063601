//! Files that are either whole or not there.

use std::path::Path;

use tempfile::NamedTempFile;

/// A temporary file in the folder of `path`, to be renamed onto it, with the permissions of an ordinary new file.
///
/// # Errors
/// If the folder cannot be written to.
pub fn beside(path: &Path) -> std::io::Result<NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(".").suffix(".part");
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // Temporary files are the owner's alone unless told otherwise; the umask still applies.
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    builder.tempfile_in(folder)
}
