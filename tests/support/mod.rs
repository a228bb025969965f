//! Common parts of the test crates: dense twins of what the program does, and a case as a run
//! prepares it.
#![allow(dead_code)] // each test crate uses its own part

pub mod dense;
pub mod limited;
pub mod prepared;
