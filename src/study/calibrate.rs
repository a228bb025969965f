//! How long a run will take, from a few steps of it: `phasewarp plan --calibrate`.
//!
//! The steps before the modes (assembling, weights, probe, exact solution) are done as in a run,
//! and timed. Then some modes are propagated for a part of the time, by the code of a run and on
//! all ranks at once, so that the times include ghost exchange and the memory bandwidth that ranks
//! share. Propagating `pieces` over `n` of the parts of `T` takes
//!
//! ```text
//! t(n) = fixed + piece · pieces + rate · cost(n)
//! ```
//!
//! seconds, and a run takes as long with the pieces and the whole cost of the mode group with most
//! to do. A piece is a batch of modes, or one mode where modes are propagated one after the other.
//! The cost is what the plan counts, applications or solves.
//!
//! The calibration may have fewer ranks than the run, or more. Each then takes a block of the size
//! that a rank of the run has, and the box is cut down to these blocks.

pub mod classical;
pub mod modes;
pub mod timing;

use crate::base::error::Result;
use crate::base::stopwatch::Stopwatch;
use crate::base::text::{counted, seconds_text};
use crate::matrix::bounds::Bounds;
use crate::matrix::observables::moments;
use crate::parallel::communicator::World;
use crate::parallel::partition::ProcessMesh;
use crate::plan::here::memory_per_rank;
use crate::plan::layout::Resources;
use crate::plan::{Plan, ProvisionalPlan};
use crate::problem::case::{Case, Integrator};
use crate::problem::grid::{Axis, PhaseSpace};
use crate::results::result_file::most_bytes;
use crate::results::result_grid::ResultGrid;
use crate::results::warped::all_bytes;
use crate::run::errors::exact_points;
use crate::run::exact::ExactTask;
use crate::run::exact::velocities::limits::expected_points;
use crate::run::ledger;
use crate::run::planning;
use crate::solve::prepared::Prepared;
use crate::study::calibrate::timing::SolveTime;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt;
use std::time::Instant;

// Seconds of input and output, measured on a local disk. They depend on the file system.
/// Seconds to create the files and write their metadata.
const SECONDS_TO_WRITE: f64 = 0.01;
/// Seconds to write a byte and read it back.
const SECONDS_PER_BYTE: f64 = 2e-9;
/// Seconds a byte of the warped field, which is transposed and transformed before it is written.
const SECONDS_PER_WARPED_BYTE: f64 = 5e-9;
/// Seconds a byte of the warped field that a run starts from, to read it and take its norms.
const SECONDS_PER_GIVEN_BYTE: f64 = 4e-9;

/// The predicted seconds of a run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Calibration {
    /// Number of ranks of the calibration.
    pub ranks: usize,
    /// Space blocks of the calibration along each x-axis.
    pub space_blocks: Vec<usize>,
    /// Whether the calibration had as many ranks as the run, and so the whole box.
    pub whole: bool,
    /// Seconds that the calibration took, with the plan.
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
            "calibrated      on {} in {:.1} s: {:.3e} s an application on a rank's block{}",
            counted(self.ranks, "rank", "ranks"),
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

/// A run whose seconds were measured. Seconds on other numbers of ranks follow by scaling.
pub struct CalibratedRun {
    /// The plan.
    pub plan: Plan,
    /// Calibration of the run.
    pub calibration: Calibration,
}

