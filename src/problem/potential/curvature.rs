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

/// A parabola that leaves the range of `V` in its cell by more than this part of the range does not
/// approximate `V`. A `V` that is a parabola leaves the range of five equidistant values by at most
/// 0.042 of it.
const OVERSHOOT: f64 = 0.05;

/// `∂²V/∂x_a²` by axis, for each space cell of a case of degree 0: of the parabola through `V` at
/// the centre of the cell and of its two faces across the axis. It is 0 where `V` jumps in the
/// cell, or is as steep as if it did: there the parabola would have a barrier or a well of its own
/// beside the step.
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
            let faces = [0, 1].map(|side| axis.face(i[a] as i64 + side));
            let mut at = |x: f64| {
                let mut point = centre;
                point[a] = x;
                values.value(piece, &point)
            };
            let [lower, upper] = faces.map(&mut at);
            let second = lower - 2.0 * middle + upper;
            let scale = lower.abs().max(middle.abs()).max(upper.abs());
            if second.abs() <= STRAIGHT * scale {
                continue;
            }
            let quarters = faces.map(|face| 0.5 * (face + centre[a]));
            if !overshoots([lower, middle, upper], || quarters.map(&mut at)) {
                along[a] = 4.0 * second / (axis.width() * axis.width());
            }
        }
        curvatures.push(along);
    });
    values.failure.map_or(Ok(curvatures), Err)
}

/// Whether the parabola through three equidistant values leaves their range, and that of the values
/// at the `quarters` between them, by more than [`OVERSHOOT`] of it.
fn overshoots([lower, middle, upper]: [f64; 3], quarters: impl FnOnce() -> [f64; 2]) -> bool {
    let (second, slope) = (lower - 2.0 * middle + upper, 0.5 * (upper - lower));
    // The extremum, in half widths from the centre.
    let turn = -slope / second;
    if turn.abs() >= 1.0 {
        return false;
    }
    let extremum = middle + 0.5 * slope * turn;
    let beyond = |values: &[f64]| {
        let least = values.iter().copied().fold(f64::INFINITY, f64::min);
        let most = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        (least - extremum).max(extremum - most) > OVERSHOOT * (most - least)
    };
    let three = [lower, middle, upper];
    beyond(&three) && beyond(&[&three[..], &quarters()].concat())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Parabolas and kinks keep their parabola wherever they turn; steps have none.
    #[test]
    fn only_steps_are_overshot() {
        let overshot =
            |v: &dyn Fn(f64) -> f64| overshoots([-1.0, 0.0, 1.0].map(v), || [-0.5, 0.5].map(v));
        for k in -200..=200 {
            let turn = f64::from(k) / 100.0;
            assert!(!overshot(&|x| (x - turn).powi(2)), "{turn}");
            assert!(!overshot(&|x| 3.0 - (x - turn).powi(2)), "{turn}");
            assert!(!overshot(&|x| (x - turn).abs()), "{turn}");
        }
        for place in [-1.0, -0.9, -0.3, 0.2, 0.7, 1.0] {
            for above in [true, false] {
                let is_above = |x: f64| if above { x >= place } else { x > place };
                let step = |x: f64| 2.0 + 0.5 * f64::from(u8::from(is_above(x)));
                let varies = step(-1.0) != step(1.0);
                assert!(!varies || overshot(&step), "{place} {above}");
            }
        }
        assert!(overshot(&|x| (30.0 * (x - 0.4)).tanh()));
    }
}
