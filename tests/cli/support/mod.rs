//! Common parts of the tests of the program: cases, jobs, checks, and reading of results.

pub mod python;

mod cases;
mod checks;
mod files;
mod launch;
mod outcome;
mod refusal;
mod results;
mod shared;

pub use cases::*;
pub use checks::*;
pub use files::*;
pub use launch::{Job, RankMesh};
pub use outcome::{Finished, Summary};
pub use refusal::*;
pub use results::*;

pub use crate::dense::{distance, parsed};
