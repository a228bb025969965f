//! A case assembled on the ranks of its mesh: the common preparation of runs, spectra and studies.

use crate::base::error::{Error, Result};
use crate::base::memory;
use crate::matrix::block_matrix::BlockMatrix;
use crate::matrix::bounds::{AssembledSize, Bounds};
use crate::matrix::instruction_set::InstructionSet;
use crate::matrix::lanes::Lanes;
use crate::parallel::communicator::{Communicator, GhostExchange, Group, World};
use crate::parallel::partition::ProcessMesh;
use crate::plan::layout::Resources;
use crate::plan::{Plan, ProvisionalPlan};
use crate::problem::case::{Case, Integrator, Method};
use crate::propagate::classical::{Classical, ClassicalSpan, ROUGH};
use crate::propagate::descriptor;
use crate::propagate::shifted::factor_bytes_per_row;
use crate::propagate::time_dependent_inflow::TIME_SHARE;
use crate::solve::rank_cells::RankCells;
use crate::solve::system::{DiscreteSystem, RoughSolution, StateNorms, SystemLimits};

/// Margin for the error of the probe.
const PROBE_SAFETY: f64 = 1.01;
/// Longest part `rate·time` of a leg that is propagated roughly before the norm is looked at.
const LONGEST_PIECE: f64 = 1e4;
/// A field whose norm has fallen to this part has left the box.
const GONE: f64 = 1e-40;
/// The left half of a disc of this radius lies in the stability region of SSP-RK3.
const RUNGE_KUTTA_RADIUS: f64 = 1.7;

/// A case, the ranks that share it, and its semi-discrete system on this rank.
pub struct Prepared {
    /// The reduced case, as it is solved.
    pub case: Case,
    /// The process mesh.
    pub communicator: Communicator,
    /// This rank's part of the grid.
    pub rank_cells: RankCells,
    /// The semi-discrete system on this rank.
    pub system: DiscreteSystem,
    /// The plan: provisional until [`plan_modes`](Self::plan_modes).
    pub plan: Plan,
    /// Bounds of the generator, with the measured growth.
    pub bounds: Bounds,
    /// Bounds with which the system was assembled, before the growth was measured.
    expected: Bounds,
    max_weight_sweeps: usize,
}

impl Prepared {
    /// Plans `case` provisionally on `resources` and assembles it. Collective.
    ///
    /// # Errors
    /// As [`ProvisionalPlan::new`] and [`DiscreteSystem::new`].
    pub fn new(world: &World, case: &Case, resources: &Resources) -> Result<Self> {
        Self::assemble(world, case, ProvisionalPlan::new(case, resources)?)
    }

