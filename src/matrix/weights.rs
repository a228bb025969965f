//! Dissipative weights: a weighted norm in which solutions with the hat interface do not grow.
//!
//! `A` has off-diagonals ≥ 0 and row sums ≤ 0, but at an interface some column sums are positive,
//! so `S` has positive eigenvalues that grow like `1/Δx`. For any `π > 0` with `D = diag(√π)`,
//! Cauchy–Schwarz in the form
//!
//! ```text
//! Σ π_i y_i A_ij y_j ≤ ½ Σ π_i (A1)_i y_i² + ½ Σ (Aᵀπ)_j y_j²
//! ```
//!
//! gives `λ⁺(sym D A D⁻¹) ≤ ½ max_j (Aᵀπ)_j/π_j`, the certificate. Weights that make it small solve
//! the M-matrix system `(Aᵀ − s I) π' = −e`, `e_j = max(0, (Aᵀ1)_j)`, `π = 1 + π'`, by Jacobi
//! sweeps. If no particle returns to a cell that it has left, the system with `s = 0` is solved
//! exactly by as many sweeps as the longest path has cells, and `λ⁺ = 0`. If particles are trapped,
//! as in a well, `Aᵀ` is singular: after some sweeps the system with `s > 0` is used, until the
//! certificate suffices. Only maxima are reduced over ranks, so that the result is the same on any
//! ranks.

use crate::base::error::{Error, Result};
use crate::base::fixed_point::larger;
use crate::matrix::block_matrix::{BlockMatrix, Operator};
use crate::parallel::communicator::{GhostExchange, Group};
use crate::problem::grid::{Axis, PhaseSpace};
use std::ops::Range;

/// A Jacobi sweep contracts by `d/(d + s)`; after this many times `d/s` sweeps it has converged.
const MOST_SWEEPS: f64 = 100.0;
/// A certificate below this fraction of the sufficient one counts as zero.
const NEGLIGIBLE: f64 = 1e-6;

/// Numbers that are compared at once.
const ABREAST: usize = 8;

/// Largest of the values; NaN if one is.
fn largest(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(f64::NEG_INFINITY, larger)
}

/// Largest `a/b`; NaN if one is.
fn largest_quotient(a: &[f64], b: &[f64]) -> f64 {
    let (of_a, rest_of_a) = a.as_chunks::<ABREAST>();
    let (of_b, rest_of_b) = b.as_chunks::<ABREAST>();
    let mut most = [f64::NEG_INFINITY; ABREAST];
    for (a, b) in of_a.iter().zip(of_b) {
        most = std::array::from_fn(|l| larger(most[l], a[l] / b[l]));
    }
    let rest = rest_of_a.iter().zip(rest_of_b).map(|(a, b)| a / b);
    largest(most.into_iter().chain(rest))
}

/// Refuses negative off-diagonal entries `(row, column, A_ij)`: the bound on `λ⁺` does not hold
/// then.
fn refuse_negative(entries: impl Iterator<Item = (usize, usize, f64)>) -> Result<()> {
    for (row, column, value) in entries {
        if row != column && (value.is_nan() || value < 0.0) {
            return Err(Error::Negative { row, column, value });
        }
    }
    Ok(())
}

/// The weights `π` and the bounds that they give.
#[derive(Clone, Debug)]
pub struct Weights {
    /// `π` for the rows and ghosts of the matrix, at least 1 if dissipative; 1 for auxiliary
    /// unknowns until they are coupled.
    pub pi: Vec<f64>,
    /// `½ max (Aᵀπ)/π`, a bound on `λ⁺`.
    pub certificate: f64,
    /// Jacobi sweeps done.
    pub sweeps: usize,
    /// `max √π / min √π`.
    pub spread: f64,
    /// Whether the weights are the volumes of the cells relative to their mean.
    pub are_volumes: bool,
}

