//! The potential on the grid: jumps at faces, slopes in cells.
//!
//! `V`'s one-sided limits at a face are the two neighbouring cells' own formulas, evaluated at the
//! face's centre; a cell's formula is that of the first region whose `where` holds at the cell's
//! centre. So jumps lie on faces by construction (paper, section 4.1: discontinuities at grid
//! points), and in between `V` is piecewise linear.

use crate::base::error::{Error, Result};
use crate::problem::case::{Case, Region};
use crate::problem::formula::Expression;
use crate::problem::grid::{Axis, MAX_DIMENSION, PhaseSpace, describe_point, for_each_cell};
use std::collections::HashSet;
use std::ops::Range;

/// Jumps below this fraction of `V` are round-off of formulas that meet at a face.
const KINK: f64 = 1e-13;

/// Jumps and slopes of `V` on a box of space cells.
#[derive(Clone, Debug)]
pub struct Potential {
    /// Box of space cells covered, one range an axis.
    ranges: Vec<Range<usize>>,
    /// `V⁺ − V⁻` at the lower face of each cell, by axis; zero at the ends of the box (the paper's
    /// assumption). At the lower end of a periodic axis, `V` of the first cell minus that of the
    /// last.
    jump: Vec<[f64; MAX_DIMENSION]>,
    /// `(V⁻_{i+1/2} − V⁺_{i−1/2})/Δx`, by axis.
    slope: Vec<[f64; MAX_DIMENSION]>,
    /// Cell indices run row-major over `ranges`.
    strides: [usize; MAX_DIMENSION],
    /// Along which axes the first cell covered comes behind the last one.
    closed: [bool; MAX_DIMENSION],
}

/// The region a space cell belongs to; or the condition that is undefined there.
fn region<'r>(
    regions: &'r [Region],
    point: &[f64; 6],
) -> std::result::Result<usize, &'r Expression> {
    for (index, region) in regions.iter().enumerate() {
        let Some(condition) = &region.condition else {
            return Ok(index);
        };
        match condition.holds(point) {
            Some(true) => return Ok(index),
            Some(false) => {}
            None => return Err(condition),
        }
    }
    Ok(regions.len() - 1)
}

/// Centre of space cell `i` as formulas take it.
fn space_point(axes: &[Axis], i: &[usize]) -> [f64; 6] {
    let mut point = [0.0; 6];
    for (a, axis) in axes.iter().enumerate() {
        point[a] = axis.centre(i[a] as i64);
    }
    point
}

/// Values of a case's potential, and the first that is not finite.
struct Values<'c> {
    case: &'c Case,
    failure: Option<Error>,
}

impl Values<'_> {
    /// The region a space cell belongs to, by its centre.
    fn region(&mut self, centre: &[f64; 6]) -> usize {
        region(&self.case.potential, centre).unwrap_or_else(|condition| {
            let place = describe_space_point(self.case.space.dimension(), centre);
            self.failure.get_or_insert_with(|| condition.undefined(f64::NAN, place));
            0
        })
    }

    /// `V` of a region at a point.
    fn value(&mut self, region: usize, point: &[f64; 6]) -> f64 {
        let formula = &self.case.potential[region].value;
        let value = formula.eval(point);
        if !value.is_finite() {
            let place = describe_space_point(self.case.space.dimension(), point);
            self.failure.get_or_insert_with(|| formula.undefined(value, place));
        }
        value
    }

    /// The jump at the lower face along axis `a` of space cell `i`, and the slope in it; `own` is
    /// its region, `below` that of the cell below, if there is one.
    fn jump_and_slope(
        &mut self,
        i: &[usize; MAX_DIMENSION],
        a: usize,
        own: usize,
        below: Option<usize>,
    ) -> [f64; 2] {
        let axes = &self.case.space.x;
        let axis = &axes[a];
        let centre = space_point(axes, i);
        let (mut lower, mut upper) = (centre, centre);
        lower[a] = axis.face(i[a] as i64);
        upper[a] = axis.face(i[a] as i64 + 1);
        let at_lower = self.value(own, &lower);
        let slope = (self.value(own, &upper) - at_lower) / axis.width();
        // The face below the first cell of a periodic axis is that above the last one.
        let turns = i[a] == 0;
        if turns {
            lower[a] = axis.face(axis.cells as i64);
        }
        let Some(below) = below.filter(|&r| r != own || turns) else {
            return [0.0, slope];
        };
        let behind = self.value(below, &lower);
        let jump = at_lower - behind;
        // A kink, not a jump: the formulas meet here to round-off.
        let drop = (slope * axis.width()).abs();
        let scale = at_lower.abs().max(behind.abs()).max(drop);
        match jump.abs() <= KINK * scale {
            true => [0.0, slope],
            false => [jump, slope],
        }
    }
}

