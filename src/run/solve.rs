//! From the discrete problem to the fields at `T`: by modes, or classically.

use crate::base::error::{Error, Result};
use crate::base::progress::Progress;
use crate::matrix::observables::{MOMENTS, Moments, VelocityFactors, moments, totals};
use crate::parallel::communicator::{Communicator, GhostExchange};
use crate::plan::Plan;
use crate::plan::balance::cost;
use crate::plan::memory::BUFFERS;
use crate::problem::case::{Case, Integrator, WarpedStart};
use crate::propagate::classical::{Classical, EXACT, classical_steps, duhamel_panels};
use crate::propagate::limiter::Reconstruction;
use crate::propagate::method::{Evolution, Initial};
use crate::propagate::propagator;
use crate::results::dataset::{About, Early, slices};
use crate::results::summary::Summary;
use crate::results::warped;
use crate::results::warped::{Given, Spread};
use crate::run::compare::Norms;
use crate::schrodingerization::warp_plan::WarpPlan;
use crate::solve::checkpoint::store::{Generation, Store};
use crate::solve::checkpoint::watch::Times;
use crate::solve::checkpoint::{Checkpoints, Resumed};
use crate::solve::kept::{KeptModes, Passage};
use crate::solve::modes;
use crate::solve::modes::{Besides, Keeping, Leg, Task};
use crate::solve::place::Place;
use crate::solve::sum::MomentsOf;
use crate::solve::system::Problem;
use num_complex::Complex64;
use std::collections::BTreeMap;
use std::path::Path;
use std::time::Instant;

/// What was solved for, on this rank's share.
pub(crate) struct Solution {
    /// Every field at `T` by each reading: `[field][reading]`.
    pub fields: Vec<Vec<Vec<f64>>>,
    /// The first field by each reading of the plateau.
    pub plateau: Vec<Vec<f64>>,
    /// Seconds that went into the files of warped fields.
    pub warped_seconds: f64,
    /// What was found at earlier times.
    pub early: Vec<Early>,
}

/// Where warped fields are written, and what is said about them besides case and plan.
pub(crate) struct Warped<'a> {
    pub directory: &'a Path,
    pub seconds: &'a BTreeMap<String, f64>,
    pub provenance: &'a [(&'static str, String)],
}

/// How a run by modes makes checkpoints.
pub(crate) struct Checkpointing<'a> {
    /// Where they are.
    pub store: &'a mut Store,
    /// The one to go on from.
    pub generation: Option<Generation>,
    /// When they are made.
    pub times: Times,
}

/// What a run writes while it goes on.
pub(crate) struct Files<'a> {
    /// The warped fields.
    pub warped: Warped<'a>,
    /// Where it is by modes.
    pub checkpointing: Option<Checkpointing<'a>>,
}

/// What either method finds, on this rank's share.
struct Found {
    fields: Vec<Vec<Vec<f64>>>,
    plateau: Vec<Vec<f64>>,
    /// `ũ`, or sums for the moments, at the end of each leg but the last: `[field][leg]`.
    early: Vec<Vec<Vec<f64>>>,
    warped_seconds: f64,
}

/// Every field at `T`, and what is wanted before; in silence where no `files` are written. Collective.
pub(crate) fn solve(
    case: &Case,
    plan: &Plan,
    communicator: &Communicator,
    place: &Place,
    problem: &mut Problem,
    summary: &mut Summary,
    files: Option<Files<'_>>,
) -> Result<Solution> {
    let speaks = communicator.world.rank() == 0 && files.is_some();
    let found = match &plan.warp {
        Some(warp) => {
            let plans = (plan, warp);
            by_modes(case, plans, communicator, place, problem, summary, files)
        }
        None => classically(case, plan, communicator, place, problem, (summary, speaks)),
    }?;
    Ok(Solution {
        early: history(case, communicator, (place, problem), found.early),
        fields: found.fields,
        plateau: found.plateau,
        warped_seconds: found.warped_seconds,
    })
}

