//! Extreme eigenvalues of `S` by Lanczos, matrix-free, with the residual of each; Gershgorin's
//! bounds.
//!
//! After `n` steps Lanczos gives a tridiagonal `T` of dimension `n`. For an extreme eigenvalue `θ`
//! of `T` with eigenvector `y`, some eigenvalue of `S` is within `β |y_last|` of `θ`, and the
//! extreme eigenvalue of `S` is at least as extreme as `θ` (Parlett, *The symmetric eigenvalue
//! problem*, chapter 13). The iteration ends when this residual is small enough at both ends.
//! Bounds that need no matrix are in [`crate::matrix::bounds::Bounds`].

use crate::base::error::{Error, Result};
use crate::matrix::block_matrix::{BlockMatrix, Operator};
use crate::parallel::communicator::{GhostExchange, Group};
use crate::solve::system::DiscreteSystem;

/// An end of the spectrum is found when its residual is at most this fraction of its magnitude.
const RELATIVE: f64 = 1e-6;
/// An end is also found when its residual is at most this fraction of the spectrum's length, as
/// eigenvalues next to zero are no more accurate than that.
const RELATIVE_TO_LENGTH: f64 = 1e-8;
/// The ends are checked again when the number of steps has grown by this fraction.
const BETWEEN_LOOKS: usize = 16;

/// One end of the spectrum of `S`.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct SpectrumEnd {
    /// The extreme Ritz value: inside the spectrum, but for round-off.
    pub value: f64,
    /// A bound on the distance from `value` to the nearest eigenvalue of `S`.
    pub residual: f64,
    /// Whether the residual is small enough for the search to end.
    pub converged: bool,
}

/// The extreme eigenvalues of `S` found by Lanczos.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct SpectrumExtremes {
    /// Largest eigenvalue.
    pub highest: SpectrumEnd,
    /// Smallest eigenvalue.
    pub lowest: SpectrumEnd,
    /// Number of Lanczos steps.
    pub steps: usize,
}

/// The spectrum of `S`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spectrum {
    /// Both ends, found by Lanczos.
    pub extremes: SpectrumExtremes,
    /// Gershgorin's lower and upper bound.
    pub gershgorin: [f64; 2],
}

impl DiscreteSystem {
    /// Both ends of the spectrum of `S` by at most `steps` Lanczos steps, and Gershgorin's bounds
    /// on it. Collective over `space`.
    ///
    /// # Errors
    /// [`Error::NotFinite`].
    pub fn spectrum(&mut self, space: &Group, steps: usize) -> Result<Spectrum> {
        let Self { matrix, exchange, norm_terms, .. } = self;
        let mut part = SymmetricPart { matrix, exchange, unknowns: *norm_terms };
        let gershgorin = part.gershgorin(space);
        let norm = gershgorin[0].abs().max(gershgorin[1].abs());
        let extremes = part.extremes(space, norm, steps);
        for end in [extremes.highest, extremes.lowest] {
            if !end.value.is_finite() {
                return Err(Error::NotFinite(format!("{} as an eigenvalue of S", end.value)));
            }
        }
        Ok(Spectrum { extremes, gershgorin })
    }
}

/// A symmetric tridiagonal matrix with diagonal `sign · alpha` and off-diagonals `beta > 0`.
struct Tridiagonal<'a> {
    sign: f64,
    alpha: &'a [f64],
    beta: &'a [f64],
}

