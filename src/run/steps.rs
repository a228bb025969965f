//! The steps of the driver, in the order in which [`super::compute`] calls them.

use crate::base::error::{Error, Result};
use crate::base::lock::DirectoryLock;
use crate::base::memory;
use crate::matrix::observables::{CellVolumes, Moments, Totals};
use crate::parallel::communicator::World;
use crate::plan::ProvisionalPlan;
use crate::plan::layout::Resources;
use crate::problem::case::{Case, Exact};
use crate::problem::grid::{MAX_DIMENSION, axis_names};
use crate::results::accuracy::{ErrorsByParticles, EstimatedErrors, is_large};
use crate::results::dataset::{EarlyResult, PlateauPoint};
use crate::results::finished::{is_finished, refuse_to_replace};
use crate::results::ledger::Ledger;
use crate::results::provenance::provenance;
use crate::results::result_grid::ResultGrid;
use crate::results::summary::Summary;
use crate::results::{self, warped};
use crate::run::at_start::at_start;
use crate::run::checkpointing::Checkpointing;
use crate::run::errors::ResultOnShare;
use crate::run::exact::{ExactRun, ExactTask};
use crate::run::expand::ExpandedResults;
use crate::run::files::{SolveOutput, WarpedOutput};
use crate::run::ledger::LedgerBeforeRun;
use crate::run::log::RunLog;
use crate::run::options::Output;
use crate::run::particles::arrivals::Arrivals;
use crate::run::particles::random_paths;
use crate::run::solution::Solution;
use crate::run::solved::SolvedFields;
use crate::run::{compare, estimates, expand, fields, ledger, readout, warnings};
use crate::scheme::reduce::reduced;
use crate::solve::prepared::Prepared;
use crate::solve::rank_cells::RankCells;

/// A probe of more updates of unknowns than this, about a second of one core, is announced.
const LONG_PROBE: f64 = 1e9;

/// The state that all steps of a run share.
pub(super) struct Driver<'a> {
    world: &'a World,
    /// The output; `None` for a run without console output, files and checkpoints.
    output: Option<Output<'a>>,
    log: RunLog,
    summary: Summary,
}

/// The reduced case, and the grid of its results.
pub(super) struct ReducedCase {
    case: Case,
    result_grid: ResultGrid,
}

/// The planned system on this rank.
pub(super) struct PlannedRun {
    prepared: Prepared,
    /// The lock of the result directory, on the first rank.
    lock: Option<DirectoryLock>,
    /// The part of this rank in the result grid.
    rank_cells: RankCells,
}

/// Observables of the initial data, and the ledger with its estimates by particles.
pub(super) struct StartObserved {
    /// The totals; `None` for a run that starts from modes.
    totals: Option<Totals>,
    /// Results at the start, if they are to be written.
    early: Option<EarlyResult>,
    ledger: Ledger,
    /// Mass that enters until the end.
    entered: Option<f64>,
    /// The ledger's particles that are in the box at the end.
    arrivals: Arrivals,
}

/// The estimated errors of the fields.
pub(super) struct FieldErrors {
    plateau: Vec<PlateauPoint>,
    /// Estimates of the errors of the grid.
    estimated: EstimatedErrors,
}

/// The results of all steps before the last.
pub(super) struct StepResults {
    pub reduced: ReducedCase,
    pub planned: PlannedRun,
    pub exact: ExactRun,
    pub checkpointing: Option<Checkpointing>,
    pub start: StartObserved,
    pub compared: FieldErrors,
    pub results: ExpandedResults,
}

impl<'a> Driver<'a> {
    /// Step 1: an empty log and summary.
    pub fn start(world: &'a World, output: Option<Output<'a>>) -> Self {
        let log = RunLog::new(world, output.is_some());
        Self { world, output, log, summary: Summary::default() }
    }

