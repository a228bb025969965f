//! The propagated system, its state, and a batch of modes.

use crate::base::fixed_point::FixedPoint;
use crate::matrix::block_matrix::BlockMatrix;
use crate::matrix::bounds::Bounds;
use crate::matrix::lanes::{LANES, Lanes};
use crate::parallel::communicator::{GhostExchange, Group};
use crate::parallel::partition::ProcessMesh;
use crate::problem::case::Case;
use crate::propagate::interruption::Interruption;

/// The system that is propagated: the matrix on this rank, the exchange of ghosts, the bounds.
pub struct Evolution<'a> {
    /// The rows of `(S, K)`.
    pub matrix: &'a BlockMatrix,
    /// Exchange of ghosts, for rows of [`Lanes`].
    pub exchange: &'a mut GhostExchange,
    /// The ranks that split space.
    pub space: &'a Group,
    /// Bounds of the spectrum.
    pub bounds: &'a Bounds,
    /// The time `T` to propagate over.
    pub time: f64,
    /// Space cells and auxiliary unknowns over the space group: terms of a norm.
    pub norm_terms: usize,
    /// Decides whether a batch is interrupted.
    pub interruption: Interruption,
}

impl Evolution<'_> {
    /// Sums of `term(row)` over all unknowns, by lane; the magnitudes of a lane's terms add up to
    /// at most `bounds[l]`. Terms are added over the velocities at each point of space, then
    /// exactly over space and ranks, so that the bits do not depend on the partition. Collective
    /// over the space group; allocates nothing.
    pub fn lane_sums(
        &self,
        bounds: &[f64; LANES],
        mut term: impl FnMut(usize) -> [f64; LANES],
    ) -> [f64; LANES] {
        let fixed = bounds.map(|bound| FixedPoint::new(2.0 * bound, self.norm_terms));
        let sums = self.matrix.pieces().map(|rows| {
            let mut sums = [0.0; LANES];
            for i in rows {
                let term = term(i);
                for l in 0..LANES {
                    sums[l] += term[l];
                }
            }
            sums
        });
        self.space.fixed_sums(fixed, sums)
    }

    /// Norms of the lanes of `state`, whose squares are at most `squares`. Collective over the
    /// space group; allocates nothing.
    pub fn lane_norms(&self, squares: &[f64; LANES], state: &[Lanes]) -> [f64; LANES] {
        let square = |i: usize| {
            let Lanes(w) = &state[i];
            std::array::from_fn(|l| w[l] * w[l] + w[LANES + l] * w[LANES + l])
        };
        self.lane_sums(squares, square).map(f64::sqrt)
    }
}

/// This rank's rows of the state that is propagated.
#[derive(Clone, Copy)]
pub enum StateRows<'a> {
    /// A real vector, the same in every mode.
    Real(&'a [f64]),
    /// A complex vector for each mode.
    Lanes(&'a [Lanes]),
}

impl StateRows<'_> {
    /// Row `i` of every lane.
    pub fn row(&self, i: usize) -> Lanes {
        match self {
            StateRows::Real(state) => {
                let mut row = Lanes::ZERO;
                row.0[..LANES].fill(state[i]);
                row
            }
            StateRows::Lanes(state) => state[i],
        }
    }
}

/// A state to propagate and the norms of its lanes.
#[derive(Clone, Copy)]
pub struct InitialState<'a> {
    /// The state.
    pub state: StateRows<'a>,
    /// Norm of each lane over all ranks of the space group, or a bound on it.
    pub norms: [f64; LANES],
}

impl<'a> InitialState<'a> {
    /// The real vector `state` of norm `norm` in every mode.
    pub fn real(state: &'a [f64], norm: f64) -> Self {
        Self { state: StateRows::Real(state), norms: [norm; LANES] }
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
    /// The planned work of each lane's mode: applications (Chebyshev: its degree), or steps of an
    /// implicit method, which are as many in every lane; unused lanes repeat the last.
    pub work: [usize; LANES],
}

impl BatchSpec {
    /// The largest work of a lane.
    pub fn largest_work(&self) -> usize {
        self.work.iter().copied().max().unwrap_or(0)
    }
}

/// The size of the series of a run.
#[derive(Clone, Copy, Debug)]
pub struct SeriesSize {
    /// The largest degree.
    pub largest_degree: usize,
    /// Planned applications to batches.
    pub applications: usize,
}

/// The part of the matrix on the fullest rank of a mesh.
#[derive(Clone, Copy)]
pub struct MatrixShare<'a> {
    /// The case.
    pub case: &'a Case,
    /// Bounds of its generator.
    pub bounds: &'a Bounds,
    /// The ranks.
    pub mesh: &'a ProcessMesh,
    /// Rows.
    pub rows: u64,
    /// Rows and ghosts.
    pub length: u64,
    /// Entries.
    pub entries: u64,
}
