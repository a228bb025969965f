//! The rotations of generalised quantum signal processing for `e^{−iτH}`.
//!
//! **Series.** On the unit circle `e^{iτ sin θ} = Σ_k J_k(τ) y^k`, `y = e^{iθ}` (Jacobi and Anger).
//! The walk `(1 − 2Π)G` of `H = cos φ` has the eigenvalues `z = −e^{±iφ}` (see
//! [`evolution`](crate::quantum::circuit::evolution)), so that `y = iz` makes `e^{−iτH}` of it. All
//! coefficients are real. With `t = 2 Σ_{k>K} |J_k|`, and what keeps `|P|` below 1 where
//! that is round-off, and `c = 1/(1 + t)`
//!
//! ```text
//! P(y) = c Σ_{|k|≤K} J_k y^{k+K},   |P| ≤ 1,   |y^{−K}P(y) − e^{iτ sin θ}| ≤ 2t.
//! ```
//!
//! **Complement.** A polynomial `Q` without zeros in the unit disc has `|Q|² = 1 − |P|² = f`: its
//! logarithm is the part of the Fourier series of `log √f` that a disc holds (Weiss' algorithm;
//! Berntson and Sünderhauf 2024). `f` is about `2t`. It is computed from the rest of the series,
//! `R = Σ_{|k|>K} J_k y^k`, without cancellation:
//! `f = 1 − c² + c²(2 Re(R e^{−iτ sin θ}) − |R|²)`.
//!
//! **Rotations.** `(P, Q) = R(θ_{2K}) D R(θ_{2K−1}) D … D R(θ_0) (1, 0)` with `D = diag(y, 1)` and
//! `R(θ) = ry(2θ)` (Motlagh and Wiebe 2024). The last one leaves no constant term above, so that
//! `tan θ = −P_0/Q_0`; it is taken off, and so on down to degree 0. As `Q` has no zero in the disc,
//! `Q_0` is as large as it can be, and errors do not grow.

use crate::propagate::bessel::bessel_series;
use num_complex::Complex64;
use rustfft::FftPlanner;
use std::f64::consts::TAU;

/// The largest number of steps `2K` of a sequence whose rotations are computed. They take some
/// seconds.
pub const MOST_STEPS: usize = 1 << 16;
/// The largest number of points of the transforms.
const MOST_POINTS: usize = 1 << 23;
/// The least `t`. Coefficients of the complement beyond its degree are below this.
const ROUND_OFF: f64 = 1e-15;

/// The rotations of a sequence of `2K` steps.
#[derive(Clone, Debug, PartialEq)]
pub struct Phases {
    /// `τ`.
    pub tau: f64,
    /// `K`.
    pub degree: usize,
    /// `2t`: bound on the distance from `e^{−iτH}` in norm.
    pub bound: f64,
    /// `2θ_0, …, 2θ_{2K}`: angles of `ry`.
    pub angles: Vec<f64>,
}

/// Why no rotations are computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoPhases {
    /// The number of steps, which is more than [`MOST_STEPS`].
    #[error("{0} steps, {MOST_STEPS} at most")]
    TooManySteps(usize),
    /// The complementary polynomial is not found to round-off on `MOST_POINTS` points.
    #[error("the complementary polynomial is not found to round-off on {MOST_POINTS} points")]
    NoComplement,
}

/// The series, cut at `K`.
struct CutSeries {
    tau: f64,
    degree: usize,
    /// `J_0, J_1, …` as far as they are not zero.
    bessel: Vec<f64>,
    /// `t`.
    rest: f64,
}

impl CutSeries {
    fn new(tau: f64, degree: usize) -> Self {
        let mut bessel = Vec::new();
        bessel_series(&mut bessel, tau, 0.0);
        bessel.resize(bessel.len().max(degree + 1), 0.0);
        let rest = 2.0 * bessel[degree + 1..].iter().map(|j| j.abs()).sum::<f64>() + ROUND_OFF;
        Self { tau, degree, bessel, rest }
    }

    /// `c`.
    fn scale(&self) -> f64 {
        1.0 / (1.0 + self.rest)
    }

