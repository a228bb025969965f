//! Common parts of the interface laws: sources of a flux, and the velocity lattice.

use crate::problem::grid::Axis;
use std::fmt::Debug;

/// The side of a face on which a source lies, seen from the cell that is updated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SourceSide {
    /// The neighbouring cell: transmission.
    Across,
    /// The cell itself: reflection.
    Same,
}

/// A share of the flux: velocity cell `velocity` (possibly off the grid) on `side`, with `weight`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FluxSource {
    /// Side of the face.
    pub side: SourceSide,
    /// Index along the velocity axis; outside `0..cells` it is a ghost, filled by the inflow.
    pub velocity: i64,
    /// Weight of the source, in (0, 1].
    pub weight: f64,
}

/// A law of transmission and reflection where the potential jumps; one file each.
pub trait InterfaceLaw: Debug + Sync {
    /// Appends the sources of velocity cell `j`, `ξ_j ≠ 0`, behind a face where the potential
    /// rises by `rise ≠ 0` from the source side to the target side:
    /// `f(x⁺, ξ_j) = Σ weight · f(source)`. The kinetic energy on the source side is
    /// `ξ²/2 + rise`. Weights are positive and sum to 1.
    fn sources(&self, out: &mut Vec<FluxSource>, axis: &Axis, j: i64, rise: f64);

    /// Whether column sums of `A` may be positive next to a jump, so that the l2 norm may grow
    /// unless it is weighted (see [`crate::matrix::weights`]).
    fn may_grow(&self) -> bool;
}

/// Velocities closer to zero than this fraction of a cell do not move.
const STANDING: f64 = 1e-9;

/// Cells further off the grid than this, behind very high walls, are treated as one cell: their
/// numbers stay exact.
pub(super) const FARTHEST: f64 = 1e15;

/// The centre of velocity cell `j`, exactly zero where it is zero but for round-off.
pub fn velocity(axis: &Axis, j: i64) -> f64 {
    let v = axis.centre(j);
    if v.abs() < STANDING * axis.width() { 0.0 } else { v }
}
