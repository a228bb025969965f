//! The window of `p` in which a measurement gives the solution.
//!
//! It ends where the field is no longer read correctly. At `p` the state's part at rate `s` of the
//! spectrum of `−ST` is read from `g(p + s)`. So on `[p − Λ⁺, p + Λ⁻]` `g` must be `e^{−p}` within
//! `ε_w e^{−p}`. This is checked on the series itself. `ε_w` is [`WINDOW`] times the tolerance that
//! the profile is planned for at `p◇`, and the field that is read from the whole window is within
//! `ε_w` too.

use crate::problem::limits::{MOST_WINDOW_SAMPLES, WINDOW_SAMPLES};
use crate::schrodingerization::profile::series::Series;
use num_complex::Complex64;
use rustfft::FftPlanner;
use std::cell::RefCell;
use std::f64::consts::PI;

/// The error in a window, in units of the tolerance that the profile is planned for at `p◇`.
pub const WINDOW: f64 = 10.0;

/// The difference of a series from `e^{−p}`. It is sampled upwards from the lower end of the domain
/// of dependence of a reading, as far as a window may reach.
pub struct Deviation {
    /// `p◇`.
    point: f64,
    /// `Λ⁻`.
    decay: f64,
    /// The lowest sample: `p◇ − Λ⁺`.
    lower: f64,
    /// Distance of two samples.
    step: f64,
    /// `|g(p) − e^{−p}|`.
    sizes: Vec<f64>,
}

impl Deviation {
    /// Longest window, in units of `p`. A longer one adds nothing visible to the probability.
    const LONGEST: f64 = 12.0;

    /// The deviation of `series` for a window that begins at `point`; `growth` and `decay` are
    /// `Λ⁺` and `Λ⁻`.
    pub fn new(series: &Series, point: f64, reach: [f64; 2]) -> Self {
        Self::by_transforms(MOST_WINDOW_SAMPLES, series, point, reach)
    }

    /// The deviation of [`new`](Self::new), by transforms of at most `longest` samples: the first
    /// takes every `k`-th sample, the next one those after them.
    fn by_transforms(
        longest: usize,
        series: &Series,
        point: f64,
        [growth, decay]: [f64; 2],
    ) -> Self {
        let (lower, samples) =
            (point - growth, (WINDOW_SAMPLES * series.modes()).next_power_of_two());
        let step = series.period / samples as f64;
        let reach = ((growth + Self::LONGEST + decay) / step).ceil() as usize + 2;
        let count = samples.min(reach);
        let decayed = Exponentials::new(lower, step, count);
        let stride = (samples / longest).max(1);
        let mut sizes = vec![0.0; count];
        WORKSPACE.with_borrow_mut(|workspace| {
            for first in 0..stride {
                let lower = lower + first as f64 * step;
                let pairs = workspace.pairs(series, lower, samples / stride / 2);
                let values = pairs.iter().flat_map(|pair| [pair.re, pair.im]);
                for (k, value) in (first..count).step_by(stride).zip(values) {
                    sizes[k] = (value - decayed.at(k)).abs();
                }
            }
        });
        Self { point, decay, lower, step, sizes }
    }

    /// The end of the window: the field is read within `tolerance` from every `p` in it. `None`
    /// where not even its first point is such a place.
    pub fn window_end(&self, tolerance: f64) -> Option<f64> {
        let Self { point, decay, lower, step, sizes } = self;
        // The first place, upwards, where g is not accurate enough for the lowest p that reads it.
        // Most places are read from the first point of the window.
        let at_point = tolerance * (-point).exp();
        let bad = |k: usize| match lower + k as f64 * step - decay {
            p if p > *point => sizes[k] > tolerance * (-p).exp(),
            _ => sizes[k] > at_point,
        };
        let first = (0..sizes.len()).find(|&k| bad(k)).unwrap_or(sizes.len());
        let end = lower + first as f64 * step - step - decay;
        (end > *point).then_some(end.min(point + Self::LONGEST))
    }

    /// The end of the window up to `end`, or an earlier one from which on the field that is read
    /// from all of it would not be within `limit`, and the bound on its error: with `M(p)` the
    /// largest deviation of the series up to `p + Λ⁻`, which is where `p` is read from at most,
    /// `√(∫M² dp/∫e^{−2p} dp)`.
    pub fn within(&self, end: f64, limit: f64) -> [f64; 2] {
        let Self { point, decay, lower, step, sizes } = self;
        let (mut most, mut seen) = (0.0f64, 0);
        let (mut above, mut below, mut error) = (0.0f64, 0.0f64, 0.0);
        let (mut square, ratio) = ((-2.0 * point).exp(), (-2.0 * step).exp());
        for k in 0..=((end - point) / step) as usize {
            let p = point + k as f64 * step;
            let upto = (((p + decay - lower) / step).ceil() as usize).min(sizes.len() - 1);
            most = sizes[seen.min(upto)..=upto].iter().copied().fold(most, f64::max);
            seen = upto;
            above += most * most;
            below += square;
            square *= ratio;
            let next = above / below;
            if next > limit * limit && k > 0 {
                return [p - step, f64::sqrt(error)];
            }
            error = next;
        }
        [end, error.sqrt()]
    }
}

/// Memory and plans that are kept between series. The choice of a profile transforms at few lengths
/// many times.
struct Workspace {
    planner: FftPlanner<f64>,
    values: Vec<Complex64>,
    scratch: Vec<Complex64>,
}

