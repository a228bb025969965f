//! Integrals of the exact solution over the velocities.
//!
//! If particles pass jumps of `V`, the exact solution jumps along the velocities, and slow
//! particles leave filaments far narrower than an element. A rule with fixed points in each element
//! has errors like those of the run that is compared. So the velocity box is cut into panels, and
//! panels in which two rules differ are halved, the worst first:
//!
//! ```text
//! ∫ f dv over a panel      Boole's rule along each axis, 5 equal steps
//! error along an axis      |Boole − Simpson| on each line along it, summed with Boole's weights
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

use crate::base::quadrature::gauss_legendre;
use crate::base::row_major::number;
use crate::matrix::observables::MOMENTS;
use crate::parallel::communicator::Group;
use crate::parallel::partition::split;
use crate::problem::case::Case;
use crate::problem::grid::{Axis, MAX_DIMENSION, PhaseSpace, for_each_cell};
use crate::run::exact::solution::ExactValues;

/// Points of a panel along an axis.
const POINTS: usize = 5;
/// Boole's rule on `[0, 1]`.
const BOOLE: [f64; POINTS] = [7.0 / 90.0, 32.0 / 90.0, 12.0 / 90.0, 32.0 / 90.0, 7.0 / 90.0];
/// Simpson's rule at the same points.
const SIMPSON: [f64; POINTS] = [1.0 / 6.0, 0.0, 4.0 / 6.0, 0.0, 1.0 / 6.0];

/// Limits on the cost of integrals, for a dimension of space.
struct IntegrationLimits {
    /// Least number of panels along an axis to begin with, if the solution may jump.
    panels: usize,
    /// Least number of panels along an axis to begin with, if `V` has one formula.
    few_panels: usize,
    /// Panels are halved until the error is below this part of the largest density.
    tolerance: f64,
    /// Points that an integral may take, if that is more than twice those that it begins with.
    most: usize,
    /// Points that all integrals together may take.
    together: usize,
    /// Positions along an axis at which the largest density is searched.
    positions: usize,
    /// Positions along an axis at which sums over the velocities of the grid are compared.
    trials: usize,
}

