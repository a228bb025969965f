//! `g(p) = e^{−p}` for `p ≥ 0`, `e^{αp}` for `p < 0`: the paper's. It has a corner at 0,
//! `ĝ(μ) = 1/(1+iμ) + 1/(α−iμ)` falls like `(1+α)/μ²`, and the modes beyond `μ` add `(1+α)/(πμ)` at
//! the corner (first order in `N_p`), but only about `(1+α)/(πdμ²)` at a distance `d` from it.

use crate::schrodingerization::profile::shape::{Form, Planned, Shape};
use crate::schrodingerization::profile::window::{Demand, Window, place};
use num_complex::Complex64;
use std::f64::consts::PI;

/// The profile.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Exponential {
    /// `α > 0`.
    pub alpha: f64,
}

impl Exponential {
    /// The one of `α` for `demand`.
    pub fn meeting(alpha: f64, demand: &Demand) -> Option<(Self, Window)> {
        let profile = Self { alpha };
        place(&profile, 0.0, demand).map(|window| (profile, window))
    }
}

impl Planned for Exponential {
    fn form(&self) -> Form<'_> {
        Form::Transform(self)
    }

    fn description(&self) -> String {
        format!("exponential: alpha {}", self.alpha)
    }
}

impl Shape for Exponential {
    fn coefficient(&self, mu: f64) -> Complex64 {
        1.0 / Complex64::new(1.0, mu) + 1.0 / Complex64::new(self.alpha, -mu)
    }

    fn value(&self, p: f64) -> f64 {
        if p >= 0.0 { (-p).exp() } else { (self.alpha * p).exp() }
    }

    fn left(&self, bound: f64) -> f64 {
        bound.ln().min(0.0) / self.alpha
    }

    /// From `ĝ = (1+α)/μ² + (1−α²)/(iμ)³ + …`, what follows being at most `(1+α³)/μ⁴`; or all
    /// magnitudes.
    fn tail(&self, mu: f64, distance: f64) -> f64 {
        let a = self.alpha;
        let parts = (1.0 + a) * corner(1, mu, distance)
            + (1.0 - a * a).abs() * corner(2, mu, distance)
            + (1.0 + a.powi(3)) / (3.0 * PI * mu.powi(3));
        parts.min((1.0 + a) / (PI * mu))
    }
}

/// Bound on what the modes beyond `μ` of a corner add, `(2/P) Σ cos(μ_l p)/μ_l^{order+1}` at
/// `p ≥ distance`: the integral of the magnitudes, `1/(π order μ^order)`, or, since neighbours
/// cancel, summation by parts (once or twice) with `sin(πp/P) ≥ πp/(1.12 P)` for `p ≤ P/4`.
fn corner(order: usize, mu: f64, distance: f64) -> f64 {
    let k = order as f64;
    let power = mu.powf(-k);
    let magnitudes = power / (PI * k);
    if distance <= 0.0 {
        return magnitudes;
    }
    let parts = (1.0 + 2.0 * (k + 1.0) / (mu * distance)).min(2.0);
    magnitudes.min(1.12 * power * parts / (PI * distance * mu))
}
