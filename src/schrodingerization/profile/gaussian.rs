//! `g(p) = e^{−p} Φ((p − p0)/σ)`, `Φ` the normal distribution function. It equals `e^{−p}` to
//! within `ε` above `p0 + zσ`, and
//!
//! ```text
//! ĝ(μ) = ∫ g(p) e^{−iμp} dp = exp(½σ²(1+iμ)² − (1+iμ) p0) / (1+iμ)
//! ```
//!
//! decays like a Gaussian. The series is spectrally accurate, since it uses `ĝ` itself, not samples
//! of `g`.

use crate::base::bisect::bisect;
use crate::problem::limits::SIGMAS;
use crate::schrodingerization::profile::shape::{
    EstimatorQuality, Planned, ProfileForm, ProfileShape,
};
use crate::schrodingerization::profile::window::{PlacedProfile, ProfileRequirements, Window};
use num_complex::Complex64;
use std::f64::consts::{PI, SQRT_2};

/// A period and a cut-off for `g(p) = e^{−p} Φ((p − p0)/σ)`.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Gaussian {
    /// Width `σ` of the switch.
    pub sigma: f64,
    /// Place `p0 < 0` of the step.
    pub offset: f64,
    /// Period `P` in `p`.
    pub period: f64,
    /// Wavenumbers beyond this are left out.
    pub cutoff: f64,
}

/// `z` with `Φ(−z) = ε`, `0 < ε ≤ ½`.
pub fn normal_quantile(epsilon: f64) -> f64 {
    let above = |z: f64| 0.5 * libm::erfc(z / SQRT_2) > epsilon;
    let [low, high] = bisect(0.0, 40.0, 100, above);
    0.5 * (low + high)
}

impl Gaussian {
    /// The profiles that meet `requirements` when read from `p = 0` on, by rising width.
    ///
    /// The conditions: `p0 = −zσ − growth`, `Φ(−z) = ε`; round-off,
    /// `exp(−p0 + σ²/2) ≤ ε/(20 ε_machine)`; left tail `q = σ² + σ√(σ² + 2(−p0 + ln 1/ε))` and
    /// period `P = decay + growth + reach + q − p0`, and at least `growth + ln 2/ε`, so that the
    /// next period's `e^{−p−P}` does not reach in (this matters for short times); cut-off
    /// `μ_max² = 1 + 2(ln 1/ε − p0)/σ²`.
    fn candidates(
        sigma: Option<f64>,
        requirements: &ProfileRequirements,
    ) -> impl Iterator<Item = Self> + use<> {
        let &ProfileRequirements { tolerance, growth, decay, reach, round_off, .. } = requirements;
        const WIDTHS: i32 = 600;
        let z = normal_quantile(tolerance);
        let digits = -tolerance.ln();
        let room = (tolerance / (20.0 * round_off)).ln();
        let [least, largest] = SIGMAS;
        let last = if sigma.is_some() { 0 } else { WIDTHS };
        (0..=last).filter_map(move |i| {
            // The possible widths, in equal ratios.
            let planned = least * (largest / least).powf(f64::from(i) / f64::from(WIDTHS));
            let sigma = sigma.unwrap_or(planned);
            let offset = -z * sigma - growth;
            let square = sigma * sigma;
            if -offset + 0.5 * square > room {
                return None;
            }
            let tail = square + sigma * (square + 2.0 * (digits - offset)).sqrt();
            let cutoff = (1.0 + 2.0 * (digits - offset) / square).sqrt();
            Some(Self {
                sigma,
                offset,
                period: (decay + growth + reach + tail - offset).max(growth + digits + 2f64.ln()),
                cutoff,
            })
        })
    }

    /// The cheapest profile for `requirements`: of the width with the least `P μ_max (μ_max + 1)`,
    /// the cost of a run. For a given `p◇` the switch is moved along, so that all is as for
    /// `p◇ = 0`.
    pub fn meeting(
        sigma: Option<f64>,
        requirements: &ProfileRequirements,
    ) -> Option<PlacedProfile<Self>> {
        let point = requirements.recovery.unwrap_or(0.0);
        let moved = |mut profile: Self| {
            profile.offset += point;
            let window =
                Window { point, distance: 0.0, period: profile.period, cutoff: profile.cutoff };
            PlacedProfile { profile, window }
        };
        Self::candidates(sigma, requirements)
            .map(moved)
            .filter(|PlacedProfile { profile, window }| requirements.admits(profile, window))
            .min_by(|a, b| requirements.rank(&a.window).total_cmp(&requirements.rank(&b.window)))
    }
}

impl Planned for Gaussian {
    fn form(&self) -> ProfileForm<'_> {
        ProfileForm::Transform(self)
    }

    fn description(&self) -> String {
        format!("gaussian: sigma {:.4}, offset {:.4}", self.sigma, self.offset)
    }

    fn estimate_doubt(&self, _modes: usize, quality: EstimatorQuality) -> Option<&'static str> {
        quality.doubt_of_oscillation()
    }
}

