//! The settings that [`advise`] chooses for an accuracy, and the file that stores them beside the
//! results of a run.

use crate::base::error::{Error, Result};
use crate::base::log::eprint_wrapped;
use crate::base::text::seconds_text;
use crate::base::{checksum, disk};
use crate::parallel::communicator::World;
use crate::problem::case::{Case, StudySettings};
use crate::results::chosen_setup::{self, ChosenSetup};
use crate::study::advise::report::warnings;
use crate::study::advise::setups::SetupReport;
use crate::study::advise::{AdviceRequest, advise};
use std::path::Path;

/// A run that is expected to take more than this multiple of the budget gives a warning.
const LONG_RUN: f64 = 10.0;

/// Checksum of the text, the options and the table files that a case was read from.
fn checksum_of(case: &Case) -> String {
    let tables: Vec<Option<u64>> = case.tables.iter().map(|file| file.checksum).collect();
    let text = [&case.text, &case.overrides.join("\n")].map(String::as_str).join("\n");
    let text = if tables.is_empty() { text } else { format!("{text}\n{tables:?}") };
    checksum::text(checksum::of_text(text.as_bytes()))
}

/// `case` with the settings that `directory` stores for it and `accuracy`; `None` if it stores
/// none. Collective.
pub fn stored(world: &World, case: &Case, accuracy: f64, directory: &Path) -> Option<Case> {
    let same = |of: &ChosenSetup| of.accuracy == accuracy && of.case == checksum_of(case);
    let of_file = || Ok(ChosenSetup::read(directory).filter(same));
    let choice = world.group().of_first_rank(of_file).ok()??;
    let found = case.with_settings(choice.settings).ok()?;
    Some(with_accuracy(found, accuracy, choice.expected_error))
}

/// What identifies a case before its settings are chosen.
pub struct CaseBefore {
    checksum: String,
    /// Number of its `--set` options.
    options: usize,
}

impl CaseBefore {
    /// The checksum and the number of options of `case`.
    pub fn new(case: &Case) -> Self {
        Self { checksum: checksum_of(case), options: case.overrides.len() }
    }

    /// The settings that turned it into the case `found`, to be stored beside the results; `None`
    /// if `found` has no accuracy.
    pub fn choice(self, found: &Case) -> Option<ChosenSetup> {
        Some(ChosenSetup {
            accuracy: found.accuracy?,
            expected_error: found.study.expected_error,
            case: self.checksum,
            // The options that were appended.
            settings: found.overrides[self.options..].to_vec(),
        })
    }
}

/// Refuses a directory with an `accuracy.json` that no run wrote. Collective.
///
/// # Errors
/// [`Error::Directory`], the same on all ranks.
pub fn refuse_foreign(world: &World, directory: &Path) -> Result<()> {
    world.group().on_first_rank(|| {
        if !directory.join(chosen_setup::NAME).exists() || ChosenSetup::read(directory).is_some() {
            return Ok(());
        }
        Err(disk::not_replaced(directory, &format!("{}, which no run wrote", chosen_setup::NAME)))
    })
}

/// `case` with the grid, degree, flux, interface and tolerance that [`advise`] chooses for
/// `request`. The choice is reported. Collective.
///
/// # Errors
/// As [`advise`]; [`Error::Input`] if nothing is advised, or only what takes
/// [`too_long`](SetupReport::too_long).
pub fn chosen(world: &World, case: &Case, request: AdviceRequest) -> Result<Case> {
    let AdviceRequest { accuracy, budget, .. } = request;
    let advised = advise(world, case, request)?;
    let Some(entry) = advised.best_of(case.method) else {
        let why = advised.why_nothing(case.method);
        return Err(Error::Input(format!("{}: accuracy {accuracy:e}: {why}", case.name)));
    };
    if let Some(why) = entry.too_long(budget) {
        return Err(Error::Input(format!("{}: accuracy {accuracy:e}: {why}", case.name)));
    }
    if world.group().is_first() {
        eprint_wrapped(&format!("accuracy {accuracy:e}: {}", entry.summary()));
        let of_advice = warnings(case, std::slice::from_ref(entry), request.clock);
        for warning in of_advice.into_iter().chain(expensive(entry, budget)) {
            eprint_wrapped(&format!("warning: {warning}"));
        }
    }
    let chosen = case.with_settings(entry.settings.iter().cloned())?;
    Ok(with_accuracy(chosen, accuracy, Some(entry.error)))
}

/// The case `chosen` for an `accuracy`, on whose grid the trials expect an error.
fn with_accuracy(chosen: Case, accuracy: f64, expected_error: Option<f64>) -> Case {
    let study = StudySettings { expected_error, ..chosen.study };
    Case { accuracy: Some(accuracy), study, ..chosen }
}

/// A warning of a run that takes long beside the `budget` of its trials, in seconds.
fn expensive(entry: &SetupReport, budget: f64) -> Option<String> {
    let seconds = entry.seconds.filter(|seconds| *seconds > LONG_RUN * budget)?;
    Some(format!(
        "the run is expected to take {}; a longer --budget tries more set-ups and may find a \
         cheaper one",
        seconds_text(seconds)
    ))
}