/// Limits by dimension of space.
const EFFORTS: [IntegrationLimits; MAX_DIMENSION] = [
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
/// Points a cell of phase space that all integrals together may take, if that is more than
/// [`IntegrationLimits::together`].
const POINTS_PER_CELL: usize = 3;
/// Points along an axis of a cell of degree 0 over which moments are averaged, if the limits allow
/// it.
const ACROSS: usize = 2;
/// In one dimension a cell in which the density at a face deviates from a line by more than this
/// part of the largest density is cut into panels.
const BENT_CELL: f64 = 5e-3;
/// Least number of positions that such a cell may take, and largest.
const POSITIONS: [usize; 2] = [12, 64];
/// One in so many cells is expected to be cut.
const BENT_CELLS: usize = 10;
/// A face is approached up to this part of a cell, as the exact density may jump there.
const BEFORE_FACE: f64 = 1e-9;
/// Tolerance of the integrals with which sums over the grid are compared, as a part of the usual
/// tolerance.
const TRIAL_TOLERANCE: f64 = 0.01;
/// Factor on the number of points that these integrals may take.
const TRIAL_POINTS: usize = 10;
/// In one dimension integrals are compared with those that begin with so many times the panels.
const FINER: usize = 4;
/// Largest difference between them, relative to the density (L1), if the points allow it.
const UNSEEN: f64 = 1e-4;
/// All integrals together may begin with so many times the points that they may take otherwise.
const MORE_POINTS: usize = 4;
/// Number of equidistant places at which they are compared, and twice that of the densest.
const COMPARED: usize = 8;
/// Places in a cell of degree 0, on `[−1, 1]`, at which a filament is looked for.
const WITHIN: [f64; 3] = [-0.8, 0.0, 0.8];
/// Panels are halved together if their errors are at least this part of the largest.
const NEAR_LARGEST: f64 = 0.25;

/// `value` at all `places`, of which each rank computes a part. Collective.
fn at_all(
    world: &Group,
    places: &[[f64; MAX_DIMENSION]],
    value: impl Fn(&[f64; MAX_DIMENSION]) -> f64,
) -> Vec<f64> {
    let mut found = vec![0.0; places.len()];
    for k in split(&(0..places.len()), world.size(), world.rank()) {
        found[k] = value(&places[k]);
    }
    world.gathered(found)
}

/// Places at which densities by different integrals are compared: the densest of some, and some
/// at equal distances, as filaments that are not seen may lie where nothing is seen.
struct ComparedPlaces {
    positions: Vec<[f64; MAX_DIMENSION]>,
    /// Number of places at equal distances, which are the first.
    equidistant: usize,
    /// Mean of `∫ |f| dv` over all places, and over the densest.
    sizes: [f64; 2],
}

impl ComparedPlaces {
    /// Some of `positions`, where `∫ |f| dv` is `sizes`.
    fn of(positions: &[[f64; MAX_DIMENSION]], sizes: &[f64]) -> Self {
        let all = sizes.len();
        let mut chosen: Vec<usize> = (0..all).step_by(all.div_ceil(COMPARED)).collect();
        let equidistant = chosen.len();
        let mut densest: Vec<usize> = (0..all).filter(|k| sizes[*k] > 0.0).collect();
        densest.sort_by(|a, b| sizes[*b].total_cmp(&sizes[*a]));
        densest.truncate(COMPARED / 2);
        let mean = |of: &[usize]| -> f64 {
            let known = of.iter().map(|k| sizes[*k]).filter(|size| size.is_finite());
            known.sum::<f64>() / of.len().max(1) as f64
        };
        let means = [mean(&(0..all).collect::<Vec<_>>()), mean(&densest)];
        chosen.extend(densest);
        let positions = chosen.iter().map(|k| positions[*k]).collect();
        Self { positions, equidistant, sizes: means }
    }

    /// The mean of `|found − expected|` relative to that of `∫ |f| dv`, the larger one of both
    /// kinds of places. Places where a density is not defined do not count.
    fn difference(&self, found: &[f64], expected: &[f64]) -> f64 {
        let differences: Vec<f64> =
            found.iter().zip(expected).map(|(found, expected)| (found - expected).abs()).collect();
        let (equidistant, densest) = differences.split_at(self.equidistant);
        let part = |(of, size): (&[f64], f64)| {
            let sum: f64 = of.iter().filter(|difference| difference.is_finite()).sum();
            let part = sum / of.len().max(1) as f64 / size;
            if part.is_finite() { part.min(1.0) } else { 0.0 }
        };
        [(equidistant, self.sizes[0]), (densest, self.sizes[1])]
            .map(part)
            .into_iter()
            .fold(0.0, f64::max)
    }
}

/// An integral over the velocities at a position.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct VelocityIntegral {
    /// Density, momentum and kinetic energy, in the order of [`MOMENTS`].
    pub moments: [f64; MOMENTS],
    /// An estimate of the density's error.
    pub error: f64,
}

impl VelocityIntegral {
    /// Adds `weight` times another integral.
    fn add(&mut self, weight: f64, other: &Self) {
        self.error += weight * other.error;
        for (sum, moment) in self.moments.iter_mut().zip(other.moments) {
            *sum += weight * moment;
        }
    }

    /// The mean over an interval of integrals at [`POINTS`] equal steps, by `rule`.
    fn mean(values: &[Self; POINTS], rule: [f64; POINTS]) -> Self {
        let mut mean = Self::default();
        values.iter().zip(rule).for_each(|(value, weight)| mean.add(weight, value));
        mean
    }
}

/// A part of a cell in one dimension.
struct CellPanel {
    lower: f64,
    upper: f64,
    /// Integrals at its points.
    values: [VelocityIntegral; POINTS],
}

