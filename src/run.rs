//! The driver: a flat list of named, timed steps.

use crate::case::{Case, Exact, Inflow as CaseInflow, Integrator, Method};
use crate::classical::Classical;
use crate::communicator::{Communicator, GhostExchange, World};
use crate::error::{Error, Result};
use crate::matrix::{self, BlockMatrix, Lanes, instruction_set};
use crate::observables::{integral, moments, power_sum};
use crate::output::{self, summary::Summary};
use crate::partition::{Block, split};
use crate::plan::{Bounds, INFLOW_GROWTH, Plan, Resources, WEIGHT_GROWTH, WEIGHT_SHIFT, WarpPlan};
use crate::potential::stray_edges;
use crate::progress::Progress;
use crate::system;
use crate::warp;
use crate::weights::Weights;
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;
use std::time::Instant;

/// The probe's forward Euler may overestimate the final norm a little.
const PROBE_SAFETY: f64 = 1.1;
/// Largest ratio of norms planned for: beyond it nothing is left of the field but round-off.
const MOST_RATIO: f64 = 1e12;

/// Seconds by step.
struct Stopwatch {
    seconds: BTreeMap<String, f64>,
    last: Instant,
}

impl Stopwatch {
    fn lap(&mut self, name: &str) {
        *self.seconds.entry(name.to_owned()).or_default() += self.last.elapsed().as_secs_f64();
        self.last = Instant::now();
    }
}

/// The discrete problem on this rank: matrix in weighted unknowns, weights, initial state.
pub struct Problem {
    /// The rows of `(S, K)`, scaled by the weights.
    pub matrix: BlockMatrix,
    /// The weights.
    pub weights: Weights,
    /// `ũ(0)`: weighted cells, then auxiliary unknowns, then room for ghosts.
    pub state: Vec<f64>,
    /// `f(0)` on this rank's cells.
    pub initial: Vec<f64>,
    /// Unknowns that count as terms of a norm: space cells and auxiliary ones, over the space group.
    pub terms: usize,
    /// Exchange of ghosts.
    pub exchange: GhostExchange,
}

impl Problem {
    /// Assembles the block of this rank, finds the weights, samples the initial state. Collective.
    ///
    /// # Errors
    /// Formulas that are not finite; weights that do not converge.
    pub fn new(
        case: &Case,
        bounds: &Bounds,
        communicator: &Communicator,
        block: Block,
        width: usize,
    ) -> Result<Self> {
        let space = &communicator.space;
        let assembled = BlockMatrix::assemble(case, block, INFLOW_GROWTH / case.end);
        let mut matrix = communicator.world.agree(assembled)?;
        let mut exchange = GhostExchange::new(space, &matrix.block, width);
        let weights = if bounds.weighted {
            let target = (WEIGHT_SHIFT / case.end, WEIGHT_GROWTH / case.end);
            let patience = 2 * case.space.axes().map(|a| a.cells).sum::<usize>();
            let weights = Weights::dissipative(&matrix, &mut exchange, space, target, patience)?;
            matrix.scale(&weights.pi);
            weights
        } else {
            Weights::none(&matrix, &mut exchange, space)
        };
        let sampled = matrix::sample(&case.space, &matrix.block, "initial.f", &case.initial, 0.0);
        let initial = communicator.world.agree(sampled)?;
        let cells = matrix.block.cells();
        let mut state = vec![0.0; matrix.length()];
        for (i, f) in initial.iter().enumerate() {
            state[i] = weights.pi[i].sqrt() * f;
        }
        for (m, aux) in matrix.inflow.iter().enumerate() {
            state[cells + m] = weights.pi[cells + m].sqrt() * aux.value / aux.coupling;
        }
        let terms = case.space.space_cells() + space.sum_count(matrix.inflow.len());
        Ok(Self {
            matrix,
            weights,
            state,
            initial,
            terms,
            exchange,
        })
    }

    /// `bounds` with the growth that was found instead of the one that was allowed for.
    pub fn bounds(&self, case: &Case, bounds: &Bounds) -> Bounds {
        let inflow = self.terms > case.space.space_cells();
        let couplings = if inflow { INFLOW_GROWTH / case.end } else { 0.0 };
        let growth = self.weights.certificate.max(couplings);
        Bounds {
            inflow,
            growth,
            decay: 2.0 * bounds.rate + growth,
            ..bounds.clone()
        }
    }

