//! The classical steps of a run for a part of the time.

use crate::base::error::Result;
use crate::problem::case::Case;
use crate::propagate::classical::{Classical, classical_steps};
use crate::propagate::limiter::Reconstruction;
use crate::solve::prepared::Prepared;
use crate::study::calibrate::timing::{PARTS, SolveTime, TimedWork, line};
use std::time::Instant;

/// Predicted seconds of the classical steps of all fields on the block of `prepared`, by the
/// integrator of `case`. Collective.
///
/// # Errors
/// As [`Reconstruction::new`].
pub fn predict_solve_time(prepared: &mut Prepared, case: &Case) -> Result<SolveTime> {
    let Prepared { plan, communicator, system, .. } = prepared;
    let world = &communicator.world;
    let fields = case.fields.len();
    let steps = |case: &Case| classical_steps(case, &plan.bounds).iter().sum::<usize>() * fields;
    let mut trial = |part: usize| -> Result<TimedWork> {
        let shortened = cut_in_time(case, part);
        world.barrier();
        let started = Instant::now();
        for (k, start) in system.states.iter().enumerate() {
            let slopes = world.agree(Reconstruction::new(case, &system.matrix, k))?;
            let mut classical =
                Classical::of(case, &system.matrix, &system.weights.pi).with_slopes(slopes);
            let mut state = start.clone();
            let (exchange, nothing) = (&mut system.exchange, |_: usize, _: &[f64]| ());
            classical.integrate_legs(exchange, &shortened, &plan.bounds, &mut state, nothing);
        }
        let seconds = world.max(started.elapsed().as_secs_f64());
        Ok(TimedWork { seconds, cost: steps(&shortened) as f64 })
    };
    let line = line(&mut trial)?;
    let application = line.rate / case.classical.integrator.stages() as f64;
    Ok(SolveTime { solve: line.fixed + line.rate * steps(case) as f64, application })
}

/// `case` with every leg cut down to `part` of [`PARTS`] equal parts.
fn cut_in_time(case: &Case, part: usize) -> Case {
    let fraction = part as f64 / PARTS as f64;
    let mut case = case.clone();
    let begin = case.start_time;
    let cut = |time: &mut f64| *time = begin + (*time - begin) * fraction;
    cut(&mut case.end);
    case.output.times.iter_mut().for_each(|at| cut(&mut at.time));
    case
}
