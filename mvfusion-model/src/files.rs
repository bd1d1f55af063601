//! Files that are either whole or not there, and what tells them apart.

use std::ffi::OsStr;
use std::path::Path;

use sha2::{Digest, Sha256};
use tempfile::NamedTempFile;

/// How the names of files begin and end that are not yet in their place.
const UNFINISHED: [&str; 2] = [".", ".part"];

/// Whether a file of this name was being written when its process was killed; nobody needs it.
pub fn is_unfinished(name: &OsStr) -> bool {
    let name = name.as_encoded_bytes();
    name.starts_with(UNFINISHED[0].as_bytes()) && name.ends_with(UNFINISHED[1].as_bytes())
}

/// A temporary file in the folder of `path`, to be renamed onto it, with the permissions of an ordinary new file.
///
/// # Errors
/// If the folder cannot be written to.
pub fn beside(path: &Path) -> std::io::Result<NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(UNFINISHED[0]).suffix(UNFINISHED[1]);
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // Temporary files are the owner's alone unless told otherwise; the umask still applies.
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    builder.tempfile_in(folder)
}

/// SHA-256 of bytes, in hexadecimal.
pub fn sha256(bytes: &[u8]) -> String {
    hexadecimal(Sha256::new_with_prefix(bytes))
}

/// A finished SHA-256 in hexadecimal.
pub(crate) fn hexadecimal(hash: Sha256) -> String {
    hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
}
