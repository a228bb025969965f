//! How long a run will take, from a few steps of it: `phasewarp plan --calibrate`.
//!
//! What comes before the modes (assembling, weights, probe, exact solution) is done as a run does it, and timed. Then the modes
//! themselves are run for a part of the time, by the code that a run uses and on all ranks at once, so that ghost exchange and a
//! memory that the ranks share count. With `t(n)` the seconds that take pieces of the work to `n` parts of `T`,
//!
//! ```text
//! t(0) = fixed,     t(n) = fixed + piece · pieces + rate · cost(n)
//! ```
//!
//! and a run takes `fixed + piece · pieces + rate · cost` with the pieces and the cost of the mode group with most to do. A piece
//! is a batch of modes, where modes go one after the other a mode; cost is what the plan counts, applications or solves.
//!
//! The ranks at hand need not be as many as the run will have. Each then takes a block of the size that a rank of the run has: the box
//! is cut down to as many blocks as there are ranks for.

use crate::base::error::Result;
use crate::base::progress::Progress;
use crate::matrix::block_matrix::BlockMatrix;
use crate::matrix::bounds::Bounds;
use crate::matrix::observables::{VelocityFactors, moments};
use crate::parallel::communicator::{Communicator, World};
use crate::parallel::partition::Mesh;
use crate::plan::Plan;
use crate::plan::balance::Batch;
use crate::plan::here::memory_per_rank;
use crate::plan::layout::{Resources, refuse_hopeless};
use crate::problem::case::{Case, Integrator};
use crate::problem::grid::{Axis, PhaseSpace};
use crate::propagate;
use crate::propagate::classical::{Classical, EXACT, ROUGH, classical_steps, poisson_window};
use crate::propagate::commutator_free::stage_degree;
use crate::propagate::limiter::Reconstruction;
use crate::propagate::method::{BatchCoupling, Evolution, Initial, Propagator};
use crate::propagate::time_dependent_inflow::Schedule;
use crate::propagate::{Span, descriptor, propagator};
use crate::results::result_file::most_bytes;
use crate::results::warped::all_bytes;
use crate::run::classical::{Integration, integrate};
use crate::run::exact::exact_solution;
use crate::run::planning::with_start;
use crate::scheme::reduce::reduced;
use crate::schrodingerization::warp_plan::WarpPlan;
use crate::solve::kept::{KeptModes, ModeProgress};
use crate::solve::modes;
use crate::solve::modes::{Keeping, Leg, RunHooks, Task};
use crate::solve::place::Place;
use crate::solve::prepared::Prepared;
use crate::solve::sum::MomentsOf;
use crate::solve::system::DiscreteSystem;
use num_complex::Complex64;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt;
use std::time::Instant;

/// Parts of the time; a power of two.
const PARTS: usize = 64;
/// A trial of so many seconds tells the rate; shorter ones are made longer while there is time left to run.
const LONG_ENOUGH: f64 = 0.25;
/// Most times that a trial is repeated.
const REPEATS: f64 = 9.0;
/// Pieces that are tried, where not all of them run at one rate.
const PIECES: usize = 3;

/// What it takes to write results, measured on a local disk: files and their metadata, a byte that is written and read back, and one of the
/// warped field, which is transposed and transformed before; and a byte of a warped field that the run starts from, of which norms are taken.
/// All depend on the file system.
const SECONDS_TO_WRITE: f64 = 0.01;
const SECONDS_PER_BYTE: f64 = 2e-9;
const SECONDS_PER_WARPED_BYTE: f64 = 5e-9;
const SECONDS_PER_GIVEN_BYTE: f64 = 4e-9;

/// What a run is expected to take.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Calibration {
    /// Ranks that measured.
    pub ranks: usize,
    /// Space blocks they had, along each x-axis.
    pub space_blocks: Vec<usize>,
    /// Whether they had the whole box, or were fewer than the run will have (or more).
    pub whole: bool,
    /// Seconds that measuring took, the plan included.
    pub took: f64,
    /// Seconds for one application of a mode, or one solve, on the block of a rank.
    pub seconds_per_application: f64,
    /// Seconds by step, with the names of `summary.json`.
    pub seconds: BTreeMap<String, f64>,
    /// Seconds to solve: propagation and recovery.
    pub solve_seconds: f64,
    /// Seconds in all, without the start of MPI.
    pub wall_seconds: f64,
}

