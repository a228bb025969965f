//! The potential on the grid: jumps at faces, slopes in cells.
//!
//! The formula of an element is that of the first region whose `where` holds at its centre. The two
//! one-sided limits of `V` at a face are the formulas of the two elements, evaluated on the face at
//! the nodes of the other axes. So jumps lie on faces by construction (paper, section 4.1:
//! discontinuities at grid points).
//!
//! Inside an element, along an axis of degree 0, `V` is linear between the two faces. For a higher
//! degree it is the polynomial of degree 8 through the formula's values at Gauss–Lobatto points of
//! the element; the slopes at the nodes are those of its derivative, projected in L2 onto the
//! degree of the element. So the slopes add up to the difference of `V` between the faces. A table
//! that is constant around its points has, in the whole element, the value at the element's centre.

mod curvature;
mod edges;
pub mod oblique;
mod pieces;
pub mod resolution;
mod values;

pub use crate::problem::potential::curvature::{ElementShape, curvatures};
pub use crate::problem::potential::edges::{
    MOST_STRAY_EDGES, RegionWidth, StrayEdge, region_edges, region_widths, unresolved_regions,
};

pub use crate::problem::potential::pieces::{is_one_piece, region, space_point};
pub use crate::problem::potential::values::KINK;

use crate::base::error::Result;
use crate::problem::case::Case;
use crate::problem::grid::{MAX_DIMENSION, PhaseSpace, box_cells, for_each_cell};
use crate::problem::potential::pieces::{PotentialPiece, element_centre, piece, spread};
use crate::problem::potential::values::PotentialValues;
use std::collections::HashSet;
use std::ops::Range;

/// Slopes that differ by less than this part of the steepest one are equal up to round-off.
const SAME: f64 = 1e-9;
/// Round-off of a slope of `V`, relative to the largest one, in a box as far from the origin as an
/// element is wide: positions have no more digits.
const ROUND_OFF: f64 = 64.0 * f64::EPSILON;

/// Jumps and slopes of `V` on a box of space cells.
#[derive(Clone, Debug)]
pub struct Potential {
    /// The box of space cells that is covered, one range per axis.
    ranges: Vec<Range<usize>>,
    /// `V⁺ − V⁻` at the lower face of each element, by axis, stored at the first cell of the
    /// element. It is zero at other cells, and at the ends of the box (the paper's assumption). At
    /// the lower end of a periodic axis it is `V` of the first cell minus that of the last.
    jump: Vec<[f64; MAX_DIMENSION]>,
    /// The region on the higher side of those jumps, by axis; empty without partial reflection.
    higher: Vec<[usize; MAX_DIMENSION]>,
    /// `∂V/∂x_a` at each cell as the scheme takes it (see above), by axis; for degree 0
    /// `(V⁻_{i+1/2} − V⁺_{i−1/2})/Δx`.
    slope: Vec<[f64; MAX_DIMENSION]>,
    /// Strides of the row-major order of `ranges`.
    strides: [usize; MAX_DIMENSION],
    /// The periodic axes that are covered as a whole: their first cell follows the last one.
    closed: [bool; MAX_DIMENSION],
}

/// Identifies a jump of `V`: its height, and with partial reflection the region on the higher side.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct JumpKind {
    bits: u64,
    /// The region on the higher side; `None` if no region reflects in part.
    pub higher: Option<usize>,
}

impl JumpKind {
    /// `V⁺ − V⁻`.
    pub fn jump(&self) -> f64 {
        f64::from_bits(self.bits)
    }
}

/// The largest jump of `V` at the faces across an axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LargestJump {
    /// `|V⁺ − V⁻|`.
    pub height: f64,
    /// The coordinate of its face.
    pub face: f64,
}

impl Potential {
    /// Memory of a space cell in bytes, without partial reflection.
    pub const CELL_BYTES: u64 = 2 * 8 * MAX_DIMENSION as u64;

