//! Common parts of the test programs: dense references of what the program computes, and a case
//! prepared as a run prepares it.
#![allow(dead_code)] // each test program uses a part of it

pub mod dense;
pub mod launcher;
pub mod limited;
pub mod prepared;
