//! A result at points between the centres or nodes of its grid: the polynomial of each element
//! along axes of a higher degree, interpolated between centres along those of degree 0, but not
//! across jumps of `V`.

use crate::problem::case::Case;
use crate::problem::grid::{MAX_DIMENSION, PhaseSpace, coordinate};
use crate::problem::potential::{Potential, is_one_piece};
use crate::run::errors::ResultOnShare;
use std::ops::Range;

/// About the largest number of products by which a result is evaluated.
const MOST_PRODUCTS: usize = 20_000_000;

/// Whether some axes have degree 0 and others do not.
pub fn is_mixed(space: &PhaseSpace) -> bool {
    let degrees = space.axes().filter(|axis| axis.cells > 1).map(|axis| axis.nodes.degree);
    let (of_cells, of_elements): (Vec<_>, Vec<_>) = degrees.partition(|degree| *degree == 0);
    !of_cells.is_empty() && !of_elements.is_empty()
}

/// About the largest number of points at which `f_h` is evaluated.
pub fn most_values(space: &PhaseSpace) -> usize {
    let products: usize = space.axes().map(|axis| axis.nodes.count().max(2)).product();
    MOST_PRODUCTS / products
}

/// `f_h` at `points`, the same on all ranks. Collective.
pub fn values_at(result: &ResultOnShare<'_>, points: &[[f64; 6]]) -> Vec<f64> {
    let space = &result.case.space;
    let n = space.dimension();
    let velocities = space.velocity_cells();
    let faces = FacesWithJumps::new(result.case);
    let corners = space.x.iter().filter(|axis| axis.nodes.degree == 0).count();
    // Each part of a value is known on one rank.
    let mut parts = vec![0.0; points.len() << corners];
    for (point, parts) in points.iter().zip(parts.chunks_mut(1 << corners)) {
        let of_axis = |k: usize| {
            interpolation(space, k, point[coordinate(n, k)], |face| faces.at(point, k, face))
        };
        let along: Vec<Vec<(usize, f64)>> = (0..2 * n).map(of_axis).collect();
        let of_velocity = products(&along[n..], |k| 0..space.v[k].cells);
        for (corner, part) in parts.iter_mut().enumerate() {
            // Of an axis of degree 0 a corner has one of two cells.
            let mut bit = 0;
            let entries = space.x.iter().zip(&along).map(|(axis, entries)| {
                if axis.nodes.degree > 0 {
                    return entries.clone();
                }
                let one = entries[corner >> bit & 1];
                bit += 1;
                vec![one]
            });
            let entries: Vec<Vec<(usize, f64)>> = entries.collect();
            for (place, weight) in products(&entries, |k| result.share[k].clone()) {
                let here = &result.field[place * velocities..][..velocities];
                *part += weight * of_velocity.iter().map(|(v, w)| w * here[*v]).sum::<f64>();
            }
        }
    }
    result.world.gathered(parts).chunks(1 << corners).map(|parts| parts.iter().sum()).collect()
}

/// The faces of elements at which `V` jumps, so that `f` does.
struct FacesWithJumps {
    elements: PhaseSpace,
    /// `V` in the elements; `None` where it does not jump, or is not known.
    potential: Option<Potential>,
}

impl FacesWithJumps {
    fn new(case: &Case) -> Self {
        let elements = case.space.by_elements();
        let has_cells = case.space.x.iter().any(|axis| axis.nodes.degree == 0);
        let may_jump = !is_one_piece(&case.potential) || case.space.periodic.contains(&true);
        // Where V is not finite on other cells, f counts as continuous.
        let whole = || Potential::whole(&Case { space: elements.clone(), ..case.clone() }).ok();
        let potential = if has_cells && may_jump { whole() } else { None };
        Self { elements, potential }
    }

    /// Whether `V` jumps at the lower face of element `face` along axis `a` of space, in the
    /// elements around `point` along the other axes.
    fn at(&self, point: &[f64; 6], a: usize, face: usize) -> bool {
        let n = self.elements.dimension();
        let Some(potential) = self.potential.as_ref().filter(|_| a < n) else {
            return false;
        };
        let mut element = [0; MAX_DIMENSION];
        for (b, axis) in self.elements.x.iter().enumerate() {
            element[b] = if b == a { face } else { axis.element_at(point[b]) };
        }
        potential.jump_below(&element[..n], a) != 0.0
    }
}

