//! The sound of a video, decoded by the program ffmpeg.

use std::path::Path;
use std::process::{Command, Stdio};

use bytemuck::pod_collect_to_vec;
use ffmpeg_sidecar::paths::ffmpeg_path;

use super::ffmpeg::{local, start};
use super::flaw::Flaw;
use crate::error::DataError;

const ADVICE: &str =
    "Check that the programs ffmpeg and ffprobe are installed and that the video has sound, or give the offset.";

/// Bytes of ffmpeg's messages to pass on.
const MOST_COMPLAINT: usize = 300;

/// The first `seconds` of the sound, as one channel with `rate` samples per second, from the time of the first frame
/// on. What starts later begins with silence.
///
/// # Errors
/// [`DataError::Content`] if ffmpeg is missing or fails, or if there is no sound.
pub(crate) fn sound(path: &Path, rate: u32, seconds: f64) -> Result<Vec<f32>, DataError> {
    let flaw = |reason: String| DataError::from(Flaw::new(path, reason, ADVICE));
    let unknown = |error: String| flaw(format!("ffprobe does not tell when its first frame is shown ({error})"));
    let filters = filters(start(path).map_err(unknown)?, rate);
    let output = Command::new(ffmpeg_path())
        // Otherwise times begin with whichever of sound and video starts first.
        .args(["-nostdin", "-v", "error", "-copyts", "-protocol_whitelist", "file,pipe", "-i"])
        .arg(local(path))
        .args(["-map", "0:a:0", "-af", &filters, "-t", &seconds.to_string()])
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

/// Filters that cut or pad the sound so that it begins at `start` seconds. Sound often starts some hundredths of a
/// second before or after the first frame, and may start much later or earlier.
fn filters(start: f64, rate: u32) -> String {
    // ffmpeg counts `first_pts` in samples of what enters a filter. Another filter therefore changes the rate before.
    let first = (start * f64::from(rate)).round() as i64;
    format!("aresample={rate},aresample=async=1:first_pts={first},asetpts=PTS-STARTPTS")
}

#[cfg(test)]
mod tests {
    use std::f32::consts::TAU;
    use std::fs;

    use super::super::ffmpeg::is_installed;
    use super::*;

    const RATE: u32 = 16_000;

    /// A file with one channel of 16 bits that is silent for a second, followed by a tone for another.
    fn tone(path: &Path) {
        let mut bytes = b"RIFF\0\0\0\0WAVEfmt \x10\0\0\0\x01\0\x01\0".to_vec();
        for number in [48_000, 96_000, 0x10_0002] {
            bytes.extend(u32::to_le_bytes(number));
        }
        bytes.extend(b"data");
        bytes.extend(u32::to_le_bytes(2 * 96_000));
        let level = |i: u32| if i < 48_000 { 0.0 } else { 20_000.0 * (TAU * 440.0 * i as f32 / 48_000.0).sin() };
        bytes.extend((0..96_000).flat_map(|i| (level(i) as i16).to_le_bytes()));
        fs::write(path, bytes).expect("written");
    }

    fn ffmpeg(arguments: &str, folder: &Path) {
        let mut command = Command::new(ffmpeg_path());
        command.current_dir(folder).args(["-nostdin", "-v", "error", "-y"]).args(arguments.split(' '));
        let ran = command.output().expect("started");
        assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stderr));
    }

    #[test]
    fn sound_counts_from_the_first_frame_whichever_starts_first() {
        if !is_installed() {
            eprintln!("NOT TESTED: the sound of videos, because the program ffmpeg is not installed");
            return;
        }
        let folder = tempfile::tempdir().expect("folder");
        tone(&folder.path().join("tone.wav"));
        ffmpeg("-f lavfi -i color=size=32x32:rate=25:duration=1 -c:v mpeg2video frames.mp4", folder.path());
        for (name, [frames, tone], begin) in [
            ("a.mp4", [0.4, 0.0], 0.6),
            ("a.mkv", [0.4, 0.0], 0.6),
            ("a.mts", [0.4, 0.0], 0.6),
            ("b.mts", [0.0, 0.4], 1.4),
        ] {
            // The frames are copied: encoding would fill the time before them.
            let inputs = format!("-itsoffset {frames} -i frames.mp4 -itsoffset {tone} -i tone.wav");
            ffmpeg(&format!("{inputs} -map 0:v -map 1:a -c:v copy -c:a mp2 {name}"), folder.path());
            let path = folder.path().join(name);
            let heard = sound(&path, RATE, 1.5).expect("heard");
            let first = heard.iter().position(|sample| sample.abs() > 0.2).expect("a tone");
            let seconds = first as f64 / f64::from(RATE);
            // Up to the delay of the codec.
            assert!((seconds - begin).abs() < 0.05, "{name}: {seconds}");
            assert_eq!(heard.len(), 24_000, "{name}");
        }
    }
}
