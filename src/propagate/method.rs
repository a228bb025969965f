//! The interface of propagators.
//!
//! [`Propagator`] propagates batches of an [`Evolution`]; [`Descriptor`] is what a plan needs to
//! know of it beforehand.

use crate::base::error::Result;
use crate::base::fixed_point::FixedPoint;
use crate::matrix::block_matrix::BlockMatrix;
use crate::matrix::bounds::Bounds;
use crate::matrix::lanes::{LANES, Lanes};
use crate::parallel::communicator::{GhostExchange, Group};
use crate::parallel::partition::Mesh;
use crate::problem::case::{Case, Propagation};
use crate::propagate::passed::PassedMoments;
use num_complex::Complex64;
use std::ops::Range;

/// What is propagated: the matrix on this rank, how its ranks exchange, and what is known of it.
pub struct Evolution<'a> {
    /// The rows of `(S, K)`.
    pub matrix: &'a BlockMatrix,
    /// Exchange of ghosts, for rows of [`Lanes`].
    pub exchange: &'a mut GhostExchange,
    /// The ranks that split space.
    pub space: &'a Group,
    /// Bounds of its spectrum.
    pub bounds: &'a Bounds,
    /// `T`.
    pub time: f64,
    /// Space cells and auxiliary unknowns over the space group: terms of a norm.
    pub terms: usize,
}

impl Evolution<'_> {
    /// Sums of `term(row)` over all unknowns, by lane, where a sum's terms add up to no more than
    /// `bounds[l]` in magnitude: over the velocities at each point of space, then exactly over
    /// space and ranks, so that the bits do not depend on the partition. Collective over the space
    /// group; allocates nothing.
    pub fn lane_sums(
        &self,
        bounds: &[f64; LANES],
        mut term: impl FnMut(usize) -> [f64; LANES],
    ) -> [f64; LANES] {
        let fixed = bounds.map(|bound| FixedPoint::new(2.0 * bound, self.terms));
        let mut totals = [0i64; 2 * LANES];
        for rows in pieces(self.matrix) {
            let mut sums = [0.0; LANES];
            for i in rows {
                let term = term(i);
                for l in 0..LANES {
                    sums[l] += term[l];
                }
            }
            for l in 0..LANES {
                let parts = fixed[l].split(sums[l]);
                totals[2 * l] += parts[0];
                totals[2 * l + 1] += parts[1];
            }
        }
        self.space.sum_integers(&mut totals);
        std::array::from_fn(|l| fixed[l].join([totals[2 * l], totals[2 * l + 1]]))
    }
}

/// The rows that are always together on a rank: the velocities at each point of space, then each
/// auxiliary unknown; one that the ranks share on the first of them.
pub(crate) fn pieces(matrix: &BlockMatrix) -> impl Iterator<Item = Range<usize>> {
    let (nv, cells) = (matrix.block.velocity_cells, matrix.block.cells());
    let points = (0..cells / nv).map(move |c| c * nv..(c + 1) * nv);
    points.chain((cells..matrix.counted_rows()).map(|i| i..i + 1))
}

/// This rank's rows of what is propagated.
#[derive(Clone, Copy)]
pub enum Start<'a> {
    /// A real vector, the same in every mode.
    Real(&'a [f64]),
    /// A complex vector a mode.
    Lanes(&'a [Lanes]),
}

impl Start<'_> {
    /// Row `i` of every lane.
    pub fn row(&self, i: usize) -> Lanes {
        match self {
            Start::Real(state) => {
                let mut row = Lanes::ZERO;
                row.0[..LANES].fill(state[i]);
                row
            }
            Start::Lanes(state) => state[i],
        }
    }
}

/// A state to propagate and the norms of its lanes.
#[derive(Clone, Copy)]
pub struct Initial<'a> {
    /// The state.
    pub state: Start<'a>,
    /// By lane, its norm over all ranks of the space group, or a bound on it.
    pub norms: [f64; LANES],
}

impl<'a> Initial<'a> {
    /// The real vector `state` of norm `norm` in every mode.
    pub fn real(state: &'a [f64], norm: f64) -> Self {
        Self { state: Start::Real(state), norms: [norm; LANES] }
    }
}

/// A batch to propagate.
#[derive(Clone, Debug)]
pub struct BatchSpec {
    /// Lanes in use.
    pub modes: usize,
    /// `μ` by lane; unused lanes repeat the last.
    pub wavenumbers: [f64; LANES],
    /// Relative error that each lane is allowed.
    pub tolerances: [f64; LANES],
    /// What the plan says each lane's mode takes: applications (Chebyshev: its degree), or steps of
    /// an implicit method, which are as many in every lane; unused lanes repeat the last.
    pub work: [usize; LANES],
}

impl BatchSpec {
    /// Most work of a lane.
    pub fn largest_work(&self) -> usize {
        self.work.iter().copied().max().unwrap_or(0)
    }
}

/// What is known of a propagated batch.
#[derive(Clone, Copy, Debug)]
pub struct BatchReport {
    /// Factor of each lane that [`Propagator::state`] leaves out.
    pub phases: [Complex64; LANES],
    /// Bound on the relative error of each lane from cutting a series or a Krylov space, or from
    /// solving to a residual; the norm must not change by more, round-off aside. The error of an
    /// implicit step is not in it.
    pub tails: [f64; LANES],
    /// Whether the method keeps the norm.
    pub unitary: bool,
    /// Applications of `(−iμS + K)`, over the modes of the batch: for a Chebyshev series the terms
    /// of each mode's own, whatever the others take.
    pub applications: usize,
    /// Linear systems solved, over the modes of the batch.
    pub solves: usize,
}

