//! The discrete problem on a rank: matrix, weights, initial state.

use crate::base::error::{Error, Result};
use crate::base::fixed_point::larger;
use crate::matrix::block_matrix::BlockMatrix;
use crate::matrix::bounds::{Bounds, WEIGHT_GROWTH, WEIGHT_SHIFT};
use crate::matrix::sampling::{SampledCells, sample};
use crate::matrix::weights::{WeightGoal, Weights};
use crate::parallel::communicator::{Communicator, GhostExchange, Group};
use crate::problem::case::{Case, LiouvilleField, Method};
use crate::problem::grid::PhaseSpace;
use crate::propagate::time_dependent_inflow::{self, Schedule, WeightedField};
use crate::solve::rank_cells::RankCells;
use crate::solve::start_field;
use num_complex::Complex64;
use serde::Serialize;
use std::time::Instant;

/// The discrete problem on this rank: matrix in weighted unknowns, weights, initial state.
pub struct DiscreteSystem {
    /// The rows of `(S, K)`, scaled by the weights.
    pub matrix: BlockMatrix,
    /// The weights.
    pub weights: Weights,
    /// `ũ` of each field at the start: weighted cells, then auxiliary unknowns, then room for
    /// ghosts.
    pub states: Vec<Vec<f64>>,
    /// Each field at the start on this rank's cells; a run drops them after computing their mass.
    pub initial: Vec<Vec<f64>>,
    /// Number of terms of a norm: space cells and auxiliary unknowns, over the space group.
    pub norm_terms: usize,
    /// The steps of an inflow that depends on time, if modes are propagated.
    pub schedule: Option<Schedule>,
    /// Bound on the growth of the system with its auxiliary unknowns.
    pub coupled_growth: f64,
    /// Half the norm of the couplings to auxiliary unknowns.
    pub coupling: f64,
    /// Exchange of ghosts.
    pub exchange: GhostExchange,
    /// Seconds for computing the weights.
    pub weight_seconds: f64,
}

/// Refuses data whose squares overflow or vanish. Collective.
///
/// # Errors
/// [`Error::Magnitude`].
fn check_magnitude(world: &Group, key: &str, values: impl Iterator<Item = f64>) -> Result<()> {
    let value = world.max(values.fold(0.0, |m: f64, x| m.max(x.abs())));
    if value == 0.0 || (1e-100..=1e100).contains(&value) {
        return Ok(());
    }
    Err(Error::Magnitude { key: key.to_owned(), value })
}

/// Limits on the use and assembly of a system.
#[derive(Clone, Copy, Debug)]
pub struct SystemLimits {
    /// The largest number of reals in a row of a vector whose ghosts are exchanged.
    pub ghost_width: usize,
    /// Largest number of sweeps for the weights.
    pub max_weight_sweeps: usize,
}

/// Finds the weights and scales `matrix` by them: dissipative weights within so many `sweeps`, the
/// volumes of elements, or ones. Collective.
fn weighted(
    case: &Case,
    matrix: &mut BlockMatrix,
    exchange: &mut GhostExchange,
    space: &Group,
    sweeps: Option<usize>,
) -> Result<Weights> {
    let weights = match sweeps {
        Some(sweeps) => {
            // Paths much longer than the grid is wide need not be followed.
            let width: usize = case.space.axes().map(|a| a.cells).sum();
            let goal = WeightGoal {
                limit: WEIGHT_GROWTH / case.duration(),
                shift: WEIGHT_SHIFT / case.duration(),
                max_weight_sweeps: sweeps.min(2 * width),
            };
            Weights::dissipative(matrix, exchange, space, goal)?
        }
        None if case.is_galerkin() => Weights::volumes(matrix, &case.space),
        None => return Ok(Weights::none(matrix, exchange, space)),
    };
    matrix.scale(&weights.pi);
    Ok(weights)
}

