//! `mvfusion lpips-weights`: what it makes of good files, and what it says of bad ones.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

use clap::Parser;
use mvfusion_cli::args::Command;
use mvfusion_cli::{Cli, command, failure};
use mvfusion_model::evaluation::Backbone;
use mvfusion_tests::{TorchContainer, TorchTensors, pickled, text};
use safetensors::SafeTensors;
use tempfile::TempDir;

/// The convolutions of AlexNet, all of one number, or those of another network.
fn convolutions(backbone: Backbone, number: f32) -> TorchTensors {
    let layers = backbone.layout().into_iter().flat_map(|stage| stage.convolutions);
    let tensors = layers.flat_map(|layer| {
        let [inputs, outputs] = layer.channels;
        let weight = vec![outputs, inputs, layer.kernel, layer.kernel];
        [("weight", weight), ("bias", vec![outputs])].map(|(kind, shape)| {
            let count = shape.iter().product();
            (format!("features.{}.{kind}", layer.number), (shape, vec![number; count]))
        })
    });
    tensors.collect()
}

/// The linear layers of AlexNet, which begin with a number.
fn linear(first: f32) -> TorchTensors {
    let layer = |(number, channels): (usize, usize)| {
        let numbers = (0..channels).map(|i| if i == 0 { first } else { i as f32 }).collect();
        (format!("lin{number}.model.1.weight"), (vec![1, channels, 1, 1], numbers))
    };
    [64, 192, 384, 256, 256].into_iter().enumerate().map(layer).collect()
}

/// A folder with sound files: `network.pth` and `linear.pth`.
struct Place(TempDir);

