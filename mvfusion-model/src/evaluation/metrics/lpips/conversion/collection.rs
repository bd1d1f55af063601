//! The parts that given files, folders and wheels contain, and the weights that are made of them.

use std::collections::BTreeMap;
use std::fs;
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

use burn::tensor::TensorData;
use mvfusion_data::files::open_file;
use safetensors::tensor::{Dtype, TensorView};
use tempfile::NamedTempFile;
use zip::ZipArchive;

use super::super::layout::Backbone;
use super::part::{Part, PartKind, TensorNames};
use super::published::{is_outdated, is_published};
use super::torch_file::TorchFile;
use crate::ModelError;
use crate::files::sha256;

/// Where the linear layers are within a folder: in the folder itself, or where the package lpips has them.
const SUBFOLDERS: [&str; 4] = ["", "v0.1", "weights/v0.1", "lpips/weights/v0.1"];

/// The folder of the linear layers in a wheel.
const IN_WHEEL: &str = "lpips/weights/v0.1/";

/// A wheel has some kB of linear layers.
const MOST_OF_ENTRY: u64 = 1 << 20;

/// Extensions of files in a folder that are looked at.
const EXTENSIONS: [&str; 3] = ["pth", "pt", "whl"];

/// A part that was found.
#[derive(Clone, Debug)]
pub struct FoundPart {
    /// The part.
    pub part: Part,
    /// The file, and the entry in it if it is a wheel.
    pub origin: String,
    /// SHA-256 of the file or the entry.
    pub sha256: String,
    /// Whether it is the published file.
    pub is_published: bool,
    /// By our names, in single precision.
    tensors: BTreeMap<String, TensorData>,
}

/// A file of weights.
#[derive(Clone, Debug)]
pub struct Weights {
    /// Its name.
    pub name: String,
    /// Its content.
    pub bytes: Vec<u8>,
    /// SHA-256 of the content.
    pub sha256: String,
}

/// The parts that were found, and what was left out.
#[derive(Clone, Debug, Default)]
pub struct Collection {
    parts: BTreeMap<Part, FoundPart>,
    /// What was not used, and why, one sentence each.
    pub unused: Vec<String>,
}

impl Collection {
    /// The parts in `paths`: files of PyTorch, wheels of the package lpips, or folders with such files. Of two files
    /// with the same part, the published one is used, and otherwise the first one.
    ///
    /// # Errors
    /// If a path does not exist, or a file that was named by itself cannot be used. In a folder, such a file is left
    /// out, and [`Collection::unused`] says so.
    pub fn gather(paths: &[PathBuf]) -> Result<Self, ModelError> {
        let mut collection = Self::default();
        for path in paths {
            let refused = |reason| ModelError::File { action: "use", path: path.clone(), reason };
            if path.is_dir() {
                for file in files_in(path).map_err(|error| refused(error.to_string()))? {
                    match parts_of(&file) {
                        Ok(parts) => parts.into_iter().for_each(|part| collection.add(part)),
                        Err(reason) => collection.unused.push(format!("{}: {reason}", file.display())),
                    }
                }
            } else {
                parts_of(path).map_err(refused)?.into_iter().for_each(|part| collection.add(part));
            }
        }
        Ok(collection)
    }

    /// A part, if it was found.
    pub fn part(&self, part: Part) -> Option<&FoundPart> {
        self.parts.get(&part)
    }

    /// The weights of a network; `None` if a part of them is missing.
    ///
    /// # Errors
    /// If they cannot be serialised.
    pub fn weights(&self, backbone: Backbone) -> Result<Option<Weights>, ModelError> {
        let kinds = [PartKind::Convolutions, PartKind::Linear];
        let parts: Option<Vec<&FoundPart>> =
            kinds.iter().map(|&kind| self.parts.get(&Part { backbone, kind })).collect();
        let Some(parts) = parts else { return Ok(None) };
        let name = format!("lpips_{}_f32.safetensors", backbone.name());
        let refused = |error: safetensors::SafeTensorError| ModelError::File {
            action: "write",
            path: PathBuf::from(&name),
            reason: error.to_string(),
        };
        let tensors: BTreeMap<&String, (Vec<usize>, Vec<u8>)> = parts
            .iter()
            .flat_map(|part| &part.tensors)
            .map(|(name, data)| {
                let bytes = data.iter::<f32>().flat_map(f32::to_le_bytes).collect();
                (name, (data.shape().to_vec(), bytes))
            })
            .collect();
        let views = tensors.iter().map(|(name, (shape, bytes))| {
            TensorView::new(Dtype::F32, shape.clone(), bytes).map(|view| (name.as_str(), view))
        });
        let views = views.collect::<Result<Vec<_>, _>>().map_err(refused)?;
        let bytes = safetensors::serialize(views, None).map_err(refused)?;
        Ok(Some(Weights { sha256: sha256(&bytes), name, bytes }))
    }