impl fmt::Display for Calibration {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "calibrated      on {} ranks in {:.1} s: {:.3e} s an application on a rank's block{}",
            self.ranks,
            self.took,
            self.seconds_per_application,
            if self.whole { "" } else { "; not the ranks of the run" }
        )?;
        let mut steps: Vec<(&String, &f64)> = self.seconds.iter().collect();
        steps.sort_by(|a, b| b.1.total_cmp(a.1));
        let steps: Vec<String> =
            (steps.iter()).map(|(name, s)| format!("{name} {}", seconds_text(**s))).collect();
        writeln!(
            f,
            "expected        {} to solve, {} in all: {}",
            seconds_text(self.solve_seconds),
            seconds_text(self.wall_seconds),
            steps.join(", ")
        )
    }
}

/// Seconds for people, with what `--time` of a batch system takes where they are many.
pub fn seconds_text(seconds: f64) -> String {
    if !seconds.is_finite() {
        return "unknown".to_owned();
    }
    if seconds >= 1e12 {
        return format!("{seconds:.0e} s");
    }
    if seconds < 100.0 {
        return format!("{seconds:.2e} s");
    }
    let whole = seconds.ceil() as u64;
    let (hours, minutes) = (whole / 3600, whole / 60 % 60);
    format!("{seconds:.0} s ({hours}:{minutes:02}:{:02})", whole % 60)
}

/// The plan of a run on `resources`, and what it is expected to take, measured on the ranks of `world`. Collective.
///
/// # Errors
/// As [`crate::run::planning::plan`]; [`crate::base::error::Error::Memory`] where a rank's block does not fit into this machine.
pub fn calibrate(world: &World, case: &Case, resources: &Resources) -> Result<(Plan, Calibration)> {
    let started = Instant::now();
    let all = world.group();
    let mut watch = crate::base::stopwatch::Stopwatch::start(0.0);
    let case = &reduced(&all, &*with_start(&all, case)?)?;
    refuse_hopeless(case, resources)?;
    let bounds = Bounds::new(case)?;
    let expected = Plan::provisional(case, &bounds, resources)?;
    let limited = Resources { memory_per_rank: Some(memory_per_rank(&all)), ..resources.clone() };
    let warp = expected.warp.as_ref();
    (expected.layout.clone()).within(case, &expected.bounds, warp, &limited)?;
    watch.lap("plan");

    // Who measures what: the run's own blocks, or as many of their size as there are ranks for.
    let mesh = &expected.layout.mesh;
    let whole = mesh.ranks() == all.size();
    let (part, here) =
        if whole { (case.clone(), mesh.clone()) } else { part_of(case, mesh, all.size()) };
    let mut block_plan = expected.clone();
    block_plan.layout.mesh = here;
    let mut prepared = Prepared::with_plan(world, &part, &bounds, block_plan)?;
    watch.part("weights", prepared.system.weight_seconds);
    watch.lap("assemble");
    let exact = (prepared.communicator.world).agree(exact_solution(&part, &prepared.place))?;
    if exact.is_some() {
        watch.lap("exact");
    }
    drop(exact);

    // The plan as the run will have it.
    let mut plan = expected;
    if plan.warp.is_some() {
        let measured = prepared.system.bounds(case, &bounds);
        let ratio = prepared.probe();
        if case.verify {
            let verify = verification(&watch, case, &bounds, &prepared.communicator);
            watch.seconds.insert("verify".to_owned(), verify);
        }
        watch.lap("probe");
        let (measured, ratio) = if whole {
            (measured, ratio)
        } else {
            // Of the whole box, where that is cheap.
            let found = crate::run::planning::plan(world, case, resources)?;
            let ratio = found.warp.map_or(ratio, |w| w.ratio);
            (found.bounds, ratio)
        };
        watch.last = Instant::now();
        plan = Plan::with_bounds(case, measured, resources, ratio)?;
        watch.lap("design");
    }
    prepared.plan.bounds = plan.bounds.clone();
    prepared.plan.warp.clone_from(&plan.warp);
    (prepared.plan.layout.groups).clone_from(&plan.layout.groups);
    let initial = std::mem::take(&mut prepared.system.initial);
    let mine: Vec<&[f64]> = (initial.iter()).map(|f| &f[prepared.place.mine.clone()]).collect();
    watch.last = Instant::now();
    moments(&prepared.communicator.world, &part, &mine);
    // Of the fields at the start and at the end.
    watch.seconds.insert("observables".to_owned(), 2.0 * watch.last.elapsed().as_secs_f64());
    drop(initial);

    let trials = Trials {
        case: &part,
        plan: &prepared.plan,
        communicator: &prepared.communicator,
        place: &prepared.place,
        whole,
    };
    let (solve, rate) = match &plan.warp {
        Some(warp) => trials.modes(&mut prepared.system, warp)?,
        None => trials.classical(&mut prepared.system)?,
    };
    let mut seconds = watch.seconds;
    let points = plan.warp.as_ref().and_then(|w| w.points);
    let given = match (&case.start, points) {
        (Some(_), Some(points)) => 8 * case.space.cells() * points,
        _ => 0,
    };
    let solve = solve + SECONDS_PER_GIVEN_BYTE * given as f64;
    seconds.insert("solve".to_owned(), solve);
    let warped = points.map_or(0, |points| all_bytes(case, points));
    let write = SECONDS_TO_WRITE
        + SECONDS_PER_BYTE * most_bytes(case) as f64
        + SECONDS_PER_WARPED_BYTE * warped as f64;
    seconds.insert("write".to_owned(), write);
    // Ranks wait for each other: the slowest counts, the same on all.
    for value in seconds.values_mut() {
        *value = all.max(*value);
    }
    let calibration = Calibration {
        ranks: all.size(),
        space_blocks: prepared.plan.layout.mesh.space.clone(),
        whole,
        took: all.max(started.elapsed().as_secs_f64()),
        seconds_per_application: rate,
        solve_seconds: seconds["solve"],
        wall_seconds: seconds.values().sum(),
        seconds,
    };
    Ok((plan, calibration))
}

