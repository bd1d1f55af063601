//! Files of PyTorch, out of which weights of LPIPS are made.

use std::fs;
use std::io::{Cursor, Write};
use std::path::Path;

use mvfusion_model::evaluation::lpips_conversion::{Collection, Part};
use mvfusion_tests::{TorchContainer, TorchTensors};

use super::{Answer, Room, Target, Targets, answer_of};
use crate::mutation::Kind;

/// The readers of this file.
pub const READERS: &[(&str, Targets)] = &[("torch", files)];

/// The file once per container, its pickle, and buffers of its hash.
const WEIGHTS: Room = Room { times: 40, fixed: 4 << 20 };

/// The linear layers of AlexNet, which are small.
fn linear() -> TorchTensors {
    let layer = |(number, channels): (usize, usize)| {
        let numbers = (0..channels).map(|i| i as f32 / 64.0).collect();
        (format!("lin{number}.model.1.weight"), (vec![1, channels, 1, 1], numbers))
    };
    [64, 192, 384, 256, 256].into_iter().enumerate().map(layer).collect()
}

fn files(place: &Path) -> Vec<Target> {
    let mut targets: Vec<Target> = TorchContainer::ALL
        .into_iter()
        .map(|container| {
            let content = container.save(&linear()).expect("an archive");
            target(place, &format!("{container:?}.pth"), &content)
        })
        .collect();
    let mut wheel = zip::ZipWriter::new(Cursor::new(Vec::new()));
    wheel.start_file("lpips/weights/v0.1/alex.pth", zip::write::SimpleFileOptions::default()).expect("an entry");
    wheel.write_all(&TorchContainer::Legacy.save(&linear()).expect("a file")).expect("written");
    targets.push(target(place, "lpips.whl", &wheel.finish().expect("an archive").into_inner()));
    targets
}

fn target(place: &Path, name: &str, content: &[u8]) -> Target {
    let file = place.join(name);
    fs::write(&file, content).expect("written");
    let paths = [file.clone()];
    let read = move || -> Answer {
        answer_of(Collection::gather(&paths), |collection| {
            // Of an archive's table, which may be damaged, nothing but the layers of AlexNet can come.
            let found = Part::ALL.into_iter().filter(|&part| collection.part(part).is_some()).count();
            if found == 1 { Ok(()) } else { Err(format!("{found} parts were found in one file")) }
        })
    };
    assert_eq!(read(), Ok(Ok(())), "a sound {name}");
    Target { file, kind: Kind::Plain, room: WEIGHTS, others: 0, read: Box::new(read) }
}
