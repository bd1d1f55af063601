//! Storage of decoded frames: a folder of PNG files for each video and size.

use std::fs::{self, Metadata};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, UNIX_EPOCH};

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::imageops::{self, FilterType as ResizeFilter};
use image::{ImageEncoder, ImageError, RgbImage};
use sha2::{Digest, Sha256};
use tempfile::TempDir;

use super::flaw::Flaw;
use super::permit::Permit;
use crate::files::TemporaryFolder;

/// Part of the names of frame sets. Increase it when the same file results in different pixels.
const VERSION: u32 = 1;
/// Beginning of the names of temporary stores.
const TEMPORARY: &str = "mvfusion-frames-";
/// A partial set without a new frame for this time belongs to an interrupted run.
const ABANDONED: Duration = Duration::from_secs(3600);
const PARTIAL: &str = ".partial-";

const MAKE_WRITABLE: &str = "Name a folder in which this program may write with `--set scene.frame_store=FOLDER`.";
const MAKE_ROOM: &str = "Free some space there, or name a folder on a disk with more room with `--set \
                         scene.frame_store=FOLDER`; smaller or fewer frames need less.";

/// The store of decoded video frames.
#[derive(Clone, Debug)]
pub(crate) struct FrameStore {
    folder: Option<PathBuf>,
    /// Created when the first frame is requested, removed with the last store and video.
    temporary: Arc<Mutex<Option<TemporaryFolder>>>,
}

impl FrameStore {
    /// A store in `folder`, which keeps frames between runs. Without a folder, the store is temporary and removed with
    /// the last video. Nothing is written until the first frame is requested.
    pub(crate) fn new(folder: Option<&Path>) -> Self {
        Self { folder: folder.map(Path::to_owned), temporary: Arc::default() }
    }

    /// The folder of the sets.
    pub(super) fn folder(&self) -> Result<PathBuf, Flaw> {
        if let Some(folder) = &self.folder {
            fs::create_dir_all(folder).map_err(|e| unwritable(folder, &e))?;
            return Ok(folder.clone());
        }
        let mut temporary = self.temporary.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(folder) = &*temporary {
            return Ok(folder.path().to_owned());
        }
        let parent = std::env::temp_dir();
        let folder = TemporaryFolder::new(&parent, &mut tempfile::Builder::new(), TEMPORARY)
            .map_err(|e| unwritable(&parent, &e))?;
        Ok(temporary.insert(folder).path().to_owned())
    }
}

/// Name of the folder with the frames of a video. A replaced file gets another name.
pub(super) fn set_name(video: &Path, metadata: &Metadata, (width, height): (u32, u32), frames: usize) -> String {
    let whole = fs::canonicalize(video).unwrap_or_else(|_| video.to_owned());
    let changed = metadata.modified().ok().and_then(|time| time.duration_since(UNIX_EPOCH).ok()).unwrap_or_default();
    let mut hash = Sha256::new();
    hash.update(whole.as_os_str().as_encoded_bytes());
    hash.update(format!("\0{VERSION} {} {}", metadata.len(), changed.as_nanos()));
    let hash: String = hash.finalize().iter().take(8).map(|byte| format!("{byte:02x}")).collect();
    let stem: String = video.file_stem().unwrap_or_default().to_string_lossy().chars().take(40).collect();
    let stem = stem.replace(|c: char| !c.is_ascii_alphanumeric() && !"-_".contains(c), "_");
    format!("{stem}-{hash}-{width}x{height}-{frames}")
}

/// The file of a frame in the folder of a set.
pub(super) fn frame_file(folder: &Path, index: usize) -> PathBuf {
    folder.join(format!("{index:06}.png"))
}

/// Whether a folder contains all frames of a set.
pub(super) fn is_complete(folder: &Path, frames: usize) -> bool {
    folder.is_dir() && (0..frames).all(|index| frame_file(folder, index).is_file())
}

/// Writes the frames of a video into a new set. The set has a temporary name until it is complete, so an interrupted
/// run leaves no set that looks complete.
pub(super) struct SetWriter {
    folder: PathBuf,
    /// Removed with its content unless the set is finished.
    partial: TempDir,
    size: (u32, u32),
    wanted: usize,
    written: usize,
    at_once: usize,
    waiting: Vec<RgbImage>,
}

impl SetWriter {
    /// `folder` is the folder of the finished set, `wanted` its number of frames.
    pub(super) fn new(folder: &Path, size: (u32, u32), wanted: usize) -> Result<Self, Flaw> {
        let (parent, name) = (folder.parent().unwrap_or(folder), folder.file_name().unwrap_or_default());
        let prefix = format!("{}{PARTIAL}", name.to_string_lossy());
        remove_abandoned(parent, &prefix);
        let partial = tempfile::Builder::new().prefix(&prefix).tempdir_in(parent);
        let partial = partial.map_err(|e| unwritable(parent, &e))?;
        let at_once = Permit::frames_at_once();
        Ok(Self { folder: folder.to_owned(), partial, size, wanted, written: 0, at_once, waiting: Vec::new() })
    }