/// Seconds that `solver.verify` takes: applications like those of the probe that was just run, of every field on every group, to
/// round-off.
fn verification(
    watch: &crate::base::stopwatch::Stopwatch,
    case: &Case,
    bounds: &Bounds,
    communicator: &Communicator,
) -> f64 {
    let courant = bounds.rate * case.end;
    let fields = case.fields.len();
    let probed = fields.div_ceil(communicator.modes.size()) * poisson_window(courant, ROUGH).end;
    let wanted = fields * poisson_window(courant, EXACT).end;
    watch.last.elapsed().as_secs_f64() * wanted as f64 / probed as f64
}

/// `case` on the middle of its box, cut down to blocks as large as those of `mesh` on at most `ranks` ranks, and the mesh of them.
fn part_of(case: &Case, mesh: &Mesh, ranks: usize) -> (Case, Mesh) {
    // As many blocks as divide the ranks, none more along an axis than the run has.
    let mut parts = vec![1; mesh.space.len()];
    let mut left = ranks;
    for (part, &most) in parts.iter_mut().zip(&mesh.space) {
        *part = (1..=most.min(left)).rev().find(|p| left.is_multiple_of(*p)).unwrap_or(1);
        left /= *part;
    }
    let cut = |((axis, &of), &parts): ((&Axis, &usize), &usize)| {
        let cells = (axis.cells.div_ceil(of) * parts).min(axis.cells);
        let first = ((axis.cells - cells) / 2) as i64;
        let (lower, upper) = (axis.face(first), axis.face(first + cells as i64));
        Axis::new(lower, upper, cells)
    };
    let x = (case.space.x.iter().zip(&mesh.space).zip(&parts)).map(cut).collect();
    let space = PhaseSpace {
        x,
        v: case.space.v.clone(),
        // These are whole: they are not split.
        periodic: case.space.periodic,
    };
    let mesh = Mesh { space: parts, groups: left };
    let case = Case { space, ..case.clone() };
    (case, mesh)
}

/// What is tried, on which ranks.
struct Trials<'a> {
    case: &'a Case,
    plan: &'a Plan,
    communicator: &'a Communicator,
    place: &'a Place,
    /// Whether these are the ranks of the run.
    whole: bool,
}