/// Moments and fields at the output times, from what was recovered there: `[field][leg]`.
fn history(
    case: &Case,
    communicator: &Communicator,
    (place, problem): (&Place, &Problem),
    mut recovered: Vec<Vec<Vec<f64>>>,
) -> Vec<Early> {
    let world = &communicator.world;
    let factors = VelocityFactors::new(&case.space);
    let legs = Leg::all(case);
    let early = case
        .times
        .iter()
        .zip(&legs)
        .enumerate()
        .map(|(leg, (at, wanted))| {
            let found = recovered
                .iter_mut()
                .map(|legs| std::mem::take(&mut legs[leg]));
            let (moments, fields) = if wanted.moments_only {
                let sums: Vec<f64> = found.flatten().collect();
                let (sums, _) = sums.as_chunks::<MOMENTS>();
                let dimension = case.space.dimension();
                (
                    Moments::of_sums(world, dimension, &factors, sums.iter().copied()),
                    Vec::new(),
                )
            } else {
                let fields: Vec<Vec<f64>> =
                    found.map(|u| problem.unweighted(&place.mine, u)).collect();
                let moments = moments(world, case, &slices(&fields));
                (moments, if at.fields { fields } else { Vec::new() })
            };
            Early {
                time: at.time,
                totals: totals(world, &case.space, &moments),
                moments,
                fields,
            }
        });
    early.collect()
}

/// The run without modes. Collective.
fn classically(
    case: &Case,
    plan: &Plan,
    communicator: &Communicator,
    place: &Place,
    problem: &mut Problem,
    (summary, speaks): (&mut Summary, bool),
) -> Result<Found> {
    let steps = classical_steps(case, &plan.bounds);
    let stages = if case.integrator == Integrator::SspRk3 {
        3
    } else {
        1
    };
    let factors = VelocityFactors::new(&case.space);
    let (mut fields, mut early) = (Vec::new(), Vec::new());
    for (k, start) in problem.states.iter().enumerate() {
        let slopes = Reconstruction::new(case, &problem.matrix, k);
        let slopes = communicator.world.agree(slopes)?;
        let progress = Progress::new(speaks, "steps", plan.classical_steps);
        let mut classical = Classical::of(case, &problem.matrix, &problem.weights.pi)
            .with_progress(progress)
            .with_slopes(slopes);
        let mut state = start.clone();
        let mut before = Vec::new();
        for (&Leg { time, moments_only }, &steps) in Leg::all(case).iter().zip(&steps) {
            let (span, exchange) = ((plan.bounds.rate, time), &mut problem.exchange);
            integrate(
                &mut classical,
                exchange,
                case.integrator,
                span,
                steps,
                &mut state,
            );
            if moments_only {
                let f = problem.unweighted(&place.mine, state[place.mine.clone()].to_vec());
                before.push(factors.at_points(&f).flatten().collect());
            } else {
                before.push(state[place.mine.clone()].to_vec());
            }
        }
        let end = before.pop().unwrap_or_default();
        fields.push(vec![problem.unweighted(&place.mine, end)]);
        early.push(before);
    }
    summary.matvecs = stages * plan.classical_steps * problem.states.len();
    summary.matvecs_here = summary.matvecs;
    Ok(Found {
        fields,
        plateau: Vec::new(),
        early,
        warped_seconds: 0.0,
    })
}