impl Potential {
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
            slope: Vec::with_capacity(cells),
            strides,
            closed: std::array::from_fn(|a| {
                a < n && case.space.is_periodic(a) && ranges[a] == (0..axes[a].cells)
            }),
        };
        let mut values = Values { case, failure: None };
        for_each_cell(ranges, |i| {
            let centre = space_point(axes, i);
            let own = values.region(&centre);
            // Regions of the cells below.
            let below: [Option<usize>; MAX_DIMENSION] = std::array::from_fn(|a| {
                let mut below = *i;
                below[a] = (a < n).then(|| case.space.wrap(a, i[a] as i64 - 1))??;
                Some(values.region(&space_point(axes, &below)))
            });
            let (mut jump, mut slope) = ([0.0; MAX_DIMENSION], [0.0; MAX_DIMENSION]);
            for a in 0..n {
                [jump[a], slope[a]] = values.jump_and_slope(i, a, own, below[a]);
            }
            this.jump.push(jump);
            this.slope.push(slope);
        });
        match values.failure {
            Some(error) => Err(error),
            None => Ok(this),
        }
    }

    /// The potential of the whole grid.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn whole(case: &Case) -> Result<Self> {
        let ranges: Vec<_> = case.space.x.iter().map(|a| 0..a.cells).collect();
        Self::new(case, &ranges)
    }

    fn position(&self, i: &[usize]) -> usize {
        self.ranges.iter().enumerate().map(|(a, r)| (i[a] - r.start) * self.strides[a]).sum()
    }

    /// `V⁺ − V⁻` at the lower face, along `axis`, of space cell `i`. Zero at the lower end of the
    /// box, unless the axis is periodic.
    pub fn jump_below(&self, i: &[usize], axis: usize) -> f64 {
        self.jump[self.position(i)][axis]
    }

    /// `V⁺ − V⁻` at the upper face, along `axis`, of space cell `i`. Zero at the upper end of what
    /// is covered, unless that is all of a periodic axis.
    pub fn jump_above(&self, i: &[usize], axis: usize) -> f64 {
        let (position, stride) = (self.position(i), self.strides[axis]);
        if i[axis] + 1 < self.ranges[axis].end {
            self.jump[position + stride][axis]
        } else if self.closed[axis] {
            self.jump[position - i[axis] * stride][axis]
        } else {
            0.0
        }
    }

    /// `(V⁻_{i+1/2} − V⁺_{i−1/2})/Δx` along `axis` in space cell `i`.
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

    /// Whether `V` jumps anywhere, by axis.
    pub fn jumps(&self) -> [bool; MAX_DIMENSION] {
        std::array::from_fn(|a| self.jump.iter().any(|jump| jump[a] != 0.0))
    }

    /// Adds the kinds of cells that there are, by their slopes and the jumps at their lower faces,
    /// to `kinds`, up to so `many`.
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

fn describe_space_point(n: usize, point: &[f64; 6]) -> String {
    let text = describe_point(n, point);
    text.split(", ").take(n).collect::<Vec<_>>().join(", ")
}

