//! Case files of a command, and where its results go.

use crate::base::error::{Error, Result};
use crate::base::log::report;
use crate::command::cli::{AccuracyArgs, CaseArgs, Mode};
use crate::parallel::communicator::World;
use crate::problem::case;
use crate::problem::case::Case;
use crate::run::planning;
use crate::scheme::reduce::reduced;
use crate::study::advise::{Wanted, advise};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Time for the trials of an accuracy, where none is given.
const DEFAULT_BUDGET: Duration = Duration::from_secs(60);

/// Reads the case file on rank 0 and parses it on all. Collective.
pub fn load(world: &World, args: &CaseArgs) -> Result<Case> {
    let group = world.group();
    let text = group.on_first_rank(|| case::read_text(&args.case))?;
    let text = group.broadcast_text(&text);
    let mode = (args.mode).map(|mode| format!("output.warped_field={}", mode == Mode::Full));
    let set: Vec<String> = args.set.iter().cloned().chain(mode).collect();
    Case::parse(&args.case.display().to_string(), &text, &set)
}

/// As [`load`], [`with_accuracy`]. Collective.
///
/// # Errors
/// As both.
pub fn load_for_accuracy(world: &World, args: &CaseArgs, wanted: &AccuracyArgs) -> Result<Case> {
    with_accuracy(world, load(world, args)?, args, wanted)
}

/// `case`, which was loaded by `args`; where an accuracy is asked for, by `--accuracy` or by
/// `solver.accuracy`, with the grid, degree, interface and tolerance that [`advise`] chooses for
/// it, which are printed. Collective.
///
/// # Errors
/// As [`advise`]; [`Error::Input`] where `--set` gives what is chosen, or where nothing is advised.
pub fn with_accuracy(
    world: &World,
    case: Case,
    args: &CaseArgs,
    wanted: &AccuracyArgs,
) -> Result<Case> {
    let Some(accuracy) = wanted.accuracy.or(case.accuracy) else {
        return match wanted.budget {
            None => Ok(case),
            Some(_) => Err(Error::Input(
                "--budget is the time to choose for an accuracy: --accuracy or solver.accuracy is \
                 missing"
                    .to_owned(),
            )),
        };
    };
    refuse_what_is_chosen(&args.set)?;
    let budget = wanted.budget.unwrap_or(DEFAULT_BUDGET).as_secs_f64();
    let advised = advise(world, &case, Wanted { accuracy, budget })?;
    let Some(entry) = advised.best_of(case.method) else {
        let why = advised.why_nothing(case.method);
        return Err(Error::Input(format!("{}: accuracy {accuracy:e}: {why}", case.name)));
    };
    if world.group().rank() == 0 {
        report(&format!("accuracy {accuracy:e}: {}", entry.summary()));
        for warning in &advised.warnings {
            report(&format!("warning: {warning}"));
        }
    }
    let set: Vec<String> = case.overrides.iter().chain(&entry.settings).cloned().collect();
    Ok(Case { accuracy: Some(accuracy), ..Case::parse(&case.name, &case.text, &set)? })
}

/// Refuses `--set` of keys that an accuracy chooses.
fn refuse_what_is_chosen(set: &[String]) -> Result<()> {
    let is_chosen = |key: &str| {
        let of_axis =
            key.starts_with("axis.") && [".cells", ".degree"].iter().any(|k| key.ends_with(k));
        of_axis
            || ["scheme.degree", "scheme.interface", "scheme.limiter", "solver.tolerance"]
                .contains(&key)
    };
    let given = set.iter().map(|set| set.split('=').next().unwrap_or_default().trim());
    match given.into_iter().find(|key| is_chosen(key)) {
        Some(key) => Err(Error::Input(format!(
            "--set {key} beside --accuracy or solver.accuracy, which choose cells, degree, \
             interface and tolerance: leave one of them out"
        ))),
        None => Ok(()),
    }
}

/// The case as it is solved: its start is read, and what its answer does not depend on is left out.
/// Collective.
///
/// # Errors
/// As [`reduced`].
pub fn reduced_case(world: &World, case: &Case) -> Result<Case> {
    let all = world.group();
    reduced(&all, &*planning::with_start(&all, case)?)
}

/// `results/NAME` of the case file.
pub fn default_directory(case: &str) -> PathBuf {
    let stem = Path::new(case).file_stem().unwrap_or_default();
    Path::new("results").join(stem)
}

/// `results/NAME-what`.
pub fn default_directory_of(case: &str, what: &str) -> PathBuf {
    let mut name = default_directory(case).into_os_string();
    name.push(format!("-{what}"));
    name.into()
}
