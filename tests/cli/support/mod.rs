//! Common parts of the tests of the command line: cases, starting the program, checks, and reading
//! results.

pub mod python;

mod cases;
mod checks;
mod launch;
mod outcome;
mod refusal;
mod results;

pub use cases::*;
pub use checks::*;
pub use launch::Job;
pub use outcome::{Finished, Summary};
pub use refusal::*;
pub use results::*;
