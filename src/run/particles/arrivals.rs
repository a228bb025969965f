//! Errors of a run that particles of the exact flow show.
//!
//! An estimate from the solution alone does not see what the grid has lost: after long times the
//! scheme has smeared `f` out, or its velocities are too few for the filaments of `f`. The
//! particles that the ledger follows arrive at points `z_p` with masses `m_p`, and `f` keeps its
//! value `f_p` along a path. Their masses are `f` times a volume, so that
//!
//! ```text
//! ∫ (f_h − f)²       = Σ (m_p/f_p) (f_h(z_p) − f_p)² where |f| is not far below |f_h|
//! ∫ f²               = Σ m_p f_p
//! ∫ over a part of ρ = Σ m_p of the particles that arrive there
//! ```
//!
//! up to the scatter of the particles. The errors of this module are those found, less
//! [`STANDARD_ERRORS`] standard errors of the replicates: small errors are not shown. The error
//! where `|f|` is smaller is that of [`drawn_nodes`](crate::run::particles::drawn_nodes). The error
//! of the density that follows from that of `f` is found by parts of space ([`SpaceParts`]).

use crate::base::error::Result;
use crate::parallel::communicator::Group;
use crate::problem::case::Case;
use crate::problem::exact::{CellLimits, HalvedCells, Tracer, traced_cells_of_axis};
use crate::problem::grid::{MAX_DIMENSION, PhaseSpace, box_cells};
use crate::results::accuracy::{ErrorsByParticles, PARTS_OF_SPACE, density_of_smeared, is_large};
use crate::results::ledger::STANDARD_ERRORS;
use crate::run::errors::ResultOnShare;
use crate::run::particles::draw::REPLICATES;
use crate::run::particles::drawn_nodes::{is_seen, squares_elsewhere};
use crate::run::particles::point_values::{is_mixed, most_values, values_at};
use crate::run::particles::space_parts::{ParticleSums, SpaceParts};

/// The least number of particles of a replicate at which `f_h` is evaluated.
const LEAST_PARTICLES: usize = 16;
/// Least number of replicates of which particles arrive.
const LEAST_REPLICATES: usize = 12;
/// Standard errors of a mass by which it may be off, in an error that is at most so large.
const SCATTER_OF_MOST: f64 = 2.0;
/// Largest standard error of the square of an error, as a part of it, with which the mean counts.
const MOST_SCATTER: f64 = 0.2;
/// Arrivals that are traced back through cells in which `V` is approximated, on half as many.
const TRACED: usize = 256;
/// Number of numbers of an [`ArrivedParticle`].
const NUMBERS: usize = 8;

/// A particle that was in the box at the end.
#[derive(Clone, Copy)]
pub struct ArrivedParticle {
    /// Its point then, `[x, y, z, vx, vy, vz]`.
    pub point: [f64; 6],
    /// Its mass.
    pub mass: f64,
    /// `f` along its path.
    pub value: f64,
}

impl ArrivedParticle {
    fn numbers(&self) -> [f64; NUMBERS] {
        let [x, y, z, u, v, w] = self.point;
        [x, y, z, u, v, w, self.mass, self.value]
    }

    fn from_numbers(&[x, y, z, u, v, w, mass, value]: &[f64; NUMBERS]) -> Self {
        Self { point: [x, y, z, u, v, w], mass, value }
    }
}

/// Particles that were in the box at the end, by replicate. Each rank has its own replicates.
#[derive(Default)]
pub struct Arrivals {
    by_replicate: [Vec<ArrivedParticle>; REPLICATES],
    /// By replicate, `Σ |m| times` by velocity axis, with the times that jumps of `V` smeared a
    /// particle out ([`smearing`](crate::run::particles::tracking::smearing)).
    smeared: [[f64; MAX_DIMENSION]; REPLICATES],
    /// A tracer with half the cells, if the cells of `V` are an approximation.
    pub halved: Option<HalvedCells>,
}

