//! The Hamiltonian-preserving scheme: from a case to `f' = A f + b`, row by row (paper, section 4).
//!
//! [`rows`] is the only definition of `A` and `b`; it takes degrees above 0 from [`galerkin`]. The
//! matrix, its transpose, the oracles and the tests derive from it. [`interface`] holds the laws at
//! a jump of `V`. [`reduce`] leaves out the cells and axes that a case does not need.
//!
//! [`rows::Scheme`] is the main type, [`row::Row`] is one row.
//!
//! Uses: parallel, problem, base. Paper: sections 4, 5 and 6 (one, two and `n` space dimensions).

pub mod galerkin;
pub mod interface;
pub mod reduce;
pub mod row;
pub mod rows;