/// The run by modes. Collective.
fn by_modes(
    case: &Case,
    (plan, warp_plan): (&Plan, &WarpPlan),
    communicator: &Communicator,
    place: &Place,
    problem: &mut Problem,
    summary: &mut Summary,
    files: Option<Files<'_>>,
) -> Result<Found> {
    let speaks = communicator.world.rank() == 0 && files.is_some();
    let (warped, mut checkpointing) = match files {
        Some(files) => (Some(files.warped), files.checkpointing),
        None => (None, None),
    };
    let group = communicator.modes.rank();
    let batches = &plan.layout.groups[group];
    let legs = Leg::all(case);
    let generation = checkpointing.as_mut().and_then(|c| c.generation.take());
    let resumed = generation.map(|generation| {
        let finished = generation.state.finished.iter().copied().collect();
        Resumed {
            batches: plan.batches_left(&finished, group),
            share: &place.share,
            generation,
        }
    });
    // Stages before the one to go on with are finished, of that one some batches.
    let stages = problem.states.len() * warp_plan.points.map_or(1, |_| legs.len());
    let left = resumed.as_ref().map_or(stages * cost(batches), |r| {
        (stages - 1 - r.generation.state.stage) * cost(batches) + cost(&r.batches)
    });
    let mut progress = Progress::new(speaks, "modes", left * problem.states.len() / stages);
    let rows = problem.matrix.rows();
    let modes: Vec<Vec<usize>> = plan.layout.modes();
    let mut kept = warp_plan.points.map(|_| {
        let mine = &modes[communicator.modes.rank()];
        KeptModes::new(rows, mine.clone())
    });
    let spread = Spread {
        communicator,
        space: &case.space,
        block: &place.block,
        modes: &modes,
        pi: &problem.weights.pi[..place.block.cells()],
        buffers: BUFFERS,
    };
    let largest = match (&case.start, &mut kept) {
        (Some(start), Some(kept)) => {
            let (largest, values) = begin(start, warp_plan, &spread, problem, kept)?;
            let generation = resumed.as_ref().map(|r| &r.generation);
            if let Some(checkpointing) = &mut checkpointing {
                checkpointing.store.begins_with(values, generation)?;
            }
            Some(largest)
        }
        _ => None,
    };
    let initial: Vec<Initial<'_>> = (problem.states.iter())
        .map(|state| {
            let norm = largest.unwrap_or_else(|| problem.norm(communicator, state, false));
            Initial::real(&state[..rows], norm)
        })
        .collect();
    let setting = plan.propagator_setting(warp_plan);
    let made = propagator(&setting, problem.schedule.as_ref(), &problem.matrix);
    let mut propagator = communicator.world.agree(made)?;
    let mut system = Evolution {
        matrix: &problem.matrix,
        exchange: &mut problem.exchange,
        space: &communicator.space,
        rate: plan.bounds.rate,
        growth: plan.bounds.growth,
        time: case.end,
        terms: problem.terms,
    };
    let factors = VelocityFactors::new(&case.space);
    let moments = MomentsOf {
        factors: &factors,
        pi: spread.pi,
    };
    let task = Task {
        communicator,
        warp: warp_plan,
        legs: &legs,
        batches,
        initial: &initial,
        shares: &place.ranges,
        moments: Some(&moments),
    };
    let mut warped_seconds = 0.0;
    let mut write = |k: usize, leg: usize, kept: &KeptModes| {
        // Of the times before the end those that are to show the fields; they are numbered.
        let wanted = |leg: &usize| case.times.get(*leg).is_none_or(|t| t.fields);
        let Some(files) = warped
            .as_ref()
            .filter(|_| case.warped_field && wanted(&leg))
        else {
            return Ok(());
        };
        let started = Instant::now();
        let early = case
            .times
            .get(leg)
            .map(|_| (0..=leg).filter(wanted).count());
        let about = About {
            case,
            plan,
            time: case.times.get(leg).map_or(case.end, |t| t.time),
            seconds: files.seconds,
            provenance: files.provenance,
        };
        let name = warped::file_name(case.fields[k].name, early);
        let field = (&warp_plan.series, warp_plan.interval[0]);
        warped::write(files.directory, &name, &about, &spread, field, kept)?;
        warped_seconds += started.elapsed().as_secs_f64();
        Ok(())
    };
    let mut keeping = kept.as_mut().map(|kept| Keeping {
        kept,
        begun: case.start.is_some(),
        after: &mut write,
    });
    let mesh = &plan.layout.mesh;
    let size = (warp_plan.modes, stages);
    summary.resumed = resumed.is_some();
    let mut checkpoints = checkpointing.map(|Checkpointing { store, times, .. }| {
        Checkpoints::new((communicator, mesh), store, times, size, resumed)
    });
    let besides = Besides {
        keeping: keeping.as_mut(),
        checkpoints: checkpoints.as_mut(),
    };
    let recovered = modes::run(&task, &mut system, &mut *propagator, &mut progress, besides)?;
    drop(kept);
    progress.finish();
    summary.checkpoints = checkpoints.map_or(0, |c| c.written);
    summary.unitarity_defect = recovered.unitarity_defect;
    summary.norm_kept = recovered.norm_kept;
    summary.matvecs = communicator.modes.sum_count(recovered.applications);
    summary.matvecs_here = (communicator.modes).sum_count(recovered.applications_here);
    summary.solves = communicator.modes.sum_count(recovered.solves);
    let busy = recovered.busy_seconds;
    summary.group_seconds = Some([-communicator.world.max(-busy), communicator.world.max(busy)]);
    let unweighted = |u: Vec<f64>| problem.unweighted(&place.mine, u);
    let fields: Vec<Vec<Vec<f64>>> = (recovered.fields.into_iter())
        .map(|readings| readings.into_iter().map(unweighted).collect())
        .collect();
    let step_errors = recovered.step_errors.into_iter().map(unweighted);
    let velocities = case.space.velocity_cells();
    summary.step_error = (fields.iter().zip(step_errors))
        .map(|(readings, error)| {
            let f = &readings[0];
            let world = &communicator.world;
            let norms = Norms {
                world,
                velocities,
                f,
            };
            (norms.square(&error) / norms.square(f)).sqrt()
        })
        .filter(|e| e.is_finite())
        .reduce(f64::max);
    summary.step_beyond = (fields.iter().zip(&recovered.step_beyond))
        .map(|(readings, beyond)| {
            let norms = Norms {
                world: &communicator.world,
                velocities,
                f: &readings[0],
            };
            beyond / norms.square(&readings[0]).sqrt()
        })
        .fold(0.0, f64::max);
    Ok(Found {
        fields,
        plateau: recovered.plateau.into_iter().map(unweighted).collect(),
        early: recovered.early,
        warped_seconds,
    })
}

