//! Errors of `f` where it is far smaller than what the grid has, as where a front was smeared out
//! into `f = 0`.
//!
//! Particles are drawn by mass, so that few or none are there. Nodes of the grid are drawn by
//! `f_h²` instead, and the path of each is traced back to the data:
//!
//! ```text
//! ∫ (f_h − f)² there = ∫ f_h² × mean of (1 − f/f_h)², zero at nodes where particles show the error
//! ```
//!
//! The draws are systematic in the order of the cells of space, with a random offset for each
//! replicate. Each node is drawn and traced on the rank that has it.

use crate::base::random::uniform;
use crate::base::row_major::{indices, number, position};
use crate::problem::exact::{CellLimits, Tracer};
use crate::problem::grid::box_cells;
use crate::run::errors::ResultOnShare;
use crate::run::particles::draw::{REPLICATES, WeightedPlace, systematic};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

/// Nodes of a replicate.
const NODES: usize = 256;
/// Particles show the error where `|f|` is at least this part of `|f_h|`.
const SEEN: f64 = 0.25;
/// The stream of the random numbers, beside those of particles and their reflections.
const STREAM: u64 = 3;

/// Whether particles show the error where `f` is `exact` and `f_h` is `found`.
pub fn is_seen(exact: f64, found: f64) -> bool {
    exact.abs() >= SEEN * found.abs()
}

/// By replicate `∫ (f_h − f)²` where particles do not show it. Zero if `V` is not finite on the
/// tracer's cells. Collective.
pub fn squares_elsewhere(result: &ResultOnShare<'_>) -> [f64; REPLICATES] {
    let ResultOnShare { world, case, share, volumes, field, .. } = *result;
    let Ok(tracer) = Tracer::with_cells(case, CellLimits::ESTIMATES) else {
        return [0.0; REPLICATES];
    };
    let lengths: Vec<usize> = case.space.x.iter().map(|axis| axis.cells).collect();
    let velocities = case.space.velocity_cells();
    let mut squares = vec![0.0; case.space.space_cells()];
    for (cell, square) in box_cells(share).zip(volumes.squares(field)) {
        squares[number(lengths.iter().copied(), cell)] = square;
    }
    // Each square is known on one rank.
    let squares = world.gathered(squares);
    let all: f64 = squares.iter().sum();
    let mut terms = vec![0.0; REPLICATES * NODES];
    for (replicate, terms) in terms.chunks_mut(NODES).enumerate() {
        let mut random = ChaCha8Rng::seed_from_u64(replicate as u64);
        random.set_stream(STREAM);
        let drawn = systematic(&squares, NODES, uniform(&mut random));
        let (mut own, mut points, mut found) = (Vec::new(), Vec::new(), Vec::new());
        for (k, WeightedPlace { item: cell, part }) in drawn.into_iter().enumerate() {
            let Some(at) = position(share, &indices(cell, &lengths)) else { continue };
            let column = &field[at * velocities..][..velocities];
            let square = |v: usize| volumes.relative(at * velocities + v) * column[v] * column[v];
            let v = velocity_of(part, velocities, square);
            own.push(k);
            points.push(case.space.inner_point(&case.space.cell(cell * velocities + v)));
            found.push(column[v]);
        }
        for ((k, found), exact) in own.into_iter().zip(found).zip(tracer.values(&points, case.end))
        {
            let term = (1.0 - exact / found).powi(2);
            if !is_seen(exact, found) && term.is_finite() {
                terms[k] = term;
            }
        }
    }
    let terms = world.gathered(terms);
    let sum = |replicate: usize| terms[replicate * NODES..][..NODES].iter().sum::<f64>();
    std::array::from_fn(|replicate| all * sum(replicate) / NODES as f64)
}

/// The velocity at which this `part` of the sum of all squares is reached.
fn velocity_of(part: f64, velocities: usize, square: impl Fn(usize) -> f64) -> usize {
    let goal = part * (0..velocities).map(&square).sum::<f64>();
    let (mut passed, mut last) = (0.0, 0);
    for v in (0..velocities).filter(|v| square(*v) > 0.0) {
        (passed, last) = (passed + square(v), v);
        if passed > goal {
            break;
        }
    }
    last
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn velocities_are_drawn_by_their_squares() {
        let squares = [0.0, 1.0, 0.0, 3.0, 0.0];
        let found = [0.0, 0.2, 0.26, 0.9, 1.0].map(|part| velocity_of(part, 5, |v| squares[v]));
        assert_eq!(found, [1, 1, 3, 3, 3]);
    }
}
