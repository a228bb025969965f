//! The classical run, without modes: `f' = A f + b` by explicit steps or by the exponential.

use crate::base::error::Result;
use crate::base::progress::Progress;
use crate::matrix::observables::VelocityFactors;
use crate::problem::legs::Leg;
use crate::propagate::classical::Classical;
use crate::propagate::limiter::Reconstruction;
use crate::results::summary::Summary;
use crate::run::history::history;
use crate::run::solved::SolvedFields;
use crate::solve::field_readings::{FieldHistory, FieldReadings};
use crate::solve::prepared::Prepared;

/// Integrates every field over all legs. Collective.
pub(crate) fn integrate_fields(
    prepared: &mut Prepared,
    prints: bool,
    summary: &mut Summary,
) -> Result<SolvedFields> {
    let Prepared { case, plan, communicator, rank_cells, system, .. } = prepared;
    let world = &communicator.world;
    let legs = Leg::all(case);
    let factors = VelocityFactors::new(&case.space);
    let (mut fields, mut early) = (Vec::new(), Vec::new());
    for (k, start) in system.states.iter().enumerate() {
        let slopes = world.agree(Reconstruction::new(case, &system.matrix, k))?;
        let progress = Progress::new(prints, "steps", plan.classical_steps);
        let mut classical = Classical::of(case, &system.matrix, &system.weights.pi)
            .with_progress(progress)
            .with_slopes(slopes);
        let mut state = start.clone();
        let mut times = Vec::new();
        let exchange = &mut system.exchange;
        classical.integrate_legs(exchange, case, &plan.bounds, &mut state, |leg, state| {
            times.push(if legs[leg].moments_only {
                let f = system.weights.own_field(&rank_cells.mine, state);
                factors.at_points(&f).flatten().collect()
            } else {
                state[rank_cells.mine.clone()].to_vec()
            });
        });
        let end = times.pop().unwrap_or_default();
        let field = system.weights.unweighted(&rank_cells.mine, end);
        fields.push(FieldReadings::single(field));
        early.push(FieldHistory { times });
    }
    summary.matvecs =
        case.classical.integrator.stages() * plan.classical_steps * system.states.len();
    summary.matvecs_here = summary.matvecs;
    let early = history(prepared, early);
    Ok(SolvedFields { fields, plateau: Vec::new(), early, warning: None })
}
