//! Integrals of the exact solution over the velocities.
//!
//! If particles pass jumps of `V`, the exact solution jumps along the velocities, and slow
//! particles leave filaments far narrower than an element. A rule with fixed points in each element
//! has errors like those of the run that is compared. So the velocity box is cut into panels, and
//! panels in which two rules differ are halved, the worst first:
//!
//! ```text
//! ∫ f dv over a panel      Boole's rule along each axis, 5 equal steps
//! error along an axis      |Boole − Simpson| on each line along it, summed with Boole's weights;
//!                          less for a formula that this shows to be smooth
//! error of the panel       the sum over its axes; halved across the axis with the largest error
//! error of the integral    (Σ error²)^½ over the panels, as their errors have either sign
//! ```
//!
//! Both rules use the same points, so that the error costs nothing, and halves reuse points of the
//! whole. A jump between two points makes the rules differ, wherever it lies.
//!
//! A filament between two points of the first panels is not seen. So in one dimension, integrals
//! that begin with more panels are compared at some places. They take over until
//! both agree, or the points are too many. Likewise, averages over some cells are compared with
//! those over parts of these cells. If they differ, filaments are looked for within every cell.
//! What differs at last is part of the error. All this is done for the end of a run only, where
//! errors are measured.
//!
//! Averages over a cell of degree 0 are means of integrals at Gauss points. In one dimension the
//! integrals at the faces are compared with the line through those at the Gauss points. Where they
//! differ, a front crosses the cell, which is then cut into panels itself, by the same rules.
//!
//! If `V` has one formula and the data are smooth, sums over the velocities of the grid are as
//! accurate with fewer points. In two and three dimensions they are used if they agree with
//! integrals by panels at some positions.

pub mod cells;
pub mod filaments;
pub mod grid_rule;
pub mod limits;
pub mod panels;
pub mod places;

use crate::base::quadrature::gauss_legendre;
use crate::parallel::communicator::Group;
use crate::problem::case::Case;
use crate::problem::grid::{Axis, MAX_DIMENSION};
use crate::run::exact::solution::ExactValues;
use crate::run::exact::velocities::cells::CellAverages;
use crate::run::exact::velocities::filaments::{ComparedPlaces, SeenFilaments};
use crate::run::exact::velocities::grid_rule::GridRule;
use crate::run::exact::velocities::limits::{
    MORE_POINTS, MOST_STEPS, PART_FOR_FORMULAS, SEARCHED, TOLERANCE, TRIALS, is_limited,
    max_points_in_all, max_points_per_integral, panels_of, points_across,
};
use crate::run::exact::velocities::panels::{PanelRule, VelocityIntegral, points_of};
use crate::run::exact::velocities::places::{at_all, centres};

/// The exact solution at a time, to be integrated over the velocity box.
pub struct VelocityIntegrals<'a> {
    rule: PanelRule<'a>,
    /// The velocities of the grid, if sums over them are accurate enough.
    grid_rule: Option<GridRule>,
    /// Whether filaments are looked for within cells of degree 0.
    within_cells: bool,
}

/// Limits the points of a `rule` to so many `paths` for `positions` integrals together, also in a
/// search for filaments, but to no fewer than twice those that each begins with.
fn limit_paths(rule: &mut PanelRule<'_>, paths: usize, positions: usize) {
    let each = (paths / positions.max(1)).max(2 * points_of(&rule.panels));
    rule.max_points_per_integral = rule.max_points_per_integral.min(each);
    rule.max_points_in_all = rule.max_points_in_all.min(paths / MORE_POINTS);
}

