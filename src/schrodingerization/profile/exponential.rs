//! The profile of the paper: `g(p) = e^{−p}` for `p ≥ 0`, `e^{α(p)p}` for `p < 0`.
//!
//! With a constant `α` it has a corner at 0, `ĝ(μ) = 1/(1+iμ) + 1/(α−iμ)` falls like `(1+α)/μ²`,
//! and the modes beyond `μ` add `(1+α)/(πμ)` at the corner (first order in `N_p`), but only about
//! `(1+α)/(πdμ²)` at a distance `d` from it.
//!
//! With a formula the left part is the [`Piecewise`] polynomial that is `e^{α(p)p}` to round-off,
//! and its transform is exact. The left part does not affect the recovery. The jumps of `g` and its
//! derivatives, at 0 and elsewhere, determine the number of modes: with jumps `J_k` of `g^{(k)}` at
//! points `c`, and for any `m`,
//!
//! ```text
//! ĝ(μ) = Σ_{k<m} Σ_c J_k(c) e^{−iμc} (iμ)^{−k−1} + (iμ)^{−m} ∫ g^{(m)}(p) e^{−iμp} dp.
//! ```
//!
//! `α(0) = −1` leaves no jump of `g'` at 0, and `α = −1 + c(−p)^k` none of the first `k`
//! derivatives.

use crate::base::piecewise::{ORDERS, Piecewise};
use crate::problem::case::Alpha;
use crate::schrodingerization::profile::shape::{Planned, ProfileForm, ProfileShape};
use crate::schrodingerization::profile::window::{PlacedProfile, ProfileRequirements, best_window};
use num_complex::Complex64;
use std::f64::consts::PI;

/// Least distance of the next period's jumps, but for those at 0, from the readings.
const GAP: f64 = 1.0;

/// The profile.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Exponential {
    /// `α > 0`, or a formula in `p`.
    pub alpha: Alpha,
}

impl Exponential {
    /// The profile of `α` for `requirements`, and its window.
    pub fn meeting(
        alpha: &Alpha,
        requirements: &ProfileRequirements,
    ) -> Option<PlacedProfile<Self>> {
        let profile = Self { alpha: alpha.clone() };
        let round_off = requirements.round_off * profile.excess();
        best_window(profile, 0.0, &ProfileRequirements { round_off, ..*requirements })
    }

    /// Bound on `Σ|c_l|` as a multiple of 2, the value that plans assume.
    ///
    /// From `|ĝ| ≤ min(‖g‖₁, ΣJ_0/μ + B/μ²)`, `B = ΣJ_1 + ∫|g''|`, for a period of at least
    /// `SHORTEST` and wavenumbers up to e to the `LOGARITHM`.
    pub(super) fn excess(&self) -> f64 {
        const SHORTEST: f64 = 4.0;
        const LOGARITHM: f64 = 28.0;
        let Alpha::Formula(extension) = &self.alpha else {
            return 1.0;
        };
        let left = &extension.values;
        let total = |order: usize| {
            let jumps: f64 = left.jumps.iter().map(|jump| jump.sizes[order]).sum();
            jumps + left.rounded[order] + at_zero(left, order)
        };
        let size = 1.0 + left.variations[0];
        let slopes = total(1) + left.variations[2] + 1.0;
        let integral = 2.0 * (size * slopes).sqrt() + LOGARITHM * total(0);
        (0.5 * (size / SHORTEST + integral / PI)).max(1.0)
    }
}

impl Planned for Exponential {
    fn form(&self) -> ProfileForm<'_> {
        ProfileForm::Transform(self)
    }

    fn description(&self) -> String {
        format!("exponential: alpha {}", self.alpha)
    }
}

impl ProfileShape for Exponential {
    fn coefficient(&self, mu: f64) -> Complex64 {
        let right = 1.0 / Complex64::new(1.0, mu);
        let left = match &self.alpha {
            Alpha::Constant(alpha) => 1.0 / Complex64::new(*alpha, -mu),
            Alpha::Formula(extension) => extension.values.transform(mu),
        };
        right + left
    }

