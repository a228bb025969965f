//! The kernel of An, Childs and Lin (arXiv 2312.03916), `0 < β < 1`:
//!
//! ```text
//! ĝ(μ) = exp(2^β − (1−iμ)^β) / (1+iμ).
//! ```
//!
//! In the upper half plane `ĝ` is analytic except for the pole at `μ = i`, so `g = e^{−p}` exactly
//! for `p > 0`. In the lower half plane, the branch cut from `−i` down gives `|g(p)| ≤ C e^p` for
//! `p < 0`, `C = (1/2π) ∫ |ĝ(x−i)| dx`. All derivatives exist at 0.

use crate::schrodingerization::profile::shape::{Planned, ProfileForm, ProfileShape};
use crate::schrodingerization::profile::window::{
    PlacedProfile, ProfileRequirements, best_window, summed_by_parts,
};
use num_complex::Complex64;
use std::f64::consts::{FRAC_PI_2, PI};

/// `|ĝ|` below `e^{−DIGITS}` is left out of values.
const DIGITS: f64 = 40.0;
/// Farther than this from 0, the left part is an integral along the cut.
const NEAR: f64 = 0.5;

/// The profile.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Acl {
    /// `β`.
    pub beta: f64,
    /// `C`.
    pub bound: f64,
}

impl Acl {
    /// The profile of `β` for `requirements`, and its window.
    pub fn meeting(beta: f64, requirements: &ProfileRequirements) -> Option<PlacedProfile<Self>> {
        best_window(Self::new(beta), 0.0, requirements)
    }

    /// The profile of `β`, within [`BETAS`](crate::problem::limits::BETAS).
    pub fn new(beta: f64) -> Self {
        // ĝ(x−i) = exp(2^β − (−ix)^β)/(2+ix), the same for ±x.
        let fall = (FRAC_PI_2 * beta).cos();
        let magnitude = |x: f64| Complex64::from((-fall * x.powf(beta)).exp() / 2f64.hypot(x));
        let start = 1e-6;
        let integral =
            start * magnitude(0.0).re + PI * summed_by_parts(|x| [magnitude(x)], start, 0.0);
        Self { beta, bound: 2f64.powf(beta).exp() * integral / PI }
    }

    /// `ĝ` at a complex point below the axis and above the cut.
    fn transform(&self, mu: Complex64) -> Complex64 {
        let i_mu = Complex64::new(-mu.im, mu.re);
        (2f64.powf(self.beta) - (1.0 - i_mu).powf(self.beta)).exp() / (1.0 + i_mu)
    }

    /// `g(p)`, `−½ < p < 0`: the inverse transform along `Im μ = −½`, by the trapezoidal rule. Its
    /// step sets a period `2π/h` after which both tails are beyond round-off.
    fn near(&self, p: f64) -> f64 {
        const PERIOD: f64 = 2.0 * DIGITS + 2.0;
        let step = 2.0 * PI / PERIOD;
        let last = (DIGITS + 2f64.powf(self.beta)) / (FRAC_PI_2 * self.beta).cos();
        let count = (last.powf(1.0 / self.beta) / step).ceil() as i64;
        let term = |k: i64| {
            let mu = Complex64::new(step * k as f64, -0.5);
            (self.transform(mu) * (Complex64::I * mu * p).exp()).re
        };
        let sum: f64 = (1..=count).rev().map(term).sum();
        (2.0 * sum + term(0)) * step / (2.0 * PI)
    }

    /// `g(p)`, `p ≤ −½`, along both sides of the cut `μ = −i(1+t)`:
    /// `(1/π) ∫_0^∞ e^{(1+t)p + 2^β − t^β cos πβ} sin(t^β sin πβ)/(2+t) dt`, with `t = e^s` by the
    /// trapezoidal rule.
    fn far(&self, p: f64) -> f64 {
        const STEP: f64 = 0.125;
        let (sin, cos) = (PI * self.beta).sin_cos();
        let term = |k: i32| {
            let t = (STEP * f64::from(k)).exp();
            let power = t.powf(self.beta);
            let exponent = (1.0 + t) * p + 2f64.powf(self.beta) - power * cos;
            exponent.exp() * (power * sin).sin() / (2.0 + t) * t
        };
        // From e^{−40} to where e^{tp} is negligible.
        let sum: f64 = (-320..=64).map(term).sum();
        sum * STEP / PI
    }
}

impl Planned for Acl {
    fn form(&self) -> ProfileForm<'_> {
        ProfileForm::Transform(self)
    }

    fn description(&self) -> String {
        format!("acl: beta {}", self.beta)
    }
}

impl ProfileShape for Acl {
    fn coefficient(&self, mu: f64) -> Complex64 {
        self.transform(Complex64::from(mu))
    }

    fn value(&self, p: f64) -> f64 {
        if p >= 0.0 {
            (-p).exp()
        } else if p > -NEAR {
            self.near(p)
        } else {
            self.far(p)
        }
    }

    fn left(&self, bound: f64) -> f64 {
        (bound / self.bound).ln().min(0.0)
    }

    fn tail(&self, mu: f64, distance: f64) -> f64 {
        summed_by_parts(|x| [self.coefficient(x)], mu, distance)
    }
}