impl ProfileShape for Gaussian {
    fn coefficient(&self, mu: f64) -> Complex64 {
        let one = Complex64::new(1.0, mu);
        (0.5 * self.sigma * self.sigma * one * one - one * self.offset).exp() / one
    }

    fn value(&self, p: f64) -> f64 {
        let switch = libm::erfc((self.offset - p) / (self.sigma * SQRT_2));
        // The growing exponential's factor vanishes faster than it grows.
        if switch > 0.0 { (-p).exp() * 0.5 * switch } else { 0.0 }
    }

    /// `e^{q−p0} e^{−q²/2σ²} ≤ bound` at `p = p0 − q`.
    fn left(&self, bound: f64) -> f64 {
        let square = self.sigma * self.sigma;
        let digits = (-self.offset - bound.ln()).max(0.0);
        self.offset - square - self.sigma * (square + 2.0 * digits).sqrt()
    }

    /// `(1/π) ∫_μ^∞ |ĝ| ≤ e^{σ²/2 − p0 − σ²μ²/2}/(πσ²μ²)`.
    fn tail(&self, mu: f64, _distance: f64) -> f64 {
        let square = self.sigma * self.sigma;
        (0.5 * square * (1.0 - mu * mu) - self.offset).exp() / (PI * square * mu * mu)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::problem::case::ProfileChoice;
    use crate::schrodingerization::profile::Profile;
    use crate::schrodingerization::profile::series::Series;

    fn series(g: &Gaussian) -> Series {
        let modes = (g.cutoff * g.period / std::f64::consts::TAU).ceil() as usize + 1;
        Series::analytic(g.period, modes, |mu| g.coefficient(mu))
    }

    fn plan(tolerance: f64, growth: f64, decay: f64, reach: f64) -> Option<Gaussian> {
        let requirements = ProfileRequirements::new(tolerance, growth, decay, reach);
        Gaussian::meeting(None, &requirements).map(|placed| placed.profile)
    }

    #[test]
    fn quantile_inverts_the_distribution() {
        assert!((normal_quantile(0.5)).abs() < 1e-12);
        assert!((normal_quantile(1e-3) - 3.090232306167813).abs() < 1e-9);
        assert!((normal_quantile(1e-11) - 6.706023155495137).abs() < 1e-9);
    }

    #[test]
    fn coefficients_are_the_fourier_transform_of_the_profile() {
        let g = plan(1e-6, 0.3, 60.0, 0.0).expect("possible");
        for mu in [0.0, 0.4, 1.7] {
            // Trapezoidal rule, spectrally accurate for a function that decays at both ends.
            let (a, b, n) = (-60.0, 60.0, 40_000);
            let h = (b - a) / f64::from(n);
            let sum: Complex64 = (0..n)
                .map(|i| {
                    let p = a + h * f64::from(i);
                    Complex64::new(0.0, -mu * p).exp() * g.value(p) * h
                })
                .sum();
            let exact = g.coefficient(mu);
            assert!((sum - exact).norm() < 1e-9 * exact.norm().max(1e-3), "{mu}: {sum} {exact}");
        }
    }

    #[test]
    fn the_series_is_the_exponential_where_it_must_be() {
        for tolerance in [1e-3, 1e-6, 1e-9, 1e-11] {
            for (growth, decay) in [(0.0, 3.0), (0.375, 127.0), (0.1, 1000.0)] {
                let g = plan(tolerance, growth, decay, 0.0).expect("possible");
                let series = series(&g);
                for i in 0..=50 {
                    let p = -growth + (decay + growth) * f64::from(i) / 50.0;
                    let sum = series.value(p);
                    let error = (sum - (-p).exp()).abs();
                    assert!(
                        error < 3.0 * tolerance * growth.exp(),
                        "{tolerance} {decay} {p}: {error}"
                    );
                }
            }
        }
    }

    #[test]
    fn mode_counts_of_the_design() {
        for (decay, expected) in [(63.0, [38, 49, 68, 99]), (127.0, [57, 76, 115, 178])] {
            for (tolerance, modes) in [1e-3, 1e-6, 1e-9, 1e-11].into_iter().zip(expected) {
                let g = plan(tolerance, 0.0, decay, 0.0).expect("possible");
                let found = series(&g).modes();
                assert!(found.abs_diff(modes) <= 1, "{decay} {tolerance}: {found}");
            }
        }
    }

    #[test]
    fn round_off_sets_the_limit() {
        let limit = |growth, decay| {
            let requirements = ProfileRequirements::new(0.1, growth, decay, 0.0);
            Profile::smallest_tolerance(&ProfileChoice::Gaussian { sigma: None }, &requirements)
        };
        let smallest = limit(0.375, 127.0).expect("possible");
        assert_eq!(limit(50.0, 127.0), None);
        assert_eq!(limit(f64::INFINITY, f64::INFINITY), None);
        assert!(smallest > 1e-15 && smallest < 1e-12, "{smallest}");
        assert!(plan(smallest * 0.9, 0.375, 127.0, 0.0).is_none());
    }
}