    /// Adds the next frame. Frames after the last wanted one are dropped.
    pub(super) fn push(&mut self, frame: RgbImage) -> Result<(), Flaw> {
        if self.written + self.waiting.len() < self.wanted {
            self.waiting.push(frame);
        }
        match self.waiting.len() >= self.at_once {
            true => self.write(),
            false => Ok(()),
        }
    }

    /// Resizes and writes the waiting frames, on separate threads. A waiting thread of rayon's pool could get another
    /// frame of the same video, and would then deadlock.
    fn write(&mut self) -> Result<(), Flaw> {
        let (folder, size) = (self.partial.path(), self.size);
        let frames = (self.written..).zip(&self.waiting);
        std::thread::scope(|scope| {
            let started: Vec<_> =
                frames.map(|(index, frame)| scope.spawn(move || write_frame(folder, index, frame, size))).collect();
            let panicked = || Flaw::new(folder, "a thread that writes frames has panicked", "Report it as a bug.");
            started.into_iter().try_for_each(|thread| thread.join().unwrap_or_else(|_| Err(panicked())))
        })?;
        self.written += self.waiting.len();
        self.waiting.clear();
        Ok(())
    }

    /// Renames the set if it is complete. Returns its number of frames.
    pub(super) fn finish(mut self) -> Result<usize, Flaw> {
        self.write()?;
        if self.written < self.wanted {
            return Ok(self.written);
        }
        let place = || share(self.partial.path()).and_then(|()| fs::rename(self.partial.path(), &self.folder));
        let placed = match place() {
            // Another process has created the same set in the meantime, and may be reading it.
            Err(_) if is_complete(&self.folder, self.wanted) => return Ok(self.written),
            // An incomplete set is in the way.
            Err(_) => match fs::remove_dir_all(&self.folder) {
                Err(e) if e.kind() != io::ErrorKind::NotFound => Err(e),
                _ => place(),
            },
            Ok(()) => Ok(()),
        };
        placed.map_err(|e| unwritable(&self.folder, &e))?;
        // Nothing is left to remove under the old name.
        drop(self.partial.keep());
        Ok(self.written)
    }
}

/// Opens a folder to other users. Temporary folders are private, but kept sets need not be.
fn share(folder: &Path) -> io::Result<()> {
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        let parent = folder.parent().unwrap_or(folder);
        fs::set_permissions(folder, fs::Permissions::from_mode(fs::metadata(parent)?.permissions().mode()))?;
    }
    #[cfg(not(unix))]
    let _ = folder;
    Ok(())
}

fn write_frame(folder: &Path, index: usize, frame: &RgbImage, (width, height): (u32, u32)) -> Result<(), Flaw> {
    let resized;
    let frame = match frame.dimensions() == (width, height) {
        true => frame,
        false => {
            resized = imageops::resize(frame, width, height, ResizeFilter::Lanczos3);
            &resized
        }
    };
    let mut bytes = Vec::new();
    PngEncoder::new_with_quality(&mut bytes, CompressionType::Fast, FilterType::Adaptive)
        .write_image(frame.as_raw(), width, height, image::ExtendedColorType::Rgb8)
        .map_err(|e| match e {
            ImageError::IoError(e) => unwritable(folder, &e),
            e => Flaw::new(folder, e, MAKE_WRITABLE),
        })?;
    fs::write(frame_file(folder, index), bytes).map_err(|e| unwritable(folder, &e))
}

/// Removes partial sets of interrupted runs. Failure is harmless.
fn remove_abandoned(parent: &Path, prefix: &str) {
    let Ok(entries) = fs::read_dir(parent) else { return };
    for entry in entries.flatten().filter(|entry| entry.file_name().to_string_lossy().starts_with(prefix)) {
        let age = entry.metadata().and_then(|m| m.modified()).ok().and_then(|time| time.elapsed().ok());
        if age.is_some_and(|age| age > ABANDONED) {
            let _ = fs::remove_dir_all(entry.path());
        }
    }
}

fn unwritable(folder: &Path, error: &io::Error) -> Flaw {
    match error.kind() {
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => {
            Flaw::new(folder, format!("the disk is full, decoded frames cannot be kept there ({error})"), MAKE_ROOM)
        }
        _ => Flaw::new(folder, format!("decoded frames cannot be kept there ({error})"), MAKE_WRITABLE),
    }
}