/// Reads the modes that the run starts from; gives the largest of their norms, and the checksum of the file's `/w`. Collective.
///
/// # Errors
/// As [`Given::read`]; [`Error::Magnitude`] for values whose squares overflow or vanish.
fn begin(
    start: &WarpedStart,
    warp: &WarpPlan,
    spread: &Spread<'_>,
    problem: &Problem,
    kept: &mut KeptModes,
) -> Result<(f64, u64)> {
    let given = Given {
        path: start.path.clone(),
        interval: warp.interval,
        points: warp.points.unwrap_or_default(),
    };
    let (values, peak) = given.read(spread, &warp.series, kept)?;
    let communicator = spread.communicator;
    if peak != 0.0 && !(1e-100..=1e100).contains(&peak) {
        return Err(Error::Magnitude {
            key: start.place.clone(),
            value: peak,
        });
    }
    let mut part = vec![0.0; kept.rows()];
    let mut largest = 0.0f64;
    for k in 0..kept.modes().len() {
        let values = &kept.values()[k * part.len()..(k + 1) * part.len()];
        let norms = [|x: &Complex64| x.re, |x: &Complex64| x.im].map(|of| {
            part.iter_mut()
                .zip(values)
                .for_each(|(part, x)| *part = of(x));
            problem.norm(communicator, &part, false)
        });
        let norm = norms[0].hypot(norms[1]);
        kept.passages_mut()[k] = Passage::start(norm);
        largest = largest.max(norm);
    }
    Ok((communicator.world.max(largest), values))
}

/// `state ← state(time)` by the classical method. Collective over the space group.
pub(crate) fn integrate(
    classical: &mut Classical<'_>,
    exchange: &mut GhostExchange,
    integrator: Integrator,
    (rate, time): (f64, f64),
    steps: usize,
    state: &mut [f64],
) {
    match integrator {
        Integrator::Exponential if classical.varies() => {
            let panels = duhamel_panels(rate * time);
            classical.duhamel(exchange, state, (rate, time), panels);
        }
        Integrator::Exponential => classical.exponential(exchange, state, (rate, time), EXACT),
        _ => classical.steps(exchange, state, integrator, time, steps),
    }
}