/// The arrivals of all replicates, the same on all ranks.
pub struct GatheredArrivals {
    by_replicate: Vec<Vec<ArrivedParticle>>,
    /// How often jumps of `V` smeared an arrived particle out along each velocity axis, as a mean
    /// over the masses.
    pub smearing: [f64; MAX_DIMENSION],
    halved: Option<HalvedCells>,
}

/// Relative errors of a density by the masses of particles; `None` without any.
pub struct DensityErrors {
    /// In L1, beyond the scatter of the masses: at least this.
    pub least: Option<f64>,
    /// In L2, with the scatter: at most this, but for what varies within the parts.
    pub most: Option<f64>,
}

impl Arrivals {
    /// Adds a particle of a `replicate` that jumps of `V` smeared out so many `times` along each
    /// velocity axis.
    pub fn add(&mut self, replicate: usize, arrived: ArrivedParticle, times: [f64; MAX_DIMENSION]) {
        self.by_replicate[replicate].push(arrived);
        let sums = self.smeared[replicate].iter_mut().zip(times);
        sums.for_each(|(sum, times)| *sum += arrived.mass.abs() * times);
    }

    /// The arrivals of all ranks; `None` if they are of too few replicates. Collective.
    pub fn gathered(&self, world: &Group) -> Option<GatheredArrivals> {
        let longest =
            world.max_count(self.by_replicate.iter().map(Vec::len).max().unwrap_or(0)).max(1);
        // No arrival has no mass: what follows the last one of a replicate is zero.
        let of_replicate = MAX_DIMENSION + longest * NUMBERS;
        let mut all = vec![0.0; REPLICATES * of_replicate];
        let own = self.by_replicate.iter().zip(&self.smeared);
        for ((arrivals, smeared), numbers) in own.zip(all.chunks_mut(of_replicate)) {
            let (sums, numbers) = numbers.split_at_mut(MAX_DIMENSION);
            sums.copy_from_slice(smeared);
            for (arrival, numbers) in arrivals.iter().zip(numbers.chunks_mut(NUMBERS)) {
                numbers.copy_from_slice(&arrival.numbers());
            }
        }
        let all = world.gathered(all);
        let (mut by_replicate, mut smearing) = (Vec::new(), [0.0; MAX_DIMENSION]);
        for numbers in all.chunks(of_replicate) {
            let (sums, numbers) = numbers.split_at(MAX_DIMENSION);
            smearing.iter_mut().zip(sums).for_each(|(all, sum)| *all += sum);
            let arrivals = numbers.as_chunks().0.iter().map(ArrivedParticle::from_numbers);
            let arrivals = arrivals.filter(|arrival| arrival.mass != 0.0);
            by_replicate.push(arrivals.collect::<Vec<_>>());
        }
        let masses = by_replicate.iter().flatten().map(|arrival| arrival.mass.abs());
        let mass: f64 = masses.sum();
        let smearing = smearing.map(|sum| sum / mass);
        let replicates = by_replicate.iter().filter(|of| !of.is_empty()).count();
        let halved = self.halved;
        let all = GatheredArrivals { by_replicate, smearing, halved };
        (replicates >= LEAST_REPLICATES).then_some(all)
    }
}

impl GatheredArrivals {
    /// The relative errors of `f` (L2) and of the density (L1, over parts of space). Collective.
    pub fn errors(&self, result: &ResultOnShare<'_>) -> ErrorsByParticles {
        let field = if keeps_values(result.case) {
            self.field_errors(result)
        } else {
            ErrorsByParticles::default()
        };
        let DensityErrors { least, most } = self.density_errors(result, &result.moments.density);
        ErrorsByParticles { density: least, density_most: most, ..field }
    }

