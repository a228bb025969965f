//! Tests of the library without MPI: the scheme against its definition, plans and series, random
//! case files, and the structure of the sources.

mod chebyshev;
mod dependencies;
mod fuzz;
mod layers;
mod names;
mod plans;
mod scheme;
mod size;
mod unsafe_blocks;

#[path = "../support/fuzz.rs"]
mod fuzzing;

#[path = "../support/dense.rs"]
mod dense;
