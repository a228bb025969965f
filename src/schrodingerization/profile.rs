//! Initial functions `g(p)` of the auxiliary variable, planned from a tolerance, as Fourier series.
//!
//! Only two things are asked of `g`: it equals `e^{−p}` where information reaches the recovery point from, and its
//! Fourier series is short. With period `P`, `μ_l = 2πl/P` and `g(p) ≈ Σ_l c_l e^{iμ_l p}` the solution is
//!
//! ```text
//! u(T) = e^{p◇} Σ_l c_l e^{iμ_l p◇} w_l(T),     w_l(T) = exp((−iμ_l S + K)T) u(0)
//! ```
//!
//! read at a point `p◇`, or by another [`crate::schrodingerization::recovery::Reading`]. Data are real, so `c_{−l} w_{−l}` is the conjugate of
//! `c_l w_l`, and only `l ≥ 0` is kept.
//!
//! A profile is a file of this folder: its planned parameters, its plan, and what [`Shape`] asks for. Where `g = e^{−p}`
//! from an edge on, [`place`] finds recovery point, period and cut-off.

pub mod acl;
pub mod designed;
pub mod exponential;
pub mod gaussian;
pub mod low_somma;
pub mod placement;
pub mod series;
pub mod smooth;

use crate::problem::case::ProfileChoice;
use crate::schrodingerization::profile::acl::Acl;
use crate::schrodingerization::profile::designed::Designed;
use crate::schrodingerization::profile::exponential::Exponential;
use crate::schrodingerization::profile::gaussian::Gaussian;
use crate::schrodingerization::profile::low_somma::LowSomma;
use crate::schrodingerization::profile::placement::{Demand, Window, place};
use crate::schrodingerization::profile::smooth::Smooth;
use num_complex::Complex64;
use serde::Serialize;
use std::fmt;

/// What is known of a function `g(p)`.
pub trait Shape {
    /// `ĝ(μ) = ∫ g(p) e^{−iμp} dp`.
    fn coefficient(&self, mu: f64) -> Complex64;

    /// `g(p)`.
    fn value(&self, p: f64) -> f64;

    /// A point below which `|g| ≤ bound`.
    fn left(&self, bound: f64) -> f64;

    /// Bound on `|Σ c_l e^{iμ_l p}|` over the modes `|μ_l| > μ`, for points `p` at least `distance` from where `g` is not
    /// smooth; falls with `μ`.
    fn tail(&self, mu: f64, distance: f64) -> f64;
}

/// How a profile is known.
pub enum Form<'a> {
    /// As a function on the line.
    Transform(&'a dyn Shape),
    /// As a periodic series only.
    Series(&'a Designed),
}

/// A profile with its planned parameters.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum Profile {
    /// A trigonometric polynomial by least squares.
    Designed(Designed),
    /// `e^{−p}` cut off by a normal distribution function.
    Gaussian(Gaussian),
    /// `e^{−p}` and `e^{αp}`.
    Exponential(Exponential),
    /// `e^{−|p|}` with a polynomial between.
    Smooth(Smooth),
    /// `e^{−|p|}` convolved with a Gaussian.
    LowSomma(LowSomma),
    /// `exp(−(1 − iμ)^β)` in the wavenumber.
    Acl(Acl),
}