    /// Step 2: merges cells and drops velocities that the solution does not need. Collective.
    ///
    /// # Errors
    /// As [`reduced`].
    pub fn reduce(&self, case: &Case) -> Result<ReducedCase> {
        let case = reduced(&self.world.group(), case)?;
        Ok(ReducedCase { result_grid: ResultGrid::new(&case), case })
    }

    /// Step 3: the system of the reduced case with its modes planned, and the lock of the result
    /// directory. Collective.
    ///
    /// # Errors
    /// As [`ProvisionalPlan::new`] and [`Prepared::new`]; where the results cannot be written, or
    /// the directory is locked or holds the results of another run.
    pub fn prepare(&mut self, reduced: &ReducedCase) -> Result<PlannedRun> {
        let ReducedCase { case, result_grid } = reduced;
        let resources = Resources {
            ranks_x: self.output.and_then(|output| output.options.ranks_x.clone()),
            ..Resources::here(self.world)
        };
        let provisional = ProvisionalPlan::new(case, &resources)?;
        let lock = self.lock(&result_grid.case)?;
        let prepared = self.assemble(case, provisional)?;
        let prepared = self.plan_modes(prepared, &resources)?;
        let rank_cells =
            result_grid.rank_cells(&prepared.rank_cells, &prepared.plan, &prepared.communicator);
        Ok(PlannedRun { prepared, lock, rank_cells })
    }

    /// Step 4: the exact solution on this rank's share, if the case names one. Collective.
    ///
    /// # Errors
    /// As [`ExactTask::run`].
    pub fn exact(&mut self, reduced: &ReducedCase, planned: &PlannedRun) -> Result<ExactRun> {
        let wall = self.output.and_then(|output| output.options.walltime);
        let wall = wall.map(|wall| (self.world.started, wall));
        let task = ExactTask {
            world: &planned.prepared.communicator.world,
            case: &reduced.result_grid.case,
            rank_cells: &planned.rank_cells,
            prints: self.log.prints,
            // Classical runs are not limited.
            wall: planned.prepared.plan.warp.as_ref().and(wall),
        };
        let exact_run = task.run()?;
        if exact_run.exact.is_some() {
            self.log.watch.lap("exact");
        }
        Ok(exact_run)
    }

    /// Step 5: prints a line about the plan, and opens the checkpoints. Collective.
    ///
    /// # Errors
    /// As [`Checkpointing::open`].
    pub fn open(&mut self, planned: &PlannedRun) -> Result<Option<Checkpointing>> {
        let prepared = &planned.prepared;
        self.log.open(&prepared.plan);
        let Some(output) = self.output else { return Ok(None) };
        Checkpointing::open(prepared, &output, self.world.started, &mut self.log)
    }

    /// Step 6: observables of the initial data, and the ledger with its estimates by particles.
    /// Collective.
    ///
    /// # Errors
    /// As [`ledger::before_run`].
    pub fn observe_start(
        &mut self,
        reduced: &ReducedCase,
        planned: &mut PlannedRun,
    ) -> Result<StartObserved> {
        let at_start = at_start(&mut planned.prepared);
        let totals = at_start.as_ref().map(|found| found.totals);
        self.summary.mass_initial = totals.map(|totals| totals.mass);
        let (mut before, mut entered) = (LedgerBeforeRun::default(), None);
        if self.output.is_some() {
            before = ledger::before_run(&self.world.group(), &reduced.result_grid.case)?;
            let ledger = &mut before.ledger;
            entered = ledger::entered_mass(&planned.prepared, ledger);
            ledger::absolute_masses(&planned.prepared, ledger, totals, entered);
        }
        let LedgerBeforeRun { ledger, arrivals } = before;
        let entered = entered.map(|entered| entered.signed);
        // Memory of the particles' paths goes back before the solve.
        memory::give_back();
        self.log.watch.lap("observables");
        let early = at_start.filter(|_| planned.prepared.case.output.at_start.is_some());
        Ok(StartObserved { totals, early, ledger, entered, arrivals })
    }