impl CellPanel {
    /// The difference of two rules, as a mean over the panel.
    fn error(&self) -> f64 {
        let [boole, simpson] =
            [BOOLE, SIMPSON].map(|rule| VelocityIntegral::mean(&self.values, rule).moments[0]);
        (boole - simpson).abs()
    }

    fn width(&self) -> f64 {
        self.upper - self.lower
    }
}

/// A part of the velocity box.
struct VelocityPanel {
    lower: [f64; MAX_DIMENSION],
    width: [f64; MAX_DIMENSION],
    /// `f` at its points, the last axis fastest.
    values: Vec<f64>,
    /// The error of the integral over it.
    error: f64,
    /// The axis with the largest part of that error.
    axis: usize,
}

/// The velocities of the grid, as points of a rule.
struct GridRule {
    /// Velocities and weights.
    points: Vec<([f64; MAX_DIMENSION], f64)>,
    /// The largest error of a density in the comparison.
    error: f64,
}

/// The exact solution at a time, to be integrated over the velocity box.
pub struct VelocityIntegrals<'a> {
    values_of: &'a ExactValues<'a>,
    time: f64,
    space: &'a PhaseSpace,
    /// Panels to begin with, by axis.
    panels: Vec<usize>,
    /// Boole's weights at the points of a panel.
    weights: Vec<f64>,
    /// The allowed error of a density.
    tolerance: f64,
    /// Points that an integral may take.
    most: usize,
    /// The part of a density that is expected to lie between the points of the first panels.
    unseen: f64,
    /// Whether filaments are looked for within cells of degree 0.
    within_cells: bool,
    /// The velocities of the grid, if sums over them are accurate enough.
    grid_rule: Option<GridRule>,
}

/// Panels along each velocity axis of `case` to begin with.
fn panels_of(case: &Case) -> Vec<usize> {
    let effort = &EFFORTS[case.space.dimension() - 1];
    let panels = |axis: &Axis| match (axis.cells, case.potential.len()) {
        (1, _) => 1,
        (cells, 1) => cells.div_ceil(MANY_CELLS).max(effort.few_panels),
        (cells, _) => cells.div_ceil(CELLS).max(effort.panels),
    };
    case.space.v.iter().map(panels).collect()
}

/// Number of points of a box of `panels` panels along each axis; neighbours share points.
fn points_of(panels: &[usize]) -> usize {
    panels.iter().map(|n| (POINTS - 1) * n + 1).product()
}

/// Points that all integrals of a run of `case` may take together.
fn allowance(space: &PhaseSpace) -> usize {
    let least = EFFORTS[space.dimension() - 1].together;
    space.cells().saturating_mul(POINTS_PER_CELL).max(least)
}

/// Points of each cell of degree 0 along an axis, over which the moments of `case` are averaged.
fn points_across(case: &Case) -> usize {
    let space = &case.space;
    let cells = space.x.iter().filter(|axis| axis.nodes.degree == 0).count() as u32;
    let positions = space.space_cells().saturating_mul(ACROSS.pow(cells));
    let fits = positions.saturating_mul(points_of(&panels_of(case))) <= allowance(&case.space);
    if fits || space.dimension() == 1 { ACROSS } else { 1 }
}

/// Adds a mass with a velocity to the sums `moments`.
fn add(moments: &mut [f64; MOMENTS], velocity: &[f64; MAX_DIMENSION], mass: f64) {
    let [x, y, z] = velocity;
    let factors = [1.0, *x, *y, *z, 0.5 * (x * x + y * y + z * z)];
    moments.iter_mut().zip(factors).for_each(|(sum, factor)| *sum += factor * mass);
}

/// Number of points that the averages over the cells of `case` begin with, as a float: it may
/// exceed every integer.
pub fn first_points(case: &Case) -> f64 {
    // In one dimension with one face of each cell.
    let faces = usize::from(case.space.dimension() == 1 && case.space.x[0].nodes.degree == 0);
    let positions =
        case.space.x.iter().map(|axis| ((points_across(case) + faces) * axis.cells) as f64);
    positions.product::<f64>() * points_of(&panels_of(case)) as f64
}

