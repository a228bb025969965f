//! The plan of a run, without running it.

use crate::base::error::Result;
use crate::matrix::bounds::Bounds;
use crate::matrix::observables::Totals;
use crate::parallel::communicator::{Group, World};
use crate::plan::here::refuse_too_large_here;
use crate::plan::layout::{Resources, refuse_too_large};
use crate::plan::{ASSUMED_RATIO, Plan, bounds_if_it_fits};
use crate::problem::case::{Case, Method, StartField};
use crate::results::start_field::origin;
use crate::results::table_file::with_tables;
use crate::results::warped::initial_file::WarpedFile;
use crate::run::at_start::at_start;
use crate::scheme::reduce::reduced;
use crate::solve::prepared::Prepared;
use std::borrow::Cow;

/// Largest number of cell updates for which the probe is made for a plan.
const CHEAP_UPDATES: f64 = 1e8;
/// Largest number of cells for which the factors of an implicit method are measured for a plan.
const CHEAP_FACTORS: usize = 1 << 17;

/// The plan of a run on `resources`. Growth and norms are measured on the ranks of `world` if that
/// takes a fraction of a second, or if a plan is impossible without. Collective.
///
/// # Errors
/// As [`Plan::new`] and [`Prepared::new`].
pub fn plan(world: &World, case: &Case, resources: &Resources) -> Result<Plan> {
    Ok(MeasuredCase::new(world, case, resources)?.plan(resources)?.plan)
}

/// A reduced case with its measured growth and norms. Plans for any number of ranks follow from it.
pub struct MeasuredCase {
    /// The reduced case.
    pub case: Case,
    /// Bounds before the growth is measured. A run is assembled by them.
    expected: Bounds,
    /// Bounds with the measured growth.
    bounds: Bounds,
    /// The ratio of norms `‖ũ(0)‖/‖f(T)‖`.
    ratio: f64,
    /// Totals of the data on the grid at time zero, if the grid was assembled.
    pub at_start: Option<Totals>,
}

impl MeasuredCase {
    /// Measures growth and norms on the ranks of `world` if that takes a fraction of a second, or
    /// if a plan is impossible without; growth and factors of an implicit method if that takes
    /// about a second. Collective.
    ///
    /// # Errors
    /// [`crate::base::error::Error::Memory`] if the case does not fit into `resources`; as
    /// [`Prepared::new`].
    pub fn new(world: &World, case: &Case, resources: &Resources) -> Result<Self> {
        let all = world.group();
        let case = read_and_reduced(&all, case)?;
        let bounds = bounds_if_it_fits(&case, resources)?;
        let updates = case.space.cells() as f64 * (bounds.rate * case.duration()).max(1.0);
        let is_unbounded = bounds.growth.is_infinite();
        let expected = bounds.clone();
        let probes = updates <= CHEAP_UPDATES || is_unbounded;
        let has_factors = case.propagator.method.order() > 0;
        let measures = probes || (has_factors && case.space.cells() <= CHEAP_FACTORS);
        if case.method == Method::Classical || !measures {
            return Ok(Self { case, expected, bounds, ratio: ASSUMED_RATIO, at_start: None });
        }
        refuse_too_large_here(world, &case)?;
        let mut prepared = Prepared::new(world, &case, &Resources::unlimited(world))?;
        let ratio = if probes { prepared.probe() } else { ASSUMED_RATIO };
        let at_start = at_start(&mut prepared).map(|found| found.totals);
        Ok(Self { case, expected, bounds: prepared.bounds, ratio, at_start })
    }

    /// The plan of a run on `resources`, and the provisional one by which it is assembled.
    ///
    /// # Errors
    /// As [`Plan::new`].
    pub fn plan(&self, resources: &Resources) -> Result<RunPlans> {
        refuse_too_large(&self.case, resources)?;
        let provisional = Plan::provisional(&self.case, &self.expected, resources)?;
        let bounds = self.bounds.clone();
        let plan = provisional.measured(&self.case, bounds, resources, self.ratio)?;
        Ok(RunPlans { provisional, plan })
    }
}

/// A plan, and the provisional one before growth and norms were measured.
pub struct RunPlans {
    /// The plan by which the run is assembled.
    provisional: Plan,
    /// The plan of the run.
    pub plan: Plan,
}

impl RunPlans {
    /// The plans of the same `case` on other `resources`, with the same modes.
    ///
    /// # Errors
    /// [`crate::base::error::Error::Ranks`] and [`crate::base::error::Error::Memory`].
    pub fn on(&self, case: &Case, resources: &Resources) -> Result<Self> {
        refuse_too_large(case, resources)?;
        let provisional = self.provisional.on(case, resources)?;
        let free = self.plan.on(case, resources)?;
        let plan = free.near(case, resources, &provisional.layout.mesh);
        Ok(Self { provisional, plan })
    }
}

/// [`with_files_read`], reduced as a run does it. Collective.
///
/// # Errors
/// As [`with_files_read`] and [`reduced`].
pub fn read_and_reduced(world: &Group, case: &Case) -> Result<Case> {
    reduced(world, &*with_files_read(world, case)?)
}

/// The case with data of the files that it names: points of a warped field, origin of a field,
/// values of tables. Collective.
///
/// # Errors
/// As [`WarpedFile::new`], [`origin`] and [`with_tables`].
pub fn with_files_read<'a>(world: &Group, case: &'a Case) -> Result<Cow<'a, Case>> {
    let case = with_tables(world, case)?;
    if let Some(start) = &case.start_field {
        let origin = Some(origin(world, start, &case)?);
        let start_field = Some(StartField { origin, ..start.clone() });
        return Ok(Cow::Owned(Case { start_field, ..case.into_owned() }));
    }
    let Some(start) = &case.warped_start else {
        return Ok(case);
    };
    let given = WarpedFile::new(world, start, &case.space)?;
    let mut case = case.into_owned();
    (case.warp.interval, case.warp.points) = (Some(given.interval), Some(given.points));
    Ok(Cow::Owned(case))
}
