//! The library without MPI: the scheme against its definition, series, and random case files.

mod chebyshev;
mod fuzz;
mod names;
mod plans;
mod scheme;
mod size;
mod staircase;

#[path = "../support/fuzz.rs"]
mod fuzzing;

#[path = "../support/dense.rs"]
mod dense;
