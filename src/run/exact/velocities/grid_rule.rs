//! Sums over the velocities of the grid, in place of integrals by panels.

use crate::matrix::observables::{MOMENTS, add_mass};
use crate::parallel::communicator::Group;
use crate::problem::grid::{MAX_DIMENSION, for_each_cell};
use crate::run::exact::velocities::panels::{PanelRule, VelocityIntegral, phase_point};
use crate::run::exact::velocities::places::{at_all, centres};

/// Tolerance of the integrals with which sums over the grid are compared, as a part of the usual
/// tolerance.
const TRIAL_TOLERANCE: f64 = 0.01;
/// Factor on the number of points that these integrals may take.
const TRIAL_POINTS: usize = 10;

/// The velocities of the grid, as points of a rule.
pub struct GridRule {
    /// Velocities and weights.
    points: Vec<([f64; MAX_DIMENSION], f64)>,
    /// The largest error of a density in the comparison.
    pub error: f64,
}

impl GridRule {
    /// The velocities of the grid, if densities by them are within the tolerance of those
    /// `by_panels`, at up to `most` positions along each axis. Collective.
    pub fn accepted(world: &Group, by_panels: &PanelRule<'_>, most: usize) -> Option<Self> {
        let axes = &by_panels.space.v;
        let mut points = Vec::new();
        for_each_cell(&by_panels.space.velocity_ranges(), |j| {
            let (mut velocity, mut weight) = ([0.0; MAX_DIMENSION], 1.0);
            for (a, axis) in axes.iter().enumerate() {
                velocity[a] = axis.centre(j[a] as i64);
                weight *= axis.weight(j[a]);
            }
            points.push((velocity, weight));
        });
        let rule = Self { points, error: 0.0 };
        let tight = PanelRule {
            tolerance: TRIAL_TOLERANCE * by_panels.tolerance,
            max_points_per_integral: TRIAL_POINTS * by_panels.max_points_per_integral,
            ..by_panels.clone()
        };
        let errors = at_all(world, &centres(by_panels.space, most), |position| {
            (rule.at(by_panels, position).moments[0] - tight.at(position).moments[0]).abs()
        });
        let error = errors.into_iter().fold(0.0, f64::max);
        (error <= by_panels.tolerance).then_some(Self { error, ..rule })
    }

    /// The integral at a position of the exact solution that is integrated `by_panels`.
    pub fn at(
        &self,
        by_panels: &PanelRule<'_>,
        position: &[f64; MAX_DIMENSION],
    ) -> VelocityIntegral {
        let points: Vec<[f64; 6]> =
            self.points.iter().map(|(velocity, _)| phase_point(position, *velocity)).collect();
        let values = by_panels.values_of.values_at(&points, by_panels.time);
        let mut moments = [0.0; MOMENTS];
        for (f, (velocity, weight)) in values.iter().zip(&self.points) {
            add_mass(&mut moments, velocity, weight * f);
        }
        VelocityIntegral { moments, error: self.error }
    }
}