    /// About the relative L2 error of the values of some arrivals where `V` is approximated: what
    /// they change by on half as many cells, in errors on all of them. `None` if there is no such
    /// error, or values do not keep along paths.
    ///
    /// # Errors
    /// If `V` is not finite.
    pub fn tracing_error(&self, case: &Case) -> Result<Option<f64>> {
        let Some(halved) = self.halved.filter(|_| keeps_values(case)) else {
            return Ok(None);
        };
        let coarser = Tracer::with_cells(case, halved.most)?;
        let all = self.by_replicate.concat();
        let step = all.len().div_ceil(TRACED);
        let some: Vec<ArrivedParticle> = all.into_iter().step_by(step).collect();
        let points: Vec<[f64; 6]> = some.iter().map(|arrival| arrival.point).collect();
        let (mut error, mut size) = (0.0, 0.0);
        for (arrival, value) in some.iter().zip(coarser.values(&points, case.end)) {
            let ArrivedParticle { mass, value: exact, .. } = arrival;
            error += mass / exact * (value - exact) * (value - exact);
            size += mass * exact;
        }
        let change = (error / size).sqrt();
        let change_in_errors = 2f64.powf(halved.order) - 1.0;
        Ok(Some(change / change_in_errors).filter(|error| error.is_finite()))
    }

    /// The error of the exact solution of `case`, if that of particles is `traced`: in two and
    /// three dimensions it is traced through more cells.
    pub fn error_of_exact(&self, case: &Case, traced: f64) -> f64 {
        let cells = |most| traced_cells_of_axis(case, most);
        let order = self.halved.map_or(0.0, |halved| halved.order);
        traced * (cells(CellLimits::ESTIMATES) / cells(CellLimits::EXACT)).powf(order)
    }

    /// The difference between a `mass` and that of all arrivals, beyond the scatter of the latter
    /// and relative to their size.
    pub fn mass_error(&self, mass: f64) -> Option<f64> {
        let difference = self.mass_difference(mass);
        let masses = self.by_replicate.iter().flatten().map(|arrival| arrival.mass.abs());
        let size = masses.sum::<f64>() / self.by_replicate.len() as f64;
        Some(difference / size).filter(|error| error.is_finite())
    }

    /// The errors that follow from `f`: `‖f_h − f‖ / ‖f‖` in L2 less the scatter, the mean, and the
    /// error of the density that remains of it. Along axes of degree 0 beside others `f_h` varies
    /// between centres by another rule than where errors are measured, so that only the first is
    /// known. Collective.
    fn field_errors(&self, result: &ResultOnShare<'_>) -> ErrorsByParticles {
        let all = &self.by_replicate;
        let space = &result.case.space;
        let most = (most_values(space) / REPLICATES).max(LEAST_PARTICLES);
        let step = all.iter().map(Vec::len).max().unwrap_or(0).div_ceil(most);
        // Each stands for as many. Each replicate begins with another one, as arrivals are in the
        // order of a curve.
        let heavier = |of: &ArrivedParticle| ArrivedParticle { mass: step as f64 * of.mass, ..*of };
        let some = |(replicate, of): (usize, &Vec<ArrivedParticle>)| {
            of.iter().skip(replicate * step / all.len()).step_by(step).map(heavier).collect()
        };
        let chosen: Vec<Vec<ArrivedParticle>> = all.iter().enumerate().map(some).collect();
        let points: Vec<[f64; 6]> = chosen.iter().flatten().map(|arrival| arrival.point).collect();
        let mut values = values_at(result, &points).into_iter();
        let parts = SpaceParts::for_particles(space, points.len());
        let mut by_part = vec![ParticleSums::default(); parts.count()];
        let mut by_replicate = vec![ParticleSums::default(); all.len()];
        let mut errors = squares_elsewhere(result).to_vec();
        for (replicate, of) in chosen.iter().enumerate() {
            for (arrival, found) in of.iter().zip(&mut values) {
                let ArrivedParticle { point, mass, value: exact, .. } = *arrival;
                let own = ParticleSums::of(mass, exact, found);
                by_replicate[replicate] += own;
                by_part[parts.at(&point)] += own;
                errors[replicate] += if is_seen(exact, found) { own.error } else { 0.0 };
            }
        }
        let (where_f_is, sizes): (Vec<f64>, Vec<f64>) =
            by_replicate.iter().map(|of| (of.error, of.size)).unzip();
        let shown = ShownError::of(&errors, &sizes);
        let of_particles = ShownError::of(&where_f_is, &sizes);
        let (Some(shown), Some(of_particles)) = (shown, of_particles) else {
            return ErrorsByParticles::default();
        };
        // Both are bounds.
        let field = Some(shown.least.max(of_particles.least));
        if is_mixed(space) {
            return ErrorsByParticles { field, ..ErrorsByParticles::default() };
        }
        let of_whole = of_particles.smeared(space);
        ErrorsByParticles {
            field,
            field_mean: shown.mean(),
            field_rough: Some(shown.rough),
            density_smeared: parts.smeared(&by_part).into_iter().chain(of_whole).reduce(f64::max),
            ..ErrorsByParticles::default()
        }
    }

