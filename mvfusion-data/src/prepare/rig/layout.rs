//! The files of a rig's cameras: their videos as they are where all frames are taken, otherwise the frames taken.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use image::RgbImage;
use rayon::prelude::*;

use super::camera::Camera;
use crate::error::DataError;
use crate::prepare::error::PrepareError;
use crate::prepare::event::{Event, Listener, Tell};
use crate::video::{FrameStore, Video};

/// The number of each camera: that of its name `camNN` if all have different ones, otherwise its place, from 1.
pub(super) fn numbers(names: &[&str]) -> Vec<u32> {
    let number = |name: &&str| -> Option<u32> {
        let digits = name.strip_prefix("cam")?;
        // The parser would accept a sign.
        digits.parse().ok().filter(|_| digits.bytes().all(|byte| byte.is_ascii_digit()))
    };
    let own: Option<Vec<u32>> = names.iter().map(number).collect();
    let differ = |numbers: &Vec<u32>| numbers.iter().collect::<BTreeSet<_>>().len() == numbers.len();
    own.filter(differ).unwrap_or_else(|| (1..).take(names.len()).collect())
}

/// The image of a camera in COLMAP's model.
pub(super) fn image_name(number: u32) -> String {
    format!("image{number}.jpg")
}

/// The name of a camera in the scene.
pub(super) fn folder_name(camera: &Camera) -> String {
    format!("cam{:02}", camera.number)
}

/// Writes the frames of the cameras.
///
/// # Errors
/// If a video cannot be decoded, or a file cannot be written.
pub(super) fn write(cameras: &[&Camera], scene: &Path, listen: &mut Listener<'_>) -> Result<(), PrepareError> {
    let as_it_is = cameras.iter().all(|camera| is_whole(camera));
    listen.tell(Event::Begins { what: "videos", total: cameras.len() })?;
    for camera in cameras {
        let name = folder_name(camera);
        match as_it_is {
            true => {
                let path = scene.join(format!("{name}.mp4"));
                fs::copy(camera.video.path(), &path).map_err(|error| PrepareError::unwritable(&path, error))?;
            }
            false => write_frames(camera, &scene.join(name), listen)?,
        }
        listen.tell(Event::Advances)?;
    }
    listen.tell(Event::Ends)?;
    let renamed: Vec<String> = cameras
        .iter()
        .filter(|camera| camera.clip.name != folder_name(camera))
        .map(|camera| format!("{} is {}", folder_name(camera), camera.clip.name))
        .collect();
    if !renamed.is_empty() {
        listen.note(format!("cameras are named by numbers: {}", renamed.join(", ")))?;
    }
    Ok(())
}

/// Whether all frames of an mp4 file are taken.
fn is_whole(camera: &Camera) -> bool {
    let is_mp4 = camera.video.path().extension().is_some_and(|extension| extension == "mp4" || extension == "MP4");
    is_mp4 && camera.frames.len() == camera.clip.frames && camera.frames.iter().copied().eq(0..camera.clip.frames)
}

/// Writes the frames that are taken, without loss.
fn write_frames(camera: &Camera, folder: &Path, listen: &mut Listener<'_>) -> Result<(), PrepareError> {
    fs::create_dir(folder).map_err(|error| PrepareError::unwritable(folder, error))?;
    let unwritable = |error: &dyn ToString| DataError::Folder {
        folder: folder.to_owned(),
        reason: error.to_string(),
        advice: "Check free space and write permission",
    };
    let last = camera.frames.last().copied().unwrap_or(0);
    let video = Video::open(camera.video.path(), last + 1, &FrameStore::new(None))?;
    let (mut waiting, mut next) = (Vec::new(), 0);
    let at_once = rayon::current_num_threads();
    let save = |waiting: &mut Vec<(usize, RgbImage)>| -> Result<(), DataError> {
        let saved = waiting.par_iter().map(|(moment, frame)| {
            frame.save(folder.join(format!("frame_{:05}.png", moment + 1))).map_err(|error| unwritable(&error))
        });
        saved.collect::<Vec<_>>().into_iter().collect::<Result<(), _>>()?;
        waiting.clear();
        Ok(())
    };
    video.each_frame(&mut |index, frame| -> Result<(), PrepareError> {
        listen.tell(Event::Continues)?;
        // A frame stands for several moments where the scene has more of them than the video.
        while camera.frames.get(next) == Some(&index) {
            waiting.push((next, frame.clone()));
            next += 1;
        }
        if waiting.len() >= at_once {
            save(&mut waiting)?;
        }
        Ok(())
    })?;
    Ok(save(&mut waiting)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_in_names_are_kept_if_all_names_have_different_ones() {
        assert_eq!(numbers(&["cam00", "cam03", "cam12"]), [0, 3, 12]);
        assert_eq!(numbers(&["cam1", "cam01"]), [1, 2]);
        assert_eq!(numbers(&["left", "cam+7", "right"]), [1, 2, 3]);
    }
}
