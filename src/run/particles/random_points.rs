//! Errors of `f` where it is far smaller than what the grid has, as where a front was smeared out
//! into `f = 0`.
//!
//! Particles are drawn by mass, so that few or none are there. The integral of `(f_h − f)²` over
//! these places is the volume of the box times the mean over random points of the box. From each
//! point the path is traced back to the data.

use crate::parallel::communicator::Group;
use crate::problem::case::Case;
use crate::problem::exact::{MostCells, Tracer};
use crate::problem::grid::PhaseSpace;

/// Random points of a replicate.
pub const POINTS_OF_REPLICATE: usize = 256;
/// Particles show the error where `|f|` is at least this part of `|f_h|`.
const SEEN: f64 = 0.25;
/// A point is not traced back if `f_h²` there in all of the box is less than this part of `∫ f²`.
const NEGLIGIBLE: f64 = 1e-6;

/// `count` random points of the box. With degree 0 they are centres of cells, where the error is
/// measured: a front within a cell is not an error there.
pub fn random_points(space: &PhaseSpace, count: usize) -> Vec<[f64; 6]> {
    let mut points = space.random_points(count);
    if space.whole_degree() == 0 {
        points.iter_mut().for_each(|point| *point = space.nearest_centre(point));
    }
    points
}

/// Whether particles show the error where `f` is `exact` and `f_h` is `found`.
pub fn is_seen(exact: f64, found: f64) -> bool {
    exact.abs() >= SEEN * found.abs()
}

/// Random points of the box.
pub struct RandomPoints<'a> {
    /// The points.
    pub points: &'a [[f64; 6]],
    /// `f_h` at these points.
    pub found: &'a [f64],
}

impl RandomPoints<'_> {
    /// By point the volume of the box times `(f_h − f)²`, and zero where particles show the error.
    /// Empty if `V` is not finite on the tracer's cells; `size` is `∫ f²`. Collective.
    pub fn squares_elsewhere(&self, world: &Group, case: &Case, size: f64) -> Vec<f64> {
        let case = case.from_time_zero();
        let Ok(tracer) = Tracer::with_cells(&case, MostCells::ESTIMATES) else {
            return Vec::new();
        };
        let volume: f64 = case.space.axes().map(|axis| axis.upper - axis.lower).product();
        let counts = |found: f64| found * found * volume > NEGLIGIBLE * size;
        let counted = (0..self.points.len()).filter(|k| counts(self.found[*k]));
        let mine: Vec<usize> = counted.skip(world.rank()).step_by(world.size()).collect();
        let points: Vec<[f64; 6]> = mine.iter().map(|k| self.points[*k]).collect();
        // Each value is known on one rank.
        let mut exact = vec![0.0; self.points.len()];
        for (k, value) in mine.into_iter().zip(tracer.values(&points, case.end)) {
            exact[k] = value;
        }
        let square = |(found, exact): (&f64, f64)| {
            let is_elsewhere = counts(*found) && !is_seen(exact, *found);
            if is_elsewhere { volume * (found - exact) * (found - exact) } else { 0.0 }
        };
        self.found.iter().zip(world.gathered(exact)).map(square).collect()
    }
}
