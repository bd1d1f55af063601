//! What the command line says about a scene to measure: `COUNT@WIDTHxHEIGHT`.

use std::fmt::{self, Display};
use std::str::FromStr;

use anyhow::{Context, Error, Result, ensure};

/// A number of Gaussians, and a picture's size.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SceneSize {
    /// Gaussians.
    pub count: usize,
    /// Pixels.
    pub width: usize,
    /// Pixels.
    pub height: usize,
}

impl FromStr for SceneSize {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let read = || {
            let (count, size) = text.split_once('@')?;
            let (width, height) = size.split_once('x')?;
            Some(Self { count: count.parse().ok()?, width: width.parse().ok()?, height: height.parse().ok()? })
        };
        let scene =
            read().with_context(|| format!("`{text}` is no scene; write COUNT@WIDTHxHEIGHT, as 50000@640x360"))?;
        ensure!(scene.count > 0 && scene.width > 0 && scene.height > 0, "`{text}` has nothing to render");
        Ok(scene)
    }
}

impl Display for SceneSize {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} Gaussians, {}x{}", self.count, self.width, self.height)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scene_is_read_and_nonsense_refused() {
        let scene = SceneSize { count: 50_000, width: 640, height: 360 };
        assert_eq!("50000@640x360".parse::<SceneSize>().expect("a scene"), scene);
        for text in ["", "50000", "50000@640", "0@640x360", "-1@640x360", "1@640x360x2"] {
            assert!(text.parse::<SceneSize>().is_err(), "{text}");
        }
    }
}
