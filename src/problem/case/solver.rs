//! `[time]`, `[scheme]`, `[checkpoint]`, and `[solver]` without `solver.warp`.

use crate::base::error::Result;
use crate::base::text::choice_text;
use crate::problem::case::file::CaseFile;
use crate::problem::case::warp::WarpTable;
use crate::problem::limits::{LARGEST_NUMBER, LARGEST_TOLERANCE, MOST_STEPS};
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::time::Duration;

/// Default of `solver.classical.cfl`.
pub const DEFAULT_CFL: f64 = 0.9;

/// The interface law: how the Hamiltonian-preserving flux at a jump of `V` combines values on the
/// side from which particles come.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Interface {
    /// Linear interpolation at the source velocity (the paper's).
    #[default]
    Hat,
    /// Overlap of energy intervals, which conserves row sums and flux-weighted column sums.
    Conservative,
}

impl Interface {
    /// All laws.
    pub const ALL: [Self; 2] = [Self::Hat, Self::Conservative];
}

/// Time integrator of the classical method `f' = A f + b`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Integrator {
    /// The exact exponential of the semi-discrete system.
    #[default]
    Exponential,
    /// First-order forward Euler.
    ForwardEuler,
    /// Third-order strong-stability-preserving Runge–Kutta.
    SspRk3,
}

impl Integrator {
    /// Applications of the matrix per step.
    pub fn stages(self) -> usize {
        match self {
            Self::SspRk3 => 3,
            Self::Exponential | Self::ForwardEuler => 1,
        }
    }
}

/// Slope limiter of the classical method (paper, the remark after section 4.2).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Limiter {
    /// No limiter: the scheme of first order.
    #[default]
    None,
    /// `ψ(θ) = max(0, min(1, θ))`.
    Minmod,
    /// `ψ(θ) = (|θ| + θ)/(1 + |θ|)`.
    VanLeer,
}

/// The method that computes `f(T)`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// Schrödingerization: unitary modes, recovered by the profile.
    #[default]
    Schrodingerized,
    /// Direct integration of the semi-discrete system.
    Classical,
}

/// The propagator that applies `exp(−iHT)` to a mode.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PropagatorMethod {
    /// Chebyshev series.
    #[default]
    Chebyshev,
    /// Lanczos, restarted in time.
    Krylov,
    /// Second-order implicit midpoint, unitary.
    CrankNicolson,
    /// First-order implicit, dissipative.
    BackwardEuler,
}

impl PropagatorMethod {
    /// Order in the time step; 0 for a method that meets a tolerance by itself.
    pub fn order(self) -> usize {
        match self {
            Self::Chebyshev | Self::Krylov => 0,
            Self::CrankNicolson => 2,
            Self::BackwardEuler => 1,
        }
    }

    /// Whether `solver.propagator.step` can be given.
    pub fn takes_step(self) -> bool {
        self != Self::Chebyshev
    }

    /// Whether the inflow may depend on time.
    pub fn takes_varying_inflow(self) -> bool {
        self == Self::Chebyshev
    }

    /// Whether all inflow may share one auxiliary unknown.
    pub fn takes_scalar_inflow(self) -> bool {
        self == Self::Chebyshev
    }
}

/// `[time]` as it is written.
#[derive(Debug, Default, Deserialize)]
pub struct TimeTable {
    #[serde(default)]
    start: f64,
    end: Option<f64>,
}

impl TimeTable {
    /// The times at which the run begins and ends.
    pub fn check(&self, file: &CaseFile<'_>) -> Result<Range<f64>> {
        let end = file.required("time.end", self.end, "a number")?;
        let least = 1.0 / LARGEST_NUMBER;
        file.within("time.end", end, least..=LARGEST_NUMBER, || {
            format!("must be above 0, between {least:e} and {LARGEST_NUMBER:e}")
        })?;
        let start = file.within("time.start", self.start, 0.0..=LARGEST_NUMBER, || {
            format!("must be from 0 to {LARGEST_NUMBER:e}")
        })?;
        if end - start < least.max(SHORTEST * end) {
            let message = format!("must be below time.end = {end}, by {SHORTEST:e} of it at least");
            return file.refuse("time.start", message);
        }
        if start > 0.0 && !file.has("initial.field") {
            let message = "initial.f is f(0); a later start needs initial.field, a file with f at \
                           that time";
            return file.refuse("time.start", message);
        }
        Ok(start..end)
    }
}

/// Least duration of a run relative to its final time, so that their difference has digits.
const SHORTEST: f64 = 1e-6;

/// `[scheme]` as it is written.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub struct SchemeTable {
    /// `interface`, if it is given.
    pub interface: Option<Interface>,
    pub limiter: Limiter,
    /// `degree`: the default for every axis.
    pub degree: i64,
    flux: Option<f64>,
    pub ends: EndFlux,
}

/// The numerical flux at the ends of the box, in space and in velocity.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum EndFlux {
    /// Upwind: outflow is lost, data outside the box enter.
    #[default]
    Open,
    /// The flux between elements, with zero outside. With the central flux nothing is lost: waves
    /// that reach an end return as waves that the grid does not resolve.
    Closed,
}

/// Default of `scheme.flux` for a degree above 0; for degree 0 it is 1. It has half of the
/// dissipation of the upwind flux and hardly more error (docs/high-order.md).
pub const DEFAULT_FLUX: f64 = 0.5;

