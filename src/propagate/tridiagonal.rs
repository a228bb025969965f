//! The exponential of a small tridiagonal matrix, by its eigenvalues; nothing is allocated.

use num_complex::Complex64;

/// Largest dimension `m` of the Krylov space.
pub(super) const DIMENSION: usize = 30;

/// The exponential of `T_m` by its eigenvalues `θ_k` and -vectors `q_k`.
pub(super) struct TridiagonalExponential {
    values: [f64; DIMENSION],
    /// The eigenvectors `q_k`.
    vectors: [[f64; DIMENSION]; DIMENSION],
    /// The first column `y` of the exponential.
    column: [Complex64; DIMENSION],
    /// `q_{0k} q_{m−1,k} e^{−iθ_k s}` and `e^{−iθ_k δ}`.
    terms: [Complex64; DIMENSION],
    turns: [Complex64; DIMENSION],
}

/// The limits of a step that the residual determines.
pub(super) struct ResidualLimits {
    /// `β_{m−1}`.
    pub beta: f64,
    /// The pieces of time in which the residual is integrated.
    pub piece: f64,
    /// The longest step, but for a part of a piece.
    pub longest: f64,
    /// Allowed error by length of the step.
    pub slope: f64,
}

/// A step of a Krylov space.
pub(super) struct BoundedStep {
    /// The time that it covers.
    pub length: f64,
    /// A bound on its error, relative to the norm of the state.
    pub error: f64,
}

impl TridiagonalExponential {
    pub(super) fn new() -> Self {
        Self {
            values: [0.0; DIMENSION],
            vectors: [[0.0; DIMENSION]; DIMENSION],
            column: [Complex64::ZERO; DIMENSION],
            terms: [Complex64::ZERO; DIMENSION],
            turns: [Complex64::ZERO; DIMENSION],
        }
    }

    /// Finds the eigenvalues and -vectors of the tridiagonal matrix of dimension `m` with `(α_j,
    /// β_j)` in `entry`; returns whether it converged. QL iteration with implicit shifts (Dubrulle,
    /// Martin and Wilkinson 1968): unlike a general routine it allocates nothing.
    pub(super) fn decompose(&mut self, m: usize, entry: impl Fn(usize) -> (f64, f64)) -> bool {
        const MOST_SWEEPS: usize = 100;
        let (d, q) = (&mut self.values, &mut self.vectors);
        let mut e = [0.0; DIMENSION];
        for j in 0..m {
            let (alpha, beta) = entry(j);
            (d[j], e[j]) = (alpha, if j + 1 < m { beta } else { 0.0 });
            q[j] = [0.0; DIMENSION];
            q[j][j] = 1.0;
        }
        for l in 0..m {
            for sweep in 0.. {
                // The block that begins at l ends where a coupling is negligible.
                let d = &self.values;
                let negligible =
                    |j: &usize| e[*j].abs() <= f64::EPSILON * (d[*j].abs() + d[*j + 1].abs());
                let end = (l..m - 1).find(negligible).unwrap_or(m - 1);
                if end == l {
                    break;
                }
                if sweep == MOST_SWEEPS || e[l].is_nan() {
                    return false;
                }
                self.sweep(&mut e, [l, end], m);
            }
        }
        true
    }

    /// A sweep over the block from row `l` to row `end`, by Wilkinson's shift from the top of the
    /// block; rotations chase the bulge up from its bottom. `e` are the couplings.
    fn sweep(&mut self, e: &mut [f64; DIMENSION], [l, end]: [usize; 2], m: usize) {
        let (d, q) = (&mut self.values, &mut self.vectors);
        let half = 0.5 * (d[l + 1] - d[l]) / e[l];
        let mut g = d[end] - d[l] + e[l] / (half + half.hypot(1.0).copysign(half));
        let (mut s, mut c, mut shift) = (1.0, 1.0, 0.0);
        for i in (l..end).rev() {
            let (f, b) = (s * e[i], c * e[i]);
            let r = g.hypot(f);
            e[i + 1] = r;
            if r == 0.0 {
                // The block falls into two.
                d[i + 1] -= shift;
                e[end] = 0.0;
                return;
            }
            (s, c) = (f / r, g / r);
            g = d[i + 1] - shift;
            let t = (d[i] - g) * s + 2.0 * c * b;
            shift = s * t;
            d[i + 1] = g + shift;
            g = c * t - b;
            let (lower, upper) = q.split_at_mut(i + 1);
            for (x, y) in lower[i][..m].iter_mut().zip(&mut upper[0][..m]) {
                (*x, *y) = (c * *x - s * *y, s * *x + c * *y);
            }
        }
        d[l] -= shift;
        e[l] = g;
        e[end] = 0.0;
    }

