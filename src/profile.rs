//! Initial functions `g(p)` of the auxiliary variable, planned from a tolerance, as Fourier series.
//!
//! Only two things are asked of `g`: it equals `e^{−p}` where information reaches the recovery point from, and its
//! Fourier series is short. With period `P`, `μ_l = 2πl/P` and `g(p) ≈ Σ_l c_l e^{iμ_l p}` the solution is
//!
//! ```text
//! u(T) = e^{p◇} Σ_l c_l e^{iμ_l p◇} w_l(T),     w_l(T) = exp((−iμ_l S + K)T) u(0)
//! ```
//!
//! read at a point `p◇`, or by another [`crate::recover::Reading`]. Data are real, so `c_{−l} w_{−l}` is the conjugate of
//! `c_l w_l`, and only `l ≥ 0` is kept.

pub mod gaussian;

use gaussian::Gaussian;
use num_complex::Complex64;
use serde::Serialize;
use std::fmt;

/// A profile with its planned parameters.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum Profile {
    /// `e^{−p}` cut off by a normal distribution function.
    Gaussian(Gaussian),
}

impl fmt::Display for Profile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Gaussian(g) => {
                write!(f, "gaussian: sigma {:.4}, offset {:.4}", g.sigma, g.offset)
            }
        }
    }
}

/// A truncated Fourier series of a real function of period [`period`](Self::period).
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Series {
    /// `P`.
    pub period: f64,
    /// `c_l`, `l = 0, 1, …`.
    #[serde(skip)]
    pub coefficients: Vec<Complex64>,
}

impl Series {
    /// `c_l = ĝ(μ_l)/P` for `modes` modes `l ≥ 0`: the coefficients of the periodic sum of `g`.
    pub fn analytic(period: f64, modes: usize, transform: impl Fn(f64) -> Complex64) -> Self {
        let coefficient = |l| transform(std::f64::consts::TAU * l as f64 / period) / period;
        Self {
            period,
            coefficients: (0..modes).map(coefficient).collect(),
        }
    }

    /// Number of modes `l ≥ 0`.
    pub fn modes(&self) -> usize {
        self.coefficients.len()
    }

    /// `μ_l = 2πl/P`.
    pub fn wavenumber(&self, l: usize) -> f64 {
        std::f64::consts::TAU * l as f64 / self.period
    }

    /// Factor of `w_l` in a real sum over all modes: twice the coefficient for `l > 0`, which stands for `−l` too.
    pub fn factor(&self, l: usize) -> Complex64 {
        self.coefficients[l] * if l == 0 { 1.0 } else { 2.0 }
    }

    /// The series at `p`.
    pub fn value(&self, p: f64) -> f64 {
        (0..self.modes())
            .map(|l| (self.factor(l) * Complex64::new(0.0, self.wavenumber(l) * p).exp()).re)
            .sum()
    }
}
