//! The plan that a run would have.

use crate::base::error::Result;
use crate::matrix::bounds::Bounds;
use crate::matrix::observables::Totals;
use crate::parallel::communicator::{Group, World};
use crate::plan::here::refuse_hopeless_here;
use crate::plan::layout::{Resources, refuse_hopeless};
use crate::plan::{ASSUMED_RATIO, Plan};
use crate::problem::case::{Case, Method, StartField};
use crate::results::start_field::origin;
use crate::results::warped::given::Given;
use crate::run::at_start::at_start;
use crate::scheme::reduce::reduced;
use crate::solve::prepared::Prepared;
use std::borrow::Cow;

/// Updates of cells that the probe may take for a plan.
const CHEAP_UPDATES: f64 = 1e8;

/// The plan that a run on `resources` would have, with growth and norms measured on `world`'s ranks
/// where that takes a fraction of a second, or where no plan can be made without. Collective.
///
/// # Errors
/// As [`Plan::new`] and [`Prepared::new`].
pub fn plan(world: &World, case: &Case, resources: &Resources) -> Result<Plan> {
    Ok(preview(world, case, resources)?.plan)
}

/// What is known of a run before it.
pub struct Preview {
    /// The plan.
    pub plan: Plan,
    /// Totals of the data on the grid at time zero, where the grid was assembled for the plan.
    pub at_start: Option<Totals>,
}

/// The plan of [`plan`], and what else its preparation tells. Collective.
///
/// # Errors
/// As [`plan`].
pub fn preview(world: &World, case: &Case, resources: &Resources) -> Result<Preview> {
    let all = world.group();
    let case = &reduced(&all, &*with_start(&all, case)?)?;
    refuse_hopeless(case, resources)?;
    let bounds = Bounds::new(case)?;
    let updates = case.space.cells() as f64 * (bounds.rate * case.duration()).max(1.0);
    let must = bounds.growth.is_infinite();
    if case.method == Method::Classical || (updates > CHEAP_UPDATES && !must) {
        let plan = Plan::with_bounds(case, bounds, resources, ASSUMED_RATIO)?;
        return Ok(Preview { plan, at_start: None });
    }
    refuse_hopeless_here(world, case)?;
    let here = Resources { ranks: all.size(), ..Resources::default() };
    let mut prepared = Prepared::new(world, case, &here)?;
    let ratio = prepared.probe();
    let at_start = at_start(&mut prepared).map(|found| found.totals);
    let plan = Plan::with_bounds(case, prepared.bounds, resources, ratio)?;
    Ok(Preview { plan, at_start })
}

/// The case with what the file that it starts from says, if it does: the points of a warped field,
/// the origin of a field. Collective.
///
/// # Errors
/// As [`Given::new`] and [`origin`].
pub fn with_start<'a>(world: &Group, case: &'a Case) -> Result<Cow<'a, Case>> {
    if let Some(start) = &case.start_field {
        let origin = Some(origin(world, start, case)?);
        let start_field = Some(StartField { origin, ..start.clone() });
        return Ok(Cow::Owned(Case { start_field, ..case.clone() }));
    }
    let Some(start) = &case.start else {
        return Ok(Cow::Borrowed(case));
    };
    let given = Given::new(world, &start.path, case, &start.place)?;
    let mut case = case.clone();
    (case.warp.interval, case.warp.points) = (Some(given.interval), Some(given.points));
    Ok(Cow::Owned(case))
}
