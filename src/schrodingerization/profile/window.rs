//! The recovery point, the period and the kept modes of a profile.

use crate::base::bisect::bisect;
use crate::matrix::lanes::LANES;
use crate::schrodingerization::profile::shape::ProfileShape;
use num_complex::Complex64;
use std::f64::consts::{PI, TAU};

/// Default width of the plateau on each side of `p◇`; a planned interval holds it.
pub const PLATEAU: f64 = 2.0;

/// The requirements that a profile meets. The spectrum of `S·T` lies in `[−decay, growth]`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProfileRequirements {
    /// `ε`: largest error of the state, relative to the initial one.
    pub tolerance: f64,
    /// `Λ⁺ ≥ λ⁺T`.
    pub growth: f64,
    /// `Λ⁻ ≥ λ⁻T`.
    pub decay: f64,
    /// How far above the recovery point the profile is also read.
    pub reach: f64,
    /// Part of `ε` that the modes left out may take.
    pub truncation: f64,
    /// Part of `ε` that each of the two neighbouring periods may take.
    pub images: f64,
    /// `p◇`, by hand.
    pub recovery: Option<f64>,
    /// `[L, R]`, by hand.
    pub interval: Option<[f64; 2]>,
    /// Whether the coefficients come from samples. Then the ends of the interval matter, not only
    /// its length.
    pub sampled: bool,
    /// Whether the shortest period is wanted instead of the cheapest run.
    pub shortest: bool,
    /// The rounding error of a mode relative to its norm; at least [`f64::EPSILON`].
    pub round_off: f64,
}

impl ProfileRequirements {
    /// The requirements of a plan by default, with analytic coefficients.
    pub fn new(tolerance: f64, growth: f64, decay: f64, reach: f64) -> Self {
        Self {
            tolerance,
            growth,
            decay,
            reach,
            truncation: 0.5,
            images: 0.125,
            recovery: None,
            interval: None,
            sampled: false,
            shortest: false,
            round_off: f64::EPSILON,
        }
    }

    /// These requirements with this decay.
    pub fn with_decay(&self, decay: f64) -> Self {
        Self { decay, ..*self }
    }

    /// These requirements with this tolerance.
    pub fn with_tolerance(&self, tolerance: f64) -> Self {
        Self { tolerance, ..*self }
    }

    /// These requirements without an interval given by hand, for the shortest period.
    pub fn in_any_interval(&self) -> Self {
        Self { interval: None, shortest: true, ..*self }
    }

    /// The quantity that a plan minimises: the cost of a run, or the period.
    pub fn rank(&self, &Window { period, cutoff, .. }: &Window) -> f64 {
        if self.shortest { period } else { period * cutoff * (cutoff + 1.0) }
    }

    /// About how many applications of `H` the modes take. It is the mean of two counts: mode by
    /// mode, and by batches of [`LANES`] from the highest mode down, each as long as its longest
    /// mode, since idle lanes cost as much as busy ones on few ranks. With `τ = ½Λ⁻√(1+μ²)` a
    /// Chebyshev series of `ln 1/tail = d` digits has the degree `τ + ½(3d)^{2/3} τ^{1/3}` (from
    /// `J_k(k sech α) ~ e^{−kα³/3}`).
    pub fn work(&self, period: f64, modes: usize) -> f64 {
        let digits = 3.0 * libm::log(10.0 * modes as f64 / self.tolerance);
        let transition = 0.5 * libm::cbrt(digits * digits);
        let degree = |l: usize| {
            let mu = TAU * l as f64 / period;
            let tau = 0.5 * self.decay * (1.0 + mu * mu).sqrt();
            tau + transition * libm::cbrt(tau)
        };
        let falling = || (0..modes).rev().map(degree);
        let batches = LANES as f64 * falling().step_by(LANES).sum::<f64>();
        0.5 * (batches + falling().sum::<f64>())
    }

    /// Bound on the contribution of a neighbouring period to `g`.
    pub fn image(&self, point: f64) -> f64 {
        self.images * self.tolerance * (-point).exp()
    }

    /// Least period for reading at `point` and `reach` further: with `q` the point below which `g`
    /// is small enough, the left images end before the domain of dependence,
    /// `P ≥ p◇ + reach + Λ⁻ − q`; the right ones add `e^{−P}` at its other end, `P ≥ Λ⁺ + ln 1/ε`.
    pub fn period(&self, shape: &dyn ProfileShape, point: f64) -> f64 {
        let furthest = point + self.reach + self.decay;
        let right = self.growth - (self.images * self.tolerance).ln();
        (furthest - shape.left(self.image(point))).max(right)
    }

    /// The interval of a window. For samples, `e^{−p}` is cut at `R` and the left tail at `L`, both
    /// below what an image may add. For analytic coefficients any interval of one period is right:
    /// it begins at least [`PLATEAU`] below `p◇`, so that it contains all readings.
    pub fn ends(&self, shape: &dyn ProfileShape, window: &Window) -> [f64; 2] {
        let upper = window.point + self.reach - (self.images * self.tolerance).ln();
        if self.sampled {
            let left = shape.left(self.image(window.point));
            return [left.min(upper - window.period), upper];
        }
        let upper = upper.min(window.point - PLATEAU + window.period);
        [upper - window.period, upper]
    }

