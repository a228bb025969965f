//! `V` as particles see it: quadratic along each axis in a cell or given by a smooth formula, with
//! jumps at faces.

use crate::base::error::Result;
use crate::base::row_major::number;
use crate::problem::case::Case;
use crate::problem::exact::motion::CellForce;
use crate::problem::formula::Expression;
use crate::problem::grid::{MAX_DIMENSION, PhaseSpace, box_cells};
use crate::problem::potential::{KINK, Potential, curvatures, region, space_point};

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
    /// The formulas by which `V` is followed, if not by its parabolas.
    formulas: Option<CellFormulas>,
}

/// A place on a face, on the side of a cell.
pub(super) struct FacePlace<'a> {
    /// The cell.
    pub cell: &'a [usize; MAX_DIMENSION],
    /// The place. At the ends of a periodic axis, that of the side.
    pub x: &'a [f64; MAX_DIMENSION],
}

/// Smooth formulas of `V`.
#[derive(Clone, Debug)]
struct CellFormulas {
    /// By region.
    regions: Vec<Expression>,
    /// The region of each cell.
    of_cell: Vec<u32>,
    /// By how much `V` changes across a cell, by axis: a jump that is far smaller is round-off.
    changes: [f64; MAX_DIMENSION],
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
        Ok(Self { space: case.space, linear, curvatures, formulas: None })
    }

    /// This potential, which particles follow by the formulas of `case`. These must be smooth.
    pub fn by_formulas(self, case: &Case) -> Self {
        let axes = &self.space.x;
        let of_cell = |cell: [usize; MAX_DIMENSION]| {
            // An undefined condition was an error before.
            region(&case.potential, &space_point(axes, &cell)).unwrap_or(0) as u32
        };
        let formulas = CellFormulas {
            regions: case.potential.iter().map(|region| region.value.clone()).collect(),
            of_cell: box_cells(&self.space.space_ranges()).map(of_cell).collect(),
            changes: std::array::from_fn(|a| {
                axes.get(a).map_or(0.0, |axis| self.steepest(a) * axis.width())
            }),
        };
        Self { formulas: Some(formulas), ..self }
    }

    /// The number of a cell, row-major.
    fn number(&self, cell: &[usize; MAX_DIMENSION]) -> usize {
        number(self.space.x.iter().map(|axis| axis.cells), *cell)
    }

    /// The formula by which particles are followed in a cell; `None` if `V` is a sum of parabolas
    /// there.
    pub fn formula(&self, cell: &[usize; MAX_DIMENSION]) -> Option<&Expression> {
        let formulas = self.formulas.as_ref()?;
        let formula = &formulas.regions[formulas.of_cell[self.number(cell)] as usize];
        formula.constant().is_none().then_some(formula)
    }

    /// Whether `V` may jump somewhere on the lower face of a cell along `axis`: it jumps at the
    /// centre of the face, or the formulas on both sides are of different regions.
    pub fn may_jump_below(&self, cell: &[usize; MAX_DIMENSION], axis: usize) -> bool {
        let mut below = *cell;
        let beside = self.space.wrap(axis, cell[axis] as i64 - 1);
        let differ = |formulas: &CellFormulas| {
            beside.is_some_and(|j| {
                below[axis] = j;
                let [own, other] = [cell, &below].map(|cell| formulas.of_cell[self.number(cell)]);
                own != other
            })
        };
        self.linear.jump_below(cell, axis) != 0.0 || self.formulas.as_ref().is_some_and(differ)
    }

    /// `V` on the side `before` of a face across `axis` minus `V` on the side `behind` it, by their
    /// formulas; `None` without formulas.
    pub fn rise_by_formulas(
        &self,
        axis: usize,
        [before, behind]: [FacePlace<'_>; 2],
    ) -> Option<f64> {
        let formulas = self.formulas.as_ref()?;
        let regions = [&before, &behind].map(|side| formulas.of_cell[self.number(side.cell)]);
        if regions[0] == regions[1] && before.x == behind.x {
            return Some(0.0);
        }
        let value = |region: u32, side: FacePlace<'_>| {
            formulas.regions[region as usize].eval(&phase_point(side.x))
        };
        let (before, behind) = (value(regions[0], before), value(regions[1], behind));
        let scale = before.abs().max(behind.abs()).max(formulas.changes[axis]);
        let rise = before - behind;
        Some(if rise.abs() <= KINK * scale { 0.0 } else { rise })
    }

    /// `∂V/∂x_a` along `axis` at the place `x` of a cell.
    pub fn slope_at(
        &self,
        cell: &[usize; MAX_DIMENSION],
        axis: usize,
        x: &[f64; MAX_DIMENSION],
    ) -> f64 {
        match self.formula(cell) {
            Some(formula) => slopes(formula, x).map_or(0.0, |slopes| slopes[axis]),
            None => self.force(cell, axis).slope_at(x[axis]),
        }
    }

    /// The curvatures along all axes in a cell.
    pub fn curvatures(&self, cell: &[usize; MAX_DIMENSION]) -> [f64; MAX_DIMENSION] {
        let is_straight = self.curvatures.is_empty();
        if is_straight { [0.0; MAX_DIMENSION] } else { self.curvatures[self.number(cell)] }
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

    /// The number of the function that `V` is in a cell, if `V` does not jump at its faces: 0 if it
    /// is constant, and one for each formula. `None` if particles are to stop at the faces of the
    /// cell.
    pub fn function_number(&self, cell: &[usize; MAX_DIMENSION]) -> Option<u32> {
        let jumps = (0..self.space.dimension()).any(|a| {
            self.linear.jump_below(cell, a) != 0.0 || self.linear.jump_above(cell, a) != 0.0
        });
        if jumps {
            return None;
        }
        if let Some(formulas) = &self.formulas
            && self.formula(cell).is_some()
        {
            return Some(1 + formulas.of_cell[self.number(cell)]);
        }
        let is_level = *self.linear.slopes(cell) == [0.0; MAX_DIMENSION]
            && self.curvatures(cell) == [0.0; MAX_DIMENSION];
        is_level.then_some(0)
    }
}

/// The slopes of a smooth formula at a place; `None` where they are not finite.
pub(super) fn slopes(
    formula: &Expression,
    x: &[f64; MAX_DIMENSION],
) -> Option<[f64; MAX_DIMENSION]> {
    let [_, slopes @ ..] = formula.value_and_slopes(&phase_point(x));
    slopes.iter().all(|slope| slope.is_finite()).then_some(slopes)
}

/// The point of phase space at a place, as formulas of `V` take it.
fn phase_point(&[x, y, z]: &[f64; MAX_DIMENSION]) -> [f64; 6] {
    [x, y, z, 0.0, 0.0, 0.0]
}