/// The goal of dissipative weights.
#[derive(Clone, Copy, Debug)]
pub struct WeightGoal {
    /// Largest certificate that suffices.
    pub limit: f64,
    /// Shift `s > limit` of the system that is used if the one without shift does not suffice.
    pub shift: f64,
    /// Sweeps of the system without shift.
    pub max_weight_sweeps: usize,
}

impl Weights {
    /// The quadrature weights of a scheme of a degree above 0, relative to their mean. In these
    /// unknowns `S ≤ 0` by construction (see [`crate::scheme::galerkin`]), and the square of the
    /// norm is proportional to the integral of `f²`.
    pub fn volumes(matrix: &BlockMatrix, space: &PhaseSpace) -> Self {
        let mut pi = vec![1.0; matrix.length()];
        let (rows, nv) = (matrix.rows(), matrix.block.velocity_cells);
        let mut set = |global: usize, local: usize| {
            for v in 0..nv {
                pi[local + v] = space.relative_volume(&space.cell(global + v));
            }
        };
        matrix.block.for_each_own(&mut set);
        matrix.block.for_each_ghost(|global, ghost| set(global, rows + ghost));
        let range = |axis: &Axis| {
            let weights = (0..axis.nodes.count()).map(|m| axis.relative_weight(m));
            let most = weights.clone().fold(0.0, f64::max);
            most / weights.fold(f64::INFINITY, f64::min)
        };
        let spread = space.axes().map(range).product::<f64>().sqrt();
        Self { pi, certificate: 0.0, sweeps: 0, spread, are_volumes: true }
    }

    /// No weights, `π = 1`, with the certificate of `matrix`.
    pub fn none(matrix: &BlockMatrix, exchange: &mut GhostExchange, space: &Group) -> Self {
        let mut state = SweepState::new(matrix);
        let certificate = state.certificate(matrix, exchange, space);
        Self {
            pi: vec![1.0; matrix.length()],
            certificate,
            sweeps: 0,
            spread: 1.0,
            are_volumes: false,
        }
    }

    /// Weights that reach `goal`, or better ones within its sweeps without shift. Collective over
    /// the space group.
    ///
    /// # Errors
    /// [`Error::Negative`] if an off-diagonal entry is negative; [`Error::Weights`] if the sweeps
    /// do not reach the goal.
    pub fn dissipative(
        matrix: &BlockMatrix,
        exchange: &mut GhostExchange,
        space: &Group,
        goal: WeightGoal,
    ) -> Result<Self> {
        let WeightGoal { shift, limit, max_weight_sweeps } = goal;
        let cells = matrix.block.cells();
        let entries = (0..cells).flat_map(|i| matrix.row(i).map(move |(j, s, k)| (i, j, s + k)));
        space.agree(refuse_negative(entries))?;
        let mut state = SweepState::new(matrix);
        let mut sweeps = 0;
        let rate = space.max(state.diagonal.iter().copied().fold(0.0, f64::max));
        let most_sweeps = max_weight_sweeps.saturating_add((MOST_SWEEPS * rate / shift) as usize);
        let certificate = loop {
            let certificate = state.certificate(matrix, exchange, space);
            let unshifted = sweeps < max_weight_sweeps;
            if certificate <= if unshifted { NEGLIGIBLE * limit } else { limit } {
                break certificate;
            }
            if sweeps == most_sweeps || certificate.is_nan() {
                return Err(Error::Weights { certificate, limit, sweeps });
            }
            state.sweep(shift, unshifted);
            sweeps += 1;
        };
        let mut pi: Vec<f64> = state.extra.iter().map(|p| 1.0 + p).collect();
        let rows = matrix.rows();
        exchange.start(&pi[..rows]);
        exchange.finish(&mut pi[rows..]);
        let own = &pi[..cells];
        let most = space.max(largest(own.iter().copied()));
        let least = -space.max(largest(own.iter().map(|p| -p)));
        Ok(Self { pi, certificate, sweeps, spread: (most / least).sqrt(), are_volumes: false })
    }

