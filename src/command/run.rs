//! `phasewarp run`: solves a case.

use crate::base::error::{Error, Result};
use crate::base::machine::{self, RunPart, StopMessages};
use crate::base::text::{percent, short};
use crate::command::accuracy;
use crate::command::cli::{CaseArgs, RunArgs};
use crate::command::loading::{default_directory, default_directory_until, load, load_continued};
use crate::command::printing::{print, set_stop_messages};
use crate::parallel::communicator::World;
use crate::problem::case::{Case, Method};
use crate::quantum::readout::Readout;
use crate::results::continued_result::ContinuedResult;
use crate::results::finished;
use crate::results::summary::Summary;
use crate::run;
use crate::run::options::Options;
use crate::study::accuracy::CaseBefore;
use std::path::{Path, PathBuf};

/// Written as soon as a signal requests a stop.
const STOP_MESSAGES: StopMessages = StopMessages {
    set_up: "stopped by a signal before the first mode: nothing to store; the same command with\n  \
             --resume starts again, from an older checkpoint if there is one\n",
    modes: "stop signal: a checkpoint of the finished modes follows; a second signal ends at \
            once\n",
};

/// Solves the case, unless `--resume` finds it finished. Collective.
///
/// # Errors
/// As [`run::run`] and [`accuracy::choose`].
pub fn execute(world: &World, args: &RunArgs) -> Result<()> {
    set_stop_messages(world, STOP_MESSAGES);
    machine::begin(RunPart::SetUp);
    let (given, directory) = run_request(world, args)?;
    let (case, chosen) = match args.continued {
        // A continued run keeps its grid.
        Some(_) => (given, None),
        None => {
            let before = CaseBefore::new(&given);
            let case = on_its_grid(world, given, args, &directory)?;
            let chosen = before.choice(&case);
            (case, chosen)
        }
    };
    if case.method != Method::Schrodingerized {
        machine::begin(RunPart::Classical);
    }
    let damaged = |damage: &Error| {
        format!("--resume: {damage}: the finished run is damaged and is computed anew")
    };
    if args.resume && run::is_done_removing_rest(world, &directory, &case, damaged) {
        return report_finished(world, &case, &directory);
    }
    let options = Options {
        ranks_x: args.ranks_x.clone(),
        resume: args.resume,
        keeps_finished: false,
        force: args.force,
        chosen,
        walltime: args.walltime,
        stop: machine::stop_flag(),
    };
    let summary = match run::run(world, &case, &directory, &options) {
        Err(Error::FinishedByOthers) => return report_finished(world, &case, &directory),
        other => other?,
    };
    if world.group().is_first() {
        summary.report_late_warnings();
    }
    print(world, &closing_line(&summary, &directory));
    let ledger = summary.ledger.iter().filter(|l| args.verbose || !l.warnings().is_empty());
    ledger.for_each(|ledger| print(world, &ledger.text()));
    let readout = summary.readout.as_ref().and_then(Readout::line);
    let inherited = summary.continued.as_ref().map(ContinuedResult::line);
    let goal = goal_line(case.accuracy, &summary);
    let errors = inherited.into_iter().chain(goal).chain(summary.accuracy.line());
    for line in readout.into_iter().chain(errors) {
        print(world, &line);
    }
    summary.missed.refuse(case.strict)?;
    if let Some(line) = summary.missed.line() {
        print(world, &line);
    }
    Ok(())
}

/// Prints that the run of `case` in `directory` is finished, and the lines about its errors.
/// Collective.
///
/// # Errors
/// As [`finished::refuse_missed`].
fn report_finished(world: &World, case: &Case, directory: &Path) -> Result<()> {
    print(world, &format!("--resume: the run is finished; results in {}", directory.display()));
    for line in finished::lines_about_errors(&world.group(), directory, case.strict)? {
        print(world, &line);
    }
    finished::refuse_missed(&world.group(), directory, case.strict)
}

