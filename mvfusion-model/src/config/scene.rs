//! The training scene, and the initial clouds of Gaussians.

use std::path::PathBuf;

use mvfusion_data::builtin::BuiltinKind;
use mvfusion_data::{Capture, Format, TimeRule};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::keys::{keys, leaves};

/// How the scene is read (ours; the formats as in METHOD §5).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct SceneConfig {
    /// Folder of the scene; without one, the built-in scene is used. The program's `--data` sets it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub data: Option<PathBuf>,
    /// Format of the folder; detected if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub format: Option<Format>,
    /// Kind of capture of the folder; that of the format if absent. `video` is for the frames of one moving camera in a
    /// format of photos, such as `mvfusion prepare` makes: the frames that are held out are then compared with the whole
    /// render, at their times.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub capture: Option<Capture>,
    /// Kind of the built-in scene, without a folder.
    pub kind: SceneKind,
    /// Seed of the built-in scene. It differs from the run's seed, so that the seeds of a sweep share one scene.
    pub seed: u64,
    /// Training photos of the built-in scene `casual`; at least 2.
    pub photos: usize,
    /// Images are downscaled by this factor when read; at least 1.
    pub downscale: f64,
    /// Maximum number of frames per camera in the layouts of Neu3D, MultipleView and Panoptic (DeGauss reads the first
    /// 300).
    pub frames: usize,
    /// The map from frame number to a time in `[0, 1]`.
    pub time: TimeRule,
    /// If a dataset has no split, every n-th photo is held out; 0 holds none out (LLFF: 8).
    pub test_every: usize,
    /// Held-out cameras of a video, such as `["cam00"]`, instead of the format's default.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub test_cameras: Option<Vec<String>>,
    /// Whether black means valid in the masks next to the images; otherwise white does, as in nerfstudio and COLMAP.
    pub invert_masks: bool,
    /// Folder that keeps the decoded frames of videos for the next run; otherwise they are temporary.
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
            capture: None,
            kind: SceneKind::Video,
            seed: 1,
            photos: 60,
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
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct InitConfig {
    /// Initial Gaussians of the static branch, instead of points: a PLY file in the layout of 3DGS, of any SH degree,
    /// such as `mvfusion export` writes. The keys below then do not apply to this branch.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub static_ply: Option<PathBuf>,
    /// The same for the dynamic branch, also in a model with one branch. Mask logits come from the file if it has them.
    /// The HexPlane grid spans the centres.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dynamic_ply: Option<PathBuf>,
    /// Dynamic Gaussians placed uniformly in the scene's box. DeGauss: 10 000 for video, 30 000 for photos.
    pub dynamic_points: usize,
    /// Dynamic Gaussians on random points of the cloud. DeGauss: 100 for video, none for photos.
    pub dynamic_from_cloud: usize,
    /// Maximum fraction of the cloud for `dynamic_from_cloud` (DeGauss: 0.1).
    pub dynamic_cloud_share: f64,
    /// Whether the Gaussians of `dynamic_from_cloud` have the colours of their points (DeGauss: random colours, like
    /// the uniform ones).
    pub dynamic_cloud_colours: bool,
    /// Dynamic Gaussians where fixed, synchronised cameras see motion, instead of uniform ones; 0 switches detection
    /// off. Without detected motion, they are uniform. Ours (docs/METHOD.md, section 13); about a quarter of
    /// `densify.dynamic.max_gaussians` leaves room for splitting.
    pub motion_points: usize,
    /// Duration in frames of the Gaussians of `motion_points` and of those born in a video, with `model.lifetime`.
    /// Ours.
    pub motion_duration: f64,
    /// Mask logit of the foreground of the Gaussians of `motion_points`, and of those born during training. Ours.
    pub motion_logit: f64,
    /// Dynamic Gaussians born at the end of the first stage where a photo differs from the static branch, instead of as
    /// many uniform ones. Needs photos with distinct moments, and `model.lifetime`. 0 switches births off. Ours
    /// (docs/METHOD.md, section 13).
    pub photo_points: usize,
    /// Duration of the Gaussians of `photo_points`, as a fraction of the time to the nearest photo: well below 1, so
    /// that no other photo shows them. Ours.
    pub photo_duration: f64,
    /// Additional static Gaussians placed uniformly in the scene's box. Ours, for clouds with gaps.
    pub static_points: usize,
    /// Static Gaussians on a far sphere. DeGauss: 100 000 for photos, none for video.
    pub sky_points: usize,
    /// Margin of the box around the cloud, as a fraction of the scene extent on every side (DeGauss: 0 for video, 0.1
    /// for photos).
    pub box_margin: f64,
    /// Maximum distance of the box beyond the cameras, in scene extents (DeGauss: 5 for video, unlimited for photos).
    pub box_reach: f64,
    /// Initial opacity (3DGS: 0.1).
    pub opacity: f64,
    /// Mask logit of the foreground. DeGauss: 0, equal shares. Ours may be larger in short runs. Where the mask favours
    /// the dynamic branch, the branch is compared with the photo directly. It then learns to move before the static
    /// branch, which starts from known points, dominates everywhere.
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

/// Lower end of `init.motion_duration`, in frames.
pub(crate) const LEAST_MOTION_DURATION: f64 = 1e-3;

keys!(SceneConfig {
    data: ANY,
    format: ANY,
    capture: ANY,
    kind: ANY,
    seed: SEED,
    photos: FROM_1.from(2.0).to(1e5).saying("a walk has at least two photos"),
    downscale: FROM_1.to(1e3).saying("pictures can be reduced, not enlarged; give 1 or more"),
    frames: FROM_1.saying("a camera has at least one frame"),
    time: ANY,
    test_every: FROM_0.saying("give n to hold out every n-th photo; 0 holds none out"),
    test_cameras: ANY,
    invert_masks: ANY,
    frame_store: ANY,
});

keys!(InitConfig {
    static_ply: ANY,
    dynamic_ply: ANY,
    dynamic_points: GAUSSIANS,
    dynamic_from_cloud: GAUSSIANS,
    dynamic_cloud_share: SHARE,
    dynamic_cloud_colours: ANY,
    motion_points: GAUSSIANS,
    motion_duration: ABOVE_0.from(LEAST_MOTION_DURATION).saying("a duration is a number above 0"),
    motion_logit: LOGIT.saying("give a number; above 0 is in favour of the foreground"),
    photo_points: GAUSSIANS,
    photo_duration: ABOVE_0.from(1e-3).saying("a duration is a number above 0"),
    static_points: GAUSSIANS,
    sky_points: GAUSSIANS,
    box_margin: FROM_0.to(1e3),
    box_reach: FROM_0.to(f64::INFINITY).saying("give a number that is not below 0; inf is without a bound"),
    opacity: SHARE.from(1e-6).to(0.999_999).saying("give a number between 0 and 1"),
    dynamic_logit: LOGIT.saying("give a number; above 0 is in favour of the foreground"),
});

leaves!(SceneKind, TimeRule);