impl Trials<'_> {
    /// Seconds to solve, and for one application, by modes. Collective.
    fn modes(&self, problem: &mut DiscreteSystem, warp: &WarpPlan) -> Result<(f64, f64)> {
        let Self { case, plan, communicator, place, .. } = *self;
        let coupling = descriptor(plan.propagation.method).batch_coupling();
        let groups = &plan.layout.groups;
        let mine = &groups[communicator.modes.rank() % groups.len()];
        let tried = pieces(mine, coupling);
        let rows = problem.matrix.rows();
        let given = case.start.as_ref().map(|_| made_up(rows));
        let norms = given.iter().flat_map(|x| {
            [|x: &Complex64| x.re, |x: &Complex64| x.im]
                .map(|of| problem.norm(communicator, &x.iter().map(of).collect::<Vec<_>>(), false))
        });
        let norm = norms.fold(0.0, f64::hypot);
        let initial: Vec<Initial<'_>> = (problem.states.iter())
            .map(|state| {
                let own = || problem.norm(communicator, state, false);
                Initial::real(&state[..rows], if norm > 0.0 { norm } else { own() })
            })
            .collect();
        let factors = VelocityFactors::new(&case.space);
        let moments = MomentsOf {
            factors: &factors,
            pi: &problem.weights.pi[..problem.matrix.block.cells()],
            least: case.space.least_relative_volume().min(1.0),
        };
        let making = Instant::now();
        let world = &communicator.world;
        let (matrix, exchange) = (&problem.matrix, &mut problem.exchange);
        let (schedule, terms) = (problem.schedule.as_ref(), problem.terms);
        let all = Shortened::new(case, plan, warp, schedule, PARTS);
        drop(world.agree(all.propagator(matrix))?);
        let making = world.max(making.elapsed().as_secs_f64());
        let mut trial = |part: usize, batches: &[Batch]| -> Result<(f64, f64)> {
            let short = Shortened::new(case, plan, warp, schedule, part);
            let mut propagator = world.agree(short.propagator(matrix))?;
            let mut system = Evolution {
                matrix,
                exchange: &mut *exchange,
                space: &communicator.space,
                bounds: &plan.bounds,
                time: case.end,
                terms,
            };
            // As a full run does, but for the files.
            let mut kept = warp.points.map(|_| {
                let modes = batches.iter().flat_map(|b| b.modes.clone());
                KeptModes::new(matrix.rows(), modes.collect())
            });
            if let (Some(kept), Some(given)) = (&mut kept, &given) {
                kept.progress_mut().fill(ModeProgress::start(norm));
                let all = kept.values_mut().chunks_exact_mut(given.len().max(1));
                all.for_each(|mode| mode.copy_from_slice(given));
            }
            world.barrier();
            let started = Instant::now();
            let task = Task {
                communicator,
                warp: &short.warp,
                legs: &short.legs,
                batches,
                initial: &initial,
                shares: &place.ranges,
                moments: Some(&moments),
            };
            let mut unwritten = |_: usize, _: usize, _: &KeptModes| Ok(());
            let mut keeping = kept.as_mut().map(|kept| Keeping {
                kept,
                begun: given.is_some(),
                after: &mut unwritten,
            });
            modes::run(
                &task,
                &mut system,
                &mut *propagator,
                &mut Progress::silent(),
                RunHooks { keeping: keeping.as_mut(), checkpoints: None },
            )?;
            let seconds = world.max(started.elapsed().as_secs_f64());
            let cost: f64 = batches.iter().map(|b| short.cost(b, coupling)).sum();
            Ok((seconds, world.max(cost)))
        };
        let nothing = repeated(&mut || trial(1, &[]))?.0;
        let (rate, one) = line(&mut |part| trial(part, &tried))?;
        // Pieces of the group with most to do.
        let tried = world.max(tried.len() as f64).max(1.0);
        let piece = ((one - nothing) / tried).max(0.0);
        let most = groups.iter().map(|group| {
            let pieces = match coupling {
                BatchCoupling::Sequential => group.iter().map(|b| b.modes.len()).sum(),
                _ => group.len(),
            };
            let cost: f64 = group.iter().map(|b| all.cost(b, coupling)).sum();
            piece * pieces as f64 + rate * cost
        });
        let mut seconds = nothing + most.fold(0.0, f64::max);
        if self.whole && seconds < LONG_ENOUGH {
            // What takes so little is tried as it is.
            seconds = repeated(&mut || trial(PARTS, mine))?.0;
        }
        Ok((making + seconds, rate / case.fields.len() as f64))
    }

    /// As [`modes`](Self::modes), by the classical method. Collective.
    fn classical(&self, problem: &mut DiscreteSystem) -> Result<(f64, f64)> {
        let Self { case, plan, communicator, .. } = *self;
        let world = &communicator.world;
        let legs = |part: usize| -> (Vec<f64>, Vec<usize>) {
            let case = of_part(case, part);
            (case.legs(), classical_steps(&case, &plan.bounds))
        };
        let fields = case.fields.len();
        let mut trial = |part: usize| -> Result<(f64, f64)> {
            let (legs, steps) = legs(part);
            world.barrier();
            let started = Instant::now();
            for (k, start) in problem.states.iter().enumerate() {
                let slopes = Reconstruction::new(case, &problem.matrix, k);
                let slopes = world.agree(slopes)?;
                let mut classical =
                    Classical::of(case, &problem.matrix, &problem.weights.pi).with_slopes(slopes);
                let mut state = start.clone();
                for (&time, &steps) in legs.iter().zip(&steps) {
                    let span = Integration {
                        integrator: case.integrator,
                        rate: plan.bounds.rate,
                        time,
                        steps,
                    };
                    integrate(&mut classical, &mut problem.exchange, span, &mut state);
                }
            }
            let seconds = world.max(started.elapsed().as_secs_f64());
            Ok((seconds, (fields * steps.iter().sum::<usize>()) as f64))
        };
        let (rate, fixed) = line(&mut trial)?;
        let stages = if case.integrator == Integrator::SspRk3 { 3.0 } else { 1.0 };
        let all = (fields * plan.classical_steps) as f64;
        Ok((fixed + rate * all, rate / stages))
    }
}

