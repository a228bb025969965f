//! The driver: a flat list of named, timed steps.

pub mod assembled;
pub mod compare;
pub mod measure;
pub mod solve;

use crate::base::error::{Error, Result};
use crate::base::log::report;
use crate::base::machine;
use crate::base::progress::Progress;
use crate::base::stopwatch::Stopwatch;
use crate::matrix::block_matrix::{sample, sample_with};
use crate::matrix::bounds::Bounds;
use crate::matrix::kernel::InstructionSet;
use crate::matrix::lanes::Lanes;
use crate::matrix::observables::{Moments, integral, moments, power_sum, totals};
use crate::parallel::communicator::{Communicator, Group, World};
use crate::plan::here::{memory_per_rank, refuse_hopeless_here};
use crate::plan::layout::{Resources, refuse_hopeless};
use crate::plan::{ASSUMED_RATIO, Plan};
use crate::problem::case::{Case, Delta, Exact, Integrator, Method};
use crate::problem::exact::Tracer;
use crate::problem::exact::sheet::exact_moments;
use crate::problem::potential::{StrayEdge, overlooked};
use crate::propagate::classical::{Classical, classical_steps};
use crate::quantum::figure::Figure;
use crate::quantum::probability::{Probabilities, points};
use crate::quantum::readout::Readout;
use crate::results;
use crate::results::dataset::Results;
use crate::results::dataset::{Early, ExactSolution, PlateauPoint, slices};
use crate::results::shown::Shown;
use crate::results::summary::{FieldSummary, Summary};
use crate::results::warped::Given;
use crate::results::{provenance, result_file};
use crate::run::assembled::Assembled;
use crate::run::compare::{Norms, estimate, include_step_error, moment_errors};
use crate::run::solve::{Checkpointing, Files, Solution, Warped, integrate, solve};
use crate::scheme::reduce::reduced;
use crate::schrodingerization::recovery::Reading;
use crate::schrodingerization::warp_plan::WarpPlan;
use crate::solve::checkpoint::store::{Generation, Store};
use crate::solve::checkpoint::watch::Times;
use crate::solve::place::Place;
use crate::solve::snapshot::Fingerprint;
use crate::solve::system::{Norms as StateNorms, Problem};
use std::borrow::Cow;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

/// The plan a run on `resources` would have, with growth and norms measured on `world`'s ranks where that is cheap
/// (a fraction of a second) or cannot be done without. Collective.
///
/// # Errors
/// As [`Plan::new`] and [`Problem::new`].
pub fn plan(world: &World, case: &Case, resources: &Resources) -> Result<Plan> {
    /// Cell updates of the probe that are cheap.
    const CHEAP: f64 = 1e8;
    let all = world.group();
    let case = &reduced(&all, &*with_start(&all, case)?)?;
    refuse_hopeless(case, resources)?;
    let bounds = Bounds::new(case)?;
    let updates = case.space.cells() as f64 * (bounds.rate * case.end).max(1.0);
    let must = bounds.growth.is_infinite();
    if case.method == Method::Classical || (updates > CHEAP && !must) {
        return Plan::with_bounds(case, bounds, resources, ASSUMED_RATIO);
    }
    refuse_hopeless_here(world, case)?;
    let here = Resources {
        ranks: all.size(),
        ..Resources::default()
    };
    let found = Assembled::new(world, case, &bounds, (&here, 1))?;
    Plan::with_bounds(case, found.bounds, resources, found.ratio)
}

/// The case with the points of the warped field that it starts from, if it does. Collective.
///
/// # Errors
/// As [`Given::new`].
pub fn with_start<'a>(world: &Group, case: &'a Case) -> Result<Cow<'a, Case>> {
    let Some(start) = &case.start else {
        return Ok(Cow::Borrowed(case));
    };
    let given = Given::new(world, &start.path, case, &start.place)?;
    let mut case = case.clone();
    (case.warp.interval, case.warp.points) = (Some(given.interval), Some(given.points));
    Ok(Cow::Owned(case))
}

/// What `run` is told besides the case.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// `--ranks-x`.
    pub ranks_x: Option<Vec<usize>>,
    /// `--resume`.
    pub resume: bool,
    /// `--walltime`, since the program began.
    pub walltime: Option<Duration>,
    /// Raised when the run shall stop with a checkpoint.
    pub stop: Arc<AtomicBool>,
}