    /// `Σ |x_i|²` over all rows, or over the cells with the weights undone. Collective over the space group.
    fn norm(&self, communicator: &Communicator, x: &[f64], field_only: bool) -> f64 {
        let cells = self.matrix.block.cells();
        let square = |i: usize| match (field_only, i < cells) {
            (true, true) => x[i] * x[i] / self.weights.pi[i],
            (true, false) => 0.0,
            _ => x[i] * x[i],
        };
        let largest = (0..self.matrix.rows()).map(square).fold(0.0, f64::max);
        let group = &communicator.space;
        let bound = group.max(largest) * self.matrix.block.velocity_cells as f64;
        if !bound.is_finite() {
            return f64::NAN;
        }
        self.matrix
            .sum_rows(group, bound, self.terms, square)
            .sqrt()
    }

    /// `ũ` to `f`: undoes the weights on the cells `range`.
    fn unweighted(&self, range: &Range<usize>, state: &[f64]) -> Vec<f64> {
        (range.clone().zip(state))
            .map(|(i, u)| u / self.weights.pi[i].sqrt())
            .collect()
    }

    /// `‖ũ(0)‖/‖f(T)‖`, with `f(T)` from forward Euler: one real vector, `rate·T` applications.
    pub fn probe(&mut self, communicator: &Communicator, rate: f64, time: f64) -> f64 {
        let steps = (rate * time / 0.9).ceil().max(1.0) as usize;
        let mut state = self.state.clone();
        let mut classical = Classical::new(&self.matrix);
        classical.steps(
            &mut self.exchange,
            &mut state,
            Integrator::ForwardEuler,
            time,
            steps,
        );
        drop(classical);
        let start = self.norm(communicator, &self.state, false);
        let end = self.norm(communicator, &state, true);
        if start == 0.0 {
            return 1.0;
        }
        (PROBE_SAFETY * start / end).clamp(1.0, MOST_RATIO)
    }
}

/// What `run` is told besides the case.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// `--ranks-x`.
    pub ranks_x: Option<Vec<usize>>,
}

