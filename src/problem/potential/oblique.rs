//! Edges of regions that are oblique to the axes, where the scheme follows a staircase of faces.

use crate::base::bisect::bisect;
use crate::problem::case::{Case, Region};
use crate::problem::grid::Axis;
use crate::problem::potential::pieces::{energy_scale, region, space_point, spread};

/// Largest number of elements that are examined. On a larger grid they are spread evenly.
const MOST_ELEMENTS: usize = 1 << 18;
/// Largest number of edges of a region that are collected.
const MOST_EDGES: usize = 1 << 13;
/// Distances, in elements, of two more lines beside a line. Edges of boxes have at most two
/// different positions on the three lines.
const BESIDE: [f64; 2] = [0.21, 0.43];
/// Halvings of the interval in which an edge is sought.
const HALVINGS: usize = 40;
/// Positions closer than this, in elements, are the same.
const ONE_PLACE: f64 = 1e-2;
/// Jumps below this part of the largest `v²/2` of the box are ignored.
const LEAST_JUMP: f64 = 1e-3;

/// A point on an edge that is oblique to the axes.
#[derive(Clone, Debug, PartialEq)]
pub struct ObliqueEdge {
    /// The region; of the two at the edge, the first in the case file.
    pub region: usize,
    /// A point of the edge, `[x, y, z, 0, 0, 0]`.
    pub point: [f64; 6],
}

/// For each region, one point at which `V` jumps at an edge that is oblique to the axes.
pub fn oblique_edges(case: &Case) -> Vec<ObliqueEdge> {
    let n = case.space.dimension();
    let mut found: Vec<Option<[f64; 6]>> = vec![None; case.potential.len()];
    if n == 1 || found.len() == 1 {
        return Vec::new();
    }
    let mut edges = vec![0; found.len()];
    let axes = &case.space.by_elements().x;
    let least_jump = LEAST_JUMP * energy_scale(&case.space);
    let at = |point: &[f64; 6]| region(&case.potential, point).ok();
    for element in spread(axes, MOST_ELEMENTS) {
        let centre = space_point(axes, &element);
        for a in (0..n).filter(|&a| element[a] + 1 < axes[a].cells) {
            let mut next = centre;
            next[a] = axes[a].centre(element[a] as i64 + 1);
            let (Some(own), Some(other)) = (at(&centre), at(&next)) else { continue };
            let key = own.min(other);
            if own == other || found[key].is_some() || edges[key] >= MOST_EDGES {
                continue;
            }
            edges[key] += 1;
            let edge = Edge {
                regions: &case.potential,
                axes,
                axis: a,
                sides: [own, other],
                ends: [centre[a], next[a]],
            };
            found[key] = edge.oblique_near(&centre).filter(|point| edge.jump(point) > least_jump);
        }
    }
    let places = found.into_iter().enumerate();
    places.filter_map(|(region, point)| Some(ObliqueEdge { region, point: point? })).collect()
}

/// An edge between two neighbouring elements.
struct Edge<'a> {
    regions: &'a [Region],
    axes: &'a [Axis],
    /// The axis along which they are neighbours.
    axis: usize,
    /// Regions of the two elements.
    sides: [usize; 2],
    /// Centres of the two elements along the axis.
    ends: [f64; 2],
}

impl Edge<'_> {
    /// The edge on the line along the axis through `centre`, if its position is different on the
    /// lines beside.
    fn oblique_near(&self, centre: &[f64; 6]) -> Option<[f64; 6]> {
        let own = self.on_line(centre)?;
        let apart = |a: f64, b: f64| (a - b).abs() > ONE_PLACE * self.axes[self.axis].width();
        let is_oblique = |b: usize, side: f64| {
            let place = |by: f64| {
                let mut beside = *centre;
                beside[b] += side * by * self.axes[b].width();
                self.on_line(&beside)
            };
            let (Some(first), Some(second)) = (place(BESIDE[0]), place(BESIDE[1])) else {
                return false;
            };
            apart(own, first) && apart(first, second) && apart(own, second)
        };
        let others = (0..self.axes.len()).filter(|&b| b != self.axis);
        let mut sides = others.flat_map(|b| [(b, -1.0), (b, 1.0)]);
        sides.any(|(b, side)| is_oblique(b, side)).then(|| self.point(centre, own))
    }

    fn point(&self, line: &[f64; 6], at: f64) -> [f64; 6] {
        let mut point = *line;
        point[self.axis] = at;
        point
    }

    /// The position of the edge on a line, if it has the same regions on its two sides there.
    fn on_line(&self, line: &[f64; 6]) -> Option<f64> {
        let at = |place: f64| region(self.regions, &self.point(line, place)).ok();
        let [inside, outside] = self.ends;
        if at(inside) != Some(self.sides[0]) || at(outside) != Some(self.sides[1]) {
            return None;
        }
        let own_side = |place| at(place) == Some(self.sides[0]);
        let [edge, _] = bisect(inside, outside, HALVINGS, own_side);
        Some(edge)
    }

    /// Height of the jump of `V` at `point`.
    fn jump(&self, point: &[f64; 6]) -> f64 {
        let [own, other] = self.sides.map(|side| self.regions[side].value.eval(point));
        (own - other).abs()
    }
}
