//! Propagators: `w(T) = exp(−iH_l T) w(0)`, `H_l = μ_l S + iK`, for a batch of modes.
//!
//! | method | | error | takes |
//! |---|---|---|---|
//! | [`chebyshev`] | series of the exponential | below the mode's tolerance, guaranteed | applications |
//! | [`krylov`] | Lanczos, restarted in time | below the mode's tolerance, guaranteed | applications |
//! | [`implicit`] | Crank–Nicolson, backward Euler | second, first order in the step | steps, each a solve |

pub mod chebyshev;
pub mod commutator_free;
pub mod implicit;
pub mod krylov;
mod shifted;

use crate::case::{Case, Propagation, PropagatorMethod};
use crate::communicator::{GhostExchange, Group};
use crate::error::Result;
use crate::matrix::blocking::Blocking;
use crate::matrix::{BlockMatrix, LANES, Lanes};
use crate::partition::Mesh;
use crate::plan::{Bounds, Plan, WarpPlan};
use crate::reproducible::FixedPoint;
use chebyshev::Interval;
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
    /// Bound on `max |A_ii|`.
    pub rate: f64,
    /// Bound on `λ⁺`.
    pub growth: f64,
    /// `T`.
    pub time: f64,
    /// Space cells and auxiliary unknowns over the space group: terms of a norm.
    pub terms: usize,
}

impl Evolution<'_> {
    /// Sums of `term(row)` over all unknowns, by lane, where a sum's terms add up to no more than `bounds[l]` in magnitude:
    /// over the velocities at each point of space, then exactly over space and ranks, so that the bits do not depend on
    /// the partition. Collective over the space group; allocates nothing.
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

/// The rows that are always together on a rank: the velocities at each point of space, then each auxiliary unknown; one that
/// the ranks share on the first of them.
fn pieces(matrix: &BlockMatrix) -> impl Iterator<Item = Range<usize>> {
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
        Self {
            state: Start::Real(state),
            norms: [norm; LANES],
        }
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
    /// What the plan says each lane's mode takes: applications (Chebyshev: its degree), or steps of an implicit method, which are
    /// as many in every lane; unused lanes repeat the last.
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
    /// Bound on the relative error of each lane from cutting a series or a Krylov space, or from solving to a residual; the
    /// norm must not change by more, round-off aside. The error of an implicit step is not in it.
    pub tails: [f64; LANES],
    /// Whether the method keeps the norm.
    pub unitary: bool,
    /// Applications of `(−iμS + K)`, over the modes of the batch: for a Chebyshev series the terms of each mode's own, whatever
    /// the others take.
    pub applications: usize,
    /// Linear systems solved, over the modes of the batch.
    pub solves: usize,
}

/// A method that applies `exp(−iHT)` to the modes of a batch. Scratch is made once; propagating allocates nothing, but for
/// what factorising a mode's matrix takes.
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

    /// `w(T)` of the batch that was propagated last, on this rank's rows, but for the lanes' phases.
    fn state(&self) -> &[Lanes];

    /// Leading term of the error that the time step leaves in [`state`](Self::state); `None` where the method meets its
    /// tolerance by itself.
    fn step_error(&self) -> Option<&[Lanes]> {
        None
    }

    /// Bound on the norm of [`step_error`](Self::step_error) for wavenumbers up to `mu` and so many steps, beside that of the
    /// initial state.
    fn largest_step_error(&self, _system: &Evolution<'_>, _mu: f64, _steps: usize) -> f64 {
        0.0
    }
}

/// The propagator of the plan, with its scratch.
///
/// # Errors
/// Where the matrix of an implicit step cannot be analysed. Not collective.
pub fn propagator(
    plan: &Plan,
    warp: &WarpPlan,
    matrix: &BlockMatrix,
) -> Result<Box<dyn Propagator>> {
    Ok(match plan.propagation.method {
        PropagatorMethod::Chebyshev => {
            Box::new(chebyshev::Chebyshev::new(matrix, warp.largest_work()))
        }
        PropagatorMethod::Krylov => Box::new(krylov::Krylov::new(matrix, plan.propagation.step)),
        PropagatorMethod::CrankNicolson | PropagatorMethod::BackwardEuler => {
            let order = order(plan.propagation.method);
            let split = plan.layout.mesh.blocks() > 1;
            Box::new(implicit::Implicit::new(matrix, order, split)?)
        }
    })
}

/// How the modes of a batch go together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Company {
    /// Side by side in the lanes, each with the bits it would have alone: a batch takes as long as its longest mode.
    Independent,
    /// Side by side, and what one takes is seen in the bits of the others: batches are fixed blocks of neighbours.
    Coupled,
    /// One after the other, each with the bits it would have alone: a batch takes as long as its modes together.
    Sequential,
}

/// How the modes of a batch go together.
pub fn company(method: PropagatorMethod) -> Company {
    match method {
        PropagatorMethod::Chebyshev => Company::Independent,
        PropagatorMethod::Krylov => Company::Coupled,
        PropagatorMethod::CrankNicolson | PropagatorMethod::BackwardEuler => Company::Sequential,
    }
}

/// Order in the time step; 0 where the method meets a tolerance by itself.
pub fn order(method: PropagatorMethod) -> usize {
    match method {
        PropagatorMethod::Chebyshev | PropagatorMethod::Krylov => 0,
        PropagatorMethod::CrankNicolson => 2,
        PropagatorMethod::BackwardEuler => 1,
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
        Some(step) if order(propagation.method) > 0 => {
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
        PropagatorMethod::Chebyshev => chebyshev::degree(scratch, half_width * time, tolerance),
        PropagatorMethod::Krylov => {
            let longest = case.propagator.step.unwrap_or(time).min(time);
            krylov::applications(scratch, half_width, (time, longest), tolerance)
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
                commutator_free::CommutatorFree::BYTES_PER_ROW
            } else {
                chebyshev::Chebyshev::BYTES_PER_ROW
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
            let vectors = krylov::DIMENSION as u64 + 1;
            vec![
                (batch, lanes * sizes.rows),
                ("Krylov space".to_owned(), vectors * lanes * sizes.length),
            ]
        }
        PropagatorMethod::CrankNicolson | PropagatorMethod::BackwardEuler => {
            let vectors = implicit::vectors(mesh.blocks() > 1) as u64;
            let bytes = shifted::factor_bytes(case, bounds, mesh);
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
