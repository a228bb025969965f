//! Estimates of the grid's error from the solution alone.
//!
//! **Axes of degree 0**: the leading error is `‖e‖ ≈ T ‖D f(T)‖`, where `D` is the term that the
//! scheme adds to transport (its modified equation), computed as the difference to a flux of third
//! order. For the upwind scheme this is mostly dissipation, for slopes the part that the limiter
//! cuts off. If other axes have a higher degree, errors are integrals, and the variation of `f`
//! within a cell is added.
//!
//! **Axes of a higher degree**: the error is about as large as the Legendre coefficients beyond the
//! highest one of each element. At fronts these are like the highest one itself. If coefficients
//! fall fast, as for smooth data, they are smaller by the same rate. The error of the density is of
//! the order of the square of that of `f`: an error that is smeared over a front of width `w` is
//! `√w` in L2 and `w` in the density, and smooth errors nearly cancel. After phase mixing it is far
//! smaller; particles of the exact flow may show that later ([`EstimatedErrors::with_particles`]).
//!
//! docs/limits.md says how reliable the estimates are; tests/cli/accuracy.rs tests it.

use crate::base::error::Result;
use crate::base::memory;
use crate::matrix::elements::{apply_along_all, for_each_element};
use crate::matrix::observables::{CellVolumes, VelocityFactors};
use crate::matrix::projection::legendre_transform;
use crate::parallel::communicator::{GhostExchange, Group};
use crate::parallel::partition::{Block, LocalIndex};
use crate::problem::case::Case;
use crate::problem::grid::{Axis, Cell, MAX_DIMENSION, PhaseSpace};
use crate::problem::potential::resolution::largest_differences_on_elements;
use crate::propagate::limiter::half_difference;
use crate::results::accuracy::{EstimatedErrors, GridErrorPair, smeared_density};
use crate::results::summary::CANCELLED;
use crate::run::errors::ResultOnShare;
use crate::run::norms::volumes_of;
use crate::scheme::rows::Scheme;
use crate::solve::prepared::Prepared;

/// Factor on `T ‖D f(T)‖` in the estimate.
const TRANSPORT_FACTOR: f64 = 2.0;
/// Least part of `‖f‖²` on cells where `D f` is known for which there is an estimate.
const LEAST_KNOWN: f64 = 0.1;
/// Factor on the estimated coefficients beyond the highest one, in the estimate of elements.
const COEFFICIENTS_FACTOR: f64 = 3.0;
/// Least ratio of a coefficient to the one before it, at a front.
const LEAST_RATIO_AT_FRONTS: f64 = 0.5;
/// Factor on the relative error of the energy in the estimate of the density.
const POTENTIAL_FACTOR: f64 = 2.0;
/// The ratio that is assumed for degree 1, whose coefficients do not show one.
const RATIO_OF_DEGREE_1: f64 = 0.5;

/// Estimates of the relative L2 errors of `f` and of the density due to the grid, at the end of a
/// run. None for measure-valued data, or if `V` jumps nearly everywhere. Collective.
///
/// # Errors
/// If `V` is not finite.
pub fn of_the_grid(prepared: &mut Prepared, f: &[f64]) -> Result<EstimatedErrors> {
    let space = &prepared.case.space;
    if prepared.case.is_measure_valued() {
        return Ok(EstimatedErrors::default());
    }
    // Memory that the solve freed goes back before the vectors of the estimate are allocated.
    memory::give_back();
    let with_elements = space.whole_degree() > 0;
    let interpolates = space.v.iter().any(|axis| axis.nodes.degree == 0);
    let mut found = [0.0; 2];
    if !with_elements || space.axes().any(|axis| axis.nodes.degree == 0 && axis.cells > 1) {
        found = by_transport(prepared, f)?;
    }
    let mut density_shown = f64::NAN;
    if with_elements {
        let more = by_coefficients(prepared, f);
        let [field, density] = [0, 1].map(|k| f64::hypot(found[k], more[k]));
        found = [field, smeared_density(density, field)];
        density_shown = density;
    }
    // A field that is zero has no relative error.
    let known = |error: f64| Some(error).filter(|e| !e.is_nan()).map(|e| e.min(1.0));
    let [field, density] = found.map(known);
    let grid = GridErrorPair { field, density };
    let interpolation = interpolates.then(|| interpolation_error(prepared, f));
    Ok(EstimatedErrors { grid, density_shown: known(density_shown), interpolation })
}

