//! The exact solution on a rank's share, where the case names one: at the end, and its moments at
//! every output time. Nothing else computes the exact density.

use crate::base::error::Result;
use crate::matrix::observables::{Moments, VelocityFactors};
use crate::matrix::sampling::{sample, sample_with};
use crate::parallel::communicator::Group;
use crate::problem::case::{Case, Exact};
use crate::problem::exact::Tracer;
use crate::problem::exact::sheet::exact_moments;
use crate::results::dataset::ExactSolution;
use crate::solve::place::Place;

/// The exact solution of a run on a rank's share.
#[derive(Default)]
pub struct ExactRun {
    /// At the end.
    pub exact: Option<ExactSolution>,
    /// Its moments at the output times before the end, then at the end.
    pub moments: Vec<Moments>,
}

/// The exact solution of a run of `case` on `place`; nothing where the case names none. Collective
/// over `world`.
///
/// # Errors
/// As [`exact_solution`], the same on all ranks.
pub fn exact_run(world: &Group, case: &Case, place: &Place) -> Result<ExactRun> {
    // Of a start from modes the data at the start are not known.
    let at_start = case.at_start.iter().filter(|_| case.start.is_none());
    let times = at_start.chain(&case.times).map(|time| time.time);
    let mut run = ExactRun::default();
    // One field at a time.
    for time in times.chain([case.end]) {
        let Some(exact) = world.agree(exact_at(world, case, place, time))? else {
            return Ok(run);
        };
        run.moments.push(moments_of(world, case, &exact));
        run.exact = (time == case.end).then_some(exact);
    }
    Ok(run)
}

/// The exact solution at `T` on `place`: `f` at cell centres, or moments as cell averages.
/// Collective over `world`.
///
/// # Errors
/// A formula or a start of a characteristic that is not finite.
pub fn exact_solution(world: &Group, case: &Case, place: &Place) -> Result<Option<ExactSolution>> {
    exact_at(world, case, place, case.end)
}

/// The same at a time up to `T`.
fn exact_at(world: &Group, case: &Case, place: &Place, time: f64) -> Result<Option<ExactSolution>> {
    let (space, block) = (&case.space, &place.block);
    Ok(match &case.exact {
        None => None,
        Some(Exact::Formula(f)) => {
            let all = sample(world, space, block, f, time)?;
            Some(ExactSolution::Field(all[place.mine.clone()].to_vec()))
        }
        Some(Exact::Characteristics) => {
            let ends_then = Case { end: time, ..case.clone() };
            if let Some(moments) = exact_moments(&ends_then)? {
                return Ok(Some(ExactSolution::Moments(moments.on(space, &place.share))));
            }
            let tracer = Tracer::new(case)?;
            let value = |point: &[f64; 6]| tracer.value(point, time);
            let exact = sample_with(space, block, &place.mine, value);
            if exact.iter().any(|f| !f.is_finite()) {
                let place = "where a characteristic of exact.kind = \"characteristics\" begins";
                return Err(case.fields[0].initial.undefined(f64::NAN, place.to_owned()));
            }
            Some(ExactSolution::Field(exact))
        }
    })
}

/// Exact density, momentum and mean velocity: of a field the sums over velocities that the run
/// takes of `f`; of measure-valued data averages over cells. Collective over `world`.
fn moments_of(world: &Group, case: &Case, exact: &ExactSolution) -> Moments {
    match exact {
        ExactSolution::Field(values) => {
            let factors = VelocityFactors::new(&case.space);
            let sums = factors.at_points(values);
            Moments::of_sums(world, case.space.dimension(), &factors, sums)
        }
        ExactSolution::Moments(exact) => Moments {
            density: exact.density.clone(),
            momentum: exact.momentum.clone(),
            velocity: exact.velocity.clone(),
            kinetic: Vec::new(),
        },
    }
}
