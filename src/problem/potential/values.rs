//! `V` at points, and what the scheme takes from it: jumps at faces, slopes at cells.

use crate::base::error::Error;
use crate::problem::case::Case;
use crate::problem::element::{LARGEST_DEGREE, Nodes};
use crate::problem::grid::{MAX_DIMENSION, describe_point};
use crate::problem::potential::pieces::{PotentialPiece, piece, space_point};

/// A jump below this fraction of `V` is round-off of two formulas that agree at the face.
pub const KINK: f64 = 1e-13;

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

    /// `∂V/∂x_a` at node `node` of `element`, on the line along axis `a` through `point`, from
    /// values at the Gauss–Lobatto points of the largest degree. It is exactly zero if `V` is
    /// constant.
    fn derivative(
        &mut self,
        point: &[f64; 6],
        a: usize,
        piece: PotentialPiece,
        element: i64,
        node: usize,
    ) -> f64 {
        let axis = &self.case.space.x[a];
        let fine = Nodes::of_space(LARGEST_DEGREE).reference();
        let mut point = *point;
        let values: Vec<f64> = (fine.nodes.iter())
            .map(|&xi| {
                point[a] = axis.at(element, xi);
                self.value(piece, &point)
            })
            .collect();
        let slopes: Vec<f64> = (fine.derivative.iter())
            .map(|row| row.iter().zip(&values).map(|(d, v)| d * (v - values[0])).sum())
            .collect();
        fine.interpolate(&slopes, axis.nodes.reference().nodes[node]) * 2.0 / axis.width()
    }
}
