//! The probability that a measurement gives the solution (paper, section 7.1).
//!
//! The state after the inverse transform in `p` is `|w(T)⟩ = C_w^{−1} Σ_k v(T, p_k)|k⟩`. Where the
//! profile is `e^{−p}`, `v(T, p) = e^{−p} u(T)`, `u = (√π f, r)`: the weighted field and the
//! auxiliary unknowns. Three things are postselected:
//!
//! ```text
//! P_p   = Σ_k e^{−2p_k} ‖u‖²/C_w²    the p-register at p◇, or in the window p◇ ≤ p_k < p_e
//! P_f   = ‖√π f‖²/‖u‖²               the block of f
//! P_π   = ‖f‖²/‖√π f‖²               the contraction π^{−½}, as a block-encoding (with weights)
//! ```
//!
//! with `C_w² = N_p ‖u(0)‖² Σ_l |c_l|²`, and `C_f = ‖f‖ = e^{p◇} C_w √P` (paper, the equation for
//! `C_f`), `P` being their product at the slice. All three conditions are met in one of `1/P`
//! repetitions, or by exact amplitude amplification (Brassard, Høyer, Mosca and Tapp 2002): with
//! `r = ⌈π/(4 arcsin √P) − ½⌉` rounds, and an ancilla turned so that the amplitude `√P` becomes
//! `sin(π/(4r + 2))`, the `2r + 1` evolutions succeed for certain. Without the ancilla they do so
//! with probability `sin²((2r + 1) arcsin √P)` only: 0.86 for `P = 0.15` and one round.
//!
//! **The window** ends where the field is no longer read correctly. At `p` the state's part at rate
//! `s` of the spectrum of `−ST` is read from `g(p + s)`. So on `[p − Λ⁺, p + Λ⁻]` `g` must be
//! `e^{−p}` within `ε_w e^{−p}`. This is checked on the series itself. `ε_w` is [`WINDOW`] times
//! the tolerance that the profile is planned for at `p◇`, and the field that is read from the whole
//! window is within `ε_w` too.

use crate::matrix::bounds::Bounds;
use crate::problem::case::Case;
use crate::quantum::cost::EvolutionRequirements;
use crate::quantum::labelled_number::LabelledNumber;
use crate::quantum::walk::evolution_part;
use crate::schrodingerization::profile::series::{Series, points};
use crate::schrodingerization::warp_plan::WarpPlan;
use crate::solve::system::StateNorms;
use num_complex::Complex64;
use rustfft::FftPlanner;
use serde::Serialize;
use std::cell::RefCell;
use std::f64::consts::PI;

/// The error in a window, in units of the tolerance that the profile is planned for at `p◇`.
pub const WINDOW: f64 = 10.0;

/// The postselections in order, and their cost.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PostselectionChain {
    /// `P_p`.
    pub in_p: LabelledNumber,
    /// `P_f`: the probability of the block of `f`, given the slice or window of `p`.
    pub field_given_p: LabelledNumber,
    /// `P_π`: the probability that the weights are removed, given both; 1 without weights.
    pub weights_given_field: LabelledNumber,
    /// `P`: the probability of all three conditions.
    pub all: LabelledNumber,
    /// Average number of repetitions until all conditions are met: `1/P`.
    pub repetitions: LabelledNumber,
    /// Rounds `r` of exact amplitude amplification, each with the evolution and its inverse.
    pub amplification_rounds: LabelledNumber,
    /// Evolutions of an amplified measurement: `2r + 1`.
    pub amplified_evolutions: LabelledNumber,
}

/// Probabilities of a run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Probabilities {
    /// `N_p`.
    pub points: usize,
    /// `p◇`.
    pub recovery: f64,
    /// `C_w`.
    pub norm_of_state: LabelledNumber,
    /// The norms from which the probabilities follow.
    pub norms: StateNorms,
    /// `[p◇, p_e)`.
    pub window: Option<[f64; 2]>,
    /// Bound on the error of the field over the whole window, in units of the tolerance that the
    /// profile is planned for. A bound below 1 is within that tolerance.
    pub window_error: Option<f64>,
    /// Probabilities of the slice at `p◇`; they halve with every doubling of `N_p`.
    pub at_slice: PostselectionChain,
    /// Probabilities of the window.
    pub in_window: PostselectionChain,
    /// `C_f` from the probability of the slice: the norm of the field as a quantum computer finds
    /// it.
    pub norm_of_field: LabelledNumber,
}