/// Runs a case and writes its results into `directory`. Collective over all ranks.
///
/// # Errors
/// The first error of any rank, the same on all.
pub fn run(world: &World, case: &Case, directory: &Path, options: &Options) -> Result<Summary> {
    let started = Instant::now();
    let mut watch = Stopwatch {
        seconds: BTreeMap::new(),
        last: started,
    };
    let all = world.group();
    let speaks = all.rank() == 0;

    // 1. Plan: who computes what, and does it fit.
    let mut bounds = Bounds::new(case)?;
    let available = all
        .agree(Ok(()))
        .map(|()| -all.max(-(system::available_memory() as f64 / all.ranks_on_node() as f64)))?;
    let mut resources = Resources {
        ranks: all.size(),
        ranks_x: options.ranks_x.clone(),
        memory_per_rank: Some(available as u64),
    };
    let mut plan = Plan::with_bounds(case, bounds.clone(), &resources, 1.0)?;
    resources.ranks_x = Some(plan.layout.mesh.space.clone());
    output::prepare(&all, directory)?;
    let communicator = Communicator::new(world, &plan.layout.mesh);
    let mut warnings = warnings(case);
    watch.lap("plan");

    // 2. The discrete problem.
    let mesh = plan.layout.mesh.clone();
    let (group, rank_in_space) = (communicator.modes.rank(), communicator.space.rank());
    let block = Block::new(&case.space, &mesh, rank_in_space);
    let layer = block.cells() / block.ranges[0].len();
    let leading = 0..block.ranges[0].len();
    let share = move |g: usize| {
        let piece = split(&leading, mesh.groups, g);
        piece.start * layer..piece.end * layer
    };
    let width = if plan.warp.is_some() {
        size_of::<Lanes>() / 8
    } else {
        1
    };
    let mut problem = Problem::new(case, &bounds, &communicator, block, width)?;
    watch.lap("assemble");

    // 3. How far the field's norm will fall, and the modes that takes.
    let start_norm = problem.norm(&communicator, &problem.state.clone(), false);
    if plan.warp.is_some() {
        let ratio = problem.probe(&communicator, bounds.rate, case.end);
        bounds = problem.bounds(case, &bounds);
        plan = Plan::with_bounds(case, bounds.clone(), &resources, ratio)?;
        watch.lap("probe");
    }
    if speaks {
        eprintln!("{}", opening_line(&plan));
    }

    // 4. Solve.
    let mine = share(group);
    let mut summary = Summary::default();
    let fields: Vec<Vec<f64>> = match &plan.warp {
        Some(warp_plan) => {
            let batches = &plan.layout.groups[group];
            let work = batches.iter().map(|&b| warp_plan.batches[b].degree).sum();
            let mut progress = Progress::new(speaks, work);
            let initial = warp::Initial {
                state: &problem.state[..problem.matrix.rows()],
                norm: start_norm,
                terms: problem.terms,
            };
            let recovered = warp::streamed(
                &communicator,
                (&problem.matrix, &mut problem.exchange),
                (warp_plan, &bounds, case.end),
                batches,
                &initial,
                &share,
                &mut progress,
            )?;
            progress.finish();
            summary.unitarity_defect = Some(recovered.unitarity_defect);
            let first_of_block = if communicator.space.rank() == 0 {
                recovered.applications
            } else {
                0
            };
            summary.matvecs = communicator.world.sum_count(first_of_block);
            (recovered.fields.iter())
                .map(|u| problem.unweighted(&mine, u))
                .collect()
        }
        None => {
            let mut state = problem.state.clone();
            classical(
                &mut problem,
                case,
                &bounds,
                plan.classical_steps,
                &mut state,
            );
            summary.matvecs = match case.integrator {
                Integrator::SspRk3 => 3 * plan.classical_steps,
                _ => plan.classical_steps,
            };
            vec![problem.unweighted(&mine, &state[mine.clone()])]
        }
    };
    watch.lap("solve");

    // 5. The distance to the exact semi-discrete solution, if wanted.
    let world_group = &communicator.world;
    let velocities = case.space.velocity_cells();
    let f = &fields[0];
    let distance = |other: &[f64]| {
        let difference = power_sum(world_group, velocities, f.len(), 2, |i| f[i] - other[i]);
        let norm = power_sum(world_group, velocities, f.len(), 2, |i| other[i]);
        (difference / norm).sqrt()
    };
    if case.verify {
        let mut state = problem.state.clone();
        Classical::new(&problem.matrix).exponential(
            &mut problem.exchange,
            &mut state,
            bounds.rate,
            case.end,
        );
        let reference = problem.unweighted(&mine, &state[mine.clone()]);
        summary.error_semidiscrete = Some(distance(&reference)).filter(|e| e.is_finite());
        watch.lap("verify");
    }

    // 6. Observables, errors, checks.
    let finite = f.iter().all(|x| x.is_finite());
    let state = if finite {
        Ok(())
    } else {
        Err(Error::NotFinite("NaN or infinity".into()))
    };
    world_group.agree(state)?;
    let norm = power_sum(world_group, velocities, f.len(), 2, |i| f[i]).sqrt();
    if let (Some(warp_plan), Some(second)) = (&plan.warp, fields.get(1)) {
        let estimate = distance(second);
        let round_off = 4.0 * f64::EPSILON * warp_plan.amplification * start_norm / norm;
        summary.error_estimate = Some(estimate).filter(|e| e.is_finite());
        summary.error_estimate_reliable = estimate.is_finite() && estimate > round_off;
    }
    if let Some(warp_plan) = &plan.warp {
        let ratio = start_norm / norm;
        summary.norm_ratio = Some(ratio).filter(|r| r.is_finite());
        summary.norm_ratio_planned = Some(warp_plan.ratio);
        if ratio > 1.5 * warp_plan.ratio {
            warnings.push(format!(
                "the field's norm fell by {ratio:.3e}, {:.3e} was planned for: the tolerance may be missed by the quotient",
                warp_plan.ratio
            ));
        }
    }
    let share_ranges = plan.layout.mesh.share(&case.space, rank_in_space, group);
    let found = moments(world_group, &case.space, f);
    summary.mass = integral(world_group, &case.space, &found.density);
    summary.kinetic_energy = integral(world_group, &case.space, &found.kinetic);
    let before = moments(world_group, &case.space, &problem.initial[mine.clone()]);
    summary.mass_initial = integral(world_group, &case.space, &before.density);
    let extreme = |sign: f64| {
        sign * world_group.max(f.iter().fold(f64::NEG_INFINITY, |m, x| m.max(sign * x)))
    };
    (summary.minimum, summary.maximum) = (extreme(-1.0), extreme(1.0));
    watch.lap("observables");

    let exact = exact_solution(case, &problem.matrix.block, &share_ranges, &mine)?;
    let exact = world_group.agree(exact)?;
    if let Some(exact) = &exact {
        let volume = case.space.cell_volume();
        let l1 = power_sum(world_group, velocities, f.len(), 1, |i| f[i] - exact[i]);
        let l2 = power_sum(world_group, velocities, f.len(), 2, |i| f[i] - exact[i]);
        summary.error_l1 = Some(l1 * volume);
        summary.error_l2 = Some((l2 * volume).sqrt());
        watch.lap("exact");
    }

    // 7. Write.
    let provenance = [
        (
            "program",
            format!("phasewarp {}", env!("CARGO_PKG_VERSION")),
        ),
        ("command", std::env::args().collect::<Vec<_>>().join(" ")),
        ("ranks", all.size().to_string()),
        ("mpi", world.library()),
        ("case_file", case.name.clone()),
    ];
    let results = output::hdf5::Results {
        case,
        plan: &plan,
        share: &share_ranges,
        f,
        exact: exact.as_deref(),
        moments: &found,
        seconds: &watch.seconds.clone(),
        provenance: &provenance,
    };
    output::hdf5::write(world_group, directory, &results)?;
    watch.lap("write");

    summary.fill(case, &plan, &problem, world_group.size());
    summary.inflow_unknowns = problem.terms - case.space.space_cells();
    summary.memory_peak_bytes_per_rank =
        world_group.max_count(system::peak_memory() as usize) as u64;
    summary.warnings = warnings;
    summary.solve_seconds = watch.seconds["solve"];
    summary.seconds = watch.seconds;
    summary.wall_seconds = started.elapsed().as_secs_f64();
    let written = if speaks {
        summary.write(directory)
    } else {
        Ok(())
    };
    world_group.agree(written)?;
    Ok(summary)
}

