//! The Fourier transform in `p`: from the modes of a cell to its values at equally spaced points,
//! and back.

use crate::schrodingerization::profile::series::{Series, points};
use num_complex::Complex64;
use rustfft::{Fft, FftPlanner};
use std::sync::Arc;

/// The points `p_j = L + jP/N_p`, `j = 0 … N_p − 1`, and the transform between them and the modes
/// `l ≥ 0` of real values:
///
/// ```text
/// w(p_j) = Σ_l Re[ factor_l e^{iμ_l p_j} x_l ] = Re Σ_l ( factor_l e^{iμ_l L} x_l ) e^{2πi lj/N_p}
/// ```
///
/// The mode `N_p/2`, which has no conjugate partner, contributes the real part of the bracket.
pub struct Transform {
    /// `factor_l e^{iμ_l L}`.
    factors: Vec<Complex64>,
    /// `1/(N_p factor_l e^{iμ_l L})`, twice that if `−l` is in the series; zero if the factor is
    /// zero.
    inverse: Vec<Complex64>,
    lower: f64,
    period: f64,
    forward: Arc<dyn Fft<f64>>,
    backward: Arc<dyn Fft<f64>>,
    line: Vec<Complex64>,
    scratch: Vec<Complex64>,
}

impl Transform {
    /// The transform for the modes of `series` on the period that begins at `lower`.
    pub fn new(series: &Series, lower: f64) -> Self {
        let (modes, points) = (series.modes(), points(series));
        let factor = |l: usize| {
            let wave = Complex64::new(0.0, series.wavenumber(l) * lower).exp();
            series.factor(l) * wave
        };
        let factors: Vec<Complex64> = (0..modes).map(factor).collect();
        let inverse = (factors.iter().enumerate()).map(|(l, factor)| {
            let partners = if series.is_unpaired(l) { 1.0 } else { 2.0 };
            match factor.norm_sqr() {
                0.0 => Complex64::ZERO,
                _ => partners / points as f64 / factor,
            }
        });
        let mut planner = FftPlanner::new();
        let (forward, backward) =
            (planner.plan_fft_forward(points), planner.plan_fft_inverse(points));
        let scratch = forward.get_inplace_scratch_len().max(backward.get_inplace_scratch_len());
        Self {
            inverse: inverse.collect(),
            factors,
            lower,
            period: series.period,
            forward,
            backward,
            line: vec![Complex64::ZERO; points],
            scratch: vec![Complex64::ZERO; scratch],
        }
    }

    /// The transform of modes that still lack the factors `phases`.
    pub fn with_phases(mut self, phases: &[Complex64]) -> Self {
        for ((factor, inverse), phase) in
            (self.factors.iter_mut().zip(&mut self.inverse)).zip(phases)
        {
            *factor *= phase;
            *inverse /= phase;
        }
        self
    }

    /// `N_p`.
    pub fn points(&self) -> usize {
        self.line.len()
    }

    /// Number of modes `l ≥ 0`.
    pub fn modes(&self) -> usize {
        self.factors.len()
    }

    /// `p_j`.
    pub fn point(&self, j: usize) -> f64 {
        self.lower + self.period * j as f64 / self.points() as f64
    }

    /// `values[j] = scale · w(p_j)` from the modes `x_l` of a cell. Allocates nothing.
    pub fn to_values(&mut self, modes: &[Complex64], scale: f64, values: &mut [f64]) {
        let (given, rest) = self.line.split_at_mut(self.factors.len());
        for ((z, x), factor) in given.iter_mut().zip(modes).zip(&self.factors) {
            *z = factor * x;
        }
        rest.fill(Complex64::ZERO);
        self.backward.process_with_scratch(&mut self.line, &mut self.scratch);
        for (value, z) in values.iter_mut().zip(&self.line) {
            *value = scale * z.re;
        }
    }

