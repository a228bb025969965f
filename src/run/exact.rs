//! The exact solution on a rank's share, if the case names one: at the end, and its moments at
//! every output time or at the end only (`exact.moments`). All exact densities are computed here.

pub mod sheets;
pub mod solution;
pub mod velocities;

use crate::base::error::{Error, Result};
use crate::base::log::eprint_wrapped;
use crate::base::progress::Progress;
use crate::matrix::observables::{Moments, VelocityFactors};
use crate::matrix::sampling::{sample, sample_with};
use crate::parallel::communicator::Group;
use crate::problem::case::{Case, Exact};
use crate::problem::exact::sheet::sums::ExactMoments;
use crate::problem::grid::{Axis, PhaseSpace, box_cells};
use crate::results::dataset::ExactSolution;
use crate::run::exact::sheets::exact_moments;
use crate::run::exact::solution::ExactValues;
use crate::run::exact::velocities::VelocityIntegrals;
use crate::run::exact::velocities::limits::max_points_per_integral;
use crate::solve::rank_cells::RankCells;
use std::ops::Range;
use std::time::{Duration, Instant};

/// The exact solution of a run on a rank's share.
#[derive(Default)]
pub struct ExactRun {
    /// The exact solution at the end.
    pub exact: Option<ExactSolution>,
    /// Moments at the output times before the end, if they are wanted there, then at the end.
    pub moments: Vec<Moments>,
    /// Estimates of the errors of the density at the end, if it is integrated over velocities.
    pub density_errors: Vec<f64>,
}

/// The exact solution at a time on a rank's share.
struct AtTime {
    exact: ExactSolution,
    moments: Moments,
    density_errors: Vec<f64>,
}

/// The times at which the exact solution of `case` is computed, the end last.
fn times(case: &Case) -> Vec<f64> {
    // If the run starts from modes, the data at the start are not known.
    let at_start = case.output.at_start.iter().filter(|_| case.warped_start.is_none());
    let earlier = at_start.chain(&case.output.times).filter(|_| case.has_exact_history());
    earlier.map(|time| time.time).chain([case.end]).collect()
}

/// The computation of the exact solution of a run.
#[derive(Clone, Copy)]
pub struct ExactTask<'a> {
    /// The group of all ranks.
    pub world: &'a Group,
    /// The case on the grid of the results.
    pub case: &'a Case,
    /// The part of this rank in that grid.
    pub rank_cells: &'a RankCells,
    /// Whether this rank reports if it takes long.
    pub prints: bool,
    /// The start of the program, and the wall time that it may take.
    pub wall: Option<(Instant, Duration)>,
}

