//! The stretches of an axis on which level sets are taken to be polynomials.
//!
//! In space these are the elements. Along velocities without a force, nodes do not know of each
//! other: values at them are accurate, while the polynomials of two elements differ at their common
//! face, so that a zero there may lie in both elements or in none, and its slope is inaccurate. So
//! a polynomial reaches from the first to the last node of its element only. The *bridge* from
//! there to the next element has the polynomial through nodes of both. Level sets are continuous
//! so, and each zero is found once.

use crate::base::quadrature::{QuadraturePoint, gauss_legendre};
use crate::problem::element::Nodes;
use crate::problem::grid::{Axis, MAX_DIMENSION};
use std::ops::Range;

/// Points of the rule in a cell of a space axis, by dimension.
const SPACE_POINTS: [usize; MAX_DIMENSION] = [8, 3, 1];
/// Points of the rule in an element of a velocity axis for each of its nodes, by dimension.
const VELOCITY_POINTS: [usize; MAX_DIMENSION] = [8, 2, 1];
/// Nodes of each of the two elements that determine the polynomial of a bridge, at most.
const BRIDGE_NODES: usize = 3;
/// Distance by which stretches of velocity reach over their ends, in elements. A zero within this
/// distance of an end, where two of them may find it, has a part in each.
const OVERLAP: f64 = 1e-6;
/// Zeros at most this far beyond an end of the velocity box, in elements, count as on it.
const AT_END: f64 = 1e-12;

/// A stretch of an axis. Places are in elements from the lower end of the axis.
pub(super) struct AxisStretch {
    /// Numbers of the nodes whose values determine the polynomial.
    pub(super) nodes: Range<usize>,
    ends: [f64; 2],
    overlap: f64,
    /// Whether an end is one of the box.
    at_box: [bool; 2],
    /// Maps values at the nodes to Bernstein coefficients between the ends and the overlaps.
    pub(super) to_bernstein: Vec<Vec<f64>>,
    /// The points of the rule, with weights as parts of the element's width.
    pub(super) samples: Vec<QuadraturePoint>,
}

impl AxisStretch {
    /// The stretch through the `nodes` of an axis with elements of the reference `element`.
    fn new(element: Nodes, nodes: Range<usize>, ends: [f64; 2], overlap: f64) -> Self {
        let at: Vec<f64> = nodes.clone().map(|node| place(element, node)).collect();
        let domain = [ends[0] - overlap, ends[1] + overlap];
        let to_bernstein = to_bernstein(&at, domain);
        Self { nodes, ends, overlap, at_box: [false; 2], to_bernstein, samples: Vec::new() }
    }

    /// This stretch with a rule of `points` points between each two neighbours of `parts`.
    fn with_samples(self, points: usize, parts: &[f64]) -> Self {
        let rule = gauss_legendre(points);
        let samples = parts.windows(2).flat_map(|ends| {
            rule.iter().map(|point| point.moved_to([ends[0], ends[1]])).collect::<Vec<_>>()
        });
        Self { samples: samples.collect(), ..self }
    }

    /// The elements of a space axis in `n` dimensions.
    pub(super) fn of_space(axis: &Axis, n: usize) -> Vec<Self> {
        let count = axis.nodes.count();
        let of_element = |e: usize| {
            let start = e as f64;
            let mut faces = vec![start];
            faces.extend((1..count).map(|node| start + upper_face(axis.nodes, node - 1)));
            faces.push(start + 1.0);
            let nodes = e * count..(e + 1) * count;
            Self::new(axis.nodes, nodes, [start, start + 1.0], 0.0)
                .with_samples(SPACE_POINTS[n - 1], &faces)
        };
        (0..axis.elements()).map(of_element).collect()
    }

