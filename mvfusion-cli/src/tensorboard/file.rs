//! The event file of a process.

use std::fs::File;
use std::io::{Cursor, Write};
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

use anyhow::Context;
use image::ImageReader;
use prost::Message;

use super::message::{Content, Event, SessionLog, Summary, SummaryImage, SummaryValue, What};
use super::record::framed;

/// How the names of event files begin. TensorBoard looks for `tfevents` and reads files in the order of their names.
const PREFIX: &str = "events.out.tfevents.";

/// The version of the format in which the start of a session makes TensorBoard forget later steps.
const VERSION: &str = "brain.Event:2";

/// A value of a step.
#[derive(Clone, Debug)]
pub struct Value(SummaryValue);

impl Value {
    /// A number. TensorBoard keeps it in single precision.
    pub fn scalar(tag: impl Into<String>, number: f64) -> Self {
        Self(SummaryValue { tag: tag.into(), content: Some(Content::SimpleValue(number as f32)) })
    }

    /// An image, given as a PNG file.
    ///
    /// # Errors
    /// If the bytes are not those of a PNG file.
    pub fn png(tag: impl Into<String>, bytes: Vec<u8>) -> anyhow::Result<Self> {
        let (width, height) =
            ImageReader::with_format(Cursor::new(&bytes), image::ImageFormat::Png).into_dimensions()?;
        let image = SummaryImage {
            height: height.try_into()?,
            width: width.try_into()?,
            // What the run writes has red, green and blue.
            colorspace: 3,
            encoded_image_string: bytes,
        };
        Ok(Self(SummaryValue { tag: tag.into(), content: Some(Content::Image(image)) }))
    }

    /// Its name.
    #[cfg(test)]
    pub fn tag(&self) -> &str {
        &self.0.tag
    }
}

/// A file to which events are appended.
#[derive(Debug)]
pub struct EventFile {
    file: File,
    path: PathBuf,
}

impl EventFile {
    /// A new file in a folder, which is created. `step` is the first step that it will tell of; TensorBoard forgets
    /// what older files tell of this step and later ones.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn create(folder: &Path, step: usize) -> anyhow::Result<Self> {
        std::fs::create_dir_all(folder).with_context(|| format!("cannot create the folder {}", folder.display()))?;
        let path = folder.join(new_name(folder));
        let file = File::create_new(&path).with_context(|| format!("cannot write {}", path.display()))?;
        let events = Self { file, path };
        events.append(0, What::FileVersion(VERSION.to_owned()))?;
        events.append(step, What::SessionLog(SessionLog { status: SessionLog::START }))?;
        Ok(events)
    }

    /// Appends the values of a step.
    ///
    /// # Errors
    /// If they cannot be written.
    pub fn add(&self, step: usize, values: Vec<Value>) -> anyhow::Result<()> {
        let value = values.into_iter().map(|Value(value)| value).collect();
        self.append(step, What::Summary(Summary { value }))
    }

    /// Appends a whole event at once. If the process is killed meanwhile, readers find half of one at the end, which
    /// they expect of files that grow.
    fn append(&self, step: usize, what: What) -> anyhow::Result<()> {
        let event = Event { wall_time: seconds_since_1970(), step: step as i64, what: Some(what) };
        let written = (&self.file).write_all(&framed(&event.encode_to_vec()));
        written.with_context(|| format!("cannot write {}", self.path.display()))
    }
}

fn seconds_since_1970() -> f64 {
    // A clock before 1970 is a clock that was never set.
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |since| since.as_secs_f64())
}

/// A name after all others of the folder, whatever the clock says.
fn new_name(folder: &Path) -> String {
    let started = |name: &str| name.strip_prefix(PREFIX)?.split('.').next()?.parse::<u64>().ok();
    let names = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.file_name());
    let latest = names.filter_map(|name| started(name.to_str()?)).max();
    let now = seconds_since_1970() as u64;
    let seconds = latest.map_or(now, |latest| now.max(latest + 1));
    let host = gethostname::gethostname();
    format!("{PREFIX}{seconds:010}.{}.{}", host.to_string_lossy().replace(['/', '\\'], "-"), std::process::id())
}

#[cfg(test)]
mod tests {
    use image::RgbImage;

    use super::super::record::whole;
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let entries = std::fs::read_dir(folder).expect("listed");
        let mut names: Vec<_> =
            entries.map(|entry| entry.expect("listed").file_name().into_string().expect("UTF-8")).collect();
        names.sort();
        names
    }

    fn events(path: &Path) -> Vec<Event> {
        let bytes = std::fs::read(path).expect("read");
        whole(&bytes).iter().map(|data| Event::decode(&data[..]).expect("an event")).collect()
    }

    #[test]
    fn a_file_tells_its_version_its_first_step_and_its_values() {
        let folder = tempfile::tempdir().expect("folder");
        let folder = folder.path().join("tensorboard");
        let file = EventFile::create(&folder, 41).expect("created");
        let mut png = Cursor::new(Vec::new());
        RgbImage::new(3, 2).write_to(&mut png, image::ImageFormat::Png).expect("encoded");
        let image = Value::png("strips/0", png.into_inner()).expect("an image");
        file.add(42, vec![Value::scalar("train/loss", 0.25), image]).expect("written");
        let found = events(&folder.join(&names(&folder)[0]));
        assert_eq!(found.len(), 3);
        assert!(found.iter().all(|event| event.wall_time > 1.7e9), "{found:?}");
        assert_eq!(found[0].what, Some(What::FileVersion("brain.Event:2".to_owned())));
        assert_eq!((found[1].step, &found[1].what), (41, &Some(What::SessionLog(SessionLog { status: 1 }))));
        let Some(What::Summary(Summary { value })) = &found[2].what else { panic!("{found:?}") };
        assert_eq!((found[2].step, value[0].tag.as_str()), (42, "train/loss"));
        assert_eq!(value[0].content, Some(Content::SimpleValue(0.25)));
        let Some(Content::Image(SummaryImage { height: 2, width: 3, colorspace: 3, .. })) = &value[1].content else {
            panic!("{value:?}")
        };
        assert!(Value::png("strips/0", b"no image".to_vec()).is_err());
    }

    #[test]
    fn a_later_file_is_read_later_even_if_the_clock_was_put_back() {
        let folder = tempfile::tempdir().expect("folder");
        std::fs::write(folder.path().join(format!("{PREFIX}9000000000.host.1")), "").expect("written");
        for step in [1, 2] {
            EventFile::create(folder.path(), step).expect("created");
        }
        let names = names(folder.path());
        let begins = |index: usize, seconds: &str| names[index].starts_with(&format!("{PREFIX}{seconds}."));
        assert!(begins(1, "9000000001") && begins(2, "9000000002"), "{names:?}");
    }
}