impl Place {
    fn new() -> Self {
        let place = Self(tempfile::tempdir().expect("folder"));
        place.write("network.pth", &TorchContainer::Zip.save(&convolutions(Backbone::Alex, 0.5)).expect("saved"));
        place.write("linear.pth", &TorchContainer::Legacy.save(&linear(0.25)).expect("saved"));
        place
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn write(&self, name: &str, content: &[u8]) {
        fs::write(self.path(name), content).expect("written");
    }

    /// Runs the command with `--out out`.
    fn run(&self, from: &[&str], more: &[&str]) -> anyhow::Result<String> {
        let from = from.iter().map(|name| self.path(name).to_str().expect("text").to_owned());
        let out = self.path("out").to_str().expect("text").to_owned();
        let line = ["mvfusion", "lpips-weights", "--out", &out, "--from"].map(str::to_owned).into_iter();
        let line = line.chain(from).chain(more.iter().map(|&word| word.to_owned()));
        let Command::LpipsWeights(args) = Cli::try_parse_from(line)?.command else { panic!("the command") };
        let mut said = Vec::new();
        command::lpips_weights(&args, &mut said)?;
        Ok(String::from_utf8(said)?)
    }

    /// The error of these files, after which nothing was written.
    fn refusal(&self, from: &[&str]) -> String {
        let error = self.run(from, &[]).expect_err("refused");
        assert!(!self.path("out").exists(), "something was written");
        format!("{error:#}")
    }

    fn made(&self) -> Vec<u8> {
        fs::read(self.path("out").join("lpips_alex_f32.safetensors")).expect("made")
    }
}

/// A tensor of a file.
fn numbers(file: &[u8], name: &str) -> Vec<f32> {
    let file = SafeTensors::deserialize(file).expect("a file of tensors");
    let data = file.tensor(name).expect("the tensor").data();
    data.as_chunks::<4>().0.iter().map(|&bytes| f32::from_le_bytes(bytes)).collect()
}

#[test]
fn each_container_makes_the_same_file_and_what_is_missing_is_named() {
    let place = Place::new();
    let said = place.run(&["network.pth", "linear.pth"], &[]).expect("made");
    let made = place.made();
    assert_eq!(numbers(&made, "features.3.bias"), [0.5; 192]);
    assert_eq!(numbers(&made, "lin1.weight")[..3], [0.25, 1.0, 2.0]);
    assert_eq!(SafeTensors::deserialize(&made).expect("a file of tensors").len(), 15);
    for part in ["SHA-256", "missing; get https://download.pytorch.org/models/vgg16-397923af.pth", "pip download"] {
        assert!(said.contains(part), "{said}");
    }
    assert!(!said.contains("as published"), "{said}");
    for container in TorchContainer::ALL {
        place.write("network.pth", &container.save(&convolutions(Backbone::Alex, 0.5)).expect("saved"));
        // As a folder, with other files in it.
        place.write("a.pth", b"nonsense");
        place.run(&[""], &[]).unwrap_or_else(|error| panic!("{container:?}: {error:#}"));
        assert!(place.made() == made, "{container:?}");
    }
}

#[test]
fn other_weights_are_replaced_only_on_request() {
    let place = Place::new();
    place.run(&["network.pth", "linear.pth"], &[]).expect("made");
    place.run(&["network.pth", "linear.pth"], &[]).expect("the same again");
    let before = place.made();
    place.write("linear.pth", &TorchContainer::Zip.save(&linear(0.75)).expect("saved"));
    let error = place.run(&["network.pth", "linear.pth"], &[]).expect_err("refused");
    assert_eq!(failure::exit_code(&error), failure::USAGE);
    assert!(error.to_string().contains("--force") && place.made() == before, "{error}");
    place.run(&["network.pth", "linear.pth"], &["--force"]).expect("replaced");
    assert_eq!(numbers(&place.made(), "lin0.weight")[0], 0.75);
}

#[test]
fn bad_files_are_refused_with_the_reason_before_anything_is_written() {
    let place = Place::new();
    let sound = fs::read(place.path("network.pth")).expect("read");
    let refusal = |name: &str, content: &[u8]| {
        place.write(name, content);
        let said = place.refusal(&[name, "linear.pth"]);
        assert!(said.contains(name), "{said}");
        said
    };
    for container in TorchContainer::ALL {
        let whole = container.save(&convolutions(Backbone::Alex, 0.5)).expect("saved");
        for length in [0, 10, 700, whole.len() / 2, whole.len() - 1000] {
            let said = refusal("cut.pth", &whole[..length]);
            assert!(said.contains("damaged"), "{container:?}, {length} bytes: {said}");
        }
        let broken = convolutions(Backbone::Alex, f32::NAN);
        assert!(refusal("nan.pth", &container.save(&broken).expect("saved")).contains("not finite everywhere"));
        let negative = container.save(&linear(-0.25)).expect("saved");
        place.write("negative.pth", &negative);
        let said = place.refusal(&["network.pth", "negative.pth"]);
        assert!(said.contains("`lin0.model.1.weight` is not zero or positive"), "{said}");
    }
    // A bit that the archive's sum finds.
    let mut flipped = sound.clone();
    let middle = flipped.len() / 2;
    flipped[middle] ^= 1;
    assert!(refusal("flipped.pth", &flipped).contains("damaged"));
    let mut other = convolutions(Backbone::Alex, 0.5);
    other.insert("features.10.weight".into(), (vec![256, 256, 1, 1], vec![0.5; 256 * 256]));
    let said = refusal("other.pth", &TorchContainer::Zip.save(&other).expect("saved"));
    assert!(said.contains("`features.10.weight` has the shape [256, 256, 1, 1] and should have"), "{said}");
    let unrelated = TorchTensors::from([("fc.weight".to_owned(), (vec![2], vec![1.0; 2]))]);
    let said = refusal("unrelated.pth", &TorchContainer::Zip.save(&unrelated).expect("saved"));
    assert!(said.contains("no tensors of AlexNet"), "{said}");
    assert!(place.refusal(&["absent.pth"]).contains("absent.pth"));
    let said = place.refusal(&["linear.pth"]);
    assert!(said.contains("no network is complete") && said.contains("alexnet-owt-7be5be79.pth"), "{said}");
}

#[test]
fn a_pickle_with_code_is_refused_and_not_run() {
    let place = Place::new();
    let proof = place.path("proof");
    let command = format!("touch {}", proof.display());
    let call = [b"cposix\nsystem\n(".as_slice(), &text(&command), b"tR"].concat();
    let entry = [text("more"), call.clone()].concat();
    for container in TorchContainer::ALL {
        let content = container.save_with(&convolutions(Backbone::Alex, 0.5), &entry).expect("saved");
        place.write("evil.pth", &content);
        let said = place.refusal(&["evil.pth", "linear.pth"]);
        assert!(said.contains("`posix.system`") && said.contains("Nothing in it was run"), "{container:?}: {said}");
    }
    // As Python's own module writes it.
    place.write("evil.pth", &pickled(&call));
    assert!(place.refusal(&["evil.pth", "linear.pth"]).contains("`posix.system`"));
    assert!(!proof.exists());
}

#[test]
fn a_wheel_has_its_own_folder_of_layers() {
    let place = Place::new();
    let wheel = |name: &str, entries: &[(&str, &[u8])]| {
        let mut archive = zip::ZipWriter::new(fs::File::create(place.path(name)).expect("created"));
        for (entry, content) in entries {
            archive.start_file(*entry, zip::write::SimpleFileOptions::default()).expect("an entry");
            archive.write_all(content).expect("written");
        }
        archive.finish().expect("an archive");
    };
    let layers = |first| TorchContainer::Legacy.save(&linear(first)).expect("saved");
    let entries: [(&str, &[u8]); 2] =
        [("lpips/weights/v0.0/alex.pth", &layers(7.0)), ("lpips/weights/v0.1/alex.pth", &layers(0.125))];
    wheel("lpips.whl", &entries);
    let said = place.run(&["network.pth", "lpips.whl"], &[]).expect("made");
    assert!(said.contains("lpips.whl: lpips/weights/v0.1/alex.pth"), "{said}");
    assert_eq!(numbers(&place.made(), "lin0.weight")[0], 0.125);
    fs::remove_dir_all(place.path("out")).expect("removed");
    wheel("numpy.whl", &[("numpy/__init__.py", b"")]);
    assert!(place.refusal(&["network.pth", "numpy.whl"]).contains("as the wheel of the package lpips has"));
    // Zeros that unpack to more than any layer.
    wheel("large.whl", &[("lpips/weights/v0.1/alex.pth", &vec![0; 3 << 20])]);
    assert!(place.refusal(&["network.pth", "large.whl"]).contains("is larger than"));
    place.write("broken.whl", b"PK");
    assert!(place.refusal(&["network.pth", "broken.whl"]).contains("no wheel"));
}

#[test]
fn holes_of_an_archive_do_not_fill_the_memory() {
    let place = Place::new();
    let mut header = tar::Header::new_gnu();
    header.set_entry_type(tar::EntryType::GNUSparse);
    header.set_path("storages").expect("a name");
    header.set_size(0);
    let sparse = header.as_gnu_mut().expect("of GNU");
    // Terabytes of nothing.
    sparse.realsize.copy_from_slice(b"\x80\0\0\0\0\0\x7f\0\0\0\0\0");
    sparse.sparse[0].offset.copy_from_slice(b"\x80\0\0\0\0\0\x7f\0\0\0\0\0");
    sparse.sparse[0].numbytes.copy_from_slice(b"00000000000\0");
    header.set_cksum();
    let mut archive = tar::Builder::new(Vec::new());
    archive.append(&header, std::io::empty()).expect("added");
    place.write("sparse.pth", &archive.into_inner().expect("an archive"));
    let said = place.refusal(&["sparse.pth", "linear.pth"]);
    assert!(said.contains("larger than the file"), "{said}");
}

#[test]
fn no_folder_is_written_where_a_file_is() {
    let place = Place::new();
    place.write("out", b"");
    let error = place.run(&["network.pth", "linear.pth"], &[]).expect_err("refused");
    assert!(format!("{error:#}").contains("cannot create the folder"), "{error:#}");
    assert!(Path::new(&place.path("out")).is_file());
}
