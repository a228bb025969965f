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
//! ## Data flow and the map of modules
//!
//! ```text
//! case.toml → Case → Case, reduced → Plan → PhaseSpace + Partition → rows of A → (S, K) and weights → modes → recovery → HDF5
//! ```
//!
//! | module | what it holds |
//! |---|---|
//! | [`case`], [`expression`] | the case file, typed, with every default; formulas |
//! | [`grid`], [`potential`], [`scheme`] | cells; jumps and slopes of `V`; row `i` of `A` and `b`, the only definition of `A` |
//! | [`reduce`] | the case without what its scene does not need |
//! | [`plan`], [`profile`], [`recover`] | every derived number before anything is solved; `g(p)` as a Fourier series; reading `u` from it, by point, integral or least squares |
//! | [`partition`], [`communicator`], [`reproducible`] | who owns what; MPI; sums that do not depend on order |
//! | [`matrix`], [`weights`], [`problem`] | the distributed `(S, K)`; the norm in which `S ≤ 0`; all of it on a rank |
//! | [`propagate`], [`warp`], [`classical`] | `exp(−iH_l T)` by series, Lanczos, implicit steps; streamed and full runs, the transform in `p`; `f' = A f + b` directly, with slopes |
//! | [`varying`] | inflow that depends on time, in steps |
//! | [`characteristics`], [`observables`], [`spectrum`] | the exact solution, of measure-valued data too; moments, level sets; eigenvalues of `S` |
//! | [`quantum`] | oracles, sparsity, resources, readout of a quantum computer; circuits of tiny cases |
//! | [`advise`], [`grids`] | which grid and set-up reach an accuracy of the density; other grids over the same box |
//! | [`run`], [`compare`], [`output`], [`progress`], [`system`] | the driver; errors; files; what is said meanwhile; memory |
//! | [`pictures`], [`report`] | a finished run drawn, and as a page, from its files |
//! | [`checkpoint`] | what is finished, on disk: a run that was stopped goes on |
//! | [`stability`] | where methods fail: borders measured beside theory |
//! | [`figure`] | pictures as data, to SVG and PNG |
//! | [`chart`] | accuracy against cost, method by method |
//! | [`cli`], [`command`], [`error`] | the command line and what can go wrong |

#![deny(missing_docs)]

pub mod advise;
pub mod case;
mod case_file;
pub mod characteristics;
pub mod chart;
pub mod checkpoint;
pub mod classical;
pub mod cli;
pub mod command;
pub mod communicator;
pub mod compare;
pub mod error;
pub mod expression;
pub mod figure;
pub mod grid;
pub mod grids;
pub mod matrix;
pub mod observables;
pub mod output;
pub mod partition;
pub mod pictures;
pub mod plan;
pub mod potential;
pub mod problem;
pub mod profile;
pub mod progress;
pub mod propagate;
pub mod quantum;
pub mod recover;
pub mod reduce;
pub mod report;
pub mod reproducible;
pub mod run;
pub mod scheme;
pub mod spectrum;
pub mod stability;
pub mod system;
pub mod varying;
pub mod warp;
pub mod weights;
