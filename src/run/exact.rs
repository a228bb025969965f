//! The exact solution on a rank's share, where the case names one: at the end, and its moments at
//! every output time. Nothing else computes the exact density.

pub mod solution;
pub mod velocities;

use crate::base::error::Result;
use crate::matrix::observables::{Moments, VelocityFactors};
use crate::matrix::sampling::{sample, sample_with};
use crate::parallel::communicator::Group;
use crate::parallel::partition::split;
use crate::problem::case::{Case, Exact};
use crate::problem::exact::sheet::exact_moments;
use crate::problem::grid::{PhaseSpace, averaged, describe_point};
use crate::results::dataset::ExactSolution;
use crate::run::exact::solution::Exactly;
use crate::run::exact::velocities::VelocityIntegrals;
use crate::solve::place::Place;

/// The exact density is averaged over at most so many points of phase space, where the cells
/// themselves are no more.
pub const MOST_POINTS: usize = 200_000;
/// A cell is cut into at most so many parts along an axis for that average.
const MOST_PARTS: usize = 8;

/// The exact solution of a run on a rank's share.
#[derive(Default)]
pub struct ExactRun {
    /// At the end.
    pub exact: Option<ExactSolution>,
    /// Moments at the output times before the end, then at the end.
    pub moments: Vec<Moments>,
}

/// The exact solution of a run of `case` on `place`; nothing where the case names none. Collective
/// over `world`.
///
/// # Errors
/// A formula or a start of a characteristic that is not finite, the same on all ranks.
pub fn exact_run(world: &Group, case: &Case, place: &Place) -> Result<ExactRun> {
    // Of a start from modes the data at the start are not known.
    let at_start = case.at_start.iter().filter(|_| case.start.is_none());
    let times = at_start.chain(&case.times).map(|time| time.time);
    let mut run = ExactRun::default();
    let mut exactly = None;
    // One field at a time.
    for time in times.chain([case.end]) {
        let exact = exact_at(world, case, place, time, &mut exactly);
        let Some(exact) = world.agree(exact)? else {
            return Ok(run);
        };
        run.moments.push(moments_of(world, case, place, time, &exact, exactly.as_ref()));
        run.exact = (time == case.end).then_some(exact);
    }
    Ok(run)
}

/// The exact solution at a time on `place`: `f` at cell centres, or moments as cell averages.
/// `exactly` is that of all times, made where `f` needs it and it is missing. Collective over
/// `world`.
fn exact_at<'a>(
    world: &Group,
    case: &'a Case,
    place: &Place,
    time: f64,
    exactly: &mut Option<Exactly<'a>>,
) -> Result<Option<ExactSolution>> {
    let space = &case.space;
    let Some(exact) = &case.exact else { return Ok(None) };
    if matches!(exact, Exact::Characteristics)
        && let Some(moments) = exact_moments(&Case { end: time, ..case.clone() })?
    {
        return Ok(Some(ExactSolution::Moments(moments.on(space, &place.share))));
    }
    let exactly = match exactly {
        Some(exactly) => &*exactly,
        None => exactly.insert(Exactly::on_one_rank(case, exact)?),
    };
    if let Exact::Formula(f) = exact {
        let values = sample(world, space, &place.part(), f, time)?;
        return Ok(Some(ExactSolution::Field(values)));
    }
    let values = sample_with(space, &place.part(), |points| exactly.values_at(points, time));
    if values.iter().any(|f| !f.is_finite()) {
        let place = "where a characteristic of exact.kind = \"characteristics\" begins";
        return Err(case.fields[0].initial.undefined(f64::NAN, place.to_owned()));
    }
    Ok(Some(ExactSolution::Field(values)))
}

