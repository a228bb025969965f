//! The library without MPI: the scheme against its definition, series, and random case files.

mod chebyshev;
mod fuzz_case;
mod plans;
mod scheme;
mod size;
mod staircase;

#[path = "../support/dense.rs"]
mod dense;
