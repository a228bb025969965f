//! Initial functions `g(p)` of the auxiliary variable, planned from a tolerance, as Fourier series.
//!
//! A profile `g` meets two requirements: it equals `e^{−p}` on the domain of dependence of the
//! recovery point, and its Fourier series is short. With period `P`, `μ_l = 2πl/P` and `g(p) ≈ Σ_l
//! c_l e^{iμ_l p}` the solution is
//!
//! ```text
//! u(T) = e^{p◇} Σ_l c_l e^{iμ_l p◇} w_l(T),     w_l(T) = exp((−iμ_l S + K)T) u(0)
//! ```
//!
//! read at a point `p◇`, or by another [`Reading`](crate::schrodingerization::recovery::Reading).
//! Data are real, so `c_{−l} w_{−l}` is the conjugate of `c_l w_l`, and only `l ≥ 0` is kept.
//!
//! A profile is a file of this folder: its parameters, its plan (`meeting`), and [`Planned`]. To
//! add one, add its file and a line to each of the two tables below: [`Profile`] and
//! [`Profile::plan`]. Where `g = e^{−p}` from an edge on, [`window::best_window`] finds recovery
//! point, period and cut-off.

pub mod acl;
pub mod constant;
pub mod designed;
pub mod exponential;
pub mod gaussian;
pub mod low_somma;
pub mod series;
pub mod shape;
pub mod smooth;
pub mod window;

pub use crate::schrodingerization::profile::shape::{
    EstimatorQuality, Planned, ProfileForm, ProfileShape,
};
pub use crate::schrodingerization::profile::window::{PlacedProfile, ProfileRequirements, Window};

use crate::base::bisect::bisect;
use crate::problem::case::ProfileChoice;
use crate::schrodingerization::profile::acl::Acl;
use crate::schrodingerization::profile::constant::Constant;
use crate::schrodingerization::profile::designed::Designed;
use crate::schrodingerization::profile::exponential::Exponential;
use crate::schrodingerization::profile::gaussian::Gaussian;
use crate::schrodingerization::profile::low_somma::LowSomma;
use crate::schrodingerization::profile::smooth::Smooth;
use serde::Serialize;
use std::fmt;
use std::ops::Deref;

/// The table of profiles: an enum of the types in the files of this folder.
macro_rules! profiles {
    ($($(#[$doc:meta])* $kind:ident,)*) => {
        /// A profile with its planned parameters.
        #[derive(Clone, Debug, PartialEq, Serialize)]
        #[serde(tag = "kind", rename_all = "kebab-case")]
        pub enum Profile {
            $($(#[$doc])* $kind($kind),)*
        }

        impl Deref for Profile {
            type Target = dyn Planned;

            fn deref(&self) -> &Self::Target {
                match self {
                    $(Self::$kind(profile) => profile,)*
                }
            }
        }

        $(impl From<$kind> for Profile {
            fn from(profile: $kind) -> Self {
                Self::$kind(profile)
            }
        })*
    };
}

profiles! {
    /// A trigonometric polynomial by least squares.
    Designed,
    /// `e^{−p}` cut off by a normal distribution function.
    Gaussian,
    /// `e^{−p}` and `e^{α(p)p}`.
    Exponential,
    /// `e^{−|p|}` with a polynomial between.
    Smooth,
    /// `e^{−|p|}` convolved with a Gaussian.
    LowSomma,
    /// `exp(−(1 − iμ)^β)` in the wavenumber.
    Acl,
    /// 1, for `S = 0`; has no name in case files.
    Constant,
}

/// A profile of one kind, if there is one, as a [`Profile`].
fn any_kind<P: Into<Profile>>(found: Option<PlacedProfile<P>>) -> Option<PlacedProfile<Profile>> {
    found.map(|PlacedProfile { profile, window }| PlacedProfile { profile: profile.into(), window })
}

impl Profile {
    /// The profile of `choice` that meets `requirements` at least cost, and its window; `None` if
    /// there is none.
    pub fn plan(
        choice: &ProfileChoice,
        requirements: &ProfileRequirements,
    ) -> Option<PlacedProfile<Self>> {
        match choice {
            ProfileChoice::Planned => {
                let both = [ProfileChoice::Designed, ProfileChoice::Gaussian { sigma: None }];
                let found = both.iter().filter_map(|c| Self::plan(c, requirements));
                let work = |w: &Window| requirements.work(w.period, w.modes(w.period) as usize);
                found.min_by(|a, b| work(&a.window).total_cmp(&work(&b.window)))
            }
            ProfileChoice::Designed => any_kind(Designed::meeting(requirements)),
            ProfileChoice::Gaussian { sigma } => any_kind(Gaussian::meeting(*sigma, requirements)),
            ProfileChoice::Exponential { alpha } => {
                any_kind(Exponential::meeting(alpha, requirements))
            }
            ProfileChoice::Smooth { order } => any_kind(Smooth::meeting(*order, requirements)),
            ProfileChoice::LowSomma { c } => any_kind(LowSomma::meeting(*c, requirements)),
            ProfileChoice::Acl { beta } => any_kind(Acl::meeting(*beta, requirements)),
        }
    }

    /// Whether [`plan`](Self::plan) finds a profile; computes no design, which would take long.
    fn possible(choice: &ProfileChoice, requirements: &ProfileRequirements) -> bool {
        match choice {
            ProfileChoice::Designed => Designed::possible(requirements),
            ProfileChoice::Planned => {
                Designed::possible(requirements) || Gaussian::meeting(None, requirements).is_some()
            }
            _ => Self::plan(choice, requirements).is_some(),
        }
    }

    /// The smallest tolerance, up to 0.1, for which [`plan`](Self::plan) finds a profile.
    pub fn smallest_tolerance(
        choice: &ProfileChoice,
        requirements: &ProfileRequirements,
    ) -> Option<f64> {
        let met = |tolerance: f64| {
            let requirements = requirements.with_tolerance(tolerance);
            Self::possible(choice, &requirements)
        };
        let (low, high) = (1e-16f64.ln(), 0.1f64.ln());
        if !met(high.exp()) {
            return None;
        }
        let [_, smallest] = bisect(low, high, 50, |x| !met(x.exp()));
        Some(smallest.exp())
    }

    /// The interval of a window; a designed series ends with its domain.
    pub fn ends(&self, requirements: &ProfileRequirements, window: &Window) -> [f64; 2] {
        match self.form() {
            ProfileForm::Transform(shape) => requirements.ends(shape, window),
            ProfileForm::Series(_) => {
                let upper = window.point + requirements.reach + requirements.decay;
                [upper - window.period, upper]
            }
        }
    }
}

impl fmt::Display for Profile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.description())
    }
}

#[cfg(test)]
mod tests;