impl Profile {
    /// The profile of `choice` that meets `demand` at least cost, and where it is read; `None` if there is none.
    pub fn plan(choice: ProfileChoice, demand: &Demand) -> Option<(Self, Window)> {
        match choice {
            ProfileChoice::Planned => {
                let both = [ProfileChoice::Designed, ProfileChoice::Gaussian];
                let found = both.iter().filter_map(|c| Self::plan(*c, demand));
                let work = |w: &Window| demand.work(w.period, w.modes(w.period) as usize);
                found.min_by(|(_, a), (_, b)| work(a).total_cmp(&work(b)))
            }
            ProfileChoice::Designed => {
                Designed::meeting(demand).map(|(g, w)| (Self::Designed(g), w))
            }
            ProfileChoice::Gaussian => {
                Gaussian::meeting(demand).map(|(g, w)| (Self::Gaussian(g), w))
            }
            ProfileChoice::Exponential { alpha } => {
                let g = Exponential { alpha };
                place(&g, 0.0, demand).map(|w| (Self::Exponential(g), w))
            }
            ProfileChoice::Smooth { order } => {
                let g = Smooth::new(order);
                place(&g, 0.0, demand).map(|w| (Self::Smooth(g), w))
            }
            ProfileChoice::LowSomma { c } => {
                LowSomma::meeting(c, demand).map(|(g, w)| (Self::LowSomma(g), w))
            }
            ProfileChoice::Acl { beta } => {
                let g = Acl::new(beta);
                place(&g, 0.0, demand).map(|w| (Self::Acl(g), w))
            }
        }
    }

    /// The smallest tolerance for which [`plan`](Self::plan) finds one, if there is one up to 0.1.
    pub fn smallest_tolerance(choice: ProfileChoice, demand: &Demand) -> Option<f64> {
        let met = |tolerance: f64| {
            let demand = Demand {
                tolerance,
                ..*demand
            };
            match choice {
                // Without a design for each.
                ProfileChoice::Designed => Designed::possible(&demand),
                ProfileChoice::Planned => {
                    Designed::possible(&demand) || Gaussian::meeting(&demand).is_some()
                }
                _ => Self::plan(choice, &demand).is_some(),
            }
        };
        let (mut low, mut high) = (1e-16f64.ln(), 0.1f64.ln());
        if !met(high.exp()) {
            return None;
        }
        for _ in 0..50 {
            let middle = 0.5 * (low + high);
            if met(middle.exp()) {
                high = middle;
            } else {
                low = middle;
            }
        }
        Some(high.exp())
    }

    /// What is known of it.
    pub fn form(&self) -> Form<'_> {
        match self {
            Self::Designed(g) => Form::Series(g),
            Self::Gaussian(g) => Form::Transform(g),
            Self::Exponential(g) => Form::Transform(g),
            Self::Smooth(g) => Form::Transform(g),
            Self::LowSomma(g) => Form::Transform(g),
            Self::Acl(g) => Form::Transform(g),
        }
    }

    /// The interval that a window asks for; a designed series ends with its domain.
    pub fn ends(&self, demand: &Demand, window: &Window) -> [f64; 2] {
        match self.form() {
            Form::Transform(shape) => demand.ends(shape, window),
            Form::Series(_) => {
                let upper = window.point + demand.reach + demand.decay;
                [upper - window.period, upper]
            }
        }
    }

    /// What part of the error of a reading at `point` its distance to a reading `apart` further on shows. The Gaussian's
    /// error is how `g` differs from `e^{−p}`, which both readings share in part. The others' is mostly what was left
    /// out; the second's, independent, lies between nothing and `e^{apart}` times the first's, the distance between 1 and
    /// `√(1 + e^{2 apart})` times the error: the geometric mean of the two.
    pub fn seen(&self, point: f64, apart: f64) -> f64 {
        match self {
            Self::Gaussian(g) => g.seen_by(point, point + apart),
            _ => 1f64.hypot(apart.exp()).sqrt(),
        }
    }
}

impl fmt::Display for Profile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Designed(g) => write!(f, "designed: error {:.1e}", g.error),
            Self::Gaussian(g) => {
                write!(f, "gaussian: sigma {:.4}, offset {:.4}", g.sigma, g.offset)
            }
            Self::Exponential(g) => write!(f, "exponential: alpha {}", g.alpha),
            Self::Smooth(g) => write!(f, "smooth: order {}", g.order),
            Self::LowSomma(g) => write!(f, "low-somma: c {:.4}, sigma {:.4}", g.c, g.sigma),
            Self::Acl(g) => write!(f, "acl: beta {}", g.beta),
        }
    }
}

#[cfg(test)]
mod tests;
