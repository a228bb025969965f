//! An axis of the grid: its elements, faces, cells and their widths.

use crate::problem::element::Nodes;
use std::ops::Range;

/// Distance, in widths, by which a point on the face of an element is moved inside.
const INSIDE: f64 = 1e-9;

/// An axis of elements `[lower + e h, lower + (e+1) h]`, `h = (upper − lower)/elements`.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// Lower end of the box.
    pub lower: f64,
    /// Upper end of the box.
    pub upper: f64,
    /// Number of cells: unknowns along the axis, `degree + 1` in each element.
    pub cells: usize,
    /// The nodes of an element.
    pub nodes: Nodes,
    /// The part of the case's axis that it represents.
    pub part: AxisPart,
}

/// The part of the case's axis that a reduced axis represents (see [`crate::scheme::reduce`]).
#[derive(Clone, Debug, Default, PartialEq)]
pub enum AxisPart {
    /// The axis is the whole axis of the case.
    #[default]
    Whole,
    /// Some of its elements, whose centres and faces have the same bits as on the whole axis.
    Window {
        /// Ends of the whole axis.
        ends: [f64; 2],
        /// Number of elements of the whole axis.
        of: usize,
        /// Number, on the whole axis, of the first element here.
        first: usize,
    },
    /// One cell that represents all elements, whose values are equal.
    Merged {
        /// Number of merged elements.
        of: usize,
        /// Nodes of the merged elements.
        nodes: Nodes,
    },
}

/// The axis that another one is a window of.
struct WholeAxis {
    ends: [f64; 2],
    elements: usize,
    /// Number, on this axis, of the first element of the window.
    first: usize,
}

impl Axis {
    /// The whole axis `[lower, upper]` with cells of degree 0.
    pub fn new(lower: f64, upper: f64, cells: usize) -> Self {
        Self { lower, upper, cells, nodes: Nodes::default(), part: AxisPart::Whole }
    }

    /// This axis with these nodes in each element.
    pub fn with_nodes(self, nodes: Nodes) -> Self {
        Self { cells: self.elements() * nodes.count(), nodes, ..self }
    }

    /// This axis with the same elements and degree 0.
    pub fn by_elements(&self) -> Self {
        self.clone().with_nodes(Nodes::default())
    }

    /// The axis of the case, before it was reduced.
    pub fn whole(&self) -> Self {
        let new = |ends: [f64; 2], of, nodes| Self::new(ends[0], ends[1], of).with_nodes(nodes);
        match self.part {
            AxisPart::Whole => self.clone(),
            AxisPart::Window { ends, of, .. } => new(ends, of, self.nodes),
            AxisPart::Merged { of, nodes } => new([self.lower, self.upper], of, nodes),
        }
    }

    /// The elements `range` of a whole axis.
    pub fn window(&self, range: &Range<usize>) -> Self {
        Self {
            lower: self.face(range.start as i64),
            upper: self.face(range.end as i64),
            cells: range.len() * self.nodes.count(),
            nodes: self.nodes,
            part: AxisPart::Window {
                ends: [self.lower, self.upper],
                of: self.elements(),
                first: range.start,
            },
        }
    }

    /// One cell that represents all cells of a whole axis.
    pub fn merged(&self) -> Self {
        Self {
            cells: 1,
            nodes: Nodes::default(),
            part: AxisPart::Merged { of: self.elements(), nodes: self.nodes },
            ..self.clone()
        }
    }

    /// Largest magnitude of a point of the box.
    pub fn largest_magnitude(&self) -> f64 {
        self.lower.abs().max(self.upper.abs())
    }

    /// The position just outside of the box at its lower or upper end, where what enters there is
    /// evaluated: a formula such as `1 if x > upper else 0` holds there.
    pub fn just_outside(&self, at_upper: bool) -> f64 {
        self.beside(if at_upper { self.upper } else { self.lower }, at_upper)
    }

    /// The coordinate above or below `x` by a little more than the round-off of a face: there a
    /// formula with an edge on the face has the value of that side.
    pub fn beside(&self, x: f64, above: bool) -> f64 {
        if above { x + self.round_off_of_face() } else { x - self.round_off_of_face() }
    }

    /// A little more than the round-off of the coordinate of a face.
    fn round_off_of_face(&self) -> f64 {
        8.0 * f64::EPSILON * self.largest_magnitude()
    }

