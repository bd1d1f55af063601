//! What the page says over the WebSocket: JSON messages, checked before anything is done with them.

use glam::{DMat3, DVec3};
use mvfusion_data::Camera;
use mvfusion_data::camera_path::LONGEST_SIDE;
use mvfusion_model::evaluation::Layer;
use serde::Deserialize;

use crate::render::LEAST_SIDE;

/// Bytes of the longest message. A request has about 500.
pub const LONGEST_MESSAGE: usize = 4096;

/// Allowed vertical fields of view, degrees.
const FIELDS_OF_VIEW: [f64; 2] = [1.0, 170.0];
/// Allowed JPEG qualities. Below them, nothing can be recognised.
const QUALITIES: [u8; 2] = [10, 100];
/// How far the axes of a pose may be from those of a rotation.
const ROTATION_ERROR: f64 = 1e-3;

/// A message of the page.
#[derive(Clone, Debug, PartialEq)]
pub enum Message {
    /// It wants a picture.
    Frame(Box<FrameRequest>),
    /// The training shall pause.
    Pause,
    /// The training shall go on.
    GoOn,
    /// The training shall save a checkpoint now.
    Checkpoint,
}

/// A picture that a page wants.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameRequest {
    /// Number of the request, which the answer bears.
    pub id: u64,
    /// The camera.
    pub camera: CameraChoice,
    /// Width and height in pixels.
    pub size: (usize, usize),
    /// Time in `[0, 1]`; `None` for the static branch alone.
    pub time: Option<f64>,
    /// The layer.
    pub layer: Layer,
    /// Whether the temporal attention takes part.
    pub mfta: bool,
    /// Grey level behind everything; `None` for that of the run.
    pub background: Option<f64>,
    /// JPEG quality.
    pub quality: u8,
}

/// The camera of a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CameraChoice {
    /// Any pose.
    Pose(Camera),
    /// The camera of a view, whose photo it is compared with.
    View(ViewId),
}

/// A view of the scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
pub struct ViewId {
    /// Training or held-out views.
    pub set: ViewSet,
    /// Its index there.
    pub index: usize,
}

/// The views of a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ViewSet {
    /// Training views.
    Train,
    /// Held-out views.
    Test,
}

/// What a server grants.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Most pixels of a picture.
    pub pixels: usize,
    /// Number of training views.
    pub train: usize,
    /// Number of held-out views.
    pub test: usize,
}

/// A message before it is checked.
#[derive(Deserialize)]
#[serde(tag = "type", rename_all = "snake_case")]
enum RawMessage {
    Frame(Box<RawRequest>),
    Pause,
    GoOn,
    Checkpoint,
}

/// A request before it is checked.
#[derive(Deserialize)]
struct RawRequest {
    id: u64,
    pose: Option<RawPose>,
    view: Option<ViewId>,
    size: [usize; 2],
    time: Option<f64>,
    layer: String,
    mfta: bool,
    background: Option<f64>,
    quality: u8,
}

/// A pose as in the `cameras.json` of 3DGS: camera-to-world by rows, in OpenCV axes.
#[derive(Deserialize)]
struct RawPose {
    position: [f64; 3],
    rotation: [[f64; 3]; 3],
    /// Vertical field of view in degrees.
    fov: f64,
}

impl Message {
    /// Reads a message.
    ///
    /// # Errors
    /// What is wrong with it, for whoever wrote the page.
    pub fn parse(text: &str, limits: &Limits) -> Result<Self, String> {
        if text.len() > LONGEST_MESSAGE {
            return Err(format!("the message has {} bytes, more than {LONGEST_MESSAGE}", text.len()));
        }
        let raw: RawMessage = serde_json::from_str(text).map_err(|error| format!("not a message: {error}"))?;
        Ok(match raw {
            RawMessage::Frame(request) => Self::Frame(Box::new(request.check(limits)?)),
            RawMessage::Pause => Self::Pause,
            RawMessage::GoOn => Self::GoOn,
            RawMessage::Checkpoint => Self::Checkpoint,
        })
    }
}

impl RawRequest {
    fn check(self, limits: &Limits) -> Result<FrameRequest, String> {
        let [width, height] = self.size;
        let sides = LEAST_SIDE..=LONGEST_SIDE;
        if !(sides.contains(&width) && sides.contains(&height)) || width * height > limits.pixels {
            return Err(format!("a picture of {width} x {height} pixels; there are at most {}", limits.pixels));
        }
        let within_one = |value: Option<f64>| value.is_none_or(|value| (0.0..=1.0).contains(&value));
        if !within_one(self.time) || !within_one(self.background) {
            return Err("the time and the background lie in [0, 1]".to_owned());
        }
        let [least, most] = QUALITIES;
        let layer = Layer::of_name(&self.layer).ok_or_else(|| format!("there is no layer `{:.40}`", self.layer))?;
        let camera = match (self.pose, self.view) {
            (Some(pose), None) => CameraChoice::Pose(pose.camera(width, height)?),
            (None, Some(view)) => CameraChoice::View(view.check(limits)?),
            _ => return Err("a request has either a pose or a view".to_owned()),
        };
        Ok(FrameRequest {
            id: self.id,
            camera,
            size: (width, height),
            time: self.time,
            layer,
            mfta: self.mfta,
            background: self.background,
            quality: self.quality.clamp(least, most),
        })
    }
}