/// Points that an integral may take of so many `positions` on the grid of `case`.
fn most_at(case: &Case, positions: f64) -> f64 {
    let least = EFFORTS[case.space.dimension() - 1].most.max(2 * points_of(&panels_of(case)));
    (least as f64).max((allowance(&case.space) as f64 / positions.max(1.0)).floor())
}

/// The largest number of points that integrals at so many `positions` take.
pub fn most_points(case: &Case, positions: f64) -> f64 {
    positions * most_at(case, positions)
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
        let n = case.space.dimension();
        let effort = &EFFORTS[n - 1];
        let panels = panels_of(case);
        let mut weights = vec![1.0];
        for _ in 0..n {
            weights = weights.iter().flat_map(|w| BOOLE.map(|b| w * b)).collect();
        }
        let mut integrals = Self {
            values_of,
            time,
            space: &case.space,
            panels,
            weights,
            tolerance: 0.0,
            most: most_at(case, positions as f64) as usize,
            unseen: 0.0,
            within_cells: false,
            grid_rule: None,
        };
        let places = integrals.places(effort.positions);
        let sizes = at_all(world, &places, |position| {
            integrals.first_panels(position).iter().map(|panel| integrals.size(panel)).sum()
        });
        integrals.tolerance = effort.tolerance * sizes.iter().copied().fold(0.0, f64::max);
        if n == 1 && time == case.end {
            integrals.see_filaments(world, positions, &ComparedPlaces::of(&places, &sizes));
        }
        if case.potential.len() == 1 && effort.trials > 0 {
            integrals.grid_rule = integrals.accepted_grid_rule(world, effort.trials);
        }
        integrals
    }

    /// Begins with more panels until that changes the densities at some places little, or all
    /// `positions` would take too many points; then the same for averages over cells. Collective.
    fn see_filaments(&mut self, world: &Group, positions: usize, compared: &ComparedPlaces) {
        let at_places =
            |of: &Self| at_all(world, &compared.positions, |place| of.by_panels(place).moments[0]);
        let mut found = at_places(self);
        let unseen = loop {
            let panels: Vec<usize> = self.panels.iter().map(|panels| FINER * panels).collect();
            let points = points_of(&panels);
            let (most, weights) = (self.most.max(2 * points), self.weights.clone());
            let finer = Self { panels, most, weights, grid_rule: None, ..*self };
            let expected = at_places(&finer);
            let unseen = compared.difference(&found, &expected);
            let fits = points.saturating_mul(positions) <= MORE_POINTS * allowance(self.space);
            if unseen <= UNSEEN || !fits {
                break unseen;
            }
            (*self, found) = (finer, expected);
        };
        self.unseen = match self.space.x[0].nodes.degree {
            0 => unseen.max(self.unseen_within_cells(world, compared)),
            _ => unseen,
        };
    }

    /// The difference of averages over cells, and over parts of the same cells. If it is large,
    /// filaments are looked for within cells from now on. Collective.
    fn unseen_within_cells(&mut self, world: &Group, compared: &ComparedPlaces) -> f64 {
        let axis = &self.space.x[0];
        let cell_of = |x: f64| (axis.position(x).floor().max(0.0) as usize).min(axis.cells - 1);
        let expected = at_all(world, &compared.positions, |[x, ..]| {
            let cell = cell_of(*x) as i64;
            self.over_cell([axis.face(cell), axis.face(cell + 1)]).moments[0]
        });
        let averages = |of: &Self| {
            at_all(world, &compared.positions, |[x, ..]| {
                of.on_line(&[[cell_of(*x), 0, 0]])[0].moments[0]
            })
        };
        let difference = compared.difference(&averages(self), &expected);
        if difference <= UNSEEN {
            return difference;
        }
        self.within_cells = true;
        compared.difference(&averages(self), &expected)
    }

    /// The velocities of the grid, if the densities by them are within the tolerance. Collective.
    fn accepted_grid_rule(&self, world: &Group, most: usize) -> Option<GridRule> {
        let axes = &self.space.v;
        let ranges: Vec<_> = axes.iter().map(|axis| 0..axis.cells).collect();
        let mut points = Vec::new();
        for_each_cell(&ranges, |j| {
            let (mut velocity, mut weight) = ([0.0; MAX_DIMENSION], 1.0);
            for (a, axis) in axes.iter().enumerate() {
                velocity[a] = axis.centre(j[a] as i64);
                weight *= axis.weight(j[a]);
            }
            points.push((velocity, weight));
        });
        let rule = GridRule { points, error: 0.0 };
        let tight = Self {
            tolerance: TRIAL_TOLERANCE * self.tolerance,
            most: TRIAL_POINTS * self.most,
            panels: self.panels.clone(),
            weights: self.weights.clone(),
            grid_rule: None,
            ..*self
        };
        let error = |position: &[f64; MAX_DIMENSION]| {
            (self.by_rule(&rule, position).moments[0] - tight.by_panels(position).moments[0]).abs()
        };
        let error = self.largest_of(world, most, error);
        (error <= self.tolerance).then_some(GridRule { error, ..rule })
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

    /// The largest `value` at up to `most` [`places`](Self::places) along each axis. Collective.
    fn largest_of(
        &self,
        world: &Group,
        most: usize,
        value: impl Fn(&[f64; MAX_DIMENSION]) -> f64,
    ) -> f64 {
        let positions = self.places(most);
        let mine = split(&(0..positions.len()), world.size(), world.rank());
        world.max(positions[mine].iter().map(value).fold(0.0, f64::max))
    }

    /// Up to `most` centres of elements along each axis.
    fn places(&self, most: usize) -> Vec<[f64; MAX_DIMENSION]> {
        let axes = &self.space.x;
        let counts: Vec<_> = axes.iter().map(|axis| 0..axis.elements().min(most)).collect();
        let mut positions = Vec::new();
        for_each_cell(&counts, |k| {
            let mut position = [0.0; MAX_DIMENSION];
            for (a, axis) in axes.iter().enumerate() {
                let element = (2 * k[a] + 1) * axis.elements() / (2 * counts[a].len());
                position[a] = axis.at(element as i64, 0.0);
            }
            positions.push(position);
        });
        positions
    }

    /// The integrals at the space cells `cells`: averaged over a cell of degree 0, else at its
    /// node.
    pub fn on_cells(&self, case: &Case, cells: &[[usize; MAX_DIMENSION]]) -> Vec<VelocityIntegral> {
        if self.space.dimension() == 1 && self.space.x[0].nodes.degree == 0 {
            return self.on_line(cells);
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
            for (a, axis) in self.space.x.iter().enumerate() {
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

    /// Averages over cells of degree 0 in one dimension.
    fn on_line(&self, cells: &[[usize; MAX_DIMENSION]]) -> Vec<VelocityIntegral> {
        let axis = &self.space.x[0];
        let rule = gauss_legendre(ACROSS);
        let at = |x: f64| self.at(&[x, 0.0, 0.0]);
        // The integral at the upper face of the last cell, from above.
        let mut known: Option<(usize, VelocityIntegral)> = None;
        let average = |&[j, ..]: &[usize; MAX_DIMENSION]| {
            let faces = [j, j + 1].map(|j| axis.face(j as i64));
            let lower = known.filter(|(i, _)| *i == j).map_or_else(|| at(faces[0]), |(_, f)| f);
            let beyond = at(faces[1]);
            known = Some((j + 1, beyond));
            let points: Vec<(f64, VelocityIntegral)> =
                rule.iter().map(|p| (p.node, at(axis.at(j as i64, p.node)))).collect();
            let [(a, first), (b, last)] = points[..] else {
                unreachable!("a rule of {ACROSS} points")
            };
            let [at_first, at_last] = [first.moments[0], last.moments[0]];
            let line = |node: f64| at_first + (at_last - at_first) * (node - a) / (b - a);
            // Where the density is undefined on a face, that says nothing about the cell.
            let is_bent = |found: &VelocityIntegral, node: f64| {
                (found.moments[0] - line(node)).abs()
                    > BENT_CELL * self.tolerance / EFFORTS[0].tolerance
            };
            // Behind the upper face the density may be another one.
            let before = || at(faces[1] - BEFORE_FACE * (faces[1] - faces[0]));
            let within = || WITHIN.iter().any(|node| is_bent(&at(axis.at(j as i64, *node)), *node));
            if is_bent(&lower, -1.0)
                || (is_bent(&beyond, 1.0) && is_bent(&before(), 1.0))
                || (self.within_cells && within())
            {
                let found = self.over_cell(faces);
                if found.moments[0].is_finite() {
                    return found;
                }
            }
            let mut mean = VelocityIntegral::default();
            points.iter().zip(&rule).for_each(|((_, f), p)| mean.add(0.5 * p.weight, f));
            mean
        };
        cells.iter().map(average).collect()
    }

    /// The average over the interval between `faces`, by subdivision of panels.
    fn over_cell(&self, faces: [f64; 2]) -> VelocityIntegral {
        let [lower, upper] = faces;
        let whole = upper - lower;
        let inside = BEFORE_FACE * whole;
        let at = |x: f64| self.at(&[x.clamp(lower + inside, upper - inside), 0.0, 0.0]);
        let values = std::array::from_fn(|k| at(lower + 0.25 * whole * k as f64));
        let mut panels = vec![CellPanel { lower, upper, values }];
        let share = allowance(self.space) / (self.space.x[0].cells * points_of(&self.panels));
        let most = (BENT_CELLS * share).clamp(POSITIONS[0], POSITIONS[1]);
        let mut used = POINTS;
        while used + POINTS - 1 <= most {
            let part = |panel: &CellPanel| panel.error() * panel.width() / whole;
            let error: f64 = panels.iter().map(part).sum();
            let worst =
                (0..panels.len()).max_by(|&a, &b| part(&panels[a]).total_cmp(&part(&panels[b])));
            let Some(worst) = worst.filter(|_| error > self.tolerance) else { break };
            let CellPanel { lower, upper, values: v } = panels.swap_remove(worst);
            let step = 0.125 * (upper - lower);
            let new = [1, 3, 5, 7].map(|k| at(lower + f64::from(k) * step));
            let middle = lower + 4.0 * step;
            panels.push(CellPanel {
                lower,
                upper: middle,
                values: [v[0], new[0], v[1], new[1], v[2]],
            });
            panels.push(CellPanel {
                lower: middle,
                upper,
                values: [v[2], new[2], v[3], new[3], v[4]],
            });
            used += POINTS - 1;
        }
        let mut mean = VelocityIntegral::default();
        for panel in &panels {
            let share = panel.width() / whole;
            mean.add(share, &VelocityIntegral::mean(&panel.values, BOOLE));
            mean.error += share * panel.error();
        }
        mean
    }

    /// The integral at a position of space.
    pub fn at(&self, position: &[f64; MAX_DIMENSION]) -> VelocityIntegral {
        match &self.grid_rule {
            Some(rule) => self.by_rule(rule, position),
            None => self.by_panels(position),
        }
    }

    /// The integral at a position by the velocities of the grid.
    fn by_rule(&self, rule: &GridRule, position: &[f64; MAX_DIMENSION]) -> VelocityIntegral {
        let points: Vec<[f64; 6]> =
            rule.points.iter().map(|(velocity, _)| Self::point(position, *velocity)).collect();
        let values = self.values_of.values_at(&points, self.time);
        let mut moments = [0.0; MOMENTS];
        for (f, (velocity, weight)) in values.iter().zip(&rule.points) {
            add(&mut moments, velocity, weight * f);
        }
        VelocityIntegral { moments, error: rule.error }
    }

    /// The integral at a position by subdivision of panels.
    fn by_panels(&self, position: &[f64; MAX_DIMENSION]) -> VelocityIntegral {
        let mut panels = self.first_panels(position);
        let mut left = self.most.saturating_sub(points_of(&self.panels));
        let new_points = (POINTS - 1) * self.weights.len() / POINTS;
        loop {
            let error = panels.iter().map(|panel| panel.error * panel.error).sum::<f64>().sqrt();
            // Panels with NaN do not count, as `max` ignores it.
            let largest = panels.iter().map(|panel| panel.error).fold(0.0, f64::max);
            let allowed = left / new_points;
            if error <= self.tolerance || error.is_nan() || allowed == 0 {
                let found = self.integral(&panels, error);
                let error = error + self.unseen * found.moments[0].abs();
                return VelocityIntegral { error, ..found };
            }
            let (mut open, mut k) = (Vec::new(), 0);
            while k < panels.len() && open.len() < allowed {
                match panels[k].error >= NEAR_LARGEST * largest {
                    true => open.push(panels.swap_remove(k)),
                    false => k += 1,
                }
            }
            left -= open.len() * new_points;
            panels.extend(self.halves(position, &open));
        }
    }

    /// The integral over `panels`.
    fn integral(&self, panels: &[VelocityPanel], error: f64) -> VelocityIntegral {
        let n = self.space.dimension();
        let mut moments = [0.0; MOMENTS];
        for panel in panels {
            let volume: f64 = panel.width[..n].iter().product();
            for (k, f) in panel.values.iter().enumerate() {
                let term = volume * self.weights[k] * f;
                add(&mut moments, &self.velocity(panel, k), term);
            }
        }
        VelocityIntegral { moments, error }
    }

    /// `∫ |f| dv` over a panel.
    fn size(&self, panel: &VelocityPanel) -> f64 {
        let volume: f64 = panel.width[..self.space.dimension()].iter().product();
        panel.values.iter().zip(&self.weights).map(|(f, weight)| volume * weight * f.abs()).sum()
    }

    /// Distance in `values` between neighbouring points of a panel along an axis.
    fn stride(&self, axis: usize) -> usize {
        POINTS.pow((self.space.dimension() - 1 - axis) as u32)
    }

    /// The velocity at point `k` of a panel.
    fn velocity(&self, panel: &VelocityPanel, k: usize) -> [f64; MAX_DIMENSION] {
        let mut velocity = [0.0; MAX_DIMENSION];
        for (a, v) in velocity.iter_mut().enumerate().take(self.space.dimension()) {
            let step = (k / self.stride(a) % POINTS) as f64 / (POINTS - 1) as f64;
            *v = panel.lower[a] + panel.width[a] * step;
        }
        velocity
    }

    /// The point of phase space at a position with a velocity.
    fn point(position: &[f64; MAX_DIMENSION], velocity: [f64; MAX_DIMENSION]) -> [f64; 6] {
        let ([x, y, z], [u, v, w]) = (*position, velocity);
        [x, y, z, u, v, w]
    }

    /// The velocity box in equal panels; neighbours share the points of their common sides.
    fn first_panels(&self, position: &[f64; MAX_DIMENSION]) -> Vec<VelocityPanel> {
        let axes = &self.space.v;
        let counts: Vec<usize> = self.panels.iter().map(|n| (POINTS - 1) * n + 1).collect();
        let mut points = Vec::with_capacity(points_of(&self.panels));
        for_each_cell(&counts.iter().map(|&n| 0..n).collect::<Vec<_>>(), |k| {
            let mut velocity = [0.0; MAX_DIMENSION];
            for (a, axis) in axes.iter().enumerate() {
                let part = k[a] as f64 / (counts[a] - 1) as f64;
                velocity[a] = axis.lower + (axis.upper - axis.lower) * part;
            }
            points.push(Self::point(position, velocity));
        });
        let values = self.values_of.values_at(&points, self.time);
        let mut panels = Vec::new();
        for_each_cell(&self.panels.iter().map(|&n| 0..n).collect::<Vec<_>>(), |j| {
            let (mut lower, mut width) = ([0.0; MAX_DIMENSION], [0.0; MAX_DIMENSION]);
            for (a, axis) in axes.iter().enumerate() {
                width[a] = (axis.upper - axis.lower) / self.panels[a] as f64;
                lower[a] = axis.lower + width[a] * j[a] as f64;
            }
            let value = |k: usize| {
                let along = |a: usize| (POINTS - 1) * j[a] + k / self.stride(a) % POINTS;
                values[number(counts.iter().copied(), (0..axes.len()).map(along))]
            };
            panels.push(self.panel(lower, width, (0..self.weights.len()).map(value).collect()));
        });
        panels
    }

    /// A panel with the values `values` at its points.
    fn panel(
        &self,
        lower: [f64; MAX_DIMENSION],
        width: [f64; MAX_DIMENSION],
        values: Vec<f64>,
    ) -> VelocityPanel {
        let n = self.space.dimension();
        let volume: f64 = width[..n].iter().product();
        let mut errors = [0.0; MAX_DIMENSION];
        for (a, error) in errors.iter_mut().enumerate().take(n) {
            let stride = self.stride(a);
            let first = |k: &usize| (k / stride).is_multiple_of(POINTS);
            for k in (0..values.len()).filter(first) {
                let difference = |d: usize| (BOOLE[d] - SIMPSON[d]) * values[k + d * stride];
                let sum: f64 = (0..POINTS).map(difference).sum();
                *error += volume * self.weights[k] / BOOLE[0] * sum.abs();
            }
        }
        let axis = (1..n).fold(0, |most, a| if errors[a] > errors[most] { a } else { most });
        VelocityPanel { lower, width, values, error: errors.iter().sum(), axis }
    }

    /// The halves of `panels` at `position`, each across its axis.
    fn halves(
        &self,
        position: &[f64; MAX_DIMENSION],
        panels: &[VelocityPanel],
    ) -> Vec<VelocityPanel> {
        let whole = |panel: &VelocityPanel| {
            let (mut lower, mut width) = (panel.lower, panel.width);
            width[panel.axis] *= 0.5;
            lower[panel.axis] += width[panel.axis];
            [panel.lower, lower].map(|lower| VelocityPanel {
                lower,
                width,
                values: vec![],
                ..*panel
            })
        };
        let step = |panel: &VelocityPanel, k: usize| k / self.stride(panel.axis) % POINTS;
        let is_new = |panel: &VelocityPanel, k: usize| step(panel, k) % 2 == 1;
        let halves: Vec<[VelocityPanel; 2]> = panels.iter().map(whole).collect();
        let mut points = Vec::new();
        for half in halves.iter().flatten() {
            let new = (0..self.weights.len()).filter(|&k| is_new(half, k));
            points.extend(new.map(|k| Self::point(position, self.velocity(half, k))));
        }
        let mut new = self.values_of.values_at(&points, self.time).into_iter();
        let mut found = Vec::with_capacity(2 * panels.len());
        for (panel, halves) in panels.iter().zip(halves) {
            for (h, half) in halves.into_iter().enumerate() {
                let stride = self.stride(panel.axis);
                let value = |k: usize| match is_new(panel, k) {
                    true => new.next().unwrap_or(f64::NAN),
                    false => {
                        let d = step(panel, k);
                        panel.values[k - d * stride + (h * (POINTS - 1) / 2 + d / 2) * stride]
                    }
                };
                let values = (0..self.weights.len()).map(value).collect();
                found.push(self.panel(half.lower, half.width, values));
            }
        }
        found
    }
}