impl Tridiagonal<'_> {
    fn rows(&self) -> usize {
        self.alpha.len()
    }

    fn diagonal(&self, k: usize) -> f64 {
        self.sign * self.alpha[k]
    }

    /// The entry that couples row `k` to the row before; 0 for the first row.
    fn before(&self, k: usize) -> f64 {
        if k > 0 { self.beta[k - 1] } else { 0.0 }
    }

    /// The entry that couples row `k` to the row after; 0 for the last row.
    fn after(&self, k: usize) -> f64 {
        if k < self.rows() - 1 { self.beta[k] } else { 0.0 }
    }

    /// Gershgorin's bounds on the eigenvalues.
    fn bounds(&self) -> [f64; 2] {
        let edge =
            |k: usize, reach: f64| self.diagonal(k) + reach * (self.after(k) + self.before(k));
        let low = (0..self.rows()).map(|k| edge(k, -1.0)).fold(f64::INFINITY, f64::min);
        [low, (0..self.rows()).map(|k| edge(k, 1.0)).fold(f64::NEG_INFINITY, f64::max)]
    }

    /// The pivot `θ − α_k − link²/last` of row `k`, if `link` couples it to the row with the pivot
    /// `last`.
    fn pivot(&self, theta: f64, k: usize, link: f64, last: f64) -> f64 {
        let shifted = theta - self.diagonal(k);
        if link == 0.0 { shifted } else { shifted - link * link / last }
    }

    /// Whether all eigenvalues are below `theta`: all pivots `d_k = θ − α_k − β_{k−1}²/d_{k−1}` are
    /// positive.
    fn is_below(&self, theta: f64) -> bool {
        let mut d = 1.0;
        (0..self.rows()).all(|k| {
            d = self.pivot(theta, k, self.before(k), d);
            d > 0.0
        })
    }

    /// The largest eigenvalue, by bisection to the last bit.
    fn largest(&self) -> f64 {
        let [mut low, mut high] = self.bounds();
        loop {
            let middle = 0.5 * (low + high);
            if !(low < middle && middle < high) {
                return high;
            }
            if self.is_below(middle) {
                high = middle;
            } else {
                low = middle;
            }
        }
    }

    /// The modulus of the last component of the eigenvector of `theta`, the largest eigenvalue.
    ///
    /// The eigenvector is twisted (Dhillon and Parlett 2004): `y_r = 1` at the row `r` with the
    /// smallest residual of the pivots `d` from above and `e` from below, `y_k = y_{k+1} β_k/d_k`
    /// above it, `y_k = y_{k−1} β_{k−1}/e_k` below. All components have one sign, so nothing
    /// cancels, and a small last component is accurate.
    fn last_component(&self, theta: f64) -> f64 {
        let m = self.rows();
        let (mut d, mut e) = (vec![0.0; m], vec![0.0; m]);
        let mut last = 1.0;
        for k in 0..m {
            last = self.pivot(theta, k, self.before(k), last);
            d[k] = last;
        }
        for k in (0..m).rev() {
            last = self.pivot(theta, k, self.after(k), last);
            e[k] = last;
        }
        let residual = |k: usize| (d[k] + e[k] - (theta - self.diagonal(k))).abs();
        let twist = (0..m).min_by(|&a, &b| residual(a).total_cmp(&residual(b))).unwrap_or(0);
        let (mut square, mut y) = (1.0, 1.0);
        for k in (0..twist).rev() {
            y *= self.after(k) / d[k];
            square += y * y;
        }
        y = 1.0;
        for k in twist + 1..m {
            y *= self.before(k) / e[k];
            square += y * y;
        }
        y.abs() / square.sqrt()
    }
}

/// Both ends of the spectrum of the tridiagonal matrix; `last` is the next off-diagonal.
fn ends(alpha: &[f64], beta: &[f64], last: f64) -> [SpectrumEnd; 2] {
    let matrices = [1.0, -1.0].map(|sign| Tridiagonal { sign, alpha, beta });
    let thetas = matrices.each_ref().map(Tridiagonal::largest);
    let length = thetas[0] + thetas[1];
    std::array::from_fn(|k| {
        let (matrix, theta) = (&matrices[k], thetas[k]);
        // Not below the round-off of the Lanczos recurrence.
        let residual = (last * matrix.last_component(theta)).max(4.0 * f64::EPSILON * length);
        SpectrumEnd {
            value: matrix.sign * theta,
            residual,
            converged: residual <= (RELATIVE * theta.abs()).max(RELATIVE_TO_LENGTH * length),
        }
    })
}

