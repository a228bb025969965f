//! Cases that give an accuracy instead of a grid, a degree and a tolerance.

use crate::base::error::{Error, Result};
use crate::base::log::report;
use crate::base::text::seconds_text;
use crate::base::{checksum, disk};
use crate::command::cli::{AccuracyArgs, CaseArgs, Changes, RunArgs};
use crate::command::loading::{key_of, load};
use crate::parallel::communicator::World;
use crate::problem::case::Case;
use crate::study::advise::report::warnings;
use crate::study::advise::{Request, advise};
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::time::Duration;

/// A run that is expected to take more than this multiple of the budget gives a warning.
const LONG_RUN: f64 = 10.0;
/// Time for the trial runs, unless `--budget` gives another.
const DEFAULT_BUDGET: Duration = Duration::from_secs(60);
/// File in the directory of a run that stores what was chosen for its accuracy.
const CHOICE: &str = "accuracy.json";

/// The `--set` options chosen for an accuracy, as [`CHOICE`] stores them.
#[derive(Debug, Serialize, Deserialize)]
struct ChosenSetup {
    /// The accuracy.
    accuracy: f64,
    /// The relative L1 error of the density that the trials expect, if the file is of a version
    /// that stores it.
    #[serde(default)]
    expected_error: Option<f64>,
    /// Checksum of the case for which it was chosen: its text and its `--set` options.
    case: String,
    /// The chosen `--set` options.
    settings: Vec<String>,
}

impl ChosenSetup {
    /// The choice that turned the case `given` into `found`: the overrides that were appended.
    fn new(given: &Case, found: &Case, accuracy: f64) -> Self {
        let settings = found.overrides[given.overrides.len()..].to_vec();
        let expected_error = found.expected_error;
        Self { accuracy, expected_error, case: checksum_of(given), settings }
    }
}

/// Checksum of the text, the options and the table files that a case was read from.
fn checksum_of(case: &Case) -> String {
    let tables: Vec<Option<u64>> = case.tables.iter().map(|file| file.checksum).collect();
    let text = [&case.text, &case.overrides.join("\n")].map(String::as_str).join("\n");
    let text = if tables.is_empty() { text } else { format!("{text}\n{tables:?}") };
    format!("{:016x}", checksum::of_text(text.as_bytes()))
}

/// The case of a run with the choice that `directory` stores for the same case and accuracy; `None`
/// if it stores none. Collective.
pub fn with_choice(world: &World, case: &Case, args: &RunArgs, directory: &Path) -> Option<Case> {
    let accuracy = args.accuracy.accuracy.or(case.accuracy)?;
    let of_file = || {
        let found = read_choice(&directory.join(CHOICE))?;
        let same = found.accuracy == accuracy && found.case == checksum_of(case);
        same.then_some(found)
    };
    let choice = world.group().of_first_rank(|| Ok(of_file())).ok()??;
    let set: Vec<String> = case.overrides.iter().cloned().chain(choice.settings).collect();
    let found = Case::parse(&case.name, &case.text, &set).ok()?.with_tables_of(case);
    let expected_error = choice.expected_error;
    Some(Case { accuracy: Some(accuracy), expected_error, ..found })
}

/// The choice in the file `path`, if a run wrote one there.
fn read_choice(path: &Path) -> Option<ChosenSetup> {
    serde_json::from_str(&disk::read_text(path).ok()?).ok()
}

/// Refuses to replace a file named [`CHOICE`] that no run wrote.
fn refuse_foreign(directory: &Path) -> Result<()> {
    let path = directory.join(CHOICE);
    if !path.exists() || read_choice(&path).is_some() {
        return Ok(());
    }
    let reason = format!(
        "it holds {CHOICE}, which no run wrote; --force replaces it, -o gives another directory"
    );
    Err(Error::Directory { path: directory.to_owned(), reason })
}

