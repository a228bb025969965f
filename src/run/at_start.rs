//! The observables of the initial data on the grid.

use crate::matrix::observables::{CellVolumes, moments};
use crate::problem::potential::nodal_values;
use crate::results::dataset::EarlyResult;
use crate::solve::prepared::Prepared;

/// Moments and totals of the initial data; also the fields, if they are to be written. The system
/// drops its initial fields. None if the run starts from modes. Collective.
pub fn at_start(prepared: &mut Prepared) -> Option<EarlyResult> {
    if prepared.case.warped_start.is_some() {
        return None;
    }
    let initial = std::mem::take(&mut prepared.system.initial);
    let (world, case) = (&prepared.communicator.world, &prepared.case);
    let mine: Vec<&[f64]> =
        (initial.iter()).map(|field| &field[prepared.rank_cells.mine.clone()]).collect();
    let share = &prepared.rank_cells.share;
    let moments = moments(world, case, share, &mine);
    let volumes = CellVolumes::new(&case.space, share);
    let totals = volumes.totals(world, &moments, &nodal_values(case, share));
    let fields = if case.output.at_start.is_some_and(|start| start.fields) {
        mine.iter().map(|field| field.to_vec()).collect()
    } else {
        Vec::new()
    };
    Some(EarlyResult { time: case.start_time, moments, totals, fields })
}
