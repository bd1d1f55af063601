//! A file of the oracles: named arrays, and which of them a check has looked at.

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::{BufReader, Cursor, Read, Seek};
use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use burn::tensor::{DType, Device, Tensor};
use mvfusion_tests::{Array, tensor};
use npyz::{NpyFile, Order};

/// The arrays of an `.npz` file, all widened to double precision, which every type in the oracles fits into exactly.
#[derive(Debug, Default)]
pub struct Archive {
    name: String,
    arrays: BTreeMap<String, Array>,
    seen: RefCell<BTreeSet<String>>,
}

impl Archive {
    /// Reads a whole file.
    pub fn open(path: &Path) -> Result<Self> {
        let file = File::open(path).with_context(|| format!("cannot open {}", path.display()))?;
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        Self::read(name, BufReader::new(file)).with_context(|| path.display().to_string())
    }

    /// Reads a file that is part of this program.
    pub fn embedded(name: &str, bytes: &'static [u8]) -> Result<Self> {
        Self::read(name.to_owned(), Cursor::new(bytes))
    }

    fn read(name: String, reader: impl Read + Seek) -> Result<Self> {
        let mut zip = zip::ZipArchive::new(reader)?;
        let mut arrays = BTreeMap::new();
        for index in 0..zip.len() {
            let entry = zip.by_index(index)?;
            let name = entry.name()?.trim_end_matches(".npy").to_owned();
            let array = NpyFile::new(entry).map_err(Into::into).and_then(numbers_of);
            arrays.insert(name.clone(), array.with_context(|| format!("`{name}`"))?);
        }
        Ok(Self { name, arrays, seen: RefCell::default() })
    }

    /// The arrays `in.<part>.*` and `out.<part>.*` as a file of its own, under names without the part.
    pub fn part(&self, part: &str) -> Self {
        let shorter = |name: &str| {
            ["in.", "out."].iter().find_map(|side| {
                let rest = name.strip_prefix(side)?.strip_prefix(part)?.strip_prefix('.')?;
                Some(format!("{side}{rest}"))
            })
        };
        let arrays = self.arrays.iter().filter_map(|(name, array)| Some((shorter(name)?, array.clone())));
        Self { name: part.to_owned(), arrays: arrays.collect(), seen: RefCell::default() }
    }

    /// The file's name without its extension.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Whether there is such an array.
    pub fn has(&self, name: &str) -> bool {
        self.arrays.contains_key(name)
    }

    /// All names, in order.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.arrays.keys().map(String::as_str)
    }

    /// An array, or `None` if the file has none of this name.
    pub fn find(&self, name: &str) -> Option<&Array> {
        let array = self.arrays.get(name)?;
        self.seen.borrow_mut().insert(name.to_owned());
        Some(array)
    }

    /// An array.
    pub fn array(&self, name: &str) -> Result<&Array> {
        self.find(name).with_context(|| format!("the file has no `{name}`"))
    }

    /// A single number.
    pub fn number(&self, name: &str) -> Result<f64> {
        match self.array(name)?.values[..] {
            [number] => Ok(number),
            _ => bail!("`{name}` is not a single number"),
        }
    }

    /// A single count.
    pub fn count(&self, name: &str) -> Result<usize> {
        Ok(self.number(name)? as usize)
    }

    /// Indices or counts.
    pub fn counts(&self, name: &str) -> Result<Vec<usize>> {
        let values = &self.array(name)?.values;
        ensure!(values.iter().all(|v| v.fract() == 0.0 && *v >= 0.0), "`{name}` holds no counts");
        Ok(values.iter().map(|&v| v as usize).collect())
    }

    /// Flags.
    pub fn flags(&self, name: &str) -> Result<Vec<bool>> {
        Ok(self.array(name)?.values.iter().map(|&v| v != 0.0).collect())
    }

    /// An input as a single-precision tensor; the inputs of the oracles are single precision.
    pub fn tensor<const D: usize>(&self, name: &str, device: &Device) -> Result<Tensor<D>> {
        let array = self.array(name)?;
        let shape: [usize; D] = array
            .shape
            .as_slice()
            .try_into()
            .ok()
            .with_context(|| format!("`{name}` has shape {:?}, not {D} axes", array.shape))?;
        Ok(tensor(&array.values, shape, device, DType::F32))
    }

    /// The outputs that nobody asked for.
    pub fn unseen(&self, is_output: impl Fn(&str) -> bool) -> Vec<&str> {
        let seen = self.seen.borrow();
        self.names().filter(|name| is_output(name) && !seen.contains(*name)).collect()
    }
}

/// The numbers of an array of any type that the oracles use.
fn numbers_of(file: NpyFile<impl Read>) -> Result<Array> {
    let shape: Vec<usize> = file.shape().iter().map(|&length| length as usize).collect();
    let order = file.order();
    let values = values(file)?;
    let values = match order {
        Order::C => values,
        Order::Fortran => row_major(&values, &shape),
    };
    ensure!(values.len() == shape.iter().product::<usize>(), "it ends too early");
    Ok(Array { shape, values })
}

/// The numbers in the order of the file.
fn values(file: NpyFile<impl Read>) -> Result<Vec<f64>> {
    macro_rules! try_type {
        ($file:expr, $type:ty, $widen:expr) => {
            match $file.try_data::<$type>() {
                Ok(data) => return Ok(data.map(|value| value.map($widen)).collect::<Result<_, _>>()?),
                Err(file) => file,
            }
        };
    }
    let file = try_type!(file, f64, |v| v);
    let file = try_type!(file, f32, f64::from);
    let file = try_type!(file, i32, f64::from);
    let file = try_type!(file, u8, f64::from);
    let file = try_type!(file, bool, |v| if v { 1.0 } else { 0.0 });
    let file = try_type!(file, i64, |v| v as f64);
    bail!("its type {} is not known", file.dtype().descr())
}

/// Column-major numbers in row-major order.
fn row_major(values: &[f64], shape: &[usize]) -> Vec<f64> {
    let place = |flat: usize| {
        let mut rest = flat;
        let mut stride: usize = shape.iter().product();
        // The first axis is the fastest in the file and the slowest here.
        let mut source = 0;
        let mut source_stride = 1;
        for &length in shape {
            stride /= length;
            source += rest / stride * source_stride;
            rest %= stride;
            source_stride *= length;
        }
        source
    };
    (0..values.len()).map(|flat| values[place(flat)]).collect()
}
