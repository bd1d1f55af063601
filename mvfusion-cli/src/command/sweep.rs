//! `mvfusion sweep`.

use std::collections::BTreeSet;
use std::io::Write;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use mvfusion_model::evaluation::Backbone;

use super::{json, sweep_status};
use crate::args::{Launcher, SweepAction, SweepArgs, SweepFolderArgs, SweepRunArgs};
use crate::clock::spoken;
use crate::failure::UsageError;
use crate::interrupt::path_for_shell;
use crate::progress::Verbosity;
use crate::sweep::{
    self, Additions, Cell, Estimate, Grid, Index, Local, Plan, SHIPPED, Slurm, Source, State, SweepFolder, table,
};
use crate::{device, lpips, threads};

/// Parent folder of the sweeps, unless `--out` is given.
const SWEEPS: &str = "runs/sweeps";

/// Threads of a cell on a cluster, unless `--threads` is given.
const CLUSTER_THREADS: usize = 4;

/// Runs a sweep, or reports its state.
///
/// # Errors
/// For an invalid grid, before anything runs. Later, if cells failed or the folder cannot be used.
pub fn sweep(args: &SweepArgs, verbosity: Verbosity, out: &mut dyn Write) -> anyhow::Result<()> {
    match &args.action {
        Some(SweepAction::Status(args)) => sweep_status::status(args, out),
        Some(SweepAction::Table(args)) => table_of(args, verbosity, out),
        Some(SweepAction::List) => list(out),
        Some(SweepAction::Show(args)) => show(&args.name, out),
        Some(SweepAction::RunCell(args)) => sweep::run_cell(args, verbosity, out),
        None => Session::new(&args.run, verbosity)?.run(out),
    }
}

fn table_of(args: &SweepFolderArgs, verbosity: Verbosity, out: &mut dyn Write) -> anyhow::Result<()> {
    let folder = SweepFolder::new(&args.folder)?;
    let index = Index::read(folder.path())?;
    if args.json {
        let outcomes = folder.outcomes(&index)?;
        table::write(&index, &outcomes, folder.path())?;
        verbosity.wrote("sweep", folder.path());
        return json::print(&table::Table::of(&index, &outcomes).json(), out);
    }
    write_table(&folder, &index, verbosity, out)
}

fn write_table(folder: &SweepFolder, index: &Index, verbosity: Verbosity, out: &mut dyn Write) -> anyhow::Result<()> {
    let outcomes = folder.outcomes(index)?;
    let written = table::write(index, &outcomes, folder.path())?;
    verbosity.wrote("sweep", folder.path());
    write!(out, "{}", table::Table::of(index, &outcomes).markdown())?;
    writeln!(out)?;
    written.iter().try_for_each(|path| writeln!(out, "written: {}", path.display()))?;
    Ok(())
}

fn list(out: &mut dyn Write) -> anyhow::Result<()> {
    for shipped in SHIPPED {
        let grid = Grid::read(Path::new(shipped.name))?.grid;
        writeln!(out, "{:24}{}", shipped.name, grid.title)?;
    }
    Ok(())
}

fn show(name: &str, out: &mut dyn Write) -> anyhow::Result<()> {
    match sweep::find_shipped(name) {
        Some(shipped) => Ok(write!(out, "{}", shipped.text)?),
        None => {
            let (meant, all) = (sweep::suggested_grid(name), sweep::shipped_names());
            Err(UsageError::new(format!("unknown grid `{name}`.{meant} The shipped grids are: {all}.")).into())
        }
    }
}

/// The setting of the LPIPS weights for all cells: none at all, or the folder that is found here.
fn lpips_weights(asked: Option<&Path>, verbosity: Verbosity) -> anyhow::Result<Option<PathBuf>> {
    if asked.is_some_and(lpips::is_none) {
        return Ok(asked.map(Path::to_owned));
    }
    let found = lpips::find(asked)?;
    if let Some(folder) = found.as_ref().filter(|_| asked.is_none()) {
        verbosity.note(&format!("lpips:  {folder}"));
    }
    Ok(found.map(|found| found.folder))
}

/// A sweep that is about to run.
struct Session<'a> {
    args: &'a SweepRunArgs,
    source: Source,
    plan: Plan,
    folder: SweepFolder,
    verbosity: Verbosity,
}