    /// Evaluates `case`'s potential on the space cells of `ranges`.
    ///
    /// # Errors
    /// [`Error::Formula`](crate::base::error::Error::Formula) where `V` is not finite.
    pub fn new(case: &Case, ranges: &[Range<usize>]) -> Result<Self> {
        let axes = &case.space.x;
        let n = axes.len();
        let mut strides = [0; MAX_DIMENSION];
        let mut cells = 1;
        for a in (0..n).rev() {
            strides[a] = cells;
            cells *= ranges[a].len();
        }
        let mut this = Self {
            ranges: ranges.to_vec(),
            jump: Vec::with_capacity(cells),
            higher: Vec::new(),
            slope: Vec::with_capacity(cells),
            strides,
            closed: std::array::from_fn(|a| {
                a < n && case.space.is_periodic(a) && ranges[a] == (0..axes[a].cells)
            }),
        };
        let reflects = case.reflects();
        let mut values = PotentialValues { case, failure: None };
        for_each_cell(ranges, |i| {
            let own = values.piece(&element_centre(axes, i));
            // The pieces of the elements below along each axis.
            let below: [Option<PotentialPiece>; MAX_DIMENSION] = std::array::from_fn(|a| {
                let mut below = *i;
                let element = (a < n).then(|| axes[a].element_of(i[a] as i64))?;
                let last = element * axes[a].nodes.count() as i64 - 1;
                below[a] = case.space.wrap(a, last)?;
                Some(values.piece(&element_centre(axes, &below)))
            });
            let (mut jump, mut slope) = ([0.0; MAX_DIMENSION], [0.0; MAX_DIMENSION]);
            for a in 0..n {
                [jump[a], slope[a]] = values.jump_and_slope(i, a, own, below[a]);
            }
            if reflects {
                let side = |a: usize| if jump[a] > 0.0 { own } else { below[a].unwrap_or(own) };
                this.higher.push(std::array::from_fn(|a| side(a).region));
            }
            this.jump.push(jump);
            this.slope.push(slope);
        });
        values.failure.map_or(Ok(this), Err)
    }

