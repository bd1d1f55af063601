//! The format glTF 2.0 (binary) with the extension `KHR_gaussian_splatting` of Khronos.
//!
//! The JSON is written by hand. The crate `gltf-json` knows a closed list of vertex attributes, and those of the
//! extension are not in it.

use glam::DMat3;
use mvfusion_data::{GaussianCloud, Scene, View, distinct_cameras, sigmoid, unit_quaternion};
use mvfusion_model::model::gaussians::SH_C0;
use mvfusion_model::model::harmonics::rotated;
use serde_json::{Map, Value, json};

use super::axes::{camera_pose, to_gltf};

/// Name of the extension, and beginning of the names of its attributes.
const EXTENSION: &str = "KHR_gaussian_splatting";

/// Numbers in the header: of the format, its version, and the two kinds of chunks, padded with spaces or zeros.
const MAGIC: u32 = 0x4654_6c67;
const VERSION: u32 = 2;
const JSON_CHUNK: (u32, u8) = (0x4e4f_534a, b' ');
const BINARY_CHUNK: (u32, u8) = (0x004e_4942, 0);

/// A component of an accessor is a 32-bit float; a buffer view holds vertex attributes.
const FLOAT: u32 = 5126;
const ARRAY_BUFFER: u32 = 34962;
/// Vertices are drawn as points where the extension is unknown.
const POINTS: u32 = 0;

/// Maximum number of cameras in the file.
const MOST_CAMERAS: usize = 32;
/// Share of the scene's extent at which the cameras begin to see.
const NEAR: f64 = 0.001;

/// Gaussians of one instant as a file. They are turned to the axes of glTF: y is up, and the training cameras look
/// along -z. Units are those of the scene. The distinct held-out cameras are nodes.
///
/// # Errors
/// If the file would exceed the 4 GiB of the format.
pub fn encode_glb(gaussians: &GaussianCloud, scene: &Scene, time: f64) -> anyhow::Result<Vec<u8>> {
    let turn = to_gltf(scene);
    let gaussians = rotated(gaussians.clone(), turn);
    let mut buffer = Buffer::default();
    let attributes = attributes(&gaussians, &mut buffer);
    let (cameras, mut nodes) = cameras(scene, turn);
    nodes.insert(0, json!({"name": "gaussians", "mesh": 0}));
    let extension = json!({EXTENSION: {"kernel": "ellipse", "colorSpace": "srgb_rec709_display"}});
    let mut document = json!({
        "asset": {
            "version": "2.0",
            "generator": concat!("mvfusion ", env!("CARGO_PKG_VERSION")),
            // From the world of the scene, row by row.
            "extras": {"time": time, "rotation_from_world": turn.transpose().to_cols_array()},
        },
        "extensionsUsed": [EXTENSION],
        "scene": 0,
        "scenes": [{"nodes": (0..nodes.len()).collect::<Vec<_>>()}],
        "nodes": nodes,
        "meshes": [{"primitives": [{"mode": POINTS, "attributes": attributes, "extensions": extension}]}],
        "accessors": buffer.accessors,
        "bufferViews": buffer.views,
        "buffers": [{"byteLength": buffer.bytes.len()}],
    });
    // A list must not be empty.
    if !cameras.is_empty() {
        document["cameras"] = json!(cameras);
    }
    container(&serde_json::to_vec(&document)?, &buffer.bytes)
}

/// The vertex attributes by name, each with its accessor.
fn attributes(gaussians: &GaussianCloud, buffer: &mut Buffer) -> Map<String, Value> {
    let mut found = Map::new();
    let own = |name: &str| format!("{EXTENSION}:{name}");
    let means = gaussians.means.iter().copied();
    found.insert("POSITION".into(), buffer.add_with_bounds(means).into());
    let colours = (0..gaussians.len()).map(|index| fallback_colour(gaussians, index));
    found.insert("COLOR_0".into(), buffer.add("VEC4", colours).into());
    let rotations = gaussians.quaternions.iter().map(|&quaternion| {
        let [w, x, y, z] = unit_quaternion(quaternion);
        [x, y, z, w].map(|part| part as f32)
    });
    found.insert(own("ROTATION"), buffer.add("VEC4", rotations).into());
    let scales = gaussians.log_scales.iter().map(|scales| scales.map(f32::exp));
    found.insert(own("SCALE"), buffer.add("VEC3", scales).into());
    let opacities = gaussians.opacity_logits.iter().map(|&logit| [sigmoid(logit) as f32]);
    found.insert(own("OPACITY"), buffer.add("SCALAR", opacities).into());
    let constant = gaussians.sh_dc.iter().copied();
    found.insert(own("SH_DEGREE_0_COEF_0"), buffer.add("VEC3", constant).into());
    for degree in 1..=gaussians.sh_degree {
        for order in 0..=2 * degree {
            // Coefficients of the lower degrees come first; the constant one is not among them.
            let place = 3 * (degree * degree + order - 1);
            let values = (0..gaussians.len()).map(|index| {
                let rest = gaussians.rest(index);
                [rest[place], rest[place + 1], rest[place + 2]]
            });
            found.insert(own(&format!("SH_DEGREE_{degree}_COEF_{order}")), buffer.add("VEC3", values).into());
        }
    }
    found
}

