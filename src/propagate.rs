//! Propagators: `w(T) = exp(−iH_l T) w(0)`, `H_l = μ_l S + iK`, for a batch of modes.
//!
//! | method | | error | takes |
//! |---|---|---|---|
//! | [`chebyshev`] | series of the exponential | below the mode's tolerance, guaranteed | applications |
//! | [`krylov`] | Lanczos, restarted in time | below the mode's tolerance, guaranteed | applications |
//! | [`implicit`] | Crank–Nicolson, backward Euler | second, first order in the step | steps, each a solve |

pub mod chebyshev;
pub mod classical;
pub mod commutator_free;
pub mod implicit;
pub mod krylov;
pub mod limiter;
pub mod method;
pub mod shifted;
pub mod time_dependent_inflow;

use crate::base::error::Result;
use crate::matrix::block_matrix::BlockMatrix;
use crate::matrix::blocking::Blocking;
use crate::matrix::bounds::Bounds;
use crate::matrix::lanes::{LANES, Lanes};
use crate::parallel::partition::Mesh;
use crate::problem::case::{Case, Propagation, PropagatorMethod};
use crate::propagate::chebyshev::Interval;
use crate::propagate::method::{Company, Propagator};

/// What a propagator is made for.
#[derive(Clone, Copy, Debug)]
pub struct Setting {
    /// Method and time step.
    pub propagation: Propagation,
    /// The most that a mode takes: see [`work`].
    pub largest_work: usize,
    /// Whether the space is split between ranks.
    pub split: bool,
}

/// The propagator of a setting, with its scratch.
///
/// # Errors
/// Where the matrix of an implicit step cannot be analysed. Not collective.
pub fn propagator(setting: &Setting, matrix: &BlockMatrix) -> Result<Box<dyn Propagator>> {
    Ok(match setting.propagation.method {
        PropagatorMethod::Chebyshev => Box::new(crate::propagate::chebyshev::Chebyshev::new(
            matrix,
            setting.largest_work,
        )),
        PropagatorMethod::Krylov => Box::new(crate::propagate::krylov::Krylov::new(
            matrix,
            setting.propagation.step,
        )),
        PropagatorMethod::CrankNicolson | PropagatorMethod::BackwardEuler => {
            let order = setting.propagation.method.order();
            let split = setting.split;
            Box::new(crate::propagate::implicit::Implicit::new(
                matrix, order, split,
            )?)
        }
    })
}

/// How the modes of a batch go together.
pub fn company(method: PropagatorMethod) -> Company {
    match method {
        PropagatorMethod::Chebyshev => Company::Independent,
        PropagatorMethod::Krylov => Company::Coupled,
        PropagatorMethod::CrankNicolson | PropagatorMethod::BackwardEuler => Company::Sequential,
    }
}

/// What a mode's norm is rounded by after so many steps of an implicit method, 0 for the others: each solves a system to a residual of some
/// units, which add up like a random walk (measured: half of this at 1000 and at 4000 steps of example 1).
pub fn round_off(steps: usize) -> f64 {
    f64::EPSILON * (1.0 + 8.0 * (steps as f64).sqrt())
}

/// Steps of an implicit method: as many equal ones as it takes for none to be longer than `step`, `⌈T/step⌉`; 0 for the
/// others.
pub fn steps(propagation: &Propagation, time: f64) -> usize {
    match propagation.step {
        // A quotient that is a whole number but for round-off is that number.
        Some(step) if propagation.method.order() > 0 => {
            (time / step * (1.0 - 1e-12)).ceil().max(1.0) as usize
        }
        _ => 0,
    }
}

/// What a mode takes by itself over `time` to a relative error `tolerance`: applications, or solves of an implicit method.
pub fn work(
    case: &Case,
    bounds: &Bounds,
    mu: f64,
    (time, tolerance): (f64, f64),
    scratch: &mut Vec<f64>,
) -> usize {
    let half_width = Interval::new(mu, bounds.rate, bounds.growth).half_width;
    match case.propagator.method {
        PropagatorMethod::Chebyshev => {
            crate::propagate::chebyshev::degree(scratch, half_width * time, tolerance)
        }
        PropagatorMethod::Krylov => {
            let longest = case.propagator.step.unwrap_or(time).min(time);
            crate::propagate::krylov::applications(scratch, half_width, (time, longest), tolerance)
        }
        PropagatorMethod::CrankNicolson | PropagatorMethod::BackwardEuler => {
            steps(&case.propagator, time)
        }
    }
}

/// Applications that a unit of [`work`] is worth, roughly.
pub fn unit(method: PropagatorMethod) -> usize {
    match method {
        PropagatorMethod::Chebyshev => 1,
        PropagatorMethod::Krylov => 2,
        PropagatorMethod::CrankNicolson | PropagatorMethod::BackwardEuler => 20,
    }
}

/// How much longer a step takes where the space is split and a Krylov solver comes on top of the factors.
pub fn cost_of_splitting(method: PropagatorMethod) -> f64 {
    match method {
        PropagatorMethod::Chebyshev | PropagatorMethod::Krylov => 1.0,
        PropagatorMethod::CrankNicolson | PropagatorMethod::BackwardEuler => 20.0,
    }
}

/// Sizes of a rank's part of the matrix.
#[derive(Clone, Copy, Debug)]
pub struct Sizes {
    /// Rows.
    pub rows: u64,
    /// Rows and ghosts.
    pub length: u64,
    /// Entries.
    pub entries: u64,
}

/// The propagator's arrays on the fullest rank, in bytes.
pub fn arrays(case: &Case, bounds: &Bounds, mesh: &Mesh, sizes: &Sizes) -> Vec<(String, u64)> {
    let lanes = size_of::<Lanes>() as u64;
    let batch = format!("batch of {LANES} modes");
    match case.propagator.method {
        PropagatorMethod::Chebyshev => {
            let bytes = if case.varies() {
                crate::propagate::commutator_free::CommutatorFree::BYTES_PER_ROW
            } else {
                crate::propagate::chebyshev::Chebyshev::BYTES_PER_ROW
            };
            let order = Blocking::bytes_per_row(case.space.velocity_cells());
            vec![
                (batch, bytes as u64 * sizes.length),
                (
                    "order of the blocking".to_owned(),
                    (order * sizes.rows as f64) as u64,
                ),
            ]
        }
        PropagatorMethod::Krylov => {
            let vectors = crate::propagate::krylov::DIMENSION as u64 + 1;
            vec![
                (batch, lanes * sizes.rows),
                ("Krylov space".to_owned(), vectors * lanes * sizes.length),
            ]
        }
        PropagatorMethod::CrankNicolson | PropagatorMethod::BackwardEuler => {
            let vectors = crate::propagate::implicit::vectors(mesh.blocks() > 1) as u64;
            let bytes = crate::propagate::shifted::factor_bytes(case, bounds, mesh);
            vec![
                (batch, 2 * lanes * sizes.rows),
                (
                    "vectors of the solver".to_owned(),
                    vectors * 16 * sizes.length,
                ),
                (
                    "factors (estimated)".to_owned(),
                    60 * sizes.entries + (bytes * sizes.rows as f64) as u64,
                ),
            ]
        }
    }
}
