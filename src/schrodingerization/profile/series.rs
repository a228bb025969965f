//! A profile as a truncated Fourier series, from its transform or from samples.

use num_complex::Complex64;
use rustfft::FftPlanner;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// A truncated Fourier series of a real function of period [`period`](Self::period).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Series {
    /// `P`.
    pub period: f64,
    /// `c_l`, `l = 0, 1, …`; in JSON pairs of real and imaginary part.
    pub coefficients: Vec<Complex64>,
    /// Whether the last mode has no conjugate partner: for even `N_p`, the mode `−N_p/2` has none.
    #[serde(rename = "alone")]
    pub last_is_unpaired: bool,
}

impl Series {
    /// `c_l = ĝ(μ_l)/P` for `modes` modes `l ≥ 0` and their partners: the coefficients of the
    /// periodic sum of `g`.
    pub fn analytic(period: f64, modes: usize, transform: impl Fn(f64) -> Complex64) -> Self {
        let coefficient = |l| transform(TAU * l as f64 / period) / period;
        Self {
            period,
            coefficients: (0..modes).map(coefficient).collect(),
            last_is_unpaired: false,
        }
    }

    /// The series of `points` modes `l = −N_p/2 … N_p/2 − 1`, with `N_p = points` even.
    pub fn analytic_points(
        period: f64,
        points: usize,
        transform: impl Fn(f64) -> Complex64,
    ) -> Self {
        Self { last_is_unpaired: true, ..Self::analytic(period, points / 2 + 1, transform) }
    }

    /// `c_l = 1` for the modes `l = −N_p/2 … N_p/2 − 1`, `N_p` even: the series of a field whose
    /// modes are given.
    pub fn ones(period: f64, points: usize) -> Self {
        Self { period, coefficients: vec![Complex64::ONE; points / 2 + 1], last_is_unpaired: true }
    }

    /// `c_l = (1/N_p) Σ_k g(p_k) e^{−iμ_l p_k}`, `p_k = L + kP/N_p`, for the modes
    /// `l = −N_p/2 … N_p/2 − 1`, `N_p` even: the trigonometric interpolant. Of the analytic
    /// coefficients of the periodic continuation of `g` from `[L, R)` it holds `Σ_m c_{l+mN_p}`.
    pub fn sampled([lower, upper]: [f64; 2], points: usize, value: impl Fn(f64) -> f64) -> Self {
        let period = upper - lower;
        let at = |k: usize| lower + period * k as f64 / points as f64;
        let mut samples: Vec<Complex64> =
            (0..points).map(|k| Complex64::from(value(at(k)) / points as f64)).collect();
        FftPlanner::new().plan_fft_forward(points).process(&mut samples);
        samples.truncate(points / 2 + 1);
        for (l, c) in samples.iter_mut().enumerate() {
            *c *= Complex64::new(0.0, -TAU * l as f64 * (lower / period)).exp();
        }
        Self { period, coefficients: samples, last_is_unpaired: true }
    }

    /// Number of modes `l ≥ 0`.
    pub fn modes(&self) -> usize {
        self.coefficients.len()
    }

    /// `μ_l = 2πl/P`.
    pub fn wavenumber(&self, l: usize) -> f64 {
        TAU * l as f64 / self.period
    }

    /// Whether mode `l` has no conjugate partner `−l` in the series.
    pub fn is_unpaired(&self, l: usize) -> bool {
        l == 0 || (self.last_is_unpaired && l + 1 == self.modes())
    }

    /// Factor of `w_l` in a real sum over all modes: twice the coefficient if `−l` is in the
    /// series.
    pub fn factor(&self, l: usize) -> Complex64 {
        self.coefficients[l] * if self.is_unpaired(l) { 1.0 } else { 2.0 }
    }

    /// The series at `p`.
    pub fn value(&self, p: f64) -> f64 {
        (0..self.modes())
            .map(|l| (self.factor(l) * Complex64::new(0.0, self.wavenumber(l) * p).exp()).re)
            .sum()
    }
}

/// The number of points `N_p` that resolves every mode of a series: 1 for mode 0 alone, which is
/// constant; twice the last mode if that has no conjugate partner, as for a given `N_p`; otherwise
/// [`points_of_modes`].
pub fn points(series: &Series) -> usize {
    let modes = series.modes();
    if series.last_is_unpaired && modes > 1 { 2 * (modes - 1) } else { points_of_modes(modes) }
}

/// The number of points for `modes` modes `l ≥ 0` with their partners: the least even number
/// without prime factors above 5 that is at least twice `modes`.
pub fn points_of_modes(modes: usize) -> usize {
    if modes == 1 {
        return 1;
    }
    // Over all 3^b 5^c below the power of two that suffices: a finite search for any number of
    // modes.
    let least = 2 * modes.max(1);
    let mut points = least.next_power_of_two();
    let mut fives = 1usize;
    while fives < points {
        let mut odd = fives;
        while odd < points {
            points = points.min(odd * least.div_ceil(odd).next_power_of_two().max(2));
            odd = odd.saturating_mul(3);
        }
        fives = fives.saturating_mul(5);
    }
    points
}
