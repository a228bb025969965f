//! How errors fall from grid to grid, and where they will be.

use serde::Serialize;

/// An error that falls less than with this power of the cells' width does not fall.
pub const LEAST: f64 = 0.1;
/// Orders of one sequence that differ by a larger part are not settled.
const SPREAD: f64 = 0.15;

/// Orders that a scheme may have.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    /// That of a discontinuous solution: what is assumed where no two errors are known.
    pub least: f64,
    /// It is of no higher order for long.
    pub most: f64,
}

/// The order in the elements' width that a sequence of errors shows, each grid twice as fine as the
/// one before.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Order {
    /// From each grid to the next.
    pub pairs: Vec<f64>,
    /// The mean of the last two.
    pub order: f64,
    /// The lower of the last two, or that of a discontinuous solution where their mean is above it:
    /// what is counted on.
    pub counted_on: f64,
    /// Whether the last two agree within 15 %, and none of the last three is negative.
    pub settled: bool,
}

impl Order {
    /// That of `errors` of a scheme with orders in `range`, from the coarsest grid on, or of
    /// distances between consecutive grids.
    pub fn of(errors: &[f64], range: Range) -> Self {
        let Range { least, most } = range;
        let pairs: Vec<f64> = (errors.windows(2)).map(|pair| (pair[0] / pair[1]).log2()).collect();
        let (mean, lower, settled) = match pairs[..] {
            [] => (least, least, false),
            // What it may be next is not known.
            [only] => (only, only.min(1.0), false),
            [.., before, last] => (
                0.5 * (before + last),
                before.min(last),
                (before - last).abs() <= SPREAD * before.abs().max(last.abs()),
            ),
        };
        // Nor where errors grew just before.
        let recent = &pairs[pairs.len().saturating_sub(3)..];
        let settled = settled && recent.iter().all(|&q| q >= 0.0);
        let known = |q: f64| {
            if q.is_finite() { q.min(most) } else { least }
        };
        let order = known(mean);
        // A pair that hardly falls by itself says nothing of how those after it do.
        let counted_on = known(lower).max(order.min(least));
        Self { pairs, order, counted_on, settled: settled && mean.is_finite() }
    }

    /// Whether the errors fall.
    pub fn falls(&self) -> bool {
        self.order >= LEAST
    }

    /// The error of a grid from its distance to one twice as fine: `e − e 2^{−q} = d` (Richardson).
    pub fn error(&self, distance: f64) -> f64 {
        distance / (1.0 - (-self.counted_on.max(LEAST)).exp2())
    }

    /// How many times finer a grid must be than one whose error is `error`, for `wanted`.
    pub fn refinement(&self, error: f64, wanted: f64) -> f64 {
        (error / wanted).powf(1.0 / self.counted_on.max(LEAST))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FIRST: Range = Range { least: 0.5, most: 2.0 };

    #[test]
    fn powers_of_the_width_are_found_and_extrapolated() {
        for q in [0.5, 1.0, 1.7] {
            let error = |k: i32| 0.3 * (-q * f64::from(k)).exp2();
            let errors: Vec<f64> = (0..4).map(error).collect();
            let order = Order::of(&errors, FIRST);
            assert!((order.order - q).abs() < 1e-12 && order.settled);
            // Distances of consecutive grids show the same order, and their errors follow from it.
            let distances: Vec<f64> = errors.windows(2).map(|e| e[0] - e[1]).collect();
            let order = Order::of(&distances, FIRST);
            assert!((order.order - q).abs() < 1e-12);
            assert!((order.error(distances[1]) - errors[1]).abs() < 1e-12);
            assert!((order.refinement(errors[3], error(7)) - 16.0).abs() < 1e-9);
        }
    }

    #[test]
    fn an_order_that_jumps_is_not_settled_and_no_more_than_that_of_a_jump_counts() {
        let order = Order::of(&[1.0, 0.5, 0.45], FIRST);
        assert!(!order.settled && order.counted_on == 0.5 && order.order > 0.5);
        assert_eq!(Order::of(&[0.1], FIRST).order, 0.5);
        assert!(!Order::of(&[0.1], FIRST).settled);
        // A pair that did not fall is no reason to expect that none will.
        let uneven = Order::of(&[0.11, 0.12, 0.06], FIRST);
        assert!(uneven.falls() && !uneven.settled && uneven.counted_on == uneven.order);
        // Still climbing; and settled.
        let of_orders = |orders: &[f64]| {
            let mut errors = vec![1.0];
            for q in orders {
                errors.push(errors[errors.len() - 1] * (-q).exp2());
            }
            Order::of(&errors, FIRST)
        };
        assert!(!of_orders(&[-0.44, 0.43, 0.67, 0.79]).settled);
        assert!(!of_orders(&[-0.1, 0.7, 0.72]).settled);
        assert!(of_orders(&[-0.44, 0.6, 0.7, 0.75]).settled);
        let stuck = Order::of(&[0.06, 0.059, 0.0591], FIRST);
        assert!(!stuck.falls());
        // Exact on both: nothing to divide.
        assert_eq!(Order::of(&[0.0, 0.0], FIRST).order, 0.5);
    }
}