    /// `x`, or [`just_outside`](Self::just_outside) if that is nearer than round-off.
    pub fn outside_of_end(&self, x: f64) -> f64 {
        let near = |end: f64| (x - end).abs() <= 1e-12 * (self.upper - self.lower);
        let at_end =
            [(self.lower, false), (self.upper, true)].into_iter().find(|(end, _)| near(*end));
        at_end.map_or(x, |(_, at_upper)| self.just_outside(at_upper))
    }

    /// Number of elements.
    pub fn elements(&self) -> usize {
        self.cells / self.nodes.count()
    }

    /// The element of cell `j`, which may lie off the axis.
    pub fn element_of(&self, j: i64) -> i64 {
        self.split(j).0
    }

    /// The element of cell `j` and the cell's number in it; `j` may lie off the axis.
    pub fn split(&self, j: i64) -> (i64, usize) {
        let count = self.nodes.count() as i64;
        (j.div_euclid(count), j.rem_euclid(count) as usize)
    }

    /// For a merged axis, the mean of `v²` over the cells that were merged.
    pub fn mean_square(&self) -> Option<f64> {
        let AxisPart::Merged { .. } = self.part else { return None };
        let whole = self.whole();
        let squares = whole.centres().into_iter().map(|v| v * v);
        if whole.nodes.degree == 0 {
            return Some(squares.sum::<f64>() / whole.cells as f64);
        }
        let terms = squares.enumerate().map(|(j, square)| square * whole.weight(j));
        Some(terms.sum::<f64>() / (whole.upper - whole.lower))
    }

    /// Number of the first cell on the whole axis.
    pub fn first_cell(&self) -> usize {
        self.of_whole().first * self.nodes.count()
    }

    /// Whether element `e`, counted from the first one here, is on the whole axis but was left out.
    /// Values there are zero.
    pub fn leaves_out(&self, e: i64) -> bool {
        let AxisPart::Window { of, first, .. } = self.part else { return false };
        let whole = (0..of as i64).contains(&(e + first as i64));
        whole && !(0..self.elements() as i64).contains(&e)
    }

    /// The axis that this is a window of; this one if it is none.
    fn of_whole(&self) -> WholeAxis {
        match self.part {
            AxisPart::Window { ends, of, first } => WholeAxis { ends, elements: of, first },
            _ => WholeAxis { ends: [self.lower, self.upper], elements: self.elements(), first: 0 },
        }
    }

    /// Element width `h`.
    pub fn width(&self) -> f64 {
        let WholeAxis { ends: [lower, upper], elements, .. } = self.of_whole();
        (upper - lower) / elements as f64
    }

    /// Mean width of the cells.
    pub fn mean_width(&self) -> f64 {
        self.width() / self.nodes.count() as f64
    }

    /// Width of cell `j`: its quadrature weight. For degree 0 it is the width of the element.
    pub fn weight(&self, j: usize) -> f64 {
        match self.nodes.degree {
            0 => self.width(),
            _ => 0.5 * self.width() * self.nodes.reference().weights[j % self.nodes.count()],
        }
    }

    /// Width of cell `j` relative to the mean width; exactly 1 for degree 0.
    pub fn relative_weight(&self, j: usize) -> f64 {
        match self.nodes.degree {
            0 => 1.0,
            _ => {
                let count = self.nodes.count();
                0.5 * count as f64 * self.nodes.reference().weights[j % count]
            }
        }
    }

    /// The widths of all cells.
    pub fn weights(&self) -> Vec<f64> {
        (0..self.cells).map(|j| self.weight(j)).collect()
    }

    /// Faces of the cells, one more than cells: sums of the weights, between which the nodes lie.
    /// Faces of elements are exact.
    pub fn cell_faces(&self) -> Vec<f64> {
        let count = self.nodes.count();
        let mut faces = Vec::with_capacity(self.cells + 1);
        for j in 0..self.cells {
            match j % count {
                0 => faces.push(self.face((j / count) as i64)),
                _ => faces.push(faces[j - 1] + self.weight(j - 1)),
            }
        }
        faces.push(self.upper);
        faces
    }

    /// The cell nearest to `point` in the element that holds it; the last one beyond the axis.
    pub fn cell_at(&self, point: f64) -> usize {
        let place = ((point - self.lower) / self.width()).floor() as usize;
        let element = place.min(self.elements() - 1);
        let count = self.nodes.count();
        let off = |j: &usize| (self.centre((element * count + j) as i64) - point).abs();
        let nearest = (0..count).min_by(|a, b| off(a).total_cmp(&off(b))).unwrap_or(0);
        element * count + nearest
    }

    /// The [`cell_at`](Self::cell_at) `point`; `None` beyond the ends of the axis.
    pub fn cell_holding(&self, point: f64) -> Option<usize> {
        (self.lower..=self.upper).contains(&point).then(|| self.cell_at(point))
    }