/// The case that `args` ask to run, and the directory of its results. Collective.
fn run_request(world: &World, args: &RunArgs) -> Result<(Case, PathBuf)> {
    let given = args.output.clone();
    if let (Some(from), Some(until)) = (&args.continued, &args.until) {
        let case = load_continued(world, from, until, &args.changes)?;
        let directory = given.unwrap_or_else(|| default_directory_until(from, case.end));
        return Ok((case, directory));
    }
    if let Some(until) = &args.until {
        let what = "is the final time of --continue DIR; for a case file use --set time.end";
        return Err(Error::Input(format!("--until {until}: {what}")));
    }
    // Without --continue the command line requires a case file.
    let case =
        CaseArgs { case: args.case.clone().unwrap_or_default(), changes: args.changes.clone() };
    let case = load(world, &case)?;
    let directory = given.unwrap_or_else(|| default_directory(&case.name));
    Ok((case, directory))
}

/// `case`, on the grid that is chosen for its accuracy if it has one. A resumed run takes the
/// stored choice. Collective.
fn on_its_grid(world: &World, case: Case, args: &RunArgs, directory: &Path) -> Result<Case> {
    let chosen = accuracy::with_choice(world, &case, args, directory);
    // Before the trials for an accuracy, which take a minute.
    if !args.force && !args.resume {
        let here = chosen.as_ref().unwrap_or(&case);
        finished::refuse_to_replace(&world.group(), directory, here, false)?;
    }
    let resumed = chosen.filter(|_| args.resume);
    resumed.map_or_else(|| accuracy::choose(world, case, args, directory), Ok)
}

/// A line that says whether the density meets the case's accuracy. `None` if the case has none, or
/// if the accuracy is missed or not shown, which `Summary::missed` reports at the end.
fn goal_line(goal: Option<f64>, summary: &Summary) -> Option<String> {
    let goal = goal.filter(|_| summary.missed.accuracy.is_none())?;
    let found = match (summary.accuracy.goal_error, summary.accuracy.goal_estimate) {
        (Some(error), _) => format!("reached, {error:.1e}"),
        (None, Some(estimate)) => {
            let rougher = match summary.accuracy.grid_density {
                Some(_) => "; the estimate of this run alone, in the last line, is the rougher one",
                None => "",
            };
            format!(
                "{estimate:.1e} by the trial runs; not measured, as there is no [exact]{rougher}"
            )
        }
        (None, None) => "not measured, as there is no [exact]".to_owned(),
    };
    Some(format!("accuracy {goal:e} of the density (relative L1): {found}"))
}

/// A line with the seconds, the errors and the directory of the results.
fn closing_line(summary: &Summary, directory: &Path) -> String {
    let mut line = format!("done in {:.2} s", summary.wall_seconds);
    if let Some(estimate) = summary.error_estimate {
        let tolerance = summary.tolerance;
        line += &if summary.error_estimate_reliable {
            format!(", error estimate {estimate:.1e} (tolerance {tolerance:e})")
        } else if let Some(measured) = summary.error_semidiscrete {
            format!(", measured error {measured:.1e} (tolerance {tolerance:e})")
        } else {
            let doubt = summary.doubt.as_deref().unwrap_or("it is not finite");
            format!(
                ", no reliable error estimate: {doubt}; solver.verify = true measures the error"
            )
        };
    }
    if let (Some(density), Some(velocity)) = (summary.error_density_l1, summary.error_velocity_l1) {
        line += &format!(
            ", L1 distance to the exact density {}, mean velocity {}",
            short(density),
            short(velocity)
        );
    }
    if let Some(l1) = summary.error_l1 {
        let part = summary
            .error_l1_relative
            .map_or(String::new(), |part| format!(" ({} of its norm)", percent(part)));
        line += &format!(", L1 distance to the exact solution {}{part}", short(l1));
    }
    if let Some(least) = summary.minimum_before_limiting {
        line += &format!(", least value {least:.1e} before output.positive");
        if summary.minimum < 0.0 {
            let left = summary.minimum;
            line +=
                &format!(" and {left:.1e} after it, where the average of an element is below 0");
        }
    }
    format!("{line}; results in {}", directory.display())
}
