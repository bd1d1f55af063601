//! The sound of a video, decoded by the program ffmpeg.

use std::path::Path;
use std::process::{Command, Stdio};

use bytemuck::pod_collect_to_vec;
use ffmpeg_sidecar::paths::ffmpeg_path;

use super::ffmpeg::local;
use super::flaw::Flaw;
use crate::error::DataError;

const ADVICE: &str = "Check that the program ffmpeg is installed and that the video has sound, or give the offset.";

/// Bytes of ffmpeg's messages to pass on.
const MOST_COMPLAINT: usize = 300;

/// The first `seconds` of the sound, as one channel with `rate` samples per second, from the time of the first frame
/// on. What starts later begins with silence.
///
/// # Errors
/// [`DataError::Content`] if ffmpeg is missing or fails, or if there is no sound.
pub(crate) fn sound(path: &Path, rate: u32, seconds: f64) -> Result<Vec<f32>, DataError> {
    let flaw = |reason: String| DataError::from(Flaw::new(path, reason, ADVICE));
    let output = Command::new(ffmpeg_path())
        .args(["-nostdin", "-v", "error", "-protocol_whitelist", "file,pipe", "-i"])
        .arg(local(path))
        // Sound often starts some hundredths of a second before or after the first frame.
        .args(["-map", "0:a:0", "-af", "aresample=async=1:first_pts=0", "-t", &seconds.to_string()])
        .args(["-ac", "1", "-ar", &rate.to_string(), "-f", "f32le", "pipe:1"])
        .stdin(Stdio::null())
        .output()
        .map_err(|error| flaw(format!("ffmpeg cannot be started ({error})")))?;
    if !output.status.success() {
        let said = String::from_utf8_lossy(&output.stderr);
        let said: String = said.trim().chars().take(MOST_COMPLAINT).collect();
        return Err(flaw(match said.contains("matches no streams") {
            true => "it has no sound".into(),
            false => format!("ffmpeg cannot decode its sound ({said})"),
        }));
    }
    let whole = output.stdout.len() / size_of::<f32>() * size_of::<f32>();
    let samples: Vec<f32> = pod_collect_to_vec(&output.stdout[..whole]);
    if samples.iter().all(|sample| *sample == 0.0) {
        return Err(flaw("its sound is silent".into()));
    }
    Ok(samples)
}
