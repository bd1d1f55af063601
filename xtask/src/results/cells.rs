//! What is trained: every method on every scene with every seed.

use std::path::{Path, PathBuf};

/// A scene.
#[derive(Debug)]
pub struct SceneEntry {
    /// Name in the tables, and of its folder under the data root.
    pub name: &'static str,
    /// Where it comes from.
    pub source: &'static str,
    /// Whether its files are needed.
    real: bool,
    /// Folder of its masks within the scene's.
    masks: Option<&'static str>,
    /// Settings of every run on it; `train.scale` keeps a run below four minutes.
    settings: &'static [&'static str],
}

/// The scenes.
pub const SCENES: &[SceneEntry] = &[
    SceneEntry { name: "video", source: "built in", real: false, masks: None, settings: &[] },
    SceneEntry {
        name: "casual",
        source: "built in",
        real: false,
        masks: None,
        settings: &["scene.kind=casual", "eval.training_views=true"],
    },
    SceneEntry {
        name: "panoptic_neu3d",
        source: "CMU Panoptic Studio, sports/basketball, 16 cameras x 24 frames of 320x180 in the layout of Neu3D",
        real: true,
        masks: Some("masks_people"),
        // Structure from motion knows points on the players.
        settings: &["train.scale=0.4", "train.scale_cloud=true"],
    },
    SceneEntry {
        name: "fox_clutter",
        source: "instant-ngp's fox, 270x480 (trained at half of that), with people of CMU Panoptic pasted into the training photos",
        real: true,
        masks: Some("masks_truth"),
        settings: &["train.scale=0.5", "scene.downscale=2", "eval.training_views=true"],
    },
];

/// A method: its name in the tables and its preset.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Method {
    /// Name in the tables.
    pub name: &'static str,
    /// The preset of the program.
    pub preset: &'static str,
}

/// 4DGS.
pub const FOUR_DGS: Method = Method { name: "4DGS", preset: "quickstart-4dgs" };
/// 4DGS with the motion-aware modules plugged in.
pub const FOUR_DGS_MOTION: Method = Method { name: "4DGS + MVG + MFTA", preset: "quickstart-4dgs-motion" };
/// The base that the paper builds on.
pub const DEGAUSS: Method = Method { name: "DeGauss", preset: "quickstart-degauss" };
/// The full model.
pub const FULL: Method = Method { name: "MVFusion-GS", preset: "quickstart" };

/// The methods in the order of the tables.
pub const METHODS: [Method; 4] = [FOUR_DGS, FOUR_DGS_MOTION, DEGAUSS, FULL];

/// One run.
#[derive(Clone, Debug)]
pub struct Cell {
    /// The scene.
    pub scene: &'static SceneEntry,
    /// The scene's folder, if it has one.
    data: Option<PathBuf>,
    /// Folder with the weights of LPIPS.
    weights: Option<PathBuf>,
    /// The method.
    pub method: Method,
    /// The seed.
    pub seed: u64,
}

/// Every run whose data are there. Seeds vary slowest, so that a table is complete early, if with few seeds.
pub fn all(data_root: Option<&Path>, weights: Option<&Path>, seeds: &[u64]) -> Vec<Cell> {
    let mut cells = Vec::new();
    for &seed in seeds {
        for scene in SCENES {
            let data = data_root.map(|root| root.join(scene.name)).filter(|folder| scene.real && folder.is_dir());
            if scene.real && data.is_none() {
                continue;
            }
            cells.extend(METHODS.map(|method| Cell {
                scene,
                data: data.clone(),
                weights: weights.map(Path::to_owned),
                method,
                seed,
            }));
        }
    }
    cells
}

impl Cell {
    /// Its name, which is its folder's.
    pub fn name(&self) -> String {
        format!("{}-{}-{}", self.scene.name, self.method.preset, self.seed)
    }

    /// Its folder.
    pub fn folder(&self, out: &Path) -> PathBuf {
        out.join(self.name())
    }

    /// Its configuration as options of the program, its data included.
    pub fn configuration(&self) -> Vec<String> {
        let mut options =
            vec!["--preset".to_owned(), self.method.preset.into(), "--seed".into(), self.seed.to_string()];
        let mut set = |setting: String| options.extend(["--set".into(), setting]);
        self.scene.settings.iter().for_each(|setting| set((*setting).to_owned()));
        if let Some(data) = &self.data {
            set(format!("scene.data={}", data.display()));
            if let Some(masks) = self.scene.masks {
                set(format!("eval.dynamic_masks={}", data.join(masks).display()));
            }
        }
        if let Some(weights) = &self.weights {
            set(format!("eval.lpips_weights={}", weights.display()));
        }
        options
    }
}
