//! Warnings of formulas and tables that are zero at every point of the grid: data that lie outside
//! of the box or between its points, or a mistake such as `exp(-(x - 90)^2)`. A constant 0 is
//! meant.

use crate::base::row_major::indices;
use crate::problem::case::{Case, Inflow, TIME, TableOf};
use crate::problem::formula::Expression;
use crate::problem::grid::{AxisEnd, PhaseSpace, coordinate, for_each_cell};
use crate::problem::potential::{is_one_piece, region, space_point};

/// Largest number of points at which a formula is evaluated; no warning on larger grids.
const MOST_POINTS: usize = 1 << 20;

/// Warnings of initial data, inflow and branches of `V` that vanish on the grid.
pub(super) fn vanishing_parts(case: &Case) -> Vec<String> {
    let space = case.space.whole();
    if space.cells() > MOST_POINTS {
        return Vec::new();
    }
    let found = [initial(case, &space), inflow(case, &space)].into_iter().flatten();
    found.chain(potentials(case, &space)).collect()
}

/// The warning that `key` vanishes at the points that are meant.
fn warning(key: &str, points: &str) -> String {
    format!(
        "{key} is zero at {points}, and is not the constant 0: does it lie outside of the box, or \
         between the points of the grid?"
    )
}

/// Whether `formula` is no constant, and zero at all `points`.
fn vanishes(formula: &Expression, points: impl Iterator<Item = [f64; 6]>, time: f64) -> bool {
    formula.constant().is_none() && formula.at_each(points, time).all(|value| value == 0.0)
}

/// The warning of initial data. Where nothing enters, the ledger warns of a solution that is zero.
fn initial(case: &Case, space: &PhaseSpace) -> Option<String> {
    if !case.starts_anew() || case.is_measure_valued() || !case.enters() {
        return None;
    }
    let formula = &case.fields[0].initial;
    let points = (0..space.cells()).map(|k| space.point_in_element(&space.cell(k)));
    let key = match formula.table() {
        Some(_) => TableOf::Initial.key(),
        None => "initial.f".to_owned(),
    };
    vanishes(formula, points, 0.0).then(|| warning(&key, "every point of the grid"))
}

/// The warning of an inflow without `t`: pulses may be shorter than any steps in time.
fn inflow(case: &Case, space: &PhaseSpace) -> Option<String> {
    let Inflow::Formula(formula) = &case.fields[0].inflow else { return None };
    if formula.depends_on(TIME) {
        return None;
    }
    let ends = space.open_ends();
    let jumps = !is_one_piece(&case.potential);
    let points = ends.iter().flat_map(|end| points_at_end(space, *end, jumps));
    let nothing = vanishes(formula, points, case.start_time);
    nothing.then(|| warning(case.inflow_key(), "all ends of the box"))
}

/// The points at which what enters through `end` is evaluated: centres of ghost cells, and those
/// just outside of the end, for the elements and the exact solution. Where `V` `jumps`, particles
/// come from beyond an end of the velocity box: up to half its width, in some steps.
fn points_at_end(
    space: &PhaseSpace,
    end: AxisEnd,
    jumps: bool,
) -> impl Iterator<Item = [f64; 6]> + '_ {
    const STEPS: usize = 16;
    let axis = space.axis(end.axis);
    let ghost = if end.upper { axis.cells as i64 } else { -1 };
    let mut positions = vec![axis.centre(ghost), axis.just_outside(end.upper)];
    if jumps && end.axis >= space.dimension() {
        let half = 0.5 * (axis.upper - axis.lower);
        let (from, sign) = if end.upper { (axis.upper, 1.0) } else { (axis.lower, -1.0) };
        positions.extend((1..=STEPS).map(|k| from + sign * half * k as f64 / STEPS as f64));
    }
    let mut lengths = space.shape();
    lengths[end.axis] = 1;
    let at = coordinate(space.dimension(), end.axis);
    (0..lengths.iter().product()).flat_map(move |k| {
        let mut cell = [0; 6];
        for (index, along) in cell.iter_mut().zip(indices(k, &lengths)) {
            *index = along;
        }
        let point = space.point_in_element(&cell);
        let at_position = |position: &f64| {
            let mut point = point;
            point[at] = *position;
            point
        };
        positions.iter().map(at_position).collect::<Vec<_>>()
    })
}

/// The warnings of branches of `V` that vanish at the centres and faces of all elements in which
/// they hold.
fn potentials(case: &Case, space: &PhaseSpace) -> Vec<String> {
    let mut points: Vec<Vec<[f64; 6]>> = vec![Vec::new(); case.potential.len()];
    let space = space.by_elements();
    for_each_cell(&space.space_ranges(), |cell| {
        let centre = space_point(&space.x, cell);
        // Undefined conditions are an error before.
        let Ok(own) = region(&case.potential, &centre) else { return };
        points[own].push(centre);
        for (a, axis) in space.x.iter().enumerate() {
            for side in [-0.5, 0.5] {
                let mut face = centre;
                face[a] += side * axis.width();
                points[own].push(face);
            }
        }
    });
    let regions = case.potential.iter().zip(points).enumerate();
    let vanishing = regions.filter(|(_, (region, points))| {
        !points.is_empty() && vanishes(&region.value, points.iter().copied(), 0.0)
    });
    let warning = |i| warning(&case.potential_key(i), "every point of its region");
    vanishing.map(|(i, _)| warning(i)).collect()
}