/// `Σ_l |c_l|²` over the modes of both signs.
pub fn square_sum(series: &Series) -> f64 {
    (0..series.modes())
        .map(|l| {
            let partners = if series.is_unpaired(l) { 1.0 } else { 2.0 };
            partners * series.coefficients[l].norm_sqr()
        })
        .sum()
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
    /// `½a_l(1 + iw^l)` at `l` and `½ā_l(1 + iw^{−l})` at `−l`. No two modes share a place where
    /// there are fewer than `pairs/2`.
    fn pairs(&mut self, series: &Series, lower: f64, pairs: usize) -> &[Complex64] {
        let Self { planner, values, scratch } = self;
        values.clear();
        values.resize(pairs, Complex64::ZERO);
        for l in 0..series.modes() {
            let half = 0.5 * series.factor(l) * Complex64::cis(series.wavenumber(l) * lower);
            let turned = Complex64::I * Complex64::cis(PI * l as f64 / pairs as f64);
            values[l] += half * (1.0 + turned);
            values[(pairs - l) % pairs] += (half * (1.0 - turned)).conj();
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
    pub fn new(series: &Series, point: f64, [growth, decay]: [f64; 2]) -> Self {
        /// About this many samples lie in the shortest wave.
        const SAMPLES: usize = 8;
        let (lower, samples) = (point - growth, (SAMPLES * series.modes()).next_power_of_two());
        let step = series.period / samples as f64;
        let reach = ((growth + Self::LONGEST + decay) / step).ceil() as usize + 2;
        let count = samples.min(reach);
        let decayed = Exponentials::new(lower, step, count);
        let sizes = WORKSPACE.with_borrow_mut(|workspace| {
            let pairs = workspace.pairs(series, lower, samples / 2);
            let values = pairs.iter().flat_map(|pair| [pair.re, pair.im]);
            values.take(count).enumerate().map(|(k, value)| (value - decayed.at(k)).abs()).collect()
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
    fn within(&self, end: f64, limit: f64) -> [f64; 2] {
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

/// The fewest rounds of amplitude amplification that reach amplitude 1 from `√probability`.
pub fn amplification_rounds(probability: f64) -> f64 {
    /// Round-off below a probability of 1 must not add a round.
    const ROUND_OFF: f64 = 1e-9;
    let angle = probability.sqrt().min(1.0).asin();
    (std::f64::consts::FRAC_PI_4 / angle - 0.5 - ROUND_OFF).ceil().max(0.0)
}

impl PostselectionChain {
    fn new(in_p: f64, norms: &StateNorms, label: &dyn Fn(f64) -> LabelledNumber) -> Self {
        let state = norms.weighted.hypot(norms.auxiliary);
        let square = |a: f64, b: f64| (a / b) * (a / b);
        let field = square(norms.weighted, state);
        let weights = square(norms.field, norms.weighted);
        Self::of_conditions([in_p, field, weights], label)
    }

    fn unavailable(why: &str) -> Self {
        Self::of_conditions([f64::NAN; 3], &|_| LabelledNumber::unavailable(why))
    }

    /// The chain of `P_p`, `P_f` and `P_π`.
    fn of_conditions(
        [in_p, field, weights]: [f64; 3],
        label: &dyn Fn(f64) -> LabelledNumber,
    ) -> Self {
        let all = in_p * field * weights;
        let rounds = amplification_rounds(all);
        Self {
            in_p: label(in_p),
            field_given_p: label(field),
            weights_given_field: label(weights),
            all: label(all),
            repetitions: label(1.0 / all),
            amplification_rounds: label(rounds),
            amplified_evolutions: label(2.0 * rounds + 1.0),
        }
    }
}

/// A state that is planned to be measured: the one that a run prepares, or one of a choice of
/// profile and recovery point.
#[derive(Clone, Debug)]
pub struct PlannedState {
    /// The profile as a series.
    pub series: Series,
    /// The profile in words.
    pub profile: String,
    /// `p◇`.
    pub point: f64,
    /// Number of points in `p`: of the plan, or of the register that holds them.
    pub points: usize,
    /// The tolerance that the profile is planned for.
    pub state_tolerance: f64,
    /// The tolerance of the field at `p◇`.
    pub field_tolerance: f64,
    /// `Λ⁺` and `Λ⁻`.
    pub reach: [f64; 2],
}

/// The measurement of a planned state.
pub struct PlannedMeasurement {
    /// The probabilities of measuring the field.
    pub probabilities: Probabilities,
    /// The requirements of the evolution, its tolerance being a part of that of the field.
    pub requirements: EvolutionRequirements,
}

impl PlannedState {
    /// The state of `warp`, the plan of a run of `case`, on the points of that plan.
    pub fn of_plan(warp: &WarpPlan, bounds: &Bounds, case: &Case) -> Self {
        Self {
            series: warp.series.clone(),
            profile: warp.profile.as_ref().map_or(String::new(), ToString::to_string),
            point: warp.readings[0].point,
            points: points(&warp.series),
            state_tolerance: warp.state_tolerance,
            field_tolerance: case.warp.share * case.tolerance,
            reach: reach(bounds, case),
        }
    }

    /// The same state in a register, which has a power of two of points.
    pub fn in_register(self) -> Self {
        Self { points: self.points.next_power_of_two(), ..self }
    }

    /// The measurement of the state with these norms, for an error `tolerance` of the field.
    pub fn measurement(&self, norms: StateNorms, tolerance: f64) -> PlannedMeasurement {
        const NORMS: &str = "norms of the classical solution, 3 digits";
        let estimate = |x: f64| LabelledNumber::estimate(x, NORMS);
        let probabilities = Probabilities::new(self, norms, &estimate);
        let requirements = self.requirements(&probabilities.amplitude(), tolerance);
        PlannedMeasurement { probabilities, requirements }
    }

    /// The requirements of an evolution of the state. The error `tolerance` of the field is one of
    /// the whole state that is `amplitude` times as large, `√P`.
    pub fn requirements(
        &self,
        amplitude: &LabelledNumber,
        tolerance: f64,
    ) -> EvolutionRequirements {
        let part = evolution_part(self.points > 1);
        EvolutionRequirements {
            highest: self.series.wavenumber(self.series.modes() - 1),
            points: self.points,
            period: self.series.period,
            tolerance: amplitude.times(&LabelledNumber::exact(part * tolerance)),
        }
    }

    /// Distance of two points.
    fn width(&self) -> f64 {
        self.series.period / self.points as f64
    }

    /// `C_w`.
    fn norm(&self, norms: &StateNorms) -> f64 {
        norms.start * (self.points as f64 * square_sum(&self.series)).sqrt()
    }

    /// `P_p` of the slice at `p◇`.
    fn in_slice(&self, norms: &StateNorms) -> f64 {
        let state = norms.weighted.hypot(norms.auxiliary);
        (state / self.norm(norms)).powi(2) * (-2.0 * self.point).exp()
    }

    /// Probability of the first `slices` slices from `p◇` on, as a multiple of that of one slice.
    fn in_slices(&self, slices: f64) -> f64 {
        let width = self.width();
        -(-2.0 * width * slices).exp_m1() / -(-2.0 * width).exp_m1()
    }

    /// Upper bound of the probability of every window of this state. The series may have the first
    /// modes only, since others add to the norm of the state.
    pub fn most_probable(&self, norms: &StateNorms) -> f64 {
        let in_p = self.in_slice(norms) * self.in_slices(f64::INFINITY);
        let all = PostselectionChain::new(in_p, norms, &LabelledNumber::bound).all;
        all.or_nan()
    }
}

/// `Λ⁺` and `Λ⁻` of `case` with these bounds.
pub fn reach(bounds: &Bounds, case: &Case) -> [f64; 2] {
    [bounds.growth, bounds.decay].map(|rate| rate * case.duration())
}

impl Probabilities {
    /// The probabilities of the window, or of the slice where there is none.
    pub fn nearest(&self) -> &PostselectionChain {
        if self.window.is_some() { &self.in_window } else { &self.at_slice }
    }

    /// Evolutions until the field is found in the window, or in the slice where there is none:
    /// repeated, and by amplitude amplification.
    pub fn evolutions(&self) -> [LabelledNumber; 2] {
        let chain = self.nearest();
        [chain.repetitions.clone(), chain.amplified_evolutions.clone()]
    }

    /// `√P` of the window, or of the slice where there is none; 1 where neither is known. Relative
    /// to the field, an error of the whole state is `1/√P` times as large.
    pub fn amplitude(&self) -> LabelledNumber {
        match &self.nearest().all {
            all if all.value().is_some() => all.with(all.or_zero().sqrt()),
            none => LabelledNumber::estimate(1.0, none.because().unwrap_or_default()),
        }
    }

    /// The probabilities of a planned state with these norms. `label` makes labelled numbers of
    /// those that follow from the norms and are as accurate as they are.
    pub fn new(
        planned: &PlannedState,
        norms: StateNorms,
        label: &dyn Fn(f64) -> LabelledNumber,
    ) -> Self {
        let PlannedState { ref series, point, points, state_tolerance, reach, .. } = *planned;
        let (norm, slice) = (planned.norm(&norms), planned.in_slice(&norms));
        let without_window = |recovery: f64, at_slice: PostselectionChain, why: &str| Self {
            points,
            recovery,
            norm_of_state: label(norm),
            norms,
            window: None,
            window_error: None,
            norm_of_field: match at_slice.all.value() {
                Some(all) => label(recovery.exp() * norm * all.sqrt()),
                None => LabelledNumber::unavailable(why),
            },
            at_slice,
            in_window: PostselectionChain::unavailable(why),
        };
        let decayed = (!slice.is_finite()).then_some("the field has decayed to zero");
        if let Some(why) = norms.no_field().or(decayed) {
            return without_window(point, PostselectionChain::unavailable(why), why);
        }
        if points == 1 {
            // The one mode of a unitary flow is the field: `p` is not postselected.
            let whole = norms.field == norms.weighted && norms.auxiliary == 0.0;
            let label: &dyn Fn(f64) -> _ = if whole { &LabelledNumber::exact } else { label };
            let chain = PostselectionChain::new(1.0, &norms, label);
            return without_window(0.0, chain, "one mode has no register of p");
        }
        let chain = PostselectionChain::new(slice, &norms, label);
        let of_slice =
            without_window(point, chain, "the profile is e^{-p} at the recovery point only");
        // The grid of points is taken to have one at p◇: its origin is free.
        let deviation = Deviation::new(series, point, reach);
        let limit = WINDOW * state_tolerance;
        let Some(end) = deviation.window_end(limit) else { return of_slice };
        let [end, error] = deviation.within(end, limit);
        let slices = ((end - point) / planned.width()).floor() + 1.0;
        Self {
            window: Some([point, end]),
            window_error: Some(error / state_tolerance),
            in_window: PostselectionChain::new(slice * planned.in_slices(slices), &norms, label),
            ..of_slice
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Amplitudes of the wanted state and of the rest after `rounds` rounds, reflection by
    /// reflection.
    fn amplified(wanted: f64, rounds: u32) -> f64 {
        let start = [wanted, (1.0 - wanted * wanted).sqrt()];
        let mut state = start;
        for _ in 0..rounds {
            // The wanted part's sign, then about the start.
            state[0] = -state[0];
            let along = 2.0 * (start[0] * state[0] + start[1] * state[1]);
            state = [0, 1].map(|k| along * start[k] - state[k]);
        }
        state[0] * state[0]
    }

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
        for modes in [1, 2, 7, 33] {
            let series = Series::analytic(20.0, modes, transform);
            let deviation = Deviation::new(&series, 0.7, [0.4, 2.5]);
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

    #[test]
    fn amplitude_amplification_succeeds_for_certain() {
        for p in [1.0, 0.999, 0.5, 0.25, 0.2499, 0.15, 0.05, 1e-3, 1e-7] {
            let rounds = amplification_rounds(p);
            // The ancilla can only lower the amplitude.
            let lowered = (std::f64::consts::FRAC_PI_2 / (2.0 * rounds + 1.0)).sin();
            assert!(lowered <= p.sqrt() + 1e-8, "{p}: {rounds}");
            assert!((amplified(lowered, rounds as u32) - 1.0).abs() < 1e-9, "{p}: {rounds}");
            // One round fewer does not reach it.
            let fewer = (2.0 * rounds - 1.0) * p.sqrt().asin();
            assert!(rounds == 0.0 || fewer < std::f64::consts::FRAC_PI_2, "{p}: {rounds}");
        }
        // The part that the circuit omits without the ancilla.
        assert!((amplified(0.15f64.sqrt(), 1) - 0.864).abs() < 1e-3);
    }
}