/// Runs a case and writes its results into `directory`. Collective over all ranks.
///
/// # Errors
/// The first error of any rank, the same on all; [`Error::Stopped`] where it stopped early and can go on.
pub fn run(world: &World, case: &Case, directory: &Path, options: &Options) -> Result<Summary> {
    let all = world.group();
    let speaks = all.rank() == 0;
    let case = &*with_start(&all, case)?;
    let Computed {
        shown,
        mut summary,
        plan,
        share,
        fields,
        exact,
        moments,
        totals,
        early,
        plateau,
        readout,
        store,
        mut watch,
    } = compute(world, case, Some((directory, options)))?;

    // 10. Write.
    let results = Results {
        case: &shown,
        plan: &plan,
        share: &share,
        fields: &slices(&fields),
        exact: exact.as_ref(),
        moments: &moments,
        totals,
        early: &early,
        plateau: &plateau,
        readout: readout.as_ref(),
        seconds: &watch.seconds.clone(),
        provenance: &provenance::provenance(world, case),
    };
    let grids = result_file::write(&all, directory, &results)?;
    let written = if speaks {
        results::xdmf::write(directory, case.end, &grids)
            .and_then(|()| results::warped::remove_older(directory, case))
    } else {
        Ok(())
    };
    all.agree(written)?;
    watch.lap("write");
    let written = match &readout {
        Some(readout) if speaks => readout.write(directory),
        _ => Ok(()),
    };
    all.agree(written)?;
    summary.readout = readout;
    summary.finish(&all, watch);
    let written = if speaks {
        summary.write(directory)
    } else {
        Ok(())
    };
    all.agree(written)?;

    // 11. Nothing is left to go on from.
    if let Some(store) = store.filter(|_| speaks)
        && let Err(error) = store.remove()
    {
        let path = store.directory().display();
        report(&format!("warning: {path} could not be removed: {error}"));
    }
    Ok(summary)
}

/// A case that was run, on this rank's share.
pub(crate) struct Computed {
    /// The case on the grid of what follows.
    shown: Case,
    pub(crate) summary: Summary,
    pub(crate) plan: Plan,
    /// This rank's space cells, one range an x-axis.
    pub(crate) share: Vec<Range<usize>>,
    /// Every field at `T`.
    pub(crate) fields: Vec<Vec<f64>>,
    pub(crate) exact: Option<ExactSolution>,
    pub(crate) moments: Moments,
    totals: [f64; 2],
    early: Vec<Early>,
    plateau: Vec<PlateauPoint>,
    readout: Option<Readout>,
    /// Its checkpoints.
    store: Option<Store>,
    pub(crate) watch: Stopwatch,
}

