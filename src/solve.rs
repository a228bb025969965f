//! A case solved on the ranks of a mesh: the discrete system, its modes in stages, checkpoints, the
//! spectrum.
//!
//! [`system::DiscreteSystem`] is the semi-discrete system on a rank; [`modes::run`] propagates the
//! modes and adds them up.
//!
//! Uses: plan, schrodingerization, propagate, matrix, scheme, parallel, problem, base. Paper:
//! sections 3.1 (the modes) and 7.1 (recovery).

mod batch;
pub mod checkpoint;
pub mod field_readings;
pub mod modes;
pub mod prepared;
pub mod rank_cells;
pub mod rank_modes;
pub mod resume;
pub mod snapshot;
pub mod spectrum;
pub mod stage;
pub mod start_field;
pub mod statistics;
pub mod sum;
pub mod system;
