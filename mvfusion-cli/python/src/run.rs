//! A trained run: its facts, its Gaussians, its renders.

use std::fs;
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

use anyhow::Context;
use glam::{DMat3, DVec3};
use mvfusion_cli::config;
use mvfusion_cli::export::{Exporter, Moment};
use mvfusion_cli::failure::UsageError;
use mvfusion_cli::memory::{self, MemoryRule};
use mvfusion_cli::progress::Verbosity;
use mvfusion_cli::render::{LayerChoice, chosen_layers, parse_layer};
use mvfusion_cli::run::{self, MasksRequest, OpenRun, RunRequest};
use mvfusion_data::camera_path::check_camera as check;
use mvfusion_data::{Camera, GaussianCloud, NamedArray, View};
use mvfusion_model::evaluation::{Layer, LayerRenderer, MotionLayers, RenderedLayer};
use pyo3::prelude::*;
use serde_json::{Value, json};

use crate::arrays::{Packed, packed, packed_array};
use crate::compute::compute;
use crate::error::raised;
use crate::values::to_python;

/// Width, height; fx, fy, cx, cy; rotation from world to camera, row by row; translation.
type CameraNumbers = ((usize, usize), [f64; 4], [f64; 9], [f64; 3]);

/// An open run.
#[pyclass(frozen, name = "Run")]
pub struct NativeRun {
    path: PathBuf,
    run: OpenRun,
    /// The motion layers with and without temporal attention, once they were measured.
    motion: [Mutex<Option<MotionLayers>>; 2],
}

#[pymethods]
impl NativeRun {
    /// Opens a run.
    #[new]
    fn open(py: Python<'_>, path: PathBuf, device: &str, data: Option<PathBuf>) -> PyResult<Self> {
        compute(py, || {
            let request = RunRequest { run: &path, data: data.as_deref(), masks: MasksRequest::Unused, device };
            let run = OpenRun::open(&request, Verbosity::SILENT)?;
            // Its files are read later, when the current folder may be another.
            Ok(Self { run, motion: Default::default(), path: std::path::absolute(&path)? })
        })
    }

    /// What does not change, as JSON.
    fn facts(&self) -> String {
        let OpenRun { config, device, scene, trained } = &self.run;
        let counts = run::GaussianCounts::of(&trained.model);
        let layers = chosen_layers(&[LayerChoice::All], &trained.model, trained.level(config));
        json!({
            "device": device.name,
            "scene": scene.name,
            "steps": trained.steps,
            "total_steps": config.train.stages.total(),
            "is_finished": run::is_finished(&self.path),
            "gaussians": counts,
            "layers": layers.iter().map(|layer| layer.name()).collect::<Vec<_>>(),
            "background": self.run.render_context().background.grey,
            "times": scene.training_times(),
        })
        .to_string()
    }

    /// The run's configuration, as nested dicts.
    fn config<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let table = || {
            let text = config::to_toml(&config::read(&self.path.join(run::CONFIG))?)?;
            anyhow::Ok(text.parse::<toml::Table>()?)
        };
        let table = table().map_err(|error| raised(&error))?;
        to_python(py, &table.into())
    }

    /// The text of `results.json`; `None` without the file.
    fn metrics(&self) -> PyResult<Option<String>> {
        let path = self.path.join(run::RESULTS);
        match fs::read_to_string(&path) {
            Ok(text) => Ok(Some(text)),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(None),
            Err(error) => Err(raised(&anyhow::Error::new(error).context(format!("cannot read {}", path.display())))),
        }
    }

    /// The views of both splits, as JSON.
    fn views(&self) -> String {
        let scene = &self.run.scene;
        let describe = |split: &str, views: &[View]| -> Vec<Value> {
            let of = |(index, view): (usize, &View)| {
                let Camera { width, height, fx, fy, cx, cy, rotation, translation } = view.camera;
                json!({
                    "split": split,
                    "index": index,
                    "name": view.name,
                    "time": view.time,
                    "size": [width, height],
                    "intrinsics": [fx, fy, cx, cy],
                    // Columns of the transpose are rows.
                    "rotation": rotation.transpose().to_cols_array(),
                    "translation": translation.to_array(),
                })
            };
            views.iter().enumerate().map(of).collect()
        };
        Value::from([describe("train", &scene.train), describe("test", &scene.test)].concat()).to_string()
    }

    /// The photo of a view, `[H, W, 3]` of bytes.
    fn photo<'py>(&self, py: Python<'py>, split: &str, index: usize) -> PyResult<Packed<'py>> {
        let views = if split == "train" { &self.run.scene.train } else { &self.run.scene.test };
        let photo = compute(py, || Ok(views.get(index).context("there is no such view")?.image.rgb()?))?;
        let shape = vec![photo.height() as usize, photo.width() as usize, 3];
        Ok(packed(py, "photo", shape, photo.as_raw()))
    }

    /// The activated Gaussians of a branch.
    fn gaussians<'py>(
        &self,
        py: Python<'py>,
        time: Option<f64>,
        branch: &str,
        without_mfta: bool,
    ) -> PyResult<Vec<Packed<'py>>> {
        let arrays = compute(py, || {
            check_time(time)?;
            Ok(self.run.device.guarded(|| self.cloud(time, branch, without_mfta))?.to_arrays())
        })?;
        Ok(arrays.into_iter().map(|array| packed_array(py, array)).collect())
    }

    /// Layers of a camera's view, `[H, W, 3]` or `[H, W]`.
    fn render<'py>(
        &self,
        py: Python<'py>,
        camera: CameraNumbers,
        time: Option<f64>,
        layers: Vec<String>,
        without_mfta: bool,
    ) -> PyResult<Vec<Packed<'py>>> {
        let rendered = compute(py, || self.rendered(&self::camera(camera), time, &layers, without_mfta))?;
        Ok(rendered.into_iter().map(|array| packed_array(py, array)).collect())
    }
}

