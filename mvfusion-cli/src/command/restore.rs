//! `mvfusion restore`.

use std::io::Write;

use anyhow::bail;

use crate::args::RestoreArgs;
use crate::run::{self, RunFolder};

/// Brings a replaced run back in place of the run that was to replace it.
///
/// # Errors
/// If none waits, another process writes to the folder, or the unfinished run can be continued and `--force` is absent.
pub fn restore(args: &RestoreArgs, out: &mut dyn Write) -> anyhow::Result<()> {
    let folder = RunFolder::continued(&args.run)?;
    let path = args.run.display();
    // A kill may have left nothing to decide: locking the folder has put back what was on its way.
    if !run::waits(&args.run) {
        match run::is_finished(&args.run) {
            true => return Ok(writeln!(out, "The run in {path} is finished, and no other one waits there.")?),
            false => bail!("no replaced run waits in {path}."),
        }
    }
    if !args.force && !run::checkpoints(&args.run)?.is_empty() {
        bail!(
            "{path} contains an unfinished run with a checkpoint. Continue it with `mvfusion train --resume {path}`, or \
             use --force to remove it and bring the replaced run back."
        );
    }
    folder.restore()?;
    Ok(writeln!(out, "The replaced run is back in {path}.")?)
}
