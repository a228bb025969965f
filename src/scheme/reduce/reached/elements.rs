//! Reached elements: where a formula is not zero, and which elements depend on which.
//!
//! A row of a degree above 0 depends on its own element, on both neighbours along an axis, and at a
//! jump on the partners of its trace (with the upwind flux, only if the trace leaves the face). An
//! element of a plane `(x_a, v_a)` is reached if one of these is. With other fluxes, traces that
//! leave a face and traces that arrive there depend on each other, so that soon all velocities that
//! a jump couples are reached.

use crate::base::quadrature::gauss_legendre;
use crate::problem::case::Case;
use crate::problem::element::{AT_END, MORE_POINTS};
use crate::problem::formula::Expression;
use crate::problem::grid::{Axis, Cell, PhaseSpace, for_each_cell};
use crate::problem::potential::{JumpKind, Potential};
use crate::scheme::interface::energy::{FaceCoupling, FaceSide};
use std::collections::{BTreeSet, HashMap};

/// The points of an element at which its projection first evaluates a formula. If the formula is
/// zero at all of them, so is the projection.
pub(super) struct Points {
    /// Along each axis, on `[−1, 1]`: Gauss points, nodes, and points next to the ends.
    along: Vec<Vec<f64>>,
}

impl Points {
    /// The points of the elements of `space`.
    pub fn new(space: &PhaseSpace) -> Self {
        let along = |axis: &Axis| {
            let rule = gauss_legendre(axis.nodes.count() + MORE_POINTS);
            let nodes = axis.nodes.reference().nodes.iter().copied();
            let ends = [-1.0 + 2.0 * AT_END, 1.0 - 2.0 * AT_END];
            rule.iter().map(|point| point.node).chain(nodes).chain(ends).collect()
        };
        Self { along: space.axes().map(along).collect() }
    }

    /// Number of points in an element.
    pub fn count(&self) -> usize {
        self.along.iter().map(Vec::len).product()
    }

    /// Whether `formula` is nonzero at one of the points, at time zero, in the element with these
    /// indices.
    pub fn find(&self, space: &PhaseSpace, formula: &Expression, element: &Cell) -> bool {
        // NaN is detected and refused later.
        formula.at_each(space.points_in(element, &self.along), 0.0).any(|f| f != 0.0)
    }
}

/// A face of a cell of a reached plane across its space axis.
pub(super) struct PlaneFace {
    /// Number of the cell above the face.
    pub number: usize,
    /// The cell on the other side; `None` beyond an end of the box.
    pub across: Option<usize>,
}

impl PlaneFace {
    /// The face of cell `i` of `space` along axis `a` of which the cell is on this `side`.
    pub fn of(space: &PhaseSpace, a: usize, i: usize, side: FaceSide) -> Self {
        match side {
            FaceSide::Above => Self { number: i, across: space.wrap(a, i as i64 - 1) },
            FaceSide::Below => {
                Self { number: (i + 1) % space.x[a].cells, across: space.wrap(a, i as i64 + 1) }
            }
        }
    }
}

/// The dependences between elements in the plane of an axis.
pub(super) struct Links {
    /// The grid of elements.
    elements: PhaseSpace,
    axis: usize,
    /// The jumps at the lower face of each element, anywhere across the axis.
    jumps: Vec<Vec<JumpKind>>,
    /// Whether a force acts in each element.
    pushed: Vec<bool>,
    /// By jump and trace, the velocity elements and sides on which the trace depends.
    partners: HashMap<JumpKind, Vec<BTreeSet<(FaceSide, usize)>>>,
}

impl Links {
    /// The dependences along space axis `a`; `None` for more than `most_jumps` kinds of jumps.
    pub fn new(case: &Case, potential: &Potential, a: usize, most_jumps: usize) -> Option<Self> {
        let space = &case.space;
        let (x, v) = (&space.x[a], &space.v[a]);
        if potential.jump_kinds(a).nth(most_jumps).is_some() {
            return None;
        }
        let mut jumps = vec![Vec::new(); x.elements()];
        let mut pushed = vec![false; x.elements()];
        for_each_cell(&space.space_ranges(), |i| {
            let (element, node) = x.split(i[a] as i64);
            let element = element as usize;
            pushed[element] |= potential.slope(i, a) != 0.0;
            let kind = potential.jump_kind(i, a, false);
            if node == 0 && !jumps[element].contains(&kind) {
                jumps[element].push(kind);
            }
        });
        let leaves = |side: FaceSide, element: usize| {
            (v.at(element as i64, 0.0) > 0.0) == (side == FaceSide::Above)
        };
        let partners = |kind: JumpKind| {
            let region = kind.higher.map(|region| &case.potential[region]);
            let reflects = region.is_some_and(|region| region.reflection.is_some());
            let upwind = case.scheme.flux == 1.0 || reflects;
            let reflected = |energy: f64| {
                region.map_or(0.0, |region| region.reflected(energy, kind.jump().abs()))
            };
            let coupling = FaceCoupling::new(v, kind.jump(), &reflected);
            let of_element = |(side, element): (FaceSide, usize)| {
                let takes = !upwind || leaves(side, element);
                let nodes = element * v.nodes.count()..(element + 1) * v.nodes.count();
                let nodes = nodes.filter(|_| takes);
                let partners = nodes.flat_map(|node| &coupling.trace(side, node).partners);
                partners.map(|share| (share.side, share.node / v.nodes.count())).collect()
            };
            let sides = [FaceSide::Below, FaceSide::Above];
            let all = sides.into_iter().flat_map(|side| (0..v.elements()).map(move |e| (side, e)));
            (kind, all.map(of_element).collect())
        };
        let partners = potential.jump_kinds(a).map(partners).collect();
        Some(Self { elements: space.by_elements(), axis: a, jumps, pushed, partners })
    }

    /// Whether the rows of element `(i, j)` depend on an element that `holds` something.
    pub fn take(&self, holds: impl Fn(usize, i64) -> bool, i: usize, j: usize) -> bool {
        let velocities = self.elements.v[self.axis].cells;
        let through = |side: FaceSide| {
            let PlaneFace { number, across } = PlaneFace::of(&self.elements, self.axis, i, side);
            let first = if side == FaceSide::Below { 0 } else { velocities };
            let from = |&(other, element): &(FaceSide, usize)| {
                let place = if other == side { Some(i) } else { across };
                place.is_some_and(|place| holds(place, element as i64))
            };
            // Cells beyond the ends of the box are inflow, which is in the set from the start.
            across.is_some()
                && self.jumps[number].iter().any(|kind| match self.partners.get(kind) {
                    None => across.is_some_and(|across| holds(across, j as i64)),
                    Some(partners) => partners[first + j].iter().any(from),
                })
        };
        let [below, above] = [j as i64 - 1, j as i64 + 1].map(|j| self.pushed[i] && holds(i, j));
        below || above || through(FaceSide::Above) || through(FaceSide::Below)
    }
}