    /// Step 7: every field at the output times, with the start, and at `T`. Writes warped fields
    /// and checkpoints. Collective.
    ///
    /// # Errors
    /// As [`fields::solve`].
    pub fn solve(
        &mut self,
        planned: &mut PlannedRun,
        start: &mut StartObserved,
        checkpointing: Option<&mut Checkpointing>,
    ) -> Result<SolvedFields> {
        let prepared = &mut planned.prepared;
        let seconds = self.log.watch.seconds.clone();
        let provenance = provenance(self.world, &prepared.case);
        let warped = self.output.map(|Output { directory, .. }| WarpedOutput {
            directory,
            seconds: &seconds,
            provenance: &provenance,
            writing_seconds: 0.0,
        });
        let mut output = SolveOutput { prints: self.log.prints, warped, checkpointing };
        let mut solution = fields::solve(prepared, &mut output, &mut self.summary)?;
        let writing_seconds = output.warped.map_or(0.0, |warped| warped.writing_seconds);
        self.log.watch.part("write", writing_seconds);
        self.log.watch.lap("solve");
        self.log.warn_later(solution.warning.clone());
        solution.early.splice(0..0, start.early.take());
        Ok(solution)
    }

    /// Step 8: the error of the fields, estimated, and measured if `solver.verify` is set.
    /// Collective.
    ///
    /// # Errors
    /// As [`compare::refuse_not_finite`]; where a formula is not finite.
    pub fn compare(
        &mut self,
        planned: &mut PlannedRun,
        solution: &SolvedFields,
    ) -> Result<FieldErrors> {
        let prepared = &mut planned.prepared;
        compare::refuse_not_finite(prepared, solution)?;
        let warnings = compare::compare(prepared, solution, &mut self.summary);
        self.log.warn_later(warnings);
        let (log, summary) = (&mut self.log, &mut self.summary);
        if prepared.case.verify {
            compare::verify(prepared, solution, log.prints, summary);
            log.watch.lap("verify");
        }
        summary.continued = compare::continued(prepared, solution.first_field(), summary);
        let plateau = compare::plateau(prepared, solution);
        let estimated = estimates::of_the_grid(prepared, solution.first_field())?;
        Ok(FieldErrors { plateau, estimated })
    }

    /// Step 9: fields and moments on the grid of the results, and their distance to the exact
    /// solution. Collective.
    ///
    /// # Errors
    /// As [`expand::expand`].
    pub fn expand(
        &mut self,
        reduced: &ReducedCase,
        planned: &PlannedRun,
        exact: &ExactRun,
        solution: SolvedFields,
    ) -> Result<ExpandedResults> {
        let prepared = &planned.prepared;
        let (grid, summary) = (&reduced.result_grid, &mut self.summary);
        expand::expand(prepared, solution, grid, exact, summary, self.log.prints)
    }