/// Runs a case, in memory and in silence where no `files` are to be written. Collective over all ranks.
///
/// # Errors
/// As [`run`].
pub(crate) fn compute(
    world: &World,
    case: &Case,
    files: Option<(&Path, &Options)>,
) -> Result<Computed> {
    let mut watch = Stopwatch::start();
    watch
        .seconds
        .insert("start".to_owned(), world.start_seconds);
    let all = world.group();
    let speaks = all.rank() == 0 && files.is_some();
    let case = &reduced(&all, case)?;
    let shown = Shown::new(case);

    // 1. Who computes what; does it fit; can the results be written.
    let mut resources = Resources {
        ranks: all.size(),
        ranks_x: files.and_then(|(_, options)| options.ranks_x.clone()),
        memory_per_rank: Some(memory_per_rank(&all)),
    };
    refuse_hopeless(case, &resources)?;
    let bounds = Bounds::new(case)?;
    let mut plan = Plan::provisional(case, &bounds, &resources)?;
    resources.ranks_x = Some(plan.layout.mesh.space.clone());
    if let Some((directory, _)) = files {
        results::prepare(&all, directory, &shown.case)?;
    }
    let communicator = Communicator::new(world, &plan.layout.mesh);
    let mut warnings = warnings(case);
    if speaks {
        warnings
            .iter()
            .for_each(|w| report(&format!("warning: {w}")));
    }
    watch.lap("plan");

    // 2. The discrete problem on this rank.
    let place = Place::new(case, &plan, &communicator);
    let width = plan.warp.as_ref().map_or(1, |_| size_of::<Lanes>() / 8);
    let sizes = (width, plan.max_weight_sweeps());
    let mut problem = Problem::new(case, &bounds, &communicator, place.block.clone(), sizes)?;
    let bounds = problem.bounds(case, &bounds);
    watch.part("weights", problem.weight_seconds);
    watch.lap("assemble");

    // 3. The exact solution, where one is named: before the run, so that a mistake in it costs no run.
    let there = shown.place(&place, &plan, &communicator);
    let exact = (communicator.world).agree(exact_solution(&shown.case, &there))?;
    if exact.is_some() {
        watch.lap("exact");
    }

    // 4. How far the norm will fall, and the modes that takes.
    if plan.warp.is_some() {
        let ratio = problem.probe(&communicator, bounds.rate, &case.legs());
        watch.lap("probe");
        plan = Plan::with_bounds(case, bounds.clone(), &resources, ratio)?;
        // Processors of different kinds might round differently, and ranks that count differently wait for each other for ever.
        let same = (plan.warp.as_ref()).is_none_or(|w| all.same(w.fingerprint()));
        if !same {
            let why = "ranks planned different series, being on processors of different kinds; start them on one kind";
            return Err(Error::Ranks(why.to_owned()));
        }
        if let (Some(points), Some((directory, _))) =
            (plan.warp.as_ref().and_then(|w| w.points), files)
        {
            let room = if speaks {
                results::warped::enough_room(directory, case, points)
            } else {
                Ok(())
            };
            all.agree(room)?;
        }
        watch.lap("design");
    }
    let planned = plan.warp.as_ref().map_or(&[][..], |w| &w.warnings);
    if speaks {
        planned
            .iter()
            .for_each(|w| report(&format!("warning: {w}")));
        report(&opening_line(&plan));
    }
    warnings.extend_from_slice(planned);

    // 5. What was finished before. Only runs by modes make checkpoints.
    let mut store = (plan.warp.as_ref().zip(files)).map(|(warp, (directory, _))| {
        let folder = directory.join("checkpoint");
        Store::new(folder, Fingerprint::new(case, warp), case.space.clone())
    });
    let generation = match files {
        Some((_, options)) => earlier(&all, &plan, options, store.as_mut(), &mut warnings)?,
        None => None,
    };
    let told = warnings.len();

    // 6. Solve; of the fields at the start only the mass is kept.
    let mut summary = Summary::default();
    let total = |moment: &[f64]| integral(&communicator.world, &case.space, moment);
    if case.start.is_none() {
        let initial = std::mem::take(&mut problem.initial);
        let mine: Vec<&[f64]> = initial.iter().map(|f| &f[place.mine.clone()]).collect();
        let mass = total(&moments(&communicator.world, case, &mine).density);
        summary.mass_initial = Some(mass);
    }
    watch.lap("observables");
    let seconds = watch.seconds.clone();
    let provenance = provenance::provenance(world, case);
    let besides = files.map(|(directory, options)| Files {
        warped: Warped {
            directory,
            seconds: &seconds,
            provenance: &provenance,
        },
        checkpointing: store.as_mut().map(|store| Checkpointing {
            store,
            generation,
            times: Times {
                every: case.checkpoint_every,
                wall: options.walltime.map(|wall| (world.started, wall)),
                stop: Arc::clone(&options.stop),
            },
        }),
    });
    let Solution {
        fields,
        plateau,
        early,
        warped_seconds,
    } = solve(
        case,
        &plan,
        &communicator,
        &place,
        &mut problem,
        &mut summary,
        besides,
    )?;
    watch.part("write", warped_seconds);
    watch.lap("solve");

    // 7. Compare: with the field at the second point, the exact semi-discrete solution, the exact solution.
    let before = early.iter().flat_map(|e| &e.fields);
    let values = fields
        .iter()
        .flatten()
        .chain(before)
        .chain(&plateau)
        .flatten();
    let finite = values.copied().all(f64::is_finite);
    let checked = if finite {
        Ok(())
    } else {
        Err(Error::NotFinite("NaN or infinity".into()))
    };
    communicator.world.agree(checked)?;
    let norms = |f| Norms {
        world: &communicator.world,
        velocities: case.space.velocity_cells(),
        f,
    };
    summary.fields = (case.fields.iter())
        .map(|field| FieldSummary {
            name: field.name.to_owned(),
            ..FieldSummary::default()
        })
        .collect();
    if case.start.is_some() {
        summary.doubt =
            Some("the field that the run began with is known on its points only".to_owned());
    } else if let Some(warp_plan) = &plan.warp {
        let found = estimate(
            &plan,
            warp_plan,
            &problem,
            &communicator,
            &fields,
            &mut summary,
        );
        warnings.extend(found);
        warnings.extend(include_step_error(&plan, &mut summary));
        let found = norms_found(&problem, &communicator, &place, &fields[0][0]);
        let measured = (&plan.bounds, warp_plan, case.end);
        summary.probabilities = Some(Probabilities::new(
            measured,
            points(&warp_plan.series),
            found,
            &Figure::exact,
        ));
    }
    if case.verify {
        for (k, readings) in fields.iter().enumerate() {
            let mut state = problem.states[k].clone();
            let reference = Case {
                integrator: Integrator::Exponential,
                ..case.clone()
            };
            let terms = classical_steps(&reference, &bounds);
            let progress = Progress::new(speaks, "verify", terms.iter().sum());
            let pi = &problem.weights.pi;
            let mut classical = Classical::of(case, &problem.matrix, pi).with_progress(progress);
            let before = early.iter().map(|e| e.fields.get(k));
            let ends = before.chain([Some(&readings[0])]);
            for ((time, &terms), field) in case.legs().into_iter().zip(&terms).zip(ends) {
                let (exact, span) = (Integrator::Exponential, (bounds.rate, time));
                let exchange = &mut problem.exchange;
                integrate(&mut classical, exchange, exact, span, terms, &mut state);
                let Some(field) = field else { continue };
                let reference = problem.unweighted(&place.mine, state[place.mine.clone()].to_vec());
                let error = norms(field).distance(&reference);
                if error.is_finite() {
                    // The worst of all times at which the field is written.
                    for worst in [
                        &mut summary.fields[k].error_semidiscrete,
                        &mut summary.error_semidiscrete,
                    ] {
                        *worst = Some(worst.unwrap_or(0.0).max(error));
                    }
                }
            }
        }
        watch.lap("verify");
    }
    let plateau = plan.warp.as_ref().map_or(Vec::new(), |w| {
        let volume = case.space.cell_volume();
        let norms = norms(&fields[0][0]);
        let of = |(reading, field): (&Reading, &Vec<f64>)| PlateauPoint {
            p: reading.point,
            distance: norms.distance_of(field),
            norm: (norms.square(field) * volume).sqrt(),
        };
        w.plateau.iter().zip(&plateau).map(of).collect()
    });

    // 8. What was left out is shown again. Moments and sums.
    let fields: Vec<Vec<f64>> = (fields.into_iter())
        .map(|mut readings| shown.field(&place.share, readings.swap_remove(0)))
        .collect();
    let early: Vec<Early> = (early.into_iter())
        .map(|early| shown.early(&place.share, early))
        .collect();
    let (solved, case) = (case, &shown.case);
    let norms = |f| Norms {
        world: &communicator.world,
        velocities: case.space.velocity_cells(),
        f,
    };
    for (field, said) in fields.iter().zip(&mut summary.fields) {
        let norms = norms(field);
        said.minimum = -norms.largest(|x| -x);
        said.maximum = norms.largest(|x| x);
    }
    let results = slices(&fields);
    let found = moments(&communicator.world, case, &results);
    let totals = totals(&communicator.world, &case.space, &found);
    [summary.mass, summary.kinetic_energy] = totals;
    summary.minimum = summary.fields[0].minimum;
    summary.maximum = summary.fields[0].maximum;
    match &exact {
        None => {}
        Some(ExactSolution::Field(exact)) => {
            let (found, exact_alone) = (norms(results[0]), norms(exact));
            let (volume, zero) = (case.space.cell_volume(), vec![0.0; exact.len()]);
            let l1 = |of: &Norms<'_>, other: &[f64]| of.difference(other, 1) * volume;
            let l2 = |of: &Norms<'_>, other: &[f64]| (of.difference(other, 2) * volume).sqrt();
            summary.error_l1 = Some(l1(&found, exact));
            summary.error_l2 = Some(l2(&found, exact));
            summary.exact_l1 = Some(l1(&exact_alone, &zero));
            summary.exact_l2 = Some(l2(&exact_alone, &zero));
        }
        Some(ExactSolution::Moments(exact)) => {
            let [density, velocity] =
                moment_errors(&communicator.world, &case.space, &found, exact);
            let world = &communicator.world;
            summary.mass_exact = Some(integral(world, &case.space, &exact.density));
            summary.error_density_l1 = Some(density);
            summary.error_velocity_l1 = Some(velocity);
        }
    }
    watch.lap("observables");

    // 9. What a quantum computer would tell of them.
    let readout = case.readout.as_ref().map(|_| {
        let discrete = (&problem, &place);
        crate::run::measure::readout(&communicator.world, case, discrete, results[0], &summary)
    });
    if readout.is_some() {
        watch.lap("readout");
    }
    summary.warnings = warnings;
    summary.told = told;
    summary.fill(solved, &plan, &problem, &communicator);
    Ok(Computed {
        summary,
        plan,
        share: there.share,
        fields,
        exact,
        moments: found,
        totals,
        early,
        plateau,
        readout,
        store,
        watch,
        shown: shown.case,
    })
}

