//! The driver of one run: ten steps, each one call.
//!
//! ```text
//! start → reduce → prepare → plan → exact → open files → solve → compare → expand → write
//! ```
//!
//! [`run()`] does all of them. [`solve`] works in memory, without console output, and returns a
//! [`Solution`].
//!
//! Uses: results, quantum, solve, and every room below.

mod at_start;
mod checkpointing;
pub mod classical;
pub mod compare;
pub mod errors;
mod estimates;
pub mod exact;
pub mod expand;
pub mod fields;
mod files;
pub mod ledger;
mod log;
mod modes;
pub mod options;
pub mod planning;
mod positive;
mod readout;
mod summarise;
mod unresolved;
pub mod warnings;

use crate::base::error::Result;
use crate::base::lock::DirectoryLock;
use crate::base::log::report;
use crate::matrix::bounds::Bounds;
use crate::matrix::observables::{CellVolumes, Moments};
use crate::parallel::communicator::World;
use crate::plan::Plan;
use crate::plan::layout::{Resources, refuse_hopeless};
use crate::problem::case::Case;
use crate::quantum::readout::Readout;
use crate::results;
use crate::results::dataset::{ExactSolution, PlateauPoint, Results, slices};
use crate::results::file_checksums;
use crate::results::finished;
use crate::results::provenance::provenance;
use crate::results::result_grid::ResultGrid;
use crate::results::summary::{self, Missed, Summary};
use crate::results::{grids, result_file, warped, xdmf};
use crate::run::at_start::at_start;
use crate::run::checkpointing::Checkpointing;
use crate::run::exact::{ExactRun, exact_run};
use crate::run::expand::Expanded;
use crate::run::files::{RunFiles, SolvedFields, WarpedOutput};
use crate::run::log::RunLog;
use crate::run::options::{Options, Output};
use crate::run::planning::with_start;
use crate::scheme::reduce::reduced;
use crate::solve::prepared::Prepared;
use serde::Deserialize;
use std::ops::Range;
use std::path::Path;

/// Runs a case and writes its results into `directory`. Collective over all ranks.
///
/// # Errors
/// The first error of any rank, the same on all; [`crate::base::error::Error::Stopped`] where the
/// run stopped early and can go on.
pub fn run(world: &World, case: &Case, directory: &Path, options: &Options) -> Result<Summary> {
    if !options.force {
        finished::refuse_to_replace(&world.group(), directory, case, options.resume)?;
    }
    let case = &*with_start(&world.group(), case)?;
    let output = Output { directory, options };
    compute(world, case, Some(output))?.write_prepared(world, directory)
}

/// Whether `directory` holds the finished results of `case`; results that are damaged are reported,
/// and are to be computed anew. Collective.
pub fn is_done(world: &World, directory: &Path, case: &Case) -> bool {
    let found = finished::is_finished(&world.group(), directory, case);
    if let (Err(damage), 0) = (&found, world.group().rank()) {
        report(&format!(
            "warning: --resume: {damage}: the finished run is damaged and is computed anew"
        ));
    }
    matches!(found, Ok(true))
}

/// An error where the finished run of `case` in `directory` misses its goals and `solver.strict` is
/// set. Collective.
///
/// # Errors
/// [`crate::base::error::Error::Missed`]; [`crate::base::error::Error::Output`] where its summary
/// cannot be read.
pub fn refuse_missed(world: &World, directory: &Path, case: &Case) -> Result<()> {
    world.group().on_first_rank(|| {
        let missed = Missed::deserialize(&summary::read(directory)?["missed"]);
        missed.unwrap_or_default().refuse(case.strict)
    })
}

/// Solves a case in memory, without console output, files or checkpoints. Collective over all
/// ranks.
///
/// # Errors
/// The first error of any rank, the same on all.
pub fn solve(world: &World, case: &Case) -> Result<Solution> {
    let case = with_start(&world.group(), case)?;
    let case = Case {
        // Its files are written while the modes are there, by `run`.
        warped_field: false,
        ..case.into_owned()
    };
    let mut solution = compute(world, &case, None)?;
    solution.summary.finish(&world.group(), &solution.log.watch);
    Ok(solution)
}

/// A solved case, on this rank's share of the grid.
pub struct Solution {
    /// The case on the grid of the results.
    pub case: Case,
    /// The numbers of the run: errors, counts, seconds, memory.
    pub summary: Summary,
    /// The plan that was carried out.
    pub plan: Plan,
    /// This rank's space cells, one range an x-axis; may be empty.
    pub share: Vec<Range<usize>>,
    /// Fields `[x, …, v, …]` on the share, moments on its space cells and totals at `T`; output
    /// times before.
    pub results: Expanded,
    /// The exact solution on the share, where the case names one.
    pub exact: Option<ExactSolution>,
    /// Moments of the exact solution at the output times before the end, then at the end.
    pub exact_moments: Vec<Moments>,
    plateau: Vec<PlateauPoint>,
    checkpointing: Option<Checkpointing>,
    /// Keeps other runs out of the directory until the results are there. On the first rank.
    lock: Option<DirectoryLock>,
    log: RunLog,
}