    fn value(&self, p: f64) -> f64 {
        match &self.alpha {
            _ if p >= 0.0 => (-p).exp(),
            Alpha::Constant(alpha) => (alpha * p).exp(),
            Alpha::Formula(extension) => extension.values.value(p),
        }
    }

    /// For a formula, the window also extends below its jumps, so that the jumps of the next period
    /// keep their distance.
    fn left(&self, bound: f64) -> f64 {
        match &self.alpha {
            Alpha::Constant(alpha) => bound.ln().min(0.0) / alpha,
            Alpha::Formula(extension) => {
                let left = &extension.values;
                let lowest = left.jumps.first().map_or(0.0, |jump| jump.at - GAP);
                left.first_above(bound).min(lowest)
            }
        }
    }

    fn tail(&self, mu: f64, distance: f64) -> f64 {
        match &self.alpha {
            Alpha::Constant(alpha) => tail_of_constant(*alpha, mu, distance),
            Alpha::Formula(extension) => tail_of_left(&extension.values, mu, distance),
        }
    }
}

/// From `ĝ = (1+α)/μ² + (1−α²)/(iμ)³ + …`, whose remainder is at most `(1+α³)/μ⁴`; or from all
/// magnitudes.
fn tail_of_constant(a: f64, mu: f64, distance: f64) -> f64 {
    let parts = (1.0 + a) * corner(1, mu, distance)
        + (1.0 - a * a).abs() * corner(2, mu, distance)
        + (1.0 + a.powi(3)) / (3.0 * PI * mu.powi(3));
    parts.min((1.0 + a) / (PI * mu))
}

/// The least of the bounds for `m = 2, 3, …`: the contribution of the jumps plus
/// `∫|g^{(m)}|/(π(m−1)μ^{m−1})`. Only jumps of the size of round-off may be next to a reading.
fn tail_of_left(left: &Piecewise, mu: f64, distance: f64) -> f64 {
    let mut least = f64::INFINITY;
    let mut corners = 0.0;
    for order in 0..ORDERS {
        corners += at_zero(left, order) * corner(order, mu, distance)
            + left.rounded[order] * corner(order, mu, 0.0);
        for jump in &left.jumps {
            corners += jump.sizes[order] * corner(order, mu, (distance - jump.at).min(GAP));
        }
        if order > 0 {
            let rest = left.variations[order + 1] + 1.0;
            least = least.min(corners + rest / (PI * order as f64 * mu.powi(order as i32)));
        }
    }
    least
}

/// `|J_k(0)|`: `g^{(k)}` is `(−1)^k` above.
fn at_zero(left: &Piecewise, order: usize) -> f64 {
    let above = if order.is_multiple_of(2) { 1.0 } else { -1.0 };
    (above - left.at_end[order]).abs()
}

/// Bound on the contribution of the modes beyond `μ` for a jump of the derivative `order`, `(2/P) Σ
/// cos(μ_l p)/μ_l^{order+1}` (or the sines) at `p ≥ distance`: the integral of the magnitudes,
/// `1/(π order μ^order)`, of a jump of `g` itself `(1/π) Σ sin(lθ)/l ≤ 1/2`; or, since neighbours
/// cancel, summation by parts (once or twice) with `sin(πp/P) ≥ πp/(1.12 P)` for `p ≤ P/4`.
fn corner(order: usize, mu: f64, distance: f64) -> f64 {
    let k = order as f64;
    let power = mu.powi(-(order as i32));
    let magnitudes = if order == 0 { 0.5 } else { power / (PI * k) };
    if distance <= 0.0 {
        return magnitudes;
    }
    let parts = (1.0 + 2.0 * (k + 1.0) / (mu * distance)).min(2.0);
    magnitudes.min(1.12 * power * parts / (PI * distance * mu))
}