/// About the part of the kinetic energy by which the paths of `result` are off, as elements take
/// `V` as a polynomial: a kink within an element is rounded, and a steep slope smoothed. It is
/// summed over the axes, each with the mean energy of the motion along it at the end. Collective.
pub fn of_the_potential(result: &ResultOnShare<'_>) -> f64 {
    let ResultOnShare { world, volumes, .. } = *result;
    let space = &result.case.space;
    let differences = largest_differences_on_elements(result.case);
    if differences.iter().all(|difference| *difference == 0.0) {
        return 0.0;
    }
    let centres: Vec<Vec<f64>> = space.v.iter().map(Axis::centres).collect();
    let parts = space.v.iter().zip(&centres).zip(differences).enumerate();
    let parts = parts.filter(|(_, (_, difference))| *difference > 0.0);
    let part = |(a, ((axis, centres), difference)): (usize, ((&Axis, &Vec<f64>), f64))| {
        let stride = space.stride(space.dimension() + a);
        let [energy, all] = volumes.sums(world, |i| {
            let v = centres[i / stride % axis.cells];
            let f = result.field[i].abs();
            [0.5 * v * v * f, f]
        });
        let fastest = axis.largest_magnitude();
        let largest = 0.5 * fastest * fastest;
        // Without data, with the largest energy.
        let mean = if all > 0.0 { energy / all } else { largest };
        difference / mean.min(largest)
    };
    let sum: f64 = parts.map(part).filter(|share| share.is_finite()).sum();
    POTENTIAL_FACTOR * sum
}

/// Whether the density of `result` is round-off, as of an `f` that is odd in `v`. Collective.
pub fn density_cancels(result: &ResultOnShare<'_>) -> bool {
    let space = &result.case.space;
    let velocities = space.velocity_cells();
    let box_of_velocities: f64 = space.v.iter().map(|axis| axis.upper - axis.lower).product();
    let [density, field] = result.volumes.integrals(result.world, |c| {
        let values = &result.field[c * velocities..][..velocities];
        let mean = values.iter().map(|f| f.abs()).sum::<f64>() / velocities as f64;
        [result.moments.density[c].abs(), mean * box_of_velocities]
    });
    density <= CANCELLED * field
}

/// A bound on the relative L2 error of linear interpolation of `f` between the velocities, by its
/// second differences: `‖δ² f‖/8 / ‖f‖` along each velocity axis of degree 0. Data that are
/// constant or linear in `v` have none, so that the law at jumps is exact for them. Laws that
/// distribute `f` among cells by overlap have the same bound: a shift by `θ` cells adds
/// `θ (1 − θ)/2 δ² f`. Collective.
fn interpolation_error(prepared: &Prepared, f: &[f64]) -> [f64; MAX_DIMENSION] {
    let (world, space) = (&prepared.communicator.world, &prepared.case.space);
    let volumes = volumes_of(prepared);
    let n = space.dimension();
    let strides: Vec<usize> = (n..2 * n).map(|axis| space.stride(axis)).collect();
    // The last is that of f.
    let sums: [f64; MAX_DIMENSION + 1] = volumes.sums(world, |i| {
        let mut squares = [0.0; MAX_DIMENSION + 1];
        for ((square, axis), stride) in squares.iter_mut().zip(&space.v).zip(&strides) {
            let j = i / stride % axis.cells;
            if 0 < j && j + 1 < axis.cells && axis.nodes.degree == 0 {
                let difference = f[i - stride] - 2.0 * f[i] + f[i + stride];
                *square = (difference / 8.0).powi(2);
            }
        }
        squares[MAX_DIMENSION] = f[i] * f[i];
        squares
    });
    std::array::from_fn(|a| (sums[a] / sums[MAX_DIMENSION]).sqrt())
}

