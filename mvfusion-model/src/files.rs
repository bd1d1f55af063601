//! Files that are either complete or absent, and their SHA-256.

use std::ffi::OsStr;
use std::path::Path;

use sha2::{Digest, Sha256};
use tempfile::NamedTempFile;

/// Prefix and suffix of temporary files. The prefix names the program, because they lie in folders of users as well.
const UNFINISHED: [&str; 2] = [".mvfusion-", ".part"];

/// Whether a file of this name is the rest of one that this program was writing when it was killed. It can be deleted.
pub fn is_unfinished(name: &OsStr) -> bool {
    let name = name.as_encoded_bytes();
    name.starts_with(UNFINISHED[0].as_bytes()) && name.ends_with(UNFINISHED[1].as_bytes())
}

/// A temporary file in the folder of `path`, with the permissions of an ordinary new file. It is later renamed to
/// `path`.
///
/// # Errors
/// If the folder is not writable.
pub fn beside(path: &Path) -> std::io::Result<NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(UNFINISHED[0]).suffix(UNFINISHED[1]);
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // By default, only the owner can read temporary files. The umask still applies.
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    builder.tempfile_in(folder_of(path))
}

/// Waits until the name of a renamed file is on the disk, where the system can. Without this, the name may be lost with
/// the power, although the contents are not.
pub fn sync_folder(path: &Path) {
    #[cfg(unix)]
    if let Ok(folder) = std::fs::File::open(folder_of(path)) {
        // Some file systems cannot sync a folder; the file is then as safe as they make it.
        let _ = folder.sync_all();
    }
    #[cfg(not(unix))]
    let _ = path;
}

fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// SHA-256 of bytes, in hexadecimal.
pub fn sha256(bytes: &[u8]) -> String {
    hexadecimal(Sha256::new_with_prefix(bytes))
}

/// A finished SHA-256 in hexadecimal.
pub(crate) fn hexadecimal(hash: Sha256) -> String {
    hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_half_written_file_is_known_by_its_name() {
        let folder = tempfile::tempdir().expect("folder");
        let file = beside(&folder.path().join("a.gif")).expect("made");
        let name = file.path().file_name().expect("a name");
        assert!(is_unfinished(name), "{}", name.display());
        assert!(!is_unfinished(OsStr::new(".thesis.part")), "a file of somebody else");
    }
}
