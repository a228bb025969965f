//! The run by modes: their start, the files of modes that are kept, and the recovered fields.

use crate::base::error::{Error, Result};
use crate::base::machine::{self, RunPart};
use crate::base::progress::Progress;
use crate::matrix::observables::{MomentsOf, VelocityFactors};
use crate::parallel::communicator::Communicator;
use crate::plan::Plan;
use crate::plan::balance::{Batch, cost};
use crate::plan::memory::BUFFERS;
use crate::problem::case::{Case, WarpedStart};
use crate::problem::legs::Leg;
use crate::propagate::evolution::{Evolution, InitialState};
use crate::propagate::interruption::Interruption;
use crate::propagate::propagator;
use crate::propagate::time_dependent_inflow::Schedule;
use crate::results::dataset::FileAttributes;
use crate::results::summary::Summary;
use crate::results::warped;
use crate::results::warped::initial_file::{ModesFromFile, ReadField, ReadingDomain, WarpedFile};
use crate::results::warped::spread::Spread;
use crate::run::checkpointing::Checkpointing;
use crate::run::files::{SolveOutput, WarpedOutput};
use crate::run::history::history;
use crate::run::norms::{FieldNorms, volumes_of};
use crate::run::solved::SolvedFields;
use crate::schrodingerization::warp_plan::WarpPlan;
use crate::solve::checkpoint::{Checkpoints, ResumePoint, RunSize};
use crate::solve::field_readings::FieldReadings;
use crate::solve::modes;
use crate::solve::modes::RunHooks;
use crate::solve::prepared::Prepared;
use crate::solve::rank_cells::RankCells;
use crate::solve::rank_modes::{ModeProgress, RankModes};
use crate::solve::stage::{FullRunModes, LegEnd, RecoveredFields, Task};
use crate::solve::system::DiscreteSystem;
use std::sync::Arc;
use std::time::Instant;

/// Solves for every field by the modes of the plan; `None` if it has none. Collective.
///
/// # Errors
/// As [`crate::solve::modes::run`]; files that cannot be written or read, or a start whose `e^p w`
/// is not flat where it is read.
pub(crate) fn by_modes(
    prepared: &mut Prepared,
    output: &mut SolveOutput<'_>,
    summary: &mut Summary,
) -> Result<Option<SolvedFields>> {
    let Prepared { case, plan, communicator, rank_cells, system, .. } = prepared;
    let Some(warp) = &plan.warp else { return Ok(None) };
    let SolveOutput { prints, warped, checkpointing } = output;
    let mut checkpointing = checkpointing.as_deref_mut();
    let generation = checkpointing.as_mut().and_then(|c| c.generation.take());
    let resumed = generation.map(|generation| {
        let finished = generation.state.finished.iter().copied().collect();
        let batches = plan.batches_left(&finished, communicator.modes.rank());
        ResumePoint { batches, share: &rank_cells.share, generation }
    });
    summary.resumed = resumed.is_some();
    let fields = system.states.len();
    let stages = fields * warp.points.map_or(1, |_| warp.legs.len());
    let left = cost_left(&plan.layout.groups[communicator.modes.rank()], stages, resumed.as_ref());
    let mut progress = Progress::new(*prints, "modes", left * fields / stages);
    let modes: Vec<Vec<usize>> = plan.layout.modes();
    let spread = spread(communicator, case, rank_cells, &modes, &system.weights.pi);
    let planned = DistributedModes { case, plan, warp, spread: &spread };
    let mut start = ModeStart::new(planned, system)?;
    if let (Some(checkpointing), Some(begun)) = (&mut checkpointing, &start.begun) {
        // A checkpoint must be of the file that the modes start from.
        let generation = resumed.as_ref().map(|resumed| &resumed.generation);
        checkpointing.store.begins_with(begun.checksum, generation)?;
    }
    let rows = system.matrix.rows();
    let states = system.states.iter().zip(&start.norms);
    let initial: Vec<_> =
        states.map(|(state, &norm)| InitialState::real(&state[..rows], norm)).collect();
    let stop = checkpointing.as_ref().map(|c| Arc::clone(&c.times.stop));
    let mut evolution = Evolution {
        matrix: &system.matrix,
        exchange: &mut system.exchange,
        space: &communicator.space,
        bounds: &plan.bounds,
        time: case.duration(),
        norm_terms: system.norm_terms,
        interruption: Interruption::new(&communicator.space, rows, stop),
    };
    let size = RunSize { modes: warp.modes, stages };
    let mut checkpoints = checkpointing.map(|Checkpointing { store, times, .. }| {
        Checkpoints::new(communicator, &plan.layout.mesh, store, times.clone(), size, resumed)
    });
    let schedule = system.schedule.as_ref();
    let mode_run = ModeRun { planned, rank_cells, schedule, initial: &initial };
    let (kept, warped) = (start.kept.as_mut(), warped.as_mut());
    let recovered =
        mode_run.run(&mut evolution, &mut progress, kept, warped, checkpoints.as_mut())?;
    progress.finish();
    summary.checkpoints = checkpoints.map_or(0, |c| c.written);
    set_counts(summary, &recovered, communicator);
    drop(start.kept);
    summary.start_error = start.begun.as_ref().and_then(|begun| begun.error);
    let warning = start.begun.and_then(|begun| begun.warning);
    Ok(Some(SolvedFields { warning, ..unweighted(prepared, recovered, summary) }))
}

