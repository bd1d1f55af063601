//! Videos: their frames as images.
//!
//! Training requests frames in random order and from several threads, but a video can only be decoded from its start.
//! Each video is therefore decoded once, frame by frame, into a folder of images. Later requests read these.

mod boxes;
#[cfg(feature = "h264")]
mod colour;
mod encode;
mod ffmpeg;
mod flaw;
#[cfg(feature = "h264")]
mod h264;
mod mp4;
mod permit;
mod samples;
mod sound;
mod store;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::fmt::Display;
use std::fs::Metadata;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use image::{DynamicImage, ImageReader};

pub use encode::{VideoWriter, can_write_videos};
pub(crate) use sound::sound;
pub(crate) use store::FrameStore;

use crate::error::DataError;
use crate::files::or_denied;
use flaw::{CHECK_FILE, EXTRACT, Flaw, READ_FEWER};
use permit::Permit;

/// Frames with more pixels are rejected, because a false header must not cause large allocations.
const MOST_PIXELS: u64 = 1 << 26;

/// A video file. Its frames are decoded when the first one is requested.
#[derive(Debug)]
pub struct Video {
    path: PathBuf,
    metadata: Metadata,
    /// Size of the upright frames.
    size: (u32, u32),
    len: usize,
    /// Number of frames of the file.
    available: usize,
    fps: Option<f64>,
    /// Absent if only ffmpeg can read the container.
    track: Option<mp4::Track>,
    decoder: VideoDecoder,
    store: FrameStore,
    /// The frames in each requested size. Each set has its own lock, which is held during decoding. Other callers wait
    /// for it.
    sets: Mutex<BTreeMap<(u32, u32), SharedSet>>,
}

type SharedSet = Arc<Mutex<FrameSet>>;

/// The frames of a video in one size.
#[derive(Debug)]
enum FrameSet {
    Wanted,
    /// Stored in this folder.
    Ready(PathBuf),
    /// Not decodable. This is remembered, because retrying for every frame would take hours.
    Failed(Flaw),
}

/// The decoder of videos.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum VideoDecoder {
    /// The program ffmpeg if it is installed, otherwise the built-in decoder.
    Auto,
    /// The program ffmpeg.
    #[cfg(test)]
    Ffmpeg,
    /// The built-in demuxer and decoder: mp4 with H.264.
    #[cfg(test)]
    BuiltIn,
}

impl VideoDecoder {
    fn is_ffmpeg(self) -> bool {
        match self {
            VideoDecoder::Auto => ffmpeg::is_installed(),
            #[cfg(test)]
            VideoDecoder::Ffmpeg => true,
            #[cfg(test)]
            VideoDecoder::BuiltIn => false,
        }
    }
}

impl Video {
    /// Opens a video. Only its headers are read, except for containers other than mp4: ffprobe reads these through to
    /// count their frames, and decodes VP8 for that. `limit` is the number of frames to use, from the first on.
    ///
    /// # Errors
    /// [`DataError::Content`] if the file is not a video, or cannot be decoded here. [`DataError::Denied`] if it may
    /// not be read.
    pub(crate) fn open(path: &Path, limit: usize, store: &FrameStore) -> Result<Arc<Self>, DataError> {
        let video = Self::with_decoder(path, limit, store, VideoDecoder::Auto);
        video.map(Arc::new).map_err(|flaw| or_denied(flaw.into()))
    }