    /// Coefficients of `P`.
    fn polynomial(&self) -> Vec<f64> {
        let k = self.degree as i64;
        let coefficient = |k: i64| {
            let j = self.bessel[k.unsigned_abs() as usize];
            self.scale() * if k < 0 && k % 2 != 0 { -j } else { j }
        };
        (-k..=k).map(coefficient).collect()
    }

    /// `f = 1 − |P|²` at `points` points of the unit circle.
    fn complement_squared(&self, points: usize, planner: &mut FftPlanner<f64>) -> Vec<f64> {
        let mut rest = vec![Complex64::ZERO; points];
        for (k, &j) in self.bessel.iter().enumerate().skip(self.degree + 1) {
            rest[k % points] += j;
            rest[(points - k % points) % points] += if k % 2 == 1 { -j } else { j };
        }
        planner.plan_fft_inverse(points).process(&mut rest);
        let square = self.scale().powi(2);
        // 1 − c², with all digits.
        let least = self.rest * self.scale() * (1.0 + self.scale());
        let value = |(j, r): (usize, &Complex64)| {
            let sin = (TAU * j as f64 / points as f64).sin();
            let whole = Complex64::cis(self.tau * sin);
            least + square * (2.0 * (r * whole.conj()).re - r.norm_sqr())
        };
        rest.iter().enumerate().map(value).collect()
    }

    /// Coefficients of `Q`, and the largest one beyond its degree.
    fn complement(&self, points: usize) -> (Vec<f64>, f64) {
        let mut planner = FftPlanner::new();
        let [forward, inverse] =
            [planner.plan_fft_forward(points), planner.plan_fft_inverse(points)];
        let squared = self.complement_squared(points, &mut planner);
        let log = |f: &f64| Complex64::from(0.5 * f.max(f64::MIN_POSITIVE).ln());
        let mut values: Vec<Complex64> = squared.iter().map(log).collect();
        let scale = 1.0 / points as f64;
        forward.process(&mut values);
        for (n, value) in values.iter_mut().enumerate() {
            *value *= match n {
                0 => scale,
                n if 2 * n < points => 2.0 * scale,
                n if 2 * n == points => scale,
                _ => 0.0,
            };
        }
        inverse.process(&mut values);
        values.iter_mut().for_each(|value| *value = value.exp());
        forward.process(&mut values);
        let coefficient = |value: &Complex64| value.re * scale;
        let (inside, beyond) = values.split_at(2 * self.degree + 1);
        let largest = beyond.iter().fold(0.0, |m: f64, value| m.max(value.norm() * scale));
        (inside.iter().map(coefficient).collect(), largest)
    }
}

impl Phases {
    /// The rotations of `e^{−iτH}` in `2K` steps, `K = degree`.
    ///
    /// # Errors
    /// [`NoPhases`].
    pub fn new(tau: f64, degree: usize) -> Result<Self, NoPhases> {
        if 2 * degree > MOST_STEPS {
            return Err(NoPhases::TooManySteps(2 * degree));
        }
        let series = CutSeries::new(tau, degree);
        let mut points = (32 * (degree + 1)).max(2 * series.bessel.len()).next_power_of_two();
        let complement = loop {
            let (complement, beyond) = series.complement(points);
            if beyond < ROUND_OFF {
                break complement;
            }
            points *= 2;
            if points > MOST_POINTS {
                return Err(NoPhases::NoComplement);
            }
        };
        let angles = angles(series.polynomial(), complement);
        Ok(Self { tau, degree, bound: 2.0 * series.rest, angles })
    }

    /// `P` and `Q` at `y`: the product of all steps on the first state of the qubit.
    pub fn product(&self, y: Complex64) -> [Complex64; 2] {
        let mut state = [Complex64::ONE, Complex64::ZERO];
        for (step, angle) in self.angles.iter().enumerate() {
            if step > 0 {
                state[0] *= y;
            }
            let (sin, cos) = (0.5 * angle).sin_cos();
            state = [state[0] * cos - state[1] * sin, state[0] * sin + state[1] * cos];
        }
        state
    }

