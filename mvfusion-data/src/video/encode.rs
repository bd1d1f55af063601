//! Encoding of videos with the program ffmpeg.

use std::io::{self, BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::thread::JoinHandle;

use ffmpeg_sidecar::paths::ffmpeg_path;
use image::RgbImage;

use super::ffmpeg::{is_installed, local};
use crate::error::DataError;

/// Converts to BT.709 colours, which players assume for large images, and tags the file with them. Crops the last
/// column or row of odd sizes, because the chroma is subsampled.
const FILTERS: &str = "crop=trunc(iw/2)*2:trunc(ih/2)*2,scale=out_color_matrix=bt709:out_range=tv,format=yuv420p";
/// Constant quality of x264 without visible artefacts.
const QUALITY: &str = "18";
/// Maximum number of lines of ffmpeg's messages to pass on.
const MOST_COMPLAINTS: usize = 3;

const ADVICE: &str = "Check that the program ffmpeg was built with libx264, or write the frames as images.";

/// Whether videos can be written, that is, whether the program ffmpeg can be run.
pub fn can_write_videos() -> bool {
    is_installed()
}

/// A video that is written frame by frame: H.264 with 4:2:0 chroma in an mp4 file, which every player supports.
#[derive(Debug)]
pub struct VideoWriter {
    path: PathBuf,
    size: (u32, u32),
    child: Child,
    frames: Option<ChildStdin>,
    /// Reads ffmpeg's messages, so that it never blocks on them.
    complaints: Option<JoinHandle<Vec<String>>>,
}

impl VideoWriter {
    /// Starts a video with frames of `size` at `fps` frames per second, and replaces any file at `path`. The last
    /// column or row of an odd size is dropped.
    ///
    /// # Errors
    /// If ffmpeg cannot be started, or a side has less than two pixels.
    pub fn create(path: &Path, size: (u32, u32), fps: f64) -> Result<Self, DataError> {
        let (width, height) = size;
        if width.min(height) < 2 {
            return Err(flaw(path, format!("a video of {width} x {height} pixels cannot be coded")));
        }
        let mut child = Command::new(ffmpeg_path())
            .args(["-v", "error", "-y", "-f", "rawvideo", "-pix_fmt", "rgb24"])
            .args(["-s", &format!("{width}x{height}"), "-r", &fps.to_string(), "-i", "pipe:0"])
            .args(["-vf", FILTERS, "-c:v", "libx264", "-crf", QUALITY, "-movflags", "+faststart"])
            .args(["-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc", "bt709", "-f", "mp4"])
            .arg(local(path))
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(|error| flaw(path, format!("ffmpeg cannot be started ({error})")))?;
        let frames = child.stdin.take();
        let complaints = child.stderr.take().map(|stderr| std::thread::spawn(move || first_lines(stderr)));
        Ok(Self { path: path.to_owned(), size, child, frames, complaints })
    }

    /// Adds a frame.
    ///
    /// # Errors
    /// If it has another size, or ffmpeg has stopped.
    pub fn add(&mut self, frame: &RgbImage) -> Result<(), DataError> {
        if frame.dimensions() != self.size {
            let ((width, height), (w, h)) = (self.size, frame.dimensions());
            return Err(flaw(&self.path, format!("a frame has {w} x {h} pixels and not {width} x {height}")));
        }
        let sent = match &mut self.frames {
            Some(frames) => frames.write_all(frame.as_raw()),
            None => Err(io::ErrorKind::BrokenPipe.into()),
        };
        match sent {
            Ok(()) => Ok(()),
            Err(error) => {
                let reason = self.end().err().unwrap_or_else(|| error.to_string());
                Err(flaw(&self.path, reason))
            }
        }
    }

    /// Ends the video and waits until it is complete.
    ///
    /// # Errors
    /// If ffmpeg failed.
    pub fn finish(mut self) -> Result<(), DataError> {
        self.end().map_err(|reason| flaw(&self.path, reason))
    }

    /// Ends the program. The error contains its messages if it failed.
    fn end(&mut self) -> Result<(), String> {
        self.frames = None;
        let status = self.child.wait().map_err(|error| error.to_string())?;
        let complaints = self.complaints.take().and_then(|lines| lines.join().ok()).unwrap_or_default();
        if status.success() {
            return Ok(());
        }
        Err(format!(
            "ffmpeg failed ({})",
            if complaints.is_empty() { status.to_string() } else { complaints.join("; ") }
        ))
    }
}

impl Drop for VideoWriter {
    /// Kills ffmpeg if the video was not finished, so that it does not wait for frames.
    fn drop(&mut self) {
        if self.complaints.is_some() {
            let _ = self.child.kill();
            let _ = self.child.wait();
        }
    }
}

/// The first lines of a stream, which is read to its end.
fn first_lines(stream: impl io::Read) -> Vec<String> {
    let mut lines = Vec::new();
    for line in BufReader::new(stream).split(b'\n').map_while(Result::ok) {
        if lines.len() < MOST_COMPLAINTS {
            lines.push(String::from_utf8_lossy(&line).trim().to_owned());
        }
    }
    lines
}

fn flaw(path: &Path, reason: String) -> DataError {
    DataError::Content { path: path.to_owned(), reason, advice: ADVICE }
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::*;
    use crate::video::{FrameStore, Video, VideoDecoder};

    /// Maximum mean error in levels due to coding, chroma subsampling and YCbCr conversion; frames are 20 levels apart.
    const LIKE: f64 = 4.0;

    fn frame(index: u8) -> RgbImage {
        RgbImage::from_fn(61, 45, |x, y| Rgb([20 * index, 4 * x as u8, 5 * y as u8]))
    }

    #[test]
    fn a_video_is_read_back_frame_by_frame_in_an_even_size() {
        if !can_write_videos() {
            eprintln!("NOT TESTED: writing videos, because the program ffmpeg is not installed");
            return;
        }
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("a video.part");
        let mut writer = VideoWriter::create(&path, (61, 45), 29.97).expect("started");
        (0..7).try_for_each(|index| writer.add(&frame(index))).expect("added");
        assert!(writer.add(&RgbImage::new(8, 8)).is_err_and(|error| error.to_string().contains("8 x 8")));
        writer.finish().expect("finished");

        let video = Video::with_decoder(&path, usize::MAX, &FrameStore::new(None), VideoDecoder::Auto).expect("opened");
        assert_eq!((video.len(), video.size()), (7, (60, 44)));
        for index in 0..7 {
            let found = video.frame(index, video.size()).expect("decoded").into_rgb8();
            let original = frame(index as u8);
            let off: u32 = found
                .enumerate_pixels()
                .flat_map(|(x, y, pixel)| pixel.0.into_iter().zip(original.get_pixel(x, y).0))
                .map(|(a, b)| u32::from(a.abs_diff(b)))
                .sum();
            let mean = f64::from(off) / f64::from(3 * 60 * 44);
            assert!(mean < LIKE, "frame {index} is {mean:.1} levels off");
        }
    }

    #[test]
    fn what_ffmpeg_complains_of_is_passed_on() {
        if !can_write_videos() {
            eprintln!("NOT TESTED: complaints of the program ffmpeg, because it is not installed");
            return;
        }
        let folder = tempfile::tempdir().expect("folder");
        let mut writer = VideoWriter::create(&folder.path().join("no/such/a.mp4"), (61, 45), 30.0).expect("started");
        let failed = (0..1000).find_map(|_| writer.add(&frame(0)).err()).or_else(|| writer.finish().err());
        let said = failed.expect("there is no such folder").to_string();
        assert!(said.contains("no/such/a.mp4") && said.contains("No such file"), "{said}");
    }
}