/// The checkpoint to go on from, if that is wanted and there is one. Collective.
///
/// # Errors
/// As [`Store::open`].
fn earlier(
    world: &Group,
    plan: &Plan,
    options: &Options,
    store: Option<&mut Store>,
    warnings: &mut Vec<String>,
) -> Result<Option<Generation>> {
    let speaks = world.rank() == 0;
    let mut warn = |line: String| {
        if speaks {
            report(&format!("warning: {line}"));
        }
        warnings.push(line);
    };
    let Some(store) = store else {
        if options.resume || options.walltime.is_some() {
            warn("--resume and --walltime have no effect: solver.method = \"classical\" makes no checkpoints".to_owned());
        }
        return Ok(None);
    };
    let folder = store.directory().display().to_string();
    if !options.resume {
        if !store.is_empty() {
            warn(format!(
                "{folder} holds the checkpoint of a run that was not finished; this one replaces it. --resume would go on from it"
            ));
        }
        return Ok(None);
    }
    let found = store.open(world, warn)?;
    if speaks {
        report(&match &found {
            None => {
                format!("--resume: no checkpoint in {folder}; the run starts from its beginning")
            }
            Some(generation) => format!(
                "going on from {}: {} of {} modes of stage {} are finished",
                generation.path().display(),
                generation.state.finished.len(),
                plan.warp.as_ref().map_or(0, |w| w.modes),
                generation.state.stage + 1,
            ),
        });
    }
    Ok(found)
}