    /// Puts the errors of `result` that particles show into the summary, and that of the exact
    /// density with which it was compared. Returns how often jumps of `V` smeared an arrived
    /// particle out along each velocity axis, if that is known. Collective.
    fn compare_with_particles(
        &mut self,
        arrivals: &Arrivals,
        result: &ResultOnShare<'_>,
        exact: &ExactRun,
    ) -> Option<[f64; MAX_DIMENSION]> {
        let case = result.case;
        let mut by_paths = ErrorsByParticles::default();
        if self.output.is_some() && case.reflects() && case.follows_from_formulas() {
            // Where V is not finite on other cells, they are not known.
            by_paths = random_paths::errors(result).unwrap_or_default();
        }
        self.summary.accuracy.particles = by_paths;
        let arrivals = arrivals.gathered(result.world)?;
        let smearing = arrivals.smearing;
        // Where V is not finite on other cells, that error is not known.
        let traced = arrivals.tracing_error(case).unwrap_or(None);
        let particles = arrivals.errors(result).beyond_tracing(traced.unwrap_or(0.0));
        let of_density = particles.density.filter(|_| case.reflects());
        self.summary.accuracy.particles = ErrorsByParticles {
            // In L1 the error of `f` is no smaller than that of the density.
            field: particles.field.or(by_paths.field).or(of_density),
            field_mean: particles.field_mean.or(by_paths.field_mean),
            density_smeared: particles.density_smeared.or(by_paths.density_smeared),
            ..particles
        };
        let is_traced = case.traces_exact() && self.summary.error_l2_relative.is_some();
        let of_exact = traced.filter(|_| is_traced);
        self.summary.exact_field_error =
            of_exact.map(|traced| arrivals.error_of_exact(case, traced));
        // Measure-valued data, and densities that cancel, have no such error.
        let Some(known) = self.summary.exact_density_error else {
            return Some(smearing);
        };
        let space = &case.space;
        let shown = match exact.moments.last() {
            // In one dimension, the exact density of degree 0 is an average over each cell.
            Some(moments) if space.dimension() == 1 && space.whole_degree() == 0 => {
                arrivals.density_errors(result, &moments.density).least
            }
            // Otherwise its mass is known up to the error of a rule.
            _ => self
                .summary
                .mass_exact
                .and_then(|mass| arrivals.mass_error(mass))
                .filter(|error| is_large(*error)),
        };
        self.summary.exact_density_error = Some(shown.map_or(known, |shown| known.max(shown)));
        Some(smearing)
    }

    /// The `estimated` errors with what particles, the interface law and the elements' `V` say of
    /// them. `smearing` by jumps of `V`, if it is not known, counts once along axes with jumps.
    /// Collective.
    fn corrected(
        &self,
        estimated: EstimatedErrors,
        result: &ResultOnShare<'_>,
        smearing: Option<[f64; MAX_DIMENSION]>,
    ) -> EstimatedErrors {
        let ledger = self.summary.ledger.as_ref();
        let interpolation = estimated.interpolation.map(|by_axis| by_axis.iter().sum());
        let by_interface = ledger.and_then(|of| of.interface_share(interpolation));
        let at_most_once = || {
            let names = axis_names(result.case.space.dimension());
            let jumps =
                |axis: &str| ledger.is_some_and(|of| of.jumps.iter().any(|j| j.axis == axis));
            std::array::from_fn(|a| {
                f64::from(u8::from(names.get(a).is_some_and(|name| jumps(name))))
            })
        };
        let particles = self.summary.accuracy.particles;
        let mut corrected = estimated
            .limit_by_particle_mean(particles.field_mean)
            .raise_to_interface_share(by_interface.unwrap_or(0.0))
            .raise_to_smearing(smearing.unwrap_or_else(at_most_once));
        if estimates::density_cancels(result) {
            corrected = corrected.without_density();
        }
        let by_potential = match self.output {
            Some(_) => estimates::of_the_potential(result),
            None => 0.0,
        };
        corrected.raise_density_to_potential_share(by_potential, &particles)
    }

    /// Step 10: completes the summary. Collective.
    pub fn finish(mut self, computed: StepResults) -> Solution {
        let StepResults { reduced, planned, exact, start, compared, results, .. } = computed;
        let PlannedRun { prepared, lock, rank_cells } = planned;
        let case = reduced.result_grid.case;
        let volumes = CellVolumes::new(&case.space, &rank_cells.share);
        let world = &prepared.communicator.world;
        let mass = |moments: &Moments| volumes.integral(world, &moments.density);
        let known = self.summary.mass_exact;
        self.summary.mass_exact = known.or_else(|| exact.moments.last().map(mass));
        let mut ledger = start.ledger;
        ledger.close(start.totals, results.totals, start.entered);
        self.log.warn_later(ledger.warnings());
        self.summary.ledger = Some(ledger);
        let result = results.on_share(world, &case, &rank_cells.share, &volumes);
        let smearing = self.compare_with_particles(&start.arrivals, &result, &exact);
        self.log.warn_later(self.summary.exact_field_warning());
        let by_formula = matches!(case.exact, Some(Exact::Formula(_)));
        self.log.warn_later(self.summary.exact_density_warning(by_formula));
        self.log.watch.part("exact", results.exact_seconds);
        self.log.watch.lap("observables");
        if case.readout.is_some() {
            let readout = readout::readout(&prepared, &case, &results.fields[0], &self.summary);
            self.summary.readout = Some(readout);
            self.log.watch.lap("readout");
        }
        self.summary.fill(&prepared, &self.log);
        let estimated = self.corrected(compared.estimated, &result, smearing);
        self.summary.judge(&prepared.case, estimated);
        Solution {
            case,
            summary: self.summary,
            plan: prepared.plan,
            share: rank_cells.share,
            results,
            exact: exact.exact,
            exact_moments: exact.moments,
            plateau: compared.plateau,
            checkpointing: computed.checkpointing,
            lock,
            log: self.log,
        }
    }