    /// The difference between a mass and that of all arrivals, beyond the scatter of the latter.
    fn mass_difference(&self, mass: f64) -> f64 {
        let masses: Vec<f64> = self
            .by_replicate
            .iter()
            .map(|of| of.iter().map(|arrival| arrival.mass).sum())
            .collect();
        let [expected, scatter] = mean(&masses);
        ((mass - expected).abs() - STANDARD_ERRORS * scatter).max(0.0)
    }

    /// The relative errors of a `density` on the share of `result`, by the masses in parts of
    /// space and in all of it. Collective.
    pub fn density_errors(&self, result: &ResultOnShare<'_>, density: &[f64]) -> DensityErrors {
        let all = &self.by_replicate;
        let space = &result.case.space;
        let parts = SpaceParts::new(space, PARTS_OF_SPACE[space.dimension() - 1]);
        let count = parts.count();
        let mut masses_of = vec![vec![0.0; all.len()]; count];
        let (mut absolute, mut arrived) = (0.0, 0);
        for (replicate, arrivals) in all.iter().enumerate() {
            for ArrivedParticle { point, mass, .. } in arrivals {
                let at = parts.at(point);
                masses_of[at][replicate] += mass;
                absolute += mass.abs();
                arrived += 1;
            }
        }
        // A part that no particle reached may have the mass of some.
        let of_particle = absolute / (arrived.max(1) * all.len()) as f64;
        let places: Vec<usize> = box_cells(result.share).map(|cell| parts.of_cell(&cell)).collect();
        let (mut shown, mut size, mut total) = (0.0, 0.0, 0.0);
        let (mut square_of_most, mut square) = (0.0, 0.0);
        let found = result.volumes.integrals_by_part(result.world, density, &places, count);
        for (part, (masses, found)) in masses_of.iter().zip(found).enumerate() {
            let [expected, scatter] = mean(masses);
            let scatter = scatter.max(of_particle);
            let difference = (found - expected).abs();
            shown += (difference - STANDARD_ERRORS * scatter).max(0.0);
            size += expected.abs();
            total += found;
            let volume = parts.volume(part);
            square_of_most += (difference + SCATTER_OF_MOST * scatter).powi(2) / volume;
            square += expected * expected / volume;
        }
        // The whole mass is known better than its parts if little of it leaves.
        shown = shown.max(self.mass_difference(total));
        let finite = |error: f64| Some(error).filter(|error| error.is_finite());
        DensityErrors {
            least: finite(shown / size),
            most: finite((square_of_most / square).sqrt()),
        }
    }
}

/// Whether `f` keeps its value along the path of a particle: not for measure-valued data, nor at a
/// jump of partial reflection.
fn keeps_values(case: &Case) -> bool {
    !case.is_measure_valued() && !case.reflects()
}

/// A relative error that particles show.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShownError {
    /// Less the scatter: at least this.
    pub least: f64,
    /// The mean over the replicates.
    pub rough: f64,
    /// Whether the scatter of the mean is small.
    is_sharp: bool,
}

