//! The modes of a run for a part of the time.

use crate::base::error::Result;
use crate::base::progress::Progress;
use crate::matrix::block_matrix::BlockMatrix;
use crate::matrix::observables::{MomentsOf, VelocityFactors};
use crate::parallel::communicator::{Communicator, GhostExchange};
use crate::plan::Plan;
use crate::plan::balance::Batch;
use crate::problem::case::Case;
use crate::problem::legs::Leg;
use crate::propagate::commutator_free::stage_degree;
use crate::propagate::evolution::{Evolution, InitialState};
use crate::propagate::interruption::Interruption;
use crate::propagate::method::{BatchCoupling, Propagator};
use crate::propagate::time_dependent_inflow::Schedule;
use crate::propagate::{self, PropagationSpan, descriptor, propagator};
use crate::schrodingerization::warp_plan::WarpPlan;
use crate::solve::modes::{self, RunHooks};
use crate::solve::prepared::Prepared;
use crate::solve::rank_cells::RankCells;
use crate::solve::rank_modes::{ModeProgress, RankModes};
use crate::solve::stage::{FullRunModes, LegEnd, Task};
use crate::solve::system::DiscreteSystem;
use crate::study::calibrate::timing::{
    LONG_ENOUGH, LinearCost, PARTS, SolveTime, TimedWork, line, repeated,
};
use num_complex::Complex64;
use std::time::Instant;

/// Number of pieces that are tried if they do not all run at the same rate.
const PIECES: usize = 3;

/// Predicted seconds of the modes of `warp` on the block of `prepared`, which is that of the run
/// itself if `whole`. Collective.
///
/// # Errors
/// As [`modes::run`].
pub fn predict_solve_time(
    prepared: &mut Prepared,
    warp: &WarpPlan,
    whole: bool,
) -> Result<SolveTime> {
    let given = GivenMode::new(prepared);
    let norms: Vec<f64> = match &given {
        Some(given) if given.norm > 0.0 => vec![given.norm; prepared.system.states.len()],
        _ => (prepared.system.states.iter())
            .map(|state| prepared.system.norm(&prepared.communicator, state))
            .collect(),
    };
    let Prepared { case, plan, communicator, rank_cells, system, .. } = prepared;
    let DiscreteSystem { matrix, exchange, states, weights, schedule, norm_terms: terms, .. } =
        system;
    let rows = matrix.rows();
    let factors = VelocityFactors::new(&case.space);
    let mut trials = ModeTrials {
        case,
        plan,
        warp,
        communicator,
        rank_cells,
        initial: (states.iter().zip(norms))
            .map(|(state, norm)| InitialState::real(&state[..rows], norm))
            .collect(),
        moments: MomentsOf::new(&case.space, &factors, &weights.pi[..matrix.block.cells()]),
        matrix,
        exchange,
        schedule: schedule.as_ref(),
        terms: *terms,
        given,
        coupling: descriptor(plan.propagation.method).batch_coupling(),
    };
    trials.predict_solve_time(whole)
}

/// A mode with made-up values, in place of the modes of a warped field that a run starts from.
struct GivenMode {
    state: Vec<Complex64>,
    norm: f64,
}

impl GivenMode {
    /// A mode with made-up values; `None` if the run starts from fields. Collective.
    fn new(prepared: &Prepared) -> Option<Self> {
        prepared.case.warped_start.as_ref()?;
        let system = &prepared.system;
        // Without zeros: arithmetic with zeros may be faster.
        let mode = |i: usize| Complex64::cis((i * i % 257) as f64);
        let state: Vec<Complex64> = (0..system.matrix.rows()).map(mode).collect();
        let norm = system.norm_of_mode(&prepared.communicator, &state);
        Some(Self { state, norm })
    }
}

/// Trials of the modes on a block.
struct ModeTrials<'a> {
    case: &'a Case,
    plan: &'a Plan,
    warp: &'a WarpPlan,
    communicator: &'a Communicator,
    rank_cells: &'a RankCells,
    matrix: &'a BlockMatrix,
    exchange: &'a mut GhostExchange,
    schedule: Option<&'a Schedule>,
    terms: usize,
    initial: Vec<InitialState<'a>>,
    given: Option<GivenMode>,
    moments: MomentsOf<'a>,
    coupling: BatchCoupling,
}