/// The plan of a run on `resources`, and its expected seconds and memory, measured on the ranks of
/// `world`. Collective.
///
/// # Errors
/// As [`planning::plan`]; [`crate::base::error::Error::Memory`] where a rank's block does not fit
/// into this machine.
pub fn calibrate(world: &World, case: &Case, resources: &Resources) -> Result<CalibratedRun> {
    let started = Instant::now();
    let all = world.group();
    let mut watch = Stopwatch::start(0.0);
    let case = &planning::read_and_reduced(&all, case)?;
    let ProvisionalPlan { bounds, plan: provisional } = ProvisionalPlan::new(case, resources)?;
    let limited = Resources { memory_per_rank: Some(memory_per_rank(&all)), ..resources.clone() };
    (provisional.layout.clone()).within(provisional.work(case), &limited)?;
    watch.lap("plan");
    let run = CalibratedCase { world, case, resources, bounds, provisional };
    let mut block = run.block(&run.provisional, &mut watch)?;
    let plan = run.plan(&mut block, &mut watch)?;
    if plan.layout.mesh != run.provisional.layout.mesh {
        drop(block);
        block = run.block(&plan, &mut watch)?;
    }
    let mut block = block.with_modes_of(&plan);
    let part = block.case.clone();
    if case.verify && plan.warp.is_some() {
        let mut reference = part.clone();
        reference.classical.integrator = Integrator::Exponential;
        let verify = classical::predict_solve_time(&mut block, &reference)?.solve;
        watch.seconds.insert("verify".to_owned(), verify);
    }
    time_observables(&mut block, &mut watch);
    watch.last = Instant::now();
    ledger::before_run(&all, &ResultGrid::new(case).case)?;
    *watch.seconds.entry("observables".to_owned()).or_default() +=
        watch.last.elapsed().as_secs_f64();
    let SolveTime { solve, application } = match &plan.warp {
        Some(warp) => modes::predict_solve_time(&mut block, warp, run.whole())?,
        None => classical::predict_solve_time(&mut block, &part)?,
    };
    let mut seconds = watch.seconds;
    seconds.insert("solve".to_owned(), solve + seconds_to_read(case, &plan));
    seconds.insert("write".to_owned(), seconds_to_write(case, &plan));
    // Ranks wait for each other: the slowest counts, the same on all.
    for value in seconds.values_mut() {
        *value = all.max(*value);
    }
    let calibration = Calibration {
        ranks: all.size(),
        space_blocks: block.plan.layout.mesh.space.clone(),
        whole: run.whole(),
        took: all.max(started.elapsed().as_secs_f64()),
        seconds_per_application: application,
        solve_seconds: seconds["solve"],
        wall_seconds: seconds.values().sum(),
        seconds,
    };
    Ok(CalibratedRun { plan, calibration })
}

/// The run that is calibrated, with its plan before growth and norms are measured.
struct CalibratedCase<'a> {
    world: &'a World,
    case: &'a Case,
    resources: &'a Resources,
    bounds: Bounds,
    provisional: Plan,
}

impl CalibratedCase<'_> {
    /// Whether the run has as many ranks as the calibration.
    fn whole(&self) -> bool {
        self.provisional.layout.mesh.ranks() == self.world.group().size()
    }

    /// The blocks of `plan`, assembled and timed, or as many blocks of their size as there are
    /// ranks for. Collective.
    fn block(&self, plan: &Plan, watch: &mut Stopwatch) -> Result<Prepared> {
        let mesh = &plan.layout.mesh;
        let (part, here) = if self.whole() {
            (self.case.clone(), mesh.clone())
        } else {
            cut_in_space(self.case, mesh, self.world.group().size())
        };
        let sweeps = self.provisional.max_weight_sweeps();
        let mut plan = plan.clone();
        plan.layout.mesh = here;
        let block = Prepared::with_sweeps(self.world, &part, &self.bounds, plan, sweeps)?;
        watch.part("weights", block.system.weight_seconds);
        watch.lap("assemble");
        let (world, rank_cells) = (&block.communicator.world, &block.rank_cells);
        let exact = ExactTask { world, case: &part, rank_cells, prints: false, wall: None };
        let found = exact.run()?;
        if found.exact.is_some() {
            let seconds = watch.last.elapsed().as_secs_f64();
            watch.lap("exact");
            let nodes = values_at_nodes(&part, found.moments.len());
            let of_errors = seconds * values_of_errors(&part) / nodes;
            *watch.seconds.entry("exact".to_owned()).or_default() += of_errors;
        }
        Ok(block)
    }

    /// The plan of the run, with the bounds and norms that are measured on the `block`. Collective.
    fn plan(&self, block: &mut Prepared, watch: &mut Stopwatch) -> Result<Plan> {
        let case = self.case;
        if self.provisional.warp.is_none() {
            return Ok(self.provisional.clone());
        }
        let mut bounds = block.bounds.clone();
        let mut ratio = block.probe();
        watch.lap("probe");
        if !self.whole() {
            // Bounds and ratio of the whole box: measured if that is cheap, else assumed.
            let found = planning::plan(self.world, case, self.resources)?;
            ratio = found.warp.map_or(ratio, |w| w.ratio);
            let assembled = found.bounds.assembled.or(bounds.assembled);
            bounds = Bounds { assembled, ..found.bounds };
        }
        watch.last = Instant::now();
        let plan = self.provisional.measured(case, bounds, self.resources, ratio)?;
        watch.lap("design");
        Ok(plan)
    }
}