/// `T ‖D f‖ / ‖f‖` along the axes of degree 0, and the same for the integrals over the velocities.
/// `T` is `time.end`, as a continued run inherits the grid's error of its first part.
/// Next to an end of the box or a jump of `V`, `D f` is unknown and assumed to be as large as
/// elsewhere. NaN if nearly all of `f` lies there. Collective.
///
/// # Errors
/// If `V` is not finite.
fn by_transport(prepared: &mut Prepared, f: &[f64]) -> Result<[f64; 2]> {
    let Prepared { case, communicator, rank_cells, system, .. } = prepared;
    let (space, world, matrix) = (&case.space, &communicator.world, &system.matrix);
    let (block, rows, exchange) = (&matrix.block, matrix.rows(), &mut system.exchange);
    let scheme = world.agree(Scheme::new(case, &block.wide_ranges()))?;
    // The field on the whole block, with ghosts; each mode group has a share of it. Vectors of this
    // size are allocated once: others would leave gaps, of which the peak depends on chance.
    let mut state = rank_cells.gathered(&communicator.modes, f, matrix.length());
    fill_ghosts(exchange, &mut state, rows);
    let volumes = CellVolumes::new(space, &rank_cells.share);
    let factors = VelocityFactors::new(space);
    let norms = |f: &[f64]| -> [f64; 2] {
        let density: Vec<f64> = factors.at_points(f).map(|sums| sums[0]).collect();
        volumes.square_integrals(world, f, &density).map(f64::sqrt)
    };
    let (mut added_term, mut error) = (vec![0.0; block.cells()], [0.0; 2]);
    let (mut corrections, mut along) = (vec![0.0; matrix.length()], vec![0.0; block.cells()]);
    let of_cells = space.axes().enumerate().filter(|(_, axis)| axis.nodes.degree == 0);
    for (axis, _) in of_cells {
        let line = AxisLines { case, scheme: &scheme, block, rows, axis };
        line.each(|i, cell| corrections[i] = line.correction(i, cell, &state).unwrap_or(f64::NAN));
        fill_ghosts(exchange, &mut corrections, rows);
        let mut parts = [vec![0u8; block.cells()], vec![0u8; block.cells()]];
        line.each(|i, cell| {
            let found = line.difference(i, cell, &corrections);
            along[i] = found.unwrap_or(0.0);
            let is_known = [scheme.speed(cell, axis) != 0.0, found.is_some()];
            parts.iter_mut().zip(is_known).for_each(|(part, is)| part[i] = u8::from(is));
        });
        let here = parts.each_ref().map(|part| &part[rank_cells.mine.clone()]);
        let [moving, known] =
            volumes.sums(world, |i| here.map(|part| f64::from(part[i]) * f[i] * f[i]));
        if known < LEAST_KNOWN * moving {
            return Ok([f64::NAN; 2]);
        }
        let of_all = if known > 0.0 { (moving / known).sqrt() } else { 1.0 };
        added_term.iter_mut().zip(&along).for_each(|(sum, part)| *sum += of_all * part);
        if space.whole_degree() > 0 {
            let mut within = vec![0.0; block.cells()];
            line.each(|i, cell| within[i] = line.within(cell, &state).unwrap_or(0.0));
            let more = norms(&within[rank_cells.mine.clone()]);
            error = [0, 1].map(|k| f64::hypot(error[k], more[k]));
        }
    }
    let (of, transport) = (norms(f), norms(&added_term[rank_cells.mine.clone()]));
    let scale = TRANSPORT_FACTOR * case.end;
    Ok([0, 1].map(|k| f64::hypot(error[k], scale * transport[k]) / of[k]))
}

/// Fills the ghosts of `vector`, which follow its `rows` rows. Collective over the space group.
fn fill_ghosts(exchange: &mut GhostExchange, vector: &mut [f64], rows: usize) {
    let (own, ghosts) = vector.split_at_mut(rows);
    exchange.start(own);
    exchange.finish(ghosts);
}

/// Lines along an axis of degree 0, through a rank's block.
struct AxisLines<'a> {
    case: &'a Case,
    scheme: &'a Scheme<'a>,
    block: &'a Block,
    rows: usize,
    axis: usize,
}