impl<'a> Session<'a> {
    /// Reads and checks everything. Writes nothing.
    fn new(args: &'a SweepRunArgs, verbosity: Verbosity) -> anyhow::Result<Self> {
        let grid = args.grid.as_deref().context("a grid is needed")?;
        let source = Grid::read(grid)?;
        let additions = Additions {
            data_root: args.data_root.clone(),
            lpips_weights: lpips_weights(args.lpips_weights.as_deref(), verbosity)?,
            set: args.set.clone(),
        };
        let mut plan = Plan::new(&source, &additions)?;
        // A missing device is reported here, once, and not by every cell. The nodes of a cluster have other devices.
        match args.launcher {
            Launcher::Local => device::check(&args.device)?,
            Launcher::Slurm => device::wants_gpu(&args.device).map(|_| ())?,
        }
        let out = args.out.clone().unwrap_or_else(|| PathBuf::from(SWEEPS).join(&source.name));
        let folder = SweepFolder::new(&out)?;
        plan.index.amendments = folder.amendments(&plan.index);
        let session = Self { args, source, plan, folder, verbosity };
        session.check_options()?;
        session.check_choice()?;
        session.check_weights()?;
        session.check_folders()?;
        session.folder.check(&session.source.text)?;
        Ok(session)
    }

    fn run(&self, out: &mut dyn Write) -> anyhow::Result<()> {
        let index = &self.plan.index;
        let to_do = self.to_do()?;
        if self.args.dry_run {
            return self.show(&to_do, out);
        }
        if self.folder.has_other_cells(index) {
            self.verbosity.note(&format!(
                "note:   {} has a sweep without any cell of this grid. Its table is replaced; its cells stay. Choose \
                 another --out to keep both",
                self.folder.path().display()
            ));
        }
        self.folder.prepare(&self.source.text, &self.plan)?;
        self.verbosity.wrote("sweep", self.folder.path());
        if let Some(sentence) = sweep::amendment_note(&index.amendments) {
            self.verbosity.note(&format!("note:   {}", sentence.trim_end_matches('.')));
        }
        let count = index.cells.len();
        self.verbosity.note(&format!(
            "sweep:  {count} cells, {} to do, in {}",
            to_do.len(),
            self.folder.path().display()
        ));
        let is_local = self.args.launcher == Launcher::Local;
        if is_local && index.wanted.speed_frames > 0 && self.args.jobs.is_some_and(|jobs| jobs.get() > 1) {
            self.verbosity.note("note:   frame rates and times are measured while several cells share the machine");
        }
        let failed = match self.args.launcher {
            _ if to_do.is_empty() => 0,
            Launcher::Local => self.local(&to_do).run(&to_do, Estimate::new(&self.folder, index)?)?,
            Launcher::Slurm => {
                self.submit(&to_do, out)?;
                if !self.args.wait {
                    let folder = path_for_shell(self.folder.path());
                    return Ok(writeln!(out, "Run `mvfusion sweep status {folder}` to follow the progress.")?);
                }
                let at_work = to_do.len() - self.free(&to_do)?.len();
                if at_work > 0 {
                    self.verbosity.note(&format!("note:   waiting for running cells ({at_work})"));
                }
                self.slurm().wait_for(&to_do)?;
                self.to_do()?.len()
            }
        };
        write_table(&self.folder, index, self.verbosity, out)?;
        if failed > 0 {
            let (count, folder) = (to_do.len(), path_for_shell(self.folder.path()));
            bail!("{failed} of {count} cells have not finished; `mvfusion sweep status {folder}` shows why");
        }
        Ok(())
    }

    /// Submits cells to SLURM, except for running ones.
    fn submit(&self, to_do: &[&Cell], out: &mut dyn Write) -> anyhow::Result<()> {
        let free = self.free(to_do)?;
        let at_work = to_do.len() - free.len();
        if at_work > 0 {
            let fate = if self.args.wait { "not submitted again, but awaited" } else { "not submitted again" };
            writeln!(out, "{at_work} of {} cells are already running: {fate}", to_do.len())?;
            self.verbosity
                .note("note:   they measure what was requested when they started; to measure more, sweep again later");
        }
        if !free.is_empty() {
            let job = self.slurm().submit(&free, self.args.wait)?;
            writeln!(out, "job {job}: {} cells", free.len())?;
        }
        Ok(())
    }