    fn with_decoder(path: &Path, limit: usize, store: &FrameStore, decoder: VideoDecoder) -> Result<Self, Flaw> {
        let metadata = std::fs::metadata(path).map_err(|e| Flaw::new(path, e, "Check the name of the file."))?;
        if !metadata.is_file() {
            return Err(Flaw::new(path, "it is no file", CHECK_FILE));
        }
        let (size, frames, fps, track) = match mp4::read(path) {
            Ok(track) => (track.size(), track.shown, track.fps, Some(track)),
            // The demuxer supports only common forms of one container. A file that it rejects may still be valid.
            Err(refusal) if decoder.is_ffmpeg() => match ffmpeg::probe(path) {
                Ok(ffmpeg::Probed { size, frames, fps }) => (size, frames, fps, None),
                Err(reason) => {
                    let reason = format!("{refusal}, and ffprobe cannot read it either ({reason})");
                    return Err(Flaw::new(path, reason, CHECK_FILE));
                }
            },
            Err(refusal) => return Err(Flaw::new(path, refusal, EXTRACT)),
        };
        if frames == 0 || size.0 == 0 || size.1 == 0 || u64::from(size.0) * u64::from(size.1) > MOST_PIXELS {
            let reason = format!("its header tells of {frames} frames of {} x {} pixels", size.0, size.1);
            return Err(Flaw::new(path, reason, CHECK_FILE));
        }
        if let Some(track) = track.as_ref().filter(|_| !decoder.is_ffmpeg()) {
            can_decode(path, track)?;
        }
        let (path, store, len) = (path.to_owned(), store.clone(), frames.min(limit));
        let sets = Mutex::default();
        Ok(Self { path, metadata, size, len, available: frames, fps, track, decoder, store, sets })
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Number of frames, at most the limit.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Number of frames of the file, used or not.
    pub(crate) fn available(&self) -> usize {
        self.available
    }

    /// Whether there is no frame.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Width and height of the frames in pixels, upright.
    pub fn size(&self) -> (u32, u32) {
        self.size
    }

    /// Mean number of frames per second; `None` if the file does not tell it.
    pub fn fps(&self) -> Option<f64> {
        self.fps
    }

    /// Passes every frame with its index to `sink`, in display order, upright and in the video's size. Nothing is kept.
    ///
    /// # Errors
    /// [`DataError::Content`] if the video cannot be decoded, or the sink's own error, which ends the decoding.
    pub(crate) fn each_frame<E: From<DataError> + Display>(
        &self,
        sink: &mut dyn FnMut(usize, image::RgbImage) -> Result<(), E>,
    ) -> Result<(), E> {
        let (mut index, mut refusal) = (0, None);
        let decoded = self.decode(&mut |frame| {
            if index < self.len {
                sink(index, frame).map_err(|error| {
                    let flaw = Flaw::new(&self.path, &error, CHECK_FILE);
                    refusal = Some(error);
                    flaw
                })?;
                index += 1;
            }
            Ok(())
        });
        match (refusal, decoded) {
            (Some(error), _) => Err(error),
            (None, Err(flaw)) => Err(DataError::from(flaw.of_whole_video()).into()),
            (None, Ok(())) if index < self.len => {
                let reason = format!("only {index} of {} frames can be decoded", self.len);
                Err(DataError::from(Flaw::new(&self.path, reason, CHECK_FILE)).into())
            }
            (None, Ok(())) => Ok(()),
        }
    }

    /// A frame, resized to `size` with a Lanczos filter if necessary. The first call for a size decodes the whole
    /// video. Calls from other threads wait for it.
    ///
    /// # Errors
    /// [`DataError::Content`] if the video cannot be decoded or its frames cannot be stored, [`DataError::Image`] if a
    /// stored frame cannot be read.
    pub(crate) fn frame(&self, index: usize, size: (u32, u32)) -> Result<DynamicImage, DataError> {
        if index >= self.len || size.0 == 0 || size.1 == 0 {
            let reason = format!("frame {index} of {} was asked for, in {} x {} pixels", self.len, size.0, size.1);
            return Err(Flaw::new(&self.path, reason, CHECK_FILE).into());
        }
        let path = store::frame_file(&self.folder(size)?, index);
        let unreadable = |e: &dyn ToString| DataError::Image { path: path.clone(), reason: e.to_string() };
        ImageReader::open(&path).map_err(|e| unreadable(&e))?.decode().map_err(|e| unreadable(&e))
    }

    /// The folder with the frames in this size.
    fn folder(&self, size: (u32, u32)) -> Result<PathBuf, Flaw> {
        let set = {
            let mut sets = self.sets.lock().unwrap_or_else(PoisonError::into_inner);
            Arc::clone(sets.entry(size).or_insert_with(|| Arc::new(Mutex::new(FrameSet::Wanted))))
        };
        // After a panic, the set is still needed.
        let mut set = set.lock().unwrap_or_else(PoisonError::into_inner);
        match &*set {
            FrameSet::Ready(folder) => return Ok(folder.clone()),
            FrameSet::Failed(flaw) => return Err(flaw.clone()),
            FrameSet::Wanted => {}
        }
        let made = self.make(size);
        *set = match &made {
            Ok(folder) => FrameSet::Ready(folder.clone()),
            Err(flaw) => FrameSet::Failed(flaw.clone()),
        };
        made
    }

    /// Decodes the video into the store, unless its frames exist from an earlier run.
    fn make(&self, size: (u32, u32)) -> Result<PathBuf, Flaw> {
        let name = store::set_name(&self.path, &self.metadata, size, self.len);
        let folder = self.store.folder()?.join(name);
        if store::is_complete(&folder, self.len) {
            return Ok(folder);
        }
        let _permit = Permit::take();
        let start = Instant::now();
        let mut writer = store::SetWriter::new(&folder, size, self.len)?;
        let by = match self.decoder.is_ffmpeg() {
            true => "ffmpeg",
            false => "the built-in decoder",
        };
        tracing::info!("decoding {} frames of {} with {by} into {}", self.len, self.path.display(), folder.display());
        self.decode(&mut |frame| writer.push(frame))?;
        let frames = writer.finish()?;
        if frames < self.len {
            let reason = format!("only {frames} of {} frames can be decoded", self.len);
            return Err(Flaw::new(&self.path, reason, READ_FEWER));
        }
        tracing::debug!("decoded {} in {:.1} s", self.path.display(), start.elapsed().as_secs_f64());
        Ok(folder)
    }

    /// Passes the first frames to `sink` in display order, upright and in the video's size, `len` at most.
    fn decode(&self, sink: &mut dyn FnMut(image::RgbImage) -> Result<(), Flaw>) -> Result<(), Flaw> {
        let mut sink = |frame: image::RgbImage| match frame.dimensions() == self.size {
            true => sink(frame),
            false => {
                let ((w, h), (width, height)) = (frame.dimensions(), self.size);
                let reason = format!("a frame has {w} x {h} pixels, but the header says {width} x {height}");
                Err(Flaw::new(&self.path, reason, CHECK_FILE))
            }
        };
        match &self.track {
            Some(track) if !self.decoder.is_ffmpeg() => decode_built_in(&self.path, track, self.len, &mut sink),
            _ => ffmpeg::decode(&self.path, self.len, &mut sink),
        }
    }
}

/// Whether the built-in decoder supports the video, judged by its headers.
fn can_decode(path: &Path, track: &mp4::Track) -> Result<(), Flaw> {
    let refused = |reason: String| Flaw::new(path, reason, EXTRACT);
    match &track.codec {
        mp4::Codec::Other(name) => Err(refused(format!("the video is {name}, for which there is no built-in decoder"))),
        #[cfg(feature = "h264")]
        mp4::Codec::H264(setup) => h264::colours(setup).map(|_| ()).map_err(refused),
        #[cfg(not(feature = "h264"))]
        mp4::Codec::H264(_) => {
            let reason = "the program ffmpeg is not installed, and this program was built without its decoder of H.264";
            Err(Flaw::new(path, reason, flaw::BUILD))
        }
    }
}

#[cfg(feature = "h264")]
use h264::decode as decode_built_in;

#[cfg(not(feature = "h264"))]
fn decode_built_in(
    path: &Path,
    track: &mp4::Track,
    _: usize,
    _: &mut dyn FnMut(image::RgbImage) -> Result<(), Flaw>,
) -> Result<(), Flaw> {
    can_decode(path, track)
}