impl AxisLines<'_> {
    /// Calls `visit(local number, cell)` for each cell of the block.
    fn each(&self, mut visit: impl FnMut(usize, &Cell)) {
        self.block.for_each_own(|global, local| {
            for v in 0..self.block.velocity_cells {
                visit(local + v, &self.case.space.cell(global + v));
            }
        });
    }

    /// The local number of the cell next to `cell`; `None` behind a jump of `V` or an end of the
    /// box.
    fn beside(&self, cell: &Cell, above: bool) -> Option<usize> {
        let space = &self.case.space;
        let n = space.dimension();
        let next = if self.axis < n {
            self.scheme.plain_neighbour(cell, self.axis, above)?
        } else {
            let mut next = *cell;
            let j = &mut next[self.axis];
            *j = if above { *j + 1 } else { j.checked_sub(1)? };
            (*j < space.v[self.axis - n].cells).then_some(next)?
        };
        match self.block.local(space.index(&next))? {
            LocalIndex::Own(i) => Some(i),
            LocalIndex::Ghost(g) => Some(self.rows + g),
        }
    }

    /// The correction of the flux at the downstream face of cell `i`: a flux of third order minus
    /// that of the scheme. It is `(2 b + a)/6 − ½ b ψ(a/b) − ½(1 − α) b` with the differences `a`
    /// behind and `b` ahead. With slopes `α = 1`, and without them `ψ = 0`.
    fn correction(&self, i: usize, cell: &Cell, f: &[f64]) -> Option<f64> {
        let up = self.scheme.speed(cell, self.axis) > 0.0;
        let behind = f[i] - f[self.beside(cell, !up)?];
        let ahead = f[self.beside(cell, up)?] - f[i];
        let third = (2.0 * ahead + behind) / 6.0;
        let central = 0.5 * (1.0 - self.case.scheme.flux) * ahead;
        Some(third - half_difference(self.case.scheme.limiter, behind, ahead) - central)
    }

    /// The root mean square variation of `f` within `cell`, with the sign of its slope.
    fn within(&self, cell: &Cell, f: &[f64]) -> Option<f64> {
        let rise = 0.5 * (f[self.beside(cell, true)?] - f[self.beside(cell, false)?]);
        Some(rise / 12f64.sqrt())
    }

    /// `D f` at cell `i`; `None` if a correction is unknown.
    fn difference(&self, i: usize, cell: &Cell, corrections: &[f64]) -> Option<f64> {
        let speed = self.scheme.speed(cell, self.axis);
        if speed == 0.0 {
            return None;
        }
        let behind = corrections[self.beside(cell, speed < 0.0)?];
        Some(speed.abs() * (corrections[i] - behind)).filter(|d| !d.is_nan())
    }
}

/// Squares of norms, by element.
#[derive(Default)]
struct CoefficientSquares {
    /// The square of the norm of all coefficients, and the estimated one of those beyond the
    /// highest.
    all_and_beyond: Vec<[f64; 2]>,
}

impl CoefficientSquares {
    /// Adds an element with the values `nodal` at its nodes. `transforms` are those to Legendre
    /// coefficients, by axis.
    fn add(&mut self, nodal: &[f64], transforms: &[Vec<Vec<f64>>]) {
        let mut all = 0.0;
        // Sums of squares by axis and by degree along it.
        let mut along: Vec<Vec<f64>> = transforms.iter().map(|t| vec![0.0; t.len()]).collect();
        let mut place = vec![0; transforms.len()];
        for (at, c) in apply_along_all(nodal, transforms.iter()).into_iter().enumerate() {
            let (mut rest, mut norm) = (at, 1.0);
            for (j, transform) in place.iter_mut().zip(transforms).rev() {
                *j = rest % transform.len();
                rest /= transform.len();
                norm /= (2 * *j + 1) as f64;
            }
            let square = norm * c * c;
            all += square;
            along.iter_mut().zip(&place).for_each(|(sums, j)| sums[*j] += square);
        }
        self.all_and_beyond.push([all, along.iter().map(|sums| beyond(sums)).sum()]);
    }