    /// Plans and assembles `case` as [`new`](Self::new) does, on all ranks of `world` with the
    /// memory of this machine. Collective.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn here(world: &World, case: &Case) -> Result<Self> {
        Self::new(world, case, &Resources::here(world))
    }

    /// Assembles `case` on the mesh of its plan, with the plan's limit on sweeps for the weights.
    /// Collective.
    ///
    /// # Errors
    /// As [`DiscreteSystem::new`].
    pub fn assemble(world: &World, case: &Case, provisional: ProvisionalPlan) -> Result<Self> {
        let ProvisionalPlan { bounds, plan } = provisional;
        let sweeps = plan.max_weight_sweeps();
        Self::with_sweeps(world, case, &bounds, plan, sweeps)
    }

    /// Assembles `case` on the mesh of `plan`, with at most `max_weight_sweeps` sweeps for the
    /// weights. Collective.
    ///
    /// # Errors
    /// As [`DiscreteSystem::new`].
    pub fn with_sweeps(
        world: &World,
        case: &Case,
        bounds: &Bounds,
        plan: Plan,
        max_weight_sweeps: usize,
    ) -> Result<Self> {
        let communicator = Communicator::new(world, &plan.layout.mesh);
        let rank_cells = RankCells::new(&case.space, &plan, &communicator);
        // Modes exchange ghosts a batch at a time, the classical method real vectors.
        let width = plan.warp.as_ref().map_or(1, |_| size_of::<Lanes>() / 8);
        let limits = SystemLimits { ghost_width: width, max_weight_sweeps };
        let system = DiscreteSystem::new(case, bounds, &communicator, &rank_cells, limits)?;
        // Returns the memory of the assembly before the modes need theirs.
        memory::give_back();
        let all = &communicator.world;
        let factors = factors_over_estimate(case, bounds, &plan.layout.mesh, all, &system.matrix)?;
        let size = assembled_size(all, &system.matrix, factors);
        let assembled = Some(size);
        Ok(Self {
            bounds: Bounds { assembled, ..system.bounds(&case.space, bounds) },
            case: case.clone(),
            communicator,
            rank_cells,
            system,
            plan,
            expected: bounds.clone(),
            max_weight_sweeps,
        })
    }

    /// Largest `‖ũ(0)‖/‖f(t)‖` over fields and output times, with a margin, from a rough
    /// propagation of the fields. Collective.
    pub fn probe(&mut self) -> f64 {
        self.rough_ends().ratio
    }

    /// The ratio that [`probe`](Self::probe) gives, and the norms of the first field at the end,
    /// which determine probabilities. Collective.
    pub fn rough_solution(&mut self) -> RoughSolution {
        let Probe { ratio, last } = self.rough_ends();
        let Self { case, communicator, bounds, system, .. } = self;
        // In several legs round-off is another, and a mode group has not the fields of others.
        let is_whole = case.legs().len() == 1 && communicator.modes.size() == 1;
        let start = system.norm(communicator, &system.states[0]);
        let state = last.filter(|_| is_whole).unwrap_or_else(|| {
            let (mut state, time) = (system.states[0].clone(), case.duration());
            propagate_leg(system, communicator, bounds, time, start, &mut state);
            state
        });
        let [weighted, auxiliary] = system.norms_of_parts(communicator, &state);
        let field = system.field_norm(communicator, &state);
        RoughSolution { ratio, norms: StateNorms { start, weighted, auxiliary, field } }
    }

    /// Propagates the fields roughly over the legs; with a varying inflow nothing is propagated.
    /// The mode groups share the fields. Collective.
    fn rough_ends(&mut self) -> Probe {
        let Self { case, communicator, bounds, system, .. } = self;
        let (mut largest, mut last) = (1.0f64, None);
        if let Some(schedule) = &system.schedule {
            // The pilot has run to the end; the rest of the tolerance is the profile's.
            let start = system.norm(communicator, &system.states[0]);
            let ratio = if start == 0.0 { 1.0 } else { PROBE_SAFETY * start / schedule.norm };
            return Probe { ratio: ratio.max(1.0) / (1.0 - TIME_SHARE), last };
        }
        let (group, groups) = (communicator.modes.rank(), communicator.modes.size());
        for field in (group..system.states.len()).step_by(groups) {
            let mut state = system.states[field].clone();
            let start = system.norm(communicator, &state);
            for time in case.legs() {
                let now = propagate_leg(system, communicator, bounds, time, start, &mut state);
                if start != 0.0 {
                    largest = largest.max(PROBE_SAFETY * start / now.unwrap_or(GONE * start));
                }
                // A larger ratio changes no decision.
                if now.is_none() {
                    break;
                }
            }
            if field == 0 {
                last = Some(state);
            }
        }
        Probe { ratio: communicator.modes.max(largest), last }
    }

    /// This system with the bounds, the modes and their groups of `plan`, which has the same
    /// blocks.
    pub fn with_modes_of(mut self, plan: &Plan) -> Self {
        self.plan.bounds = plan.bounds.clone();
        self.plan.warp.clone_from(&plan.warp);
        self.plan.layout.groups.clone_from(&plan.layout.groups);
        self
    }

    /// Turns `ũ` on this rank's share into `f`, by undoing the weights.
    pub fn unweighted(&self, state: Vec<f64>) -> Vec<f64> {
        self.system.weights.unweighted(&self.rank_cells.mine, state)
    }

    /// This system with the plan of its modes, for the `ratio` of the probe. It is assembled again
    /// if that plan has another process mesh. Collective.
    ///
    /// # Errors
    /// As [`Plan::new`]; [`Error::Ranks`] if ranks plan different series.
    pub fn plan_modes(self, world: &World, resources: &Resources, ratio: f64) -> Result<Self> {
        let plan = self.plan.measured(&self.case, self.bounds.clone(), resources, ratio)?;
        // Processors of different kinds might round differently, and ranks with different plans
        // would wait for each other for ever.
        let all = &self.communicator.world;
        let rounds_alike = all.same(u64::from(InstructionSet::here().is_fused()));
        let warp = plan.warp.as_ref();
        if !rounds_alike || warp.is_some_and(|warp| !all.same(warp.fingerprint())) {
            let why = "ranks round or plan differently, being on processors of different kinds; \
                       start them on one kind";
            return Err(Error::Ranks(why.to_owned()));
        }
        if plan.layout.mesh == self.plan.layout.mesh {
            return Ok(Self { plan, ..self });
        }
        let Self { case, expected, max_weight_sweeps, system, .. } = self;
        // Frees this system before another is assembled.
        drop(system);
        Self::with_sweeps(world, &case, &expected, plan, max_weight_sweeps)
    }
}

