//! The kinds of faces of a grid's elements, on which bounds of the spectrum depend.

use crate::base::row_major::volume;
use crate::matrix::line_bounds::{FaceKind, LinePiece, MOST_UNKNOWNS};
use crate::problem::case::Case;
use crate::problem::grid::{Axis, MAX_DIMENSION, for_each_cell};
use crate::problem::potential::{JumpKind, Potential};
use std::collections::{BTreeMap, HashMap};
use std::ops::Range;

/// The faces of the elements along each axis.
pub struct ElementFaces<'a> {
    case: &'a Case,
    /// For each axis: the kinds of the lower and upper face of elements, with the steepest force on
    /// such elements.
    found: [BTreeMap<[FaceKind; 2], f64>; MAX_DIMENSION],
    /// The jumps at the lower end of the first axis, row-major over the other axes. On a periodic
    /// axis they are those at its upper end.
    first_jumps: Vec<JumpKind>,
    /// For each axis, the fewest elements between two jumps, or between a jump and an end.
    between_jumps: [usize; MAX_DIMENSION],
    /// For each axis, the element above the last jump found on each line.
    last_jump: [HashMap<[usize; MAX_DIMENSION], usize>; MAX_DIMENSION],
}

impl<'a> ElementFaces<'a> {
    /// The faces of `case`, before any is added.
    pub fn new(case: &'a Case) -> Self {
        let between_jumps = std::array::from_fn(|a| case.space.x.get(a).map_or(0, Axis::elements));
        let (found, last_jump) = Default::default();
        Self { case, found, first_jumps: Vec::new(), between_jumps, last_jump }
    }

    /// Adds the elements of the space cells of `ranges`, in ascending order along the first axis.
    /// `potential` also covers the next cells along that axis.
    pub fn add(&mut self, potential: &Potential, ranges: &[Range<usize>]) {
        let space = &self.case.space;
        let across = volume(&ranges[1..]);
        let mut count = 0;
        for_each_cell(ranges, |i| {
            if i[0] == 0 {
                self.first_jumps.push(potential.jump_kind(i, 0, false));
            }
            for a in 0..space.dimension() {
                let wrapped = (a == 0).then(|| self.first_jumps[count % across]);
                let faces = [false, true].map(|upper| self.face(potential, i, a, upper, wrapped));
                let force = potential.slope(i, a).abs() / space.v[a].width();
                let steepest = self.found[a].entry(faces).or_default();
                *steepest = steepest.max(force);
                self.count_between_jumps(potential, i, a);
            }
            count += 1;
        });
        // Lines along the other axes end with the layer.
        self.last_jump[1..].iter_mut().for_each(HashMap::clear);
    }

    /// Updates the fewest elements between jumps, if there is a jump at the lower face of space
    /// cell `i`, or the line along axis `a` ends with it.
    fn count_between_jumps(&mut self, potential: &Potential, i: &[usize; MAX_DIMENSION], a: usize) {
        let axis = &self.case.space.x[a];
        let (element, mut line) = (i[a] / axis.nodes.count(), *i);
        line[a] = 0;
        if potential.jump_below(i, a) != 0.0 && element > 0 {
            let last = self.last_jump[a].insert(line, element).unwrap_or(0);
            self.between_jumps[a] = self.between_jumps[a].min(element - last);
        }
        if i[a] + 1 == axis.cells {
            let last = self.last_jump[a].get(&line).copied().unwrap_or(0);
            self.between_jumps[a] = self.between_jumps[a].min(axis.elements() - last);
        }
    }

    /// The kind of the lower or upper face, along axis `a`, of the element of space cell `i`.
    fn face(
        &self,
        potential: &Potential,
        i: &[usize; MAX_DIMENSION],
        a: usize,
        upper: bool,
        wrapped: Option<JumpKind>,
    ) -> FaceKind {
        let (space, closed) = (&self.case.space, self.case.is_closed());
        let axis = &space.x[a];
        let element = i[a] / axis.nodes.count();
        let at_end = if upper { element + 1 == axis.elements() } else { element == 0 };
        if at_end && !space.is_periodic(a) {
            return if closed { FaceKind::Closed } else { FaceKind::Open };
        }
        let mut cell = *i;
        cell[a] = element * axis.nodes.count() + if upper { axis.nodes.count() - 1 } else { 0 };
        let kind = match wrapped.filter(|_| at_end && upper) {
            Some(kind) => kind,
            None => potential.jump_kind(&cell, a, upper),
        };
        if kind.jump() == 0.0 {
            return FaceKind::Inner;
        }
        let reflects = |region: usize| self.case.potential[region].reflection.is_some();
        if kind.higher.is_some_and(reflects) {
            return FaceKind::Upwind;
        }
        // On the lower side of V the partners have slower or reflected velocities.
        let is_higher = (kind.jump() < 0.0) == upper;
        let v = &space.v[a];
        let reflected = (2.0 * kind.jump().abs()).sqrt();
        if closed || !is_higher && reflected <= v.upper.min(-v.lower) {
            FaceKind::Inner
        } else {
            FaceKind::Beyond
        }
    }

    /// The parts of lines along axis `a`: single elements, by their faces. A short line without
    /// jumps is one part. Elements next to an end or a jump form a longer part, if no element of
    /// the axis has a steeper force; on any line there must be room for two such parts.
    pub fn pieces(&self, a: usize) -> Vec<LinePiece> {
        let space = &self.case.space;
        let (elements, count) = (space.x[a].elements(), space.x[a].nodes.count());
        let most = self.found[a].values().copied().fold(0.0, f64::max);
        if self.between_jumps[a] == elements
            && !space.is_periodic(a)
            && elements * count <= MOST_UNKNOWNS
        {
            let end = if self.case.is_closed() { FaceKind::Closed } else { FaceKind::Open };
            return vec![LinePiece { elements, faces: [end; 2], steepest: most }];
        }
        let together = (MOST_UNKNOWNS / count).min(self.between_jumps[a] / 2).max(1);
        let piece = |(&faces, &steepest): (&[FaceKind; 2], &f64)| {
            let one_sided = faces.contains(&FaceKind::Inner) && faces != [FaceKind::Inner; 2];
            let elements = if one_sided && steepest == most { together } else { 1 };
            LinePiece { elements, faces, steepest }
        };
        self.found[a].iter().map(piece).collect()
    }
}