impl BatchReport {
    /// Of a method that keeps the norm, with nothing counted yet.
    pub(super) fn unitary(phases: [Complex64; LANES]) -> Self {
        Self { phases, tails: [0.0; LANES], unitary: true, applications: 0, solves: 0 }
    }
}

/// A method that applies `exp(−iHT)` to the modes of a batch. Scratch is made once; propagating
/// allocates nothing, but for what factorising a mode's matrix takes.
pub trait Propagator {
    /// Propagates `initial` in every lane. Collective over the space group.
    ///
    /// # Errors
    /// Where the method does not converge, on all ranks of the space group.
    fn propagate(
        &mut self,
        system: &mut Evolution<'_>,
        batch: &BatchSpec,
        initial: &Initial<'_>,
    ) -> Result<BatchReport>;

    /// The same, and the moments at the times that `passed` has been told, into it. Collective over
    /// the space group.
    ///
    /// # Errors
    /// As [`propagate`](Self::propagate).
    ///
    /// # Panics
    /// Where [`Descriptor::passes_times`] is not true.
    fn propagate_past(
        &mut self,
        _system: &mut Evolution<'_>,
        _batch: &BatchSpec,
        _initial: &Initial<'_>,
        _passed: &mut PassedMoments<'_>,
    ) -> Result<BatchReport> {
        panic!("this method stops at every output time");
    }

    /// `w(T)` of the batch that was propagated last, on this rank's rows, but for the lanes'
    /// phases.
    fn state(&self) -> &[Lanes];

    /// Leading term of the error that the time step leaves in [`state`](Self::state); `None` where
    /// the method meets its tolerance by itself.
    fn step_error(&self) -> Option<&[Lanes]> {
        None
    }

    /// Bound on the norm of [`step_error`](Self::step_error) for wavenumbers up to `mu` and so many
    /// steps, beside that of the initial state.
    fn largest_step_error(&self, _system: &Evolution<'_>, _mu: f64, _steps: usize) -> f64 {
        0.0
    }
}

/// How the modes of a batch are coupled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BatchCoupling {
    /// Side by side in the lanes, each with the bits it would have alone: a batch takes as long as
    /// its longest mode.
    Independent,
    /// Side by side, the bits of each depend on the others: batches are fixed blocks of neighbours.
    Coupled,
    /// One after the other, each with the bits it would have alone: a batch takes as long as its
    /// modes together.
    Sequential,
}

impl BatchCoupling {
    /// What a batch costs whose modes take these `works`: idle lanes count.
    pub fn cost(self, works: impl Iterator<Item = usize>) -> usize {
        match self {
            Self::Independent | Self::Coupled => LANES * works.max().unwrap_or(0),
            Self::Sequential => works.sum(),
        }
    }
}

/// What a propagator is made for.
#[derive(Clone, Copy, Debug)]
pub struct Setting {
    /// Method and time step.
    pub propagation: Propagation,
    /// The most that a mode takes: see [`Descriptor::work`].
    pub largest_work: usize,
    /// Whether the space is split between ranks.
    pub split: bool,
}

/// What is asked of the propagation of one mode.
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

/// What the modes of a run take.
#[derive(Clone, Copy, Debug)]
pub struct RunWork {
    /// Least work of a mode.
    pub least: usize,
    /// Most work of a mode.
    pub most: usize,
    /// Time step of the case, if it gives one.
    pub step: Option<f64>,
    /// Steps of an implicit method.
    pub steps: usize,
    /// `T`.
    pub time: f64,
}

/// The part of the matrix on the fullest rank of a mesh.
#[derive(Clone, Copy)]
pub struct MatrixShare<'a> {
    /// The case.
    pub case: &'a Case,
    /// Bounds of its generator.
    pub bounds: &'a Bounds,
    /// The ranks.
    pub mesh: &'a Mesh,
    /// Rows.
    pub rows: u64,
    /// Rows and ghosts.
    pub length: u64,
    /// Entries.
    pub entries: u64,
}

/// What a plan needs to know of a propagator before there is one.
pub trait Descriptor: Sync {
    /// How the modes of a batch are coupled.
    fn batch_coupling(&self) -> BatchCoupling;

    /// What a mode takes: applications of the matrix, or steps of an implicit method, each a solve.
    fn work(&self, demand: &ModeDemand, scratch: &mut Vec<f64>) -> usize;

    /// Applications that cost as much as a unit of [`work`](Self::work), about.
    fn applications_per_work(&self) -> usize;

    /// How many times longer a unit of work takes where space is split over ranks.
    fn cost_of_splitting(&self) -> f64 {
        1.0
    }

    /// Whether a leg may pass times at which moments are wanted.
    fn passes_times(&self) -> bool {
        false
    }

    /// The propagator's arrays and their bytes.
    fn arrays(&self, share: &MatrixShare<'_>) -> Vec<(String, u64)>;

    /// Method and work in words.
    fn summary(&self, work: &RunWork) -> String;

    /// The propagator, with its scratch.
    ///
    /// # Errors
    /// Where the matrix of an implicit step cannot be analysed. Not collective.
    fn propagator(&self, setting: &Setting, matrix: &BlockMatrix) -> Result<Box<dyn Propagator>>;
}