/// A region's edge that misses the faces of the grid.
#[derive(Clone, Debug, PartialEq)]
pub struct StrayEdge {
    /// Axis along which it was found.
    pub axis: usize,
    /// Where it lies.
    pub at: f64,
    /// The face the scheme moves it to.
    pub face: f64,
}

/// What the grid does not see of the regions.
#[derive(Clone, Debug, Default)]
pub struct Overlooked {
    /// Edges inside cells, one a distinct place. The scheme treats them as lying on the nearest
    /// face, a change of the problem by that distance.
    pub edges: Vec<StrayEdge>,
    /// Regions, by index, that hold at no cell's centre.
    pub empty: Vec<usize>,
}

/// Where along each space axis the region changes between the centres of neighbouring cells; `None`
/// for an axis along which it does so at more than some dozens of places, as a curved edge does.
pub fn region_edges(case: &Case) -> Vec<Option<Vec<f64>>> {
    const MOST: usize = 64;
    let axes = &case.space.x;
    let ranges: Vec<_> = axes.iter().map(|a| 0..a.cells).collect();
    let mut found: Vec<Option<Vec<f64>>> = vec![Some(Vec::new()); axes.len()];
    if case.potential.len() == 1 {
        return found;
    }
    // Undefined conditions are an error elsewhere.
    let at = |point: &[f64; 6]| region(&case.potential, point).unwrap_or(0);
    for_each_cell(&ranges, |i| {
        let centre = space_point(axes, i);
        let own = at(&centre);
        for (a, axis) in axes.iter().enumerate() {
            let mut point = centre;
            point[a] = axis.centre(i[a] as i64 + 1);
            if i[a] + 1 == axis.cells || found[a].is_none() || at(&point) == own {
                continue;
            }
            let (mut inside, mut outside) = (centre[a], point[a]);
            for _ in 0..60 {
                point[a] = 0.5 * (inside + outside);
                if at(&point) == own {
                    inside = point[a];
                } else {
                    outside = point[a];
                }
            }
            if let Some(edges) = &mut found[a]
                && !(edges.iter()).any(|e: &f64| (e - inside).abs() < 1e-6 * axis.width())
            {
                edges.push(inside);
                if edges.len() > MOST {
                    found[a] = None;
                }
            }
        }
    });
    found
}

/// Looks for region edges along lines through cell centres, and for regions between the centres.
pub fn overlooked(case: &Case) -> Overlooked {
    const MOST: usize = 8;
    let axes = &case.space.x;
    let ranges: Vec<_> = axes.iter().map(|a| 0..a.cells).collect();
    let mut found: Vec<StrayEdge> = Vec::new();
    let mut used = vec![false; case.potential.len()];
    if used.len() == 1 {
        return Overlooked::default();
    }
    // Undefined conditions are an error elsewhere.
    let at = |point: &[f64; 6]| region(&case.potential, point).unwrap_or(0);
    for_each_cell(&ranges, |i| {
        let centre = space_point(axes, i);
        let own = at(&centre);
        used[own] = true;
        for (a, axis) in axes.iter().enumerate() {
            for side in [0, 1] {
                let face = axis.face((i[a] + side) as i64);
                let mut inside = centre[a];
                // Just inside the face, so that an edge on the face itself is not found.
                let mut outside = face + (centre[a] - face) * 1e-6;
                let probe = |x: f64| {
                    let mut point = centre;
                    point[a] = x;
                    at(&point) == own
                };
                if found.len() >= MOST || probe(outside) {
                    continue;
                }
                for _ in 0..60 {
                    let middle = 0.5 * (inside + outside);
                    if probe(middle) {
                        inside = middle;
                    } else {
                        outside = middle;
                    }
                }
                let at = 0.5 * (inside + outside);
                let known = |e: &StrayEdge| e.axis == a && (e.at - at).abs() < 1e-6 * axis.width();
                if !found.iter().any(known) {
                    found.push(StrayEdge { axis: a, at, face });
                }
            }
        }
    });
    Overlooked { edges: found, empty: (0..used.len()).filter(|&r| !used[r]).collect() }
}
