//! The interface of profiles.

use crate::schrodingerization::profile::series::Series;
use num_complex::Complex64;

/// A function `g(p)` on the line.
pub trait ProfileShape {
    /// `ĝ(μ) = ∫ g(p) e^{−iμp} dp`.
    fn coefficient(&self, mu: f64) -> Complex64;

    /// `g(p)`.
    fn value(&self, p: f64) -> f64;

    /// A point below which `|g| ≤ bound`.
    fn left(&self, bound: f64) -> f64;

    /// Bound on `|Σ c_l e^{iμ_l p}|` over the modes `|μ_l| > μ`, for points `p` at least `distance`
    /// from where `g` is not smooth; falls with `μ`.
    fn tail(&self, mu: f64, distance: f64) -> f64;
}

/// The form in which a profile is known.
pub enum ProfileForm<'a> {
    /// As a function on the line.
    Transform(&'a dyn ProfileShape),
    /// As a periodic series only.
    Series(&'a Series),
}

/// A profile whose parameters are planned.
pub trait Planned {
    /// The form in which it is known.
    fn form(&self) -> ProfileForm<'_>;

    /// Kind and parameters of the profile, in words.
    fn description(&self) -> String;
}
