//! The coefficients of the Chebyshev series against the integral in their definition.

use phasewarp::propagate::bessel::bessel_series;
use std::f64::consts::PI;

/// `J_k(τ) = (1/π) ∫_0^π cos(kθ − τ sin θ) dθ`, by a trapezoidal rule that is exact to round-off.
fn bessel(k: usize, tau: f64) -> f64 {
    const POINTS: usize = 4000;
    let term = |i: usize| {
        let theta = PI * i as f64 / POINTS as f64;
        let weight = if i == 0 || i == POINTS { 0.5 } else { 1.0 };
        weight * (k as f64 * theta - tau * theta.sin()).cos()
    };
    (0..=POINTS).map(term).sum::<f64>() / POINTS as f64
}

fn compare(tau: f64) {
    let mut series = Vec::new();
    let left = bessel_series(&mut series, tau, 1e-15);
    assert!(left <= 1e-15, "tau = {tau:e}: {left:e} left");
    for (k, found) in series.iter().enumerate() {
        let exact = bessel(k, tau);
        let error = (found - exact).abs();
        // Written so that NaN fails.
        assert!(error <= 1e-13, "J_{k}({tau:e}) = {found}, {exact} expected");
    }
    let next = bessel(series.len(), tau);
    assert!(next.abs() <= 1e-13, "tau = {tau:e}: cut at {next:e}");
}

#[test]
fn bessel_functions() {
    for tau in [1e-6, 0.01, 1.0, 7.5, 100.0, 1500.0] {
        compare(tau);
    }
}

/// Runs over very short times have very small arguments.
#[test]
fn bessel_functions_of_very_small_arguments() {
    for tau in [1e-20, 1e-60, 1e-70, 1e-150, 1e-300] {
        compare(tau);
    }
}
