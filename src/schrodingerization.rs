//! The warped phase transformation (paper, section 3): `g(p)` and its Fourier series, modes,
//! recovery.
//!
//! [`profile`] holds the functions `g` and their requirements on period, cut-off and recovery
//! point; [`warp_plan::WarpPlan`] is the series of a run; [`recovery`] reads `u(T)` from `v(T, p)`;
//! [`transform`] is the transform in `p`.
//!
//! [`placement`] finds period, cut-off and recovery points of a case. A profile is one file of
//! [`profile`].
//!
//! Uses: propagate, matrix, scheme, parallel, problem, base. Paper: sections 3.1 and 7.1
//! (recovery).

pub mod placement;
pub mod profile;
pub mod recovery;
#[cfg(test)]
mod test_support;
pub mod transform;
pub mod warp_plan;