/// The exact solution on this rank's share: `f` at cell centres, or density and velocity as cell averages.
pub(crate) fn exact_solution(case: &Case, place: &Place) -> Result<Option<ExactSolution>> {
    let (space, block) = (&case.space, &place.block);
    Ok(match &case.exact {
        None => None,
        Some(Exact::Formula(f)) => {
            let all = sample(space, block, f, case.end)?;
            Some(ExactSolution::Field(all[place.mine.clone()].to_vec()))
        }
        Some(Exact::Characteristics) => {
            if let Some(moments) = exact_moments(case)? {
                return Ok(Some(ExactSolution::Moments(
                    moments.on(space, &place.share),
                )));
            }
            let tracer = Tracer::new(case)?;
            let value = |point: &[f64; 6]| tracer.value(point, case.end);
            let exact = sample_with(space, block, &place.mine, value);
            if exact.iter().any(|f| !f.is_finite()) {
                let place = "where a characteristic of exact.kind = \"characteristics\" begins";
                return Err(case.fields[0].initial.undefined(f64::NAN, place.to_owned()));
            }
            Some(ExactSolution::Field(exact))
        }
    })
}

/// Norms of the first field that the probabilities of measuring it follow from. Collective.
fn norms_found(
    problem: &Problem,
    communicator: &Communicator,
    place: &Place,
    field: &[f64],
) -> StateNorms {
    let world = &communicator.world;
    let velocities = problem.matrix.block.velocity_cells;
    let pi = &problem.weights.pi[place.mine.clone()];
    let norm =
        |term: &dyn Fn(usize) -> f64| power_sum(world, velocities, field.len(), 2, term).sqrt();
    let start = &problem.states[0];
    let [_, auxiliary] = problem.norms_of_parts(communicator, start);
    StateNorms {
        start: problem.norm(communicator, start, false),
        weighted: norm(&|i| pi[i].sqrt() * field[i]),
        field: norm(&|i| field[i]),
        auxiliary,
    }
}

