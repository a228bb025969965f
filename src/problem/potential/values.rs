//! `V` at points, and what the scheme takes from it: jumps at faces, slopes at cells.

use crate::base::error::Error;
use crate::base::quadrature::legendre_values;
use crate::problem::case::Case;
use crate::problem::element::{LARGEST_DEGREE, Nodes};
use crate::problem::grid::{MAX_DIMENSION, describe_point};
use crate::problem::potential::pieces::{PotentialPiece, piece, space_point};
use std::sync::OnceLock;

/// A jump below this fraction of `V` is round-off of two formulas that agree at the face.
pub const KINK: f64 = 1e-13;
/// Differences of `V` from a line below this fraction of `V` are round-off.
const ROUND_OFF: f64 = 4.0 * f64::EPSILON;

/// Evaluates a case's potential, and remembers the first value that is not finite.
pub(super) struct PotentialValues<'c> {
    pub case: &'c Case,
    pub failure: Option<Error>,
}

impl PotentialValues<'_> {
    /// The piece of the element around `centre`.
    pub fn piece(&mut self, centre: &[f64; 6]) -> PotentialPiece {
        piece(&self.case.potential, centre).unwrap_or_else(|condition| {
            let place = describe_point(self.case.space.dimension(), &centre[..MAX_DIMENSION]);
            self.failure.get_or_insert_with(|| condition.undefined(f64::NAN, place));
            PotentialPiece { region: 0, constant: None }
        })
    }

    /// `V` of a piece at a point.
    pub fn value(&mut self, piece: PotentialPiece, point: &[f64; 6]) -> f64 {
        let formula = &self.case.potential[piece.region].value;
        let value = piece.constant.unwrap_or_else(|| formula.eval(point));
        if !value.is_finite() {
            let place = describe_point(self.case.space.dimension(), &point[..MAX_DIMENSION]);
            self.failure.get_or_insert_with(|| formula.undefined(value, place));
        }
        value
    }

    /// The jump at the lower face, along axis `a`, of the element of space cell `i`, and the slope
    /// at the cell. The jump is 0 unless the cell is the first of its element. `own` is the piece
    /// of the element, `below` that of the element below, if there is one.
    pub fn jump_and_slope(
        &mut self,
        i: &[usize; MAX_DIMENSION],
        a: usize,
        own: PotentialPiece,
        below: Option<PotentialPiece>,
    ) -> [f64; 2] {
        let axes = &self.case.space.x;
        let axis = &axes[a];
        let (element, node) = axis.split(i[a] as i64);
        let centre = space_point(axes, i);
        let (mut lower, mut upper) = (centre, centre);
        lower[a] = axis.face(element);
        upper[a] = axis.face(element + 1);
        let at_lower = self.value(own, &lower);
        let drop = self.value(own, &upper) - at_lower;
        let slope = match axis.nodes.degree {
            0 => drop / axis.width(),
            _ => self.derivative(&centre, a, own, element, node),
        };
        // Below the first element of a periodic axis is the upper face of the last one.
        let turns = i[a] == 0;
        if turns {
            lower[a] = axis.face(axis.elements() as i64);
        }
        let Some(below) = below.filter(|&piece| node == 0 && (piece != own || turns)) else {
            return [0.0, slope];
        };
        let behind = self.value(below, &lower);
        let jump = at_lower - behind;
        // If the formulas agree here up to round-off, this is a kink and not a jump.
        let mut before = lower;
        before[a] = axis.face(if turns { axis.elements() as i64 } else { element } - 1);
        let drop_behind = (behind - self.value(below, &before)).abs();
        let scale = at_lower.abs().max(behind.abs()).max(drop.abs()).max(drop_behind);
        if jump.abs() <= KINK * scale { [0.0, slope] } else { [jump, slope] }
    }

    /// `∂V/∂x_a` at node `node` of `element`, on the line along axis `a` through `point`, as
    /// [`slope_at`] takes it.
    fn derivative(
        &mut self,
        point: &[f64; 6],
        a: usize,
        piece: PotentialPiece,
        element: i64,
        node: usize,
    ) -> f64 {
        let axis = &self.case.space.x[a];
        let mut point = *point;
        let values: Vec<f64> = (fine_points().iter())
            .map(|&xi| {
                point[a] = axis.at(element, xi);
                self.value(piece, &point)
            })
            .collect();
        slope_at(axis.nodes, node, &values) * 2.0 / axis.width()
    }
}

