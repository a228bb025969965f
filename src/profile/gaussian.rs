//! `g(p) = e^{−p} Φ((p − p0)/σ)`, `Φ` the normal distribution function. It equals `e^{−p}` to within `ε` above `p0 + zσ`, and
//!
//! ```text
//! ĝ(μ) = ∫ g(p) e^{−iμp} dp = exp(½σ²(1+iμ)² − (1+iμ) p0) / (1+iμ)
//! ```
//!
//! decays like a Gaussian: spectrally accurate, since `ĝ` itself and no samples of `g` are used.

use num_complex::Complex64;

/// A period and a cut-off for `g(p) = e^{−p} Φ((p − p0)/σ)`.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Gaussian {
    /// Width `σ` of the switch.
    pub sigma: f64,
    /// Its place `p0 < 0`.
    pub offset: f64,
    /// Period `P` in `p`.
    pub period: f64,
    /// Wavenumbers beyond this are left out.
    pub cutoff: f64,
}

/// `z` with `Φ(−z) = ε`, `0 < ε ≤ ½`.
pub fn normal_quantile(epsilon: f64) -> f64 {
    let (mut low, mut high) = (0.0, 40.0);
    for _ in 0..100 {
        let middle = 0.5 * (low + high);
        if 0.5 * libm::erfc(middle / std::f64::consts::SQRT_2) > epsilon {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

impl Gaussian {
    /// The cheapest one that recovers `u` to `tolerance`, when the spectrum of `S·T` lies in
    /// `[−decay, growth]` and recovery points in `[0, reach]`; `None` if round-off forbids it.
    ///
    /// The conditions: `p0 = −zσ − growth`, `Φ(−z) = ε`; round-off, `exp(−p0 + σ²/2) ≤ ε/(20 ε_machine)`; left tail
    /// `q = σ² + σ√(σ² + 2(−p0 + ln 1/ε))` and period `P = decay + growth + reach + q − p0`, and at least `growth + ln 2/ε`, so that
    /// the next period's `e^{−p−P}` does not reach in (this matters for short times); cut-off
    /// `μ_max² = 1 + 2(ln 1/ε − p0)/σ²`. Among widths `σ` the one of least `P μ_max (μ_max + 1)`, what a run costs.
    pub fn plan(tolerance: f64, growth: f64, decay: f64, reach: f64) -> Option<Self> {
        const WIDTHS: i32 = 600;
        let z = normal_quantile(tolerance);
        let digits = -tolerance.ln();
        let room = (tolerance / (20.0 * f64::EPSILON)).ln();
        (0..=WIDTHS)
            .filter_map(|i| {
                // 0.05 to 20, in equal ratios.
                let sigma = 0.05 * 400f64.powf(f64::from(i) / f64::from(WIDTHS));
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
                    period: (decay + growth + reach + tail - offset)
                        .max(growth + digits + 2f64.ln()),
                    cutoff,
                })
            })
            .min_by(|a, b| a.cost().total_cmp(&b.cost()))
    }

    fn cost(&self) -> f64 {
        self.period * self.cutoff * (self.cutoff + 1.0)
    }

    /// The smallest tolerance for which [`plan`](Self::plan) finds one; `None` if there is none up to 0.1.
    pub fn smallest_tolerance(growth: f64, decay: f64, reach: f64) -> Option<f64> {
        let (mut low, mut high) = (1e-16f64.ln(), 0.1f64.ln());
        Self::plan(high.exp(), growth, decay, reach)?;
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if Self::plan(middle.exp(), growth, decay, reach).is_some() {
                high = middle;
            } else {
                low = middle;
            }
        }
        Some(high.exp())
    }

    /// The same function of `p − distance`, times `e^{−distance}`, so that it still equals `e^{−p}`.
    pub fn translated(self, distance: f64) -> Self {
        Self {
            offset: self.offset + distance,
            ..self
        }
    }

    /// What part of the error at `p◇ = 0` the distance to the field read at `p◇ = second` shows, where the spectrum of `S` near
    /// zero dominates: the relative deficit of `g` is `Φ((p0 − p)/σ)`, so `1 − Φ((p0 − second)/σ)/Φ(p0/σ)`.
    pub fn seen_by(&self, second: f64) -> f64 {
        let deficit =
            |p: f64| libm::erfc((p - self.offset) / (self.sigma * std::f64::consts::SQRT_2));
        1.0 - deficit(second) / deficit(0.0)
    }

    /// Number of modes `l ≥ 0`.
    pub fn modes(&self) -> usize {
        (self.cutoff * self.period / std::f64::consts::TAU).ceil() as usize + 1
    }

    /// `μ_l = 2πl/P`.
    pub fn wavenumber(&self, l: usize) -> f64 {
        std::f64::consts::TAU * l as f64 / self.period
    }

    /// `ĝ(μ)`.
    pub fn coefficient(&self, mu: f64) -> Complex64 {
        let one = Complex64::new(1.0, mu);
        (0.5 * self.sigma * self.sigma * one * one - one * self.offset).exp() / one
    }

    /// `g(p)`.
    pub fn value(&self, p: f64) -> f64 {
        let t = (self.offset - p) / (self.sigma * std::f64::consts::SQRT_2);
        (-p).exp() * 0.5 * libm::erfc(t)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantile_inverts_the_distribution() {
        assert!((normal_quantile(0.5)).abs() < 1e-12);
        assert!((normal_quantile(1e-3) - 3.090232306167813).abs() < 1e-9);
        assert!((normal_quantile(1e-11) - 6.706023155495137).abs() < 1e-9);
    }

    #[test]
    fn coefficients_are_the_fourier_transform_of_the_profile() {
        let g = Gaussian::plan(1e-6, 0.3, 60.0, 0.0).expect("possible");
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
            assert!(
                (sum - exact).norm() < 1e-9 * exact.norm().max(1e-3),
                "{mu}: {sum} {exact}"
            );
        }
    }

    #[test]
    fn the_series_is_the_exponential_where_it_must_be() {
        for tolerance in [1e-3, 1e-6, 1e-9, 1e-11] {
            for (growth, decay) in [(0.0, 3.0), (0.375, 127.0), (0.1, 1000.0)] {
                let g = Gaussian::plan(tolerance, growth, decay, 0.0).expect("possible");
                for i in 0..=50 {
                    let p = -growth + (decay + growth) * f64::from(i) / 50.0;
                    let sum: f64 = (0..g.modes())
                        .map(|l| {
                            let mu = g.wavenumber(l);
                            let term = g.coefficient(mu) * Complex64::new(0.0, mu * p).exp();
                            term.re / g.period * if l == 0 { 1.0 } else { 2.0 }
                        })
                        .sum();
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
                let g = Gaussian::plan(tolerance, 0.0, decay, 0.0).expect("possible");
                assert!(
                    g.modes().abs_diff(modes) <= 1,
                    "{decay} {tolerance}: {}",
                    g.modes()
                );
            }
        }
    }

    #[test]
    fn round_off_sets_the_limit() {
        let smallest = Gaussian::smallest_tolerance(0.375, 127.0, 0.0).expect("possible");
        assert_eq!(Gaussian::smallest_tolerance(50.0, 127.0, 0.0), None);
        assert_eq!(
            Gaussian::smallest_tolerance(f64::INFINITY, f64::INFINITY, 0.0),
            None
        );
        assert!(smallest > 1e-15 && smallest < 1e-12, "{smallest}");
        assert!(Gaussian::plan(smallest * 0.9, 0.375, 127.0, 0.0).is_none());
    }
}
