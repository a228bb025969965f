//! Where a profile is read, how long its period is, and which modes are kept.

use super::Shape;
use std::f64::consts::PI;

/// What is asked of a profile. The spectrum of `S·T` lies in `[−decay, growth]`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Demand {
    /// `ε`: largest error of the state, relative to the initial one.
    pub tolerance: f64,
    /// `Λ⁺ ≥ λ⁺T`.
    pub growth: f64,
    /// `Λ⁻ ≥ λ⁻T`.
    pub decay: f64,
    /// How far beyond the recovery point is read, too.
    pub reach: f64,
    /// Part of `ε` that the modes left out may take.
    pub truncation: f64,
    /// Part of `ε` that the neighbouring periods may take, from the left and from the right each.
    pub images: f64,
    /// `p◇`, by hand.
    pub recovery: Option<f64>,
    /// `[L, R]`, by hand.
    pub interval: Option<[f64; 2]>,
    /// Whether the coefficients come from samples, so that the ends of the interval matter and not only its length.
    pub sampled: bool,
    /// Whether the shortest period is wanted instead of the cheapest run.
    pub shortest: bool,
}

impl Demand {
    /// What a plan without anything by hand asks of the analytic coefficients.
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
        }
    }

    /// What plans are compared by: the cost of a run, or the period.
    pub fn rank(&self, period: f64, cutoff: f64) -> f64 {
        if self.shortest {
            period
        } else {
            period * cutoff * (cutoff + 1.0)
        }
    }

    /// What a neighbouring period may add to `g`.
    pub fn image(&self, point: f64) -> f64 {
        self.images * self.tolerance * (-point).exp()
    }

    /// Least period for reading at `point` and `reach` further: with `q` the point below which `g` is small enough, the left images end
    /// before the domain of dependence, `P ≥ p◇ + reach + Λ⁻ − q`; the right ones add `e^{−P}` at its other end,
    /// `P ≥ Λ⁺ + ln 1/ε`.
    pub fn period(&self, shape: &dyn Shape, point: f64) -> f64 {
        let furthest = point + self.reach + self.decay;
        let right = self.growth - (self.images * self.tolerance).ln();
        (furthest - shape.left(self.image(point))).max(right)
    }

    /// The interval that a window asks for. Samples see `e^{−p}` end at `R` and the left tail at `L`: both
    /// within what an image may add.
    pub fn ends(&self, shape: &dyn Shape, window: &Window) -> [f64; 2] {
        let upper = window.point + self.reach - (self.images * self.tolerance).ln();
        let mut lower = upper - window.period;
        if self.sampled {
            lower = lower.min(shape.left(self.image(window.point)));
        }
        [lower, upper]
    }

    /// Whether the interval given by hand has room for `window`.
    pub fn admits(&self, shape: &dyn Shape, window: &Window) -> bool {
        let Some([lower, upper]) = self.interval else {
            return true;
        };
        let inside = lower < window.point && window.point < upper;
        let long = upper - lower >= window.period;
        let [_, right] = self.ends(shape, window);
        let small = upper >= right && lower <= shape.left(self.image(window.point));
        inside && long && (!self.sampled || small)
    }

    /// Whether a reading amplified by `e^{point}` keeps its digits: `e^{p◇} Σ|c_l| ≤ ε/(20 ε_machine)`, `Σ|c_l| ≤ 2`.
    pub fn keeps_digits(&self, point: f64) -> bool {
        point <= self.highest_point()
    }

    /// The largest `p◇` that [`keeps_digits`](Self::keeps_digits).
    pub fn highest_point(&self) -> f64 {
        (self.tolerance / (40.0 * f64::EPSILON)).ln()
    }
}

/// Where a profile is read and how much of its series is kept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Window {
    /// `p◇`.
    pub point: f64,
    /// How far everything that reaches `p◇` stays from where `g` is not smooth, or not `e^{−p}`; negative when it does not.
    pub distance: f64,
    /// `P`.
    pub period: f64,
    /// Wavenumbers beyond this are left out.
    pub cutoff: f64,
}

impl Window {
    /// Modes `l ≥ 0` up to the cut-off with this period; as a float, since there may be too many to count.
    pub fn modes(&self, period: f64) -> f64 {
        (self.cutoff * period / std::f64::consts::TAU).ceil() + 1.0
    }
}

/// The window of least cost for a profile that is `e^{−p}` from `edge` on. What is read at `p◇` comes from
/// `[p◇ − Λ⁺, p◇ + Λ⁻]`, so `p◇ = Λ⁺ + edge`, or one more: there the amplification is `e` times larger and the modes left out
/// of a profile with a corner cancel.
pub fn place(shape: &dyn Shape, edge: f64, demand: &Demand) -> Option<Window> {
    let planned = [0.0, 1.0].map(|further| demand.growth + edge + further);
    let points = match &demand.recovery {
        Some(point) => std::slice::from_ref(point),
        None => &planned[..],
    };
    (points.iter())
        .filter_map(|&point| window(shape, edge, demand, point))
        .filter(|w| demand.admits(shape, w))
        .min_by(|a, b| {
            let [a, b] = [a, b].map(|w| demand.rank(w.period, w.cutoff));
            a.total_cmp(&b)
        })
}

fn window(shape: &dyn Shape, edge: f64, demand: &Demand, point: f64) -> Option<Window> {
    if !demand.keeps_digits(point) {
        return None;
    }
    let distance = point - demand.growth - edge;
    let allowed = demand.truncation * demand.tolerance * (-point).exp();
    // Below MOST, in equal ratios.
    const MOST: f64 = 1e12;
    let (mut low, mut high) = (1e-3f64.ln(), MOST.ln());
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if shape.tail(middle.exp(), distance.max(0.0)) > allowed {
            low = middle;
        } else {
            high = middle;
        }
    }
    Some(Window {
        point,
        distance,
        // The corners of the next period are no nearer.
        period: demand
            .period(shape, point)
            .max(point + demand.reach + demand.decay + distance + 1.0),
        cutoff: high.exp(),
    })
}

/// Bound on what the modes beyond `μ` of a corner add, `(2/P) Σ cos(μ_l p)/μ_l^{order+1}` at `p ≥ distance`: the integral of the
/// magnitudes, `1/(π order μ^order)`, or, since neighbours cancel, summation by parts (once or twice) with
/// `sin(πp/P) ≥ πp/(1.12 P)` for `p ≤ P/4`.
pub fn corner(order: usize, mu: f64, distance: f64) -> f64 {
    let k = order as f64;
    let power = mu.powf(-k);
    let magnitudes = power / (PI * k);
    if distance <= 0.0 {
        return magnitudes;
    }
    let parts = (1.0 + 2.0 * (k + 1.0) / (mu * distance)).min(2.0);
    magnitudes.min(1.12 * power * parts / (PI * distance * mu))
}