/// A start vector that is the same for any partition: a hash of the global number of the unknown.
fn start_value(global: usize) -> f64 {
    let mut h = (global as u64).wrapping_add(0x9e37_79b9_7f4a_7c15);
    h = (h ^ (h >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    h = (h ^ (h >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    (h >> 11) as f64 / (1u64 << 53) as f64 - 0.5
}

/// `S` on the ranks of a space group.
pub struct SymmetricPart<'a> {
    /// The rows of `(S, K)`.
    pub matrix: &'a BlockMatrix,
    /// Exchange of ghosts.
    pub exchange: &'a mut GhostExchange,
    /// Number of terms of a norm over all ranks.
    pub unknowns: usize,
}

impl SymmetricPart<'_> {
    /// Gershgorin's bounds on the spectrum: `min (s_ii − Σ|s_ij|)` and `max (s_ii + Σ|s_ij|)`.
    /// Collective over `space`.
    pub fn gershgorin(&self, space: &Group) -> [f64; 2] {
        let matrix = self.matrix;
        let mut bounds = [f64::NEG_INFINITY; 2];
        let shared = matrix.shared_row();
        for i in 0..matrix.rows() {
            let (mut diagonal, mut radius) = (0.0, 0.0);
            for (j, s, _) in matrix.row(i) {
                if i == j {
                    diagonal = s;
                } else {
                    radius += s.abs();
                }
            }
            if shared == Some(i) {
                // Every rank holds its part of this row.
                radius = space.sum_terms(&[radius]);
            }
            bounds[0] = bounds[0].max(radius - diagonal);
            bounds[1] = bounds[1].max(radius + diagonal);
        }
        space.max_into(&mut bounds);
        [-bounds[0], bounds[1]]
    }

    /// Lanczos until both ends of the spectrum are found, at most `steps` steps, without
    /// reorthogonalisation: copies of converged values appear, which do not affect the extremes.
    /// `norm` bounds `‖S‖`. Collective over `space`.
    pub fn extremes(&mut self, space: &Group, norm: f64, steps: usize) -> SpectrumExtremes {
        let Self { matrix, exchange, unknowns } = self;
        let (matrix, unknowns) = (*matrix, *unknowns);
        let rows = matrix.rows();
        let mut vector = start_vector(matrix, unknowns);
        let dot = |a: &[f64], b: &[f64], bound: f64| {
            matrix.sum_rows(space, bound, unknowns, |i| a[i] * b[i])
        };
        let most = matrix.block.velocity_cells as f64;
        let length = dot(&vector, &vector, most).sqrt();
        vector[..rows].iter_mut().for_each(|x| *x /= length);
        let mut previous = vec![0.0; rows];
        let mut image = vec![0.0; matrix.length()];
        let (mut alpha, mut beta): (Vec<f64>, Vec<f64>) = (Vec::new(), Vec::new());
        let bound = 2.0 * norm * norm.max(1.0) + 1.0;
        let mut off = 0.0;
        let mut found: Option<[SpectrumEnd; 2]> = None;
        let mut next_look = 2;
        loop {
            matrix.apply(exchange, Operator::Symmetric, &mut image, &mut vector);
            let a = dot(&image, &vector, bound);
            for i in 0..rows {
                image[i] -= a * vector[i] + off * previous[i];
            }
            alpha.push(a);
            off = dot(&image, &image, bound).max(0.0).sqrt();
            // The Krylov space is invariant: more steps from this start find no other eigenvalue.
            let exhausted = off <= 1e-14 * norm || !off.is_finite();
            let m = alpha.len();
            let over = exhausted || m >= steps;
            if over || m == next_look {
                next_look = m + 1 + m / BETWEEN_LOOKS;
                found = Some(with_earlier(ends(&alpha, &beta, off), found));
            }
            if let Some([highest, lowest]) = found
                && (over || (highest.converged && lowest.converged))
            {
                return SpectrumExtremes { highest, lowest, steps: m };
            }
            beta.push(off);
            for i in 0..rows {
                previous[i] = vector[i];
                vector[i] = image[i] / off;
            }
        }
    }
}

/// The vector that Lanczos starts from, the same on any number of ranks, with room for ghosts.
/// Auxiliary unknowns start with the value of their rows; a common unknown of all ranks with that
/// of a cell after the grid's `unknowns`.
fn start_vector(matrix: &BlockMatrix, unknowns: usize) -> Vec<f64> {
    let (rows, cells) = (matrix.rows(), matrix.block.cells());
    let mut vector = vec![0.0; matrix.length()];
    matrix.block.for_each_own(|global, local| {
        for v in 0..matrix.block.velocity_cells {
            vector[local + v] = start_value(global + v);
        }
    });
    // Not by the number of rows with inflow, which may be 1 beside a common unknown, too.
    if matrix.shared_row().is_none() {
        for (m, aux) in matrix.inflow.iter().enumerate() {
            vector[cells + m] = vector[aux.row as usize];
        }
    } else {
        vector[cells..rows].fill(start_value(unknowns));
    }
    vector
}

/// Both ends, each with the smaller of its residuals `now` and `before`: later copies of a
/// converged value increase its residual, but do not change the value.
fn with_earlier(mut now: [SpectrumEnd; 2], before: Option<[SpectrumEnd; 2]>) -> [SpectrumEnd; 2] {
    for (now, before) in now.iter_mut().zip(before.into_iter().flatten()) {
        if before.residual < now.residual {
            (now.residual, now.converged) = (before.residual, before.converged);
        }
    }
    now
}

#[cfg(test)]
mod tests {
    use super::*;
    use faer::{Mat, Side};

    /// Against all eigenvalues and vectors of the same matrix.
    #[test]
    fn extreme_pairs_of_tridiagonal_matrices() {
        for m in [1, 2, 3, 7, 40] {
            for seed in 0..20 {
                let number = |k: usize| start_value(1000 * seed + 10 * m + k);
                let alpha: Vec<f64> = (0..m).map(|k| 3.0 * number(k)).collect();
                let beta: Vec<f64> = (0..m - 1).map(|k| 0.01 + number(50 + k).abs()).collect();
                let matrix = Mat::from_fn(m, m, |i, j| match i.abs_diff(j) {
                    0 => alpha[i],
                    1 => beta[i.min(j)],
                    _ => 0.0,
                });
                let all = matrix.self_adjoint_eigen(Side::Lower).expect("it converges");
                for (sign, at) in [(1.0, m - 1), (-1.0, 0)] {
                    let tridiagonal = Tridiagonal { sign, alpha: &alpha, beta: &beta };
                    let theta = tridiagonal.largest();
                    let last = tridiagonal.last_component(theta);
                    let (value, component) = (all.S()[at], all.U()[(m - 1, at)].abs());
                    assert!((sign * theta - value).abs() < 1e-13, "{m} {seed}: {theta} {value}");
                    assert!((last - component).abs() < 1e-10, "{m} {seed}: {last} {component}");
                }
            }
        }
    }
}
