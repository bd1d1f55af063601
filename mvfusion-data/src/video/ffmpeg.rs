//! Decoding with the program ffmpeg, which supports every codec.

use std::ffi::OsString;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::OnceLock;

use ffmpeg_sidecar::child::FfmpegChild;
use ffmpeg_sidecar::command::FfmpegCommand;
use ffmpeg_sidecar::event::{FfmpegEvent, LogLevel};
use ffmpeg_sidecar::ffprobe::ffprobe_path;
use ffmpeg_sidecar::paths::ffmpeg_path;
use image::RgbImage;
use serde_json::Value;

use super::flaw::{CHECK_FILE, EXTRACT, Flaw, READ_FEWER};

/// Numbers the frames instead of timing them. Otherwise ffmpeg would drop and duplicate frames for a constant rate, and
/// the option against that has different names in different versions. Interpolates the chroma instead of repeating it,
/// which is 1 dB closer to the original images.
const FILTERS: &str = "settb=1/25,setpts=N,scale=flags=bicubic+accurate_rnd+full_chroma_int";
/// The codec in which a packet may hold a frame that is never shown. In others, as VP9, it comes with one that is.
const INVISIBLE: &str = "vp8";
/// Maximum number of lines of ffmpeg's messages to pass on.
const MOST_COMPLAINTS: usize = 3;

/// Whether the program can be run.
pub(super) fn is_installed() -> bool {
    static INSTALLED: OnceLock<bool> = OnceLock::new();
    *INSTALLED.get_or_init(|| {
        let mut command = Command::new(ffmpeg_path());
        keep_signals_from(&mut command);
        command.arg("-version").stdin(Stdio::null()).output().is_ok_and(|output| output.status.success())
    })
}

/// Passes the first `wanted` frames to `sink`, upright.
pub(super) fn decode(
    path: &Path,
    wanted: usize,
    sink: &mut dyn FnMut(RgbImage) -> Result<(), Flaw>,
) -> Result<(), Flaw> {
    let mut command = FfmpegCommand::new();
    command
        .args(["-nostdin", "-protocol_whitelist", "file", "-i"])
        .arg(local(path))
        .args(["-map", "0:V:0", "-vf", FILTERS, "-r", "25", "-frames:v", &wanted.to_string()])
        .rawvideo();
    keep_signals_from(command.as_inner_mut());
    let mut child = command.spawn().map_err(|e| Flaw::new(path, format!("ffmpeg cannot be started ({e})"), EXTRACT))?;
    let passed = pass_on(&mut child, path, wanted, sink);
    // If a frame was rejected, the program is still running.
    let _ = child.kill();
    let _ = child.wait();
    passed
}

/// Passes the frames to the sink as they arrive.
fn pass_on(
    child: &mut FfmpegChild,
    path: &Path,
    wanted: usize,
    sink: &mut dyn FnMut(RgbImage) -> Result<(), Flaw>,
) -> Result<(), Flaw> {
    let flaw = |reason: String| Flaw::new(path, reason, CHECK_FILE);
    let (mut frames, mut complaints) = (0, Vec::new());
    for event in child.iter().map_err(|e| flaw(format!("ffmpeg does not answer ({e})")))? {
        match event {
            FfmpegEvent::OutputFrame(frame) => {
                let image = RgbImage::from_raw(frame.width, frame.height, frame.data);
                sink(image.ok_or_else(|| flaw("ffmpeg gave part of a frame".into()))?)?;
                frames += 1;
            }
            FfmpegEvent::Log(LogLevel::Error | LogLevel::Fatal, line) | FfmpegEvent::Error(line)
                if complaints.len() < MOST_COMPLAINTS =>
            {
                complaints.push(line.trim().to_owned());
            }
            _ => {}
        }
    }
    let complaints = complaints.join("; ");
    if frames < wanted {
        let told = if complaints.is_empty() { String::new() } else { format!(" ({complaints})") };
        return Err(Flaw::new(path, format!("ffmpeg decodes only {frames} of {wanted} frames{told}"), READ_FEWER));
    }
    if !complaints.is_empty() {
        tracing::warn!("{}: ffmpeg complains: {complaints}", path.display());
    }
    Ok(())
}

/// What ffprobe tells of a video.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Probed {
    /// Size of the upright frames.
    pub(super) size: (u32, u32),
    pub(super) frames: usize,
    /// Mean number of frames per second.
    pub(super) fps: Option<f64>,
}

