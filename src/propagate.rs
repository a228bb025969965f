//! Propagators: `w(T) = exp(−iH_l T) w(0)`, `H_l = μ_l S + iK`, for a batch of modes.

pub mod chebyshev;
pub mod commutator_free;

use crate::case::PropagatorMethod;
use crate::communicator::{GhostExchange, Group};
use crate::error::Result;
use crate::matrix::{BlockMatrix, LANES, Lanes};
use crate::plan::{Plan, WarpPlan};
use num_complex::Complex64;

/// What is propagated: the matrix on this rank, how its ranks exchange, and what is known of it.
pub struct Evolution<'a> {
    /// The rows of `(S, K)`.
    pub matrix: &'a BlockMatrix,
    /// Exchange of ghosts, for rows of [`Lanes`].
    pub exchange: &'a mut GhostExchange,
    /// The ranks that split space.
    pub space: &'a Group,
    /// Bound on `max |A_ii|`.
    pub rate: f64,
    /// Bound on `λ⁺`.
    pub growth: f64,
    /// `T`.
    pub time: f64,
    /// Space cells and auxiliary unknowns over the space group: terms of a norm.
    pub terms: usize,
}

/// A state to propagate and its norm.
#[derive(Clone, Copy)]
pub struct Initial<'a> {
    /// `ũ(0)`, this rank's rows; real.
    pub state: &'a [f64],
    /// `‖ũ(0)‖` over all ranks of the space group.
    pub norm: f64,
}

/// A batch to propagate: unused lanes repeat the last wavenumber.
#[derive(Clone, Debug)]
pub struct BatchSpec {
    /// `μ` by lane.
    pub wavenumbers: [f64; LANES],
    /// Degree of the Chebyshev series, common to the lanes.
    pub degree: usize,
}

/// What is known of a propagated batch.
#[derive(Clone, Copy, Debug)]
pub struct BatchReport {
    /// Factor of each lane that [`Propagator::state`] leaves out.
    pub phases: [Complex64; LANES],
    /// Bound on the relative error of each lane from cutting a series; the norm must not change by more, round-off aside.
    pub tails: [f64; LANES],
    /// Whether the method keeps the norm.
    pub unitary: bool,
    /// Applications a mode took.
    pub applications: usize,
}

/// A method that applies `exp(−iHT)` to the modes of a batch. Scratch is made once; propagating allocates nothing.
pub trait Propagator {
    /// Propagates `initial` in every lane. Collective over the space group.
    ///
    /// # Errors
    /// Where the method does not converge.
    fn propagate(
        &mut self,
        system: &mut Evolution<'_>,
        batch: &BatchSpec,
        initial: &Initial<'_>,
    ) -> Result<BatchReport>;

    /// `w(T)` of the batch that was propagated last, on this rank's rows, but for the lanes' phases.
    fn state(&self) -> &[Lanes];
}

/// The propagator of the plan, with its scratch.
pub fn propagator(plan: &Plan, warp: &WarpPlan, matrix: &BlockMatrix) -> Box<dyn Propagator> {
    match plan.propagator {
        PropagatorMethod::Chebyshev
        | PropagatorMethod::Krylov
        | PropagatorMethod::CrankNicolson
        | PropagatorMethod::BackwardEuler => {
            Box::new(chebyshev::Chebyshev::new(matrix, warp.largest_degree()))
        }
    }
}
