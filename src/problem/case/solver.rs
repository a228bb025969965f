//! `[solver]` without `solver.warp`: the method, its accuracy, and how it propagates.

use crate::base::error::Result;
use crate::base::text::choice_text;
use crate::problem::case::file::CaseFile;
use crate::problem::case::warp::WarpTable;
use crate::problem::limits::{LARGEST_TOLERANCE, MOST_STEPS};
use serde::{Deserialize, Serialize};

/// Default of `solver.classical.cfl`.
pub const DEFAULT_CFL: f64 = 0.9;

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

/// Files and lines of settings of `[solver]`, for errors of a plan.
#[derive(Clone, Debug)]
pub struct SolverPlaces {
    /// File and line of `solver.tolerance`.
    pub tolerance: String,
    /// File and line of `solver.warp.interval`.
    pub interval: String,
}

impl SolverPlaces {
    /// The places of settings in `file`.
    pub(super) fn of(file: &CaseFile<'_>) -> Self {
        Self {
            tolerance: file.place("solver.tolerance"),
            interval: file.place("solver.warp.interval"),
        }
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

/// `[solver.classical]`: the settings of the classical method.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClassicalSettings {
    /// `solver.classical.integrator`: the time integrator.
    pub integrator: Integrator,
    /// `solver.classical.cfl`: the step of explicit methods, relative to the longest one that keeps
    /// the maximum principle.
    pub cfl: f64,
}

/// `[solver.classical]` as it is written.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub struct ClassicalTable {
    integrator: Integrator,
    cfl: Option<f64>,
}

impl ClassicalTable {
    /// The settings of the classical method.
    pub fn check(&self, file: &CaseFile<'_>) -> Result<ClassicalSettings> {
        Ok(ClassicalSettings { integrator: self.integrator, cfl: self.cfl(file)? })
    }

    fn cfl(&self, file: &CaseFile<'_>) -> Result<f64> {
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
