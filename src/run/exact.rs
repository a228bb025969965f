//! The exact solution on a rank's share, where the case names one: at the end, and its moments at
//! every output time. Nothing else computes the exact density.

use crate::base::error::Result;
use crate::matrix::observables::{Moments, VelocityFactors};
use crate::matrix::sampling::{sample, sample_with};
use crate::parallel::communicator::Group;
use crate::parallel::partition::split;
use crate::problem::case::{Case, Exact};
use crate::problem::exact::Tracer;
use crate::problem::exact::sheet::exact_moments;
use crate::problem::formula::Expression;
use crate::problem::grid::{PhaseSpace, averaged, describe_point};
use crate::results::dataset::ExactSolution;
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
    let mut tracer = None;
    // One field at a time.
    for time in times.chain([case.end]) {
        let exact = exact_at(world, case, place, time, &mut tracer);
        let Some(exact) = world.agree(exact)? else {
            return Ok(run);
        };
        run.moments.push(moments_of(world, case, &exact));
        run.exact = (time == case.end).then_some(exact);
    }
    Ok(run)
}

/// The exact solution at a time on `place`: `f` at cell centres, or moments as cell averages.
/// `tracer` is that of all times, made where it is missing. Collective over `world`.
fn exact_at<'a>(
    world: &Group,
    case: &'a Case,
    place: &Place,
    time: f64,
    tracer: &mut Option<Tracer<'a>>,
) -> Result<Option<ExactSolution>> {
    let space = &case.space;
    Ok(match &case.exact {
        None => None,
        Some(Exact::Formula(f)) => {
            Some(ExactSolution::Field(sample(world, space, &place.part(), f, time)?))
        }
        Some(Exact::Characteristics) => {
            let ends_then = Case { end: time, ..case.clone() };
            if let Some(moments) = exact_moments(&ends_then)? {
                return Ok(Some(ExactSolution::Moments(moments.on(space, &place.share))));
            }
            let tracer = match tracer {
                Some(tracer) => &*tracer,
                None => tracer.insert(Tracer::new(case)?),
            };
            let exact = sample_with(space, &place.part(), |points| tracer.values(points, time));
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

/// The exact solution at the end of a case, at any points.
pub struct Exactly<'a> {
    formula: Option<&'a Expression>,
    tracer: Option<Tracer<'a>>,
    end: f64,
}

impl<'a> Exactly<'a> {
    /// The solution of `case` that `exact` names. Collective.
    ///
    /// # Errors
    /// Where `V` is not finite.
    pub fn new(world: &Group, case: &'a Case, exact: &'a Exact) -> Result<Self> {
        let (formula, tracer) = match exact {
            Exact::Characteristics => (None, Some(Tracer::new(case))),
            Exact::Formula(formula) => (Some(formula), None),
        };
        Ok(Self { formula, tracer: world.agree(tracer.transpose())?, end: case.end })
    }

    /// The values of the solution at `points`.
    pub fn values(&self, points: &[[f64; 6]]) -> Vec<f64> {
        let traced = self.tracer.as_ref().map(|tracer| tracer.values(points, self.end));
        let given = || self.formula.map(|formula| formula.at_points(points, self.end));
        traced.or_else(given).unwrap_or_default()
    }
}

/// Averages of the exact density at the end over the space cells of `case`, on all ranks. `f` is
/// taken at the centres of parts of each cell: the error of `f(0)` at the centres of cells is the
/// discretisation's. Collective.
///
/// # Errors
/// Where the exact solution is not finite.
pub fn averaged_density(group: &Group, case: &Case, exact: &Exact) -> Result<Vec<f64>> {
    if let Some(moments) = group.agree(exact_moments(case))? {
        return Ok(moments.density);
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
        for (f, at) in exactly.values(&points).into_iter().zip(points) {
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
