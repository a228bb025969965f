//! # phasewarp
//!
//! An emulator, distributed over MPI ranks, of a quantum algorithm for the Liouville equation of classical mechanics
//!
//! ```text
//! f_t + v·∇_x f − ∇V·∇_v f = 0
//! ```
//!
//! with a potential `V` that may jump. Particles that meet a jump are transmitted or reflected so that `|v|²/2 + V` is
//! kept. The Hamiltonian-preserving scheme builds this into its fluxes and gives `f' = A f + b` ([`scheme`]). With
//! `S = (A+Aᵀ)/2`, `K = (A−Aᵀ)/2`, the warped phase transformation `w(t, p) = g(p) f(t)`, `g = e^{−p}` for `p ≥ 0`, turns it
//! into `w_t = −S w_p + K w`, whose Fourier modes in `p` evolve unitarily and do not couple:
//!
//! ```text
//! w_l(T) = exp(−iH_l T) f(0),   H_l = μ_l S + iK,      f(T) = e^{p◇} Σ_l weight_l e^{iμ_l p◇} w_l(T)
//! ```
//!
//! ## Data flow
//!
//! ```text
//! case.toml → Case → Case, reduced → Plan → PhaseSpace + Partition → rows of A → (S, K) and weights
//!           → modes → recovery → HDF5
//! ```
//!
//! ## The map: fourteen rooms in one staircase
//!
//! A room imports rooms below it only.
//!
//! | room | what it holds |
//! |---|---|
//! | [`command`] | the command line: one function a subcommand |
//! | [`study`] | many trials of a case: `advise`, `chart`, `stability`, `calibrate` |
//! | [`run`] | the driver of one run |
//! | [`results`] | result files, written, read back, drawn, reported |
//! | [`quantum`] | oracles, sparsity, resources, readout and circuits of a quantum computer |
//! | [`solve`] | the semi-discrete system on a rank, modes in stages, checkpoints, the spectrum |
//! | [`plan`] | every derived number before anything is solved: layout on ranks, memory, cost |
//! | [`schrodingerization`] | `g(p)` as a Fourier series, modes, recovery, the transform in `p` |
//! | [`propagate`] | `exp(−iH_l T)` by series, Lanczos, implicit steps; `f' = A f + b` directly |
//! | [`matrix`] | `(S, K)` by rows, kernels, bounds, weights, the inflow's unknowns, moments |
//! | [`scheme`] | rows of `A` and `b`, the only definition of `A`; what a scene does not need |
//! | [`parallel`] | blocks of space and groups of modes; ghost exchange, transpose |
//! | [`problem`] | the case file, formulas, the grid, the potential, the exact solution |
//! | [`base`] | errors, text, log lines, directories, the machine, fixed-point sums |

#![deny(missing_docs)]

pub mod base;
pub mod command;
pub mod matrix;
pub mod parallel;
pub mod plan;
pub mod problem;
pub mod propagate;
pub mod quantum;
pub mod results;
pub mod run;
pub mod scheme;
pub mod schrodingerization;
pub mod solve;
pub mod study;
