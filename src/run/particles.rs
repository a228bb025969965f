//! Particles of the exact flow. They tell the ledger what leaves the box, and show errors of the
//! grid that the solution does not.
//!
//! They are drawn from the case's formulas ([`draw`]), also in parts that samples would miss
//! ([`crate::problem::narrow_parts`]), and followed ([`tracking`]). Where they arrive, `f` and the
//! masses are compared with the result ([`arrivals`]): by parts of space ([`space_parts`]), at
//! nodes where particles are few ([`drawn_nodes`]), and by random paths behind partial reflection
//! ([`random_paths`]). [`point_values`] evaluates the result between its nodes.

pub mod arrivals;
pub mod draw;
pub mod drawn_nodes;
pub mod point_values;
pub mod random_paths;
pub mod space_parts;
pub mod tracking;
