//! A file of PyTorch that is not trusted: only its tensors are read, and nothing in it is run.

use std::collections::HashMap;
use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::Path;

use burn::tensor::{DType, TensorData};
use mvfusion_data::files::open_file;
use pytorch_reader::{DType as TorchType, PickleValue, PytorchReader, Tensor};
use sha2::{Digest, Sha256};

use super::part::{Part, TensorNames};
use crate::files::hexadecimal;

/// Larger files are not read. torchvision's VGG-16 has 553 MB.
const MOST_BYTES: u64 = 1 << 30;

/// Where the magic of a tar archive is, and the magic.
const TAR_MAGIC: (usize, &[u8]) = (257, b"ustar");

/// What a reader of pickles calls a tensor.
const TENSOR: &str = "torch.Tensor";

/// A file of PyTorch, with tensors that are not read yet.
pub(super) struct TorchFile {
    /// SHA-256 of the file.
    pub sha256: String,
    tensors: HashMap<String, Tensor>,
}

impl TorchFile {
    /// Opens a file in any of the containers of `torch.save`.
    ///
    /// # Errors
    /// The reason why it cannot be used.
    pub fn open(path: &Path) -> Result<Self, String> {
        let said = |error: io::Error| error.to_string();
        let mut file = open_file(path).map_err(said)?;
        let length = file.metadata().map_err(said)?.len();
        if length > MOST_BYTES {
            return Err(format!("it has {length} bytes, and such files have at most {MOST_BYTES}"));
        }
        let (head, sha256) = hashed(&mut file).map_err(said)?;
        let (place, magic) = TAR_MAGIC;
        if head.get(place..place + magic.len()) == Some(magic) {
            refuse_holes(path, length)?;
        }
        let damaged = |error: pytorch_reader::PytorchError| {
            format!("it is damaged, or no file of PyTorch ({})", error.to_string().trim_end_matches('.'))
        };
        // A state dictionary consists of tensors and their names. What else a pickle may ask for is a call.
        let values = PytorchReader::read_pickle_data(path, None).map_err(damaged)?;
        if let Some(name) = call_in(&values) {
            return Err(format!(
                "it asks for `{name}` to be called or loaded, and files of weights hold tensors alone. Nothing in it \
                 was run"
            ));
        }
        let tensors = PytorchReader::new(path).map_err(damaged)?.into_tensors();
        Ok(Self { sha256, tensors })
    }

    /// The part that the file contains.
    ///
    /// # Errors
    /// Why it contains none.
    pub fn part(&self) -> Result<Part, String> {
        let misfits = Part::ALL.map(|part| (part, self.misfits(part)));
        if let Some((part, _)) = misfits.iter().find(|(_, misfits)| misfits.is_empty()) {
            return Ok(*part);
        }
        // The part that comes closest.
        let closest = misfits.iter().filter(|(part, misfits)| misfits.len() < part.tensors().len());
        let closest = closest.min_by_key(|(part, misfits)| misfits.len() * 100 / part.tensors().len());
        Err(match closest {
            Some((part, misfits)) => format!("it is not {}: {}", part.words(), misfits[0]),
            None => "it holds no tensors of AlexNet, of VGG-16, or of the linear layers of LPIPS".to_owned(),
        })
    }

    /// What is wrong with the tensors of a part.
    fn misfits(&self, part: Part) -> Vec<String> {
        let misfit = |TensorNames { published, shape, .. }: TensorNames| match self.tensors.get(&published) {
            None => Some(format!("`{published}` is missing")),
            Some(tensor) if tensor.shape() != shape => {
                Some(format!("`{published}` has the shape {:?} and should have {shape:?}", tensor.shape()))
            }
            Some(tensor) if float(tensor.dtype()).is_none() => {
                Some(format!("`{published}` holds {:?} and should hold floats", tensor.dtype()))
            }
            Some(_) => None,
        };
        part.tensors().into_iter().filter_map(misfit).collect()
    }

    /// A tensor of a known shape, in single precision.
    ///
    /// # Errors
    /// Why it cannot be read.
    pub fn numbers(&self, names: &TensorNames) -> Result<TensorData, String> {
        let name = &names.published;
        let tensor = self.tensors.get(name).ok_or_else(|| format!("`{name}` is missing"))?;
        let dtype = float(tensor.dtype()).ok_or_else(|| format!("`{name}` does not hold floats"))?;
        let bytes = tensor.read().map_err(|error| format!("it is damaged ({error})"))?;
        Ok(TensorData::from_bytes_vec(bytes, names.shape.clone(), dtype).convert_dtype(DType::F32))
    }
}

/// The first bytes of a file, and its SHA-256.
fn hashed(file: &mut File) -> io::Result<(Vec<u8>, String)> {
    let mut hash = Sha256::new();
    let (mut head, mut buffer) = (Vec::new(), vec![0; 1 << 20]);
    loop {
        match file.read(&mut buffer) {
            Ok(0) => return Ok((head, hexadecimal(hash))),
            Ok(count) => {
                if head.is_empty() {
                    head = buffer[..count.min(512)].to_vec();
                }
                hash.update(&buffer[..count]);
            }
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
}

/// Refuses an archive with an entry that is larger than the archive: tar stores holes, which would fill the memory.
fn refuse_holes(path: &Path, length: u64) -> Result<(), String> {
    let damaged = |error: io::Error| format!("it is damaged ({error})");
    let mut archive = tar::Archive::new(BufReader::new(open_file(path).map_err(damaged)?));
    for entry in archive.entries().map_err(damaged)? {
        if entry.map_err(damaged)?.size() > length {
            return Err("it is damaged (an entry is larger than the file)".to_owned());
        }
    }
    Ok(())
}

/// The name of something that is no data and no tensor.
fn call_in(value: &PickleValue) -> Option<&str> {
    match value {
        PickleValue::Unsupported(name) => (name != TENSOR).then_some(name),
        PickleValue::List(items) => items.iter().find_map(call_in),
        PickleValue::Dict(entries) => entries.values().find_map(call_in),
        _ => None,
    }
}

/// The type of floats; `None` for other numbers.
fn float(dtype: TorchType) -> Option<DType> {
    match dtype {
        TorchType::F64 => Some(DType::F64),
        TorchType::F32 => Some(DType::F32),
        TorchType::F16 => Some(DType::F16),
        TorchType::BF16 => Some(DType::BF16),
        _ => None,
    }
}
