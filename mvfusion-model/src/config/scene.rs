//! Which scene is trained on, and the clouds of Gaussians that training starts from.

use std::path::PathBuf;

use mvfusion_data::builtin::BuiltinKind;
use mvfusion_data::{Format, TimeRule};
use serde::{Deserialize, Serialize};

use super::keys::{keys, leaves};

/// How the scene is read.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SceneConfig {
    /// Folder of the scene; without one, the built-in scene is made. The program's `--data` sets it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub data: Option<PathBuf>,
    /// Format of the folder; tried in turn if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub format: Option<Format>,
    /// Kind of the built-in scene, where there is no folder.
    pub kind: SceneKind,
    /// Seed of the built-in scene, apart from the run's, so that seeds of one sweep train on one scene.
    pub seed: u64,
    /// Pictures are reduced by this factor when read; at least 1.
    pub downscale: f64,
    /// At most this many frames a camera (DeGauss reads the first 300).
    pub frames: usize,
    /// How a frame's number becomes a time in `[0, 1]`.
    pub time: TimeRule,
    /// Where nothing says what a photo is for, every so many is held out; 0 holds none out (LLFF: 8).
    pub test_every: usize,
    /// Cameras of a video that are held out, such as `["cam00"]`, instead of those that the format holds out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub test_cameras: Option<Vec<String>>,
    /// Whether black counts in the masks that lie beside the pictures; else white counts, as nerfstudio and COLMAP have it.
    pub invert_masks: bool,
    /// Folder in which the decoded frames of videos stay for the next run; else they lie in a temporary one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub frame_store: Option<PathBuf>,
}

/// The kind of the built-in scene.
pub type SceneKind = BuiltinKind;

impl Default for SceneConfig {
    fn default() -> Self {
        Self {
            data: None,
            format: None,
            kind: SceneKind::Video,
            seed: 1,
            downscale: 1.0,
            frames: 300,
            time: TimeRule::default(),
            test_every: 8,
            test_cameras: None,
            invert_masks: false,
            frame_store: None,
        }
    }
}

/// The clouds of Gaussians before the first step (METHOD §3).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct InitConfig {
    /// File of Gaussians that the static branch starts from, instead of points: a PLY file in the layout of 3DGS, of
    /// any degree of colours, such as `mvfusion export` writes. The keys below do not count for this branch then.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub static_ply: Option<PathBuf>,
    /// The same for the dynamic branch, and for the only one of a model that has one. Its mask logits are those of
    /// the file if it has them. The HexPlane grid spans its centres.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dynamic_ply: Option<PathBuf>,
    /// Dynamic Gaussians strewn uniformly over the scene's box. DeGauss: 10 000 for video, 30 000 for photos.
    pub dynamic_points: usize,
    /// Dynamic Gaussians put on random points of the cloud. DeGauss: 100 for video, none for photos.
    pub dynamic_from_cloud: usize,
    /// At most this share of the cloud is used for them (DeGauss: 0.1).
    pub dynamic_cloud_share: f64,
    /// Whether they have the colours of their points (DeGauss: random ones, like those that are strewn).
    pub dynamic_cloud_colours: bool,
    /// Dynamic Gaussians put where synchronised still cameras see something move, instead of those that are strewn; 0
    /// looks for none. Ours (docs/METHOD.md, section 13); about a quarter of `densify.dynamic.max_gaussians` leaves room
    /// for splitting. Where nothing is found, they are strewn.
    pub motion_points: usize,
    /// How long they live, in frames, with `model.lifetime`.
    pub motion_duration: f64,
    /// Their logit of belonging to the foreground.
    pub motion_logit: f64,
    /// Dynamic Gaussians born at the end of the first stage where a photo differs from the static branch, instead of as
    /// many that are strewn; where each photo has a moment of its own, and with `model.lifetime`. 0 lets none be born.
    /// Ours (docs/METHOD.md, section 13).
    pub photo_points: usize,
    /// How long they live, in distances to the next photo's moment: well below 1, so that no other photo shows them.
    pub photo_duration: f64,
    /// Static Gaussians strewn uniformly over the scene's box, beside those on the points; ours, for clouds with gaps.
    pub static_points: usize,
    /// Static Gaussians on a far sphere. DeGauss: 100 000 for photos, none for video.
    pub sky_points: usize,
    /// The box is the cloud's, larger by this share of the scene extent on every side (DeGauss: 0 for video, 0.1 for
    /// photos).
    pub box_margin: f64,
    /// The box reaches beyond the cameras by at most this many scene extents (DeGauss: 5 for video, without limit for photos).
    pub box_reach: f64,
    /// Opacity of every Gaussian (3DGS: 0.1).
    pub opacity: f64,
    /// Logit of belonging to the foreground. DeGauss: 0, a draw between the branches. Ours may start above it in short
    /// runs: where the mask favours the dynamic branch it is compared with the photo directly, so that it learns to move
    /// before the static branch, which starts from known points, has won everywhere.
    pub dynamic_logit: f64,
}

impl Default for InitConfig {
    fn default() -> Self {
        Self {
            static_ply: None,
            dynamic_ply: None,
            dynamic_points: 10_000,
            dynamic_from_cloud: 100,
            dynamic_cloud_share: 0.1,
            dynamic_cloud_colours: false,
            motion_points: 0,
            motion_duration: 2.0,
            motion_logit: 0.0,
            photo_points: 0,
            photo_duration: 0.2,
            static_points: 0,
            sky_points: 0,
            box_margin: 0.0,
            box_reach: 5.0,
            opacity: 0.1,
            dynamic_logit: 0.0,
        }
    }
}

keys!(SceneConfig {
    data: ANY,
    format: ANY,
    kind: ANY,
    seed: ANY,
    downscale: FROM_1.saying("pictures can be reduced, not enlarged; give 1 or more"),
    frames: ANY,
    time: ANY,
    test_every: ANY,
    test_cameras: ANY,
    invert_masks: ANY,
    frame_store: ANY,
});

keys!(InitConfig {
    static_ply: ANY,
    dynamic_ply: ANY,
    dynamic_points: ANY,
    dynamic_from_cloud: ANY,
    dynamic_cloud_share: SHARE,
    dynamic_cloud_colours: ANY,
    motion_points: ANY,
    motion_duration: ABOVE_0.saying("a duration is a number above 0"),
    motion_logit: FINITE.saying("give a number; above 0 is in favour of the foreground"),
    photo_points: ANY,
    photo_duration: ABOVE_0.saying("a duration is a number above 0"),
    static_points: ANY,
    sky_points: ANY,
    box_margin: FROM_0,
    box_reach: FROM_0_OR_WITHOUT_END,
    opacity: INSIDE_0_1,
    dynamic_logit: FINITE.saying("give a number; above 0 is in favour of the foreground"),
});

leaves!(SceneKind, TimeRule);
