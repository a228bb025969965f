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
//! repetitions, or after `⌊π/(4 arcsin √P)⌋` rounds of amplitude amplification.
//!
//! **The window** ends where the field is no longer read correctly. At `p` the state's part at rate
//! `s` of the spectrum of `−ST` is read from `g(p + s)`, so `g` must be `e^{−p}` within `ε e^{−p}`
//! on `[p − Λ⁺, p + Λ⁻]`. This is checked on the series itself.

use crate::matrix::bounds::Bounds;
use crate::quantum::figure::Figure;
use crate::schrodingerization::profile::series::Series;
use crate::schrodingerization::warp_plan::WarpPlan;
use crate::solve::system::StateNorms;
use num_complex::Complex64;
use rustfft::FftPlanner;
use serde::Serialize;

/// What is postselected one after the other, and what that costs.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Chain {
    /// `P_p`.
    pub in_p: Figure,
    /// `P_f` given that.
    pub field_given_p: Figure,
    /// `P_π` given both; 1 without weights.
    pub weights_given_field: Figure,
    /// All of it.
    pub all: Figure,
    /// Repetitions until it succeeds, on average: `1/P`.
    pub repetitions: Figure,
    /// Rounds of amplitude amplification, each with the evolution and its inverse.
    pub amplification_rounds: Figure,
    /// Evolutions until it succeeds, on average: `(2r + 1)/sin²((2r + 1) arcsin √P)` with `r`
    /// rounds.
    pub amplified_evolutions: Figure,
}

/// Probabilities of a run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Probabilities {
    /// `N_p`.
    pub points: usize,
    /// `p◇`.
    pub recovery: f64,
    /// `C_w`.
    pub norm_of_state: Figure,
    /// The norms they follow from.
    pub norms: StateNorms,
    /// `[p◇, p_e)`.
    pub window: Option<[f64; 2]>,
    /// Of the slice at `p◇`. Halves with every doubling of `N_p`.
    pub at_slice: Chain,
    /// Of the window.
    pub in_window: Chain,
    /// `C_f` from the probability of the slice: the norm of the field as a quantum computer finds
    /// it.
    pub norm_of_field: Figure,
}

/// `Σ_l |c_l|²` over the modes of both signs.
pub fn square_sum(series: &Series) -> f64 {
    (0..series.modes())
        .map(|l| {
            let partners = if series.is_alone(l) { 1.0 } else { 2.0 };
            partners * series.coefficients[l].norm_sqr()
        })
        .sum()
}

/// The end of the window that begins at `point`: the field is read within `tolerance` from every
/// `p` in it. `None` where not even `point` is such a place.
pub fn window_end(
    series: &Series,
    point: f64,
    [growth, decay]: [f64; 2],
    tolerance: f64,
) -> Option<f64> {
    /// Samples of the shortest wave, about.
    const SAMPLES: usize = 8;
    /// Beyond this length the window adds nothing visible to the probability.
    const LONGEST: f64 = 12.0;
    let lower = point - growth;
    let samples = (SAMPLES * series.modes()).next_power_of_two();
    let step = series.period / samples as f64;
    let mut values = vec![Complex64::ZERO; samples];
    for (l, value) in values.iter_mut().take(series.modes()).enumerate() {
        *value = series.factor(l) * Complex64::new(0.0, series.wavenumber(l) * lower).exp();
    }
    FftPlanner::new().plan_fft_inverse(samples).process(&mut values);
    // The first place, upwards, where g is not accurate enough for the lowest p that reads it.
    let good = |(k, value): (usize, &Complex64)| {
        let q = lower + k as f64 * step;
        let p = (q - decay).max(point);
        (value.re - (-q).exp()).abs() <= tolerance * (-p).exp()
    };
    let first = values.iter().enumerate().position(|at| !good(at));
    let end = lower + first.unwrap_or(samples) as f64 * step - step - decay;
    (end > point).then_some(end.min(point + LONGEST))
}