    /// The largest difference between the product of the steps and `c Σ J_k y^{k+K}`, at `points`
    /// points of the unit circle.
    pub fn difference(&self, points: usize) -> f64 {
        let polynomial = CutSeries::new(self.tau, self.degree).polynomial();
        let at = |j: usize| {
            let y = Complex64::cis(TAU * (j as f64 + 0.25) / points as f64);
            let value = polynomial.iter().rev().fold(Complex64::ZERO, |sum, c| sum * y + c);
            (self.product(y)[0] - value).norm()
        };
        (0..points).map(at).fold(0.0, f64::max)
    }
}

/// The angles `2θ` of the rotations, the first one first.
fn angles(mut p: Vec<f64>, mut q: Vec<f64>) -> Vec<f64> {
    let mut angles = Vec::with_capacity(p.len());
    for degree in (1..p.len()).rev() {
        let theta = (-p[0]).atan2(q[0]);
        angles.push(2.0 * theta);
        let (sin, cos) = theta.sin_cos();
        for n in 0..degree {
            let above = cos * p[n + 1] + sin * q[n + 1];
            q[n] = cos * q[n] - sin * p[n];
            p[n] = above;
        }
    }
    angles.push(2.0 * q[0].atan2(p[0]));
    angles.reverse();
    angles
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::propagate::chebyshev::degree;

    fn phases(tau: f64, tail: f64) -> Phases {
        let degree = degree(&mut Vec::new(), tau, tail);
        Phases::new(tau, degree).unwrap_or_else(|why| panic!("{tau} {tail}: {why}"))
    }

    /// Coefficients of both polynomials, multiplied out.
    fn multiplied(angles: &[f64]) -> [Vec<f64>; 2] {
        let [mut p, mut q] = [vec![1.0], vec![0.0]];
        for (step, angle) in angles.iter().enumerate() {
            if step > 0 {
                p.insert(0, 0.0);
                q.push(0.0);
            }
            let (sin, cos) = (0.5 * angle).sin_cos();
            for (p, q) in p.iter_mut().zip(&mut q) {
                (*p, *q) = (*p * cos - *q * sin, *p * sin + *q * cos);
            }
        }
        [p, q]
    }

    /// The product of the steps has the coefficients of the series, and is near the exponential.
    #[test]
    fn products_are_the_series() {
        for tau in [0.0, 1e-9, 0.3, 2.0, 7.7, 60.0, 400.0] {
            for tail in [0.1, 1e-3, 1e-6, 1e-10, 1e-13] {
                let phases = phases(tau, tail);
                let series = CutSeries::new(tau, phases.degree);
                let [p, _] = multiplied(&phases.angles);
                assert_eq!(p.len(), 2 * phases.degree + 1);
                for (found, expected) in p.iter().zip(series.polynomial()) {
                    assert!((found - expected).abs() < 1e-13, "{tau} {tail}: {found} {expected}");
                }
                assert!(phases.bound <= 2.0 * tail);
                for j in 0..50 {
                    let y = Complex64::cis(0.13 * f64::from(j));
                    let [p, q] = phases.product(y);
                    let apart =
                        (p * y.powi(-(phases.degree as i32)) - Complex64::cis(tau * y.im)).norm();
                    assert!(apart <= phases.bound + 1e-12, "{tau} {tail}: {apart}");
                    assert!((p.norm_sqr() + q.norm_sqr() - 1.0).abs() < 1e-12);
                }
            }
        }
    }

    /// Long sequences are as exact; another angle is noticed.
    #[test]
    fn long_sequences() {
        let mut phases = phases(4000.0, 5e-4);
        assert!(phases.angles.len() > 8000);
        assert!(phases.difference(16) < 2e-12, "{:e}", phases.difference(16));
        phases.angles[4000] += 1e-6;
        assert!(phases.difference(16) > 1e-9);
        let most = 2 * MOST_STEPS;
        assert_eq!(Phases::new(1.0, MOST_STEPS), Err(NoPhases::TooManySteps(most)));
    }
}