/// The points of the reference element at which `V` is evaluated.
pub(super) fn fine_points() -> &'static [f64] {
    &Nodes::of_space(LARGEST_DEGREE).reference().nodes
}

/// The slope at node `node` of an element with the `values` of `V` at [`fine_points`], along the
/// reference element, by [`slope_matrix`]. Where `V` is linear up to round-off, the bits are equal
/// at all nodes; where it is constant, the slope is exactly zero.
fn slope_at(nodes: Nodes, node: usize, values: &[f64]) -> f64 {
    let [first, .., last] = values else { return 0.0 };
    let mean = 0.5 * (last - first);
    let beside_line = |(xi, v): (&f64, &f64)| v - first - mean * (1.0 + xi);
    let rest: Vec<f64> = fine_points().iter().zip(values).map(beside_line).collect();
    let largest = |all: &[f64]| all.iter().fold(0.0, |most: f64, v| most.max(v.abs()));
    if largest(&rest) <= ROUND_OFF * largest(values) {
        return mean;
    }
    mean + slope_matrix(nodes)[node].iter().zip(&rest).map(|(d, v)| d * v).sum::<f64>()
}

/// Maps the values of `V` at [`fine_points`] to the slopes at `nodes`, along the reference element:
/// the derivative of the polynomial through these values, projected in L2 onto the degree of the
/// nodes. So their quadrature is the difference of `V` between the faces: a particle that crosses
/// the element has the energy that `V` gives it, even if `V` has a kink there.
pub(super) fn slope_matrix(nodes: Nodes) -> &'static [Vec<f64>] {
    static TABLE: OnceLock<Vec<Vec<Vec<f64>>>> = OnceLock::new();
    let all = (0..=LARGEST_DEGREE).map(Nodes::of_space);
    &TABLE.get_or_init(|| all.map(projected_slopes).collect())[nodes.degree]
}

/// [`slope_matrix`] of `nodes`, by Lobatto's rule at the fine points, which is exact here.
fn projected_slopes(nodes: Nodes) -> Vec<Vec<f64>> {
    let fine = Nodes::of_space(LARGEST_DEGREE).reference();
    let degree = nodes.degree;
    let legendre: Vec<_> = fine.nodes.iter().map(|xi| legendre_values(degree, *xi)).collect();
    let row = |xi: &f64| {
        let here = legendre_values(degree, *xi);
        let mut row = vec![0.0; fine.nodes.len()];
        for ((there, weight), derivative) in
            legendre.iter().zip(&fine.weights).zip(&fine.derivative)
        {
            let kernel = here.iter().zip(there).enumerate();
            let kernel: f64 = kernel.map(|(j, (a, b))| (j as f64 + 0.5) * a * b).sum();
            for (sum, d) in row.iter_mut().zip(derivative) {
                *sum += weight * kernel * d;
            }
        }
        row
    };
    nodes.reference().nodes.iter().map(row).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Slopes of polynomials of a degree up to `k + 1` are those at the nodes. For any values, the
    /// quadrature of the slopes is the difference between the faces.
    #[test]
    fn slopes_are_exact_for_polynomials_and_add_up_to_the_difference() {
        for degree in 1..=LARGEST_DEGREE {
            let nodes = Nodes::of_space(degree);
            let slopes = |values: &[f64]| -> Vec<f64> {
                (0..=degree).map(|node| slope_at(nodes, node, values)).collect()
            };
            let line: Vec<f64> = fine_points().iter().map(|xi| 0.7 * xi + 0.1).collect();
            assert!(slopes(&line).iter().all(|slope| *slope == 0.5 * (line[8] - line[0])));
            assert_eq!(slopes(&[0.3; 9]), vec![0.0; degree + 1]);
            let reference = nodes.reference();
            for power in 1..=(degree + 1).min(LARGEST_DEGREE) as i32 {
                let values: Vec<f64> = fine_points().iter().map(|xi| xi.powi(power)).collect();
                for (found, xi) in slopes(&values).iter().zip(&reference.nodes) {
                    let exact = f64::from(power) * xi.powi(power - 1);
                    assert!((found - exact).abs() < 1e-11, "{degree} {power}: {found} {exact}");
                }
            }
            let kink: Vec<f64> = fine_points().iter().map(|xi| (xi - 0.3).abs()).collect();
            let rule = slopes(&kink).into_iter().zip(&reference.weights);
            let sum: f64 = rule.map(|(slope, weight)| slope * weight).sum();
            assert!((sum - (0.7 - 1.3)).abs() < 1e-12, "{degree}: {sum}");
        }
    }
}
