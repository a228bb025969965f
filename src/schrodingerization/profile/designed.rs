//! A trigonometric polynomial of few modes, designed to be `e^{−p}` on the domain of dependence
//! `[−Λ⁺, Λ⁻ + reach]` only. Its period is longer than the domain by a gap, in which its values are
//! limited by round-off only.
//!
//! **Least squares.** About the middle `m` of the domain of length `L`, with `y = p − m`, even and
//! odd parts separate,
//!
//! ```text
//! g = Σ_l a_l cos(μ_l y) + b_l sin(μ_l y),     e^{−p} = e^{−m} (cosh y − sinh y),     μ_l = 2πl/P,
//! ```
//!
//! and `a`, `b` minimise `mean |g − e^{−p}|² + η²‖·‖²` each over nodes `y = (L/2) sin(θ)`, `θ`
//! equally spaced (Chebyshev's, denser to the ends, where the error would be largest). This is a
//! Fourier extension (Huybrechs 2010, SIAM J. Numer. Anal. 47, 4326), whose system is numerically
//! singular. The penalty `η` keeps `Σ|c_l|`, which amplifies round-off, below `ε/(20 ε_machine)`.
//!
//! **How many modes.** `g` is the sum of the images of `e^{−p} 1_{p>0}` convolved with an `h`
//! supported in the gap, `∫ h e^s ds = 1`. With `|ĥ| ≤ G` up to the cut-off `W` and `≤ ε` beyond,
//! analytic in the upper half plane, `ln|ĥ(i)| = 0` is at most the mean of the bounds by the
//! harmonic measure of `[−W, W]` seen from `i`, `ω = (2/π) arctan W` (two-constants theorem). So
//! with `G = ε/(20 ε_machine)`
//!
//! ```text
//! W ≥ tan((π/2) ln(1/ε) / ln(1/(20 ε_machine))),
//! ```
//!
//! for any gap. A long gap comes close to this bound, and below it if the domain itself is short.
//! The search starts there.
//!
//! **Long domains.** Beyond `LARGEST` modes the design is made for a shorter domain, at whose end
//! `g` is below `ε`. It is cut there and continued by zero to the full period, which takes a few
//! percent more modes.

pub mod circle;
pub mod least_squares;

use crate::base::bisect::bisect_whole;
use crate::schrodingerization::profile::designed::circle::{Circle, TURN};
use crate::schrodingerization::profile::designed::least_squares::minimiser;
use crate::schrodingerization::profile::series::Series;
use crate::schrodingerization::profile::shape::{EstimatorQuality, Planned, ProfileForm};
use crate::schrodingerization::profile::window::{PlacedProfile, ProfileRequirements, Window};
use num_complex::Complex64;
use std::f64::consts::{FRAC_1_SQRT_2, FRAC_PI_2, PI, SQRT_2, TAU};

/// With fewer modes, the profile may have the same error at both readings.
const FEWEST_MODES_TO_TELL: usize = 10;
/// The largest ratio of `Σ|c_l|` to the error in double precision, `ln(1/(20 ε_machine))`.
const MOST_CANCELLATION: f64 = 33.05;
/// Least `ε e^{−Λ⁺}` of a design. A tenth of it would take twice the modes.
const SMALLEST: f64 = 1e-13;
/// A shorter domain, which may be a point, has the gap of this length.
const SHORTEST: f64 = 1e-3;
/// Longest domain of a design: up to it, units of a millionth of the period resolve `e^{−p}`, and a
/// design takes seconds.
const LONGEST: f64 = 2e4;
/// Part of `ε` that the error may take on the domain. A twentieth is for round-off, a tenth for the
/// propagator, and the rest because `S` and `K` do not commute: then the error of the state was up
/// to 2.44 times the largest one on the domain (docs/numerics.md, "From the profile to the field").
const SHARE: f64 = 0.35;
/// Shares of a design that is continued (the cut may double its error): of the error, and of the
/// largest `Σ|c_l|`.
const CONTINUED_SHARES: [f64; 2] = [0.175, 0.9];
/// Most modes of a design, about; a polynomial with more is continued from a shorter domain.
const LARGEST: f64 = 160.0;
/// The largest number of modes for which several gaps are tried.
const QUICK: usize = 100;
/// Factors of the other gaps, relative to the first one.
const OTHER_GAPS: [f64; 4] = [FRAC_1_SQRT_2, SQRT_2, 2.0, 2.0 * SQRT_2];