    /// Checks that the results can be written, and locks the directory for this run; the first rank
    /// has the lock. `case` is that of the results. Collective.
    ///
    /// # Errors
    /// As [`results::prepare`] and [`refuse_to_replace`]; [`Error::FinishedByOthers`].
    fn lock(&mut self, case: &Case) -> Result<Option<DirectoryLock>> {
        let Some(Output { given, directory, options }) = self.output else { return Ok(None) };
        let world = self.world.group();
        let lock = results::prepare(&world, directory, case)?;
        // Another run may have ended here since this one looked.
        let keeps_finished = options.resume || options.keeps_finished;
        if keeps_finished && matches!(is_finished(&world, directory, given), Ok(true)) {
            return Err(Error::FinishedByOthers);
        }
        if !options.force {
            refuse_to_replace(&world, directory, given, options.resume)?;
        }
        if let Some(chosen) = &options.chosen {
            world.on_first_rank(|| chosen.write(directory))?;
        }
        if let Some(why) = lock.as_ref().and_then(|lock| lock.unlocked.as_ref()) {
            let directory = directory.display();
            self.log.warn(format!(
                "{directory} cannot be locked ({why}): no other run may write there at the same \
                 time"
            ));
        }
        Ok(lock)
    }

    /// The semi-discrete system on this rank. Collective.
    fn assemble(&mut self, case: &Case, provisional: ProvisionalPlan) -> Result<Prepared> {
        for warning in warnings::warnings(case) {
            self.log.warn(warning);
        }
        self.log.watch.lap("plan");
        let prepared = Prepared::assemble(self.world, case, provisional)?;
        self.log.watch.part("weights", prepared.system.weight_seconds);
        self.log.watch.lap("assemble");
        Ok(prepared)
    }

    /// `prepared` with its modes planned for the ratio of norms that the probe measures. Fails if
    /// the disk has no room for the warped field. Collective.
    fn plan_modes(&mut self, mut prepared: Prepared, resources: &Resources) -> Result<Prepared> {
        if prepared.plan.warp.is_some() {
            let applications = prepared.bounds.rate * prepared.case.duration();
            // With inflow in time the norm at the end is known already.
            let is_measured = prepared.system.schedule.is_none();
            if is_measured && applications * prepared.case.space.cells() as f64 > LONG_PROBE {
                self.log.line(&format!(
                    "the norm at the end is measured first, by about {applications:.0} \
                     applications of A"
                ));
            }
            let ratio = prepared.probe();
            self.log.watch.lap("probe");
            prepared = prepared.plan_modes(self.world, resources, ratio)?;
            let points = prepared.plan.warp.as_ref().and_then(|warp| warp.points);
            if let (Some(points), Some(output)) = (points, self.output) {
                let room = if self.log.prints {
                    warped::enough_room(output.directory, &prepared.case, points)
                } else {
                    Ok(())
                };
                prepared.communicator.world.agree(room)?;
            }
            self.log.watch.lap("design");
        }
        Ok(prepared)
    }
}
