//! `phasewarp plan`: memory, work and process meshes of a run.

use crate::base::error::Result;
use crate::command::accuracy::with_accuracy;
use crate::command::cli::PlanArgs;
use crate::command::describe::{errors, readout};
use crate::command::loading::load;
use crate::command::printing::{print, print_as, print_json};
use crate::command::sbatch::{self, JobResources};
use crate::command::values::RankNumbers;
use crate::parallel::communicator::World;
use crate::plan::here::{announce_slow_steps, memory_per_rank};
use crate::plan::job_request::{JobRequest, MachineNode};
use crate::plan::layout::{Layout, Resources};
use crate::plan::{Plan, refuse_long_transport};
use crate::problem::case::Case;
use crate::run::planning::{self, RunPlans};
use crate::run::warnings::warnings;
use crate::study::calibrate::{CalibratedRun, Calibration, calibrate};
use crate::study::ranks::{RankChoice, RankTable};
use serde::Serialize;

/// What `plan --json` prints for one number of ranks.
#[derive(Serialize)]
struct PlanJson<'a> {
    #[serde(flatten)]
    plan: &'a Plan,
    layout: &'a Layout,
    advice: &'a JobRequest,
    /// Warnings about the case; those of its modes are in the plan.
    warnings: &'a [String],
    #[serde(skip_serializing_if = "Option::is_none")]
    calibration: Option<&'a Calibration>,
}

/// Plans the case on one number of ranks or on several; `--calibrate` measures a few steps.
/// Collective.
///
/// # Errors
/// As [`planning::plan`], [`calibrate`], `load`, `with_accuracy` and [`sbatch::write`].
pub fn execute(world: &World, args: &PlanArgs) -> Result<()> {
    let case = load(world, &args.case)?;
    sbatch::refuse(world, args, &case)?;
    let case = with_accuracy(world, case, &args.case.changes, &args.accuracy)?;
    let case = planning::read_and_reduced(&world.group(), &case)?;
    if refuse_long_transport(&case).is_ok() {
        announce_slow_steps(world, &case);
    }
    let needs = match &args.ranks {
        Some(RankNumbers::Many(numbers)) => on_many(world, args, &case, numbers),
        Some(RankNumbers::One(ranks)) => on_one(world, args, &case, *ranks),
        None if args.calibrate => on_one(world, args, &case, world.group().size()),
        None => on_one(world, args, &case, 1),
    }?;
    if !args.json {
        warnings(&case).iter().for_each(|warning| print(world, &format!("warning: {warning}")));
    }
    sbatch::write(world, args, &case, needs)
}

/// The node that the options describe, if they do.
fn node(args: &PlanArgs, ranks: usize) -> Option<MachineNode> {
    let on_node = args.ranks_per_node.map(|n| n as usize);
    let memory = args.memory_per_node;
    (memory.is_some() || on_node.is_some())
        .then(|| MachineNode { memory, ranks: on_node.unwrap_or(ranks) })
}

/// The resources of a run on `ranks` ranks.
fn resources(args: &PlanArgs, ranks: usize) -> Resources {
    let share = node(args, ranks).and_then(|node| node.share(ranks));
    Resources {
        ranks,
        ranks_x: args.ranks_x.clone(),
        memory_per_rank: args.memory_per_rank.or(share),
    }
}

/// Prints the plan on `ranks` ranks. Collective.
fn on_one(world: &World, args: &PlanArgs, case: &Case, ranks: usize) -> Result<JobResources> {
    let resources = resources(args, ranks);
    let (plan, calibration) = if args.calibrate {
        let CalibratedRun { plan, calibration } = calibrate(world, case, &resources)?;
        (plan, Some(calibration))
    } else {
        (planning::plan(world, case, &resources)?, None)
    };
    // The memory of this machine for each of `ranks` ranks.
    let all = world.group();
    let here = memory_per_rank(&all) as f64 * all.size() as f64 / ranks as f64;
    let advice = JobRequest::new(case, &plan, &resources, node(args, ranks), here as u64);
    let calibration = calibration.as_ref();
    if args.json {
        let warnings = &warnings(case);
        let layout = &plan.layout;
        print_json(
            world,
            &PlanJson { plan: &plan, layout, advice: &advice, warnings, calibration },
        );
    } else {
        print(world, &plan.to_string());
        print(world, &(errors(case) + &readout(case)));
        print(world, &advice.to_string());
        if let Some(calibration) = calibration {
            print(world, &calibration.to_string());
        }
    }
    let seconds = calibration.map(|found| found.wall_seconds);
    Ok(JobResources { ranks, memory: plan.memory(), seconds })
}

/// Prints a table for these ascending numbers of ranks. Returns what the last number that is worth
/// it needs. Collective.
fn on_many(world: &World, args: &PlanArgs, case: &Case, numbers: &[usize]) -> Result<JobResources> {
    let most = numbers.last().copied().unwrap_or(1);
    let measured = planning::MeasuredCase::new(world, case, &resources(args, most))?;
    let plan_on = |known: &Option<RunPlans>, resources: &Resources| match known {
        None => measured.plan(resources),
        Some(known) => known.on(&measured.case, resources),
    };
    let mut known = None;
    let mut choices = Vec::new();
    for &ranks in numbers {
        let resources = resources(args, ranks);
        let plan = plan_on(&known, &resources).map(|planned| known.insert(planned).plan.clone());
        choices.push(RankChoice { ranks, node: node(args, ranks), plan });
    }
    let reference = if args.calibrate {
        Some(calibrate(world, case, &resources(args, ranks_of_reference(world, &choices)))?)
    } else {
        None
    };
    // Its cost is compared with others, also where it does not fit.
    let alone = Resources { ranks: 1, ..Resources::default() };
    let one = plan_on(&known, &alone)?;
    let table = RankTable::new(&measured.case, choices, &one.plan, reference.as_ref())?;
    print_as(world, &table, args.json);
    let best = table.recommended();
    Ok(JobResources {
        ranks: best.map_or(1, |best| best.ranks),
        memory: best.map_or(0, |best| best.memory),
        seconds: best.and_then(|best| best.seconds),
    })
}

/// The number of ranks whose seconds are measured: of those that fit, the smallest that is not
/// below the number of started ranks, else the largest.
fn ranks_of_reference(world: &World, choices: &[RankChoice]) -> usize {
    let started = world.group().size();
    let fitting = || choices.iter().filter(|choice| choice.plan.is_ok()).map(|c| c.ranks);
    fitting().find(|&ranks| ranks >= started).or(fitting().next_back()).unwrap_or(started)
}
