//! `phasewarp sweep`: a case with every combination of values.

use crate::base::disk;
use crate::base::error::{Error, Result};
use crate::base::log::eprint_wrapped;
use crate::base::machine::{self, RunPart, StopMessages};
use crate::command::cli::{Mode, SweepArgs};
use crate::command::loading::{default_directory_of, load_text};
use crate::command::printing::{print, print_unwrapped, set_stop_messages};
use crate::parallel::communicator::World;
use crate::run::options::Options;
use crate::study::sweep::table::{SweepTable, refuse_to_replace};
use crate::study::sweep::vary::Vary;
use crate::study::sweep::{Sweep, SweepRequest, SweepResult};
use std::path::Path;

/// Written as soon as a signal requests a stop.
const STOP_MESSAGES: StopMessages = StopMessages {
    set_up: "stopped by a signal before the first mode of a run: nothing to store;\n  \
             the same command goes on\n",
    modes: "stop signal: this run writes a checkpoint, or ends if it makes none; a second signal \
            ends at once\n",
};

/// Solves the cases that are not finished, writes and prints the table. Collective.
///
/// # Errors
/// As [`Sweep::new`], [`refuse_to_replace`] and [`Sweep::solve`]; [`Error::SweepFailed`] if a run
/// failed.
pub fn execute(world: &World, args: &SweepArgs) -> Result<()> {
    let sweep = sweep(world, args)?;
    let directory = &sweep.request.directory;
    if args.list {
        list(world, &sweep);
        return Ok(());
    }
    if args.index.is_none() && !args.force {
        let runs = sweep.runs.iter().map(|run| run.directory.as_path());
        world.group().on_first_rank(|| refuse_to_replace(directory, runs))?;
    }
    if args.table {
        return conclude(world, directory, &sweep.collect(world)?);
    }
    // Fails before hours are spent on runs.
    world.group().on_first_rank(|| disk::make(directory))?;
    let options = Options {
        ranks_x: args.ranks_x.clone(),
        resume: true,
        force: args.force,
        walltime: args.walltime,
        keeps_finished: true,
        chosen: None,
        stop: machine::stop_flag(),
    };
    set_stop_messages(world, STOP_MESSAGES);
    machine::begin(RunPart::Modes);
    if let Some(number) = args.index {
        return sweep.solve_one(world, number, &options);
    }
    let SweepResult { table, stopped } = sweep.solve(world, &options)?;
    match stopped {
        None => conclude(world, directory, &table),
        Some(stopped) => {
            // A later sweep would take an empty table for that of another sweep.
            if !table.rows.is_empty() {
                world.group().on_first_rank(|| table.write(directory))?;
            }
            Err(stopped)
        }
    }
}

/// The sweep that the options describe. Collective.
///
/// # Errors
/// As [`load_text`], [`Vary::parse`] and [`Sweep::new`].
fn sweep(world: &World, args: &SweepArgs) -> Result<Sweep> {
    let path = &args.case.case;
    let default = || default_directory_of(&path.display().to_string(), "sweep");
    let vary: Result<Vec<Vary>> = args.vary.iter().map(|text| Vary::parse(text)).collect();
    Sweep::new(SweepRequest {
        path: path.clone(),
        text: load_text(world, path)?,
        set: args.case.changes.set.clone(),
        mode: args.case.changes.mode.map(|mode| match mode {
            Mode::Streamed => "streamed",
            Mode::Full => "full",
        }),
        vary: vary?,
        directory: args.output.clone().unwrap_or_else(default),
    })
}

/// Prints one line per run.
fn list(world: &World, sweep: &Sweep) {
    for run in &sweep.runs {
        let (number, label, directory) = (run.number, sweep.label(run), run.directory.display());
        let label = label.replace(['\t', '\n'], " ");
        print_unwrapped(world, &format!("{number}\t{label}\t{directory}"));
        if let (Some(why), true) = (&run.refused, world.group().is_first()) {
            eprint_wrapped(&format!("warning: run {number} is refused: {why}"));
        }
    }
}

/// Writes and prints the table.
fn conclude(world: &World, directory: &Path, table: &SweepTable) -> Result<()> {
    world.group().on_first_rank(|| table.write(directory))?;
    let shown = directory.display();
    print(world, &format!("{table}\ntable.csv and table.tex in {shown}"));
    match (table.failed(), table.unfinished()) {
        (0, 0) => Ok(()),
        (failed, unfinished) => Err(Error::SweepFailed {
            path: directory.join("table.csv"),
            failed,
            unfinished,
            runs: table.rows.len(),
        }),
    }
}