/// The values of each field at the start on the block's cells: from its formula or from a file. The
/// mode groups share the projection onto elements. Collective.
fn initial_values(
    case: &Case,
    matrix: &BlockMatrix,
    communicator: &Communicator,
    rank_cells: &RankCells,
) -> Result<Vec<Vec<f64>>> {
    let world = &communicator.world;
    let is_shared = case.space.whole_degree() > 0 && communicator.modes.size() > 1;
    let part = if is_shared { rank_cells.part() } else { SampledCells::whole(&matrix.block) };
    let values = |(k, field): (usize, &LiouvilleField)| {
        let (key, values) = match &case.start_field {
            Some(start) => {
                let values = start_field::read(communicator, &case.space, &matrix.block, start)?;
                (&start.place[..], values)
            }
            None => {
                let sampled = sample(world, &case.space, &part, &field.initial, 0.0);
                let mine = world.agree(sampled)?;
                let values = if is_shared {
                    let cells = matrix.block.cells();
                    rank_cells.gathered(&communicator.modes, &mine, cells)
                } else {
                    mine
                };
                (field.initial.place(), values)
            }
        };
        check_magnitude(world, key, values.iter().copied())?;
        // A pulse may be as small as it likes at the start.
        let counts = |value: &f64| !case.varies() || value.abs() > 1.0;
        let inflow = matrix.inflow.iter().map(|aux| aux.values[k]).filter(counts);
        check_magnitude(world, field.entering().place(), inflow)?;
        Ok(values)
    };
    case.fields.iter().enumerate().map(values).collect()
}

/// `√π` times the `values` of field `k` and its auxiliary unknowns.
fn weighted_state(
    fields: &[LiouvilleField],
    matrix: &BlockMatrix,
    pi: &[f64],
    k: usize,
    values: &[f64],
) -> Vec<f64> {
    let cells = matrix.block.cells();
    let mut state = vec![0.0; matrix.length()];
    for (i, f) in values.iter().enumerate() {
        state[i] = pi[i].sqrt() * f;
    }
    for (m, r) in matrix.auxiliary(k, fields[k].enters()).enumerate() {
        state[cells + m] = pi[cells + m].sqrt() * r;
    }
    state
}

/// The steps of an inflow that depends on time, if the modes of `field` are propagated; the
/// classical method only checks its samples. `None` for a constant inflow. Collective.
fn inflow_schedule(
    case: &Case,
    matrix: &BlockMatrix,
    exchange: &mut GhostExchange,
    communicator: &Communicator,
    field: &WeightedField<'_>,
) -> Result<Option<Schedule>> {
    match (case.varies(), case.method) {
        (false, _) => Ok(None),
        (true, Method::Classical) => {
            communicator.world.agree(time_dependent_inflow::largest_inflow(case, matrix))?;
            Ok(None)
        }
        (true, Method::Schrodingerized) => {
            time_dependent_inflow::schedule(case, matrix, exchange, communicator, field).map(Some)
        }
    }
}

impl DiscreteSystem {
    /// Assembles the block of this rank, finds the weights, samples the initial state. Collective.
    ///
    /// # Errors
    /// Formulas that are not finite; weights that do not converge.
    pub fn new(
        case: &Case,
        bounds: &Bounds,
        communicator: &Communicator,
        rank_cells: &RankCells,
        limits: SystemLimits,
    ) -> Result<Self> {
        let space = &communicator.space;
        let assembled = BlockMatrix::assemble(case, rank_cells.block.clone());
        let mut matrix = communicator.world.agree(assembled)?;
        let mut exchange = GhostExchange::new(space, &matrix.block, limits.ghost_width);
        let started = Instant::now();
        let sweeps = bounds.weighted.then_some(limits.max_weight_sweeps);
        let mut weights = weighted(case, &mut matrix, &mut exchange, space, sweeps)?;
        let weight_seconds = started.elapsed().as_secs_f64();
        matrix.couple(space, case, &mut weights.pi);
        matrix.gather_elements();
        let cells = matrix.block.cells();
        let initial = initial_values(case, &matrix, communicator, rank_cells)?;
        let mut states: Vec<Vec<f64>> = (initial.iter().enumerate())
            .map(|(k, values)| weighted_state(&case.fields, &matrix, &weights.pi, k, values))
            .collect();
        let field = WeightedField { weights: &weights.pi, state: &states[0], rate: bounds.rate };
        let schedule = inflow_schedule(case, &matrix, &mut exchange, communicator, &field)?;
        if let Some(schedule) = &schedule {
            states[0][cells..matrix.rows()].copy_from_slice(&schedule.unknowns);
            matrix.common_growth = schedule.common_growth;
        }
        let couplings: Vec<f64> = match &schedule {
            None => matrix.inflow.iter().map(|aux| aux.coupling).collect(),
            Some(schedule) => schedule.envelope.clone(),
        };
        let coupled_growth = matrix.coupled_growth(space, weights.certificate, &couplings);
        let coupling = matrix.coupling_norm(space, &couplings);
        let counted = matrix.counted_rows() - cells;
        let norm_terms = case.space.space_cells() + space.sum_count(counted);
        Ok(Self {
            matrix,
            weights,
            states,
            initial,
            norm_terms,
            schedule,
            coupled_growth,
            coupling,
            exchange,
            weight_seconds,
        })
    }

