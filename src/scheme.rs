//! The Hamiltonian-preserving scheme: from a case to `f' = A f + b`, row by row (paper, section 4).
//!
//! [`rows`] is the only definition of `A` and `b`, of degree 0 there and of a higher degree in
//! [`galerkin`]; the matrix, its transpose, the oracles and the tests come from it. [`interface`]
//! holds what happens at a jump of `V`. [`reduce`] leaves out the cells and axes that a scene does
//! not need.
//!
//! Uses: parallel, problem, base.

pub mod galerkin;
pub mod interface;
pub mod reduce;
pub mod row;
pub mod rows;
