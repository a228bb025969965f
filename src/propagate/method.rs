//! The interface of propagators.
//!
//! [`Propagator`] propagates batches of an [`Evolution`]; [`Descriptor`] has the properties that a
//! plan needs beforehand.

use crate::base::error::Result;
use crate::base::memory::NamedBytes;
use crate::matrix::block_matrix::BlockMatrix;
use crate::matrix::lanes::{LANES, Lanes};
use crate::problem::case::Propagation;
use crate::propagate::evolution::{BatchSpec, Evolution, InitialState, MatrixShare};
use crate::propagate::intermediate_moments::IntermediateMoments;
use num_complex::Complex64;

/// Statistics of a propagated batch.
#[derive(Clone, Copy, Debug)]
pub struct BatchReport {
    /// Factor of each lane that [`Propagator::state`] leaves out.
    pub phases: [Complex64; LANES],
    /// Bound on the relative error of each lane from cutting a series or a Krylov space, or from
    /// the residual of a solve; the norm must not change by more, except by round-off. It does not
    /// include the error of an implicit step.
    pub tails: [f64; LANES],
    /// Whether the method keeps the norm.
    pub unitary: bool,
    /// Applications of `(−iμS + K)`, over the modes of the batch: for a Chebyshev series, the terms
    /// of each mode's own series.
    pub applications: usize,
    /// Linear systems solved, over the modes of the batch.
    pub solves: usize,
}

impl BatchReport {
    /// The report of a method that keeps the norm, before anything is counted.
    pub(super) fn unitary(phases: [Complex64; LANES]) -> Self {
        Self { phases, tails: [0.0; LANES], unitary: true, applications: 0, solves: 0 }
    }
}

/// A method that applies `exp(−iHT)` to the modes of a batch. Scratch is made once; propagation
/// allocates nothing, except to factorise a mode's matrix.
pub trait Propagator {
    /// Propagates `initial` in every lane. Collective over the space group.
    ///
    /// # Errors
    /// If the method does not converge, on all ranks of the space group;
    /// [`Error::Interrupted`](crate::base::error::Error::Interrupted) if the batch is interrupted.
    fn propagate(
        &mut self,
        system: &mut Evolution<'_>,
        batch: &BatchSpec,
        initial: &InitialState<'_>,
    ) -> Result<BatchReport>;

    /// Propagates `initial`, and stores the moments at the times of `passed` in it. Collective over
    /// the space group.
    ///
    /// # Errors
    /// As [`propagate`](Self::propagate).
    ///
    /// # Panics
    /// If [`Descriptor::passes_times`] is false.
    fn propagate_past(
        &mut self,
        _system: &mut Evolution<'_>,
        _batch: &BatchSpec,
        _initial: &InitialState<'_>,
        _passed: &mut IntermediateMoments<'_>,
    ) -> Result<BatchReport> {
        panic!("this method stops at every output time");
    }

    /// `w(T)` of the batch that was propagated last, on this rank's rows, without the lanes'
    /// phases.
    fn state(&self) -> &[Lanes];

    /// Leading term of the time-step error of [`state`](Self::state); `None` if the method meets
    /// its tolerance by itself.
    fn step_error(&self) -> Option<&[Lanes]> {
        None
    }

    /// Bound on the norm of [`step_error`](Self::step_error) for wavenumbers up to `mu` and so many
    /// steps, relative to the norm of the initial state.
    fn largest_step_error(&self, _system: &Evolution<'_>, _mu: f64, _steps: usize) -> f64 {
        0.0
    }

    /// The power `q` of the time step with which that error falls.
    fn step_order(&self) -> i32 {
        0
    }
}

/// How the modes of a batch are coupled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BatchCoupling {
    /// Side by side in the lanes, each with the bits it would have alone: a batch takes as long as
    /// its longest mode.
    Independent,
    /// Side by side, with bits that depend on each other: batches are fixed blocks of neighbouring
    /// modes.
    Coupled,
    /// One after the other, each with the bits it would have alone: a batch takes as long as its
    /// modes together.
    Sequential,
}

impl BatchCoupling {
    /// The cost of a batch whose modes take these `works`; idle lanes count.
    pub fn cost(self, works: impl Iterator<Item = usize>) -> usize {
        match self {
            Self::Independent | Self::Coupled => LANES * works.max().unwrap_or(0),
            Self::Sequential => works.sum(),
        }
    }
}

/// The settings with which a propagator is made.
#[derive(Clone, Copy, Debug)]
pub struct PropagatorSetting {
    /// Method and time step.
    pub propagation: Propagation,
    /// Largest work of a mode, see [`Descriptor::work`].
    pub largest_work: usize,
    /// Applications to whole batches that a rank with modes does in a whole run, about; or solves.
    pub applications: usize,
    /// Whether the space is split between ranks.
    pub split: bool,
}

/// The accuracy and time of the propagation of one mode.
#[derive(Clone, Copy, Debug)]
pub struct ModeDemand {
    /// Half the length of the interval that holds the spectrum of `H`.
    pub half_width: f64,
    /// The time to propagate over.
    pub time: f64,
    /// Relative error allowed.
    pub tolerance: f64,
    /// Time step: of an implicit method, or the longest of a Krylov space.
    pub step: Option<f64>,
}

/// The work of the modes of a run.
#[derive(Clone, Copy, Debug)]
pub struct RunWork {
    /// Least work of a mode in a leg.
    pub least: usize,
    /// Largest work of a mode in a leg.
    pub most: usize,
    /// Time step of the case, if it gives one.
    pub step: Option<f64>,
    /// Steps of an implicit method.
    pub steps: usize,
    /// The time `T` to propagate over.
    pub time: f64,
}

/// The properties of a propagator that a plan needs before it is built.
pub trait Descriptor: Sync {
    /// How the modes of a batch are coupled.
    fn batch_coupling(&self) -> BatchCoupling;

    /// The work of a mode: applications of the matrix, or steps of an implicit method, each a
    /// solve.
    fn work(&self, demand: &ModeDemand, scratch: &mut Vec<f64>) -> usize;

    /// Applications that cost as much as a unit of [`work`](Self::work), about.
    fn applications_per_work(&self) -> usize;

    /// Factor on the time of a unit of work where space is split over ranks.
    fn cost_of_splitting(&self) -> f64 {
        1.0
    }

    /// Whether a leg may pass output times of moments.
    fn passes_times(&self) -> bool {
        false
    }

    /// The propagator's arrays and their bytes.
    fn arrays(&self, share: &MatrixShare<'_>) -> Vec<NamedBytes>;

    /// Bytes on this rank of what the propagator computes from `matrix` before it starts.
    ///
    /// # Errors
    /// As [`propagator`](Self::propagator).
    fn factor_bytes(&self, _matrix: &BlockMatrix) -> Result<u64> {
        Ok(0)
    }

    /// The method and its work as text.
    fn summary(&self, work: &RunWork) -> String;

    /// The propagator, with its scratch.
    ///
    /// # Errors
    /// Where the matrix of an implicit step cannot be analysed. Not collective.
    fn propagator(
        &self,
        setting: &PropagatorSetting,
        matrix: &BlockMatrix,
    ) -> Result<Box<dyn Propagator>>;
}