    /// The stretches of a velocity axis in `n` dimensions, in ascending order.
    pub(super) fn of_velocity(axis: &Axis, n: usize) -> Vec<Self> {
        let (count, elements) = (axis.nodes.count(), axis.elements());
        let own = |e: usize| {
            let nodes = e * count..(e + 1) * count;
            let at_box = [e == 0, e + 1 == elements];
            let lower = if at_box[0] { 0.0 } else { place(axis.nodes, nodes.start) };
            let upper = if at_box[1] { elements as f64 } else { place(axis.nodes, nodes.end - 1) };
            Self { at_box, ..Self::new(axis.nodes, nodes, [lower, upper], OVERLAP) }
        };
        let bridge = |e: usize| {
            let (face, reach) = ((e + 1) * count, count.min(BRIDGE_NODES));
            let ends = [face - 1, face].map(|node| place(axis.nodes, node));
            Self::new(axis.nodes, face - reach..face + reach, ends, OVERLAP)
        };
        let sampled = |stretch: Self| {
            let ends = stretch.ends;
            stretch.with_samples(VELOCITY_POINTS[n - 1] * count, &ends)
        };
        let all = (0..elements).flat_map(|e| {
            let bridge = (e + 1 < elements).then(|| bridge(e));
            [Some(own(e)), bridge].into_iter().flatten()
        });
        all.map(sampled).collect()
    }

    /// Whether it leads from an element to the next.
    pub(super) fn is_bridge(&self, element: Nodes) -> bool {
        self.nodes.start / element.count() != (self.nodes.end - 1) / element.count()
    }

    /// Its width with the overlaps, in elements.
    pub(super) fn width(&self) -> f64 {
        self.ends[1] - self.ends[0] + 2.0 * self.overlap
    }

    /// The coordinate in `[0, 1]` of a place.
    pub(super) fn coordinate(&self, place: f64) -> f64 {
        (place - self.ends[0] + self.overlap) / self.width()
    }

    /// The place of a coordinate in `[0, 1]`.
    pub(super) fn place(&self, coordinate: f64) -> f64 {
        self.ends[0] - self.overlap + self.width() * coordinate
    }

    /// The nearest place between its ends.
    pub(super) fn nearest(&self, place: f64) -> f64 {
        place.clamp(self.ends[0], self.ends[1])
    }

    /// The part with which a zero at this place counts; the parts in two stretches sum to 1.
    pub(super) fn part(&self, place: f64) -> f64 {
        let part = |beyond: f64, at_box: bool| {
            if at_box {
                f64::from(u8::from(beyond <= AT_END))
            } else {
                (0.5 * (1.0 - beyond / self.overlap)).clamp(0.0, 1.0)
            }
        };
        part(self.ends[0] - place, self.at_box[0]) * part(place - self.ends[1], self.at_box[1])
    }
}

/// The place of a node of an axis, in elements.
fn place(element: Nodes, node: usize) -> f64 {
    let (e, node) = (node / element.count(), node % element.count());
    e as f64 + 0.5 * (1.0 + element.reference().nodes[node])
}

/// The upper face of the cell of a node within its element, as a part of the element.
pub(super) fn upper_face(element: Nodes, node: usize) -> f64 {
    0.5 * element.reference().weights[..=node].iter().sum::<f64>()
}

/// The matrix that maps values at the places `at` to Bernstein coefficients on `domain`. Each
/// Lagrange polynomial is the product of its linear factors `(u − u_m)/(u_n − u_m)`.
fn to_bernstein(at: &[f64], domain: [f64; 2]) -> Vec<Vec<f64>> {
    let count = at.len();
    let column = |n: usize| {
        let mut coefficients = vec![1.0];
        for m in (0..count).filter(|m| *m != n) {
            let [lower, upper] = domain.map(|end| (end - at[m]) / (at[n] - at[m]));
            let k = coefficients.len();
            let mut next = vec![0.0; k + 1];
            for (j, c) in coefficients.iter().enumerate() {
                next[j] += (k - j) as f64 / k as f64 * lower * c;
                next[j + 1] += (j + 1) as f64 / k as f64 * upper * c;
            }
            coefficients = next;
        }
        coefficients
    };
    let columns: Vec<Vec<f64>> = (0..count).map(column).collect();
    (0..count).map(|j| columns.iter().map(|column| column[j]).collect()).collect()
}