    /// Rejects options that would be ignored.
    fn check_options(&self) -> Result<(), UsageError> {
        let is_local = self.args.launcher == Launcher::Local;
        let ignored = [("--sbatch", !self.args.sbatch.is_empty()), ("--wait", self.args.wait)];
        match ignored.into_iter().find(|(_, given)| is_local && *given) {
            Some((option, _)) => Err(UsageError::new(format!("{option} requires --launcher slurm."))),
            None => Ok(()),
        }
    }

    /// Checks that the selected scenes, variants and seeds exist.
    fn check_choice(&self) -> Result<(), UsageError> {
        let cells = &self.plan.index.cells;
        let named = |option, what, names: &[String], of: fn(&Cell) -> &str| {
            let Some(name) = names.iter().find(|name| !cells.iter().any(|cell| of(cell) == **name)) else {
                return Ok(());
            };
            let known: BTreeSet<String> = cells.iter().map(|cell| format!("`{}`", of(cell))).collect();
            let known = known.into_iter().collect::<Vec<_>>().join(", ");
            Err(UsageError::new(format!("{option}: the grid has no {what} `{name}`; it has {known}.")))
        };
        named("--scenes", "scene", &self.args.scenes, |cell| &cell.scene)?;
        named("--variant", "variant", &self.args.variants, |cell| &cell.variant)?;
        match self.args.seeds.iter().find(|seed| !cells.iter().any(|cell| cell.seed == **seed)) {
            Some(seed) => {
                let known: BTreeSet<u64> = cells.iter().map(|cell| cell.seed).collect();
                let known = known.iter().map(u64::to_string).collect::<Vec<_>>().join(", ");
                Err(UsageError::new(format!("--seeds: the grid has no seed {seed}; it has {known}.")))
            }
            None => Ok(()),
        }
    }

    /// Checks that the folder of weights has a network that the columns need, or any network if they need none. Missing
    /// networks may be added later.
    fn check_weights(&self) -> anyhow::Result<()> {
        let Some(folder) = self.plan.index.wanted.lpips_weights.as_deref() else { return Ok(()) };
        let needed = self.plan.index.lpips_networks();
        // Weights that lie where they are looked for by themselves were not asked for.
        if self.args.lpips_weights.is_some() {
            let asked = if needed.is_empty() { BTreeSet::from(Backbone::ALL) } else { needed.clone() };
            lpips::check_option(folder, &asked)?;
        }
        let missing = lpips::missing(folder, &needed);
        if !missing.is_empty() {
            let (folder, files) = (folder.display(), lpips::files_of(&missing));
            self.verbosity
                .note(&format!("note:   {folder} has no {files} or equivalent; columns that need it stay empty"));
        }
        Ok(())
    }

    /// Checks that the folders of the selected scenes exist.
    fn check_folders(&self) -> anyhow::Result<()> {
        let chosen = self.plan.index.cells.iter().zip(&self.plan.configs).filter(|(cell, _)| self.is_chosen(cell));
        let folders = chosen.flat_map(|(cell, config)| {
            [&config.scene.data, &config.eval.dynamic_masks].map(|folder| (cell, folder.as_deref()))
        });
        let mut missing: Vec<String> = folders
            .filter_map(|(cell, folder)| Some((cell, folder?)))
            .filter(|(_, folder)| !folder.is_dir())
            .map(|(cell, folder)| format!("{} ({})", folder.display(), cell.scene))
            .collect();
        missing.sort();
        missing.dedup();
        if !missing.is_empty() {
            bail!(
                "these folders of the grid do not exist: {}. Set --data-root, or select other scenes with --scenes.",
                missing.join(", ")
            );
        }
        self.check_formats()
    }

    /// Checks that the folders of the selected scenes hold scenes. Their files are read when a cell begins.
    fn check_formats(&self) -> anyhow::Result<()> {
        let chosen = self.plan.index.cells.iter().zip(&self.plan.configs).filter(|(cell, _)| self.is_chosen(cell));
        let mut known = BTreeSet::new();
        for (cell, config) in chosen {
            let Some(folder) = &config.scene.data else { continue };
            if known.insert((folder, config.scene.format.map(|format| format.name()))) {
                mvfusion_data::recognise(folder, config.scene.format)
                    .with_context(|| format!("the scene `{}` of the grid", cell.scene))?;
            }
        }
        Ok(())
    }