/// The distribution of `modes` and of cells with the weights `pi` over the ranks.
fn spread<'a>(
    communicator: &'a Communicator,
    case: &'a Case,
    rank_cells: &'a RankCells,
    modes: &'a [Vec<usize>],
    pi: &'a [f64],
) -> Spread<'a> {
    let (space, block) = (&case.space, &rank_cells.block);
    Spread { communicator, space, block, modes, pi: &pi[..block.cells()], buffers: BUFFERS }
}

/// A case that is solved by modes, its plan, and the distribution of its modes and cells.
#[derive(Clone, Copy)]
struct DistributedModes<'a> {
    case: &'a Case,
    plan: &'a Plan,
    /// The modes of the plan.
    warp: &'a WarpPlan,
    spread: &'a Spread<'a>,
}

/// Cost of this rank's `batches` over all `stages` that is left. In a resumed run the stages before
/// that of the checkpoint are finished, and some batches of that stage.
fn cost_left(batches: &[Batch], stages: usize, resumed: Option<&ResumePoint<'_>>) -> usize {
    match resumed {
        Some(r) => (stages - 1 - r.generation.state.stage) * cost(batches) + cost(&r.batches),
        None => stages * cost(batches),
    }
}

/// The start of the modes, from the initial fields or from the modes of a file.
struct ModeStart {
    /// Norm of the modes of each field, or a bound on it.
    norms: Vec<f64>,
    /// The modes of this rank, if the run keeps them; already read if they start from a file.
    kept: Option<RankModes>,
    /// Properties of the modes of that file.
    begun: Option<StartModes>,
}

impl ModeStart {
    /// Reads `initial.warped` if the case has it. Collective.
    ///
    /// # Errors
    /// As [`read_start`].
    fn new(planned: DistributedModes<'_>, system: &DiscreteSystem) -> Result<Self> {
        let DistributedModes { case, warp, spread, .. } = planned;
        let communicator = spread.communicator;
        let own = &spread.modes[communicator.modes.rank()];
        let mut kept = (warp.points).map(|_| RankModes::new(system.matrix.rows(), own.clone()));
        let begun = match (&case.warped_start, &mut kept) {
            (Some(start), Some(kept)) => Some(read_start(start, planned, system, kept)?),
            _ => None,
        };
        let norm = |state: &Vec<f64>| match &begun {
            Some(begun) => begun.largest_norm,
            None => system.norm(communicator, state),
        };
        Ok(Self { norms: system.states.iter().map(norm).collect(), kept, begun })
    }
}

/// The propagation of all modes of a run, from their start to the recovered fields.
struct ModeRun<'a> {
    planned: DistributedModes<'a>,
    rank_cells: &'a RankCells,
    schedule: Option<&'a Schedule>,
    initial: &'a [InitialState<'a>],
}

