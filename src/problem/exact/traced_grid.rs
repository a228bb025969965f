//! The grid on which particles are traced: `V` is quadratic or smooth in each cell, and jumps only
//! at faces.

use crate::base::error::Result;
use crate::problem::case::Case;
use crate::problem::element::Nodes;
use crate::problem::exact::by_axes::moves_by_axes;
use crate::problem::exact::cells::{TracedPotential, slopes};
use crate::problem::grid::{Axis, MAX_DIMENSION, PhaseSpace, box_cells, for_each_cell};
use crate::problem::potential::resolution::{POINTS, largest_mismatches};
use crate::problem::potential::{
    ElementShape, Potential, region, region_edges, shape_in_elements, space_point,
};
use std::iter::StepBy;
use std::ops::RangeInclusive;

/// An edge of a region this close to a face, as a fraction of an element, counts as lying on it.
const EDGE_ON_FACE: f64 = 1e-9;
/// Up to this many edges across an axis are taken for sides of boxes, on which faces are placed.
const FEW_EDGES: usize = 8;
/// Least degree of the elements with which the shape of `V` is detected.
const CURVATURE_DEGREE: usize = 3;

/// By space cell, row-major: the number of layers of cells around it in which `V` is, as in itself,
/// the same function ([`TracedPotential::function_number`]).
pub(super) fn free_layers(potential: &TracedPotential) -> Vec<u32> {
    let space = &potential.space;
    let n = space.dimension();
    let functions: Vec<_> =
        box_cells(&space.space_ranges()).map(|cell| potential.function_number(&cell)).collect();
    let layers = |function: &Option<u32>| if function.is_some() { u32::MAX } else { 0 };
    let mut distance: Vec<u32> = functions.iter().map(layers).collect();
    // Chebyshev distance to the nearest cell of another function, by one sweep up and one down
    // (Rosenfeld and Pfaltz 1966), over the neighbours that come before a cell in row-major order
    // and over their mirror images.
    let mut before: Vec<_> = box_cells(&vec![0..3; n]).map(|d| d.map(|d| d as i64 - 1)).collect();
    before.truncate(before.len() / 2);
    for sign in [1, -1] {
        // The sweep down visits the mirror images of the cells in the order of the sweep up.
        let mut next = 0;
        for_each_cell(&space.space_ranges(), |i| {
            let of_cell = |next| if sign > 0 { next } else { distance.len() - 1 - next };
            let (k, mut least) = (of_cell(next), u32::MAX);
            for offset in &before {
                let (mut neighbour, mut inside) = (0, true);
                for (a, axis) in space.x.iter().enumerate() {
                    let (j, cells) = (i[a] as i64 + offset[a], axis.cells as i64);
                    inside &= (0..cells).contains(&j);
                    neighbour = neighbour * cells + j;
                }
                if inside {
                    let at = of_cell(neighbour as usize);
                    let layers = if functions[at] == functions[k] { distance[at] } else { 0 };
                    least = least.min(layers.saturating_add(1));
                }
            }
            distance[k] = distance[k].min(least);
            next += 1;
        });
    }
    distance.iter_mut().for_each(|d| *d = d.saturating_sub(1));
    distance
}

/// The cells on which particles are traced: their shape, and limits on the number into which
/// elements are cut.
#[derive(Clone, Copy, Debug)]
pub struct CellLimits {
    /// `V` is taken as linear in a cell; otherwise as quadratic.
    pub is_linear: bool,
    /// Largest number of space cells where `V` has another shape, so that it is approximated.
    pub approximated: usize,
    /// Largest number so that edges of regions lie on faces, in two and three dimensions. In one
    /// there are up to 8192.
    pub edges: usize,
}

/// Largest number of space cells of a case of which all are examined beside a run, for estimates.
pub const MOST_EXAMINED: usize = 1 << 18;

impl CellLimits {
    /// For the exact solution.
    pub const EXACT: Self = Self { is_linear: false, approximated: 1 << 21, edges: 1 << 21 };
    /// For estimates by a few hundred particles.
    pub const ESTIMATES: Self = Self { is_linear: false, approximated: 1 << 16, edges: 1 << 16 };

