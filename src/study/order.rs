//! The order of convergence that errors on a sequence of grids show.

use serde::Serialize;

/// An error whose order in the width of the cells is below this does not count as falling.
const LEAST: f64 = 0.1;
/// Largest relative difference of the last two orders of a settled sequence.
const SPREAD: f64 = 0.15;

/// Orders that a scheme may have.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OrderRange {
    /// The order of a discontinuous solution; assumed if fewer than two errors are known.
    pub least: f64,
    /// The highest order that is trusted.
    pub most: f64,
}

/// The order in the elements' width that a sequence of errors shows, each grid twice as fine as the
/// one before.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Order {
    /// The order from each grid to the next.
    pub pairs: Vec<f64>,
    /// The mean of the last two orders.
    pub order: f64,
    /// The order that extrapolation uses: the lower of the last two orders. It is not below that of
    /// a discontinuous solution if the mean of the two is above that.
    pub counted_on: f64,
    /// Whether the last two agree within 15 %, and none of the last three is negative.
    pub settled: bool,
}

impl Order {
    /// The order of `errors` of a scheme with orders in `range`, coarsest grid first. Distances
    /// between consecutive grids have the same order and may stand for errors.
    pub fn of(errors: &[f64], range: OrderRange) -> Self {
        Self::of_steps(errors, &vec![1.0; errors.len().saturating_sub(1)], range)
    }

    /// The order of `errors` on grids each of which is `2^s` times as fine as the one before, with
    /// `s` from `steps`.
    pub fn of_steps(errors: &[f64], steps: &[f64], range: OrderRange) -> Self {
        let OrderRange { least, most } = range;
        let pairs = errors.windows(2).zip(steps);
        let pairs: Vec<f64> = pairs.map(|(pair, s)| (pair[0] / pair[1]).log2() / s).collect();
        let (mean, lower, settled) = match pairs[..] {
            [] => (least, least, false),
            // One pair does not show the next order.
            [only] => (only, only.min(1.0), false),
            [.., before, last] => (
                0.5 * (before + last),
                before.min(last),
                (before - last).abs() <= SPREAD * before.abs().max(last.abs()),
            ),
        };
        // An order is not settled while errors grow.
        let recent = &pairs[pairs.len().saturating_sub(3)..];
        let settled = settled && recent.iter().all(|&q| q >= 0.0);
        let known = |q: f64| {
            if q.is_finite() { q.min(most) } else { least }
        };
        let order = known(mean);
        // A single pair whose errors hardly fall does not show the order on finer grids.
        let counted_on = known(lower).max(order.min(least));
        Self { pairs, order, counted_on, settled: settled && mean.is_finite() }
    }

    /// Whether the errors fall.
    pub fn falls(&self) -> bool {
        self.order >= LEAST
    }

    /// Richardson's estimate of the error of a grid from its distance `d` to a grid twice as fine:
    /// `e − e 2^{−q} = d`.
    pub fn error(&self, distance: f64) -> f64 {
        distance / (1.0 - (-self.counted_on.max(LEAST)).exp2())
    }

    /// The factor by which a grid of error `error` must be refined to have the error `wanted`.
    pub fn refinement(&self, error: f64, wanted: f64) -> f64 {
        (error / wanted).powf(1.0 / self.counted_on.max(LEAST))
    }
}

/// Orders as text, to two digits.
pub fn orders_text(orders: &[f64]) -> String {
    let all: Vec<String> = orders.iter().map(|order| format!("{order:.2}")).collect();
    all.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    const FIRST: OrderRange = OrderRange { least: 0.5, most: 2.0 };

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
