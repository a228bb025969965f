//! Limits on the cost of integrals over the velocities.

use crate::problem::case::Case;
use crate::problem::grid::{Axis, MAX_DIMENSION, PhaseSpace};
use crate::run::exact::velocities::panels::points_of;

/// Limits on the cost of integrals, for a dimension of space.
pub struct IntegrationLimits {
    /// Least number of panels along an axis to begin with, if the solution may jump.
    pub panels: usize,
    /// Least number of panels along an axis to begin with, if `V` has one formula.
    pub few_panels: usize,
    /// Panels are halved until the error is below this part of the largest density.
    pub tolerance: f64,
    /// Points that an integral may take, if that is more than twice those that it begins with.
    pub most: usize,
    /// Points that all integrals together may take.
    pub together: usize,
    /// Positions along an axis at which the largest density is searched.
    pub positions: usize,
    /// Positions along an axis at which sums over the velocities of the grid are compared.
    pub trials: usize,
}

/// Limits by dimension of space.
const LIMITS: [IntegrationLimits; MAX_DIMENSION] = [
    IntegrationLimits {
        panels: 64,
        few_panels: 64,
        tolerance: 1e-5,
        most: 2000,
        together: 500_000,
        positions: 64,
        trials: 0,
    },
    IntegrationLimits {
        panels: 8,
        few_panels: 2,
        tolerance: 1e-3,
        most: 2000,
        together: 1_000_000,
        positions: 6,
        trials: 3,
    },
    IntegrationLimits {
        panels: 2,
        few_panels: 2,
        tolerance: 5e-3,
        most: 6000,
        together: 500_000,
        positions: 3,
        trials: 2,
    },
];
/// Largest number of velocity cells of a panel along an axis, if the solution may jump.
const CELLS: usize = 4;
/// Largest number of velocity cells of a panel along an axis, if `V` has one formula.
const MANY_CELLS: usize = 8;
/// Integrals are compared with those that begin with so many times the panels, for filaments.
pub const FINER: usize = 4;
/// Number of equidistant places at which they are compared, and twice that of the densest.
pub const COMPARED: usize = 8;
/// Points a cell of phase space that all integrals together may take, if that is more than
/// [`IntegrationLimits::together`].
const POINTS_PER_CELL: usize = 3;
/// Points along an axis of a cell of degree 0 over which moments are averaged, if the limits allow
/// it.
pub const ACROSS: usize = 2;

impl IntegrationLimits {
    /// The limits in the dimension of `space`.
    pub fn of(space: &PhaseSpace) -> &'static Self {
        &LIMITS[space.dimension() - 1]
    }
}

/// Panels along each velocity axis of `case` to begin with.
pub fn panels_of(case: &Case) -> Vec<usize> {
    let limits = IntegrationLimits::of(&case.space);
    let panels = |axis: &Axis| match (axis.cells, case.potential.len()) {
        (1, _) => 1,
        (cells, 1) => cells.div_ceil(MANY_CELLS).max(limits.few_panels),
        (cells, _) => cells.div_ceil(CELLS).max(limits.panels),
    };
    case.space.v.iter().map(panels).collect()
}

/// Points that all integrals of a run of `case` may take together.
pub fn allowance(case: &Case) -> usize {
    let enough = enough(&case.space);
    case.most_exact_points.map_or(enough, |most| most.min(enough))
}

/// Whether a study with little time allows fewer points than integrals may take otherwise. Then
/// fronts within cells are not looked for.
pub fn is_limited(case: &Case) -> bool {
    allowance(case) < enough(&case.space)
}

fn enough(space: &PhaseSpace) -> usize {
    let least = IntegrationLimits::of(space).together;
    space.cells().saturating_mul(POINTS_PER_CELL).max(least)
}

/// Points of each cell of degree 0 along an axis, over which the moments of `case` are averaged.
pub fn points_across(case: &Case) -> usize {
    let space = &case.space;
    let cells = space.x.iter().filter(|axis| axis.nodes.degree == 0).count() as u32;
    let positions = space.space_cells().saturating_mul(ACROSS.pow(cells));
    let fits = positions.saturating_mul(points_of(&panels_of(case))) <= allowance(case);
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
    let positions = IntegrationLimits::of(&case.space).positions;
    let compared = (COMPARED + COMPARED / 2) * (1 + FINER);
    ((positions + compared) * points_of(&panels_of(case))) as f64
}

/// All points are shared out among at least so many positions. On a few cells a position would
/// otherwise take far more points than it needs.
const FEWEST_POSITIONS: f64 = 64.0;

/// Points that an integral may take of so many `positions` on the grid of `case`.
pub fn most_at(case: &Case, positions: f64) -> f64 {
    let first = points_of(&panels_of(case));
    let least = if is_limited(case) {
        first
    } else {
        IntegrationLimits::of(&case.space).most.max(2 * first)
    };
    (least as f64).max((allowance(case) as f64 / positions.max(FEWEST_POSITIONS)).floor())
}

/// About the largest number of points that integrals at so many `positions` take. In one dimension
/// a jump takes few points beyond the first ones; filaments take more, [`FINER`] times as many
/// where they are found at once. In more dimensions it may be all that they are allowed.
pub fn expected_points(case: &Case, positions: f64) -> f64 {
    match case.space.dimension() {
        1 => FINER as f64 * positions * points_of(&panels_of(case)) as f64 + points_to_search(case),
        _ => positions * most_at(case, positions),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CASE: &str = "[[axis]]\nx = { lower = 0, upper = 1, cells = 10 }\n\
        v = { lower = -1, upper = 1, cells = 10 }\n[[potential]]\nvalue = \"x^2\"\n\
        [initial]\nf = \"1\"\n[time]\nend = 1\n";

    /// A study with little time takes fewer points, but at least those of an integral.
    #[test]
    fn a_study_limits_the_points() {
        let case = Case::parse("limits", CASE, &[]).expect("a case");
        assert_eq!(allowance(&case), LIMITS[0].together);
        let limited = Case { most_exact_points: Some(5000), ..case.clone() };
        assert_eq!(allowance(&limited), 5000);
        let one = points_of(&panels_of(&case));
        assert!(is_limited(&limited) && !is_limited(&case));
        assert_eq!(most_at(&limited, 1000.0), one as f64);
        assert!(most_at(&case, 1000.0) >= (2 * one) as f64);
        assert!(most_at(&limited, 1.0) < most_at(&case, 1.0));
        let more = Case { most_exact_points: Some(usize::MAX), ..case.clone() };
        assert!(allowance(&more) == allowance(&case) && !is_limited(&more));
    }
}
