//! `output.positive`: the scaling limiter of Zhang and Shu (J. Comput. Phys. 229, 2010) on the
//! field that is written.
//!
//! In an element with the average `f̄ ≥ 0` and the least nodal value `m < 0`, `f` becomes
//! `f̄ + θ (f − f̄)` with `θ = f̄/(f̄ − m)`: no node is below zero, and the average is kept. An
//! element whose average is negative becomes constant.

use crate::matrix::elements::for_each_element;
use crate::problem::grid::PhaseSpace;
use std::ops::Range;

/// Limits the field `f` on a rank's `share` of space, all velocities.
pub fn limit(space: &PhaseSpace, share: &[Range<usize>], f: &mut [f64]) {
    if f.is_empty() {
        return;
    }
    for_each_element(space, share, |element| {
        let (mut sum, mut volume, mut least) = (0.0, 0.0, f64::INFINITY);
        let weights = element.weights();
        element.for_each_cell(share, |cell, node| {
            sum += weights[node] * f[cell];
            volume += weights[node];
            least = least.min(f[cell]);
        });
        if least >= 0.0 {
            return;
        }
        let mean = sum / volume;
        let theta = (mean / (mean - least)).clamp(0.0, 1.0);
        element.for_each_cell(share, |cell, _| {
            let limited = mean + theta * (f[cell] - mean);
            // Round-off may leave a value just below zero.
            f[cell] = if mean >= 0.0 { limited.max(0.0) } else { limited };
        });
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::problem::element::Nodes;
    use crate::problem::grid::{Axis, MAX_DIMENSION};

    #[test]
    fn averages_are_kept_and_values_are_nonnegative() {
        let space = PhaseSpace {
            x: vec![Axis::new(0.0, 1.0, 3).with_nodes(Nodes::of_space(2))],
            v: vec![Axis::new(-1.0, 1.0, 2).with_nodes(Nodes::of_velocity(3))],
            periodic: [false; MAX_DIMENSION],
        };
        let weight = |cell: usize| space.relative_volume(&space.cell(cell));
        let before: Vec<f64> = (0..space.cells()).map(|j| (1.7 * j as f64).sin() + 0.4).collect();
        // The last two elements of x, like the share of one rank of several.
        let share = 3..space.x[0].cells;
        let skip = share.start * space.velocity_cells();
        let mut after = before.clone();
        limit(&space, &[share], &mut after[skip..]);
        assert_eq!(before[..skip], after[..skip]);
        assert!(before[skip..].iter().any(|f| *f < -0.1));
        for e in 1..3 {
            for d in 0..2 {
                let of = |values: &[f64]| -> f64 {
                    let inside = |c: &usize| {
                        let cell = space.cell(*c);
                        cell[0] / 3 == e && cell[1] / 4 == d
                    };
                    (0..space.cells()).filter(inside).map(|c| weight(c) * values[c]).sum()
                };
                let [old, new] = [of(&before), of(&after)];
                assert!((old - new).abs() < 1e-13, "{old} {new}");
                assert!(old > 0.0);
            }
        }
        assert!(after[skip..].iter().all(|f| *f >= 0.0));
    }

    #[test]
    fn a_negative_average_is_kept_as_a_constant() {
        let space = PhaseSpace {
            x: vec![Axis::new(0.0, 1.0, 1).with_nodes(Nodes::of_space(1))],
            v: vec![Axis::new(0.0, 1.0, 1)],
            periodic: [false; MAX_DIMENSION],
        };
        let mut f = vec![-3.0, 1.0];
        limit(&space, std::slice::from_ref(&(0..2)), &mut f);
        assert_eq!(f, [-1.0, -1.0]);
    }
}