    /// The point `twice` half elements above the lower end: a face for an even number, a centre for
    /// an odd one. A mirrored axis has exactly mirrored points.
    fn point(&self, twice: f64) -> f64 {
        let WholeAxis { ends: [lower, upper], elements, first } = self.of_whole();
        let n = 2.0 * elements as f64;
        let twice = twice + 2.0 * first as f64;
        ((n - twice) * lower + twice * upper) / n
    }

    /// Centre of cell `j`, its node; `j` may lie outside `0..cells` (ghost cells).
    pub fn centre(&self, j: i64) -> f64 {
        if self.nodes.degree == 0 {
            return self.point(2.0 * j as f64 + 1.0);
        }
        let (e, m) = self.split(j);
        self.at(e, self.nodes.reference().nodes[m])
    }

    /// The [`centre`](Self::centre) of cell `j`. A centre on a face is moved inside the element by
    /// a billionth of the element's width, or round-off if that is more, so that a path from there
    /// begins in the element.
    pub fn inner_centre(&self, j: i64) -> f64 {
        self.centre_off_face(j, (INSIDE * self.width()).max(self.round_off_of_face()))
    }

    /// The [`centre`](Self::centre) of cell `j`, [`beside`](Self::beside) a face on which it lies,
    /// in the element.
    pub fn centre_in_element(&self, j: i64) -> f64 {
        self.centre_off_face(j, self.round_off_of_face())
    }

    /// The [`centre`](Self::centre) of cell `j`, moved by `distance` into its element if it lies on
    /// a face.
    fn centre_off_face(&self, j: i64, distance: f64) -> f64 {
        let (e, m) = self.split(j);
        match self.nodes.reference().nodes[m] {
            -1.0 => self.face(e) + distance,
            1.0 => self.face(e + 1) - distance,
            _ => self.centre(j),
        }
    }

    /// The point `ξ ∈ [−1, 1]` of element `e`. Faces are exact.
    pub fn at(&self, e: i64, xi: f64) -> f64 {
        match xi {
            -1.0 => self.face(e),
            1.0 => self.face(e + 1),
            _ => self.point(2.0 * e as f64 + 1.0) + 0.5 * self.width() * xi,
        }
    }

    /// Lower face of element `e`, the upper face of element `e − 1`.
    pub fn face(&self, e: i64) -> f64 {
        self.point(2.0 * e as f64)
    }

    /// Distance of `point` from the lower end in widths of elements. For a window it is exactly
    /// that on the whole axis minus the number of elements before the window.
    pub fn position(&self, point: f64) -> f64 {
        let WholeAxis { ends: [lower, _], first, .. } = self.of_whole();
        (point - lower) / self.width() - first as f64
    }

    /// The element that holds `point`; the nearest one beyond the ends of the axis.
    pub fn element_at(&self, point: f64) -> usize {
        (self.position(point).floor().max(0.0) as usize).min(self.elements() - 1)
    }

    /// Cell centres, in order.
    pub fn centres(&self) -> Vec<f64> {
        (0..self.cells as i64).map(|j| self.centre(j)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Nodes on faces are moved into their element, wherever the box is.
    #[test]
    fn inner_centres_are_in_their_elements() {
        for lower in [0.0, -3.0, 1e7, -1e7, 1e12] {
            let axis = Axis::new(lower, lower + 3.0, 6).with_nodes(Nodes::of_space(2));
            for j in 0..axis.cells as i64 {
                let (centre, e) = (axis.inner_centre(j), axis.element_of(j));
                assert!(axis.face(e) < centre && centre < axis.face(e + 1), "{lower}: {j}");
            }
        }
    }

    #[test]
    fn a_point_just_below_the_upper_end_is_in_the_last_cell() {
        let axis = Axis::new(-1.0, 1.0, 10);
        let below = axis.upper.next_down();
        // The distance from the lower end rounds to the whole length.
        assert_eq!((below - axis.lower) / axis.width(), 10.0);
        for axis in [axis.clone(), axis.with_nodes(Nodes::of_space(2))] {
            for point in [below, axis.upper] {
                assert_eq!(axis.cell_holding(point), Some(axis.cells - 1));
            }
            assert_eq!(axis.cell_holding(axis.lower), Some(0));
            assert_eq!(axis.cell_holding(axis.lower.next_down()), None);
            assert_eq!(axis.cell_holding(axis.upper.next_up()), None);
            assert_eq!(axis.cell_holding(f64::NAN), None);
        }
    }
}