thread_local! {
    static WORKSPACE: RefCell<Workspace> = RefCell::new(Workspace {
        planner: FftPlanner::new(),
        values: Vec::new(),
        scratch: Vec::new(),
    });
}

impl Workspace {
    /// The values of a series at `2 · pairs` points, from `lower` on over its period. The real
    /// parts are the values of even number, the imaginary parts those of odd number. With `a_l` the
    /// series at `lower` and `w` the first root of unity, the spectrum of these pairs is
    /// `½a_l(1 + iw^l)` at `l` and `½ā_l(1 + iw^{−l})` at `−l`, modulo the number of pairs.
    fn pairs(&mut self, series: &Series, lower: f64, pairs: usize) -> &[Complex64] {
        let Self { planner, values, scratch } = self;
        values.clear();
        values.resize(pairs, Complex64::ZERO);
        for l in 0..series.modes() {
            let half = 0.5 * series.factor(l) * Complex64::cis(series.wavenumber(l) * lower);
            let turned = Complex64::I * Complex64::cis(PI * l as f64 / pairs as f64);
            values[l % pairs] += half * (1.0 + turned);
            values[(pairs - l % pairs) % pairs] += (half * (1.0 - turned)).conj();
        }
        let fft = planner.plan_fft_inverse(pairs);
        scratch.resize(fft.get_inplace_scratch_len(), Complex64::ZERO);
        fft.process_with_scratch(values, scratch);
        values
    }
}

/// `e^{−(start + k·step)}` for many `k`, with two exponentials for every few hundred of them.
struct Exponentials {
    fine: [f64; Self::FINE],
    coarse: Vec<f64>,
}

impl Exponentials {
    const FINE: usize = 256;

    /// The exponentials with `k < count`.
    fn new(start: f64, step: f64, count: usize) -> Self {
        let coarse = |block: usize| (-(start + (block * Self::FINE) as f64 * step)).exp();
        Self {
            fine: std::array::from_fn(|k| (-(k as f64 * step)).exp()),
            coarse: (0..count.div_ceil(Self::FINE)).map(coarse).collect(),
        }
    }

    fn at(&self, k: usize) -> f64 {
        self.coarse[k / Self::FINE] * self.fine[k % Self::FINE]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The error of the field that is read from all points of a window, one rate of the spectrum
    /// after the other, is within its bound, and not far below.
    #[test]
    fn the_error_of_a_window_is_bounded() {
        let (sigma, offset) = (0.4f64, -1.2f64);
        let transform = |mu: f64| {
            let one = Complex64::new(1.0, mu);
            (0.5 * sigma * sigma * one * one - one * offset).exp() / one
        };
        let series = Series::analytic(30.0, 60, transform);
        let [point, end] = [0.0, 3.0];
        let [growth, decay] = [0.1, 15.0];
        let deviation = Deviation::new(&series, point, [growth, decay]);
        let [whole, bound] = deviation.within(end, f64::INFINITY);
        assert_eq!(whole, end);
        // A limit ends the window, and is kept.
        let [shorter, error] = deviation.within(end, 0.5 * bound);
        assert!(shorter < end && error <= 0.5 * bound, "{shorter} {error:e} {bound:e}");
        let points = || (0..300).map(|k| f64::from(k) * 0.01);
        let of_rate = |rate: f64| {
            let off = |p: f64| (series.value(p + rate) - (-p - rate).exp()).powi(2);
            let (above, below) =
                points().fold((0.0, 0.0), |(a, b), p| (a + off(p), b + (-2.0 * p).exp()));
            (above / below).sqrt()
        };
        let rates = (0..=60).map(|i| -growth + (growth + decay) * f64::from(i) / 60.0);
        let worst = rates.map(of_rate).fold(0.0, f64::max);
        assert!(worst <= bound * 1.01, "{worst:e} {bound:e}");
        assert!(worst >= 0.03 * bound, "{worst:e} {bound:e}");
    }

    /// The samples are the values of the series, with and without a mode of wavenumber zero alone.
    #[test]
    fn deviations_are_those_of_the_values() {
        let transform = |mu: f64| Complex64::new(1.0, 0.3 * mu) / (1.0 + mu * mu);
        let rows = [(1, 1 << 20), (2, 1 << 20), (7, 1 << 20), (33, 1 << 20), (33, 64), (7, 16)];
        for (modes, longest) in rows {
            let series = Series::analytic(20.0, modes, transform);
            let deviation = Deviation::by_transforms(longest, &series, 0.7, [0.4, 2.5]);
            let largest = (0..deviation.sizes.len()).map(|k| {
                let p = deviation.lower + k as f64 * deviation.step;
                let expected = (series.value(p) - (-p).exp()).abs();
                (deviation.sizes[k] - expected).abs()
            });
            assert!(largest.fold(0.0, f64::max) < 1e-13, "{modes}");
            assert!(deviation.sizes.len() as f64 * deviation.step > 14.9);
        }
    }

    /// The window ends where a constant deviation is too large, also where `e^{Λ⁻}` is no number.
    #[test]
    fn windows_of_strong_decay_end_in_time() {
        for decay in [10.0, 1000.0] {
            let sizes = vec![1e-4; ((decay + 12.0) / 0.01) as usize];
            let deviation = Deviation { point: 0.0, decay, lower: 0.0, step: 0.01, sizes };
            // 1e-4 is e^{−p}/1000 up to there.
            let end = deviation.window_end(1e-3).expect("a window");
            assert!((end - 10.0f64.ln()).abs() < 0.03, "{decay}: {end}");
            assert_eq!(deviation.window_end(1e-5), None);
        }
    }
}
