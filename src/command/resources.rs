//! `phasewarp resources`: the cost of the case on a quantum computer.

use crate::base::error::{Error, Result};
use crate::base::table::{ColumnValues, csv, tabular};
use crate::command::cli::{RecordFormat, ResourcesArgs};
use crate::command::loading::load;
use crate::command::printing::{print, print_json, print_unwrapped};
use crate::parallel::communicator::World;
use crate::quantum::optimise::ranking::Ranking;
use crate::quantum::purpose::CasePurpose;
use crate::study::end_to_end::EndToEnd;
use crate::study::quantum_setups::{compared, ranked};
use serde::Serialize;
use std::fmt::Display;

/// First line of a table in LaTeX.
const TEX_HEAD: &str = "% Written by phasewarp resources. x exact, g emitted gates (exact), \
                        b upper bound, m model or estimate";

/// Prints the counts of the cheapest set-up and of the case's own; with `--optimise` a ranking of
/// choices, with `--accuracy` the cost from end to end. Collective.
///
/// # Errors
/// As [`CasePurpose::refuse`], [`compared`], [`ranked`] and [`EndToEnd::new`]; [`Error::Input`] for
/// `--optimise` or `--accuracy` in a format that holds one choice.
pub fn execute(world: &World, args: &ResourcesArgs) -> Result<()> {
    let case = load(world, &args.case)?;
    let many = if args.optimise { "--optimise" } else { "--accuracy" };
    let one = matches!(args.format, RecordFormat::Azure | RecordFormat::Qref);
    if one && (args.optimise || args.accuracy.is_some()) {
        return Err(Error::Input(format!(
            "{many} compares many choices: --format text, json, csv and latex show them; azure and \
             qref hold only one"
        )));
    }
    CasePurpose::Counts.refuse(&case)?;
    let synthesis = args.t_of_rotation;
    if let Some(accuracy) = args.accuracy {
        let found = EndToEnd::new(world, &case, accuracy, synthesis)?;
        show(world, args.format, &found, EndToEnd::columns);
        return Ok(());
    }
    if args.optimise {
        show(world, args.format, &ranked(world, &case, synthesis)?, Ranking::columns);
        return Ok(());
    }
    let found = compared(world, &case, synthesis)?;
    match args.format {
        RecordFormat::Azure => print_json(world, &found.cheapest.logical_counts()),
        RecordFormat::Qref => print_json(world, &found.cheapest.qref()),
        format => show(world, format, &found, |found| found.costs().columns()),
    }
    Ok(())
}

/// Prints `found` as text or JSON, or its table.
fn show<T: Serialize + Display>(
    world: &World,
    format: RecordFormat,
    found: &T,
    columns: impl Fn(&T) -> Vec<ColumnValues>,
) {
    match format {
        RecordFormat::Csv => print_unwrapped(world, &csv(&columns(found))),
        RecordFormat::Latex => {
            let table = tabular(&columns(found), |_| String::new());
            print_unwrapped(world, &format!("{TEX_HEAD}\n{table}"));
        }
        RecordFormat::Json => print_json(world, found),
        RecordFormat::Text | RecordFormat::Azure | RecordFormat::Qref => {
            print(world, &found.to_string());
        }
    }
}
