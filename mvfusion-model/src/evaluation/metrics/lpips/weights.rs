//! LPIPS weights in files.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use burn::tensor::{DType, Device, TensorData};
use mvfusion_data::files::read_bytes;
use safetensors::tensor::{Dtype, SafeTensors, TensorView};

use super::layout::Backbone;
use super::network::Lpips;
use super::source::Source;
use crate::ModelError;

impl Backbone {
    /// Larger files are not read. The convolutions of VGG-16 have 59 MB in single precision.
    pub const MOST_BYTES: u64 = 1 << 28;

    /// The file with the network's weights in a folder: `lpips_<name>_f32.safetensors`, `lpips_<name>_f16.safetensors`
    /// or `lpips_<name>.safetensors`, whichever exists first.
    pub fn file_in(self, folder: &Path) -> Option<PathBuf> {
        let name = self.name();
        ["_f32", "_f16", ""]
            .iter()
            .map(|precision| folder.join(format!("lpips_{name}{precision}.safetensors")))
            .find(|path| path.is_file())
    }
}

impl Lpips {
    /// Loads a network with the weights of a file to `device`, in single precision.
    ///
    /// The file contains `features.<number>.weight` `[out, in, k, k]` and `features.<number>.bias` `[out]` with
    /// torchvision's layer numbers, and `lin<stage>.weight` `[1, C, 1, 1]`, as floats of 16, 32 or 64 bits. Other
    /// tensors are ignored.
    ///
    /// # Errors
    /// If the file cannot be read, or a tensor is missing, has another shape, or is not finite.
    pub fn load(backbone: Backbone, path: &Path, device: &Device) -> Result<Self, ModelError> {
        Self::build(&backbone.layout(), &mut WeightsFile::open(path, device)?)
    }
}

/// A weights file, converted to single precision.
struct WeightsFile<'a> {
    path: &'a Path,
    device: &'a Device,
    tensors: BTreeMap<String, TensorData>,
}

impl<'a> WeightsFile<'a> {
    fn open(path: &'a Path, device: &'a Device) -> Result<Self, ModelError> {
        let unreadable = |reason: String| ModelError::File { action: "read", path: path.to_owned(), reason };
        let bytes = read_bytes(path, Backbone::MOST_BYTES).map_err(|error| unreadable(error.to_string()))?;
        let file = SafeTensors::deserialize(&bytes).map_err(|error| unreadable(error.to_string()))?;
        let mut tensors = BTreeMap::new();
        for (name, view) in file.tensors() {
            // Tensors of other types are ignored.
            if let Some(data) = single(&view) {
                tensors.insert(name, data);
            }
        }
        Ok(Self { path, device, tensors })
    }
}

impl Source for WeightsFile<'_> {
    fn numbers(&mut self, name: &str, shape: &[usize]) -> Result<TensorData, ModelError> {
        let misfit = |found: String| ModelError::Weights {
            path: self.path.to_owned(),
            tensor: name.to_owned(),
            expected: shape.to_vec(),
            found,
        };
        let data = self.tensors.remove(name).ok_or_else(|| misfit("missing".to_owned()))?;
        if data.shape()[..] != *shape {
            return Err(misfit(format!("of shape {:?}", data.shape().to_vec())));
        }
        if data.iter::<f32>().any(|value| !value.is_finite()) {
            return Err(misfit("not finite everywhere".to_owned()));
        }
        Ok(data)
    }

    fn device(&self) -> &Device {
        self.device
    }
}

/// The values of a tensor in single precision; `None` if they are not floats.
fn single(view: &TensorView<'_>) -> Option<TensorData> {
    let dtype = match view.dtype() {
        Dtype::F32 => DType::F32,
        Dtype::F16 => DType::F16,
        Dtype::BF16 => DType::BF16,
        Dtype::F64 => DType::F64,
        _ => return None,
    };
    let data = TensorData::from_bytes_vec(view.data().to_vec(), view.shape().to_vec(), dtype);
    Some(data.convert_dtype(DType::F32))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_support::for_each_device;

    /// Writes a file with the AlexNet layout, modified by `change`, in which all values are `value`.
    fn write(path: &Path, value: f32, change: impl FnOnce(&mut BTreeMap<String, Vec<usize>>)) {
        let mut shapes = BTreeMap::new();
        for (number, stage) in Backbone::Alex.layout().iter().enumerate() {
            for layer in &stage.convolutions {
                let [inputs, outputs] = layer.channels;
                shapes.insert(
                    format!("features.{}.weight", layer.number),
                    vec![outputs, inputs, layer.kernel, layer.kernel],
                );
                shapes.insert(format!("features.{}.bias", layer.number), vec![outputs]);
                shapes.insert(format!("lin{number}.weight"), vec![1, outputs, 1, 1]);
            }
        }
        change(&mut shapes);
        let tensors: Vec<(String, Vec<usize>, Vec<u8>)> = shapes
            .into_iter()
            .map(|(name, shape)| {
                let bytes = value.to_le_bytes().repeat(shape.iter().product());
                (name, shape, bytes)
            })
            .collect();
        let views = tensors.iter().map(|(name, shape, bytes)| {
            (name.clone(), TensorView::new(Dtype::F32, shape.clone(), bytes).expect("numbers fill the shape"))
        });
        std::fs::write(path, safetensors::serialize(views, None).expect("serialised")).expect("written");
    }

    /// The error message of loading a file.
    fn complaint(path: &Path) -> String {
        let said = std::cell::RefCell::new(None);
        for_each_device(|device| {
            let result = Lpips::load(Backbone::Alex, path, &device);
            said.replace(Some(result.err().map_or(String::new(), |error| error.to_string())));
        });
        said.into_inner().expect("a device")
    }

    #[test]
    fn a_damaged_file_is_refused_with_file_tensor_and_both_shapes() {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("lpips_alex_f32.safetensors");
        assert!(complaint(&path).contains("lpips_alex_f32"), "a missing file");
        write(&path, 0.5, |_| ());
        assert_eq!(complaint(&path), "");
        write(&path, 0.5, |shapes| drop(shapes.insert("features.3.weight".into(), vec![192, 64, 3, 3])));
        let said = complaint(&path);
        for part in ["lpips_alex_f32", "features.3.weight", "[192, 64, 5, 5]", "[192, 64, 3, 3]"] {
            assert!(said.contains(part), "`{part}` is not in: {said}");
        }
        write(&path, 0.5, |shapes| drop(shapes.remove("lin4.weight")));
        let said = complaint(&path);
        assert!(said.contains("lin4.weight") && said.contains("missing"), "{said}");
        write(&path, f32::NAN, |_| ());
        assert!(complaint(&path).contains("not finite"), "{}", complaint(&path));
        std::fs::write(&path, b"nonsense").expect("written");
        assert!(complaint(&path).contains("lpips_alex_f32"), "{}", complaint(&path));
    }

    #[test]
    fn single_precision_goes_first() {
        let folder = tempfile::tempdir().expect("folder");
        assert_eq!(Backbone::Vgg.file_in(folder.path()), None);
        for (name, precision) in [("lpips_vgg_f16.safetensors", "f16"), ("lpips_vgg_f32.safetensors", "f32")] {
            std::fs::write(folder.path().join(name), b"").expect("written");
            let found = Backbone::Vgg.file_in(folder.path()).expect("there is one");
            assert!(found.to_string_lossy().contains(precision), "{found:?}");
        }
        assert_eq!(Backbone::Alex.file_in(folder.path()), None);
    }
}
