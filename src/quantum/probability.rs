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
//! The window is found by [`measurement_window`](crate::quantum::measurement_window).

use crate::matrix::bounds::Bounds;
use crate::problem::case::Case;
use crate::quantum::cost::EvolutionRequirements;
use crate::quantum::labelled_number::LabelledNumber;
use crate::quantum::measurement_window::{Deviation, WINDOW};
use crate::quantum::walk::evolution_part;
use crate::schrodingerization::profile::series::{Series, points};
use crate::schrodingerization::warp_plan::WarpPlan;
use crate::solve::system::StateNorms;
use serde::Serialize;

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

    /// This state in a register, which has a power of two of points.
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
