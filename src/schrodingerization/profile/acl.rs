//! The kernel of An, Childs and Lin (arXiv 2312.03916), `0 < β < 1`:
//!
//! ```text
//! ĝ(μ) = exp(2^β − (1−iμ)^β) / (1+iμ).
//! ```
//!
//! In the upper half plane `ĝ` is analytic except for the pole at `μ = i`, so `g = e^{−p}` exactly
//! for `p > 0`. In the lower half plane, the branch cut from `−i` down gives `|g(p)| ≤ C e^p` for
//! `p < 0`, `C = (1/2π) ∫ |ĝ(x−i)| dx`. All derivatives exist at 0.

use crate::schrodingerization::profile::shape::{Planned, ProfileForm, ProfileShape};
use crate::schrodingerization::profile::window::{
    PlacedProfile, ProfileRequirements, best_window, summed_by_parts,
};
use num_complex::Complex64;
use std::cell::OnceCell;
use std::f64::consts::{FRAC_PI_2, PI};

/// `|ĝ|` below `e^{−DIGITS}` is left out of values.
const DIGITS: f64 = 40.0;
/// Farther than this from 0, the left part is an integral along the cut.
const NEAR: f64 = 0.5;

/// The profile.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Acl {
    /// `β`.
    pub beta: f64,
    /// `C`.
    pub bound: f64,
}

impl Acl {
    /// The profile of `β` for `requirements`, and its window.
    pub fn meeting(beta: f64, requirements: &ProfileRequirements) -> Option<PlacedProfile<Self>> {
        best_window(Self::new(beta), 0.0, requirements)
    }

    /// The profile of `β`, within [`BETAS`](crate::problem::limits::BETAS).
    pub fn new(beta: f64) -> Self {
        // ĝ(x−i) = exp(2^β − (−ix)^β)/(2+ix), the same for ±x.
        let fall = (FRAC_PI_2 * beta).cos();
        let magnitude = |x: f64| Complex64::from((-fall * x.powf(beta)).exp() / 2f64.hypot(x));
        let start = 1e-6;
        let integral =
            start * magnitude(0.0).re + PI * summed_by_parts(|x| [magnitude(x)], start, 0.0);
        Self { beta, bound: 2f64.powf(beta).exp() * integral / PI }
    }

    /// `ĝ` at a complex point below the axis and above the cut.
    fn transform(&self, mu: Complex64) -> Complex64 {
        let i_mu = Complex64::new(-mu.im, mu.re);
        (2f64.powf(self.beta) - (1.0 - i_mu).powf(self.beta)).exp() / (1.0 + i_mu)
    }
}

/// `g(p)` for `p < 0`: what does not depend on `p`.
struct LeftPart<'a> {
    profile: &'a Acl,
    /// Number of the terms of the inverse transform, but for the first.
    count: i64,
    /// These terms, if there are at most [`MOST_STORED`], once one is needed.
    near: OnceCell<Vec<NearTerm>>,
    far: Vec<FarTerm>,
    /// `2^β`.
    constant: f64,
}

/// A term of the inverse transform.
struct NearTerm {
    mu: Complex64,
    /// `ĝ(μ)`.
    transform: Complex64,
}

/// A term of the integral along the cut.
struct FarTerm {
    t: f64,
    /// `t^β cos πβ`.
    fall: f64,
    /// `sin(t^β sin πβ)`.
    wave: f64,
}

/// Distance of two points of the integral along the cut, in `ln t`.
const CUT_STEP: f64 = 0.125;
/// The inverse transform by the trapezoidal rule has this period, after which both tails are beyond
/// round-off.
const PERIOD: f64 = 2.0 * DIGITS + 2.0;
/// Distance of its points.
const NEAR_STEP: f64 = 2.0 * PI / PERIOD;
/// Largest number of terms that are kept: 2 MiB. From `β = 0.47` down there are more.
const MOST_STORED: i64 = 1 << 16;

impl NearTerm {
    fn new(profile: &Acl, k: i64) -> Self {
        let mu = Complex64::new(NEAR_STEP * k as f64, -0.5);
        Self { mu, transform: profile.transform(mu) }
    }

    fn value(&self, p: f64) -> f64 {
        (self.transform * (Complex64::I * self.mu * p).exp()).re
    }
}

impl<'a> LeftPart<'a> {
    fn new(profile: &'a Acl) -> Self {
        let beta = profile.beta;
        let constant = 2f64.powf(beta);
        let last = (DIGITS + constant) / (FRAC_PI_2 * beta).cos();
        let count = (last.powf(1.0 / beta) / NEAR_STEP).ceil() as i64;
        let (sin, cos) = (PI * beta).sin_cos();
        let far = |k: i32| {
            let t = (CUT_STEP * f64::from(k)).exp();
            let power = t.powf(beta);
            FarTerm { t, fall: power * cos, wave: (power * sin).sin() }
        };
        // From e^{−40} to where e^{tp} is negligible.
        let far = (-320..=64).map(far).collect();
        Self { profile, count, near: OnceCell::new(), far, constant }
    }

    /// `g(p)`.
    fn value(&self, p: f64) -> f64 {
        if p > -NEAR { self.by_transform(p) } else { self.along_cut(p) }
    }

    /// `g(p)`, `−½ < p < 0`: the inverse transform along `Im μ = −½`.
    fn by_transform(&self, p: f64) -> f64 {
        let term = |k: i64| NearTerm::new(self.profile, k);
        let rest: f64 = if self.count > MOST_STORED {
            (1..=self.count).rev().map(|k| term(k).value(p)).sum()
        } else {
            let stored = self.near.get_or_init(|| (1..=self.count).rev().map(term).collect());
            stored.iter().map(|term| term.value(p)).sum()
        };
        (2.0 * rest + term(0).value(p)) * NEAR_STEP / (2.0 * PI)
    }

    /// `g(p)`, `p ≤ −½`, along both sides of the cut `μ = −i(1+t)`:
    /// `(1/π) ∫_0^∞ e^{(1+t)p + 2^β − t^β cos πβ} sin(t^β sin πβ)/(2+t) dt`, with `t = e^s` by the
    /// trapezoidal rule.
    fn along_cut(&self, p: f64) -> f64 {
        let term = |FarTerm { t, fall, wave }: &FarTerm| {
            let exponent = (1.0 + t) * p + self.constant - fall;
            exponent.exp() * wave / (2.0 + t) * t
        };
        self.far.iter().map(term).sum::<f64>() * CUT_STEP / PI
    }
}

impl Planned for Acl {
    fn form(&self) -> ProfileForm<'_> {
        ProfileForm::Transform(self)
    }

    fn description(&self) -> String {
        format!("acl: beta {}", self.beta)
    }
}

impl ProfileShape for Acl {
    fn coefficient(&self, mu: f64) -> Complex64 {
        self.transform(Complex64::from(mu))
    }

    fn value(&self, p: f64) -> f64 {
        self.values()(p)
    }

    fn values(&self) -> Box<dyn Fn(f64) -> f64 + '_> {
        let left = LeftPart::new(self);
        Box::new(move |p| if p >= 0.0 { (-p).exp() } else { left.value(p) })
    }

    fn left(&self, bound: f64) -> f64 {
        (bound / self.bound).ln().min(0.0)
    }

    fn tail(&self, mu: f64, distance: f64) -> f64 {
        summed_by_parts(|x| [self.coefficient(x)], mu, distance)
    }
}
