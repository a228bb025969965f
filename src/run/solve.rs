//! From the discrete problem to the fields at `T`: by modes, or classically.

use super::Place;
use crate::case::{Case, Integrator};
use crate::classical::limiter::Reconstruction;
use crate::classical::{Classical, EXACT, duhamel_panels};
use crate::communicator::{Communicator, GhostExchange};
use crate::compare::Norms;
use crate::error::Result;
use crate::output::summary::Summary;
use crate::plan::{Plan, cost};
use crate::problem::Problem;
use crate::progress::Progress;
use crate::propagate::commutator_free::CommutatorFree;
use crate::propagate::{Evolution, Initial, Propagator, propagator};
use crate::warp;

/// What was solved for, on this rank's share.
pub(super) struct Solution {
    /// Every field at `T` by each reading: `[field][reading]`.
    pub fields: Vec<Vec<Vec<f64>>>,
    /// The first field by each reading of the plateau.
    pub plateau: Vec<Vec<f64>>,
}

/// Every field at `T`. Collective.
pub(super) fn solve(
    case: &Case,
    plan: &Plan,
    communicator: &Communicator,
    place: &Place,
    problem: &mut Problem,
    summary: &mut Summary,
) -> Result<Solution> {
    let speaks = communicator.world.rank() == 0;
    let Some(warp_plan) = &plan.warp else {
        let steps = plan.classical_steps;
        let stages = if case.integrator == Integrator::SspRk3 {
            3
        } else {
            1
        };
        let mut fields = Vec::new();
        for (k, start) in problem.states.iter().enumerate() {
            let slopes = Reconstruction::new(case, &problem.matrix, k);
            let slopes = communicator.world.agree(slopes)?;
            let progress = Progress::new(speaks, "steps", steps);
            let classical = Classical::of(case, &problem.matrix, &problem.weights.pi)
                .with_progress(progress)
                .with_slopes(slopes);
            let mut state = start.clone();
            let span = (plan.bounds.rate, case.end);
            let exchange = &mut problem.exchange;
            integrate(
                classical,
                exchange,
                case.integrator,
                span,
                steps,
                &mut state,
            );
            fields.push(vec![
                problem.unweighted(&place.mine, state[place.mine.clone()].to_vec()),
            ]);
        }
        summary.matvecs = stages * steps * problem.states.len();
        return Ok(Solution {
            fields,
            plateau: Vec::new(),
        });
    };
    let batches = &plan.layout.groups[communicator.modes.rank()];
    let cost = problem.states.len() * cost(batches);
    let mut progress = Progress::new(speaks, "modes", cost);
    let rows = problem.matrix.rows();
    let initial: Vec<Initial<'_>> = (problem.states.iter())
        .map(|state| Initial {
            state: &state[..rows],
            norm: problem.norm(communicator, state, false),
        })
        .collect();
    let made: Result<Box<dyn Propagator>> = match &problem.schedule {
        Some(schedule) => Ok(Box::new(CommutatorFree::new(
            &problem.matrix,
            warp_plan,
            schedule,
        ))),
        None => propagator(plan, warp_plan, &problem.matrix),
    };
    let mut propagator = communicator.world.agree(made)?;
    let mut system = Evolution {
        matrix: &problem.matrix,
        exchange: &mut problem.exchange,
        space: &communicator.space,
        rate: plan.bounds.rate,
        growth: plan.bounds.growth,
        time: case.end,
        terms: problem.terms,
    };
    let recovered = warp::streamed(
        communicator,
        &mut system,
        (warp_plan, &mut *propagator),
        batches,
        &initial,
        &place.ranges,
        &mut progress,
    )?;
    progress.finish();
    summary.unitarity_defect = recovered.unitarity_defect;
    summary.norm_kept = recovered.norm_kept;
    summary.matvecs = communicator.modes.sum_count(recovered.applications);
    summary.solves = communicator.modes.sum_count(recovered.solves);
    let busy = recovered.busy_seconds;
    summary.group_seconds = Some([-communicator.world.max(-busy), communicator.world.max(busy)]);
    let unweighted = |u: Vec<f64>| problem.unweighted(&place.mine, u);
    let fields: Vec<Vec<Vec<f64>>> = (recovered.fields.into_iter())
        .map(|readings| readings.into_iter().map(unweighted).collect())
        .collect();
    let step_errors = recovered.step_errors.into_iter().map(unweighted);
    let velocities = case.space.velocity_cells();
    summary.step_error = (fields.iter().zip(step_errors))
        .map(|(readings, error)| {
            let f = &readings[0];
            let world = &communicator.world;
            let norms = Norms {
                world,
                velocities,
                f,
            };
            (norms.square(&error) / norms.square(f)).sqrt()
        })
        .filter(|e| e.is_finite())
        .reduce(f64::max);
    summary.step_beyond = (fields.iter().zip(&recovered.step_beyond))
        .map(|(readings, beyond)| {
            let norms = Norms {
                world: &communicator.world,
                velocities,
                f: &readings[0],
            };
            beyond / norms.square(&readings[0]).sqrt()
        })
        .fold(0.0, f64::max);
    Ok(Solution {
        fields,
        plateau: recovered.plateau.into_iter().map(unweighted).collect(),
    })
}

/// `state ← state(time)` by the classical method. Collective over the space group.
pub(super) fn integrate(
    mut classical: Classical<'_>,
    exchange: &mut GhostExchange,
    integrator: Integrator,
    (rate, time): (f64, f64),
    steps: usize,
    state: &mut [f64],
) {
    match integrator {
        Integrator::Exponential if classical.varies() => {
            let panels = duhamel_panels(rate * time);
            classical.duhamel(exchange, state, (rate, time), panels);
        }
        Integrator::Exponential => classical.exponential(exchange, state, (rate, time), EXACT),
        _ => classical.steps(exchange, state, integrator, time, steps),
    }
}
