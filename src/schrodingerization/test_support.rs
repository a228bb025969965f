//! Support for the tests of this module.

use crate::base::quadrature::QuadraturePoint;

/// Simpson's rule on `intervals` intervals, an even number, of `[lower, upper]`.
pub(crate) fn simpson(
    [lower, upper]: [f64; 2],
    intervals: u32,
) -> impl Iterator<Item = QuadraturePoint> {
    let width = (upper - lower) / f64::from(intervals);
    (0..=intervals).map(move |i| {
        let factor = match i {
            0 => 1.0,
            i if i == intervals => 1.0,
            i if i % 2 == 1 => 4.0,
            _ => 2.0,
        };
        QuadraturePoint { node: lower + width * f64::from(i), weight: factor * width / 3.0 }
    })
}
