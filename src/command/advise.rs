//! `phasewarp advise`: grid and set-up for an accuracy.

use crate::base::error::Result;
use crate::command::cli::AdviseArgs;
use crate::command::loading::load;
use crate::command::printing::print_as;
use crate::parallel::communicator::World;
use crate::study::advise::{AdviceRequest, advise};

/// Prints the advice. Collective.
///
/// # Errors
/// As [`advise`].
pub fn execute(world: &World, args: &AdviseArgs) -> Result<()> {
    let case = load(world, &args.case)?;
    let wanted = AdviceRequest {
        accuracy: args.accuracy,
        budget: args.budget.as_secs_f64(),
        clock: args.clock.chosen(),
    };
    print_as(world, &advise(world, &case, wanted)?, args.json);
    Ok(())
}