/// The designed series.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Designed {
    /// `[p◇ − Λ⁺, p◇ + Λ⁻]`.
    pub domain: [f64; 2],
    /// Largest `e^{p◇} |g − e^{−p}|` found on the domain and as far beyond it as `g` is read.
    pub error: f64,
    /// The modes.
    #[serde(skip)]
    pub series: Series,
}

impl Designed {
    /// The design of about least work for `requirements`, read at `p◇ = 0` or the given point;
    /// `None` if round-off forbids it ([`possible`](Self::possible)).
    pub fn meeting(requirements: &ProfileRequirements) -> Option<PlacedProfile<Self>> {
        if !Self::possible(requirements) {
            return None;
        }
        let circle = Circle::new();
        // Longer gaps for long domains and for few digits.
        let length = (requirements.growth + requirements.reach + requirements.decay).max(SHORTEST);
        let planned =
            5.0 * (MOST_CANCELLATION - digits(requirements)) * libm::pow(length / 128.0, 0.2);
        let work = |g: &Polynomial| requirements.work(g.period, g.modes());
        let mut best = with_gap(&circle, requirements, planned, f64::INFINITY)?;
        // With few modes, one batch more or less matters: other gaps are tried.
        let others = if best.modes() <= QUICK { &OTHER_GAPS[..] } else { &[] };
        for factor in others {
            let limit = work(&best);
            let found = with_gap(&circle, requirements, factor * planned, limit);
            if let Some(found) = found.filter(|found| work(found) < limit) {
                best = found;
            }
        }
        let error = best.errors(&circle, domain(requirements)).fold(0.0, f64::max);
        let mut series = best.series(&circle);
        // Read at another point, the profile is e^{−p◇} g(p − p◇), so that the weights are the
        // same.
        let point = requirements.recovery.unwrap_or(0.0);
        for l in 0..series.modes() {
            let mu = series.wavenumber(l);
            series.coefficients[l] *= Complex64::new(-point, -mu * point).exp();
        }
        let window = Window {
            point,
            distance: 0.0,
            period: series.period,
            cutoff: series.wavenumber(series.modes() - 1),
        };
        let domain = [point - requirements.growth, point + requirements.decay];
        let designed = Self { domain, error, series };
        Some(PlacedProfile { profile: designed, window })
    }

    /// Whether there is a design: `ε e^{−Λ⁺}` is not too small, the domain not too long, and the
    /// case gives neither interval nor samples. Beyond its domain a design has no values to sample.
    pub fn possible(requirements: &ProfileRequirements) -> bool {
        // Also false if the growth is not known.
        let least = requirements.tolerance * libm::exp(-requirements.growth);
        let [lower, upper] = domain(requirements);
        least >= SMALLEST * coarser(requirements)
            && upper - lower <= LONGEST
            && requirements.interval.is_none()
            && !requirements.sampled
    }
}

impl Planned for Designed {
    fn form(&self) -> ProfileForm<'_> {
        ProfileForm::Series(&self.series)
    }

    fn description(&self) -> String {
        format!("designed: error {:.1e}", self.error)
    }

    fn estimate_doubt(&self, modes: usize, quality: EstimatorQuality) -> Option<&'static str> {
        if modes < FEWEST_MODES_TO_TELL {
            Some("so few modes may err alike at both recovery points")
        } else {
            quality.doubt_of_oscillation()
        }
    }
}

/// The rounding error of modes as a multiple of that of double precision.
fn coarser(requirements: &ProfileRequirements) -> f64 {
    requirements.round_off / f64::EPSILON
}

/// `ln 1/ε`, relative to the largest value on the domain, `e^{Λ⁺}`.
fn digits(requirements: &ProfileRequirements) -> f64 {
    requirements.growth - libm::log(requirements.tolerance)
}

/// The interval on which `g` must be `e^{−p}`.
fn domain(requirements: &ProfileRequirements) -> [f64; 2] {
    [-requirements.growth, requirements.reach + requirements.decay]
}

