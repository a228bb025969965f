//! Formulas and exact solutions on a rank's cells.
//!
//! Of degree 0, the value at the centre of each cell. Of a higher degree, the `L2` projection onto
//! the polynomials of each element, by Gauss's rule; an element in which a formula jumps is cut
//! into halves along every axis, again and again, where it does. On grids so large that this would
//! take too long, elements that look smooth have the values at their nodes.

use crate::base::error::Result;
use crate::matrix::elements::for_each_element;
use crate::matrix::projection::Projection;
use crate::parallel::communicator::Group;
use crate::parallel::partition::Block;
use crate::problem::element::MORE_POINTS;
use crate::problem::formula::Expression;
use crate::problem::grid::{MAX_DIMENSION, PhaseSpace, describe_point};
use std::ops::Range;

/// Points of a rule for a whole grid at most; beyond, elements that look smooth have nodal values.
const MOST_POINTS: f64 = 4e7;
/// Points beyond which nothing is cut once more in two and three dimensions, if all were.
const MOST_CUT_POINTS: f64 = 1e8;
/// How often an element is cut where a formula jumps, by space dimension.
const MOST_CUTS: [usize; MAX_DIMENSION] = [6, 2, 1];
/// `value` at the centres of the block's cells `cells`, of those on a face just inside.
pub fn sample_with(
    space: &PhaseSpace,
    block: &Block,
    cells: &Range<usize>,
    mut value: impl FnMut(&[f64; 6]) -> f64,
) -> Vec<f64> {
    let mut values = Vec::with_capacity(cells.len());
    block.for_each_own(|global, local| {
        for v in 0..block.velocity_cells {
            if cells.contains(&(local + v)) {
                values.push(value(&space.inner_point(&space.cell(global + v))));
            }
        }
    });
    values
}

/// A formula on this rank's cells. Collective over `world` (the largest value).
///
/// # Errors
/// [`crate::base::error::Error::Formula`] where it is not finite, on the rank that finds it.
pub fn sample(
    world: &Group,
    space: &PhaseSpace,
    block: &Block,
    formula: &Expression,
    time: f64,
) -> Result<Vec<f64>> {
    let mut failure = None;
    let mut checked = |point: &[f64; 6]| {
        let value = formula.at_point(point, time);
        if !value.is_finite() && failure.is_none() {
            failure = Some(formula.undefined(value, describe_point(space.dimension(), point)));
        }
        value
    };
    let values = match space.degree() {
        0 => {
            let mut values = Vec::with_capacity(block.cells());
            block.for_each_own(|global, _| {
                for v in 0..block.velocity_cells {
                    values.push(checked(&space.point(&space.cell(global + v))));
                }
            });
            values
        }
        _ => projected(world, space, block, &mut checked),
    };
    match failure {
        Some(error) => Err(error),
        None => Ok(values),
    }
}

/// The `L2` projection of `value` on this rank's cells. Collective over `world`.
fn projected(
    world: &Group,
    space: &PhaseSpace,
    block: &Block,
    value: &mut impl FnMut(&[f64; 6]) -> f64,
) -> Vec<f64> {
    let nodal = sample_with(space, block, &(0..block.cells()), |point| value(point));
    let finite = nodal.iter().filter(|f| f.is_finite());
    let largest = world.max(finite.fold(0.0, |most, f| most.max(f.abs())));
    let mut values = vec![0.0; block.cells()];
    let points: f64 =
        space.axes().map(|a| (a.elements() * (a.nodes.count() + MORE_POINTS)) as f64).product();
    let always = points <= MOST_POINTS;
    let cuts = most_cuts(space.dimension(), points);
    let projection = Projection::new(space, cuts, largest);
    for_each_element(space, &block.ranges, |element| {
        let mut at_nodes = vec![0.0; element.shape().iter().product()];
        element.for_each_cell(&block.ranges, |cell, node| at_nodes[node] = nodal[cell]);
        if always || projection.is_rough(&at_nodes) {
            at_nodes = projection.onto(element, value);
        }
        element.for_each_cell(&block.ranges, |cell, node| values[cell] = at_nodes[node]);
    });
    values
}

/// How often an element of a grid may be cut whose rules have `points` points in all.
fn most_cuts(dimension: usize, points: f64) -> usize {
    let most = MOST_CUTS[dimension - 1];
    let after = |cuts: usize| points * f64::powi(4.0, (dimension * cuts) as i32);
    let few = |cuts: &usize| dimension == 1 || after(*cuts) <= MOST_CUT_POINTS;
    (0..=most).rev().find(few).unwrap_or(0)
}