/// A mode of so many rows that stands for those of a file: of no length scale, and zero nowhere, as zeros take no time.
fn made_up(rows: usize) -> Vec<Complex64> {
    (0..rows).map(|i| Complex64::cis((i * i % 257) as f64)).collect()
}

/// `case` with every leg cut down to `part` of [`PARTS`] equal parts.
fn of_part(case: &Case, part: usize) -> Case {
    let fraction = part as f64 / PARTS as f64;
    let mut case = case.clone();
    case.end *= fraction;
    case.times.iter_mut().for_each(|at| at.time *= fraction);
    case
}

/// A run of the modes with every leg cut down.
struct Shortened<'a> {
    plan: &'a Plan,
    warp: WarpPlan,
    legs: Vec<Leg>,
    schedule: Option<Schedule>,
}

impl<'a> Shortened<'a> {
    /// Of `plan` to `part` of [`PARTS`] equal parts, or as many whole steps as that takes; each mode is allowed its part of the
    /// error, too.
    fn new(
        case: &Case,
        plan: &'a Plan,
        warp: &WarpPlan,
        schedule: Option<&Schedule>,
        part: usize,
    ) -> Self {
        let fraction = part as f64 / PARTS as f64;
        let mut legs = Leg::all(case);
        let mut warp = warp.clone();
        let mut scratch = Vec::new();
        let schedule = schedule.map(|all| {
            let steps = (all.steps * part).div_ceil(PARTS);
            Schedule {
                steps,
                couplings: all.couplings[..2 * steps * all.envelope.len()].to_vec(),
                ..all.clone()
            }
        });
        for (k, leg) in legs.iter_mut().enumerate() {
            let steps = match &schedule {
                // One leg, two stages a step.
                Some(_) => plan.bounds.stages / 2,
                None => propagate::steps(&plan.propagation, leg.time),
            };
            let fraction = match steps {
                0 => fraction,
                steps => (steps * part).div_ceil(PARTS) as f64 / steps as f64,
            };
            leg.time *= fraction;
            if part == PARTS {
                continue;
            }
            for l in 0..warp.modes {
                let span = Span { time: leg.time, tolerance: warp.leg_tolerance(l) * fraction };
                let (mu, bounds) = (warp.wavenumber(l), &plan.bounds);
                let work = propagate::work(&case.propagator, bounds, mu, span, &mut scratch);
                warp.leg_work[k][l] = work;
            }
        }
        warp.state_tolerance *= fraction;
        Self { plan, warp, legs, schedule }
    }

    fn propagator(&self, matrix: &BlockMatrix) -> Result<Box<dyn Propagator + '_>> {
        let setting = self.plan.propagator_setting(&self.warp);
        propagator(&setting, self.schedule.as_ref(), matrix)
    }

    /// What a batch costs, as the plan counts it leg by leg, each exponential of an inflow that varies with its own degree.
    fn cost(&self, batch: &Batch, coupling: BatchCoupling) -> f64 {
        let mut scratch = Vec::new();
        let bounds = &self.plan.bounds;
        let mut sum = 0;
        for (leg, work) in self.legs.iter().zip(&self.warp.leg_work) {
            let works = batch.modes.iter().map(|&l| match &self.schedule {
                None => work[l],
                Some(schedule) => {
                    let interval = bounds.interval(self.warp.wavenumber(l));
                    let (tau, stages) = (interval.half_width * leg.time, schedule.stages());
                    stages * stage_degree(&mut scratch, tau, work[l], stages)
                }
            });
            sum += coupling.cost(works);
        }
        sum as f64
    }
}

