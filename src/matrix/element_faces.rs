//! The kinds of faces of a grid's elements, as far as bounds of the spectrum depend on them.

use crate::matrix::line_bounds::{FaceKind, LinePiece, MOST_UNKNOWNS};
use crate::problem::case::Case;
use crate::problem::grid::{Axis, MAX_DIMENSION, for_each_cell};
use crate::problem::potential::{JumpKind, Potential};
use std::collections::{BTreeMap, HashMap};
use std::ops::Range;

/// The faces of the elements along each axis.
pub struct ElementFaces<'a> {
    case: &'a Case,
    /// By axis: the faces below and above an element, and the steepest force on such elements.
    found: [BTreeMap<[FaceKind; 2], f64>; MAX_DIMENSION],
    /// The jumps where the first axis closes on itself, in the order of the other cells.
    turn: Vec<JumpKind>,
    /// By axis: the fewest elements between two jumps, or between a jump and an end of the axis.
    between: [usize; MAX_DIMENSION],
    /// By axis: the element above the last jump found on each line.
    last: [HashMap<[usize; MAX_DIMENSION], usize>; MAX_DIMENSION],
}

impl<'a> ElementFaces<'a> {
    /// The faces of `case`, before any is added.
    pub fn new(case: &'a Case) -> Self {
        let between = std::array::from_fn(|a| case.space.x.get(a).map_or(0, Axis::elements));
        let (found, last) = Default::default();
        Self { case, found, turn: Vec::new(), between, last }
    }

    /// Adds the elements of the space cells of `ranges`, those of the first axis in ascending
    /// order; `potential` covers the cells behind them along the first axis, too.
    pub fn add(&mut self, potential: &Potential, ranges: &[Range<usize>]) {
        let space = &self.case.space;
        let across: usize = ranges[1..].iter().map(Range::len).product();
        let mut count = 0;
        for_each_cell(ranges, |i| {
            if i[0] == 0 {
                self.turn.push(potential.jump_kind(i, 0, false));
            }
            for a in 0..space.dimension() {
                let turn = (a == 0).then(|| self.turn[count % across]);
                let faces = [false, true].map(|upper| self.face(potential, i, a, upper, turn));
                let force = potential.slope(i, a).abs() / space.v[a].width();
                let steepest = self.found[a].entry(faces).or_default();
                *steepest = steepest.max(force);
                self.measure(potential, i, a);
            }
            count += 1;
        });
        // Lines along the other axes end with the layer.
        self.last[1..].iter_mut().for_each(HashMap::clear);
    }

    /// Counts the elements below a jump at the lower face of space cell `i`, and those above the
    /// last one.
    fn measure(&mut self, potential: &Potential, i: &[usize; MAX_DIMENSION], a: usize) {
        let axis = &self.case.space.x[a];
        let (element, mut line) = (i[a] / axis.nodes.count(), *i);
        line[a] = 0;
        if potential.jump_below(i, a) != 0.0 && element > 0 {
            let last = self.last[a].insert(line, element).unwrap_or(0);
            self.between[a] = self.between[a].min(element - last);
        }
        if i[a] + 1 == axis.cells {
            let last = self.last[a].get(&line).copied().unwrap_or(0);
            self.between[a] = self.between[a].min(axis.elements() - last);
        }
    }

    /// The kind of the lower or upper face, along axis `a`, of the element of space cell `i`.
    fn face(
        &self,
        potential: &Potential,
        i: &[usize; MAX_DIMENSION],
        a: usize,
        upper: bool,
        turn: Option<JumpKind>,
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
        let kind = match turn.filter(|_| at_end && upper) {
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
        // On the lower side of V slower and reflected velocities are the partners.
        let is_higher = (kind.jump() < 0.0) == upper;
        let v = &space.v[a];
        let reflected = (2.0 * kind.jump().abs()).sqrt();
        match closed || !is_higher && reflected <= v.upper.min(-v.lower) {
            true => FaceKind::Inner,
            false => FaceKind::Beyond,
        }
    }

    /// The parts of lines along axis `a`: single elements, by their faces. A short line without
    /// jumps is taken whole. Where none of the axis are steeper, the elements from an end or a jump
    /// on are taken together, as many as two such stretches have room for on any line.
    pub fn pieces(&self, a: usize) -> Vec<LinePiece> {
        let space = &self.case.space;
        let (elements, count) = (space.x[a].elements(), space.x[a].nodes.count());
        let most = self.found[a].values().copied().fold(0.0, f64::max);
        if self.between[a] == elements && !space.is_periodic(a) && elements * count <= MOST_UNKNOWNS
        {
            let end = if self.case.is_closed() { FaceKind::Closed } else { FaceKind::Open };
            return vec![LinePiece { elements, faces: [end; 2], steepest: most }];
        }
        let together = (MOST_UNKNOWNS / count).min(self.between[a] / 2).max(1);
        let piece = |(&faces, &steepest): (&[FaceKind; 2], &f64)| {
            let one_sided = faces.contains(&FaceKind::Inner) && faces != [FaceKind::Inner; 2];
            let elements = if one_sided && steepest == most { together } else { 1 };
            LinePiece { elements, faces, steepest }
        };
        self.found[a].iter().map(piece).collect()
    }
}