    /// Whether a `V` of this shape within the elements is not exact in the cells.
    fn approximates(self, shape: ElementShape) -> bool {
        let exact = if self.is_linear { ElementShape::Linear } else { ElementShape::Quadratic };
        shape > exact
    }
}

/// Largest number of parts into which an element is cut along an axis.
const MOST_PARTS: usize = 64;
/// In one dimension elements are cut into more parts if edges are on faces then, up to this number
/// of cells.
const MOST_CELLS_IN_LINE: usize = 8192;
/// For degree 0, in up to two dimensions, a `V` that is approximated cuts elements into no more
/// parts than make this number of cells along an axis.
const ENOUGH_CELLS: usize = 512;

/// An approximated `V` is traced well enough to tell large errors of a run from small ones on at
/// least this number of cells along each axis that has more than one.
const FINE_CELLS: usize = 128;

/// Memory of a space cell of a tracer: jumps, slopes and layers of free cells.
const CELL_BYTES: u64 = Potential::CELL_BYTES + 4;
/// Memory of the curvatures in a space cell.
const CURVATURE_BYTES: u64 = 24;
/// Memory of the number of a cell's formula.
const FORMULA_BYTES: u64 = 4;

/// The grid on which particles are traced.
pub(super) struct TracedGrid {
    /// Its cells.
    pub space: PhaseSpace,
    /// Whether `V` may be curved in a cell.
    pub is_bent: bool,
    /// Whether particles follow the formulas of `V`.
    pub by_formulas: bool,
    /// Whether `V` has another shape in the elements than in the cells, and is not followed by its
    /// formulas.
    pub is_approximate: bool,
    /// Whether `V` is exact, or approximated on enough cells.
    pub is_accurate: bool,
}

/// How `V` varies within the elements of a case.
struct VariationInElements {
    /// Its shape.
    shape: ElementShape,
    /// The axes along which `V` between the nodes differs from its interpolant.
    missed: [bool; MAX_DIMENSION],
}

impl VariationInElements {
    /// Nothing is known.
    const UNKNOWN: Self = Self { shape: ElementShape::General, missed: [false; MAX_DIMENSION] };

    /// The variation of `V` of a case.
    ///
    /// # Errors
    /// As [`shape_in_elements`].
    fn of(case: &Case) -> Result<Self> {
        let mut fine = case.clone();
        for axis in &mut fine.space.x {
            if axis.nodes.degree < CURVATURE_DEGREE {
                *axis = axis.by_elements().with_nodes(Nodes::of_space(CURVATURE_DEGREE));
            }
        }
        let shape = shape_in_elements(&fine)?;
        let mut missed = [false; MAX_DIMENSION];
        largest_mismatches(&fine).iter().for_each(|found| missed[found.axis] = true);
        // A formula may vary where no node sees it.
        let is_missed = missed.contains(&true);
        Ok(Self { shape: if is_missed { ElementShape::General } else { shape }, missed })
    }
}

impl TracedGrid {
    /// The grid for `case`, by the `variation` of `V` in the elements of `sample`.
    fn new(case: &Case, sample: &Case, variation: &VariationInElements, most: CellLimits) -> Self {
        let VariationInElements { shape, missed } = *variation;
        let is_approximate = most.approximates(shape);
        let edges = region_edges(sample);
        let parts = LeastParts::new(case, most, is_approximate.then_some(missed));
        let space = cut_elements(case, &edges, most, &parts);
        let is_bent = may_bend(case, &space, shape, most);
        let is_fine = space.x.iter().all(|axis| axis.cells == 1 || axis.cells >= FINE_CELLS);
        let is_accurate = !is_approximate || is_fine && parts.meets_all;
        let by_cells = Self { space, is_bent, by_formulas: false, is_approximate, is_accurate };
        if !is_approximate || most.is_linear || !has_smooth_formulas(sample) {
            return by_cells;
        }
        let by_axes = || {
            let space = cut_elements(sample, &edges, most, &LeastParts::WHOLE);
            let potential = TracedPotential::new(sample, space, true);
            potential.is_ok_and(|potential| moves_by_axes(&potential))
        };
        if case.space.dimension() == 1 || is_fine && by_axes() {
            return by_cells;
        }
        let space = cut_elements(case, &edges, most, &LeastParts::WHOLE);
        Self { space, is_bent: true, by_formulas: true, is_approximate: false, is_accurate: true }
    }
}

