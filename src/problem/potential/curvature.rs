//! The curvature of the potential within elements.

use crate::base::error::Result;
use crate::problem::case::Case;
use crate::problem::grid::{MAX_DIMENSION, for_each_cell};
use crate::problem::potential::pieces::{element_centre, space_point};
use crate::problem::potential::values::PotentialValues;

/// A second difference of `V` below this fraction of `V` is round-off.
const STRAIGHT: f64 = 16.0 * f64::EPSILON;

/// How `V` varies within the elements, up to round-off.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum ElementShape {
    /// It is linear.
    Linear,
    /// It is a sum of quadratic functions of one coordinate each.
    Quadratic,
    /// Neither.
    General,
}

/// `∂²V/∂x_a²` by axis, for each space cell of a case of degree 0: of the parabola through `V` at
/// the centre of the cell and of its two faces across the axis.
///
/// # Errors
/// [`Error::Formula`](crate::base::error::Error::Formula) where `V` is not finite.
pub fn curvatures(case: &Case) -> Result<Vec<[f64; MAX_DIMENSION]>> {
    let axes = &case.space.x;
    let mut values = PotentialValues { case, failure: None };
    let mut curvatures = Vec::with_capacity(case.space.space_cells());
    for_each_cell(&case.space.space_ranges(), |i| {
        let piece = values.piece(&element_centre(axes, i));
        let centre = space_point(axes, i);
        let middle = values.value(piece, &centre);
        let mut along = [0.0; MAX_DIMENSION];
        for (a, axis) in axes.iter().enumerate() {
            let [lower, upper] = [0, 1].map(|side| {
                let mut point = centre;
                point[a] = axis.face(i[a] as i64 + side);
                values.value(piece, &point)
            });
            let second = lower - 2.0 * middle + upper;
            let scale = lower.abs().max(middle.abs()).max(upper.abs());
            if second.abs() > STRAIGHT * scale {
                along[a] = 4.0 * second / (axis.width() * axis.width());
            }
        }
        curvatures.push(along);
    });
    values.failure.map_or(Ok(curvatures), Err)
}
