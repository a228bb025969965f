//! Measure-valued data `f = φ Π_a δ(ψ_a)` at one point of space, with a discrete delta function.
//!
//! The density `φ` and the level sets `ψ_a` obey the Liouville equation with smooth data. Only at
//! the output time a delta function is evaluated on the velocity grid (paper, section Numerical
//! examples; Jin and Wen 2005):
//!
//! ```text
//! δ_ω(y) = (1 + cos(πy/ω))/(2ω) for |y| ≤ ω, else 0,      ω_a = max(|det ∂Ψ/∂v|, 1) Δv_a
//! ```
//!
//! In one dimension, if `ψ` is linear in `v` with a slope of magnitude 1 or more, `δ_ω(ψ)` is a
//! bell of half-width `Δv` in `v`, and its values sum to `1/(|ψ'| Δv)` exactly, wherever its centre
//! lies. For slopes below 1 the half-width is `K = 1/|ψ'|` cells, and the sum has the factor
//! `1 + 2 sin(2πK)/(2πK(1 − 4K²)) cos(2πc) + …` with the centre `c` in cells. The error is at most
//! 6 %, and zero if `2K` is an integer.
//!
//! In more dimensions the determinant is not the right width of each axis: for
//! `∂Ψ/∂v = diag(λ_1, λ_2)` the bell of axis 1 has the half-width `K_1 = |λ_2|` cells, and below
//! one cell it falls between the lattice points. [`DeltaWidth::Gradient`] takes the width of each
//! level set from its own gradient, `Σ_b |∂ψ_a/∂v_b| Δv_b` (Engquist, Tornberg, Tsai 2005). This is
//! the same in one dimension, and right for any diagonal Jacobian.

use crate::problem::case::DeltaWidth;
use crate::problem::grid::{MAX_DIMENSION, PhaseSpace, for_each_cell};
use std::f64::consts::PI;

/// `δ_ω(y)`.
pub fn delta(y: f64, omega: f64) -> f64 {
    if y.abs() <= omega { (1.0 + (PI * y / omega).cos()) / (2.0 * omega) } else { 0.0 }
}

/// A square matrix of up to three rows, extended by those of the identity.
pub type Jacobian = [[f64; MAX_DIMENSION]; MAX_DIMENSION];

/// The identity.
pub const IDENTITY: Jacobian = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// `det J`.
pub fn determinant(j: &Jacobian) -> f64 {
    let minor = |a: usize, b: usize| j[1][a] * j[2][b] - j[1][b] * j[2][a];
    j[0][0] * minor(1, 2) - j[0][1] * minor(0, 2) + j[0][2] * minor(0, 1)
}

/// `∂ψ/∂v` at cell `j` along an axis of `cells` cells of width `h`, where `value(i)` is `ψ` in cell
/// `i`. The difference is central, and one-sided at the ends. `None` for a single cell.
fn derivative(j: usize, cells: usize, h: f64, value: impl Fn(usize) -> f64) -> Option<f64> {
    let (lower, upper) = (j.saturating_sub(1), (j + 1).min(cells - 1));
    (lower < upper).then(|| (value(upper) - value(lower)) / ((upper - lower) as f64 * h))
}

/// `out ← φ Π_a δ_{ω_a}(ψ_a)` over the velocity cells at one point of space; `phi` and each of
/// `psi` hold the values there.
pub fn concentrate(
    out: &mut [f64],
    space: &PhaseSpace,
    width: DeltaWidth,
    phi: &[f64],
    psi: &[&[f64]],
) {
    let n = space.dimension();
    let mut strides = [1; MAX_DIMENSION];
    for a in (1..n).rev() {
        strides[a - 1] = strides[a] * space.v[a].cells;
    }
    let ranges: [_; MAX_DIMENSION] =
        std::array::from_fn(|a| 0..space.v.get(a).map_or(1, |v| v.cells));
    let mut at = 0;
    for_each_cell(&ranges[..n], |j| {
        let mut jacobian = IDENTITY;
        for a in 0..n {
            for b in 0..n {
                let value = |i: usize| psi[a][at - j[b] * strides[b] + i * strides[b]];
                let axis = &space.v[b];
                if let Some(slope) = derivative(j[b], axis.cells, axis.width(), value) {
                    jacobian[a][b] = slope;
                }
            }
        }
        let mut product = phi[at];
        for a in 0..n {
            let h = space.v[a].width();
            let omega = match width {
                DeltaWidth::Determinant => determinant(&jacobian).abs().max(1.0) * h,
                DeltaWidth::Gradient => {
                    (0..n).map(|b| jacobian[a][b].abs() * space.v[b].width()).sum::<f64>().max(h)
                }
            };
            product *= delta(psi[a][at], omega);
        }
        out[at] = product;
        at += 1;
    });
}

#[cfg(test)]
mod tests;
