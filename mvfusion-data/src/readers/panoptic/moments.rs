//! The moments of a file of cameras, told by the numbers of its frames.

use std::collections::BTreeMap;
use std::path::Path;

use crate::error::DataError;
use crate::readers::shared::frame_numbers::{FrameNumber, NumberedFrames, check_numbers};

/// The moments of a file.
#[derive(Debug)]
pub(super) struct Moments {
    /// Name of the file.
    file: &'static str,
    /// Number of times.
    pub(super) times: usize,
    /// The number of the frames of each time; `None` if the names do not tell it.
    numbers: Option<Vec<FrameNumber>>,
}

/// An image in the lists of a file.
#[derive(Clone, Copy, Debug)]
pub(super) struct ListedImage<'a> {
    /// Index of its time.
    pub(super) time: usize,
    pub(super) camera: i64,
    /// Its name: `7/000003.jpg`.
    pub(super) name: &'a str,
}

impl Moments {
    /// The moments of a file of `times` times, of which the first `limit` are used. `images` are sorted by time.
    ///
    /// # Errors
    /// [`DataError::Disagreement`] if two images of one used time have different numbers. After a missing frame, all
    /// later frames of its camera would have the wrong time.
    pub(super) fn of<'a>(
        folder: &Path,
        file: &'static str,
        times: usize,
        limit: usize,
        images: impl Iterator<Item = ListedImage<'a>>,
    ) -> Result<Self, DataError> {
        let unknown = Ok(Self { file, times, numbers: None });
        let mut cameras: BTreeMap<i64, Vec<FrameNumber>> = BTreeMap::new();
        let mut moments: Vec<Vec<(FrameNumber, i64)>> = vec![Vec::new(); times];
        for ListedImage { time, camera, name } in images {
            let stem = Path::new(name).file_stem().unwrap_or_default().to_string_lossy();
            let Some(number) = FrameNumber::split(&stem).1 else { return unknown };
            cameras.entry(camera).or_default().push(number.clone());
            moments[time].push((number, camera));
        }
        // In names like `000003/cam07.jpg`, the numbers are not those of frames.
        let ascend = |numbers: &Vec<FrameNumber>| numbers.windows(2).all(|pair| pair[0] < pair[1]);
        if !cameras.values().all(ascend) || cameras.values().all(|numbers| numbers.len() < 2) {
            return unknown;
        }
        for (time, images) in moments.iter().enumerate().take(limit) {
            // A camera that shows a later frame than another one lacks the frame of that one.
            let (least, most) = (images.iter().min(), images.iter().max());
            let Some(((lacking, has), (found, lacks))) = least.zip(most).filter(|(a, b)| a.0 != b.0) else { continue };
            return Err(DataError::Disagreement {
                folder: folder.to_owned(),
                first: format!("camera {lacks} has no frame {lacking} at time {time} of {file} (its {found} is there)"),
                second: format!("camera {has} has it"),
                advice: format!("Add it, or remove frame {lacking} of every camera from both files"),
            });
        }
        let numbers = moments.into_iter().map(|images| Some(images.into_iter().next()?.0));
        Ok(Self { file, times, numbers: numbers.collect() })
    }
}

/// The number of times that are used, at most `limit`. They must be the same moments in both files.
///
/// # Errors
/// [`DataError::Disagreement`] if they are not.
pub(super) fn common_times(folder: &Path, files: [&Moments; 2], limit: usize) -> Result<usize, DataError> {
    if let [Moments { numbers: Some(one), .. }, Moments { numbers: Some(other), .. }] = files {
        let lists = [(files[0], one), (files[1], other)];
        let lists = lists.map(|(moments, numbers)| NumberedFrames { name: moments.file, numbers });
        check_numbers(folder, lists, limit, "both files")?;
    }
    let [count, other] = files.map(|moments| moments.times.min(limit));
    if count == other {
        return Ok(count);
    }
    let mut advice = "Copy both again".to_owned();
    let least = count.min(other);
    if least > 0 {
        advice += &format!("; or, if only the last times are missing, read fewer with `--set scene.frames={least}`");
    }
    Err(DataError::Disagreement {
        folder: folder.to_owned(),
        first: format!("{} has {count} times", files[0].file),
        second: format!("{} has {other}", files[1].file),
        advice,
    })
}