impl ExactTask<'_> {
    /// The exact solution; empty if the case names none. Collective.
    ///
    /// # Errors
    /// A formula or a start of a characteristic that is not finite, or [`Error::WallTime`], the
    /// same on all ranks.
    pub fn run(&self) -> Result<ExactRun> {
        let Self { world, case, rank_cells, prints, .. } = *self;
        let mut run = ExactRun::default();
        let Some(exact) = &case.exact else { return Ok(run) };
        let times = times(case);
        let mut watch = ExactWatch::new(prints, times.len(), ExactWork::of(case, rank_cells));
        let by_sheet = case.is_measure_valued() && matches!(exact, Exact::Characteristics);
        let values = || ExactValues::new(world, case, exact).map(|values| values.until(self.wall));
        let values_of = if by_sheet { None } else { Some(values()?) };
        for time in times {
            let found = match &values_of {
                Some(values_of) => self.at_time(time, values_of, &mut watch)?,
                None => self.moments_of_sheet(time)?,
            };
            world.agree(self.in_time())?;
            run.moments.push(found.moments);
            if time == case.end {
                (run.exact, run.density_errors) = (Some(found.exact), found.density_errors);
            }
            watch.advance();
        }
        watch.progress.finish();
        Ok(run)
    }

    /// An error if the wall time is over on this rank.
    fn in_time(&self) -> Result<()> {
        let Some((_, wall)) = self.wall.filter(|(start, wall)| start.elapsed() >= *wall) else {
            return Ok(());
        };
        let at_end = match times(self.case).len() {
            1 => "",
            _ => "exact.moments = \"end\" computes it at time.end only; ",
        };
        Err(Error::WallTime {
            seconds: wall.as_secs_f64(),
            why: format!(
                "set-up and the exact solution, which come before the modes, take longer; \
                 {at_end}{WITHOUT_EXACT_SOLUTION}"
            ),
        })
    }

    /// The exact moments of measure-valued data at a time, as averages over cells. Collective.
    fn moments_of_sheet(&self, time: f64) -> Result<AtTime> {
        let case = Case { end: time, ..self.case.clone() };
        let ExactMoments { density, momentum, velocity, curve } =
            exact_moments(self.world, &case, &self.rank_cells.share)?;
        Ok(AtTime {
            exact: ExactSolution::Measure { curve },
            moments: Moments { density, momentum, velocity, kinetic: Vec::new() },
            density_errors: Vec::new(),
        })
    }

    /// The exact solution at a time: `f` at cell centres, and its moments. These are integrals over
    /// the velocities, averaged over cells of degree 0; or sums over the velocities of the grid, if
    /// these are accurate enough. `watch` reports the progress. Collective.
    fn at_time(
        &self,
        time: f64,
        values_of: &ExactValues<'_>,
        watch: &mut ExactWatch,
    ) -> Result<AtTime> {
        /// Cells of space between which the progress is reported.
        const CELLS_AT_ONCE: usize = 64;
        let Self { world, case, rank_cells, .. } = *self;
        let space = &case.space;
        let values = match values_of {
            ExactValues::Given(f) => sample(world, space, &rank_cells.part(), f, time),
            ExactValues::Traced { .. } => {
                let at_points = |points: &[[f64; 6]]| {
                    watch.progress.advance(points.len());
                    values_of.values_at(points, time)
                };
                let values = sample_with(space, &rank_cells.part(), at_points);
                if values.iter().all(|f| f.is_finite()) {
                    self.in_time().map(|()| values)
                } else {
                    let place = "where a characteristic of exact.kind = \"characteristics\" begins";
                    Err(case.fields[0].initial.undefined(f64::NAN, place.to_owned()))
                }
            }
        };
        let values = world.agree(values)?;
        let integrals = VelocityIntegrals::on_grid(world, values_of, case, time);
        let (moments, density_errors) = match integrals.grid_error() {
            Some(error) => {
                let factors = VelocityFactors::new(space);
                let moments = Moments::of_sums(world, &factors, factors.at_points(&values));
                let errors = vec![error; moments.density.len()];
                (moments, errors)
            }
            None => {
                let mut found = Vec::new();
                let cells: Vec<_> = box_cells(&rank_cells.share).collect();
                for cells in cells.chunks(CELLS_AT_ONCE) {
                    if self.in_time().is_err() {
                        break;
                    }
                    found.extend(integrals.on_cells(case, cells));
                    watch.progress.advance(cells.len() * watch.work.integral);
                }
                world.agree(self.in_time())?;
                let errors = found.iter().map(|integral| integral.error).collect();
                let moments = found.into_iter().map(|integral| integral.moments);
                (Moments::new(world, space.dimension(), moments), errors)
            }
        };
        Ok(AtTime { exact: ExactSolution::Field(values), moments, density_errors })
    }
}

/// What a rank computes at a time, in values of the exact solution.
#[derive(Clone, Copy)]
struct ExactWork {
    /// Values at the rank's cells.
    values: usize,
    /// Cells of space at which the density is integrated.
    places: usize,
    /// About the number of values of one integral.
    integral: usize,
}

impl ExactWork {
    fn of(case: &Case, rank_cells: &RankCells) -> Self {
        let places = rank_cells.share.iter().map(Range::len).product();
        let integral = max_points_per_integral(case, case.space.space_cells() as f64) as usize;
        Self { values: rank_cells.part().cells.len(), places, integral }
    }

    /// All values.
    fn sum(&self) -> usize {
        self.values + self.places * self.integral
    }
}

/// What helps where the exact solution, or the errors against it, take long.
pub(crate) const WITHOUT_EXACT_SOLUTION: &str =
    "--set exact={} leaves out the exact solution and the errors measured against it";

/// Reports the progress of the exact solution, and once a warning if it takes long.
struct ExactWatch {
    progress: Progress,
    /// Whether no warning is reported, or none any more.
    silent: bool,
    /// Number of times at which the exact solution is wanted.
    all: usize,
    /// Number of times at which the exact solution is computed.
    done: usize,
    /// What is computed at a time.
    work: ExactWork,
    started: Instant,
}