    /// The estimated relative error. Collective.
    fn error(&self, world: &Group) -> f64 {
        let elements = world.sum_count(self.all_and_beyond.len());
        let [all, beyond] = world.sum_lanes(elements, self.all_and_beyond.iter().copied());
        COEFFICIENTS_FACTOR * (beyond / all).sqrt()
    }
}

/// The expected square of the coefficients beyond the highest known one. `squares` are those of the
/// known ones by rising degree. The result is `c_k² min(1, (r/r_front)²)²` with their ratio `r`, to
/// which the mean does not belong.
///
/// Coefficients of even and odd functions alternate with zero. From degree 4 on the ratio is that
/// over two degrees, and `c_k` is at least what the ratio makes of the coefficient before.
fn beyond(squares: &[f64]) -> f64 {
    let of_front = LEAST_RATIO_AT_FRONTS * LEAST_RATIO_AT_FRONTS;
    let [highest, ratio] = match *squares {
        [] | [_] => return 0.0,
        [_, b] => return RATIO_OF_DEGREE_1 * RATIO_OF_DEGREE_1 * b,
        [_, b, c] => [c, c / b],
        [_, a, b, c] => [c, (b + c) / (a + b)],
        [.., z, a, b, c] => {
            let ratio = ((b + c) / (z + a)).sqrt();
            [c.max(ratio.min(1.0) * b), ratio]
        }
    };
    // A ratio 0/0 counts as 1; the highest coefficient is then 0.
    highest * (ratio / of_front).min(1.0).powi(2)
}

/// Estimates along the axes of higher degrees, for `f` and its integral over the velocities.
/// Collective.
fn by_coefficients(prepared: &Prepared, f: &[f64]) -> [f64; 2] {
    let (space, share) = (&prepared.case.space, &prepared.rank_cells.share);
    let world = &prepared.communicator.world;
    let all: Vec<Vec<Vec<f64>>> = space.axes().map(|a| legendre_transform(a.nodes)).collect();
    let of = |space: &PhaseSpace, values: &[f64]| -> f64 {
        let mut squares = CoefficientSquares::default();
        for_each_element(space, share, |element| {
            squares.add(&element.nodal(share, values), &all[..space.axes().count()]);
        });
        squares.error(world)
    };
    let field = of(space, f);
    let factors = VelocityFactors::new(space);
    let density: Vec<f64> = factors.at_points(f).map(|sums| sums[0]).collect();
    let of_density = of(&PhaseSpace { v: Vec::new(), ..space.clone() }, &density);
    [field, of_density]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The mean says nothing about what is beyond.
    #[test]
    fn means_do_not_change_what_is_beyond() {
        for degree in 1..=8 {
            let squares = |mean: f64| -> Vec<f64> {
                (0..=degree).map(|j| if j == 0 { mean } else { 1.0 / f64::from(j) }).collect()
            };
            assert_eq!(beyond(&squares(0.0)), beyond(&squares(25.0)), "degree {degree}");
            assert!(beyond(&squares(1.0)) > 0.0);
        }
    }

    /// If coefficients fall fast, those beyond are smaller than the highest one.
    #[test]
    fn smooth_functions_have_less_beyond() {
        for degree in 2..=8 {
            let fall: Vec<f64> = (0..=degree).map(|j| 0.01f64.powi(j)).collect();
            let highest = fall[fall.len() - 1];
            assert!((0.001..0.01).contains(&(beyond(&fall) / highest)), "degree {degree}");
        }
    }

    /// From degree 4 on, an even or odd function has as much beyond an element's degree as one
    /// whose coefficients fall like its own that are not zero.
    #[test]
    fn even_and_odd_functions_have_a_rest() {
        for degree in 4..=8 {
            for parity in 0..2 {
                let fall = |j: i32| 0.1f64.powi(j);
                let alternating: Vec<f64> =
                    (0..=degree).map(|j| if j % 2 == parity { fall(j) } else { 0.0 }).collect();
                let all: Vec<f64> = (0..=degree).map(fall).collect();
                let ratio = beyond(&alternating) / beyond(&all);
                assert!((0.3..=3.0).contains(&ratio), "degree {degree}, {parity}: {ratio}");
            }
        }
    }
}
