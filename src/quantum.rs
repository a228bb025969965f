//! The quantum side: what a quantum computer would be given, what it would take, and what could be read from it.
//!
//! | module | what it holds |
//! |---|---|
//! | [`access`] | the sparse-access oracles of `H = H1 ⊗ D_μ − H2 ⊗ I` (paper, section 3.2) |
//! | [`sparsity`] | nonzeros of rows and columns, measured against the paper's bounds |
//! | [`probability`] | with what probability a measurement gives the solution |
//! | [`optimise`] | the cheapest profile, recovery point and `δ` |
//! | [`export`] | states, `H` and circuits of a tiny case, for a simulator of quantum computers |
//! | [`readout`] | density, momentum and mean velocity as they would be measured |
//! | [`resources`] | queries, qubits, gates; records for other programs |
//!
//! Every number says what it is: see [`figure::Figure`].

pub mod access;
pub mod export;
pub mod figure;
pub mod optimise;
pub mod probability;
pub mod readout;
pub mod resources;
pub mod sparsity;
