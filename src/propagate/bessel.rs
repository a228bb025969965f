//! Bessel functions: the coefficients of Chebyshev series of exponentials.

/// Below this the first three Bessel functions are their leading terms to round-off.
const SMALL_ARGUMENT: f64 = 1e-8;

/// Writes `J_0(τ), …, J_K(τ)` into `out`, where `K` is the least degree with `2 Σ_{k>K} |J_k(τ)| ≤
/// tail`; returns that sum.
///
/// Backward recurrence `J_{k−1} = (2k/τ) J_k − J_{k+1}` from far above (Miller), normalised by
/// `J_0 + 2 Σ J_{2k} = 1`.
pub fn bessel_series(out: &mut Vec<f64>, tau: f64, tail: f64) -> f64 {
    out.clear();
    if tau < SMALL_ARGUMENT {
        // Leading terms, exact to round-off; the recurrence would overflow.
        out.extend([1.0, 0.5 * tau, 0.125 * tau * tau]);
        return cut(out, tail);
    }
    let top = (tau + 60.0 + 20.0 * tau.cbrt()).ceil() as usize;
    out.resize(top + 1, 0.0);
    out[top] = 1e-280;
    let mut above = 0.0;
    for k in (1..=top).rev() {
        let below = 2.0 * k as f64 / tau * out[k] - above;
        above = out[k];
        out[k - 1] = below;
        if below.abs() > 1e250 {
            // Rescale what was computed so far.
            for value in &mut out[k - 1..] {
                *value *= 1e-300;
            }
            above = out[k];
        }
    }
    let norm = out[0] + 2.0 * out.iter().skip(2).step_by(2).sum::<f64>();
    for value in out.iter_mut() {
        *value /= norm;
    }
    cut(out, tail)
}

/// Cuts a series where the terms left out add up to at most `tail`; returns their sum.
fn cut(out: &mut Vec<f64>, tail: f64) -> f64 {
    let mut left = 0.0;
    let mut degree = out.len() - 1;
    while degree > 1 && left + 2.0 * out[degree].abs() <= tail {
        left += 2.0 * out[degree].abs();
        degree -= 1;
    }
    out.truncate(degree + 1);
    left
}