/// What the user should know before the run.
pub fn warnings(case: &Case) -> Vec<String> {
    let names = ["x", "y", "z"];
    let found = overlooked(case);
    let line = |edge: &StrayEdge| {
        format!(
            "potential: a region's edge at {} = {:.6} misses the faces of the grid; it is moved to {:.6}, by {:.2e}",
            names[edge.axis],
            edge.at + 0.0,
            edge.face + 0.0,
            (edge.at - edge.face).abs()
        )
    };
    let empty = |region: &usize| {
        format!(
            "potential.{region}: its where holds at no cell's centre; the region is not there on this grid"
        )
    };
    let idle = (!case.enters() && case.warp.delta != Delta::Planned)
        .then(|| "solver.warp.delta has no effect: nothing enters (inflow.value is 0)".to_owned());
    let unread = (case.method == Method::Classical && case.plateau.is_some()).then(|| {
        "output.plateau has no effect: with solver.method = \"classical\" nothing is read at any p".to_owned()
    });
    (found.edges.iter().map(line))
        .chain(found.empty.iter().map(empty))
        .chain(idle)
        .chain(unread)
        .collect()
}

fn opening_line(plan: &Plan) -> String {
    let mesh = &plan.layout.mesh;
    let what = match &plan.warp {
        Some(WarpPlan {
            modes,
            applications,
            solves: 0,
            ..
        }) => {
            format!("{modes} modes, {applications} applications")
        }
        Some(WarpPlan { modes, solves, .. }) => format!("{modes} modes, {solves} solves"),
        None => format!("{} classical steps", plan.classical_steps),
    };
    let title = if plan.title.is_empty() {
        "phasewarp"
    } else {
        &plan.title
    };
    format!(
        "{title}: {} cells, {what}, {} ranks ({} space x {} modes)",
        plan.cells,
        mesh.ranks(),
        mesh.blocks(),
        mesh.groups
    )
}

impl Summary {
    /// What the plan and the problem say. Collective.
    fn fill(&mut self, case: &Case, plan: &Plan, problem: &Problem, communicator: &Communicator) {
        let world = &communicator.world;
        self.title = case.title.clone();
        self.version = env!("CARGO_PKG_VERSION").to_owned();
        self.git = crate::base::version::GIT.to_owned();
        self.method = Some(case.method);
        self.interface = Some(case.interface);
        self.ranks = world.size();
        self.space_blocks = plan.layout.mesh.space.clone();
        self.mode_groups = plan.layout.mesh.groups;
        self.imbalance = plan.warp.as_ref().map(|_| plan.layout.imbalance);
        self.instruction_set = InstructionSet::here().name().to_owned();
        self.cells = plan.cells;
        self.reductions = plan.reductions.clone();
        self.distinct_rows = communicator.space.sum_count(problem.matrix.distinct_rows());
        self.inflow_unknowns = problem.terms - case.space.space_cells();
        self.modes = plan.warp.as_ref().map_or(0, |w| w.modes);
        self.points = plan.warp.as_ref().and_then(|w| w.points);
        self.tolerance = case.tolerance;
        self.memory_planned_bytes_per_rank = plan.memory();
        self.growth_bound = plan.bounds.growth;
        self.decay_bound = plan.bounds.decay;
        if let Some(schedule) = &problem.schedule {
            self.time_steps = Some(schedule.steps);
            self.time_error = Some(schedule.error);
        }
        self.growth_certificate = problem.weights.certificate;
        self.weight_spread = problem.weights.spread;
        self.weight_sweeps = problem.weights.sweeps;
    }

    /// What is known at the end: seconds, and the memory that was taken. Collective.
    pub(crate) fn finish(&mut self, world: &Group, watch: Stopwatch) {
        self.memory_peak_bytes_per_rank = world.max_count(machine::peak_memory() as usize) as u64;
        self.solve_seconds = watch.seconds.get("solve").copied().unwrap_or(0.0);
        self.wall_seconds = watch.started.elapsed().as_secs_f64();
        self.seconds = watch.seconds;
    }
}