    /// The modes `x_l` of a cell from `values[j] = w(p_j)/scale`. Allocates nothing.
    pub fn to_modes(&mut self, values: &[f64], scale: f64, modes: &mut [Complex64]) {
        for (z, value) in self.line.iter_mut().zip(values) {
            *z = Complex64::from(scale * value);
        }
        self.forward.process_with_scratch(&mut self.line, &mut self.scratch);
        for ((x, z), inverse) in modes.iter_mut().zip(&self.line).zip(&self.inverse) {
            *x = inverse * z;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    const LOWER: f64 = -3.7;

    /// Several series: planned, of a designed profile, and for a given `N_p`.
    fn series() -> Vec<Series> {
        let transform = |mu: f64| Complex64::new(1.0, 0.3) / Complex64::new(1.0 + mu, 0.2 * mu);
        let free = |modes| Series::analytic(11.3, modes, transform);
        let given = |points| Series::analytic_points(11.3, points, transform);
        let sampled = Series::sampled([LOWER, LOWER + 11.3], 18, |p| (-p * p).exp());
        let mut list: Vec<Series> = [1, 2, 7, 13, 28, 47].into_iter().map(free).collect();
        list.extend([2, 6, 14, 22, 64].map(given));
        list.push(sampled);
        list
    }

    fn cell(modes: usize) -> Vec<Complex64> {
        (0..modes)
            .map(|l| Complex64::new((1.3 * l as f64).sin(), (0.7 * l as f64 + 0.2).cos()))
            .collect()
    }

    #[test]
    fn points_of_no_modes_end() {
        let mut none = series().remove(1);
        none.coefficients.clear();
        assert_eq!(points(&none), 2);
    }

    #[test]
    fn points_show_every_mode() {
        for series in series() {
            let n = points(&series);
            assert!(n >= 2 * (series.modes() - 1) && (n.is_multiple_of(2) || series.modes() == 1));
            assert!(n <= 2 * series.modes() + 6, "{n} of {}", series.modes());
        }
        let free = |modes| points(&Series::analytic(1.0, modes, |_| Complex64::ONE));
        assert_eq!([1, 4, 7, 11, 28].map(free), [1, 8, 16, 24, 60]);
        let given = |n| points(&Series::analytic_points(1.0, n, |_| Complex64::ONE));
        assert_eq!([2, 22, 16384].map(given), [2, 22, 16384]);
    }

    #[test]
    fn values_are_the_naive_sum() {
        for series in series() {
            let mut transform = Transform::new(&series, LOWER);
            let x = cell(series.modes());
            let mut values = vec![f64::NAN; transform.points()];
            transform.to_values(&x, 2.5, &mut values);
            for (j, value) in values.iter().enumerate() {
                let p = transform.point(j);
                let terms = x.iter().enumerate().map(|(l, x)| {
                    let wave = Complex64::new(0.0, series.wavenumber(l) * p).exp();
                    (series.factor(l) * wave * x).re
                });
                let expected = 2.5 * terms.sum::<f64>();
                assert!((value - expected).abs() < 1e-12, "{value} {expected}");
            }
            // For a separable field: the profile times the field.
            transform.to_values(&vec![Complex64::from(3.0); x.len()], 1.0, &mut values);
            for (j, value) in values.iter().enumerate() {
                let expected = 3.0 * series.value(transform.point(j));
                assert!((value - expected).abs() < 1e-12, "{value} {expected}");
            }
        }
    }

    #[test]
    fn modes_are_the_naive_transform() {
        for series in series() {
            let mut transform = Transform::new(&series, LOWER);
            let n = transform.points();
            let values: Vec<f64> = (0..n).map(|j| (2.1 * j as f64).sin() + 0.1).collect();
            let mut found = vec![Complex64::ZERO; series.modes()];
            transform.to_modes(&values, 0.5, &mut found);
            for (l, x) in found.iter().enumerate() {
                let sum: Complex64 = (values.iter().enumerate())
                    .map(|(j, w)| {
                        let angle = -TAU * (l * j % n) as f64 / n as f64;
                        0.5 * w * Complex64::new(0.0, angle).exp()
                    })
                    .sum();
                // Mode l of the half series represents the modes l and −l of all N_p.
                let both = if l == 0 || 2 * l == n { 1.0 } else { 2.0 };
                let wave = Complex64::new(0.0, -series.wavenumber(l) * LOWER).exp();
                let expected = both / n as f64 * sum * wave / series.factor(l);
                let error = (x - expected).norm() / (1.0 + expected.norm());
                assert!(error < 1e-12, "mode {l} of {n}: {x} {expected}");
            }
        }
    }

    #[test]
    fn there_and_back() {
        for series in series() {
            let mut transform = Transform::new(&series, LOWER);
            let x = cell(series.modes());
            let mut values = vec![0.0; transform.points()];
            let mut back = vec![Complex64::ZERO; x.len()];
            transform.to_values(&x, 4.0, &mut values);
            transform.to_modes(&values, 0.25, &mut back);
            for (l, (x, back)) in x.iter().zip(&back).enumerate() {
                let factor = transform.factors[l];
                // Mode 0, and a mode without partner, contribute their real part.
                let seen = if series.is_unpaired(l) {
                    Complex64::from((factor * x).re) / factor
                } else {
                    *x
                };
                assert!((seen - back).norm() < 1e-12, "mode {l}: {seen} {back}");
            }
        }
    }

    #[test]
    fn phases_are_factors_of_the_modes() {
        for series in series() {
            let x = cell(series.modes());
            let phases: Vec<Complex64> =
                (0..x.len()).map(|l| Complex64::from_polar(1.0, 0.4 + l as f64)).collect();
            let product: Vec<Complex64> = x.iter().zip(&phases).map(|(x, p)| x * p).collect();
            let mut plain = Transform::new(&series, LOWER);
            let mut expected = vec![0.0; plain.points()];
            plain.to_values(&product, 1.0, &mut expected);
            let mut with = Transform::new(&series, LOWER).with_phases(&phases);
            let mut found = expected.clone();
            with.to_values(&x, 1.0, &mut found);
            for (a, b) in found.iter().zip(&expected) {
                assert!((a - b).abs() < 1e-12, "{a} {b}");
            }
        }
    }

    #[test]
    fn there_and_back_from_values() {
        // With all modes that N_p points resolve, the transform is exact.
        for n in [2, 6, 14, 22, 64, 100] {
            let series = Series::analytic_points(7.9, n, |_| Complex64::ONE);
            let mut transform = Transform::new(&series, LOWER);
            let values: Vec<f64> = (0..n).map(|j| (1.9 * j as f64 * j as f64).cos()).collect();
            let mut modes = vec![Complex64::ZERO; transform.modes()];
            let mut back = vec![0.0; n];
            transform.to_modes(&values, 1.0, &mut modes);
            transform.to_values(&modes, 1.0, &mut back);
            for (a, b) in values.iter().zip(&back) {
                assert!((a - b).abs() < 1e-14, "{n} points: {a} {b}");
            }
        }
    }
}
