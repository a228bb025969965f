//! Studies: many trials of one case, to advise on a grid, to chart accuracy against cost, to find where methods
//! fail, and to calibrate the model of cost.
//!
//! Uses: run, results, and every room below.

pub mod advise;
pub mod calibrate;
pub mod chart;
pub mod stability;
