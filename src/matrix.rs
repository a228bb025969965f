//! The distributed matrix pair `(S, K)`, `S = (A+Aᵀ)/2`, `K = (A−Aᵀ)/2`, its bounds, weights and
//! observables.
//!
//! [`block_matrix::BlockMatrix`] holds the rows of one rank; [`kernel`] and [`blocking`] apply them
//! to a batch of modes; [`embedding`] adds the unknowns of the inflow; [`weights`] define the norm
//! in which `S ≤ 0`; [`bounds::Bounds`] are guaranteed bounds of the spectrum; [`observables`] are
//! moments.
//!
//! Uses: scheme, parallel, problem, base. Paper: section 3.1 (`H1 = S`, `iH2 = K`).

pub mod assembly;
pub mod block_matrix;
pub mod blocking;
pub mod bounds;
mod bundles;
pub mod element_faces;
pub mod elements;
pub mod embedding;
mod equal_rows;
pub mod inflow;
pub mod instruction_set;
pub mod kernel;
pub mod lanes;
pub mod line_bounds;
pub mod observables;
mod potential_scan;
pub mod projection;
mod row_lines;
pub mod rows;
pub mod sampling;
pub mod terms;
pub mod vector;
mod velocity_lines;
pub mod weights;
