//! Limits on the cost of integrals over the velocities; arrays are by dimension of space.

use crate::problem::case::Case;
use crate::problem::grid::{Axis, MAX_DIMENSION, PhaseSpace};
use crate::run::exact::velocities::panels::points_of;

/// Least number of panels along an axis to begin with, if the solution may jump.
const PANELS: [usize; MAX_DIMENSION] = [64, 8, 2];
/// Least number of panels along an axis to begin with, if `V` has one formula.
const FEW_PANELS: [usize; MAX_DIMENSION] = [64, 2, 2];
/// Panels are halved until the error is below this part of the largest density.
pub const TOLERANCE: [f64; MAX_DIMENSION] = [1e-5, 1e-3, 5e-3];
/// In two and three dimensions, of a formula the error may be this part of that: its values are
/// cheap.
pub const PART_FOR_FORMULAS: f64 = 0.01;
/// Points that an integral may take, if that is more than twice those that it begins with.
const MOST_POINTS: [usize; MAX_DIMENSION] = [2000, 2000, 6000];
/// Points that all integrals together may take.
const POINTS_IN_ALL: [usize; MAX_DIMENSION] = [500_000, 1_000_000, 500_000];
/// Positions along an axis at which the largest density is searched.
pub const SEARCHED: [usize; MAX_DIMENSION] = [64, 6, 3];
/// Positions along an axis at which sums over the velocities of the grid are compared.
pub const TRIALS: [usize; MAX_DIMENSION] = [0, 3, 2];
/// Largest number of velocity cells of a panel along an axis, if the solution may jump.
const CELLS: usize = 4;
/// Largest number of velocity cells of a panel along an axis, if `V` has one formula.
const MANY_CELLS: usize = 8;
/// After a search for filaments all integrals together may begin with so many times the points that
/// they may take otherwise.
pub const MORE_POINTS: usize = 4;
/// Integrals are compared with those that begin with so many times the panels, for filaments.
pub const FINER: usize = 4;
/// Number of equidistant places at which they are compared, and twice that of the densest.
pub const COMPARED: usize = 8;
/// Points a cell of phase space that all integrals together may take, if that is more than
/// [`POINTS_IN_ALL`].
const POINTS_PER_CELL: usize = 3;
/// Cells that the paths of the first panels of all integrals may pass together, where they pass
/// many. With the panels that are halved this takes half a minute on one core.
pub const MOST_STEPS: f64 = 5e7;
/// Points along an axis of a cell of degree 0 over which moments are averaged, if the limits allow
/// it.
pub const ACROSS: usize = 2;

/// Panels along each velocity axis of `case` to begin with.
pub fn panels_of(case: &Case) -> Vec<usize> {
    let d = case.space.dimension() - 1;
    let panels = |axis: &Axis| match (axis.cells, case.potential.len()) {
        (1, _) => 1,
        (cells, 1) => cells.div_ceil(MANY_CELLS).max(FEW_PANELS[d]),
        (cells, _) => cells.div_ceil(CELLS).max(PANELS[d]),
    };
    case.space.v.iter().map(panels).collect()
}

/// Points that all integrals of a run of `case` may take together.
pub fn max_points_in_all(case: &Case) -> usize {
    let points = points_without_study(&case.space);
    case.study.most_exact_points.map_or(points, |most| most.min(points))
}

/// Whether a study with little time allows fewer points than integrals may take otherwise. Then
/// fronts within cells are not looked for.
pub fn is_limited(case: &Case) -> bool {
    max_points_in_all(case) < points_without_study(&case.space)
}

fn points_without_study(space: &PhaseSpace) -> usize {
    space.cells().saturating_mul(POINTS_PER_CELL).max(POINTS_IN_ALL[space.dimension() - 1])
}

/// Points of each cell of degree 0 along an axis, over which the moments of `case` are averaged.
pub fn points_across(case: &Case) -> usize {
    let space = &case.space;
    let cells = space.x.iter().filter(|axis| axis.nodes.degree == 0).count() as u32;
    let positions = space.space_cells().saturating_mul(ACROSS.pow(cells));
    let fits = positions.saturating_mul(points_of(&panels_of(case))) <= max_points_in_all(case);
    if fits || space.dimension() == 1 { ACROSS } else { 1 }
}

/// About the number of points that the averages over the cells of `case` take, as a float: it may
/// exceed every integer.
pub fn expected_points_of_averages(case: &Case) -> f64 {
    // In one dimension with one face of each cell.
    let faces = usize::from(case.space.dimension() == 1 && case.space.x[0].nodes.degree == 0);
    let positions =
        case.space.x.iter().map(|axis| ((points_across(case) + faces) * axis.cells) as f64);
    positions.product::<f64>() * points_of(&panels_of(case)) as f64 + points_to_search(case)
}

/// Points by which the largest density is found, and in one dimension filaments are looked for.
fn points_to_search(case: &Case) -> f64 {
    if case.space.dimension() > 1 {
        return 0.0;
    }
    let compared = (COMPARED + COMPARED / 2) * (1 + FINER);
    ((SEARCHED[0] + compared) * points_of(&panels_of(case))) as f64
}

/// All points are shared out among at least so many positions. On a few cells a position would
/// otherwise take far more points than it needs.
const FEWEST_POSITIONS: f64 = 64.0;

/// Points that an integral may take of so many `positions` on the grid of `case`.
pub fn max_points_per_integral(case: &Case, positions: f64) -> f64 {
    let first = points_of(&panels_of(case));
    let least = if is_limited(case) {
        first
    } else {
        MOST_POINTS[case.space.dimension() - 1].max(2 * first)
    };
    (least as f64).max((max_points_in_all(case) as f64 / positions.max(FEWEST_POSITIONS)).floor())
}

/// About the largest number of points that integrals at so many `positions` take. In one dimension
/// a jump takes few points beyond the first ones; filaments take more, [`FINER`] times as many
/// where they are found at once. In more dimensions it may be all that they are allowed.
pub fn expected_points(case: &Case, positions: f64) -> f64 {
    match case.space.dimension() {
        1 => FINER as f64 * positions * points_of(&panels_of(case)) as f64 + points_to_search(case),
        _ => positions * max_points_per_integral(case, positions),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::problem::case::StudySettings;

    const CASE: &str = "[[axis]]\nx = { lower = 0, upper = 1, cells = 10 }\n\
        v = { lower = -1, upper = 1, cells = 10 }\n[[potential]]\nvalue = \"x^2\"\n\
        [initial]\nf = \"1\"\n[time]\nend = 1\n";

    /// A study with little time takes fewer points, but at least those of an integral.
    #[test]
    fn a_study_limits_the_points() {
        let case = Case::parse("limits", CASE, &[]).expect("a case");
        let limited_to = |most| {
            let study = StudySettings { most_exact_points: Some(most), ..case.study };
            Case { study, ..case.clone() }
        };
        assert_eq!(max_points_in_all(&case), POINTS_IN_ALL[0]);
        let limited = limited_to(5000);
        assert_eq!(max_points_in_all(&limited), 5000);
        let one = points_of(&panels_of(&case));
        assert!(is_limited(&limited) && !is_limited(&case));
        assert_eq!(max_points_per_integral(&limited, 1000.0), one as f64);
        assert!(max_points_per_integral(&case, 1000.0) >= (2 * one) as f64);
        assert!(max_points_per_integral(&limited, 1.0) < max_points_per_integral(&case, 1.0));
        let more = limited_to(usize::MAX);
        assert!(max_points_in_all(&more) == max_points_in_all(&case) && !is_limited(&more));
    }
}
