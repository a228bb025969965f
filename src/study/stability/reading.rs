//! The error of reading `f` from the warped field at a point `p◇`, by theory.
//!
//! A component of the state that `S` multiplies by `−s/T` moves by `s` in `p`. With the periodic
//! series `G` it is read at `p◇` as `e^{p◇} G(p◇ + s)`, where the exact value is `e^{−s}`. So the
//! error relative to the field is about
//!
//! ```text
//! ‖ũ(0)‖/‖f(T)‖ · ( max |e^{p◇} G(p◇ + s) − e^{−s}|  over s in [−λ⁺T, λ⁻T]
//!                    +  ε_machine e^{p◇} Σ|c_l| )
//! ```
//!
//! It contains the errors of a point below `λ⁺T`, where `g` is not `e^{−p}`, of the ends of the
//! interval and of the truncated series, and round-off. `K` does not commute with `S` and mixes the
//! components, but they stay within the same bounds.

use crate::base::error::{Error, Result};
use crate::problem::case::Case;
use crate::schrodingerization::profile::gaussian::{Gaussian, normal_quantile};
use crate::schrodingerization::profile::series::Series;
use crate::study::stability::cases::extremes;
use crate::study::stability::panel::CurvePoint;
use crate::study::stability::reference::ReferenceProblem;

/// Largest difference of the profile from `e^{−p}` for `p ≥ 0`.
pub const THRESHOLD: f64 = 1e-8;
/// Width of the switch of the profile near `p = 0`.
const SIGMA: f64 = 1.0;

/// The ends of the spectrum of `S`, times `T`.
#[derive(Clone, Copy, Debug)]
pub struct SpectrumExtent {
    /// The largest eigenvalue `λ⁺` of `S`, times `T`.
    pub growth: f64,
    /// Minus the smallest eigenvalue of `S`, `λ⁻`, times `T`.
    pub decay: f64,
}

impl SpectrumExtent {
    /// The ends of the spectrum, measured by Lanczos' method. Collective.
    ///
    /// # Errors
    /// As [`extremes`].
    pub fn measured(reference: &mut ReferenceProblem, time: f64) -> Result<Self> {
        let found = extremes(&mut reference.prepared)?;
        Ok(Self { growth: found.highest.value * time, decay: -found.lowest.value * time })
    }

    /// Length in `p` over which components of the state move.
    pub fn length(self) -> f64 {
        self.decay + self.growth.max(0.0)
    }
}

/// A Gaussian profile that switches on below `p = 0`.
pub(crate) struct SwitchedGaussian {
    /// The profile.
    pub profile: Gaussian,
    /// The length below `p = 0` beyond which it is small.
    pub room: f64,
}

/// A Gaussian profile with [`THRESHOLD`] and [`SIGMA`] that switches on below `p = 0`.
pub(crate) fn switched_gaussian() -> SwitchedGaussian {
    let offset = -normal_quantile(THRESHOLD) * SIGMA;
    // Beyond the cutoff coefficients are below round-off.
    let digits = -libm::log(THRESHOLD * f64::EPSILON);
    let square = SIGMA * SIGMA;
    let profile = Gaussian {
        sigma: SIGMA,
        offset,
        period: 0.0,
        cutoff: (1.0 + 2.0 * (digits - offset) / square).sqrt(),
    };
    let tail = square + SIGMA * (square + 2.0 * (-libm::log(THRESHOLD) - offset)).sqrt();
    SwitchedGaussian { profile, room: tail - offset }
}

/// The error of a reading at `p`, by theory, if the norm of the state is `ratio` times that of the
/// field.
pub fn expected(series: &Series, p: f64, extent: SpectrumExtent, ratio: f64) -> f64 {
    const SAMPLES: u32 = 400;
    let SpectrumExtent { growth, decay } = extent;
    let error = |s: f64| (p.exp() * series.value(p + s) - (-s).exp()).abs();
    let all = |from: f64, to: f64| {
        (0..=SAMPLES).map(move |k| from + (to - from) * f64::from(k) / f64::from(SAMPLES))
    };
    // Components that grow or hardly decay are sampled more closely.
    let near = all(-growth, (4.0 - growth).min(decay));
    let worst = all(-growth, decay).chain(near).map(error).fold(0.0, f64::max);
    let amplified: f64 = (0..series.modes()).map(|l| series.factor(l).norm()).sum();
    ratio * (worst + f64::EPSILON * p.exp() * amplified)
}

/// The point where `of` first falls below `threshold` and the one where it last rises above it.
/// Between grid points, `ln(of)` is interpolated linearly.
pub fn plateau(
    points: &[CurvePoint],
    threshold: f64,
    of: fn(&CurvePoint) -> f64,
) -> [Option<f64>; 2] {
    let between = |a: &CurvePoint, b: &CurvePoint| {
        let part = (threshold / of(a)).ln() / (of(b) / of(a)).ln();
        Some(a.x + part * (b.x - a.x)).filter(|x| x.is_finite())
    };
    let inside = |p: &CurvePoint| of(p) <= threshold;
    let pairs = || points.windows(2);
    let first = pairs().find(|w| !inside(&w[0]) && inside(&w[1]));
    let last = pairs().rfind(|w| inside(&w[0]) && !inside(&w[1]));
    [first, last].map(|pair| pair.and_then(|w| between(&w[0], &w[1])))
}

/// Refuses a case whose inflow depends on time, for panels about `p`.
///
/// # Errors
/// [`Error::Input`] if it does.
pub fn refuse_varying(case: &Case) -> Result<()> {
    if !case.varies() {
        return Ok(());
    }
    Err(Error::input(
        "the inflow depends on time: its modes have couplings that change from step to step",
    ))
}