/// The constant colour, linear as glTF demands of vertex colours, and the opacity: for programs that draw points.
fn fallback_colour(gaussians: &GaussianCloud, index: usize) -> [f32; 4] {
    let linear = |encoded: f64| match encoded {
        // The transfer function of sRGB (IEC 61966-2-1).
        ..=0.04045 => encoded / 12.92,
        _ => ((encoded + 0.055) / 1.055).powf(2.4),
    };
    let colour = |dc: f32| linear((0.5 + SH_C0 * f64::from(dc)).clamp(0.0, 1.0)) as f32;
    let [r, g, b] = gaussians.sh_dc[index].map(colour);
    [r, g, b, sigmoid(gaussians.opacity_logits[index]) as f32]
}

/// The distinct held-out cameras, and their nodes. glTF has no principal point; the centre of the image is taken.
fn cameras(scene: &Scene, turn: DMat3) -> (Vec<Value>, Vec<Value>) {
    let mut distinct = distinct_cameras(&scene.test);
    distinct.truncate(MOST_CAMERAS);
    let camera = |view: &&View| {
        let camera = &view.camera;
        let ratio = camera.width as f64 * camera.fy / (camera.height as f64 * camera.fx);
        let near = (NEAR * scene.extent()).max(f64::from(f32::MIN_POSITIVE));
        let perspective = json!({"yfov": camera.field_of_view().y, "aspectRatio": ratio, "znear": near});
        json!({"type": "perspective", "name": view.name, "perspective": perspective})
    };
    let node = |(index, view): (usize, &&View)| {
        let (place, rotation) = camera_pose(&view.camera, turn);
        json!({"name": view.name, "camera": index, "translation": place.to_array(), "rotation": rotation})
    };
    (distinct.iter().map(camera).collect(), distinct.iter().enumerate().map(node).collect())
}

/// The binary part of a file, with what describes it.
#[derive(Debug, Default)]
struct Buffer {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Buffer {
    /// Adds an accessor of rows of floats, and returns its index.
    fn add<const N: usize>(&mut self, kind: &str, rows: impl ExactSizeIterator<Item = [f32; N]>) -> usize {
        let (start, count) = (self.bytes.len(), rows.len());
        rows.for_each(|row| self.bytes.extend(row.into_iter().flat_map(f32::to_le_bytes)));
        self.views.push(json!({
            "buffer": 0, "byteOffset": start, "byteLength": self.bytes.len() - start, "target": ARRAY_BUFFER,
        }));
        let view = self.views.len() - 1;
        self.accessors.push(json!({"bufferView": view, "componentType": FLOAT, "count": count, "type": kind}));
        self.accessors.len() - 1
    }

    /// The same for positions, whose bounds must be known.
    fn add_with_bounds(&mut self, rows: impl ExactSizeIterator<Item = [f32; 3]> + Clone) -> usize {
        let start = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
        let (low, high) = rows.clone().fold(start, |(low, high), row| {
            let each = |of: fn(f32, f32) -> f32, bound: [f32; 3]| [0, 1, 2].map(|axis| of(bound[axis], row[axis]));
            (each(f32::min, low), each(f32::max, high))
        });
        let index = self.add("VEC3", rows);
        (self.accessors[index]["min"], self.accessors[index]["max"]) = (json!(low), json!(high));
        index
    }
}

/// A file of a JSON and a binary chunk.
fn container(document: &[u8], binary: &[u8]) -> anyhow::Result<Vec<u8>> {
    const HEADER: usize = 12;
    const CHUNK_HEADER: usize = 8;
    let padded = |bytes: &[u8]| bytes.len().next_multiple_of(4);
    let total = HEADER + 2 * CHUNK_HEADER + padded(document) + padded(binary);
    let number = |count: usize| {
        u32::try_from(count).map_err(|_| anyhow::anyhow!("the file would have {total} bytes; glTF allows 4 GiB"))
    };
    let mut file = Vec::with_capacity(total);
    file.extend([MAGIC, VERSION, number(total)?].into_iter().flat_map(u32::to_le_bytes));
    for (bytes, (kind, padding)) in [(document, JSON_CHUNK), (binary, BINARY_CHUNK)] {
        file.extend([number(padded(bytes))?, kind].into_iter().flat_map(u32::to_le_bytes));
        file.extend_from_slice(bytes);
        file.resize(file.len() + padded(bytes) - bytes.len(), padding);
    }
    Ok(file)
}
