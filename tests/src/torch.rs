//! Files as `torch.save` writes them, in each of its three containers.
//!
//! The pickles have the opcodes of PyTorch's own files of protocol 2, without the memo, which readers need not use.

use std::collections::BTreeMap;
use std::io::{Cursor, Write};

use anyhow::Result;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

/// A container of `torch.save`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TorchContainer {
    /// A zip archive, since PyTorch 1.6.
    Zip,
    /// Pickles and numbers one behind the other, since PyTorch 0.1.10.
    Legacy,
    /// A tar archive, before that.
    Tar,
}

/// Tensors of single precision by name, each with its shape.
pub type TorchTensors = BTreeMap<String, (Vec<usize>, Vec<f32>)>;

/// The magic number of the legacy container, as a pickle.
const MAGIC: &[u8] = b"\x80\x02\x8a\x0al\xfc\x9cF\xf9 j\xa8P\x19.";

impl TorchContainer {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Zip, Self::Legacy, Self::Tar];

    /// A state dictionary in this container.
    ///
    /// # Errors
    /// If an archive cannot be written.
    pub fn save(self, tensors: &TorchTensors) -> Result<Vec<u8>> {
        self.save_with(tensors, b"")
    }

    /// The same with pickled entries `more` of the dictionary: a key, its value, and so on.
    ///
    /// # Errors
    /// As [`Self::save`].
    pub fn save_with(self, tensors: &TorchTensors, more: &[u8]) -> Result<Vec<u8>> {
        match self {
            Self::Zip => zipped(tensors, more),
            Self::Legacy => Ok(legacy(tensors, more)),
            Self::Tar => tarred(tensors, more),
        }
    }
}

fn zipped(tensors: &TorchTensors, more: &[u8]) -> Result<Vec<u8>> {
    let options = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    let mut add = |name: &str, bytes: &[u8]| -> Result<()> {
        archive.start_file(format!("archive/{name}"), options)?;
        Ok(archive.write_all(bytes)?)
    };
    add("data.pkl", &dictionary(tensors, more, |key, tensor| rebuilt(key, tensor, &[])))?;
    add("byteorder", b"little")?;
    for (key, (_, numbers)) in tensors.values().enumerate() {
        add(&format!("data/{key}"), &bytes(numbers))?;
    }
    add("version", b"3\n")?;
    Ok(archive.finish()?.into_inner())
}

fn legacy(tensors: &TorchTensors, more: &[u8]) -> Vec<u8> {
    let keys = (0..tensors.len()).flat_map(|key| text(&key.to_string())).collect::<Vec<_>>();
    // The place of a view of a storage.
    let none = b"N";
    let mut file = [
        MAGIC,
        &pickled(&integer(1001)),
        &system(),
        &dictionary(tensors, more, |key, tensor| rebuilt(key, tensor, none)),
        &pickled(&[b"](".as_slice(), &keys, b"e"].concat()),
    ]
    .concat();
    for (_, numbers) in tensors.values() {
        file.extend((numbers.len() as i64).to_le_bytes());
        file.extend(bytes(numbers));
    }
    file
}

fn tarred(tensors: &TorchTensors, more: &[u8]) -> Result<Vec<u8>> {
    let class = |name: &str| [b"ctorch\n", name.as_bytes(), b"\n"].concat();
    let mut storages = pickled(&integer(tensors.len()));
    let mut table = pickled(&integer(tensors.len()));
    for (key, (shape, numbers)) in tensors.values().enumerate() {
        let storage = [integer(1000 + key), text("cpu"), class("FloatStorage")].concat();
        storages.extend(pickled(&tuple(&storage)));
        storages.extend((numbers.len() as i64).to_le_bytes());
        storages.extend(bytes(numbers));
        let entry = [integer(key), integer(1000 + key), class("FloatTensor")].concat();
        table.extend(pickled(&tuple(&entry)));
        table.extend((shape.len() as i32).to_le_bytes());
        table.extend([0; 4]);
        for side in shape.iter().chain(&strides(shape)) {
            table.extend((*side as i64).to_le_bytes());
        }
        table.extend(0i64.to_le_bytes());
    }
    // Views of storages: none.
    storages.extend(pickled(b"]"));
    let named = |key: usize, _: &(Vec<usize>, Vec<f32>)| [text(&key.to_string()), b"Q".to_vec()].concat();
    let mut archive = tar::Builder::new(Vec::new());
    for (name, content) in [
        ("sys_info", system()),
        ("pickle", dictionary(tensors, more, named)),
        ("tensors", table),
        ("storages", storages),
    ] {
        let mut header = tar::Header::new_ustar();
        header.set_size(content.len() as u64);
        header.set_mode(0o600);
        archive.append_data(&mut header, name, content.as_slice())?;
    }
    Ok(archive.into_inner()?)
}

/// An ordered dictionary of tensors, with the attribute `_metadata` that state dictionaries have.
fn dictionary(
    tensors: &TorchTensors,
    more: &[u8],
    value: impl Fn(usize, &(Vec<usize>, Vec<f32>)) -> Vec<u8>,
) -> Vec<u8> {
    let ordered = b"ccollections\nOrderedDict\n)R";
    let entries =
        tensors.iter().enumerate().flat_map(|(key, (name, tensor))| [text(name), value(key, tensor)].concat());
    let entries: Vec<u8> = entries.collect();
    let metadata = [b"}".as_slice(), &text("_metadata"), ordered, b"sb"].concat();
    pickled(&[ordered.as_slice(), b"(", &entries, more, b"u", &metadata].concat())
}

/// A call that makes a tensor of a storage. `view` is a further field of the storage.
fn rebuilt(key: usize, (shape, numbers): &(Vec<usize>, Vec<f32>), view: &[u8]) -> Vec<u8> {
    let kind = b"ctorch\nFloatStorage\n";
    let storage =
        [&text("storage"), kind.as_slice(), &text(&key.to_string()), &text("cpu"), &integer(numbers.len()), view];
    let integers = |sides: &[usize]| tuple(&sides.iter().flat_map(|&side| integer(side)).collect::<Vec<_>>());
    let arguments = [
        &tuple(&storage.concat()),
        b"Q".as_slice(),
        &integer(0),
        &integers(shape),
        &integers(&strides(shape)),
        // No gradient, and no hooks.
        b"\x89ccollections\nOrderedDict\n)R",
    ];
    [b"ctorch._utils\n_rebuild_tensor_v2\n".as_slice(), &tuple(&arguments.concat()), b"R"].concat()
}

/// What both older containers say about the machine that wrote them.
fn system() -> Vec<u8> {
    pickled(&[b"}(".as_slice(), &text("protocol_version"), &integer(1001), &text("little_endian"), b"\x88u"].concat())
}

fn strides(shape: &[usize]) -> Vec<usize> {
    (1..=shape.len()).map(|after| shape[after..].iter().product()).collect()
}

fn bytes(numbers: &[f32]) -> Vec<u8> {
    numbers.iter().flat_map(|number| number.to_le_bytes()).collect()
}

/// A whole pickle of a value.
pub fn pickled(value: &[u8]) -> Vec<u8> {
    [b"\x80\x02", value, b"."].concat()
}

/// A pickled text.
pub fn text(text: &str) -> Vec<u8> {
    [b"X", &(text.len() as u32).to_le_bytes()[..], text.as_bytes()].concat()
}

fn integer(number: usize) -> Vec<u8> {
    [b"J", &(number as i32).to_le_bytes()[..]].concat()
}

fn tuple(items: &[u8]) -> Vec<u8> {
    [b"(", items, b"t"].concat()
}