/// Size, number and rate of the frames, from ffprobe. It reads the file, and decodes it only if it must.
pub(super) fn probe(path: &Path) -> Result<Probed, String> {
    const ENTRIES: &str =
        "stream=codec_name,width,height,avg_frame_rate,nb_read_packets:stream_side_data=rotation:stream_tags=rotate";
    let answer = ask(path, ENTRIES, &["-count_packets"])?;
    let told = &answer["streams"][0];
    let mut probed = stream(told).ok_or("it finds no video in it")?;
    if told["codec_name"] == INVISIBLE {
        let counted = ask(path, "stream=nb_read_frames", &["-count_frames"])?;
        let frames = counted["streams"][0]["nb_read_frames"].as_str().and_then(|frames| frames.parse().ok());
        // The packets are an upper bound.
        probed.frames = frames.unwrap_or(probed.frames).min(probed.frames);
    }
    Ok(probed)
}

/// When the first frame is shown, in seconds of the container's clock, from ffprobe. A container without a clock begins
/// at 0.
pub(super) fn start(path: &Path) -> Result<f64, String> {
    let answer = ask(path, "stream=start_time:format=start_time", &[])?;
    let seconds = |part: &Value| part["start_time"].as_str()?.parse::<f64>().ok().filter(|seconds| seconds.is_finite());
    Ok(seconds(&answer["streams"][0]).or_else(|| seconds(&answer["format"])).unwrap_or(0.0))
}

/// What ffprobe answers about the first video in a file.
fn ask(path: &Path, entries: &str, options: &[&str]) -> Result<Value, String> {
    let mut command = Command::new(ffprobe_path());
    keep_signals_from(&mut command);
    let output = command
        .args(["-v", "error", "-protocol_whitelist", "file", "-select_streams", "V:0"])
        .args(options)
        .args(["-show_entries", entries, "-of", "json"])
        .arg(local(path))
        .stdin(Stdio::null())
        .output()
        .map_err(|e| e.to_string())?;
    if !output.status.success() {
        return Err(String::from_utf8_lossy(&output.stderr).trim().to_owned());
    }
    serde_json::from_slice(&output.stdout).map_err(|e| e.to_string())
}

/// A stream in ffprobe's answer.
fn stream(stream: &Value) -> Option<Probed> {
    let side = |name: &str| stream[name].as_u64().and_then(|side| u32::try_from(side).ok());
    let (width, height) = (side("width")?, side("height")?);
    let frames = stream["nb_read_packets"].as_str()?.parse().ok()?;
    let turned = stream["side_data_list"].as_array().and_then(|list| list.iter().find_map(|d| d["rotation"].as_f64()));
    let turned = turned.or_else(|| stream["tags"]["rotate"].as_str()?.parse().ok()).unwrap_or(0.0);
    let size = if turned.rem_euclid(180.0) == 90.0 { (height, width) } else { (width, height) };
    Some(Probed { size, frames, fps: stream["avg_frame_rate"].as_str().and_then(rate) })
}

/// A rate such as `30000/1001`.
fn rate(text: &str) -> Option<f64> {
    let (frames, seconds) = text.split_once('/')?;
    let rate = frames.parse::<f64>().ok()? / seconds.parse::<f64>().ok()?;
    (rate.is_finite() && rate > 0.0).then_some(rate)
}

/// Keeps a Ctrl-C at the terminal from a program. It is meant for this one, which would otherwise take the missing
/// frames for a damaged video.
fn keep_signals_from(command: &mut Command) {
    #[cfg(unix)]
    std::os::unix::process::CommandExt::process_group(command, 0);
    #[cfg(not(unix))]
    let _ = command;
}

/// A file name that ffmpeg mistakes for neither an option nor an address.
pub(super) fn local(path: &Path) -> OsString {
    let mut name = OsString::from("file:");
    name.push(path);
    name
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn a_program_has_a_process_group_of_its_own() {
        let mut command = Command::new("sh");
        keep_signals_from(&mut command);
        let output = command.args(["-c", "echo $$; cut -d ' ' -f 5 /proc/$$/stat"]).output().expect("a shell");
        let said = String::from_utf8(output.stdout).expect("text");
        let (process, group) = said.trim().split_once('\n').expect("two lines");
        assert_eq!(process, group);
    }
}