/// The case of a run. If it has an accuracy, [`advise`] chooses its settings, which are stored in
/// `directory`. Collective.
///
/// # Errors
/// As [`load_for_accuracy`]; if the directory cannot be written, or holds a foreign file.
pub fn choose(world: &World, case: Case, args: &RunArgs, directory: &Path) -> Result<Case> {
    if !args.force && args.accuracy.accuracy.or(case.accuracy).is_some() {
        world.group().on_first_rank(|| refuse_foreign(directory))?;
    }
    let found = with_accuracy(world, case.clone(), &args.changes, &args.accuracy)?;
    if let Some(accuracy) = found.accuracy {
        world.group().on_first_rank(|| {
            disk::make(directory)?;
            let path = directory.join(CHOICE);
            let text = serde_json::to_string_pretty(&ChosenSetup::new(&case, &found, accuracy));
            disk::write_text(&path, &(text.map_err(|e| disk::failure(&path, &e))? + "\n"))
        })?;
    }
    Ok(found)
}

/// Reads a case; if it has an accuracy, with the settings that [`advise`] chooses. Collective.
///
/// # Errors
/// As `load` and `with_accuracy`.
pub fn load_for_accuracy(world: &World, args: &CaseArgs, wanted: &AccuracyArgs) -> Result<Case> {
    with_accuracy(world, load(world, args)?, &args.changes, wanted)
}

/// `case`, which was loaded with `changes`. If `--accuracy` or `solver.accuracy` gives an accuracy,
/// [`advise`] chooses grid, degree, flux, interface and tolerance for it. The choice is printed.
/// Collective.
///
/// # Errors
/// As [`advise`]; [`Error::Input`] if `--set` gives a key that `advise` chooses, or if nothing is
/// advised.
fn with_accuracy(
    world: &World,
    case: Case,
    changes: &Changes,
    wanted: &AccuracyArgs,
) -> Result<Case> {
    let Some(accuracy) = wanted.accuracy.or(case.accuracy) else {
        return match wanted.budget {
            None => Ok(case),
            Some(_) => Err(Error::Input(
                "--budget is the time for the trial runs of an accuracy; --accuracy or \
                 solver.accuracy is missing"
                    .to_owned(),
            )),
        };
    };
    refuse_chosen_keys(&changes.set)?;
    let budget = wanted.budget.unwrap_or(DEFAULT_BUDGET).as_secs_f64();
    let advised = advise(world, &case, Request { accuracy, budget })?;
    let Some(entry) = advised.best_of(case.method) else {
        let why = advised.why_nothing(case.method);
        return Err(Error::Input(format!("{}: accuracy {accuracy:e}: {why}", case.name)));
    };
    if world.group().rank() == 0 {
        report(&format!("accuracy {accuracy:e}: {}", entry.summary()));
        let expensive = entry.seconds.filter(|seconds| *seconds > LONG_RUN * budget).map(|seconds| {
            format!(
                "the run is expected to take {}; a longer --budget tries more set-ups and may find \
                 a cheaper one",
                seconds_text(seconds)
            )
        });
        for warning in warnings(&case, std::slice::from_ref(entry)).into_iter().chain(expensive) {
            report(&format!("warning: {warning}"));
        }
    }
    let set: Vec<String> = case.overrides.iter().chain(&entry.settings).cloned().collect();
    let chosen = Case::parse(&case.name, &case.text, &set)?.with_tables_of(&case);
    Ok(Case { accuracy: Some(accuracy), expected_error: Some(entry.error), ..chosen })
}

/// Refuses `--set` of keys that an accuracy chooses.
fn refuse_chosen_keys(set: &[String]) -> Result<()> {
    let is_chosen = |key: &str| {
        let of_axis =
            key.starts_with("axis.") && [".cells", ".degree"].iter().any(|k| key.ends_with(k));
        of_axis
            || [
                "scheme.degree", "scheme.flux", "scheme.interface", "scheme.limiter",
                "solver.tolerance",
            ]
            .contains(&key)
    };
    let given = set.iter().map(|set| key_of(set));
    match given.into_iter().find(|key| is_chosen(key)) {
        Some(key) => Err(Error::Input(format!(
            "--set {key} beside --accuracy or solver.accuracy, which choose cells, degree, \
             flux, interface and tolerance: leave one of them out"
        ))),
        None => Ok(()),
    }
}