/// The pieces of a group that are tried: one, where all run at one rate, otherwise some from the longest to the shortest.
fn pieces(group: &[Batch], coupling: BatchCoupling) -> Vec<Batch> {
    let all: Vec<Batch> = match coupling {
        BatchCoupling::Independent => return group.iter().take(1).cloned().collect(),
        BatchCoupling::Coupled => group.to_vec(),
        BatchCoupling::Sequential => (group.iter())
            .flat_map(|batch| &batch.modes)
            .map(|&mode| Batch { modes: vec![mode], cost: 1 })
            .collect(),
    };
    let count = all.len().min(PIECES);
    let at = |k: usize| all[k * (all.len() - 1) / (count - 1).max(1)].clone();
    (0..count).map(at).collect()
}

/// Seconds a unit of cost, and what is left at no cost: from the first of [`PARTS`] parts of the time and so many more that they take
/// long enough to tell. `trial` tells seconds and cost, the same on all ranks.
fn line(trial: &mut impl FnMut(usize) -> Result<(f64, f64)>) -> Result<(f64, f64)> {
    // The first of all also finds its way into the memory.
    trial(1)?;
    let (mut part, first) = (1, repeated(&mut || trial(1))?);
    let mut last = first;
    // A slow moment is not long enough by itself: there must be more to do than at first.
    while (last.0 < LONG_ENOUGH || last.1 < 2.0 * first.1) && part < PARTS {
        part *= 2;
        last = trial(part)?;
    }
    if part > 1 {
        last = repeated(&mut || trial(part))?;
    }
    let more = last.1 - first.1;
    let rate = if more > 0.0 {
        ((last.0 - first.0) / more).max(0.0)
    } else {
        // All there is to do was done.
        last.0 / last.1.max(1.0)
    };
    Ok((rate, (last.0 - rate * last.1).max(0.0)))
}

/// The mean of a trial that is repeated while that takes little: a run, too, takes what is slow now and then as it comes.
fn repeated(trial: &mut impl FnMut() -> Result<(f64, f64)>) -> Result<(f64, f64)> {
    let (first, cost) = trial()?;
    let times = (2.0 * LONG_ENOUGH / first.max(1e-9)).clamp(1.0, REPEATS);
    let mut sum = first;
    for _ in 1..times as usize {
        sum += trial()?.0;
    }
    Ok((sum / times.floor(), cost))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_of_a_part_are_as_large_as_those_of_the_whole() {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("cases/example3.toml");
        let sizes =
            |n: usize, m: usize| [format!("axis.0.x.cells={n}"), format!("axis.1.x.cells={m}")];
        // Cells, blocks of the run and its mode groups, ranks at hand; blocks and groups they have.
        for (cells, blocks, groups, ranks, expected) in [
            ([20, 30], [4, 5], 3, 4, ([4, 1], 1)),
            ([20, 30], [4, 5], 3, 6, ([3, 2], 1)),
            ([20, 30], [1, 1], 64, 2, ([1, 1], 2)),
            ([21, 31], [2, 3], 1, 1, ([1, 1], 1)),
            ([21, 31], [2, 3], 1, 7, ([1, 1], 7)),
        ] {
            let case = Case::load(&path, &sizes(cells[0], cells[1])).expect("a case");
            let mesh = Mesh { space: blocks.to_vec(), groups };
            let (part, here) = part_of(&case, &mesh, ranks);
            assert_eq!((here.space.clone(), here.groups), (expected.0.to_vec(), expected.1));
            assert_eq!(here.ranks(), ranks);
            for (axis, (whole, a)) in part.space.x.iter().zip(case.space.x.iter().zip(0..)) {
                let largest = whole.cells.div_ceil(blocks[a]);
                assert_eq!(axis.cells.div_ceil(here.space[a]), largest.min(axis.cells));
                assert!((axis.width() - whole.width()).abs() < 1e-12);
                assert!(axis.lower >= whole.lower - 1e-12 && axis.upper <= whole.upper + 1e-12);
            }
        }
    }
}
