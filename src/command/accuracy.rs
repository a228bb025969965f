//! Cases that give an accuracy instead of a grid, a degree and a tolerance.

use crate::base::error::{Error, Result};
use crate::command::cli::{AccuracyArgs, Changes, RunArgs};
use crate::parallel::communicator::World;
use crate::problem::case::Case;
use crate::problem::case::file::keys_of;
use crate::study::accuracy;
use crate::study::advise::AdviceRequest;
use std::path::Path;
use std::time::Duration;

/// Time for the trial runs, unless `--budget` gives another.
const DEFAULT_BUDGET: Duration = Duration::from_secs(60);

/// The case of a run with the choice that `directory` stores for the same case and accuracy; `None`
/// if it stores none. Collective.
pub fn with_choice(world: &World, case: &Case, args: &RunArgs, directory: &Path) -> Option<Case> {
    accuracy::stored(world, case, args.accuracy.accuracy.or(case.accuracy)?, directory)
}

/// The case of a run. If it has an accuracy, [`accuracy::chosen`] chooses its settings. Collective.
///
/// # Errors
/// As [`with_accuracy`]; if the directory holds a foreign file.
pub fn choose(world: &World, case: Case, args: &RunArgs, directory: &Path) -> Result<Case> {
    if !args.force && args.accuracy.accuracy.or(case.accuracy).is_some() {
        accuracy::refuse_foreign(world, directory)?;
    }
    with_accuracy(world, case, &args.changes, &args.accuracy)
}

/// `case`, which was loaded with `changes`; with the settings that [`accuracy::chosen`] chooses if
/// `--accuracy` or `solver.accuracy` gives an accuracy. Collective.
///
/// # Errors
/// As [`accuracy::chosen`]; [`Error::Input`] if `--set` gives a key that an accuracy chooses.
pub fn with_accuracy(
    world: &World,
    case: Case,
    changes: &Changes,
    wanted: &AccuracyArgs,
) -> Result<Case> {
    let Some(accuracy) = wanted.accuracy.or(case.accuracy) else {
        let given =
            [("--budget", wanted.budget.is_some()), ("--reproducible", wanted.clock.reproducible)];
        return match given.iter().find(|(_, given)| *given) {
            None => Ok(case),
            Some((option, _)) => Err(Error::Input(format!(
                "{option} is for the trial runs of an accuracy; --accuracy or solver.accuracy is \
                 missing"
            ))),
        };
    };
    refuse_chosen_keys(&changes.set)?;
    let budget = wanted.budget.unwrap_or(DEFAULT_BUDGET).as_secs_f64();
    accuracy::chosen(world, &case, AdviceRequest { accuracy, budget, clock: wanted.clock.chosen() })
}

/// Refuses `--set` of keys that an accuracy chooses.
fn refuse_chosen_keys(set: &[String]) -> Result<()> {
    const CHOSEN: [&str; 5] =
        ["scheme.degree", "scheme.flux", "scheme.interface", "scheme.limiter", "solver.tolerance"];
    let of_axis = |key: &str| {
        key.starts_with("axis.") && (key.ends_with(".cells") || key.ends_with(".degree"))
    };
    let is_chosen = |key: &String| of_axis(key) || CHOSEN.contains(&key.as_str());
    match set.iter().flat_map(|set| keys_of(set)).find(is_chosen) {
        Some(key) => Err(Error::Input(format!(
            "--set {key} beside --accuracy or solver.accuracy, which choose cells, degree, \
             flux, interface and tolerance: leave one of them out"
        ))),
        None => Ok(()),
    }
}