impl ShownError {
    /// The error by the squares of errors and of sizes of each replicate; `None` where the size is
    /// not known.
    pub fn of(errors: &[f64], sizes: &[f64]) -> Option<Self> {
        // The scatter of squares of tiny or huge values is no number; a power of two changes no
        // bits.
        let largest = sizes.iter().fold(0.0, |most: f64, size| most.max(size.abs()));
        let unit = largest.log2().floor().exp2();
        let in_units =
            |squares: &[f64]| mean(&squares.iter().map(|x| x / unit).collect::<Vec<_>>());
        let ([error, scatter], [size, of_size]) = (in_units(errors), in_units(sizes));
        let is_known = error.is_finite() && size > 0.0 && of_size <= MOST_SCATTER * size;
        let relative = |square: f64| (square.max(0.0) / size).sqrt().min(1.0);
        is_known.then(|| Self {
            least: relative(error - STANDARD_ERRORS * scatter),
            rough: relative(error),
            is_sharp: scatter <= MOST_SCATTER * error,
        })
    }

    /// The mean, if its scatter is small.
    pub fn mean(&self) -> Option<f64> {
        self.is_sharp.then_some(self.rough)
    }

    /// The error of the density if this one of `f` is large, so that `f` was smeared out.
    pub fn smeared(&self, space: &PhaseSpace) -> Option<f64> {
        let large = self.mean().filter(|error| is_large(*error))?;
        Some(density_of_smeared(space.whole_degree(), large))
    }
}