/// Runs a case in memory. Only where `output` is given it prints, keeps checkpoints and writes
/// warped fields. Collective over all ranks.
///
/// # Errors
/// As [`run()`].
fn compute(world: &World, case: &Case, output: Option<Output<'_>>) -> Result<Solution> {
    let mut log = RunLog::new(world, output.is_some());
    let mut summary = Summary::default();
    let case = reduced(&world.group(), case)?;
    let result_grid = ResultGrid::new(&case);
    let (lock, mut prepared) = planned(world, &case, &result_grid.case, output, &mut log)?;
    let place = result_grid.place(&prepared.place, &prepared.plan, &prepared.communicator);
    let exact_run = exact_run(&prepared.communicator.world, &result_grid.case, &place)?;
    if exact_run.exact.is_some() {
        log.watch.lap("exact");
    }
    log.open(&prepared.plan);
    let mut checkpointing = match output {
        Some(output) => Checkpointing::open(&prepared, &output, world.started, &mut log)?,
        None => None,
    };
    let at_start = at_start(&mut prepared);
    let initial = at_start.as_ref().map(|found| found.totals);
    summary.mass_initial = initial.map(|totals| totals.mass);
    let ledger = output.map(|_| ledger::before_run(&world.group(), &result_grid.case));
    let mut ledger = ledger.transpose()?.unwrap_or_default();
    let entered = ledger::entered(&prepared);
    log.watch.lap("observables");
    let files = output.map(|output| (output.directory, checkpointing.as_mut()));
    let mut solution = solve_fields(world, &mut prepared, files, &mut summary, &mut log)?;
    solution.early.splice(0..0, at_start.filter(|_| prepared.case.at_start.is_some()));
    compare_fields(&mut prepared, &solution, &mut summary, &mut log)?;
    let plateau = compare::plateau(&prepared, &solution);
    let estimated = estimates::of_the_grid(&mut prepared, &solution.fields[0][0])?;
    let results = expand::expand(&prepared, solution, &result_grid, &exact_run, &mut summary)?;
    summary.exact_density_warning().into_iter().for_each(|warning| log.warn_later(warning));
    let ExactRun { exact, moments: exact_moments, .. } = exact_run;
    let volumes = CellVolumes::new(&result_grid.case.space, &place.share);
    let mass = |moments: &Moments| volumes.integral(&prepared.communicator.world, &moments.density);
    summary.mass_exact = exact_moments.last().map(mass);
    ledger.close(initial, results.totals, entered);
    ledger.warnings().into_iter().for_each(|warning| log.warn_later(warning));
    summary.ledger = Some(ledger);
    log.watch.part("exact", results.exact_seconds);
    log.watch.lap("observables");
    if result_grid.case.readout.is_some() {
        summary.readout =
            Some(readout::readout(&prepared, &result_grid.case, &results.fields[0], &summary));
        log.watch.lap("readout");
    }
    summary.fill(&prepared, &log);
    summary.judge(&prepared.case, estimated);
    Ok(Solution {
        case: result_grid.case,
        summary,
        plan: prepared.plan,
        share: place.share,
        results,
        exact,
        exact_moments,
        plateau,
        checkpointing,
        lock,
        log,
    })
}

/// The system of the reduced `case` with its modes planned, and the lock of the result directory;
/// `result_grid` is the case on the grid of its results. Collective.
fn planned(
    world: &World,
    case: &Case,
    result_grid: &Case,
    output: Option<Output<'_>>,
    log: &mut RunLog,
) -> Result<(Option<DirectoryLock>, Prepared)> {
    let resources = Resources {
        ranks_x: output.and_then(|output| output.options.ranks_x.clone()),
        ..Resources::here(world)
    };
    refuse_hopeless(case, &resources)?;
    let bounds = Bounds::new(case)?;
    let plan = Plan::provisional(case, &bounds, &resources)?;
    let lock = output.map(|output| lock(world, output.directory, result_grid, log));
    let lock = lock.transpose()?.flatten();
    let prepared = prepare(world, case, &bounds, plan, log)?;
    Ok((lock, plan_modes(world, prepared, &resources, output, log)?))
}

/// Every field at `T` and at the output times before; warped fields and checkpoints go to `files`,
/// the directory with its checkpoints. Collective.
fn solve_fields(
    world: &World,
    prepared: &mut Prepared,
    files: Option<(&Path, Option<&mut Checkpointing>)>,
    summary: &mut Summary,
    log: &mut RunLog,
) -> Result<SolvedFields> {
    let seconds = log.watch.seconds.clone();
    let provenance = provenance(world, &prepared.case);
    let files = files.map(|(directory, checkpointing)| RunFiles {
        warped: WarpedOutput { directory, seconds: &seconds, provenance: &provenance },
        checkpointing,
    });
    let solution = fields::solve(prepared, files, summary)?;
    log.watch.part("write", solution.warped_seconds);
    log.watch.lap("solve");
    solution.warning.iter().for_each(|warning| log.warn_later(warning.clone()));
    Ok(solution)
}