impl Chain {
    fn new(in_p: f64, norms: &StateNorms, exact: &dyn Fn(f64) -> Figure) -> Self {
        let state = norms.weighted.hypot(norms.auxiliary);
        let square = |a: f64, b: f64| (a / b) * (a / b);
        let field = square(norms.weighted, state);
        let weights = square(norms.field, norms.weighted);
        let all = in_p * field * weights;
        let angle = all.sqrt().min(1.0).asin();
        let rounds = (std::f64::consts::FRAC_PI_4 / angle).floor();
        let evolutions = 2.0 * rounds + 1.0;
        let success = (evolutions * angle).sin().powi(2);
        Self {
            in_p: exact(in_p),
            field_given_p: exact(field),
            weights_given_field: exact(weights),
            all: exact(all),
            repetitions: exact(1.0 / all),
            amplification_rounds: exact(rounds),
            amplified_evolutions: exact(evolutions / success),
        }
    }

    fn unavailable(why: &str) -> Self {
        let none = || Figure::unavailable(why);
        Self {
            in_p: none(),
            field_given_p: none(),
            weights_given_field: none(),
            all: none(),
            repetitions: none(),
            amplification_rounds: none(),
            amplified_evolutions: none(),
        }
    }
}

/// The state that a run prepares, as its plan knows it.
#[derive(Clone, Copy)]
pub struct PlannedState<'a> {
    /// Bounds of the generator.
    pub bounds: &'a Bounds,
    /// The plan of the modes.
    pub warp: &'a WarpPlan,
    /// `T`.
    pub time: f64,
    /// Points in `p`: of the plan, or of the register that holds them.
    pub points: usize,
}

impl Probabilities {
    /// `√P` of the window, or of the slice where there is none; 1 where neither is known. Relative
    /// to the field, an error of the whole state is `1/√P` times as large.
    pub fn amplitude(&self) -> f64 {
        let known = self.in_window.all.value().or(self.at_slice.all.value());
        known.map_or(1.0, f64::sqrt)
    }

    /// Probabilities of a planned state with these norms. `label` makes figures of what follows
    /// from the norms, which is as accurate as they are.
    pub fn new(
        planned: &PlannedState<'_>,
        norms: StateNorms,
        label: &dyn Fn(f64) -> Figure,
    ) -> Self {
        let PlannedState { bounds, warp, time, points } = *planned;
        let series = &warp.series;
        let point = warp.readings[0].point;
        let width = series.period / points as f64;
        let norm = norms.start * (points as f64 * square_sum(series)).sqrt();
        let state = norms.weighted.hypot(norms.auxiliary);
        let slice = (state / norm).powi(2) * (-2.0 * point).exp();
        if norms.field == 0.0 || !slice.is_finite() {
            let none = Chain::unavailable("nothing is left of the field");
            return Self {
                points,
                recovery: point,
                norm_of_state: label(norm),
                norms,
                window: None,
                at_slice: none.clone(),
                in_window: none,
                norm_of_field: Figure::unavailable("nothing is left of the field"),
            };
        }
        // The grid of points is taken to have one at p◇: its origin is free.
        let lambda = [bounds.growth * time, bounds.decay * time];
        let end = window_end(series, point, lambda, 10.0 * warp.state_tolerance);
        let in_window = end.map(|end| {
            let slices = ((end - point) / width).floor() + 1.0;
            let sum = -(-2.0 * width * slices).exp_m1() / -(-2.0 * width).exp_m1();
            Chain::new(slice * sum, &norms, label)
        });
        let at_slice = Chain::new(slice, &norms, label);
        let all = at_slice.all.value().unwrap_or(f64::NAN);
        Self {
            points,
            recovery: point,
            norm_of_state: label(norm),
            norms,
            window: end.map(|end| [point, end]),
            in_window: in_window.unwrap_or_else(|| {
                Chain::unavailable("the profile is e^{-p} at the recovery point only")
            }),
            norm_of_field: label(point.exp() * norm * all.sqrt()),
            at_slice,
        }
    }
}
