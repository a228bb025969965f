//! `phasewarp check` and `phasewarp check-result`: cases and results without solving anything.

use crate::base::error::Result;
use crate::command::cli::{CheckArgs, CheckResultArgs};
use crate::command::describe::describe;
use crate::command::loading::{load_for_accuracy, reduced_case};
use crate::command::printing::print;
use crate::matrix::bounds::Bounds;
use crate::parallel::communicator::World;
use crate::plan::here::refuse_hopeless_here;
use crate::plan::layout::Resources;
use crate::results::readback;
use crate::results::shown::Shown;
use crate::run::{ledger, planning, warnings};

/// Prints the case as it was read, and warnings about it. Collective.
///
/// # Errors
/// As [`planning::plan`].
pub fn execute(world: &World, args: &CheckArgs) -> Result<()> {
    let case = reduced_case(world, &load_for_accuracy(world, &args.case, &args.accuracy)?)?;
    refuse_hopeless_here(world, &case)?;
    let bounds = Bounds::new(&case)?;
    let resources = Resources { ranks: world.group().size(), ..Resources::default() };
    // Where the grid is small enough, planning finds formulas that are not finite and tolerances
    // that cannot be met.
    let preview = planning::preview(world, &case, &resources)?;
    print(world, &describe(&case, &bounds));
    let mut ledger = ledger::foreseen(&world.group(), &Shown::new(&case).case)?;
    ledger.mass.initial = preview.at_start.map(|totals| totals.mass);
    print(world, &ledger.text());
    let planned = preview.plan.warp.map_or(Vec::new(), |w| w.warnings);
    let found = [warnings::warnings(&case), planned, ledger.warnings()].concat();
    for warning in &found {
        print(world, &format!("warning: {warning}"));
    }
    Ok(())
}

/// Compares the datasets of a run with their checksums. Collective.
///
/// # Errors
/// As [`readback::check_result`].
pub fn execute_on_result(world: &World, args: &CheckResultArgs) -> Result<()> {
    for (path, datasets) in readback::check_result(&world.group(), &args.directory)? {
        print(world, &format!("{}: {datasets} datasets as written", path.display()));
    }
    Ok(())
}