    /// The potential of the whole grid.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn whole(case: &Case) -> Result<Self> {
        Self::new(case, &case.space.space_ranges())
    }

    /// Index of space cell `i` in the vectors.
    fn position(&self, i: &[usize]) -> usize {
        self.ranges.iter().enumerate().map(|(a, r)| (i[a] - r.start) * self.strides[a]).sum()
    }

    /// `V⁺ − V⁻` at the lower face, along `axis`, of space cell `i`, if it is the first of its
    /// element, else zero. It is zero at the lower end of the box, unless the axis is periodic.
    pub fn jump_below(&self, i: &[usize], axis: usize) -> f64 {
        self.jump[self.position(i)][axis]
    }

    /// `V⁺ − V⁻` at the upper face, along `axis`, of space cell `i`. It is zero at the upper end of
    /// the covered cells, unless they are a whole periodic axis.
    pub fn jump_above(&self, i: &[usize], axis: usize) -> f64 {
        self.face(i, axis, true).map_or(0.0, |at| self.jump[at][axis])
    }

    /// `∂V/∂x_a` along `axis` at space cell `i`, projected onto the degree of the element; for
    /// degree 0 `(V⁻_{i+1/2} − V⁺_{i−1/2})/Δx`.
    pub fn slope(&self, i: &[usize], axis: usize) -> f64 {
        self.slope[self.position(i)][axis]
    }

    /// The slopes along all axes in space cell `i`.
    pub fn slopes(&self, i: &[usize]) -> &[f64; MAX_DIMENSION] {
        &self.slope[self.position(i)]
    }

    /// Largest `|slope|` along `axis`.
    pub fn steepest(&self, axis: usize) -> f64 {
        self.slope.iter().fold(0.0, |most, s| most.max(s[axis].abs()))
    }

    /// How `V` varies within the elements of `space` that are covered. Slopes along an axis are
    /// equal within the `tolerance` of that axis.
    fn shape(&self, space: &PhaseSpace, tolerance: &[f64; MAX_DIMENSION]) -> ElementShape {
        let along =
            |a: usize| (0..self.slope.len()).map(move |p| self.shape_at(space, p, a, tolerance[a]));
        (0..space.dimension()).flat_map(along).max().unwrap_or(ElementShape::Linear)
    }

    /// What the slope along `a` at the node `p` shows, compared with other nodes of its element.
    fn shape_at(&self, space: &PhaseSpace, p: usize, a: usize, tolerance: f64) -> ElementShape {
        let slope = |p: usize| self.slope[p][a];
        let node = |b: usize| p / self.strides[b] % self.ranges[b].len() % space.x[b].nodes.count();
        let first = |b: usize| p - node(b) * self.strides[b];
        let differ = |s: f64, t: f64| (s - t).abs() > tolerance;
        if (0..space.dimension()).any(|b| b != a && differ(slope(p), slope(first(b)))) {
            return ElementShape::General;
        }
        let xi = &space.x[a].nodes.reference().nodes;
        let last = first(a) + (xi.len() - 1) * self.strides[a];
        let part = (xi[node(a)] - xi[0]) / (xi[xi.len() - 1] - xi[0]);
        let [at_first, at_last] = [first(a), last].map(slope);
        if differ(slope(p), at_first + part * (at_last - at_first)) {
            ElementShape::General
        } else if differ(slope(p), at_first) {
            ElementShape::Quadratic
        } else {
            ElementShape::Linear
        }
    }

    /// The different jumps along `axis`.
    pub fn jump_kinds(&self, axis: usize) -> impl Iterator<Item = JumpKind> + '_ {
        let mut seen = HashSet::new();
        let kinds = (0..self.jump.len()).map(move |at| self.kind_at(at, axis));
        kinds.filter(move |kind| kind.jump() != 0.0 && seen.insert(*kind))
    }

    fn kind_at(&self, at: usize, axis: usize) -> JumpKind {
        let higher = self.higher.get(at).map(|regions| regions[axis]);
        JumpKind { bits: self.jump[at][axis].to_bits(), higher }
    }

    /// The jump at the lower or upper face, along `axis`, of the element of space cell `i`. For the
    /// lower face the cell must be the first of its element, for the upper face the last.
    pub fn jump_kind(&self, i: &[usize], axis: usize, upper: bool) -> JumpKind {
        let none = JumpKind { bits: 0, higher: None };
        self.face(i, axis, upper).map_or(none, |at| self.kind_at(at, axis))
    }

    /// The index of the cell whose lower face along `axis` is the lower or upper face of space cell
    /// `i`; `None` if it is not covered.
    fn face(&self, i: &[usize], axis: usize, upper: bool) -> Option<usize> {
        let (position, stride) = (self.position(i), self.strides[axis]);
        if !upper {
            Some(position)
        } else if i[axis] + 1 < self.ranges[axis].end {
            Some(position + stride)
        } else {
            self.closed[axis].then(|| position - i[axis] * stride)
        }
    }

    /// The largest jump at faces across each axis of `space`; `None` where `V` does not jump.
    pub fn largest_jumps(&self, space: &PhaseSpace) -> [Option<LargestJump>; MAX_DIMENSION] {
        std::array::from_fn(|a| {
            let heights = self.jump.iter().map(|jump| jump[a].abs()).enumerate();
            let (at, height) =
                heights.filter(|(_, h)| *h > 0.0).max_by(|a, b| a.1.total_cmp(&b.1))?;
            let cell = self.ranges[a].start + at / self.strides[a] % self.ranges[a].len();
            let (axis, cell) = (&space.x[a], cell as i64);
            Some(LargestJump { height, face: axis.face(axis.element_of(cell)) })
        })
    }

    /// Numbers of lower faces across each axis at which `V` jumps: of the cells of each layer along
    /// the first axis.
    pub fn jump_faces(&self) -> impl Iterator<Item = [usize; MAX_DIMENSION]> {
        let of_layer = |jumps: &[[f64; MAX_DIMENSION]]| {
            std::array::from_fn(|a| jumps.iter().filter(|jump| jump[a] != 0.0).count())
        };
        self.jump.chunks(self.strides[0]).map(of_layer)
    }

    /// Adds to `kinds` the different combinations of jumps at the lower faces of a cell and slopes
    /// in it, until `kinds` has `many`.
    pub fn collect_kinds(&self, kinds: &mut HashSet<[u64; 2 * MAX_DIMENSION]>, many: usize) {
        for (jump, slope) in self.jump.iter().zip(&self.slope) {
            if kinds.len() >= many {
                return;
            }
            let mut values = jump.iter().chain(slope);
            kinds.insert(std::array::from_fn(|_| values.next().map_or(0, |v| v.to_bits())));
        }
    }

    /// Largest `Σ_a |slope_a| / Δv_a` over the cells: the force's part of the diagonal of `A`.
    pub fn force_rate(&self, space: &PhaseSpace) -> f64 {
        self.slope
            .iter()
            .map(|slope| space.v.iter().zip(slope).map(|(v, s)| s.abs() / v.width()).sum::<f64>())
            .fold(0.0, f64::max)
    }
}

