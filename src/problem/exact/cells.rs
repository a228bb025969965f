//! `V` as particles see it: quadratic along each axis in a cell, with jumps at faces.

use crate::base::error::Result;
use crate::base::row_major::number;
use crate::problem::case::Case;
use crate::problem::exact::motion::CellForce;
use crate::problem::grid::{MAX_DIMENSION, PhaseSpace};
use crate::problem::potential::{Potential, curvatures};

/// Jumps, slopes and curvatures of `V` on the cells of `space`.
///
/// In a cell `∂V/∂x_a = slope + curvature (x_a − centre)` along each axis: `V` between two opposite
/// faces is the parabola through its values there and at the centre. Products of coordinates are
/// left out.
#[derive(Clone, Debug)]
pub(super) struct TracedPotential {
    /// The cells, of degree 0.
    pub space: PhaseSpace,
    /// Jumps, and slopes at the centres of cells.
    pub linear: Potential,
    /// By cell and axis; empty where `V` is linear in all cells.
    curvatures: Vec<[f64; MAX_DIMENSION]>,
}

impl TracedPotential {
    /// The potential of `case` on `space`, whose cells are parts of the case's elements; linear in
    /// each unless `is_bent`.
    ///
    /// # Errors
    /// [`Error::Formula`](crate::base::error::Error::Formula) where `V` is not finite.
    pub fn new(case: &Case, space: PhaseSpace, is_bent: bool) -> Result<Self> {
        let case = Case { space, ..case.clone() };
        let linear = Potential::whole(&case)?;
        let mut curvatures = if is_bent { curvatures(&case)? } else { Vec::new() };
        if curvatures.iter().all(|along| *along == [0.0; MAX_DIMENSION]) {
            curvatures = Vec::new();
        }
        Ok(Self { space: case.space, linear, curvatures })
    }

    /// The curvatures along all axes in a cell.
    pub fn curvatures(&self, cell: &[usize; MAX_DIMENSION]) -> [f64; MAX_DIMENSION] {
        let at = || number(self.space.x.iter().map(|axis| axis.cells), *cell);
        if self.curvatures.is_empty() { [0.0; MAX_DIMENSION] } else { self.curvatures[at()] }
    }

    /// `∂V/∂x_a` along `axis` in a cell.
    pub fn force(&self, cell: &[usize; MAX_DIMENSION], axis: usize) -> CellForce {
        CellForce {
            centre: self.space.x[axis].centre(cell[axis] as i64),
            slope: self.linear.slope(cell, axis),
            curvature: self.curvatures(cell)[axis],
        }
    }

    /// Largest `|∂V/∂x_a|` along `axis`, or a little more.
    pub fn steepest(&self, axis: usize) -> f64 {
        let bent = self.curvatures.iter().fold(0.0f64, |most, along| most.max(along[axis].abs()));
        self.linear.steepest(axis) + 0.5 * bent * self.space.x[axis].width()
    }

    /// Whether `V` is constant in a cell, and does not jump at its faces.
    pub fn is_free(&self, cell: &[usize; MAX_DIMENSION]) -> bool {
        (0..self.space.dimension()).all(|a| {
            self.linear.slope(cell, a) == 0.0
                && self.linear.jump_below(cell, a) == 0.0
                && self.linear.jump_above(cell, a) == 0.0
        }) && self.curvatures(cell) == [0.0; MAX_DIMENSION]
    }
}