    fn add(&mut self, found: FoundPart) {
        let Some(other) = self.parts.get(&found.part) else {
            self.parts.insert(found.part, found);
            return;
        };
        let takes_over = found.is_published && !other.is_published;
        let (used, unused) = if takes_over { (&found, other) } else { (other, &found) };
        if used.tensors != unused.tensors {
            self.unused.push(format!("{}: {} come from {}", unused.origin, found.part.words(), used.origin));
        }
        if takes_over {
            self.parts.insert(found.part, found);
        }
    }
}

/// The files of a folder that may contain a part, in alphabetical order.
fn files_in(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for place in SUBFOLDERS.map(|place| folder.join(place)) {
        if place != folder && !place.is_dir() {
            continue;
        }
        for entry in fs::read_dir(&place)? {
            let path = entry?.path();
            let extension = path.extension().map(|extension| extension.to_string_lossy().to_lowercase());
            if extension.is_some_and(|extension| EXTENSIONS.contains(&extension.as_str())) && path.is_file() {
                files.push(path);
            }
        }
    }
    files.sort();
    Ok(files)
}

/// The parts in a file or a wheel.
fn parts_of(path: &Path) -> Result<Vec<FoundPart>, String> {
    let origin = path.display().to_string();
    match path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("whl")) {
        true => parts_of_wheel(path, &origin),
        false => Ok(vec![part_of(path, origin)?]),
    }
}

/// The part in a file of PyTorch.
fn part_of(path: &Path, origin: String) -> Result<FoundPart, String> {
    let file = TorchFile::open(path)?;
    let part = file.part()?;
    if is_outdated(&file.sha256) {
        return Err("these are the linear layers of LPIPS v0.0; those in the folder v0.1 beside it are needed".into());
    }
    let read = |names: TensorNames| {
        let data = file.numbers(&names)?;
        let wrong = |what: &str| Err(format!("`{}` is not {what} everywhere", names.published));
        if data.iter::<f32>().any(|value| !value.is_finite()) {
            return wrong("finite");
        }
        // Distances are weighted sums of squares. LPIPS clamps its weights in training.
        if part.kind == PartKind::Linear && data.iter::<f32>().any(|value| value < 0.0) {
            return wrong("zero or positive");
        }
        Ok((names.own, data))
    };
    let tensors = part.tensors().into_iter().map(read).collect::<Result<_, _>>()?;
    let is_published = is_published(part, &file.sha256);
    Ok(FoundPart { part, origin, sha256: file.sha256, is_published, tensors })
}

/// The linear layers in a wheel of the package lpips.
fn parts_of_wheel(path: &Path, origin: &str) -> Result<Vec<FoundPart>, String> {
    let damaged = |error: &dyn std::fmt::Display| format!("it is damaged, or no wheel ({error})");
    let file = open_file(path).map_err(|error| error.to_string())?;
    let mut archive = ZipArchive::new(io::BufReader::new(file)).map_err(|error| damaged(&error))?;
    let mut parts = Vec::new();
    for name in Backbone::ALL.map(|backbone| format!("{IN_WHEEL}{}.pth", backbone.name())) {
        let Ok(entry) = archive.by_name(&name) else { continue };
        let mut bytes = Vec::new();
        let length = entry.take(MOST_OF_ENTRY + 1).read_to_end(&mut bytes).map_err(|error| damaged(&error))?;
        if length as u64 > MOST_OF_ENTRY {
            return Err(format!("its entry {name} is larger than {MOST_OF_ENTRY} bytes"));
        }
        // The reader of pickles takes files.
        let mut copy = NamedTempFile::new().map_err(|error| error.to_string())?;
        copy.write_all(&bytes).map_err(|error| error.to_string())?;
        let part = part_of(copy.path(), format!("{origin}: {name}")).map_err(|reason| format!("{name}: {reason}"))?;
        parts.push(part);
    }
    if parts.is_empty() {
        return Err(format!("it has no {IN_WHEEL}alex.pth or vgg.pth, as the wheel of the package lpips has"));
    }
    Ok(parts)
}