/// Puts the error of the fields into `summary`: the estimate, and the measurement by
/// `solver.verify`. Collective.
fn compare_fields(
    prepared: &mut Prepared,
    solution: &SolvedFields,
    summary: &mut Summary,
    log: &mut RunLog,
) -> Result<()> {
    compare::refuse_not_finite(prepared, solution)?;
    for warning in compare::compare(prepared, solution, summary) {
        log.warn_later(warning);
    }
    if prepared.case.verify {
        compare::verify(prepared, solution, log.prints, summary);
        log.watch.lap("verify");
    }
    summary.continued = compare::continued(prepared, &solution.fields[0][0], summary);
    Ok(())
}

/// Makes sure that the results can be written, by this run alone; gives the directory's lock, on
/// the first rank. Collective.
fn lock(
    world: &World,
    directory: &Path,
    case: &Case,
    log: &mut RunLog,
) -> Result<Option<DirectoryLock>> {
    let lock = results::prepare(&world.group(), directory, case)?;
    if let Some(why) = lock.as_ref().and_then(|lock| lock.unlocked.as_ref()) {
        let directory = directory.display();
        log.warn(format!(
            "{directory} cannot be locked ({why}): no other run may write there at the same time"
        ));
    }
    Ok(lock)
}

/// The semi-discrete system on this rank. Collective.
fn prepare(
    world: &World,
    case: &Case,
    bounds: &Bounds,
    plan: Plan,
    log: &mut RunLog,
) -> Result<Prepared> {
    for warning in warnings::warnings(case) {
        log.warn(warning);
    }
    log.watch.lap("plan");
    let prepared = Prepared::with_plan(world, case, bounds, plan)?;
    log.watch.part("weights", prepared.system.weight_seconds);
    log.watch.lap("assemble");
    Ok(prepared)
}

/// `prepared` with its modes planned, for the ratio of norms that the probe measures; refused if
/// the disk has no room for the warped field. Collective.
fn plan_modes(
    world: &World,
    mut prepared: Prepared,
    resources: &Resources,
    output: Option<Output<'_>>,
    log: &mut RunLog,
) -> Result<Prepared> {
    if prepared.plan.warp.is_some() {
        let ratio = prepared.probe();
        log.watch.lap("probe");
        prepared = prepared.plan_modes(world, resources, ratio)?;
        let points = prepared.plan.warp.as_ref().and_then(|warp| warp.points);
        if let (Some(points), Some(output)) = (points, output) {
            let room = match log.prints {
                true => warped::enough_room(output.directory, &prepared.case, points),
                false => Ok(()),
            };
            prepared.communicator.world.agree(room)?;
        }
        log.watch.lap("design");
    }
    Ok(prepared)
}

impl Solution {
    /// Writes `result.h5`, the views of its grids, `readout.csv` and `summary.json` into
    /// `directory`, which is made. Collective.
    ///
    /// # Errors
    /// [`crate::base::error::Error::Directory`] and [`crate::base::error::Error::Output`].
    pub fn write(self, world: &World, directory: &Path) -> Result<Summary> {
        let _lock = results::prepare(&world.group(), directory, &self.case)?;
        self.write_prepared(world, directory)
    }

    /// As [`write`](Self::write), into a directory that is known to take it; deletes the
    /// checkpoints. Collective.
    fn write_prepared(self, world: &World, directory: &Path) -> Result<Summary> {
        let Self { mut summary, mut log, results, lock: _lock, .. } = self;
        let (all, case) = (world.group(), &self.case);
        // Pictures of an older result do not belong to this one.
        all.on_first_rank(|| finished::remove_older(directory, case))?;
        let steps = result_file::write(
            &all,
            directory,
            &Results {
                case,
                plan: &self.plan,
                share: &self.share,
                fields: &slices(&results.fields),
                exact: self.exact.as_ref(),
                exact_moments: &self.exact_moments,
                moments: &results.moments,
                potential: &results.potential,
                totals: results.totals,
                early: &results.early,
                plateau: &self.plateau,
                readout: summary.readout.as_ref(),
                seconds: &log.watch.seconds.clone(),
                provenance: &provenance(world, case),
            },
        )?;
        all.on_first_rank(|| {
            xdmf::write(directory, &steps)?;
            grids::write(directory, &steps)
        })?;
        log.watch.lap("write");
        all.on_first_rank(|| match &summary.readout {
            Some(readout) => Readout::write(readout, directory),
            None => Ok(()),
        })?;
        summary.files = file_checksums::of_files(&all, directory, &results::file_names(case))?;
        summary.finish(&all, &log.watch);
        all.on_first_rank(|| summary.write(directory))?;
        if let Some(checkpointing) = self.checkpointing.filter(|_| log.prints) {
            checkpointing.remove(&log);
        }
        Ok(summary)
    }
}
