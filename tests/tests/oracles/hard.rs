//! Hard inputs: values near 1, places far outside, invalid pixels, nothing at all.
//!
//! `hard.npz` has the grid and the losses, computed by `hard.py` beside it from the formulas of METHOD. The other cases
//! compare single precision on a backend with double precision on the first CPU backend ([`cases`]).

mod cases;
mod scenes;
mod splats;

use anyhow::{Result, ensure};
use libtest_mimic::Trial;
use mvfusion_tests::Backend;

use crate::archive::Archive;
use crate::kinds::Check;
use crate::{hexplane, losses};

/// The file; its format is told in `hard.py`.
const FILE: &[u8] = include_bytes!("../../oracles/hard.npz");

/// The cases of the file.
const CASES: [(&str, Check); 5] = [
    ("regularisers", hexplane::check_regularisers),
    ("hexplane", hexplane::check),
    ("loss_coarse", losses::check_geometry),
    ("loss_safe", losses::check_clamped_geometry),
    ("loss_fine", losses::check_deformation),
];

/// One trial a case.
pub fn trials(backend: Backend) -> Vec<Trial> {
    let of_file = CASES.iter().map(|&(name, check)| trial(backend, name, move || run(name, check, backend)));
    of_file.chain(cases::trials(backend)).chain(scenes::trials(backend)).collect()
}

fn trial(backend: Backend, name: &str, body: impl FnOnce() -> Result<()> + Send + 'static) -> Trial {
    Trial::test(format!("hard::{}::{name}", backend.name), move || body().map_err(|error| format!("{error:#}").into()))
}

fn run(name: &str, check: Check, backend: Backend) -> Result<()> {
    let archive = Archive::embedded("hard", FILE)?.part(name);
    check(&archive, &(backend.device)())?;
    let unseen = archive.unseen(|name| name.starts_with("out."));
    ensure!(unseen.is_empty(), "not looked at: {unseen:?}");
    Ok(())
}