/// About the number of values of which the exact solution is made, with moments at so many `times`.
fn values_at_nodes(case: &Case, times: usize) -> f64 {
    let space = &case.space;
    space.cells() as f64 + times as f64 * expected_points(case, space.space_cells() as f64)
}

/// About the number of exact values of which the errors on elements are made.
fn values_of_errors(case: &Case) -> f64 {
    let is_integral = case.space.whole_degree() > 0 && !case.is_measure_valued();
    if is_integral { exact_points(case) } else { 0.0 }
}

/// Times the moments of the fields at the start and at the end; the fields at the start are
/// dropped. Collective.
fn time_observables(block: &mut Prepared, watch: &mut Stopwatch) {
    let initial = std::mem::take(&mut block.system.initial);
    let mine: Vec<&[f64]> = (initial.iter()).map(|f| &f[block.rank_cells.mine.clone()]).collect();
    watch.last = Instant::now();
    moments(&block.communicator.world, &block.case, &block.rank_cells.share, &mine);
    watch.seconds.insert("observables".to_owned(), 2.0 * watch.last.elapsed().as_secs_f64());
}

/// Points of the warped field, where one is written or read.
fn points(plan: &Plan) -> Option<usize> {
    plan.warp.as_ref()?.points
}

/// Seconds for the warped field that a run starts from.
fn seconds_to_read(case: &Case, plan: &Plan) -> f64 {
    let points = points(plan).filter(|_| case.warped_start.is_some());
    let bytes = points.map_or(0, |points| 8 * case.space.cells() * points);
    SECONDS_PER_GIVEN_BYTE * bytes as f64
}

fn seconds_to_write(case: &Case, plan: &Plan) -> f64 {
    let warped = points(plan).map_or(0, |points| all_bytes(case, points));
    SECONDS_TO_WRITE
        + SECONDS_PER_BYTE * most_bytes(case) as f64
        + SECONDS_PER_WARPED_BYTE * warped as f64
}

/// `case` on the middle of its box, cut down to as many blocks of the size of those of `mesh` as
/// `ranks` ranks can take, and the mesh of these blocks.
fn cut_in_space(case: &Case, mesh: &ProcessMesh, ranks: usize) -> (Case, ProcessMesh) {
    // Along each axis a number of blocks that divides the ranks left, at most that of the run.
    let mut parts = vec![1; mesh.space.len()];
    let mut left = ranks;
    for (part, &most) in parts.iter_mut().zip(&mesh.space) {
        *part = (1..=most.min(left)).rev().find(|p| left.is_multiple_of(*p)).unwrap_or(1);
        left /= *part;
    }
    let cut = |((axis, &of), &parts): ((&Axis, &usize), &usize)| {
        let all = axis.elements();
        let elements = (all.div_ceil(of) * parts).min(all);
        let first = ((all - elements) / 2) as i64;
        let (lower, upper) = (axis.face(first), axis.face(first + elements as i64));
        Axis::new(lower, upper, elements).with_nodes(axis.nodes)
    };
    let x = (case.space.x.iter().zip(&mesh.space).zip(&parts)).map(cut).collect();
    let space = PhaseSpace {
        x,
        v: case.space.v.clone(),
        // A periodic axis is never split, so it stays whole.
        periodic: case.space.periodic,
    };
    let mesh = ProcessMesh { space: parts, groups: left };
    let case = Case { space, ..case.clone() };
    (case, mesh)
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
            let mesh = ProcessMesh { space: blocks.to_vec(), groups };
            let (part, here) = cut_in_space(&case, &mesh, ranks);
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