/// As [`propagate_roughly`] over a leg, in pieces, which end where hardly any of the state is left
/// in the box. Returns its field norm; `None` below [`GONE`] of the norm `start`. Collective over
/// the space group.
fn propagate_leg(
    system: &mut DiscreteSystem,
    communicator: &Communicator,
    bounds: &Bounds,
    time: f64,
    start: f64,
    state: &mut [f64],
) -> Option<f64> {
    let pieces = (bounds.rate * time / LONGEST_PIECE).ceil().max(1.0);
    let mut norm = None;
    for _ in 0..pieces as usize {
        propagate_roughly(&system.matrix, &mut system.exchange, bounds, time / pieces, state);
        norm = Some(system.field_norm(communicator, state));
        if norm.is_some_and(|norm| norm < GONE * start) {
            return None;
        }
    }
    norm
}

/// `state ← exp(A time) state`, to about three digits of its norm: one real vector. Collective over
/// the space group.
///
/// Degree 0: by the exponential, in little more than `rate·time` applications. Higher degrees: by
/// SSP-RK3, as the exponential would take three times as many applications. SSP-RK3 is stable if
/// the numerical range lies in its stability region, and it damps components that it does not
/// resolve.
fn propagate_roughly(
    matrix: &BlockMatrix,
    exchange: &mut GhostExchange,
    bounds: &Bounds,
    time: f64,
    state: &mut [f64],
) {
    let mut classical = Classical::new(matrix);
    if matrix.by_elements {
        let steps = (bounds.radius() * time / RUNGE_KUTTA_RADIUS).ceil().max(1.0) as usize;
        classical.steps(exchange, state, Integrator::SspRk3, time, steps);
    } else {
        classical.exponential(exchange, state, ClassicalSpan { rate: bounds.rate, time }, ROUGH);
    }
}

/// The result of a rough propagation of the fields.
struct Probe {
    /// Largest `‖ũ(0)‖/‖f(t)‖` of the fields over the ends `t` of the legs, with a margin.
    ratio: f64,
    /// The first field at the end, on ranks of the mode group that propagates it.
    last: Option<Vec<f64>>,
}

/// Bytes of the factors of an implicit method on the fullest rank, over those estimated; 1 without
/// factors. Collective.
///
/// # Errors
/// As [`Descriptor::factor_bytes`](crate::propagate::method::Descriptor::factor_bytes).
fn factors_over_estimate(
    case: &Case,
    bounds: &Bounds,
    mesh: &ProcessMesh,
    world: &Group,
    matrix: &BlockMatrix,
) -> Result<f64> {
    let method = descriptor(case.propagator.method);
    if case.method == Method::Classical || case.propagator.method.order() == 0 {
        return Ok(1.0);
    }
    let bytes = world.max(world.agree(method.factor_bytes(matrix))? as f64);
    let rows = world.max(matrix.rows() as f64);
    Ok(bytes / (factor_bytes_per_row(case, bounds, mesh) * rows))
}

/// The size of `matrix` on the fullest rank of `world`. Collective.
fn assembled_size(world: &Group, matrix: &BlockMatrix, factors: f64) -> AssembledSize {
    let largest = |number: usize, of: usize| world.max(number as f64 / of.max(1) as f64);
    let assembly = matrix.assembly;
    AssembledSize {
        bytes_per_row: largest(matrix.bytes(), matrix.rows()),
        bytes_per_row_before: largest(assembly.bytes, matrix.rows()),
        changed_bytes_per_row: largest(assembly.changed_bytes, matrix.rows()),
        contributions_per_row: world.max(assembly.contributions_per_row),
        inflow_rows_per_cell: largest(matrix.inflow.len(), matrix.block.cells()),
        source_bytes_per_cell: largest(matrix.entering.bytes(), matrix.block.cells()),
        factors_over_estimate: factors,
    }
}
