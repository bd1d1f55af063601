//! The layouts, and which scenes fit them.

use serde::{Deserialize, Serialize};

use super::package::Package;
use super::{Misfit, colmap, dnerf, hypernerf, multipleview, nerfstudio, neu3d, onthego, panoptic};
use crate::{Capture, Scene};

/// The layouts in which a scene can be written.
///
/// Cameras, pictures and points survive in all of them; each says below what else becomes of a scene. Videos go to the
/// first six, photos to the rest.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Layout {
    /// `camNN/images/0000.png`, `poses_bounds.npy`, `points3D.ply`. For cameras that stand still, with square pixels
    /// and the principal point in the middle, of which one is held out. Times become index / number of frames.
    Neu3d,
    /// Dynamic 3D Gaussians: `train_meta.json`, `test_meta.json`, `ims/<camera>/000000.png`, `init_pt_cld.npz`. For
    /// synchronised cameras. Times become index / number of frames.
    Panoptic,
    /// `transforms.json` and `images/<view>.png`, with times and the split as they are.
    Nerfstudio,
    /// 4DGaussians' own: `camNN/frame_00001.png`, `sparse_/`, `points3D_multipleview.ply`. For cameras that stand
    /// still. Times become index / number of frames; which camera is held out has no place in it and is lost.
    MultipleView,
    /// `transforms_{train,val,test}.json`, `train/r_000.png`, `test/r_000.png`, `fused.ply`. For cameras of one focal
    /// length, with square pixels and the principal point in the middle. Its readers divide the times by their maximum.
    DNerf,
    /// Nerfies' and HyperNeRF's: `dataset.json`, `metadata.json`, `scene.json`, `camera/`, `rgb/1x/`, `points.npy`.
    /// Times become their index / the largest index.
    HyperNerf,
    /// `images/` and `sparse/0`, a PINHOLE camera, as other splatting programs read it. In all layouts for photos these
    /// are named `2clutter000.png` for training and `1extra000.png` if held out; number / largest number is the time.
    Colmap,
    /// NeRF On-the-go as published: `images/`, `transforms.json`, `split.json`; and `points3D.ply`, which the original
    /// lacks.
    OnTheGo,
    /// NeRF On-the-go as SpotLessSplats and DeGauss take it: `images/` and `sparse/0`, an OPENCV camera.
    #[serde(rename = "onthego-colmap")]
    OnTheGoColmap,
    /// The same in an inner folder `0`.
    RobustNerf,
}

impl Layout {
    /// All layouts: those for videos, then those for photos.
    pub const ALL: [Self; 10] = [
        Self::Neu3d,
        Self::Panoptic,
        Self::Nerfstudio,
        Self::MultipleView,
        Self::DNerf,
        Self::HyperNerf,
        Self::Colmap,
        Self::OnTheGo,
        Self::OnTheGoColmap,
        Self::RobustNerf,
    ];

    /// Its name in configurations and on the command line.
    pub fn key(self) -> &'static str {
        match self {
            Self::Neu3d => "neu3d",
            Self::Panoptic => "panoptic",
            Self::Nerfstudio => "nerfstudio",
            Self::MultipleView => "multipleview",
            Self::DNerf => "dnerf",
            Self::HyperNerf => "hypernerf",
            Self::Colmap => "colmap",
            Self::OnTheGo => "onthego",
            Self::OnTheGoColmap => "onthego-colmap",
            Self::RobustNerf => "robustnerf",
        }
    }

    /// The layout of that key.
    pub fn of_key(key: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|layout| layout.key() == key)
    }

    /// The kind of scene that it is for.
    pub fn capture(self) -> Capture {
        match self {
            Self::Neu3d | Self::Panoptic | Self::Nerfstudio | Self::MultipleView | Self::DNerf | Self::HyperNerf => {
                Capture::Video
            }
            Self::Colmap | Self::OnTheGo | Self::OnTheGoColmap | Self::RobustNerf => Capture::Photos,
        }
    }

    /// Whether readers hold something out, or fail, where the files hold out nothing.
    pub(super) fn needs_test_views(self) -> bool {
        matches!(self, Self::Neu3d | Self::Panoptic | Self::DNerf | Self::HyperNerf)
    }

    /// What the folder will hold for a scene of the kind that this is for.
    pub(super) fn package(self, scene: &Scene) -> Result<Package<'_>, Misfit> {
        match self {
            Self::Neu3d => neu3d::package(scene),
            Self::Panoptic => panoptic::package(scene),
            Self::Nerfstudio => nerfstudio::package(scene),
            Self::MultipleView => multipleview::package(scene),
            Self::DNerf => dnerf::package(scene),
            Self::HyperNerf => hypernerf::package(scene),
            Self::Colmap => Ok(colmap::package(scene, "", colmap::LensModel::Pinhole)),
            Self::OnTheGo => onthego::package(scene),
            Self::OnTheGoColmap => Ok(colmap::package(scene, "", colmap::LensModel::OpenCv)),
            Self::RobustNerf => Ok(colmap::package(scene, "0/", colmap::LensModel::OpenCv)),
        }
    }
}
