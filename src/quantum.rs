//! The quantum side: the input of a quantum computer, its resources, and what could be measured.
//!
//! | module | what it holds |
//! |---|---|
//! | [`access`] | the sparse-access oracles of `H = H1 ⊗ D_μ − H2 ⊗ I` (paper, section 3.2) |
//! | [`sparsity`] | nonzeros of rows and columns, measured against the paper's bounds |
//! | [`probability`] | with what probability a measurement gives the solution |
//! | [`measurement_window`] | where in `p` it does so, by the profile's series |
//! | [`cost`] | gates until the field is measured, of every access to `H` |
//! | [`optimise`] | the cheapest profile, recovery point and `δ` |
//! | [`schemes`] | the schemes that are taken on a quantum computer |
//! | [`circuit`] | the block encoding of `H` as gates, with their counts |
//! | [`export`] | states, `H` and circuits of a tiny case, for a quantum simulator |
//! | [`matrices`] | `A`, `b` and `(S, K)` as files, for any program of linear algebra |
//! | [`purpose`] | which cases each use of the quantum side refuses |
//! | [`phases`] | the rotations of `e^{−iτH}` by generalised quantum signal processing |
//! | [`synthesis`] | T gates of rotations, by a model |
//! | [`surface_code`] | physical qubits, under stated assumptions |
//! | [`walk`] | calls of the oracles, bits and registers of `e^{−iHT}` by the walk |
//! | [`readout`] | density, momentum and mean velocity as they would be measured |
//! | [`resources`] | queries, qubits, gates; records for other programs |
//!
//! Every number is labelled exact, emitted, bound, estimate, model or unavailable: see
//! [`labelled_number::LabelledNumber`].
//!
//! Uses: solve, and every module below. Paper: sections 3.2 (sparse access and cost) and 7
//! (recovery and readout), appendix on column sparsity.

use crate::base::error::{Error, Result};
use crate::plan::Plan;
use crate::schrodingerization::warp_plan::WarpPlan;

pub mod access;
pub mod circuit;
pub mod cost;
pub mod export;
pub mod labelled_number;
pub mod matrices;
pub mod measurement_window;
pub mod optimise;
pub mod phases;
pub mod probability;
pub mod purpose;
pub mod readout;
pub mod resources;
pub mod schemes;
pub mod sparsity;
pub mod surface_code;
pub mod synthesis;
#[cfg(test)]
mod test_support;
pub mod walk;

/// The modes that `plan` has for `case`.
///
/// # Errors
/// [`Error::Input`] for a plan of the classical method, which has none.
pub(crate) fn planned_modes<'a>(name: &str, plan: &'a Plan) -> Result<&'a WarpPlan> {
    let none = || Error::Input(format!("{name}: there is no plan of modes"));
    plan.warp.as_ref().ok_or_else(none)
}