/// Whether `V` is a smooth formula in each region, with finite slopes at the corners of the
/// elements of `case` in that region.
fn has_smooth_formulas(case: &Case) -> bool {
    let axes = &case.space.by_elements().x;
    let is_finite = |cell: [usize; MAX_DIMENSION]| {
        // An undefined condition was an error before.
        let own = region(&case.potential, &space_point(axes, &cell)).unwrap_or(0);
        let at_corner = |corner: [usize; MAX_DIMENSION]| {
            let mut x = [0.0; MAX_DIMENSION];
            for (a, axis) in axes.iter().enumerate() {
                x[a] = axis.face((cell[a] + corner[a]) as i64);
            }
            slopes(&case.potential[own].value, &x).is_some()
        };
        box_cells(&vec![0..2; axes.len()]).all(at_corner)
    };
    case.potential.iter().all(|region| region.value.is_smooth())
        && box_cells(&case.space.by_elements().space_ranges()).all(is_finite)
}

/// The grid on which particles are traced. Its cells are the case's elements, cut into parts for
/// two reasons: if `V` is approximated in the cells, into as many as `most` allows; and if an edge
/// of a region lies inside of an element, so that it comes to lie on a face.
///
/// Particles follow the formulas of `V` where these are smooth, if parabolas in the cells are not
/// exact. The exceptions are one dimension, and motions along the axes that are independent of each
/// other, on enough cells: a path through many cells takes less time there.
pub(super) fn traced_grid(case: &Case, most: CellLimits) -> Result<TracedGrid> {
    Ok(TracedGrid::new(case, case, &VariationInElements::of(case)?, most))
}

/// Whether `V`, of this `shape` in the case's elements, may be curved in a cell of `space`. Cells
/// that are parts of elements may be in regions that no element belongs to.
fn may_bend(case: &Case, space: &PhaseSpace, shape: ElementShape, most: CellLimits) -> bool {
    let elements = case.space.x.iter().map(Axis::elements).product();
    let is_cut = space.space_cells() > elements;
    !most.is_linear && (shape > ElementShape::Linear || is_cut)
}

/// About the grid of a tracer, by a sample of elements: up to 64 along an axis in one and two
/// dimensions, up to 16 in three.
fn sampled_grid(case: &Case, most: CellLimits) -> TracedGrid {
    const SAMPLED: [usize; MAX_DIMENSION] = [64, 64, 16];
    let mut sample = case.clone();
    let sampled = SAMPLED[case.space.dimension() - 1];
    for axis in &mut sample.space.x {
        axis.cells = axis.elements().min(sampled) * axis.nodes.count();
    }
    // Where V of the sample is not finite, that of the case may be.
    let variation = VariationInElements::of(&sample).unwrap_or(VariationInElements::UNKNOWN);
    TracedGrid::new(case, &sample, &variation, most)
}

/// About the memory of a [`Tracer::with_cells`](super::Tracer::with_cells), in bytes: `V` in its
/// space cells.
pub fn traced_bytes(case: &Case, most: CellLimits) -> u64 {
    let TracedGrid { space, is_bent, by_formulas, .. } = sampled_grid(case, most);
    let of_curvature = if is_bent { CURVATURE_BYTES } else { 0 };
    let of_formulas = if by_formulas { FORMULA_BYTES } else { 0 };
    space.space_cells() as u64 * (CELL_BYTES + of_curvature + of_formulas)
}

/// About the number of space cells of a [`Tracer::with_cells`](super::Tracer::with_cells) along an
/// axis, as a mean over the axes.
pub fn traced_cells_of_axis(case: &Case, most: CellLimits) -> f64 {
    (sampled_grid(case, most).space.space_cells() as f64).powf(1.0 / case.space.dimension() as f64)
}

/// The largest number of parts of an element along each of `axes` axes, if elements may be cut into
/// `cells` cells.
fn most_parts(cells: f64, axes: usize) -> usize {
    (libm::pow(cells, 1.0 / axes as f64) as usize).clamp(1, MOST_PARTS)
}