impl<'a> VelocityIntegrals<'a> {
    /// Integrals of the exact solution of `case` at `time`, for `positions` positions in space on
    /// all ranks. Collective over `world`, as the largest density is needed.
    pub fn new(
        world: &Group,
        values_of: &'a ExactValues<'a>,
        case: &'a Case,
        time: f64,
        positions: usize,
    ) -> Self {
        let d = case.space.dimension() - 1;
        let mut rule = PanelRule::new(values_of, &case.space, time, panels_of(case));
        rule.max_points_per_integral = max_points_per_integral(case, positions as f64) as usize;
        (rule.max_points_in_all, rule.is_limited) = (max_points_in_all(case), is_limited(case));
        let steps = values_of.steps(time);
        if steps > 1.0 {
            limit_paths(&mut rule, (MOST_STEPS / steps) as usize, positions);
        }
        let places = centres(&case.space, SEARCHED[d]);
        let sizes = at_all(world, &places, |position| rule.size_at(position));
        rule.tolerance = TOLERANCE[d] * sizes.iter().copied().fold(0.0, f64::max);
        if case.space.dimension() == 1 && time == case.end {
            let compared = ComparedPlaces::of(&places, &sizes);
            let SeenFilaments { rule, within_cells } =
                SeenFilaments::search(world, rule, positions, &compared);
            return Self { rule, grid_rule: None, within_cells };
        }
        let may_sum = case.potential.len() == 1 && TRIALS[d] > 0;
        let grid_rule = may_sum.then(|| GridRule::accepted(world, &rule, TRIALS[d])).flatten();
        if d > 0 && values_of.are_given() {
            rule.tolerance *= PART_FOR_FORMULAS;
        }
        Self { rule, grid_rule, within_cells: false }
    }

    /// The largest error of a density by sums over the velocities of the grid, if they are used.
    pub fn grid_error(&self) -> Option<f64> {
        self.grid_rule.as_ref().map(|rule| rule.error)
    }

    /// Integrals as [`new`](Self::new) makes them, for the nodes of the grid or averages over its
    /// cells. Collective.
    pub fn on_grid(
        world: &Group,
        values_of: &'a ExactValues<'a>,
        case: &'a Case,
        time: f64,
    ) -> Self {
        Self::new(world, values_of, case, time, case.space.space_cells())
    }

    /// The integrals at the space cells `cells`: averaged over a cell of degree 0, else at its
    /// node.
    pub fn on_cells(&self, case: &Case, cells: &[[usize; MAX_DIMENSION]]) -> Vec<VelocityIntegral> {
        let space = self.rule.space;
        if space.dimension() == 1 && space.x[0].nodes.degree == 0 {
            let averages = CellAverages { rule: &self.rule, within_cells: self.within_cells };
            return averages.of(cells);
        }
        let rule = gauss_legendre(points_across(case));
        // Points across a cell and their weights, by axis.
        let along = |axis: &Axis, j: usize| -> Vec<[f64; 2]> {
            match axis.nodes.degree {
                0 => rule.iter().map(|p| [axis.at(j as i64, p.node), 0.5 * p.weight]).collect(),
                _ => vec![[axis.inner_centre(j as i64), 1.0]],
            }
        };
        let average = |cell: &[usize; MAX_DIMENSION]| {
            let mut positions = vec![([0.0; MAX_DIMENSION], 1.0)];
            for (a, axis) in space.x.iter().enumerate() {
                let points = along(axis, cell[a]);
                let next = |(position, weight): &([f64; MAX_DIMENSION], f64)| {
                    let (mut position, weight) = (*position, *weight);
                    points.clone().into_iter().map(move |[x, part]| {
                        position[a] = x;
                        (position, weight * part)
                    })
                };
                positions = positions.iter().flat_map(next).collect();
            }
            let mut mean = VelocityIntegral::default();
            for (position, weight) in positions {
                mean.add(weight, &self.at(&position));
            }
            mean
        };
        cells.iter().map(average).collect()
    }

    /// The integral at a position of space.
    pub fn at(&self, position: &[f64; MAX_DIMENSION]) -> VelocityIntegral {
        match &self.grid_rule {
            Some(grid) => grid.at(&self.rule, position),
            None => self.rule.at(position),
        }
    }
}
