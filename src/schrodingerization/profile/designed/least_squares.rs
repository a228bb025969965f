//! Regularised linear least squares, dense, by Householder's reflections.
//!
//! It uses additions, multiplications, divisions and square roots in a fixed order only, so that
//! every machine finds the same bits. The minimiser is sensitive to rounding (the minimum is not),
//! and the ranks of a run must agree on it.

/// Partial sums of a scalar product; the compiler adds them side by side.
const LANES: usize = 8;

/// The minimiser `c` of `‖Bc − f‖² + η²‖c‖²`: `Q R = [B; ηI]`, `R c = Qᵀ [f; 0]`. The columns of
/// `B` have the length of `f`.
pub fn minimiser(columns: &[Vec<f64>], f: &[f64], eta: f64) -> Vec<f64> {
    let (rows, n) = (f.len(), columns.len());
    // Column by column, the right-hand side last.
    let height = rows + n;
    let mut a = vec![0.0; height * (n + 1)];
    for (j, column) in columns.iter().enumerate() {
        a[j * height..][..rows].copy_from_slice(column);
        a[j * height + rows + j] = eta;
    }
    a[n * height..][..rows].copy_from_slice(f);
    for k in 0..n {
        let (left, right) = a.split_at_mut((k + 1) * height);
        // Below row `rows + k` column k is still zero.
        let active = k..rows + k + 1;
        let v = &mut left[k * height..][active.clone()];
        let norm = dot(v, v).sqrt();
        let diagonal = if v[0] > 0.0 { -norm } else { norm };
        v[0] -= diagonal;
        let half_square = -diagonal * v[0];
        for column in right.chunks_exact_mut(height) {
            let w = &mut column[active.clone()];
            let factor = dot(v, w) / half_square;
            w.iter_mut().zip(&*v).for_each(|(w, v)| *w -= factor * v);
        }
        v[0] = diagonal;
    }
    let mut c = a[n * height..][..n].to_vec();
    for k in (0..n).rev() {
        c[k] /= a[k * height + k];
        let (above, column) = (c[k], &a[k * height..][..k]);
        c.iter_mut().zip(column).for_each(|(c, r)| *c -= above * r);
    }
    c
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut lanes = [0.0; LANES];
    let (a, b) = (a.chunks_exact(LANES), b.chunks_exact(LANES));
    let rest = a.remainder().iter().zip(b.remainder());
    let rest: f64 = rest.map(|(a, b)| a * b).sum();
    for (a, b) in a.zip(b) {
        for k in 0..LANES {
            lanes[k] += a[k] * b[k];
        }
    }
    rest + lanes.iter().sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The gradient vanishes: `Bᵀ(Bc − f) + η²c = 0`; and without a penalty a square system is
    /// solved.
    #[test]
    fn the_gradient_vanishes() {
        let entry = |i: usize, j: usize| ((1 + i) as f64 * (0.3 + j as f64)).sin();
        for (rows, n, eta) in [(5, 5, 0.0), (23, 9, 0.0), (30, 12, 0.3), (4, 7, 1e-3)] {
            let columns: Vec<Vec<f64>> =
                (0..n).map(|j| (0..rows).map(|i| entry(i, j)).collect()).collect();
            let f: Vec<f64> = (0..rows).map(|i| (-0.1 * i as f64).exp()).collect();
            let c = minimiser(&columns, &f, eta);
            let residual: Vec<f64> = (0..rows)
                .map(|i| (0..n).map(|j| columns[j][i] * c[j]).sum::<f64>() - f[i])
                .collect();
            for j in 0..n {
                let gradient = dot(&columns[j], &residual) + eta * eta * c[j];
                assert!(gradient.abs() < 1e-11, "{rows} {n} {eta}: {gradient:e}");
            }
            let size = residual.iter().fold(0.0f64, |m, r| m.max(r.abs()));
            assert_eq!(rows == n, size < 1e-11, "{rows} {n} {eta}: {size:e}");
        }
    }
}
