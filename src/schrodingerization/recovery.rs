//! Reading `u(T)` from the warped field `v(T, p) = e^{−p} u(T)`.

use crate::problem::case::RecoveryMethod;
use crate::schrodingerization::profile::designed::circle::TURN;
use crate::schrodingerization::profile::series::Series;
use num_complex::Complex64;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// Points of the least-squares reading.
const POINTS: usize = 9;

/// A linear functional on functions of `p` that maps `e^{−p}` to 1, and hence `v` to `u`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Reading {
    /// The method of the reading.
    pub method: RecoveryMethod,
    /// `p◇`.
    pub point: f64,
    /// Width of the window `[p◇, p◇ + width]`; not used by [`RecoveryMethod::Point`].
    pub width: f64,
}

impl Reading {
    /// The functional of `e^{iμp}`:
    ///
    /// - point: `e^{p◇} v(p◇)`;
    /// - integral: `∫ v dp / (e^{−p◇} − e^{−p◇−width})` over the window;
    /// - least squares: the `u` with the least `Σ |v(q) − e^{−q} u|²` over equally spaced `q`,
    ///   `Σ e^{−q} v(q) / Σ e^{−2q}`.
    pub fn of_wave(&self, mu: f64) -> Complex64 {
        // e^{p◇} e^{iμp◇} is common to all.
        let at_point = Complex64::new(self.point, mu * self.point).exp();
        let width = self.width;
        let window = match self.method {
            RecoveryMethod::Point => Complex64::ONE,
            RecoveryMethod::Integral => {
                let half = 0.5 * mu * width;
                let sinc = if half.abs() < 1e-8 { 1.0 } else { half.sin() / half };
                let decrease = -(-width).exp_m1();
                Complex64::new(0.0, half).exp() * (width * sinc / decrease)
            }
            RecoveryMethod::LeastSquares => {
                let (mut sum, mut squares) = (Complex64::ZERO, 0.0);
                for k in 0..POINTS {
                    let q = width * k as f64 / (POINTS - 1) as f64;
                    sum += Complex64::new(-q, mu * q).exp();
                    squares += (-2.0 * q).exp();
                }
                sum / squares
            }
        };
        at_point * window
    }
}

/// The least and the largest part of the error of `first` that its distance to `second` shows. The
/// error is that of the series, for states whose spectrum of `−ST` is spread over `[from, from +
/// s]`, for some `s` up to `to − from`. The functional reads a component at `s` from `g(p + s)`,
/// and should give `e^{−s}`.
pub fn visible_error_parts(
    series: &Series,
    [first, second]: [&Reading; 2],
    [from, to]: [f64; 2],
) -> [f64; 2] {
    /// Lengths of the intervals of `s` in addition to the whole one. Elements that resolve smooth
    /// data have a spectrum of length 1e-3 or so: their error is that at one end.
    const SPREADS: [f64; 5] = [0.002, 0.06, 0.6, 6.0, 20.0];
    const SAMPLES: u32 = 24;
    let weights: Vec<[Complex64; 2]> = (0..series.modes())
        .map(|l| [first, second].map(|r| series.factor(l) * r.of_wave(series.wavenumber(l))))
        .collect();
    let errors = |s: f64| {
        // A whole multiple of a small angle, so that long ones keep their digits.
        let k = (s / series.period * TURN as f64).round() as i64;
        let mut read = [-libm::exp(-(k as f64 / TURN as f64 * series.period)); 2];
        for (l, weight) in (0i64..).zip(&weights) {
            let turns = ((l * k) & (TURN - 1)) as f64 / TURN as f64;
            let (sin, cos) = libm::sincos(TAU * turns);
            for (read, weight) in read.iter_mut().zip(weight) {
                *read += weight.re * cos - weight.im * sin;
            }
        }
        read
    };
    let spreads = SPREADS.iter().map(|spread| spread.min(to - from)).chain([to - from]);
    let ratios = spreads.map(|spread| {
        let (mut seen, mut all) = (0.0, 0.0);
        for i in 0..SAMPLES {
            let place = (f64::from(i) + 0.5) / f64::from(SAMPLES);
            let [a, b] = errors(from + place * spread);
            seen += (a - b) * (a - b);
            all += a * a;
        }
        (seen / all).sqrt()
    });
    ratios.fold([f64::INFINITY, 0.0], |[least, most], r: f64| [least.min(r), most.max(r)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::schrodingerization::test_support::simpson;

    const METHODS: [RecoveryMethod; 3] =
        [RecoveryMethod::Point, RecoveryMethod::Integral, RecoveryMethod::LeastSquares];

    /// Each functional of the trigonometric polynomial with modes `c_l`, by its definition.
    fn by_definition(reading: &Reading, v: impl Fn(f64) -> f64) -> f64 {
        let (a, b) = (reading.point, reading.point + reading.width);
        match reading.method {
            RecoveryMethod::Point => a.exp() * v(a),
            RecoveryMethod::Integral => {
                let points = simpson([a, b], 2000);
                let integral: f64 = points.map(|point| point.weight * v(point.node)).sum();
                integral / ((-a).exp() - (-b).exp())
            }
            RecoveryMethod::LeastSquares => {
                let q = |k: usize| a + (b - a) * k as f64 / 8.0;
                let above: f64 = (0..9).map(|k| (-q(k)).exp() * v(q(k))).sum();
                let below: f64 = (0..9).map(|k| (-2.0 * q(k)).exp()).sum();
                above / below
            }
        }
    }

    #[test]
    fn readings_of_waves_follow_the_definition() {
        for method in METHODS {
            for (point, width) in [(0.3, 1.0), (2.0, 0.25)] {
                let reading = Reading { method, point, width };
                for mu in [0.0, 1e-10, 0.7, 13.0] {
                    let found = reading.of_wave(mu);
                    let re = by_definition(&reading, |p| (mu * p).cos());
                    let im = by_definition(&reading, |p| (mu * p).sin());
                    let error = (found - Complex64::new(re, im)).norm();
                    assert!(error < 1e-9, "{reading:?} {mu}: {error:e}");
                }
                // 1 for the exponential.
                let one = by_definition(&reading, |p| (-p).exp());
                assert!((one - 1.0).abs() < 1e-12, "{reading:?}: {one}");
            }
        }
    }
}
