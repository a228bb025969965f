//! `phasewarp plan`: memory, work and process meshes of a run.

use crate::base::error::Result;
use crate::command::cli::PlanArgs;
use crate::command::loading::{load_for_accuracy, reduced_case};
use crate::command::printing::{print, print_json};
use crate::parallel::communicator::World;
use crate::plan::Plan;
use crate::plan::advice::{Advice, Node};
use crate::plan::here::memory_per_rank;
use crate::plan::layout::Resources;
use crate::run::planning;
use crate::study::calibrate::{Calibration, calibrate};
use serde::Serialize;

/// What `plan --json` prints.
#[derive(Serialize)]
struct Planned<'a> {
    #[serde(flatten)]
    plan: &'a Plan,
    advice: &'a Advice,
    #[serde(skip_serializing_if = "Option::is_none")]
    calibration: Option<&'a Calibration>,
}

/// Plans the case, with `--calibrate` from a few steps of it. Collective.
///
/// # Errors
/// As [`planning::plan`], [`calibrate`] and `load_for_accuracy`.
pub fn execute(world: &World, args: &PlanArgs) -> Result<()> {
    let case = reduced_case(world, &load_for_accuracy(world, &args.case, &args.accuracy)?)?;
    let started = world.group().size();
    let ranks = args.ranks.map_or(if args.calibrate { started } else { 1 }, |n| n as usize);
    let node = args
        .memory_per_node
        .map(|memory| Node { memory, ranks: args.ranks_per_node.map_or(ranks, |n| n as usize) });
    // A node that is not full has more for each rank.
    let share = node.map(|node| node.memory / node.ranks.min(ranks) as u64);
    let resources = Resources {
        ranks,
        ranks_x: args.ranks_x.clone(),
        memory_per_rank: args.memory_per_rank.or(share),
    };
    let (plan, calibration) = if args.calibrate {
        let (plan, found) = calibrate(world, &case, &resources)?;
        (plan, Some(found))
    } else {
        (planning::plan(world, &case, &resources)?, None)
    };
    // As if all its ranks were started here.
    let here = memory_per_rank(&world.group()) as f64 * started as f64 / ranks as f64;
    let advice = Advice::new(&case, &plan, &resources, node, here as u64);
    if args.json {
        let planned = Planned { plan: &plan, advice: &advice, calibration: calibration.as_ref() };
        print_json(world, &planned);
        return Ok(());
    }
    print(world, &plan.to_string());
    print(world, &advice.to_string());
    if let Some(calibration) = calibration {
        print(world, &calibration.to_string());
    }
    Ok(())
}