impl NativeRun {
    fn cloud(&self, time: Option<f64>, branch: &str, without_mfta: bool) -> anyhow::Result<GaussianCloud> {
        let exporter = Exporter::of(&self.run, without_mfta, Verbosity::SILENT);
        let moment = time.map_or(Moment::Canonical, Moment::At);
        match (branch, time) {
            ("dynamic", _) => Ok(exporter.dynamic(moment)?),
            ("static", _) => exporter.static_()?.ok_or_else(|| {
                UsageError::new("the model has no static branch: its only branch is \"dynamic\".").into()
            }),
            ("scene", Some(_)) => Ok(exporter.scene(moment)?),
            ("scene", None) => {
                Err(UsageError::new("the whole scene is shown at a time: give time, from 0 to 1.").into())
            }
            _ => {
                let names = "\"dynamic\", \"static\" and \"scene\"";
                Err(UsageError::new(format!("unknown branch `{branch}`: the branches are {names}.")).into())
            }
        }
    }

    fn rendered(
        &self,
        camera: &Camera,
        time: Option<f64>,
        layers: &[String],
        without_mfta: bool,
    ) -> anyhow::Result<Vec<NamedArray>> {
        check_time(time)?;
        check(camera).map_err(|reason| UsageError::new(format!("the camera cannot be rendered: {reason}.")))?;
        let unknown = |name: &str, reason: String| UsageError::new(format!("unknown layer `{name}`: {reason}."));
        let choices = layers.iter().map(|name| parse_layer(name).map_err(|reason| unknown(name, reason)));
        let choices = choices.collect::<Result<Vec<_>, _>>()?;
        let (config, level) = (&self.run.config, self.run.level());
        let model = self.run.model(without_mfta, Verbosity::SILENT);
        let layers = chosen_layers(&choices, &model, level);
        let size = (camera.width, camera.height);
        memory::check_rendering(&model, config, size, layers.len(), &self.run.device, MemoryRule::of_flag(false))?;
        let context = self.run.render_context();
        self.run.device.guarded(|| {
            let motion = match layers.iter().any(|layer| layer.is_motion()) {
                // A layer that the model lacks is refused before anything is measured.
                true if layers.iter().all(|layer| layer.lacking(&model, level).is_none()) => {
                    self.motion(without_mfta, || Ok(MotionLayers::measure(&model, &context, config.motion.weights)?))?
                }
                _ => MotionLayers::default(),
            };
            let renderer = LayerRenderer::with_motion(&model, level, &context, &layers, &motion)?;
            let shown = |layer: RenderedLayer| Ok(interleaved(layer.layer, layer.size(), layer.pixels()?));
            renderer.render(camera, time)?.into_iter().map(shown).collect()
        })
    }

    /// The motion layers, measured once.
    fn motion(
        &self,
        without_mfta: bool,
        measure: impl FnOnce() -> anyhow::Result<MotionLayers>,
    ) -> anyhow::Result<MotionLayers> {
        let mut known = self.motion[usize::from(without_mfta)].lock().unwrap_or_else(PoisonError::into_inner);
        if known.is_none() {
            *known = Some(measure()?);
        }
        Ok(known.clone().unwrap_or_default())
    }
}

/// Pixels with their channels side by side, from channels one after the other. One channel has no axis of its own.
fn interleaved(layer: Layer, (width, height): (usize, usize), planes: Vec<f32>) -> NamedArray {
    let (name, pixels) = (layer.name(), width * height);
    if planes.len() == pixels {
        return NamedArray { name, shape: vec![height, width], values: planes };
    }
    let shape = vec![height, width, planes.len() / pixels.max(1)];
    let values = (0..pixels).flat_map(|pixel| planes.iter().skip(pixel).step_by(pixels).copied()).collect();
    NamedArray { name, shape, values }
}

fn check_time(time: Option<f64>) -> Result<(), UsageError> {
    match time {
        Some(time) if !(0.0..=1.0).contains(&time) => {
            Err(UsageError::new(format!("the time is {time}, and times lie in [0, 1].")))
        }
        _ => Ok(()),
    }
}

fn camera(((width, height), [fx, fy, cx, cy], rotation, translation): CameraNumbers) -> Camera {
    let rotation = DMat3::from_cols_array(&rotation).transpose();
    Camera { width, height, fx, fy, cx, cy, rotation, translation: DVec3::from_array(translation) }
}

/// Whether a camera can be rendered.
#[pyfunction]
pub fn check_camera(numbers: CameraNumbers) -> PyResult<()> {
    check(&camera(numbers))
        .map_err(|reason| raised(&UsageError::new(format!("the camera cannot be rendered: {reason}.")).into()))
}
