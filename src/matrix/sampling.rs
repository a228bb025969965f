//! Formulas and exact solutions on a rank's cells, evaluated at many points at a time.
//!
//! For degree 0 the sample is the value at the centre of each cell. For higher degrees it is the
//! `L2` projection onto the polynomials of each element, by Gauss's rule; an element in which a
//! formula jumps is repeatedly cut into halves along every axis. On grids for which this takes too
//! long, elements with smooth data have nodal values.

use crate::base::error::Result;
use crate::matrix::elements::for_each_element;
use crate::matrix::projection::Projection;
use crate::parallel::communicator::Group;
use crate::parallel::partition::Block;
use crate::problem::element::MORE_POINTS;
use crate::problem::formula::Expression;
use crate::problem::grid::{Cell, MAX_DIMENSION, PhaseSpace, describe_point};
use std::ops::Range;

/// Largest number of quadrature points for a whole grid. Beyond it, elements with smooth data use
/// nodal values.
const MOST_POINTS: f64 = 4e7;
/// In two and three dimensions, elements may be cut as often as all together then have at most this
/// many points.
const MOST_CUT_POINTS: f64 = 1e8;
/// Largest number of successive cuts of an element at a jump, by space dimension.
const MOST_CUTS: [usize; MAX_DIMENSION] = [6, 2, 1];
/// Number of points that are evaluated together.
const BATCH: usize = 1024;

/// The cells of a block that a rank samples: whole elements.
#[derive(Clone)]
pub struct SampledCells<'a> {
    /// The block.
    pub block: &'a Block,
    /// Numbers of the sampled cells in the block.
    pub cells: Range<usize>,
    /// Space cells of the sample, one range an x-axis.
    pub ranges: &'a [Range<usize>],
}

impl<'a> SampledCells<'a> {
    /// All cells of `block`.
    pub fn whole(block: &'a Block) -> Self {
        Self { block, cells: 0..block.cells(), ranges: &block.ranges }
    }

    /// The values `values_at(points)` of a function, at `point` of each cell.
    fn at_cells(
        &self,
        space: &PhaseSpace,
        point: impl Fn(&Cell) -> [f64; 6],
        mut values_at: impl FnMut(&[[f64; 6]]) -> Vec<f64>,
    ) -> Vec<f64> {
        let mut values = Vec::with_capacity(self.cells.len());
        let mut points = Vec::with_capacity(BATCH);
        self.block.for_each_own(|global, local| {
            for v in 0..self.block.velocity_cells {
                if self.cells.contains(&(local + v)) {
                    points.push(point(&space.cell(global + v)));
                }
                if points.len() == BATCH {
                    values.extend(values_at(&points));
                    points.clear();
                }
            }
        });
        values.extend(values_at(&points));
        values
    }
}

/// The values `values_at(points)` of a function at the centres of the cells of `part`. A centre on
/// a face is moved just inside its element.
pub fn sample_with(
    space: &PhaseSpace,
    part: &SampledCells<'_>,
    values_at: impl FnMut(&[[f64; 6]]) -> Vec<f64>,
) -> Vec<f64> {
    part.at_cells(space, |cell| space.inner_point(cell), values_at)
}

/// A formula on the cells of `part`. Collective over `world`, for its largest value.
///
/// # Errors
/// [`crate::base::error::Error::Formula`] if it is not finite, on the rank that finds it.
pub fn sample(
    world: &Group,
    space: &PhaseSpace,
    part: &SampledCells<'_>,
    formula: &Expression,
    time: f64,
) -> Result<Vec<f64>> {
    let mut failure = None;
    let mut checked = |points: &[[f64; 6]]| {
        let values = formula.at_points(points, time);
        let undefined = values.iter().zip(points).find(|(value, _)| !value.is_finite());
        if let (Some((value, point)), None) = (undefined, &failure) {
            failure = Some(formula.undefined(*value, describe_point(space.dimension(), point)));
        }
        values
    };
    let values = match space.whole_degree() {
        0 => part.at_cells(space, |cell| space.point(cell), &mut checked),
        _ => projected(world, space, part, &mut checked),
    };
    failure.map_or(Ok(values), Err)
}

/// The `L2` projection of a function with `values_at(points)` on the cells of `part`. Collective
/// over `world`.
fn projected(
    world: &Group,
    space: &PhaseSpace,
    part: &SampledCells<'_>,
    values_at: &mut impl FnMut(&[[f64; 6]]) -> Vec<f64>,
) -> Vec<f64> {
    let nodal = sample_with(space, part, |points| values_at(points));
    let finite = nodal.iter().filter(|f| f.is_finite());
    let largest = world.max(finite.fold(0.0, |most, f| most.max(f.abs())));
    let mut values = vec![0.0; nodal.len()];
    let points: f64 =
        space.axes().map(|a| (a.elements() * (a.nodes.count() + MORE_POINTS)) as f64).product();
    let always = points <= MOST_POINTS;
    let cuts = most_cuts(space.dimension(), points);
    let projection = Projection::new(space, cuts, largest);
    for_each_element(space, part.ranges, |element| {
        let mut at_nodes = element.nodal(part.ranges, &nodal);
        if always || projection.is_rough(&at_nodes) {
            at_nodes = projection.onto(element, values_at);
        }
        element.for_each_cell(part.ranges, |cell, node| values[cell] = at_nodes[node]);
    });
    values
}

/// Largest number of successive cuts of an element, on a grid whose rules have `points` points in
/// all.
fn most_cuts(dimension: usize, points: f64) -> usize {
    let most = MOST_CUTS[dimension - 1];
    let after = |cuts: usize| points * f64::powi(4.0, (dimension * cuts) as i32);
    let few = |cuts: &usize| dimension == 1 || after(*cuts) <= MOST_CUT_POINTS;
    (0..=most).rev().find(few).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parallel::partition::ProcessMesh;
    use crate::problem::element::Nodes;
    use crate::problem::grid::Axis;

    /// A node on a face has the value on its own side of a jump there.
    #[test]
    fn nodes_on_faces_are_sampled_inside_of_their_elements() {
        let space = PhaseSpace {
            x: vec![Axis::new(-1.0, 1.0, 2).with_nodes(Nodes::of_space(2))],
            v: vec![Axis::new(-1.0, 1.0, 1)],
            periodic: [false; MAX_DIMENSION],
        };
        let block = Block::new(&space, &ProcessMesh { space: vec![1], groups: 1 }, 0);
        let step = |points: &[[f64; 6]]| -> Vec<f64> {
            points.iter().map(|point| if point[0] < 0.0 { 0.0 } else { 1.0 }).collect()
        };
        let values = sample_with(&space, &SampledCells::whole(&block), step);
        assert_eq!(values, [0.0, 0.0, 0.0, 1.0, 1.0, 1.0]);
    }
}
