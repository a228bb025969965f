//! Extreme eigenvalues of `S` by Lanczos, matrix-free; bounds without it are in [`crate::plan::Bounds`].

use crate::communicator::{GhostExchange, Group};
use crate::matrix::{BlockMatrix, Part};
use faer::{Mat, Side};

/// The extreme eigenvalues of `S` found by Lanczos (lower bounds on the true magnitudes).
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Extremes {
    /// Largest eigenvalue.
    pub highest: f64,
    /// Smallest eigenvalue.
    pub lowest: f64,
    /// Steps done.
    pub steps: usize,
}

/// A start vector that is the same for any partition: a hash of the global number of the unknown.
fn start_value(global: usize) -> f64 {
    let mut h = (global as u64).wrapping_add(0x9e37_79b9_7f4a_7c15);
    h = (h ^ (h >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    h = (h ^ (h >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    (h >> 11) as f64 / (1u64 << 53) as f64 - 0.5
}

/// Lanczos on `S` for at most `steps` steps, without reorthogonalisation: copies of converged values appear, which the
/// extremes do not mind. `norm` bounds `‖S‖`; `unknowns` is the number over all ranks. Collective over `space`.
pub fn extremes(
    matrix: &BlockMatrix,
    exchange: &mut GhostExchange,
    space: &Group,
    norm: f64,
    unknowns: usize,
    steps: usize,
) -> Extremes {
    let (rows, cells) = (matrix.rows(), matrix.block.cells());
    let mut vector = vec![0.0; matrix.length()];
    matrix.block.for_each_own(|global, local| {
        for v in 0..matrix.block.velocity_cells {
            vector[local + v] = start_value(global + v);
        }
    });
    // Auxiliary unknowns start like their rows, a common one of all ranks like a cell beyond the grid.
    if matrix.auxiliaries() == matrix.inflow.len() {
        for (m, aux) in matrix.inflow.iter().enumerate() {
            vector[cells + m] = vector[aux.row as usize];
        }
    } else {
        vector[cells..rows].fill(start_value(unknowns));
    }
    let dot =
        |a: &[f64], b: &[f64], bound: f64| matrix.sum_rows(space, bound, unknowns, |i| a[i] * b[i]);
    let length = dot(&vector, &vector, unknowns as f64).sqrt();
    vector[..rows].iter_mut().for_each(|x| *x /= length);
    let mut previous = vec![0.0; rows];
    let mut image = vec![0.0; matrix.length()];
    let (mut alpha, mut beta): (Vec<f64>, Vec<f64>) = (Vec::new(), Vec::new());
    let bound = 2.0 * norm * norm.max(1.0) + 1.0;
    let mut off = 0.0;
    for _ in 0..steps.min(unknowns) {
        matrix.apply(exchange, Part::Symmetric, &mut image, &mut vector);
        let a = dot(&image, &vector, bound);
        for i in 0..rows {
            image[i] -= a * vector[i] + off * previous[i];
        }
        alpha.push(a);
        off = dot(&image, &image, bound).max(0.0).sqrt();
        if off <= 1e-14 * norm {
            break;
        }
        beta.push(off);
        for i in 0..rows {
            previous[i] = vector[i];
            vector[i] = image[i] / off;
        }
    }
    let m = alpha.len();
    let tridiagonal = Mat::from_fn(m, m, |i, j| match i.abs_diff(j) {
        0 => alpha[i],
        1 => beta[i.min(j)],
        _ => 0.0,
    });
    let values = tridiagonal
        .self_adjoint_eigenvalues(Side::Lower)
        .unwrap_or_default();
    Extremes {
        highest: values.last().copied().unwrap_or(f64::NAN),
        lowest: values.first().copied().unwrap_or(f64::NAN),
        steps: m,
    }
}