impl SchemeTable {
    /// The interface law of the upwind scheme of degree 0. A scheme that couples traces by energy
    /// has no such law. It conserves what the law `conservative` does, so it is reported by that
    /// name.
    pub fn law(&self, couples_by_energy: bool) -> Interface {
        if couples_by_energy { Interface::Conservative } else { self.interface.unwrap_or_default() }
    }

    /// The parameter `α` of the numerical flux between elements, from 0 (central) to 1 (upwind).
    pub fn flux(&self, file: &CaseFile<'_>, degree: usize) -> Result<f64> {
        match self.flux {
            Some(flux) => file.between("scheme.flux", flux, [0.0, 1.0]),
            None if degree == 0 => Ok(1.0),
            None => Ok(DEFAULT_FLUX),
        }
    }
}

/// `[solver]` as it is written, without `solver.warp`.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub struct SolverTable {
    pub method: Method,
    tolerance: Option<f64>,
    accuracy: Option<f64>,
    pub verify: bool,
    pub strict: bool,
    pub warp: WarpTable,
    pub propagator: Propagation,
    pub classical: ClassicalTable,
    pub reduce: AllowedReductions,
}

impl SolverTable {
    /// Checks `tolerance`.
    pub fn tolerance(&self, file: &CaseFile<'_>) -> Result<f64> {
        let tolerance = self.tolerance.unwrap_or(1e-6);
        if !(tolerance > 0.0 && tolerance <= LARGEST_TOLERANCE) {
            let message = format!("must be above 0 and at most {LARGEST_TOLERANCE}");
            return file.refuse("solver.tolerance", message);
        }
        Ok(tolerance)
    }

    /// Checks `accuracy`.
    pub fn accuracy(&self, file: &CaseFile<'_>) -> Result<Option<f64>> {
        if self.accuracy.is_some_and(|accuracy| !(accuracy > 0.0 && accuracy < 1.0)) {
            return file.refuse("solver.accuracy", "must be above 0 and below 1");
        }
        Ok(self.accuracy)
    }
}

/// `[solver.propagator]`: the propagator and its time step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Propagation {
    /// The method that propagates the modes.
    pub method: PropagatorMethod,
    /// The time step of the implicit methods, which need one, or the longest step of `krylov`.
    pub step: Option<f64>,
}

impl Propagation {
    /// Checks the settings for a run of duration `time`.
    pub(super) fn check(self, file: &CaseFile<'_>, time: f64) -> Result<Self> {
        let key = "solver.propagator.step";
        match self.step {
            None if self.method.order() > 0 => {
                let method = choice_text(&self.method);
                file.refuse(key, format!("missing; \"{method}\" needs a time step above 0"))
            }
            Some(_) if !self.method.takes_step() => file.refuse(
                key,
                format!(
                    "solver.propagator.method = \"{}\" takes the whole time at once; leave it out, \
                     or choose a method with time steps",
                    choice_text(&self.method)
                ),
            ),
            Some(step) if !(time / step > 0.0 && time / step <= MOST_STEPS) => file.refuse(
                key,
                format!("must be above 0, and a duration of {time:e} at most {MOST_STEPS:e} steps"),
            ),
            _ => Ok(self),
        }
    }
}

/// `[solver.classical]` as it is written.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub struct ClassicalTable {
    pub integrator: Integrator,
    cfl: Option<f64>,
}

impl ClassicalTable {
    /// Checks `cfl`.
    pub fn cfl(&self, file: &CaseFile<'_>) -> Result<f64> {
        let cfl = self.cfl.unwrap_or(DEFAULT_CFL);
        if !(cfl > 0.0 && cfl <= 1.0) {
            let message = "must be above 0 and at most 1, where forward Euler stops being stable";
            return file.refuse("solver.classical.cfl", message);
        }
        Ok(cfl)
    }
}

/// `[solver.reduce]`: which reductions are allowed. `true` or `false` in its place holds for all.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(default)]
pub struct AllowedReductions {
    /// Leave out axes along which the data do not vary.
    pub axes: bool,
    /// Leave out velocities that no particle reaches.
    pub velocities: bool,
    /// Leave out auxiliary unknowns if nothing enters.
    pub inflow: bool,
    /// Leave out the modes `l < 0`.
    pub modes: bool,
}

impl Default for AllowedReductions {
    fn default() -> Self {
        Self { axes: true, velocities: true, inflow: true, modes: true }
    }
}

/// `[checkpoint]` as it is written.
#[derive(Debug, Default, Deserialize)]
pub struct CheckpointTable {
    minutes: Option<f64>,
}

impl CheckpointTable {
    /// Time between checkpoints; `None` if they are not made by the clock.
    pub fn check(&self, file: &CaseFile<'_>) -> Result<Option<Duration>> {
        const YEAR: f64 = 525_600.0;
        let minutes = self.minutes.unwrap_or(30.0);
        let minutes = file.within("checkpoint.minutes", minutes, 0.0..=YEAR, || {
            format!("must be from 0 (no checkpoints by the clock) to {YEAR}")
        })?;
        Ok((minutes > 0.0).then(|| Duration::from_secs_f64(60.0 * minutes)))
    }
}