impl<'a> ModeTrials<'a> {
    fn predict_solve_time(&mut self, whole: bool) -> Result<SolveTime> {
        let (plan, world) = (self.plan, &self.communicator.world);
        let groups = &plan.layout.groups;
        let mine = &groups[self.communicator.modes.rank() % groups.len()];
        let tried = pieces(mine, self.coupling);
        let making = Instant::now();
        let all = ShortenedRun::new(self, PARTS);
        drop(world.agree(all.propagator(self.matrix))?);
        let making = world.max(making.elapsed().as_secs_f64());
        let nothing = repeated(&mut || self.trial(1, &[]))?.seconds;
        let LinearCost { rate, fixed } = line(&mut |part| self.trial(part, &tried))?;
        // Pieces of the group with most to do.
        let tried = world.max(tried.len() as f64).max(1.0);
        let piece = ((fixed - nothing) / tried).max(0.0);
        let most = groups.iter().map(|group| {
            let pieces = match self.coupling {
                BatchCoupling::Sequential => group.iter().map(|b| b.modes.len()).sum(),
                _ => group.len(),
            };
            let cost: f64 = group.iter().map(|b| all.cost(b, self.coupling)).sum();
            piece * pieces as f64 + rate * cost
        });
        let mut seconds = nothing + most.fold(0.0, f64::max);
        if whole && seconds < LONG_ENOUGH {
            // So short a run is timed as it is.
            seconds = repeated(&mut || self.trial(PARTS, mine))?.seconds;
        }
        let application = rate / self.case.fields.len() as f64;
        Ok(SolveTime { solve: making + seconds, application })
    }

    /// Runs `batches` for a part of the time, as a full run does but for the files. Collective.
    fn trial(&mut self, part: usize, batches: &[Batch]) -> Result<TimedWork> {
        let (short, world) = (ShortenedRun::new(self, part), &self.communicator.world);
        let mut propagator = world.agree(short.propagator(self.matrix))?;
        let mut system = Evolution {
            matrix: self.matrix,
            exchange: &mut *self.exchange,
            space: &self.communicator.space,
            bounds: &self.plan.bounds,
            time: self.case.duration(),
            norm_terms: self.terms,
            interruption: Interruption::default(),
        };
        let mut kept = self.warp.points.map(|_| {
            let modes = batches.iter().flat_map(|b| b.modes.clone());
            RankModes::new(self.matrix.rows(), modes.collect())
        });
        if let (Some(kept), Some(given)) = (&mut kept, &self.given) {
            kept.progress_mut().fill(ModeProgress::start(given.norm));
            let all = kept.values_mut().chunks_exact_mut(given.state.len().max(1));
            all.for_each(|mode| mode.copy_from_slice(&given.state));
        }
        world.barrier();
        let started = Instant::now();
        let task = Task {
            communicator: self.communicator,
            warp: &short.warp,
            legs: &short.legs,
            batches,
            initial: &self.initial,
            shares: &self.rank_cells.ranges,
            moments: Some(&self.moments),
        };
        let mut unwritten = |_: LegEnd, _: &RankModes| Ok(());
        let mut keeping = kept.as_mut().map(|kept| FullRunModes {
            kept,
            begun: self.given.is_some(),
            after: &mut unwritten,
        });
        let hooks = RunHooks { keeping: keeping.as_mut(), checkpoints: None };
        modes::run(&task, &mut system, &mut *propagator, &mut Progress::silent(), hooks)?;
        let seconds = world.max(started.elapsed().as_secs_f64());
        let cost: f64 = batches.iter().map(|b| short.cost(b, self.coupling)).sum();
        Ok(TimedWork { seconds, cost: world.max(cost) })
    }
}

/// A run of the modes with every leg cut down.
struct ShortenedRun<'a> {
    plan: &'a Plan,
    warp: WarpPlan,
    legs: Vec<Leg>,
    schedule: Option<Schedule>,
}

impl<'a> ShortenedRun<'a> {
    /// The run of `trials` cut down to `part` of [`PARTS`] equal parts of the time, rounded up to
    /// whole steps. The error that a mode may have is cut down in proportion.
    fn new(trials: &ModeTrials<'a>, part: usize) -> Self {
        let &ModeTrials { case, plan, warp, schedule, .. } = trials;
        let fraction = part as f64 / PARTS as f64;
        let mut legs = warp.legs.clone();
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
            leg.passed.iter_mut().for_each(|time| *time *= fraction);
            if part == PARTS {
                continue;
            }
            let of_mode = |l: usize| {
                let span =
                    PropagationSpan { time: leg.time, tolerance: warp.leg_tolerance(l) * fraction };
                let (mu, bounds) = (warp.wavenumber(l), &plan.bounds);
                propagate::work(&case.propagator, bounds, mu, span, &mut scratch)
            };
            let work = (0..warp.modes).map(of_mode).collect();
            warp.leg_work[k] = work;
        }
        warp.state_tolerance *= fraction;
        Self { plan, warp, legs, schedule }
    }

    fn propagator(&self, matrix: &BlockMatrix) -> Result<Box<dyn Propagator + '_>> {
        let setting = self.plan.propagator_setting(&self.warp);
        propagator(&setting, self.schedule.as_ref(), matrix)
    }

    /// The cost of a batch, counted leg by leg as in the plan. With a time-dependent inflow each
    /// exponential has its own degree.
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

/// The pieces of a group that are tried: one if all run at the same rate, otherwise [`PIECES`] from
/// the longest to the shortest.
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