impl ModeRun<'_> {
    /// Propagates the modes and recovers the fields. A run that keeps its modes (`kept`) also
    /// writes their `files`, if it has any. Collective.
    ///
    /// # Errors
    /// As [`crate::solve::modes::run`]; a propagator without room for its scratch.
    fn run(
        &self,
        evolution: &mut Evolution<'_>,
        progress: &mut Progress,
        kept: Option<&mut RankModes>,
        mut files: Option<&mut WarpedOutput<'_>>,
        checkpoints: Option<&mut Checkpoints<'_>>,
    ) -> Result<RecoveredFields> {
        let DistributedModes { case, plan, warp, spread } = self.planned;
        let (communicator, space) = (spread.communicator, spread.space);
        let setting = plan.propagator_setting(warp);
        let made = propagator(&setting, self.schedule, evolution.matrix);
        let mut propagator = communicator.world.agree(made)?;
        let factors = VelocityFactors::new(space);
        let moments = MomentsOf::new(space, &factors, spread.pi);
        let task = Task {
            communicator,
            warp,
            legs: &warp.legs,
            batches: &plan.layout.groups[communicator.modes.rank()],
            initial: self.initial,
            shares: &self.rank_cells.ranges,
            moments: Some(&moments),
        };
        let mut after = |end: LegEnd, kept: &RankModes| match files.as_mut() {
            Some(files) => self.write(files, end, kept),
            None => Ok(()),
        };
        let begun = case.warped_start.is_some();
        let mut keeping = kept.map(|kept| FullRunModes { kept, begun, after: &mut after });
        let hooks = RunHooks { keeping: keeping.as_mut(), checkpoints };
        let stores = hooks.checkpoints.is_some();
        if stores {
            // From now on all ranks answer a stop signal together.
            communicator.world.barrier();
            machine::begin(RunPart::Modes);
        }
        let recovered = modes::run(&task, evolution, &mut *propagator, progress, hooks);
        if stores {
            // A signal comes too late for a checkpoint now.
            machine::begin(RunPart::Outside);
        }
        recovered
    }

    /// Writes the modes of a field at the end of a leg, if the case asks for them. Collective.
    fn write(
        &self,
        files: &mut WarpedOutput<'_>,
        LegEnd { field, leg }: LegEnd,
        kept: &RankModes,
    ) -> Result<()> {
        let DistributedModes { case, plan, warp, spread } = self.planned;
        let WarpPlan { series, interval, legs, .. } = warp;
        // Files of times before the end have a number in their name.
        let times = &case.output.times;
        let time = Leg::output_times(&legs[..=leg]).count() - 1;
        let wanted = |time: &usize| times.get(*time).is_none_or(|t| t.fields);
        if !case.output.warped_field || !wanted(&time) {
            return Ok(());
        }
        let started = Instant::now();
        let number = times.get(time).map(|_| (0..=time).filter(wanted).count());
        let about = FileAttributes {
            case,
            plan,
            time: times.get(time).map_or(case.end, |t| t.time),
            seconds: files.seconds,
            provenance: files.provenance,
        };
        let name = warped::file_name(case.fields[field].name, number);
        let path = files.directory.join(name);
        warped::write(&path, &about, spread, series, interval[0], kept)?;
        files.writing_seconds += started.elapsed().as_secs_f64();
        Ok(())
    }
}

/// Puts the counts of a run by modes into `summary`, summed over all groups. Collective.
fn set_counts(summary: &mut Summary, recovered: &RecoveredFields, communicator: &Communicator) {
    let groups = &communicator.modes;
    summary.unitarity_defect = recovered.unitarity_defect;
    summary.norm_kept = recovered.norm_kept;
    summary.matvecs = groups.sum_count(recovered.applications);
    summary.matvecs_here = groups.sum_count(recovered.applications_here);
    summary.solves = groups.sum_count(recovered.solves);
    let (world, busy) = (&communicator.world, recovered.busy_seconds);
    summary.group_seconds = Some([-world.max(-busy), world.max(busy)]);
}

