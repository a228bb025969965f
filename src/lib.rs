//! # phasewarp
//!
//! An emulator, distributed over MPI ranks, of a quantum algorithm for the Liouville equation of
//! classical mechanics
//!
//! ```text
//! f_t + v·∇_x f − ∇V·∇_v f = 0
//! ```
//!
//! with a potential `V` that may jump. Particles that meet a jump are transmitted or reflected so
//! that `|v|²/2 + V` is kept. The Hamiltonian-preserving scheme builds this into its fluxes and
//! gives `f' = A f + b` ([`scheme`]). With `S = (A+Aᵀ)/2`, `K = (A−Aᵀ)/2`, the warped phase
//! transformation `w(t, p) = g(p) f(t)`, with `g = e^{−p}` where the recovery reads from, turns it
//! into `w_t = −S w_p + K w`, whose Fourier modes in `p` evolve unitarily and do not couple:
//!
//! ```text
//! w_l(T) = exp(−iH_l T) f(0),   H_l = μ_l S + iK
//! f(T)   = e^{p◇} Σ_l weight_l e^{iμ_l p◇} w_l(T)
//! ```
//!
//! ## Data flow
//!
//! ```text
//! case.toml → Case → Case, reduced → Plan → PhaseSpace + Partition
//!           → rows of A → (S, K) and weights → modes → recovery → HDF5
//! ```
//!
//! ## The map: fourteen modules in layers
//!
//! A module imports modules below it only.
//!
//! | module | what it holds |
//! |---|---|
//! | `command` | the command line: one function a subcommand |
//! | `study` | many trials: advice, chart, stability, sweep, calibration, ranks, end to end |
//! | `run` | the driver of one run |
//! | `results` | result files, written, read back, drawn, reported |
//! | `quantum` | oracles, sparsity, resources, readout and circuits of a quantum computer |
//! | `solve` | the semi-discrete system on a rank, modes in stages, checkpoints, the spectrum |
//! | `plan` | every derived number before anything is solved: layout on ranks, memory, cost |
//! | `schrodingerization` | `g(p)` as a Fourier series, modes, recovery, the transform in `p` |
//! | `propagate` | `exp(−iH_l T)` by series, Lanczos, implicit steps; `f' = A f + b` directly |
//! | `matrix` | `(S, K)` by rows, kernels, bounds, weights, the inflow's unknowns, moments |
//! | `scheme` | rows of `A` and `b`, the only definition of `A`; the reduction of a case |
//! | `parallel` | blocks of space and groups of modes; ghost exchange, transpose |
//! | `problem` | the case file, formulas, the grid, the potential, the exact solution |
//! | `base` | errors, text, log lines, directories, the machine, fixed-point sums |
//!
//! ## As a library
//!
//! [`World`] starts MPI, [`Case`] is the problem, [`plan()`] predicts its cost as a [`Plan`],
//! [`solve`] gives a [`Solution`] (fields and [`Moments`] on a rank's share of the [`PhaseSpace`],
//! and a [`Summary`]), and [`run`] is what `phasewarp run` does. All are collective: every rank
//! calls them. Other modules are public for the tests only, and have no pages here.
//!
//! ```
//! use phasewarp::{Case, World, solve};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let text = r#"
//!     [[axis]]
//!     x = { lower = -1, upper = 1, cells = 16 }
//!     v = { lower = -1, upper = 1, cells = 16 }
//!     [[potential]]
//!     where = "x < 0"
//!     value = "0.2"
//!     [[potential]]
//!     value = "0"
//!     [initial]
//!     f = "exp(-20*((x+0.5)^2+(v-0.7)^2))"
//!     [time]
//!     end = 0.5
//!     [solver]
//!     tolerance = 1e-6
//!     verify = true
//! "#;
//! let world = World::start().ok_or("MPI was started before")?;
//! let case = Case::parse("step", text, &[])?;
//! let solution = solve(&world, &case)?;
//! assert!(solution.summary.error_semidiscrete.is_some_and(|error| error <= 1e-6));
//! assert_eq!(solution.results.fields[0].len(), 16 * 16);
//! # Ok(())
//! # }
//! ```

#![deny(missing_docs)]

pub use base::error::{Error, Result};
pub use matrix::observables::Moments;
pub use parallel::communicator::{Group, World};
pub use plan::Plan;
pub use plan::layout::Layout;
pub use problem::case::Case;
pub use problem::grid::{Axis, PhaseSpace};
pub use results::dataset::ExactSolution;
pub use results::summary::Summary;
pub use run::expand::ExpandedResults;
pub use run::options::Options;
pub use run::{Solution, run, solve};
pub use schrodingerization::warp_plan::WarpPlan;

/// The plan of a run of `case` on the ranks of `world`: modes, applications, memory per rank.
/// Growth and norms are measured if that is cheap. Collective.
///
/// # Errors
/// A tolerance that cannot be met, a mesh that does not fit, too little memory.
pub fn plan(world: &World, case: &Case) -> Result<Plan> {
    run::planning::plan(world, case, &plan::layout::Resources::here(world))
}

#[doc(hidden)]
pub mod base;
#[doc(hidden)]
pub mod command;
#[doc(hidden)]
pub mod matrix;
#[doc(hidden)]
pub mod parallel;
#[doc(hidden)]
pub mod plan;
#[doc(hidden)]
pub mod problem;
#[doc(hidden)]
pub mod propagate;
#[doc(hidden)]
pub mod quantum;
#[doc(hidden)]
pub mod results;
#[doc(hidden)]
pub mod run;
#[doc(hidden)]
pub mod scheme;
#[doc(hidden)]
pub mod schrodingerization;
#[doc(hidden)]
pub mod solve;
#[doc(hidden)]
pub mod study;