    /// Whether the interval given by hand has room for `window`.
    pub fn admits(&self, shape: &dyn ProfileShape, window: &Window) -> bool {
        let Some([lower, upper]) = self.interval else {
            return true;
        };
        let inside = lower < window.point && window.point < upper;
        let long = upper - lower >= window.period;
        let [_, right] = self.ends(shape, window);
        let small = upper >= right && lower <= shape.left(self.image(window.point));
        inside && long && (!self.sampled || small)
    }

    /// Whether a reading amplified by `e^{point}` keeps its digits: `e^{p◇} Σ|c_l| ≤ ε/(20 r)` for
    /// a round-off `r`, `Σ|c_l| ≤ 2`.
    pub fn keeps_digits(&self, point: f64) -> bool {
        point <= self.highest_point()
    }

    /// The largest `p◇` that [`keeps_digits`](Self::keeps_digits).
    pub fn highest_point(&self) -> f64 {
        (self.tolerance / (40.0 * self.round_off)).ln()
    }
}

/// The recovery point of a profile, and the kept part of its series.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Window {
    /// `p◇`.
    pub point: f64,
    /// Distance of the domain of dependence of `p◇` from points where `g` is not smooth or not
    /// `e^{−p}`; negative if it contains such points.
    pub distance: f64,
    /// `P`.
    pub period: f64,
    /// Wavenumbers beyond this are left out.
    pub cutoff: f64,
}

/// A profile and its window.
#[derive(Clone, Debug, PartialEq)]
pub struct PlacedProfile<P> {
    /// The profile.
    pub profile: P,
    /// Its window.
    pub window: Window,
}

impl Window {
    /// Modes `l ≥ 0` up to the cut-off with this period; as a float, since there may be too many to
    /// count.
    pub fn modes(&self, period: f64) -> f64 {
        (self.cutoff * period / TAU).ceil() + 1.0
    }
}

/// `profile`, which is `e^{−p}` from `edge` on, and its window of least cost. The domain of
/// dependence of `p◇` is `[p◇ − Λ⁺, p◇ + Λ⁻]`, so `p◇ = Λ⁺ + edge`, or one more: there the
/// amplification is `e` times larger, and the omitted modes of a profile with a corner cancel.
pub fn best_window<P: ProfileShape>(
    profile: P,
    edge: f64,
    requirements: &ProfileRequirements,
) -> Option<PlacedProfile<P>> {
    let planned = [0.0, 1.0].map(|further| requirements.growth + edge + further);
    let points = match &requirements.recovery {
        Some(point) => std::slice::from_ref(point),
        None => &planned[..],
    };
    let window = (points.iter())
        .filter_map(|&point| window(&profile, edge, requirements, point))
        .filter(|w| requirements.admits(&profile, w))
        .min_by(|a, b| requirements.rank(a).total_cmp(&requirements.rank(b)))?;
    Some(PlacedProfile { profile, window })
}

fn window(
    shape: &dyn ProfileShape,
    edge: f64,
    requirements: &ProfileRequirements,
    point: f64,
) -> Option<Window> {
    if !requirements.keeps_digits(point) {
        return None;
    }
    let distance = point - requirements.growth - edge;
    let allowed = requirements.truncation * requirements.tolerance * (-point).exp();
    // Below MOST, in equal ratios.
    const MOST: f64 = 1e12;
    let refused = |x: f64| shape.tail(x.exp(), distance.max(0.0)) > allowed;
    let [_, cutoff] = bisect(1e-3f64.ln(), MOST.ln(), 60, refused);
    Some(Window {
        point,
        distance,
        // The corners of the next period are not closer.
        period: requirements
            .period(shape, point)
            .max(point + requirements.reach + requirements.decay + distance + 1.0),
        cutoff: cutoff.exp(),
    })
}

/// Bound on `|(2/P) Re Σ ĝ(μ_l) e^{iμ_l p}|` over `μ_l > μ`, where `ĝ` is a sum of parts
/// `a(x) e^{ixc}` from corners `−c` at least `distance` from `p`, whose `a` vary slowly: the
/// integral of the magnitudes, `(1/π) ∫_μ^∞ Σ|a| dx`, or, since neighbours cancel, by summation by
/// parts `Σ (|a(μ)| + ∫_μ^∞ |a'| dx) / (P sin(πp/P))`, with `sin(πp/P) ≥ πp/(1.12 P)` for
/// `p ≤ P/4`.
pub fn summed_by_parts<const N: usize>(
    parts: impl Fn(f64) -> [Complex64; N],
    mu: f64,
    distance: f64,
) -> f64 {
    // x = μ e^s; magnitudes fall, so that the left end of a step bounds it.
    const STEP: f64 = 0.02;
    let size = |a: &[Complex64; N]| a.iter().map(|a| a.norm()).sum::<f64>();
    let (mut x, mut a) = (mu, parts(mu));
    let first = size(&a);
    let (mut integral, mut variation) = (0.0, first);
    while size(&a) > 1e-6 * first {
        let next = x * STEP.exp();
        let b = parts(next);
        integral += size(&a) * (next - x);
        variation += (0..N).map(|k| (b[k] - a[k]).norm()).sum::<f64>();
        (x, a) = (next, b);
    }
    // The rest, falling like 1/x² at least.
    let magnitudes = (integral + size(&a) * x) / PI;
    if distance > 0.0 {
        magnitudes.min(1.12 * (variation + size(&a)) / (PI * distance))
    } else {
        magnitudes
    }
}