impl Summary {
    /// What the plan and the problem say.
    fn fill(&mut self, case: &Case, plan: &Plan, problem: &Problem, ranks: usize) {
        self.title = case.title.clone();
        self.version = env!("CARGO_PKG_VERSION").to_owned();
        self.ranks = ranks;
        self.space_blocks = plan.layout.mesh.space.clone();
        self.mode_groups = plan.layout.mesh.groups;
        self.instruction_set = instruction_set().to_owned();
        self.cells = plan.cells;
        self.modes = plan.warp.as_ref().map_or(0, |w| w.modes);
        self.tolerance = case.tolerance;
        self.memory_planned_bytes_per_rank = plan.memory();
        self.growth_bound = plan.bounds.growth;
        self.growth_certificate = problem.weights.certificate;
        self.weight_spread = problem.weights.spread;
        self.weight_sweeps = problem.weights.sweeps;
    }
}

fn classical(problem: &mut Problem, case: &Case, bounds: &Bounds, steps: usize, state: &mut [f64]) {
    let mut classical = Classical::new(&problem.matrix);
    match case.integrator {
        Integrator::Exponential => {
            classical.exponential(&mut problem.exchange, state, bounds.rate, case.end);
        }
        integrator => {
            classical.steps(&mut problem.exchange, state, integrator, case.end, steps);
        }
    }
}

/// The exact solution at the centres of the cells `mine` of the block.
fn exact_solution(
    case: &Case,
    block: &Block,
    share: &[Range<usize>],
    mine: &Range<usize>,
) -> Result<Result<Option<Vec<f64>>>> {
    let _ = share;
    let Some(exact) = &case.exact else {
        return Ok(Ok(None));
    };
    Ok(match exact {
        Exact::Formula(formula) => matrix::sample(&case.space, block, "exact.f", formula, case.end)
            .map(|v| Some(v[mine.clone()].to_vec())),
        Exact::Characteristics => Ok(None),
    })
}

/// What the user should know before the run.
pub fn warnings(case: &Case) -> Vec<String> {
    let names = ["x", "y", "z"];
    let mut list: Vec<String> = stray_edges(case)
        .iter()
        .map(|edge| {
            format!(
                "potential: a region's edge at {} = {:.6} misses the faces of the grid; it is moved to {:.6}, by {:.2e}",
                names[edge.axis],
                edge.at,
                edge.face,
                (edge.at - edge.face).abs()
            )
        })
        .collect();
    if case.method == Method::Classical
        && case.integrator != Integrator::Exponential
        && matches!(case.inflow, CaseInflow::Initial)
    {
        list.push("inflow.value = \"initial\" is kept constant in time".into());
    }
    list
}

fn opening_line(plan: &Plan) -> String {
    let mesh = &plan.layout.mesh;
    let what = match &plan.warp {
        Some(WarpPlan {
            modes,
            applications,
            ..
        }) => format!("{modes} modes, {applications} applications"),
        None => format!("{} classical steps", plan.classical_steps),
    };
    format!(
        "{}: {} cells, {what}, {} ranks ({} space x {} modes)",
        if plan.title.is_empty() {
            "phasewarp"
        } else {
            &plan.title
        },
        plan.cells,
        mesh.ranks(),
        mesh.blocks(),
        mesh.groups
    )
}
