//! Who owns which part of phase space, and how ranks exchange.
//!
//! [`partition`] splits space blocks and mode groups; [`communicator::Communicator`] holds the
//! groups, the exchange of ghost layers, the transpose and votes; [`files`] opens what all ranks
//! read.
//!
//! Uses: problem (the grid), base.

pub mod communicator;
pub mod files;
pub mod partition;