/// `V` at the nodes of the space cells of `ranges`, row-major: the value of the region to which the
/// node's element belongs. It may be not finite, as the scheme of degree 0 needs `V` at faces only.
pub fn nodal_values(case: &Case, ranges: &[Range<usize>]) -> Vec<f64> {
    let axes = &case.space.x;
    let value = |i: [usize; MAX_DIMENSION]| {
        // Undefined conditions are reported by `Potential::new`.
        let found = piece(&case.potential, &element_centre(axes, &i)).ok();
        let formula = &case.potential[found.map_or(0, |piece| piece.region)].value;
        let constant = found.and_then(|piece| piece.constant);
        constant.unwrap_or_else(|| formula.eval(&space_point(axes, &i)))
    };
    box_cells(ranges).map(value).collect()
}

/// Largest number of elements whose shape of `V` is examined, by dimension. In a larger grid they
/// are spread evenly.
const MOST_SHAPES: [usize; MAX_DIMENSION] = [1 << 13, 1 << 12, 1 << 10];

/// How `V` varies within the elements of `case`, whose axes have degrees of at least 2.
///
/// # Errors
/// As [`Potential::new`].
pub fn shape_in_elements(case: &Case) -> Result<ElementShape> {
    if case.potential.iter().all(|region| region.value.constant().is_some()) {
        return Ok(ElementShape::Linear);
    }
    let space = &case.space;
    let elements = space.by_elements();
    let potentials = || {
        spread(&elements.x, MOST_SHAPES[space.dimension() - 1]).map(|element| {
            let nodes = space.x.iter().zip(element).map(|(axis, at)| {
                let count = axis.nodes.count();
                at * count..(at + 1) * count
            });
            Potential::new(case, &nodes.collect::<Vec<_>>())
        })
    };
    let mut tolerance = [0.0; MAX_DIMENSION];
    for potential in potentials() {
        let potential = potential?;
        for (a, axis) in space.x.iter().enumerate() {
            let farthest = axis.lower.abs().max(axis.upper.abs());
            let part = SAME + ROUND_OFF * farthest / axis.width();
            tolerance[a] = f64::max(tolerance[a], part * potential.steepest(a));
        }
    }
    let mut shape = ElementShape::Linear;
    for potential in potentials() {
        shape = shape.max(potential?.shape(space, &tolerance));
    }
    Ok(shape)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::problem::element::Nodes;

    /// In a grid of which some elements are examined, and in one of which all are.
    #[test]
    fn shapes_are_seen_in_small_and_large_grids() {
        for cells in [6, 20_000] {
            for (value, expected) in [
                ("0.3", ElementShape::Linear),
                ("0.3 - 0.1*x", ElementShape::Linear),
                ("x^2 + x", ElementShape::Quadratic),
                ("x^3", ElementShape::General),
            ] {
                let text = format!(
                    "[[axis]]\nx = {{ lower = 0, upper = 1, cells = {cells} }}\n\
                     v = {{ lower = -1, upper = 1, cells = 2 }}\n[[potential]]\n\
                     where = \"x > 0.5\"\nvalue = \"0.1\"\n[[potential]]\n\
                     value = \"{value}\"\n[initial]\nf = \"1\"\n[time]\nend = 1.0\n"
                );
                let mut case = Case::parse("shape", &text, &[]).expect("a case");
                for axis in &mut case.space.x {
                    *axis = axis.by_elements().with_nodes(Nodes::of_space(3));
                }
                let found = shape_in_elements(&case).expect("a finite V");
                assert_eq!(found, expected, "{value} on {cells}");
            }
        }
    }
}