    fn is_chosen(&self, cell: &Cell) -> bool {
        let SweepRunArgs { scenes, variants, seeds, .. } = self.args;
        let is_in = |names: &[String], name| names.is_empty() || names.contains(name);
        is_in(scenes, &cell.scene) && is_in(variants, &cell.variant) && (seeds.is_empty() || seeds.contains(&cell.seed))
    }

    /// The selected cells that have not finished.
    fn to_do(&self) -> anyhow::Result<Vec<&Cell>> {
        let index = &self.plan.index;
        let chosen = index.cells.iter().filter(|cell| self.is_chosen(cell));
        Ok(chosen.filter(|cell| !self.folder.is_finished(&cell.id, &index.wanted)).collect())
    }

    /// Those of some cells that are not running.
    fn free<'c>(&self, cells: &[&'c Cell]) -> anyhow::Result<Vec<&'c Cell>> {
        let mut free = Vec::new();
        for &cell in cells {
            if self.folder.state(&cell.id, &self.plan.index.wanted)? != State::Running {
                free.push(cell);
            }
        }
        Ok(free)
    }

    fn local(&self, to_do: &[&Cell]) -> Local<'_> {
        let threads = threads::count(self.args.threads);
        let (folder, index, device) = (&self.folder, &self.plan.index, self.args.device.as_str());
        let default_jobs = || sweep::default_jobs(&self.plan, to_do, device, threads);
        let jobs = self.args.jobs.map_or_else(default_jobs, NonZeroUsize::get).min(to_do.len().max(1));
        Local { folder, index, device, jobs, threads, verbosity: self.verbosity }
    }

    fn slurm(&self) -> Slurm<'_> {
        Slurm {
            folder: &self.folder,
            index: &self.plan.index,
            device: &self.args.device,
            jobs: self.args.jobs.map(NonZeroUsize::get),
            threads: self.args.threads.map_or(CLUSTER_THREADS, NonZeroUsize::get),
            options: &self.args.sbatch,
        }
    }

    /// Prints what a run would do.
    fn show(&self, to_do: &[&Cell], out: &mut dyn Write) -> anyhow::Result<()> {
        let index = &self.plan.index;
        for cell in index.cells.iter().filter(|cell| self.is_chosen(cell)) {
            let state = self.folder.state(&cell.id, &index.wanted)?;
            let name = cell.name(&index.axes);
            writeln!(out, "{:12} {}  {name}, {} steps", state.word(), cell.id, cell.steps)?;
        }
        if self.args.launcher == Launcher::Slurm {
            let free = self.free(to_do)?;
            if !free.is_empty() {
                write!(out, "\n{}\n", self.slurm().script(&free)?)?;
            }
        }
        let jobs = match self.args.launcher {
            Launcher::Local => self.local(to_do).jobs,
            Launcher::Slurm => self.args.jobs.map_or(to_do.len(), NonZeroUsize::get),
        };
        let mut estimate = Estimate::new(&self.folder, index)?;
        if self.args.probe {
            self.probe(to_do, &mut estimate)?;
        }
        let steps: usize = to_do.iter().map(|cell| cell.steps).sum();
        let time = estimate.seconds(to_do.iter().copied(), jobs).map_or("unknown".to_owned(), spoken);
        let ground = estimate.ground();
        writeln!(out, "{} cells to do, {steps} steps, {jobs} at a time: {time} ({ground})", to_do.len())?;
        Ok(())
    }

    /// Runs a few steps of one cell per scene and variant.
    fn probe(&self, to_do: &[&Cell], estimate: &mut Estimate) -> anyhow::Result<()> {
        let mut tried = BTreeSet::new();
        let Plan { index, configs } = &self.plan;
        let threads = match self.args.launcher {
            Launcher::Local => self.local(to_do).share(to_do.len()),
            Launcher::Slurm => self.slurm().threads,
        };
        for (cell, config) in index.cells.iter().zip(configs).filter(|(cell, _)| to_do.contains(cell)) {
            if tried.insert((&cell.scene, &cell.variant)) {
                self.verbosity.note(&format!("probe:  {}", cell.name(&index.axes)));
                estimate.add_probe(cell, sweep::probe_seconds(cell, config, &self.args.device, threads)?);
            }
        }
        Ok(())
    }
}