/// The recovered fields without weights; the error of the time step relative to them goes into
/// `summary`. Collective.
fn unweighted(
    prepared: &Prepared,
    recovered: RecoveredFields,
    summary: &mut Summary,
) -> SolvedFields {
    let fields: Vec<FieldReadings> = (recovered.fields.into_iter())
        .map(|readings| readings.map(|u| prepared.unweighted(u)))
        .collect();
    let volumes = volumes_of(prepared);
    let norms: Vec<FieldNorms<'_>> = (fields.iter())
        .map(|readings| FieldNorms::new(prepared, &volumes, readings.first()))
        .collect();
    summary.step_error = (norms.iter().zip(recovered.step_errors))
        .map(|(norms, error)| norms.relative(&prepared.unweighted(error)))
        .filter(|e| e.is_finite())
        .reduce(f64::max);
    summary.step_beyond = (norms.iter().zip(&recovered.step_beyond))
        .map(|(norms, beyond)| beyond / norms.norm())
        .fold(0.0, f64::max);
    SolvedFields {
        fields,
        plateau: (recovered.plateau.into_iter()).map(|u| prepared.unweighted(u)).collect(),
        early: history(prepared, recovered.early),
        warning: None,
    }
}

/// Properties of modes that were read from a file.
struct StartModes {
    /// Largest norm of a mode.
    largest_norm: f64,
    /// Checksum of the file's dataset `/w`.
    checksum: u64,
    /// Relative error of `f` that they may cause, if it exceeds the tolerance.
    error: Option<f64>,
    /// A warning of that error.
    warning: Option<String>,
}

/// Largest relative error of `f` due to an uneven start that is accepted with any tolerance.
const MOST_UNEVEN: f64 = 1e-3;

/// Refuses a start whose `e^p w` is not flat where `f` is read, and warns of one that varies by
/// more than `case.tolerance`. Only warns if the case writes the warped field. The points of the
/// start lie in `interval`.
fn refuse_uneven(
    start: &WarpedStart,
    case: &Case,
    domain: ReadingDomain,
    interval: [f64; 2],
    uneven: f64,
) -> Result<Option<String>> {
    let [lower, upper] = domain.ends;
    let finding = format!(
        "e^p w varies by {uneven:.1e} of its largest value where f at p = {:.4} depends on it, \
         from p = {lower:.4} to {upper:.4}: f may be off by that",
        domain.point
    );
    let [first, last] = interval;
    let beyond = if lower < first || upper > last {
        format!("; beyond its points, from {first:.4} to {last:.4}, the field is repeated")
    } else {
        String::new()
    };
    let bound = MOST_UNEVEN.max(10.0 * case.tolerance);
    if uneven <= bound || case.output.warped_field {
        let warns = uneven > case.tolerance;
        return Ok(warns.then(|| format!("initial.warped: {finding}{beyond}")));
    }
    Err(start.wrong(&format!(
        "{finding}, at most {bound:.0e} is accepted{beyond}; solver.warp.recovery reads f \
         elsewhere, output.warped_field = true asks for w instead of f"
    )))
}

/// Reads the modes that the run starts from. Collective.
///
/// # Errors
/// As [`WarpedFile::read`] and [`refuse_uneven`]; [`Error::Magnitude`] for values whose squares
/// overflow or vanish.
fn read_start(
    start: &WarpedStart,
    planned: DistributedModes<'_>,
    system: &DiscreteSystem,
    kept: &mut RankModes,
) -> Result<StartModes> {
    let DistributedModes { case, plan, warp, spread } = planned;
    let given = WarpedFile {
        path: start.path.clone(),
        interval: warp.interval,
        points: warp.points.unwrap_or_default(),
    };
    let domain = ReadingDomain::new(&warp.readings[0], &plan.bounds, case.duration());
    let ReadField { checksum, largest: peak, unevenness } =
        given.read(ModesFromFile { spread, series: &warp.series, kept, domain })?;
    let communicator = spread.communicator;
    if peak != 0.0 && !(1e-100..=1e100).contains(&peak) {
        return Err(Error::Magnitude { key: start.place.clone(), value: peak });
    }
    let warning = refuse_uneven(start, case, domain, warp.interval, unevenness)?;
    let rows = kept.rows();
    let mut largest = 0.0f64;
    for k in 0..kept.modes().len() {
        let mode = &kept.values()[k * rows..(k + 1) * rows];
        let norm = system.norm_of_mode(communicator, mode);
        kept.progress_mut()[k] = ModeProgress::start(norm);
        largest = largest.max(norm);
    }
    let error = warning.as_ref().map(|_| unevenness);
    Ok(StartModes { largest_norm: communicator.world.max(largest), checksum, error, warning })
}
