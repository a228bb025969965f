//! `e^{−|p|}` convolved with a normal density of variance `σ²`, times `e^{−σ²/2}` (Low and Somma,
//! arXiv 2508.19238):
//!
//! ```text
//! g(p) = e^{−p} Φ(p/σ − σ) + e^{p} Φ(−p/σ − σ),     ĝ(μ) = 2/(1+μ²) · e^{−σ²(1+μ²)/2}.
//! ```
//!
//! For `p ≥ c` it is `e^{−p}` up to an error that grows with `σ`. The published parameters are,
//! with `γ = (1/c)√(c + ln((1+1/2π)/ε))`: `σ = 1/(√2 γ)`, cut-off `2cγ²`, spacing of the
//! wavenumbers at most `π/(½T‖S‖ + ln(64 e^{3c/2}/15ε))`. The plan here takes the largest `σ` whose
//! deviation at `c` is within the tolerance, and cut-off and period as for every profile.

use crate::base::bisect::bisect;
use crate::schrodingerization::profile::shape::{Planned, ProfileForm, ProfileShape};
use crate::schrodingerization::profile::window::{PlacedProfile, ProfileRequirements, best_window};
use num_complex::Complex64;
use std::f64::consts::{FRAC_1_SQRT_2, PI};

/// Part of the tolerance that the deviation of `g` from `e^{−p}` may take.
const DEVIATION: f64 = 0.25;

/// The profile.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct LowSomma {
    /// The point from which on `g` is `e^{−p}`.
    pub c: f64,
    /// Width of the Gaussian.
    pub sigma: f64,
}

/// `Φ(x)`.
fn normal(x: f64) -> f64 {
    0.5 * libm::erfc(-x * FRAC_1_SQRT_2)
}

impl LowSomma {
    /// The cheapest for `requirements`, with `c` chosen unless it is given; read at `p◇ = Λ⁺ + c`.
    pub fn meeting(
        c: Option<f64>,
        requirements: &ProfileRequirements,
    ) -> Option<PlacedProfile<Self>> {
        // 0.25 to 16, in equal ratios.
        let planned: Vec<f64> = match (c, requirements.recovery) {
            (Some(c), _) => vec![c],
            (None, Some(point)) if point > requirements.growth => vec![point - requirements.growth],
            (None, Some(_)) => vec![1.0],
            (None, None) => (0..=48).map(|i| 0.25 * 2f64.powf(f64::from(i) / 8.0)).collect(),
        };
        let planned = planned.into_iter().filter_map(|c| {
            let allowed = DEVIATION * requirements.tolerance * (-requirements.growth).exp();
            let profile = Self::within(c, allowed)?;
            let point = requirements.recovery.unwrap_or(requirements.growth + c);
            let requirements = ProfileRequirements { recovery: Some(point), ..*requirements };
            best_window(profile, c, &requirements)
        });
        let rank = |placed: &PlacedProfile<Self>| requirements.rank(&placed.window);
        planned.min_by(|a, b| rank(a).total_cmp(&rank(b)))
    }

    /// The profile of the largest `σ` with `|e^p g − 1| ≤ allowed` for `p ≥ c`.
    pub fn within(c: f64, allowed: f64) -> Option<Self> {
        let (low, high) = (1e-4 * c, 10.0 * c.sqrt());
        let least = Self { c, sigma: low }.deviation();
        if least.is_nan() || least > allowed {
            return None;
        }
        let [low, _] = bisect(low, high, 60, |sigma| Self { c, sigma }.deviation() <= allowed);
        Some(Self { c, sigma: low })
    }

    /// Bound on `|e^p g(p) − 1|` for `p ≥ c`: `Φ(σ − c/σ) + e^{2c} Φ(−c/σ − σ)`, where `σ² < c`.
    pub fn deviation(&self) -> f64 {
        let (c, s) = (self.c, self.sigma);
        if s * s >= c {
            return 1.0;
        }
        normal(s - c / s) + (2.0 * c).exp() * normal(-c / s - s)
    }
}

impl Planned for LowSomma {
    fn form(&self) -> ProfileForm<'_> {
        ProfileForm::Transform(self)
    }

    fn description(&self) -> String {
        format!("low-somma: c {:.4}, sigma {:.4}", self.c, self.sigma)
    }
}

impl ProfileShape for LowSomma {
    fn coefficient(&self, mu: f64) -> Complex64 {
        let square = 1.0 + mu * mu;
        Complex64::from(2.0 / square * (-0.5 * self.sigma * self.sigma * square).exp())
    }

    fn value(&self, p: f64) -> f64 {
        // Even; the growing exponential's factor vanishes faster than it grows.
        let (p, s) = (p.abs(), self.sigma);
        let far = normal(-p / s - s);
        let far = if far > 0.0 { p.exp() * far } else { 0.0 };
        (-p).exp() * normal(p / s - s) + far
    }

    /// `g ≤ 1.5 e^{−|p|}`, since `e^p Φ(−p/σ−σ) ≤ ½ e^{−(p²/σ²+σ²)/2} ≤ ½ e^{−p}`.
    fn left(&self, bound: f64) -> f64 {
        (bound / 1.5).ln().min(0.0)
    }

    /// `(1/π) ∫_μ^∞ ĝ`, with `1/(1+x²) ≤ 1/x²` and the Gaussian's tail.
    fn tail(&self, mu: f64, _distance: f64) -> f64 {
        let square = self.sigma * self.sigma;
        let gaussian = (-0.5 * square * (1.0 + mu * mu)).exp();
        2.0 / PI * gaussian * (1.0 / mu).min(1.0 / (square * mu.powi(3)))
    }
}
