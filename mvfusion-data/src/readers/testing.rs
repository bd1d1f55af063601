//! A folder to which the tests of readers write scenes.

use std::fs;
use std::path::{Path, PathBuf};

use image::{Rgb, RgbImage};
use npyz::WriterBuilder;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::Value;
use tempfile::TempDir;

use super::open;
use super::options::ReadOptions;
use crate::error::DataError;
use crate::scene::{Scene, View};

/// Two points, red and green.
pub(crate) const PLY: &str = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\n\
    property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n1 2 3 255 0 0\n\
    4 5 6 0 255 0\n";

/// A temporary folder.
pub(crate) struct SceneFolder(TempDir);

impl SceneFolder {
    pub(crate) fn new() -> Self {
        Self(tempfile::tempdir().expect("folder"))
    }

    pub(crate) fn path(&self) -> &Path {
        self.0.path()
    }

    pub(crate) fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub(crate) fn write(&self, name: &str, content: impl AsRef<[u8]>) {
        fs::create_dir_all(self.at(name).parent().expect("a folder")).expect("folder");
        fs::write(self.at(name), content).expect("written");
    }

    pub(crate) fn write_json(&self, name: &str, value: &Value) {
        self.write(name, value.to_string());
    }

    pub(crate) fn write_picture(&self, name: &str, (width, height): (u32, u32), level: u8) {
        fs::create_dir_all(self.at(name).parent().expect("a folder")).expect("folder");
        RgbImage::from_pixel(width, height, Rgb([level; 3])).save(self.at(name)).expect("written");
    }

    pub(crate) fn remove(&self, name: &str) {
        let path = self.at(name);
        if path.is_dir() { fs::remove_dir_all(path) } else { fs::remove_file(path) }.expect("removed");
    }

    pub(crate) fn open(&self) -> Result<Scene, DataError> {
        self.open_with(ReadOptions::default())
    }

    /// Also checks that the scene, if it can be read, passes [`Scene::check`].
    pub(crate) fn open_with(&self, options: ReadOptions) -> Result<Scene, DataError> {
        let scene = open(self.path(), &options)?;
        scene.check().expect("readers deliver scenes that can be used");
        Ok(scene)
    }

    /// The message of the error, which must occur and name every part.
    pub(crate) fn complaint(&self, parts: &[&str]) {
        let message = self.open().expect_err("the scene is damaged").to_string();
        assert!(message.contains(self.path().to_str().expect("utf-8")), "the place is missing: {message}");
        parts.iter().for_each(|part| assert!(message.contains(part), "`{part}` is missing: {message}"));
    }

    /// Writes a file with one wrong character, again and again. Each must give an error or a scene of finite numbers.
    pub(crate) fn survives_wrong_characters(&self, name: &str, whole: &str) {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        for _ in 0..150 {
            let mut text = whole.as_bytes().to_vec();
            let place = random.random_range(0..text.len());
            text[place] = b"0123456789.-e[]{},\"x"[random.random_range(0..20)];
            self.write(name, &text);
            let Ok(scene) = self.open() else { continue };
            for view in scene.train.iter().chain(&scene.test) {
                let camera = &view.camera;
                assert!(camera.rotation.is_finite() && camera.translation.is_finite());
                assert!(camera.fx > 0.0 && camera.fy > 0.0 && camera.fx.is_finite() && camera.cx.is_finite());
                assert!((0.0..=1.0).contains(&view.time));
            }
        }
    }
}

/// An `.npy` file.
pub(crate) fn npy<T: npyz::AutoSerialize>(shape: &[u64], values: Vec<T>) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut writer = npyz::WriteOptions::new().default_dtype().shape(shape).writer(&mut bytes).begin_nd().expect("npy");
    writer.extend(values).expect("written");
    writer.finish().expect("written");
    bytes
}

/// The names and times of views.
pub(crate) fn shown(views: &[View]) -> Vec<(&str, f64)> {
    views.iter().map(|view| (view.name.as_str(), view.time)).collect()
}

/// A value with another entry.
pub(crate) fn with(mut value: Value, key: &str, entry: Value) -> Value {
    value[key] = entry;
    value
}