/// The polynomial of fewest modes with a period longer by `gap` than the domain. `None` also if it
/// surely takes the work `limit` or more, which one trial shows where no shorter domain is used.
fn with_gap(
    circle: &Circle,
    requirements: &ProfileRequirements,
    gap: f64,
    limit: f64,
) -> Option<Polynomial> {
    let [lower, upper] = domain(requirements);
    let (tolerance, digits) = (requirements.tolerance, digits(requirements));
    let cutoff = libm::tan(FRAC_PI_2 * digits / MOST_CANCELLATION);
    // Near the limit of double precision, round-off needs a larger penalty.
    let eta = 5e-15 * coarser(requirements) * libm::exp(0.12 * (digits - 20.7).max(0.0));
    let design = |upper: f64, share: f64, digits: f64| {
        let domain = LatticeDomain::new([lower, upper], gap);
        let guess = 1 + (domain.period * cutoff / TAU) as usize;
        let attempt = |modes: usize| {
            let g = domain.fit(circle, modes, eta);
            let kept = g.keeps_digits(digits * tolerance, requirements.round_off);
            (kept && g.meets(circle, [lower, upper], share * tolerance)).then_some(g)
        };
        let most = 2 * guess + 40;
        // At least 2 modes; 1 where the work of 2 is too much.
        let within = |modes: usize| requirements.work(domain.period, modes) < limit;
        let [allowed, _] = bisect_whole(1, most + 1, within);
        let enough = limit.is_infinite() || (allowed > 1 && attempt(allowed).is_some());
        enough.then(|| least(guess, allowed, attempt)).flatten()
    };
    // The shorter domain ends where e^{−p} is far below the tolerance.
    let shorter = (TAU * LARGEST / cutoff - gap).max(2.0 * digits);
    if upper - lower <= shorter {
        return design(upper, SHARE, 1.0);
    }
    let end = lower + shorter;
    let [share, digits] = CONTINUED_SHARES;
    let short = design(end, share, digits)?;
    let period = upper - lower + gap;
    let guess = (short.modes() as f64 * period / short.period) as usize;
    let mut long = short.continued(end, period, guess + guess / 8 + 40);
    let modes = least(guess, long.modes(), |modes| {
        let g = long.truncated(modes);
        let kept = g.keeps_digits(tolerance, requirements.round_off);
        (kept && g.meets(circle, [lower, upper], SHARE * tolerance)).then_some(modes)
    })?;
    long.coefficients.truncate(modes);
    Some(long)
}

/// The result of `attempt` for the least number of modes, from 2 to `most`, that it accepts: found
/// by steps from `guess`, then by bisection. For many modes, about the least.
fn least<T>(guess: usize, most: usize, mut attempt: impl FnMut(usize) -> Option<T>) -> Option<T> {
    let (mut low, mut high) = (1, None);
    let (mut modes, mut step) = (guess.clamp(2, most), 1 + guess / 24);
    loop {
        match attempt(modes) {
            None => low = modes,
            Some(found) => high = Some((modes, found)),
        }
        modes = match &high {
            None if modes == most => return None,
            None => (modes + step).min(most),
            Some((met, _)) if *met <= low + 1 + guess / 250 => return high.map(|(_, found)| found),
            // No number of modes was refused yet.
            Some((met, _)) if low == 1 => (met - step.min(met - 2)).max(2),
            Some((met, _)) => (low + met) / 2,
        };
        step *= 2;
    }
}

/// Period and domain in whole units of `P/TURN`.
struct LatticeDomain {
    period: f64,
    middle: i64,
    end: i64,
}

impl LatticeDomain {
    /// Covers the domain, longer by at most some millionths of the period.
    fn new([lower, upper]: [f64; 2], gap: f64) -> Self {
        let period = upper - lower + gap;
        let units = TURN as f64 / period;
        Self {
            period,
            middle: (0.5 * (lower + upper) * units).floor() as i64,
            end: (0.5 * (upper - lower) * units).ceil() as i64 + 1,
        }
    }

    /// The regularised least squares.
    fn fit(&self, circle: &Circle, modes: usize, eta: f64) -> Polynomial {
        let nodes = 20 + modes + modes / 2;
        let unit = self.period / TURN as f64;
        let places: Vec<i64> = (1..=nodes)
            .map(|i| libm::sin(FRAC_PI_2 * i as f64 / nodes as f64) * self.end as f64)
            .map(|k| k.round() as i64)
            .collect();
        let weight = 1.0 / (nodes as f64).sqrt();
        // The even (+1) or odd (−1) part of the polynomial and of e^{−p}.
        let part = |sign: f64, first: usize, wave: fn(Complex64) -> f64| {
            let at = |l: usize, k: i64| weight * wave(circle.at(l as i64 * k));
            let columns: Vec<Vec<f64>> =
                (first..modes).map(|l| places.iter().map(|&k| at(l, k)).collect()).collect();
            let f: Vec<f64> = (places.iter())
                .map(|k| [self.middle + k, self.middle - k].map(|k| libm::exp(-(k as f64 * unit))))
                .map(|[above, below]| 0.5 * weight * (above + sign * below))
                .collect();
            minimiser(&columns, &f, eta)
        };
        let even = part(1.0, 0, |e| e.re);
        let odd = part(-1.0, 1, |e| e.im);
        let pairs = even.iter().skip(1).zip(&odd);
        let rest = pairs.map(|(a, b)| Complex64::new(0.5 * a, -0.5 * b));
        Polynomial {
            period: self.period,
            centre: self.middle,
            coefficients: [Complex64::from(even[0])].into_iter().chain(rest).collect(),
        }
    }
}