/// A mean over the replicates, and its standard error.
fn mean(values: &[f64]) -> [f64; 2] {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let squares: f64 = values.iter().map(|x| (x - mean) * (x - mean)).sum();
    [mean, (squares / (count * (count - 1.0))).sqrt()]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Without a known size there is no relative error, and least of all one of 100 %.
    #[test]
    fn errors_of_unknown_size_are_unknown() {
        let errors = [1.0; REPLICATES];
        let shown = |errors: &[f64], sizes: &[f64]| {
            ShownError::of(errors, sizes).map(|shown| (shown.least, shown.rough, shown.mean()))
        };
        let some = |size: f64| shown(&errors, &[size; REPLICATES]);
        assert_eq!(some(4.0), Some((0.5, 0.5, Some(0.5))));
        assert_eq!(some(0.0), None);
        assert_eq!(some(-1.0), None);
        assert_eq!(some(f64::NAN), None);
        assert_eq!(shown(&[0.0; REPLICATES], &[0.0; REPLICATES]), None);
        let scattered =
            std::array::from_fn::<f64, REPLICATES, _>(|k| if k == 0 { 1.0 } else { 0.0 });
        assert_eq!(shown(&errors, &scattered), None);
        assert_eq!(shown(&scattered, &[1.0; REPLICATES]), Some((0.0, 0.25, None)));
        let wrong =
            std::array::from_fn::<f64, REPLICATES, _>(|k| if k == 0 { f64::NAN } else { 1.0 });
        assert_eq!(shown(&wrong, &errors), None);
    }

    /// Data of any allowed size have the same relative errors.
    #[test]
    fn relative_errors_do_not_depend_on_the_unit_of_f() {
        let squares = |size: f64| {
            let of = |k: usize| size * size * (1.0 + 0.01 * (k as f64).sin());
            let sizes = std::array::from_fn::<f64, REPLICATES, _>(of);
            [sizes.map(|size| 0.01 * size), sizes]
        };
        let found = |size: f64| {
            let [errors, sizes] = squares(size);
            let shown = ShownError::of(&errors, &sizes).expect("an error");
            [shown.least, shown.mean().expect("a mean")]
        };
        let expected = found(1.0);
        assert!(expected[0] < expected[1], "{expected:?}");
        for size in [1e90, 1e-90] {
            let near = |(a, b): (f64, f64)| (a - b).abs() < 1e-12;
            assert!(found(size).into_iter().zip(expected).all(near), "{size}: {:?}", found(size));
        }
    }

    /// The error that a coarser tracer shows is that of the values, within a factor of 3: of a
    /// quartic oscillator against many more cells, and of one with coupled axes against its
    /// solution in normal modes.
    #[test]
    fn errors_of_paths_are_estimated() {
        let text = |cells: usize, axes: usize, value: &str, f: &str, end: f64| {
            let axis = format!(
                "[[axis]]\nx = {{ lower = -2, upper = 2, cells = {cells} }}\n\
                 v = {{ lower = -3, upper = 3, cells = 8 }}\n"
            );
            let text = axis.repeat(axes)
                + &format!("[[potential]]\nvalue = '{value}'\n[initial]\nf = '{f}'\n")
                + &format!("[time]\nend = {end}\n[solver]\ntolerance = 1e-3\n");
            Case::parse("test", &text, &[]).expect("a case")
        };
        let line = "exp(-20*(x - 0.8)^2 - 20*v^2)";
        let quartic = |cells: usize| text(cells, 1, "x^4 - 0.3*x^3", line, 20.0);
        let (coarse, fine) = (quartic(16), quartic(8192));
        let by_cells = Tracer::new(&fine).expect("V is finite");
        let plane = "exp(-20*(x - 0.8)^2 - 20*(y + 0.2)^2 - 20*vx^2 - 20*vy^2)";
        // A formula with a kink is not followed as such.
        let coupled = text(16, 2, "0.5*(x^2 + y^2) + 0.3*x*y + 0*abs(x)", plane, 12.0);
        let by_modes = |point: &[f64; 6]| {
            let back = |sign: f64| {
                let rate = (1.0 + 0.3 * sign).sqrt();
                let [q, p] = [0, 3].map(|k| 0.5 * (point[k] + sign * point[k + 1]));
                let (sin, cos) = (12.0 * rate).sin_cos();
                [q * cos - p / rate * sin, p * cos + rate * q * sin]
            };
            let [[a, u], [b, w]] = [back(1.0), back(-1.0)];
            let squares = [a + b - 0.8, a - b + 0.2, u + w, u - w].map(|x| x * x);
            (-20.0 * squares.iter().sum::<f64>()).exp()
        };
        for case in [&coarse, &coupled] {
            let is_line = case.space.dimension() == 1;
            let exact = |point: &[f64; 6]| {
                if is_line { by_cells.value(point, 20.0) } else { by_modes(point) }
            };
            let tracer = Tracer::with_cells(case, CellLimits::ESTIMATES).expect("V is finite");
            let halved = tracer.halved();
            let mut starts = case.space.random_points(200);
            for start in &mut starts {
                let [x, y, _, vx, vy, _] = *start;
                *start = [0.8 + 0.15 * x, 0.15 * y, 0.0, 0.1 * vx, 0.1 * vy, 0.0];
                start[1] -= if case.space.dimension() == 2 { 0.2 } else { 0.0 };
            }
            let values = case.fields[0].initial.at_points(&starts, 0.0);
            let forward = tracer.clone().forward();
            let arrived = |(start, value): (&[f64; 6], f64)| {
                let path = forward.follow(start, case.end);
                path.remaining.is_none().then_some(ArrivedParticle {
                    point: path.point,
                    mass: value,
                    value,
                })
            };
            let arrivals: Vec<_> = starts.iter().zip(values).filter_map(arrived).collect();
            assert!(arrivals.len() > 150, "{}", arrivals.len());
            let (mut error, mut size) = (0.0, 0.0);
            for ArrivedParticle { point, mass, value, .. } in &arrivals {
                let off = exact(point) - value;
                error += mass / value * off * off;
                size += mass * value;
            }
            let error = (error / size).sqrt();
            let smearing = [0.0; MAX_DIMENSION];
            let found = GatheredArrivals { by_replicate: vec![arrivals], smearing, halved };
            let estimate = found.tracing_error(case).expect("V is finite").expect("an estimate");
            let ratio = estimate / error;
            assert!((0.3..3.0).contains(&ratio), "{estimate:e} {error:e}: {}", case.text);
        }
    }
}
