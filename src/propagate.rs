//! Propagators: `w(T) = exp(−iH_l T) w(0)`, `H_l = μ_l S + iK`, for a batch of modes.
//!
//! - [`chebyshev`]: a series of the exponential. The error is below the mode's tolerance,
//!   guaranteed; the cost is counted in applications.
//! - [`krylov`]: Lanczos, restarted in time, with the same guarantee and the same cost.
//! - [`implicit`]: Crank–Nicolson and backward Euler, of second and first order in the step. The
//!   cost is counted in steps, each a solve.
//!
//! [`evolution`] is the system that they propagate. A propagator is a file of this folder that
//! implements [`method::Propagator`] and describes in a [`method::Descriptor`] what a plan needs
//! beforehand. [`descriptor`] is the table: to add a propagator, add its file, a line there, and
//! its name to [`PropagatorMethod`]. [`commutator_free`] is the Chebyshev propagator for an inflow
//! that depends on time; [`classical`] integrates `f' = A f + b` directly.
//!
//! Uses: matrix, scheme, parallel, problem, base. Paper: section 3.1, equation (3.13).

pub mod bessel;
pub mod chebyshev;
pub mod classical;
pub mod commutator_free;
mod elimination;
pub mod evolution;
mod gmres;
pub mod implicit;
pub mod inflow_panels;
pub mod intermediate_moments;
pub mod interruption;
pub mod krylov;
pub mod limiter;
mod local_factors;
pub mod method;
pub mod shifted;
pub mod time_dependent_inflow;
mod tridiagonal;

use crate::base::error::Result;
use crate::matrix::block_matrix::BlockMatrix;
use crate::matrix::bounds::Bounds;
use crate::problem::case::{Case, Integrator, Method, Propagation, PropagatorMethod};
use crate::propagate::commutator_free::CommutatorFree;
use crate::propagate::implicit::ImplicitMethod;
use crate::propagate::method::{Descriptor, ModeDemand, Propagator, PropagatorSetting};
use crate::propagate::time_dependent_inflow::Schedule;

/// The table of propagators.
pub fn descriptor(method: PropagatorMethod) -> &'static dyn Descriptor {
    match method {
        PropagatorMethod::Chebyshev => &chebyshev::ChebyshevMethod,
        PropagatorMethod::Krylov => &krylov::KrylovMethod,
        PropagatorMethod::CrankNicolson => &ImplicitMethod { name: "crank-nicolson", order: 2 },
        PropagatorMethod::BackwardEuler => &ImplicitMethod { name: "backward-euler", order: 1 },
    }
}

/// The propagator of a setting, with its scratch; given a `schedule` of the inflow, a product of
/// exponentials.
///
/// # Errors
/// If the matrix of an implicit step cannot be analysed. Not collective.
pub fn propagator<'a>(
    setting: &PropagatorSetting,
    schedule: Option<&'a Schedule>,
    matrix: &BlockMatrix,
) -> Result<Box<dyn Propagator + 'a>> {
    match schedule {
        Some(schedule) => Ok(Box::new(CommutatorFree::new(matrix, setting, schedule))),
        None => descriptor(setting.propagation.method).propagator(setting, matrix),
    }
}

/// Bound on the relative round-off of a mode's norm after `steps` steps of an implicit method;
/// `steps` is 0 for the other methods, which leaves one unit of round-off. Each step leaves a
/// residual of a few units of round-off, and these add up like a random walk (measured: half of
/// this bound at 1000 and at 4000 steps of example 1).
pub fn round_off(steps: usize) -> f64 {
    f64::EPSILON * (1.0 + 8.0 * (steps as f64).sqrt())
}

/// Bound on the relative error of the classical exponential after so many `applications`, which is
/// round-off; `None` for other algorithms.
pub fn exponential_error(case: &Case, applications: usize) -> Option<f64> {
    let is_exact =
        case.method == Method::Classical && case.classical.integrator == Integrator::Exponential;
    is_exact.then(|| round_off(applications))
}

/// Steps of an implicit method over `time`; 0 for the others.
pub fn steps(propagation: &Propagation, time: f64) -> usize {
    match propagation.step {
        Some(step) if propagation.method.order() > 0 => implicit::steps(step, time),
        _ => 0,
    }
}

/// A time to propagate over, and the relative error that a mode may have after it.
#[derive(Clone, Copy, Debug)]
pub struct PropagationSpan {
    /// The time to propagate over.
    pub time: f64,
    /// The allowed relative error.
    pub tolerance: f64,
}

/// The work of the mode of wavenumber `mu` alone: applications, or solves of an implicit method.
pub fn work(
    propagation: &Propagation,
    bounds: &Bounds,
    mu: f64,
    span: PropagationSpan,
    scratch: &mut Vec<f64>,
) -> usize {
    let PropagationSpan { time, tolerance } = span;
    let (half_width, step) = (bounds.interval(mu).half_width, propagation.step);
    let demand = ModeDemand { half_width, time, tolerance, step };
    descriptor(propagation.method).work(&demand, scratch)
}