/// Exact density, momentum, mean velocity and kinetic energy at a time on `place`. In one dimension
/// integrals over the velocities, of degree 0 averaged over cells of space; in more the sums over
/// velocities that the run takes of `f`; of measure-valued data averages over cells. Collective.
fn moments_of(
    world: &Group,
    case: &Case,
    place: &Place,
    time: f64,
    exact: &ExactSolution,
    exactly: Option<&Exactly<'_>>,
) -> Moments {
    match exact {
        ExactSolution::Field(values) => {
            let integrals = exactly.and_then(|e| VelocityIntegrals::new(e, case, time));
            if let Some(integrals) = integrals {
                let found = integrals.on_axis(world, &case.space.x[0], place.share[0].clone());
                return Moments::new(world, 1, found.into_iter());
            }
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

/// Averages of the exact density at the end over the space cells of `case`, on all ranks. In more
/// than one dimension `f` is taken at the centres of parts of each cell. Collective.
///
/// # Errors
/// Where the exact solution is not finite.
pub fn averaged_density(group: &Group, case: &Case, exact: &Exact) -> Result<Vec<f64>> {
    if let Some(moments) = group.agree(exact_moments(case))? {
        return Ok(moments.density);
    }
    if case.space.dimension() == 1 && case.space.degree() == 0 {
        return density_on_axis(group, case, exact);
    }
    let axes = 2 * case.space.dimension() as u32;
    let fits = |&parts: &usize| case.space.cells().saturating_mul(parts.pow(axes)) <= MOST_POINTS;
    let parts = (1..=MOST_PARTS).rev().find(fits).unwrap_or(1);
    let shape: Vec<usize> = case.space.elements().iter().map(|n| n * parts).collect();
    let fine = Case { space: case.space.with_elements(&shape), ..case.clone() };
    let exactly = Exactly::new(group, &fine, exact)?;
    let space = &fine.space;
    let velocities = space.velocity_cells();
    let mut failure = None;
    let mut density = vec![0.0; space.space_cells()];
    for point in split(&(0..density.len()), group.size(), group.rank()) {
        let cells = point * velocities..(point + 1) * velocities;
        let points: Vec<[f64; 6]> = cells.map(|cell| space.point(&space.cell(cell))).collect();
        for (f, at) in exactly.values_at(&points, case.end).into_iter().zip(points) {
            if !f.is_finite() && failure.is_none() {
                let formula = match exact {
                    Exact::Formula(formula) => formula,
                    Exact::Characteristics => &case.fields[0].initial,
                };
                failure = Some(formula.undefined(f, describe_point(space.dimension(), &at)));
            }
            density[point] += f * space.velocity_volume();
        }
    }
    group.agree(failure.map_or(Ok(()), Err))?;
    let cells = |space: &PhaseSpace| space.x.iter().map(|a| a.cells).collect::<Vec<_>>();
    Ok(averaged(&group.gathered(&density), &cells(space), &cells(&case.space)))
}

/// The same of cells in one dimension, by integrals over the velocities. Collective.
fn density_on_axis(group: &Group, case: &Case, exact: &Exact) -> Result<Vec<f64>> {
    let exactly = Exactly::new(group, case, exact)?;
    let axis = &case.space.x[0];
    let mine = split(&(0..axis.cells), group.size(), group.rank());
    let mut density = vec![0.0; axis.cells];
    if let Some(integrals) = VelocityIntegrals::new(&exactly, case, case.end) {
        let found = integrals.on_axis(group, axis, mine.clone());
        density[mine].iter_mut().zip(found).for_each(|(density, moments)| *density = moments[0]);
    }
    let failure = match (density.iter().find(|density| !density.is_finite()), exact) {
        (None, _) => Ok(()),
        (Some(value), Exact::Formula(formula)) => Err((formula, *value)),
        (Some(value), Exact::Characteristics) => Err((&case.fields[0].initial, *value)),
    };
    let place = "where it is integrated over the velocities".to_owned();
    group.agree(failure.map_err(|(formula, value)| formula.undefined(value, place)))?;
    Ok(group.gathered(&density))
}