    /// `bounds` with the measured growth instead of the assumed one.
    pub fn bounds(&self, space: &PhaseSpace, bounds: &Bounds) -> Bounds {
        let inflow = self.norm_terms > space.space_cells();
        // An auxiliary unknown alone neither grows nor decays.
        let growth = if inflow { self.coupled_growth } else { self.weights.certificate };
        Bounds {
            inflow,
            stages: self.schedule.as_ref().map_or(0, Schedule::stages),
            growth,
            decay: bounds.dissipation + growth,
            coupling: self.coupling,
            ..bounds.clone()
        }
    }

    /// `(Σ |x_i|²)^½` over all rows. Collective over the space group.
    pub fn norm(&self, communicator: &Communicator, x: &[f64]) -> f64 {
        self.root_of_sum(communicator, |i| x[i] * x[i])
    }

    /// `(Σ |x_i|²)^½` over the cells with the weights undone. Collective over the space group.
    pub fn field_norm(&self, communicator: &Communicator, x: &[f64]) -> f64 {
        let cells = self.matrix.block.cells();
        self.root_of_sum(communicator, |i| {
            if i >= cells {
                0.0
            } else if self.weights.are_volumes {
                x[i] * x[i]
            } else {
                x[i] * x[i] / self.weights.pi[i]
            }
        })
    }

    /// The norm of a mode over all rows. Collective over the space group.
    pub fn norm_of_mode(&self, communicator: &Communicator, mode: &[Complex64]) -> f64 {
        let norm = |of: fn(&Complex64) -> f64| {
            let part: Vec<f64> = mode.iter().map(of).collect();
            self.norm(communicator, &part)
        };
        norm(|x| x.re).hypot(norm(|x| x.im))
    }

    /// The l2 norms of `x` over the weighted cells, and over the auxiliary unknowns. Collective
    /// over the space group.
    pub fn norms_of_parts(&self, communicator: &Communicator, x: &[f64]) -> [f64; 2] {
        let cells = self.matrix.block.cells();
        [true, false].map(|field| {
            let part = |i: usize| {
                if (i < cells) == field { x[i] * x[i] } else { 0.0 }
            };
            self.root_of_sum(communicator, part)
        })
    }

    /// Root of the sum of `square(i)` over the rows `i` of all ranks of the space group.
    fn root_of_sum(&self, communicator: &Communicator, square: impl Fn(usize) -> f64) -> f64 {
        let largest = (0..self.matrix.counted_rows()).map(&square).fold(0.0, larger);
        let group = &communicator.space;
        let bound = group.max(largest) * self.matrix.block.velocity_cells as f64;
        if !bound.is_finite() {
            return f64::NAN;
        }
        self.matrix.sum_rows(group, bound, self.norm_terms, square).sqrt()
    }
}

/// Norms of a solution that are computed before modes are planned, to about three digits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RoughSolution {
    /// Largest `‖ũ(0)‖/‖f(t)‖`, with a margin, that modes are planned for.
    pub ratio: f64,
    /// Norms of the first field.
    pub norms: StateNorms,
}

/// Norms of the vectors whose ratios are probabilities.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct StateNorms {
    /// Norm `‖ũ(0)‖` of the weighted state with its auxiliary unknowns.
    pub start: f64,
    /// Norm `‖√π f(T)‖` of the weighted field.
    pub weighted: f64,
    /// Norm `‖f(T)‖` of the field.
    pub field: f64,
    /// Norm `‖r‖` of the auxiliary unknowns, which does not change.
    pub auxiliary: f64,
}

impl StateNorms {
    /// The reason why there is no state to prepare; `None` if there is one.
    pub fn no_start(&self) -> Option<&'static str> {
        const WHY: &str = "f(0) is 0 and nothing enters: there is no state to prepare";
        (self.start == 0.0).then_some(WHY)
    }

    /// The reason why there is no field to measure; `None` if there is one.
    pub fn no_field(&self) -> Option<&'static str> {
        let decayed = (self.field == 0.0).then_some("the field has decayed to zero");
        self.no_start().or(decayed)
    }
}