impl ExactWatch {
    fn new(prints: bool, all: usize, work: ExactWork) -> Self {
        let progress = Progress::new(prints, "exact solution", all * work.sum())
            .with_remedy(WITHOUT_EXACT_SOLUTION);
        Self { progress, silent: !prints, all, done: 0, work, started: Instant::now() }
    }

    /// Counts a time as done.
    fn advance(&mut self) {
        self.done += 1;
        self.progress.advance_to(self.done * self.work.sum());
        if self.silent {
            return;
        }
        let seconds = self.started.elapsed().as_secs_f64();
        if let Some(line) = slowness(self.all, self.done, seconds) {
            eprint_wrapped(&line);
            self.silent = true;
        }
    }
}

/// A warning that the exact solution takes long; `None` if it does not, or cannot be left out. It
/// is for `all` times, of which the first `done` took `seconds`.
fn slowness(all: usize, done: usize, seconds: f64) -> Option<String> {
    /// The shortest time in seconds from which the whole time is extrapolated.
    const SHORTEST: f64 = 1.0;
    const LONG: f64 = 10.0;
    let expected = seconds * all as f64 / done as f64;
    (done < all && seconds >= SHORTEST && expected >= LONG).then(|| {
        format!(
            "the exact moments at {all} times take about {expected:.0} s in all; with \
             exact.moments = \"end\" they are computed at time.end only"
        )
    })
}

/// The exact density at the end, averaged over equal cells of space, as many as `case` has. The
/// same on all ranks. Collective.
///
/// # Errors
/// If the exact solution is not finite.
pub fn averaged_density(group: &Group, case: &Case, exact: &Exact) -> Result<Vec<f64>> {
    let mut share = case.space.space_ranges();
    share[0] = group.piece_of(&share[0]);
    if case.is_measure_valued() {
        let moments = exact_moments(group, case, &share)?;
        // The share is a range of the row-major cells.
        let layer = case.space.space_cells() / case.space.x[0].cells;
        let mut density = vec![0.0; case.space.space_cells()];
        density[share[0].start * layer..share[0].end * layer].copy_from_slice(&moments.density);
        return Ok(group.gathered(density));
    }
    let values_of = ExactValues::new(group, case, exact)?;
    let equal = |axis: &Axis| match axis.nodes.degree {
        0 => axis.clone(),
        _ => Axis::new(axis.lower, axis.upper, axis.cells),
    };
    let x = case.space.x.iter().map(equal).collect();
    let case = Case { space: PhaseSpace { x, ..case.space.clone() }, ..case.clone() };
    let integrals = VelocityIntegrals::on_grid(group, &values_of, &case, case.end);
    let cells: Vec<_> = box_cells(&case.space.space_ranges()).collect();
    let mine = group.piece_of(&(0..cells.len()));
    let mut density = vec![0.0; cells.len()];
    let found = integrals.on_cells(&case, &cells[mine.clone()]);
    for (density, integral) in density[mine].iter_mut().zip(found) {
        *density = integral.moments[0];
    }
    let failure = match (density.iter().find(|density| !density.is_finite()), exact) {
        (None, _) => Ok(()),
        (Some(value), Exact::Formula(formula)) => Err((formula, *value)),
        (Some(value), Exact::Characteristics) => Err((&case.fields[0].initial, *value)),
    };
    let place = "where it is integrated over the velocities".to_owned();
    group.agree(failure.map_err(|(formula, value)| formula.undefined(value, place)))?;
    Ok(group.gathered(density))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The note about slow exact moments has their seconds and the key that leaves them out.
    #[test]
    fn long_exact_solutions_name_their_key() {
        let line = slowness(1000, 20, 1.8).expect("90 s are long");
        assert!(line.contains("1000 times take about 90 s"), "{line}");
        assert!(line.contains("exact.moments = \"end\""), "{line}");
        // Too early to tell; short; nothing that could be left out; the last time.
        for (all, done, seconds) in [(1000, 1, 0.5), (1000, 200, 1.8), (1, 1, 30.0), (9, 9, 30.0)] {
            assert_eq!(slowness(all, done, seconds), None, "{all} {done} {seconds}");
        }
    }
}
