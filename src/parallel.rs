//! The distribution of phase space and modes over the MPI ranks, and their communication.
//!
//! [`partition`] splits space blocks and mode groups; [`communicator::Communicator`] holds the
//! groups, the exchange of ghost layers, the transpose and votes; [`files`] opens HDF5 files on all
//! ranks.
//!
//! Uses: problem (the grid), base. Paper: none, the paper does not treat parallel emulation.

pub mod communicator;
mod deadline;
pub mod files;
mod ghost_exchange;
mod group;
pub mod partition;
mod world;
