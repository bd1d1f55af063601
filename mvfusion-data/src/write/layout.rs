//! The layouts, and the kind of scene of each.

use serde::{Deserialize, Serialize};

use super::error::Misfit;
use super::package::Package;
use super::{colmap, dnerf, hypernerf, multipleview, nerfstudio, neu3d, onthego, panoptic};
use crate::scene::{Capture, Scene};

/// The layouts that a scene can be written in.
///
/// All of them keep cameras, images and points. The documentation of each variant states other changes. The first six
/// are for videos, the rest for photos.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Layout {
    /// `camNN/images/0000.png`, `poses_bounds.npy`, `points3D.ply`. For fixed cameras with square pixels and a centred
    /// principal point, exactly one of them held out. Times become index / number of frames.
    Neu3d,
    /// Dynamic 3D Gaussians: `train_meta.json`, `test_meta.json`, `ims/<camera>/000000.png`, `init_pt_cld.npz`. For
    /// synchronised cameras. Times become index / number of frames.
    Panoptic,
    /// `transforms.json` and `images/<view>.png`. Times and split do not change.
    Nerfstudio,
    /// The layout of 4DGaussians: `camNN/frame_00001.png`, `sparse_/`, `points3D_multipleview.ply`. For fixed cameras.
    /// Times become index / number of frames. The choice of held-out cameras is lost.
    MultipleView,
    /// `transforms_{train,val,test}.json`, `train/r_000.png`, `test/r_000.png`, `fused.ply`. For cameras with one focal
    /// length, square pixels and a centred principal point. Its readers divide times by the largest.
    DNerf,
    /// Nerfies and HyperNeRF: `dataset.json`, `metadata.json`, `scene.json`, `camera/`, `rgb/1x/`, `points.npy`. Times
    /// become their index / the largest index.
    HyperNerf,
    /// `images/` and `sparse/0` with a PINHOLE camera, for other splatting programs. All layouts for photos name
    /// training photos `2clutter000.png` and held-out photos `1extra000.png`. The time is number / largest number.
    Colmap,
    /// NeRF On-the-go as published: `images/`, `transforms.json`, `split.json`, and additionally `points3D.ply`.
    OnTheGo,
    /// NeRF On-the-go as SpotLessSplats and DeGauss read it: `images/` and `sparse/0` with an OPENCV camera.
    #[serde(rename = "onthego-colmap")]
    OnTheGoColmap,
    /// The same in a subfolder `0`.
    RobustNerf,
}

impl Layout {
    /// All layouts, first those for videos.
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

    /// Name in configurations and on the command line.
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

    /// The layout with this key.
    pub fn of_key(key: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|layout| layout.key() == key)
    }

    /// The kind of scene that it can represent.
    pub fn capture(self) -> Capture {
        match self {
            Self::Neu3d | Self::Panoptic | Self::Nerfstudio | Self::MultipleView | Self::DNerf | Self::HyperNerf => {
                Capture::Video
            }
            Self::Colmap | Self::OnTheGo | Self::OnTheGoColmap | Self::RobustNerf => Capture::Photos,
        }
    }

    /// Whether readers fail, or choose held-out views themselves, if the files hold none out.
    pub(super) fn needs_test_views(self) -> bool {
        matches!(self, Self::Neu3d | Self::Panoptic | Self::DNerf | Self::HyperNerf)
    }

    /// The content of the folder for a scene of this layout's kind.
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