impl ViewId {
    /// The same view, if there is one.
    pub(super) fn check(self, limits: &Limits) -> Result<Self, String> {
        let count = match self.set {
            ViewSet::Train => limits.train,
            ViewSet::Test => limits.test,
        };
        (self.index < count).then_some(self).ok_or_else(|| format!("there are {count} such views"))
    }
}

impl RawPose {
    fn camera(&self, width: usize, height: usize) -> Result<Camera, String> {
        let axes = DMat3::from_cols_array_2d(&self.rotation).transpose();
        let off = axes * axes.transpose() - DMat3::IDENTITY;
        let is_rotation = off.to_cols_array().iter().all(|value| value.abs() < ROTATION_ERROR);
        if !is_rotation || axes.determinant() < 0.0 {
            return Err("the axes of the pose are no rotation".to_owned());
        }
        let [least, most] = FIELDS_OF_VIEW;
        if !(least..=most).contains(&self.fov) {
            return Err(format!("fields of view go from {least} to {most} degrees"));
        }
        let focal = height as f64 / (2.0 * (self.fov.to_radians() / 2.0).tan());
        let camera = Camera::centred(width, height, focal, axes, DVec3::from_array(self.position));
        camera.is_computable().then_some(camera).ok_or_else(|| "the pose is too far away to compute with".to_owned())
    }
}

#[cfg(test)]
pub(super) mod tests {
    use serde_json::{Value, json};

    use super::*;

    pub const LIMITS: Limits = Limits { pixels: 640 * 480, train: 4, test: 2 };

    /// A sound request.
    pub fn request(id: u64) -> Value {
        json!({
            "type": "frame", "id": id, "size": [320, 180], "time": 0.5, "layer": "composed", "mfta": false,
            "background": null, "quality": 60,
            "pose": {"position": [0, 0, -3], "rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "fov": 60},
        })
    }

    fn parse(message: &Value) -> Result<Message, String> {
        Message::parse(&message.to_string(), &LIMITS)
    }

    #[test]
    fn a_pose_becomes_a_camera_with_its_field_of_view() {
        let Ok(Message::Frame(request)) = parse(&request(7)) else { panic!("a request") };
        let CameraChoice::Pose(camera) = request.camera else { panic!("a pose") };
        assert_eq!((request.id, request.size, request.layer), (7, (320, 180), Layer::Composed));
        assert!((camera.field_of_view().y.to_degrees() - 60.0).abs() < 1e-9);
        assert!(camera.centre().distance(DVec3::new(0.0, 0.0, -3.0)) < 1e-12);
    }

    #[test]
    fn a_view_is_one_of_the_scene() {
        let with = |set: &str, index: usize| {
            let mut message = request(1);
            message["pose"] = Value::Null;
            message["view"] = json!({"set": set, "index": index});
            parse(&message)
        };
        let Ok(Message::Frame(found)) = with("test", 1) else { panic!("a request") };
        assert_eq!(found.camera, CameraChoice::View(ViewId { set: ViewSet::Test, index: 1 }));
        assert!(with("test", 2).is_err_and(|error| error.contains("2 such views")));
        assert!(with("gt", 0).is_err());
    }

    #[test]
    fn commands_have_no_contents() {
        for (name, command) in
            [("pause", Message::Pause), ("go_on", Message::GoOn), ("checkpoint", Message::Checkpoint)]
        {
            assert_eq!(parse(&json!({"type": name})), Ok(command));
        }
    }

    #[test]
    fn what_makes_no_sense_is_refused_with_a_reason() {
        let with = |key: &str, value: Value| {
            let mut message = request(1);
            message[key] = value;
            parse(&message)
        };
        let pose = |key: &str, value: Value| {
            let mut pose = request(1)["pose"].clone();
            pose[key] = value;
            with("pose", pose)
        };
        for (result, words) in [
            (with("size", json!([640, 481])), "pixels"),
            (with("size", json!([8, 480])), "pixels"),
            (with("size", json!([usize::MAX, usize::MAX])), "pixels"),
            (with("time", json!(1.5)), "[0, 1]"),
            (with("background", json!(-1)), "[0, 1]"),
            (with("layer", json!("gt")), "layer `gt`"),
            (with("pose", Value::Null), "either"),
            (pose("fov", json!(0)), "degrees"),
            (pose("rotation", json!([[1, 0, 0], [0, 1, 0], [0, 0, 2]])), "rotation"),
            (pose("rotation", json!([[1, 0, 0], [0, 1, 0], [0, 0, -1]])), "rotation"),
            (pose("position", json!([1e300, 0, 0])), "too far"),
            (parse(&json!({"type": "frame"})), "not a message"),
            (parse(&json!({"type": "shutdown"})), "not a message"),
            (Message::parse(&" ".repeat(LONGEST_MESSAGE + 1), &LIMITS), "bytes"),
        ] {
            assert!(result.as_ref().is_err_and(|error| error.contains(words)), "{words}: {result:?}");
        }
    }

    #[test]
    fn a_quality_is_held_within_its_bounds() {
        let mut message = request(1);
        message["quality"] = json!(0);
        let Ok(Message::Frame(found)) = parse(&message) else { panic!("a request") };
        assert_eq!(found.quality, QUALITIES[0]);
    }
}