    /// Turns `ũ` on the cells `range` into `f`, by undoing the weights.
    pub fn unweighted(&self, range: &Range<usize>, mut state: Vec<f64>) -> Vec<f64> {
        for (u, pi) in state.iter_mut().zip(&self.pi[range.clone()]) {
            *u /= pi.sqrt();
        }
        state
    }

    /// `f` on the cells `range` of the whole `state` of a rank.
    pub fn own_field(&self, range: &Range<usize>, state: &[f64]) -> Vec<f64> {
        self.unweighted(range, state[range.clone()].to_vec())
    }
}

struct SweepState {
    /// `π' = π − 1`, rows and ghosts.
    extra: Vec<f64>,
    /// `Aᵀ π`.
    image: Vec<f64>,
    /// `−A_ii`.
    diagonal: Vec<f64>,
    /// `e_j − (Aᵀ1)_j`, the difference of `Aᵀπ' + e` and `Aᵀπ`.
    offset: Vec<f64>,
    cells: usize,
    pi: Vec<f64>,
}

impl SweepState {
    fn new(matrix: &BlockMatrix) -> Self {
        let (cells, length) = (matrix.block.cells(), matrix.length());
        let diagonal = (0..cells)
            .map(|i| matrix.row(i).filter(|&(j, ..)| j == i).map(|(_, s, _)| -s).sum())
            .collect();
        Self {
            extra: vec![0.0; length],
            image: vec![0.0; length],
            diagonal,
            offset: Vec::new(),
            cells,
            pi: vec![1.0; length],
        }
    }

    /// Computes `Aᵀπ` and from it `½ max (Aᵀπ)/π` over the cells.
    fn certificate(
        &mut self,
        matrix: &BlockMatrix,
        exchange: &mut GhostExchange,
        space: &Group,
    ) -> f64 {
        for (pi, extra) in self.pi[..self.cells].iter_mut().zip(&self.extra) {
            *pi = 1.0 + extra;
        }
        matrix.apply(exchange, Operator::Transpose, &mut self.image, &mut self.pi);
        if self.offset.is_empty() {
            // On the first call `π = 1`, so that the image has the column sums.
            self.offset = self.image[..self.cells].iter().map(|&c| c.max(0.0) - c).collect();
        }
        let own = 0..self.cells;
        0.5 * space.max(largest_quotient(&self.image[own.clone()], &self.pi[own]))
    }

    /// `π' ← (Bᵀπ' + e)/(d + s)`, with `Bᵀπ' = Aᵀπ' + dπ'` and `A = B − d`. Cells without outflow
    /// (`d = 0`, particles at rest) always use the shift, others unless the sweep is `unshifted`.
    fn sweep(&mut self, shift: f64, unshifted: bool) {
        for i in 0..self.cells {
            let d = self.diagonal[i];
            let shift = if unshifted && d > 0.0 { 0.0 } else { shift };
            let right = self.image[i] + self.offset[i] + d * self.extra[i];
            self.extra[i] = (right / (d + shift)).max(0.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_quotient_is_found_anywhere() {
        for length in [1, 7, 8, 21] {
            let ones = vec![1.0; length];
            for at in 0..length {
                let mut values = vec![-2.0; length];
                values[at] = -1.0;
                assert_eq!(largest_quotient(&values, &ones), -1.0, "{at} of {length}");
                values[at] = f64::NAN;
                assert!(largest_quotient(&values, &ones).is_nan(), "{at} of {length}");
            }
        }
    }

    #[test]
    fn negative_entries_are_refused() {
        let good = [(0, 0, -2.0), (0, 1, 1.0), (1, 1, -1.0), (1, 0, 0.0)];
        assert!(refuse_negative(good.into_iter()).is_ok());
        let bad = good.into_iter().chain([(2, 1, -1e-3)]);
        let message = refuse_negative(bad).map_err(|e| e.to_string());
        assert!(message.is_err_and(|m| m.contains("row 2") && m.contains("-1e-3")));
        assert!(refuse_negative([(0, 1, f64::NAN)].into_iter()).is_err());
    }
}
