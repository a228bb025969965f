//! The problem that a user states: case file, formulas, grid, potential, exact solution.
//!
//! [`case::Case`] is the case file, typed, with every default; [`grid::PhaseSpace`] is its grid.
//!
//! Uses: base. Paper: section 2 and the examples of section 8.

pub mod case;
pub mod element;
pub mod exact;
pub mod exported;
pub mod formula;
pub mod grid;
pub mod legs;
pub mod limits;
pub mod narrow_parts;
pub mod potential;
pub mod sample_box;
pub mod table;