/// The cells along axis `k` of the `2n` by which a function is interpolated at `x`, with weights.
///
/// An axis of degree 0 has two cells: the one around `x`, and its neighbour on the side of `x`. If
/// `jumps` holds for the face between them, or an end of the box is there, the line through the
/// cell and its other neighbour is continued.
fn interpolation(
    space: &PhaseSpace,
    k: usize,
    x: f64,
    jumps: impl Fn(usize) -> bool,
) -> Vec<(usize, f64)> {
    let axis = space.axis(k);
    let position = axis.position(x);
    if axis.nodes.degree > 0 {
        let element = axis.element_at(x);
        let values = axis.nodes.reference().values_at(2.0 * (position - element as f64) - 1.0);
        let first = element * axis.nodes.count();
        return values.into_iter().enumerate().map(|(m, weight)| (first + m, weight)).collect();
    }
    let (own, n) = (axis.element_at(x), space.dimension());
    let neighbour = |above: bool| {
        let beside = if above { own as i64 + 1 } else { own as i64 - 1 };
        let beside = match k.checked_sub(n) {
            None => space.wrap(k, beside)?,
            Some(_) => usize::try_from(beside).ok().filter(|j| *j < axis.cells)?,
        };
        let face = if above { beside } else { own };
        (!jumps(face)).then_some(beside)
    };
    let from_centre = position - 0.5 - own as f64;
    let ahead = from_centre > 0.0;
    let part = from_centre.abs();
    match (neighbour(ahead), neighbour(!ahead)) {
        (Some(beside), _) => vec![(own, 1.0 - part), (beside, part)],
        (None, Some(behind)) => vec![(own, 1.0 + part), (behind, -part)],
        (None, None) => vec![(own, 1.0), (own, 0.0)],
    }
}

/// Places and weights of the products of `entries`, one of each axis, in the row-major box of the
/// `range` of each axis; without those that are not in it.
fn products(
    entries: &[Vec<(usize, f64)>],
    range: impl Fn(usize) -> Range<usize>,
) -> Vec<(usize, f64)> {
    let mut found = vec![(0, 1.0)];
    for (k, entries) in entries.iter().enumerate() {
        let range = range(k);
        let within: Vec<_> = entries.iter().filter(|(j, _)| range.contains(j)).collect();
        found = (found.iter())
            .flat_map(|(place, weight)| {
                let next =
                    |(j, w): &&(usize, f64)| (place * range.len() + (j - range.start), weight * w);
                within.iter().map(next).collect::<Vec<_>>()
            })
            .collect();
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::problem::element::Nodes;
    use crate::problem::grid::Axis;

    fn value(space: &PhaseSpace, k: usize, x: f64, f: impl Fn(f64) -> f64) -> f64 {
        let axis = space.axis(k);
        let entries = interpolation(space, k, x, |face| k == 0 && face == JUMP);
        entries.iter().map(|(j, w)| w * f(axis.centre(*j as i64))).sum()
    }

    /// The cell above a face at which functions jump in tests.
    const JUMP: usize = 3;

    /// Lines are interpolated between the centres of cells, and beyond them next to jumps and ends;
    /// polynomials in the elements of their degree.
    #[test]
    fn polynomials_are_interpolated() {
        let x = Axis::new(-1.0, 2.0, 7);
        let v = Axis::new(-2.0, 1.0, 4).with_nodes(Nodes::of_velocity(3));
        let space = PhaseSpace { x: vec![x], v: vec![v], periodic: [false; MAX_DIMENSION] };
        let jump = space.x[0].face(JUMP as i64);
        for at in [-0.99, -0.7, 0.1, 0.13, jump - 0.01, jump, jump + 0.01, 1.4, 2.0] {
            let line = |x: f64| if x < jump { 3.0 - 2.0 * x } else { 7.0 + x };
            assert!((value(&space, 0, at, line) - line(at)).abs() < 1e-13, "{at}");
            let cubic = |v: f64| 1.0 + v * v * (v - 0.5);
            let at = at - 1.001;
            assert!((value(&space, 1, at, cubic) - cubic(at)).abs() < 1e-12, "{at}");
        }
    }

    #[test]
    fn products_leave_out_what_another_rank_has() {
        let entries = [vec![(1, 0.25), (2, 0.75)], vec![(4, 0.5), (5, 0.5)]];
        let found = products(&entries, |k| [2..4, 3..6][k].clone());
        assert_eq!(found, [(1, 0.375), (2, 0.375)]);
    }
}
