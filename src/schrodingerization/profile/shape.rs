//! The interface of profiles.

use crate::schrodingerization::profile::series::Series;
use num_complex::Complex64;
use serde::Serialize;

/// A function `g(p)` on the line.
pub trait ProfileShape {
    /// `ĝ(μ) = ∫ g(p) e^{−iμp} dp`.
    fn coefficient(&self, mu: f64) -> Complex64;

    /// `g(p)`.
    fn value(&self, p: f64) -> f64;

    /// `g` for many points: what does not depend on them is computed once.
    fn values(&self) -> Box<dyn Fn(f64) -> f64 + '_> {
        Box::new(|p| self.value(p))
    }

    /// A point below which `|g| ≤ bound`.
    fn left(&self, bound: f64) -> f64;

    /// Bound on `|Σ c_l e^{iμ_l p}|` over the modes `|μ_l| > μ`, for points `p` at least `distance`
    /// from where `g` is not smooth; falls with `μ`.
    fn tail(&self, mu: f64, distance: f64) -> f64;
}

/// The form in which a profile is known.
pub enum ProfileForm<'a> {
    /// A function on the line, by its transform.
    Transform(&'a dyn ProfileShape),
    /// A periodic series only.
    Series(&'a Series),
}

/// How well the distance of two readings shows the error of the series.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct EstimatorQuality {
    /// The part of the error that the distance shows; above 1 if it overstates the error.
    #[serde(rename = "seen")]
    pub efficiency: f64,
    /// Bound on the factor by which that part depends on the state; infinite if it is not known.
    #[serde(rename = "seen_within")]
    pub doubt: f64,
}

impl EstimatorQuality {
    /// The distance is taken for the error, and may be any part of it.
    pub const UNKNOWN: Self = Self { efficiency: 1.0, doubt: f64::INFINITY };

    /// If the distance shows a smaller part of the error than this, it may consist mostly of other
    /// differences between the readings (round-off, truncated series).
    const LEAST_EFFICIENCY: f64 = 0.35;
    /// Largest factor by which the visible part of the error may depend on the state.
    const LARGEST_DOUBT: f64 = 3.0;

    /// The doubt of a profile whose error oscillates in `p`, so that its visible part is known.
    pub fn doubt_of_oscillation(self) -> Option<&'static str> {
        (self.efficiency < Self::LEAST_EFFICIENCY || self.doubt > Self::LARGEST_DOUBT)
            .then_some("both recovery points share most of the error")
    }
}

/// A profile whose parameters are planned.
pub trait Planned {
    /// The form in which it is known.
    fn form(&self) -> ProfileForm<'_>;

    /// Kind and parameters of the profile, in words.
    fn description(&self) -> String;

    /// The reason why the distance of two readings, with `modes` propagated, may not estimate the
    /// error; `None` if it does.
    fn estimate_doubt(&self, _modes: usize, _quality: EstimatorQuality) -> Option<&'static str> {
        Some("the modes that this profile omits may cancel at both recovery points")
    }
}