/// The least numbers of parts into which elements are cut.
struct LeastParts {
    /// By axis.
    along: [usize; MAX_DIMENSION],
    /// Along these axes the number is an odd multiple of [`POINTS`], so that cells have their
    /// centres where `V` was found to differ from what the nodes show.
    by_points: [bool; MAX_DIMENSION],
    /// Whether all such axes are cut like that.
    meets_all: bool,
}

impl LeastParts {
    /// Elements need not be cut.
    const WHOLE: Self =
        Self { along: [1; MAX_DIMENSION], by_points: [false; MAX_DIMENSION], meets_all: true };

    /// For `case`. `missed` are the axes along which nodes miss what `V` is between them; `None` if
    /// `V` is not approximated in the cells.
    fn new(case: &Case, most: CellLimits, missed: Option<[bool; MAX_DIMENSION]>) -> Self {
        let Some(missed) = missed else { return Self::WHOLE };
        let space = case.space.by_elements();
        let n = space.dimension();
        let room = most.approximated as f64 / space.space_cells() as f64;
        let enough = most_parts(room, n);
        let count = missed.iter().filter(|missed| **missed).count();
        let left = room / libm::pow(POINTS as f64, count as f64);
        let fits = left >= 1.0;
        let by_points = missed.map(|missed| missed && fits);
        let along = std::array::from_fn(|a| {
            let Some(axis) = space.x.get(a) else { return 1 };
            let least = match case.space.whole_degree() {
                0 if n == MAX_DIMENSION => 1,
                0 => enough.min(ENOUGH_CELLS.div_ceil(axis.cells)),
                _ => enough,
            };
            if by_points[a] {
                let most = (least / POINTS).max(1);
                POINTS * (most - usize::from(most.is_multiple_of(2)))
            } else if by_points.contains(&true) {
                least.min(most_parts(left, n - count))
            } else {
                least
            }
        });
        Self { along, by_points, meets_all: fits || count == 0 }
    }
}

/// The elements of the case, cut into parts. `edges` are those of the regions, by axis.
fn cut_elements(
    case: &Case,
    edges: &[Option<Vec<f64>>],
    most: CellLimits,
    least: &LeastParts,
) -> PhaseSpace {
    let mut space = case.space.by_elements();
    let (n, cells) = (space.dimension(), space.space_cells());
    for (a, (axis, edges)) in space.x.iter_mut().zip(edges).enumerate() {
        let fewest = least.along[a];
        let largest = match n {
            1 => MOST_CELLS_IN_LINE / axis.cells,
            _ => most_parts(most.edges as f64 / cells as f64, n),
        };
        let edges = edges.as_deref().unwrap_or_default();
        // In more dimensions many edges belong to a curve that faces cannot follow.
        let follows = n == 1 || edges.len() <= FEW_EDGES;
        let near = if follows { MOST_PARTS.min(largest).max(fewest) } else { fewest };
        let step = if least.by_points[a] { 2 * POINTS } else { 1 };
        let numbers = (fewest..=largest.max(fewest)).step_by(step);
        let parts = with_edges(axis, edges, numbers, near);
        if parts > 1 {
            *axis = Axis::new(axis.lower, axis.upper, axis.cells * parts);
        }
    }
    space
}

/// The least number of parts of an element, of these `numbers`, with which all `edges` lie on
/// faces. If there is none, the number up to `near` with which they are nearest to faces.
fn with_edges(
    axis: &Axis,
    edges: &[f64],
    mut numbers: StepBy<RangeInclusive<usize>>,
    near: usize,
) -> usize {
    let furthest = |parts: usize| {
        let width = axis.width() / parts as f64;
        let miss = |edge: &f64| {
            let place = (edge - axis.lower) / width;
            (place - place.round()).abs() * width
        };
        edges.iter().map(miss).fold(0.0, f64::max)
    };
    let on_face = EDGE_ON_FACE * axis.width();
    let all = numbers.clone();
    let nearest = || {
        let up_to = all.take_while(|&parts| parts <= near);
        up_to.min_by(|&a, &b| furthest(a).total_cmp(&furthest(b)))
    };
    numbers.find(|&parts| furthest(parts) <= on_face).or_else(nearest).unwrap_or(1)
}
