//! The files of a run.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use clap::Parser;
use mvfusion_cli::args::Command;
use mvfusion_cli::progress::Verbosity;
use mvfusion_cli::run::{self, MetricsLog, PerView, Results, RunRecord};
use mvfusion_cli::{Cli, command, config, report};
use mvfusion_data::Layout;
use mvfusion_tests::SMALL_MODEL;

use super::scenes::write_scene;
use super::{RECORDS, Room, Target, Targets, answer, answer_of};
use crate::mutation::Kind;

/// The readers of this file.
pub const READERS: &[(&str, Targets)] = &[
    ("config", |place| {
        one(place, run::CONFIG, Kind::Toml, |file| {
            let read = || -> anyhow::Result<String> {
                let config = config::read(file)?;
                config.check()?;
                config::to_toml(&config)
            };
            answer(read())
        })
    }),
    ("record", |place| one(place, run::RECORD, Kind::Json, |file| answer(run::read_json::<RunRecord>(file)))),
    ("results", |place| {
        one(place, run::RESULTS, Kind::Json, |file| {
            // What a command does with them: compares them, and lists them.
            answer(run::read_json::<Results>(file).map(|results| (results.differences(&results), results.metrics())))
        })
    }),
    ("per_view", |place| one(place, run::PER_VIEW, Kind::Json, |file| answer(run::read_json::<PerView>(file)))),
    ("metrics", |place| {
        one(place, run::METRICS, Kind::JsonLines, |file| {
            answer_of(MetricsLog::resume(file, 4), |(_, elapsed)| match elapsed.is_finite() {
                true => Ok(()),
                false => Err(format!("{elapsed} seconds of training")),
            })
        })
    }),
    ("report", reports),
];

/// The memory of a report: a page with all images, which are decoded and coded again.
const REPORT: Room = Room { times: 64, fixed: 3 << 29 };

/// Settings of a run of a few seconds that still passes through all stages.
const TINY: [&str; 3] =
    ["train.stages={geometry=2, deformation=2, refinement=2}", "train.log_interval=1", "eval.strips=1"];

/// A finished run, the same one for all readers.
pub fn finished(place: &Path) -> &'static Path {
    static RUN: OnceLock<PathBuf> = OnceLock::new();
    RUN.get_or_init(|| {
        let ground = place.parent().expect("a folder for all readers");
        let (scene, run) = (ground.join("scene"), ground.join("run"));
        write_scene(Layout::Neu3d, &scene, (32, 24));
        let paths = ["--data".as_ref(), scene.as_os_str(), "--out".as_ref(), run.as_os_str()];
        let settings = TINY.iter().chain(&SMALL_MODEL).flat_map(|setting| ["--set", setting]);
        let words = ["mvfusion", "train", "--quiet"].into_iter().chain(settings).map(AsRef::as_ref);
        let cli = Cli::try_parse_from(words.chain(paths)).expect("a command line");
        let Command::Train(args) = cli.command else { panic!("the command is `train`") };
        command::train(&args, Verbosity::SILENT, &mut Vec::new()).expect("trained");
        run
    })
}

/// A file of the run.
fn one(place: &Path, name: &str, kind: Kind, read: fn(&Path) -> super::Answer) -> Vec<Target> {
    let file = finished(place).join(name);
    assert_eq!(read(&file), Ok(Ok(())), "a sound file");
    let path = file.clone();
    vec![Target { file, kind, room: RECORDS, others: 0, read: Box::new(move || read(&path)) }]
}

/// The report, which is made whatever the files hold.
fn reports(place: &Path) -> Vec<Target> {
    let run = finished(place);
    let is_strip = |path: &PathBuf| path.extension().is_some_and(|extension| extension == "png");
    let mut strips =
        std::fs::read_dir(run.join(run::STRIPS)).expect("listed").map(|entry| entry.expect("listed").path());
    let strip = strips.find(is_strip).expect("a strip");
    let files = [
        (run.join(run::CONFIG), Kind::Toml),
        (run.join(run::RECORD), Kind::Json),
        (run.join(run::RESULTS), Kind::Json),
        (run.join(run::PER_VIEW), Kind::Json),
        (run.join(run::SCENE), Kind::Json),
        (run.join(run::STRIPS).join(run::PANELS), Kind::Json),
        (run.join(run::METRICS), Kind::JsonLines),
        (strip, Kind::Png),
    ];
    let others = super::bytes_below(run);
    let target =
        |(file, kind)| Target { file, kind, room: REPORT, others, read: Box::new(move || answer(report::html(run))) };
    files.into_iter().map(target).collect()
}