    /// The longest step `s`, a multiple of a piece, with `β ∫ |(exp(−iTs))_{m−1,0}| ds ≤ slope s`,
    /// and that integral as the bound on its error.
    pub(super) fn follow(&mut self, m: usize, limits: &ResidualLimits) -> BoundedStep {
        let &ResidualLimits { beta, piece, longest, slope } = limits;
        if beta == 0.0 {
            return BoundedStep { length: longest, error: 0.0 };
        }
        for k in 0..m {
            let product = self.vectors[k][0] * self.vectors[k][m - 1];
            self.terms[k] = product.into();
            self.turns[k] = Complex64::new(0.0, -self.values[k] * piece).exp();
        }
        let entry = |terms: &[Complex64]| terms.iter().sum::<Complex64>().norm();
        let (mut s, mut integral) = (0.0, 0.0);
        let mut before = entry(&self.terms[..m]);
        while s < longest {
            for (term, turn) in self.terms[..m].iter_mut().zip(&self.turns) {
                *term *= turn;
            }
            let after = entry(&self.terms[..m]);
            let next = integral + beta * piece * f64::max(before, after);
            // NaN ends the loop, too.
            if next.is_nan() || next > slope * (s + piece) {
                break;
            }
            (s, integral, before) = (s + piece, next, after);
        }
        BoundedStep { length: s, error: integral }
    }

    /// `y = exp(−iTτ) e_0`.
    pub(super) fn exponential(&mut self, m: usize, tau: f64) -> &[Complex64] {
        for k in 0..m {
            let turn = Complex64::new(0.0, -self.values[k] * tau).exp();
            self.terms[k] = self.vectors[k][0] * turn;
        }
        for j in 0..m {
            let row = (0..m).map(|k| self.vectors[k][j] * self.terms[k]);
            self.column[j] = row.sum();
        }
        &self.column[..m]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tridiagonal_matrices_are_decomposed() {
        let mut projected = TridiagonalExponential::new();
        // An ordinary matrix; one decoupled in the middle and at the end; a multiple of the
        // identity; a graded one.
        let cases: [&dyn Fn(usize) -> (f64, f64); 4] = [
            &|j| (((j * 7) % 5) as f64 - 2.0, 1.0 + 0.1 * j as f64),
            &|j| (j as f64, if j % 4 == 2 || j > 7 { 0.0 } else { 0.5 }),
            &|_| (3.0, 0.0),
            &|j| (10f64.powi(-(j as i32)), 10f64.powi(-(j as i32))),
        ];
        for entry in cases {
            for m in [1, 2, 3, 11, DIMENSION] {
                assert!(projected.decompose(m, entry));
                let (d, q) = (&projected.values, &projected.vectors);
                for k in 0..m {
                    for j in 0..m {
                        let (alpha, beta) = entry(j);
                        let left = if j > 0 { entry(j - 1).1 * q[k][j - 1] } else { 0.0 };
                        let right = if j + 1 < m { beta * q[k][j + 1] } else { 0.0 };
                        let residual = left + alpha * q[k][j] + right - d[k] * q[k][j];
                        assert!(residual.abs() < 1e-13, "{m} {k} {j}: {residual:e}");
                        let product: f64 = (0..m).map(|i| q[k][i] * q[j][i]).sum();
                        let unit = f64::from(u8::from(j == k));
                        assert!((product - unit).abs() < 1e-13);
                    }
                }
            }
        }
        assert!(!projected.decompose(3, |_| (f64::NAN, f64::NAN)));
    }
}