/// `g(p) = Re(c_0 + 2 Σ c_l e^{iμ_l (p − centre)})`.
#[derive(Clone)]
struct Polynomial {
    period: f64,
    /// The centre, in units of `P/TURN`.
    centre: i64,
    coefficients: Vec<Complex64>,
}

impl Polynomial {
    fn modes(&self) -> usize {
        self.coefficients.len()
    }

    fn truncated(&self, modes: usize) -> Self {
        Self { coefficients: self.coefficients[..modes].to_vec(), ..*self }
    }

    /// `Σ|c_l| ≤ ε/(20 r)` for modes rounded by `r`, over both signs of `l`.
    fn keeps_digits(&self, tolerance: f64, round_off: f64) -> bool {
        let sum: f64 = self.coefficients.iter().map(|c| c.norm_sqr().sqrt()).sum();
        2.0 * sum <= tolerance / (20.0 * round_off)
    }

    /// `|g − e^{−p}|` at Chebyshev points, at most about a quarter of the shortest wave apart;
    /// further apart beyond 1500 modes.
    fn errors(&self, circle: &Circle, [lower, upper]: [f64; 2]) -> impl Iterator<Item = f64> {
        let unit = self.period / TURN as f64;
        let (middle, half) = (0.5 * (lower + upper), 0.5 * (upper - lower));
        let count = 50 + 6 * self.modes().min(1500);
        (0..=count)
            .map(move |i| middle - half * libm::cos(PI * i as f64 / count as f64))
            .map(move |p| (p / unit).round() as i64)
            .map(move |k| {
                let waves = (1i64..).map(|l| circle.at(l * (k - self.centre)));
                let terms = self.coefficients.iter().skip(1).zip(waves);
                let sum: f64 = terms.map(|(c, e)| c.re * e.re - c.im * e.im).sum();
                let value = self.coefficients[0].re + 2.0 * sum;
                (value - libm::exp(-(k as f64 * unit))).abs()
            })
    }

    fn meets(&self, circle: &Circle, domain: [f64; 2], limit: f64) -> bool {
        self.errors(circle, domain).all(|error| error <= limit)
    }

    /// The first `modes` coefficients, for the longer `period`, of the function that equals this
    /// one on its period that ends at `end` and is zero elsewhere. With the middle `q` of that
    /// period of length `P`, `c_l = (P/period) Σ_m c_m e^{iν_m q} sinc(π(m − lP/period))`.
    fn continued(&self, end: f64, period: f64, modes: usize) -> Self {
        let unit = period / TURN as f64;
        let centre = ((end - 0.5 * self.period) / unit).round() as i64;
        let moved = centre as f64 * unit / self.period - self.centre as f64 / TURN as f64;
        let known = self.modes() as i64;
        let terms: Vec<(i64, Complex64)> = (1 - known..known)
            .map(|m| {
                let c = self.coefficients[m.unsigned_abs() as usize];
                let (sin, cos) = libm::sincos(TAU * (m as f64 * moved).fract());
                let c = if m < 0 { c.conj() } else { c };
                (m, c * Complex64::new(cos, sin))
            })
            .collect();
        let ratio = self.period / period;
        let coefficient = |l: usize| {
            let x = l as f64 * ratio;
            let nearest = x.round();
            // sin(π(m − x)) up to its sign, without cancellation if x is nearly whole.
            let sin = libm::sin(PI * (nearest - x));
            let sinc = |m: i64| match m - nearest as i64 {
                0 if nearest == x => 1.0,
                n if n % 2 == 0 => sin / (PI * (m as f64 - x)),
                _ => -sin / (PI * (m as f64 - x)),
            };
            terms.iter().map(|(m, c)| c * sinc(*m)).sum::<Complex64>() * ratio
        };
        Self { period, centre, coefficients: (0..modes).map(coefficient).collect() }
    }

    fn series(&self, circle: &Circle) -> Series {
        let moved = |(l, c): (i64, &Complex64)| c * circle.at(-l * self.centre);
        Series {
            period: self.period,
            coefficients: (0i64..).zip(&self.coefficients).map(moved).collect(),
            last_is_unpaired: false,
        }
    }
}

#[cfg(test)]
mod tests;
