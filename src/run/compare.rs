//! The error of the fields: estimated from the distance between two readings, and measured against
//! the exact semi-discrete solution.

use crate::base::checksum;
use crate::base::error::{Error, Result};
use crate::base::progress::Progress;
use crate::plan::Plan;
use crate::problem::case::{Case, Integrator};
use crate::propagate::classical::{Classical, classical_steps};
use crate::propagate::time_dependent_inflow::Schedule;
use crate::propagate::{exponential_error, round_off, steps};
use crate::quantum::labelled_number::LabelledNumber;
use crate::quantum::probability::{PlannedState, Probabilities};
use crate::results::accuracy::GridErrorPair;
use crate::results::continued_result::ContinuedResult;
use crate::results::dataset::PlateauPoint;
use crate::results::summary::{FieldSummary, Summary};
use crate::run::norms::{FieldNorms, volumes_of};
use crate::run::solved::SolvedFields;
use crate::schrodingerization::warp_plan::WarpPlan;
use crate::solve::field_readings::FieldReadings;
use crate::solve::prepared::Prepared;
use crate::solve::system::StateNorms;

/// The norm may fall by up to this factor more than planned without a warning.
const RATIO_MARGIN: f64 = 1.2;

/// Least ratio of a reliable estimate to the round-off in the two fields.
const ROUND_OFF_MARGIN: f64 = 4.0;

/// Largest ratio of the roughly known part of a reliable estimate to the rest of it.
const LARGEST_REST: f64 = 2.0;

/// Refuses a solution with NaN or infinity in it. Collective.
///
/// # Errors
/// [`Error::NotFinite`].
pub(crate) fn refuse_not_finite(prepared: &Prepared, solution: &SolvedFields) -> Result<()> {
    let early = solution.early.iter().flat_map(|early| &early.fields).chain(&solution.plateau);
    let fields = solution.fields.iter().flat_map(FieldReadings::each);
    let mut values = fields.chain(early.map(Vec::as_slice)).flatten();
    let checked = if values.all(|f| f.is_finite()) {
        Ok(())
    } else {
        Err(Error::NotFinite("NaN or infinity".into()))
    };
    prepared.communicator.world.agree(checked)
}

/// Puts the error estimate and the probabilities of measuring the field into `summary`, and returns
/// warnings. Collective.
pub(crate) fn compare(
    prepared: &Prepared,
    solution: &SolvedFields,
    summary: &mut Summary,
) -> Vec<String> {
    let (case, plan) = (&prepared.case, &prepared.plan);
    summary.fields = (case.fields.iter())
        .map(|field| FieldSummary { name: field.name.to_owned(), ..FieldSummary::default() })
        .collect();
    if case.warped_start.is_some() {
        let why = "the warped field at the start is known at its points only";
        summary.doubt = Some(why.to_owned());
        return Vec::new();
    }
    let Some(warp) = &plan.warp else {
        return Vec::new();
    };
    let norm_fell = estimate(prepared, warp, solution, summary);
    include_step_error(summary);
    summary.inflow_jumps = prepared.system.schedule.as_ref().is_some_and(|all| all.jumps);
    // A measured error says more.
    let jumps = (summary.inflow_jumps && !case.verify).then(|| INFLOW_JUMPS.to_owned());
    let warnings: Vec<String> =
        norm_fell.into_iter().chain(jumps).chain(above_tolerance(case, plan, summary)).collect();
    let norms = state_norms(prepared, solution.first_field());
    summary.probabilities = Some(Probabilities::new(
        &PlannedState::of_plan(warp, &plan.bounds, case),
        norms,
        &LabelledNumber::exact,
    ));
    warnings
}

/// The norms of the first field that determine the probabilities of measuring it. Collective.
fn state_norms(prepared: &Prepared, field: &[f64]) -> StateNorms {
    let Prepared { communicator, system, rank_cells, .. } = prepared;
    let pi = &system.weights.pi[rank_cells.mine.clone()];
    let world = &communicator.world;
    let volumes = volumes_of(prepared);
    // With elements the weights are the volumes, which the norm already contains.
    let weight = |i: usize| if system.weights.are_volumes { 1.0 } else { pi[i].sqrt() };
    let start = &system.states[0];
    let [_, auxiliary] = system.norms_of_parts(communicator, start);
    let squares = |i: usize| [weight(i) * field[i], field[i]].map(|f| f * f);
    let [weighted, field] = volumes.sums(world, squares).map(f64::sqrt);
    StateNorms { start: system.norm(communicator, start), weighted, field, auxiliary }
}

/// Puts the distance to the exact semi-discrete solution (`solver.verify`) into `summary`: the
/// largest of all times at which the field is written. Collective.
pub(crate) fn verify(
    prepared: &mut Prepared,
    solution: &SolvedFields,
    prints: bool,
    summary: &mut Summary,
) {
    let mut reference = prepared.case.clone();
    reference.classical.integrator = Integrator::Exponential;
    let volumes = volumes_of(prepared);
    for (k, readings) in solution.fields.iter().enumerate() {
        // No leg ends at the start, which may be among the output times.
        let early = solution.early.iter().filter(|early| early.time > prepared.case.start_time);
        let early = early.map(|early| early.fields.get(k).map(Vec::as_slice));
        let ends: Vec<Option<&[f64]>> = early.chain([Some(readings.first())]).collect();
        let exact = exact_semidiscrete(prepared, &reference, k, prints);
        let fields =
            ends.into_iter().zip(exact).filter_map(|(field, exact)| field.zip(Some(exact)));
        let errors =
            fields.map(|(f, exact)| FieldNorms::new(prepared, &volumes, f).distance(&exact));
        let worst = errors.filter(|error| error.is_finite()).reduce(f64::max);
        summary.fields[k].error_semidiscrete = worst;
        summary.error_semidiscrete =
            (summary.error_semidiscrete.into_iter()).chain(worst).reduce(f64::max);
    }
}

/// Field `k` at the end of each leg of `case` by the classical exponential, on this rank's share.
/// Collective.
fn exact_semidiscrete(
    prepared: &mut Prepared,
    case: &Case,
    k: usize,
    prints: bool,
) -> Vec<Vec<f64>> {
    let Prepared { bounds, rank_cells, system, .. } = prepared;
    let mut state = system.states[k].clone();
    let terms = classical_steps(case, bounds).iter().sum();
    let progress = Progress::new(prints, "verify", terms);
    let mut classical =
        Classical::of(case, &system.matrix, &system.weights.pi).with_progress(progress);
    let mut ends = Vec::new();
    classical.integrate_legs(&mut system.exchange, case, bounds, &mut state, |_, state| {
        ends.push(system.weights.own_field(&rank_cells.mine, state));
    });
    ends
}

/// The error that a run inherits from the result that it continues. The difference `e` of two
/// solutions with the same inflow obeys `e' = A e`. In the weighted norm it grows at most by
/// `e^{growth t}`; between this norm and the l2 norm lies at most the spread of the weights.
/// Collective.
pub(crate) fn continued(
    prepared: &Prepared,
    f: &[f64],
    summary: &Summary,
) -> Option<ContinuedResult> {
    let (case, system) = (&prepared.case, &prepared.system);
    let start = case.start_field.as_ref()?;
    let origin = start.origin?;
    let volumes = volumes_of(prepared);
    let norms = FieldNorms::new(prepared, &volumes, f);
    let before = system.field_norm(&prepared.communicator, &system.states[0]);
    let ratio = before / norms.norm();
    let weights = &system.weights;
    let spread = if weights.are_volumes { 1.0 } else { weights.spread };
    let growth = (weights.certificate.max(0.0) * case.duration()).exp();
    let inherited = origin.error.map(|error| error * ratio * spread * growth);
    let error_inherited = inherited.filter(|error| error.is_finite());
    let own = summary.own_error().or_else(|| exponential_error(case, summary.matvecs));
    Some(ContinuedResult {
        file: start.path.display().to_string(),
        checksum: checksum::text(origin.checksum),
        time: case.start_time,
        error: origin.error,
        error_inherited,
        error_total: error_inherited.zip(own).map(|(inherited, own)| inherited + own),
        // What leaves takes its error along.
        grid: GridErrorPair {
            field: origin.grid_errors.field.map(|error| error * ratio.min(1.0)),
            ..origin.grid_errors
        },
    })
}

/// The first field at each reading of the plateau: its norm, and its distance to the field.
/// Collective.
pub(crate) fn plateau(prepared: &Prepared, solution: &SolvedFields) -> Vec<PlateauPoint> {
    let Some(warp) = &prepared.plan.warp else {
        return Vec::new();
    };
    let volumes = volumes_of(prepared);
    (warp.plateau.iter().zip(&solution.plateau))
        .map(|(reading, field)| {
            let norms = FieldNorms::new(prepared, &volumes, field);
            PlateauPoint {
                p: reading.point,
                distance: norms.distance(solution.first_field()),
                norm: (norms.square() * volumes.mean).sqrt(),
            }
        })
        .collect()
}

/// Puts the error estimate into `summary`: from the two readings of each field, or with inflow that
/// depends on time from its steps. Returns a warning if a norm fell by more than planned.
/// Collective.
fn estimate(
    prepared: &Prepared,
    warp: &WarpPlan,
    solution: &SolvedFields,
    summary: &mut Summary,
) -> Option<String> {
    let ComparedReadings { largest_ratio, largest_estimate } =
        compare_readings(prepared, warp, &solution.fields, summary);
    summary.norm_ratio = Some(largest_ratio).filter(|r| *r > 0.0);
    summary.norm_ratio_planned = Some(warp.ratio);
    let estimate = match &prepared.system.schedule {
        Some(schedule) => (largest_estimate)
            .map(|_| estimate_from_steps(prepared, schedule, solution.first_field())),
        None => largest_estimate,
    };
    if let Some(estimate) = estimate {
        estimate.put_into(summary);
    }
    let fell_more = largest_ratio > RATIO_MARGIN * warp.ratio;
    fell_more.then(|| {
        format!(
            "the norm of the field fell by a factor {largest_ratio:.3e}, but {:.3e} was planned: \
             the error may exceed the tolerance in proportion",
            warp.ratio
        )
    })
}

/// What the readings of all fields show.
struct ComparedReadings {
    /// Largest ratio of the norm of a state at the start to that of its field.
    largest_ratio: f64,
    /// Largest estimate of the error of a field from two readings, if there are two.
    largest_estimate: Option<ErrorEstimate>,
}

/// Compares the two readings of each field, and puts the estimates of the fields into `summary`.
/// Collective.
fn compare_readings(
    prepared: &Prepared,
    warp: &WarpPlan,
    fields: &[FieldReadings],
    summary: &mut Summary,
) -> ComparedReadings {
    let (plan, system) = (&prepared.plan, &prepared.system);
    let communicator = &prepared.communicator;
    let volumes = volumes_of(prepared);
    let mut largest_ratio: f64 = 0.0;
    let mut largest: Option<ErrorEstimate> = None;
    for (k, (readings, state)) in fields.iter().zip(&system.states).enumerate() {
        let norms = FieldNorms::new(prepared, &volumes, readings.first());
        let ratio = system.norm(communicator, state) / norms.norm();
        if !ratio.is_finite() {
            continue;
        }
        largest_ratio = largest_ratio.max(ratio);
        if let Some(second) = readings.second() {
            // The efficiency corrects for the part of the error that both readings share.
            let estimate = norms.distance(second) / warp.estimator_quality.efficiency;
            let amplification: f64 =
                (warp.readings[..2].iter()).map(|r| warp.amplification(r)).sum();
            let noise = round_off(plan.steps) * amplification * ratio;
            let round_off = ROUND_OFF_MARGIN * noise / warp.estimator_quality.efficiency;
            summary.fields[k].error_estimate = Some(estimate).filter(|e| e.is_finite());
            if largest.as_ref().is_none_or(|largest| estimate > largest.estimate) {
                let doubt = warp.estimate_doubt();
                largest = Some(ErrorEstimate { estimate, round_off, doubt });
            }
        }
    }
    ComparedReadings { largest_ratio, largest_estimate: largest }
}

/// An estimate of the error of a field, relative to the field.
struct ErrorEstimate {
    estimate: f64,
    /// The part of the estimate that may be round-off.
    round_off: f64,
    /// The reason why the estimate may not be the error; `None` if there is none.
    doubt: Option<&'static str>,
}

impl ErrorEstimate {
    /// Puts the estimate into `summary`, and whether it is reliable.
    fn put_into(self, summary: &mut Summary) {
        let Self { estimate, round_off, doubt } = self;
        let finite = Some(estimate).filter(|e| e.is_finite());
        if let [only] = &mut summary.fields[..] {
            only.error_estimate = finite;
        }
        summary.error_estimate = finite;
        summary.hidden_by_round_off = estimate <= round_off;
        let hidden = summary.hidden_by_round_off.then(|| {
            format!("it would be {estimate:.1e}, of which round-off may be {round_off:.1e}")
        });
        summary.doubt = doubt.map(str::to_owned).or(hidden);
        let is_known = finite.is_some() && !summary.hidden_by_round_off;
        summary.error_estimate_reliable = is_known && summary.doubt.is_none();
    }
}

/// The estimate with inflow that depends on time: the distance of `f` to the field that the search
/// for the number of steps ended with, and the error of that. Collective.
fn estimate_from_steps(prepared: &Prepared, schedule: &Schedule, f: &[f64]) -> ErrorEstimate {
    let Prepared { system, rank_cells, .. } = prepared;
    let reference = system.weights.own_field(&rank_cells.mine, &schedule.reference);
    let volumes = volumes_of(prepared);
    let distance = FieldNorms::new(prepared, &volumes, f).distance(&reference);
    let (rest, stages) = (schedule.reference_error, schedule.stages());
    let may_be_large = !schedule.order_is_seen && rest > LARGEST_REST * distance;
    let doubt = if schedule.jumps {
        Some("the inflow jumps in time, which all numbers of steps may miss alike")
    } else {
        may_be_large.then_some("the error of so few time steps is only roughly known")
    };
    ErrorEstimate {
        estimate: distance + rest,
        round_off: ROUND_OFF_MARGIN * round_off(stages),
        doubt,
    }
}

/// The warning about inflow that jumps in time.
const INFLOW_JUMPS: &str = "inflow.value jumps in time, so that the error may be far above the \
    tolerance; end the run at the jump and continue it (run --continue), make the jump smooth, or \
    measure the error (solver.verify = true)";

/// Largest leading term of a step's error that counts as an estimate of it.
const LARGEST_STEP_ERROR: f64 = 0.1;
/// Least part of a mode's norm that remains at the end, if the leading term counts as an estimate.
const LEAST_NORM_KEPT: f64 = 0.5;

/// Adds the error of the time step, which both readings share, to the error estimate.
fn include_step_error(summary: &mut Summary) {
    let Some(found) = summary.step_error else { return };
    // A long step moves the two readings apart by more than its error.
    let rest = summary.error_estimate.unwrap_or(0.0);
    summary.step_is_estimated = found <= LARGEST_STEP_ERROR
        && rest <= found.max(summary.tolerance)
        && summary.norm_kept >= Some(LEAST_NORM_KEPT)
        && summary.step_beyond <= 0.5 * found;
    if !summary.step_is_estimated {
        summary.doubt = Some("the step is too long for its error to be estimated".to_owned());
    }
    summary.error_estimate = summary.error_estimate.map(|e| e + found);
    summary.error_estimate_reliable &= summary.step_is_estimated;
}

/// Ratio to the tolerance from which a doubtful estimate leads to a warning.
const DOUBTFUL_MARGIN: f64 = 1.5;

/// The step that has the error of the steps of `case`, of which those of each leg are equal, if all
/// were equal.
fn mean_step(case: &Case, order: f64) -> f64 {
    let of_leg = |leg: f64| leg * (leg / steps(&case.propagator, leg) as f64).powf(order);
    let sum: f64 = case.legs().into_iter().map(of_leg).sum();
    (sum / case.duration()).powf(1.0 / order)
}

/// The warning that the error estimate of `summary` is above the tolerance, if it is.
fn above_tolerance(case: &Case, plan: &Plan, summary: &Summary) -> Option<String> {
    let tolerance = plan.tolerance;
    let (Some(found), Some(step)) = (summary.step_error, plan.propagation.step) else {
        let whole = summary.error_estimate.filter(|_| !summary.hidden_by_round_off)?;
        let margin = if summary.error_estimate_reliable { 1.0 } else { DOUBTFUL_MARGIN };
        return (whole > margin * tolerance).then(|| {
            format!("the error estimate {whole:.1e} is above the tolerance {tolerance:e}")
        });
    };
    let whole = summary.error_estimate.unwrap_or(found);
    let size = if summary.step_is_estimated {
        format!("contributes {found:.1e}")
    } else {
        format!("is too long for its error to be estimated (leading term {found:.1e})")
    };
    // This part of the error falls with a power of the step; the rest does not depend on it.
    let order = plan.propagation.method.order() as f64;
    let room = tolerance - (whole - found);
    let mean = mean_step(case, order);
    // Rounding to two digits adds at most the margin.
    let step_for = |part: f64| 0.95 * mean * (part / found).powf(1.0 / order);
    let enough = if room > 0.0 {
        format!("about {:.1e} would meet it", step_for(room))
    } else if found > 0.5 * tolerance {
        // The rest may be due to the step, too, which moves the two readings apart.
        format!("about {:.1e} would lower this part to half of it", step_for(0.5 * tolerance))
    } else {
        "which is the smaller part".to_owned()
    };
    (whole > tolerance).then(|| {
        format!(
            "solver.propagator.step: the error estimate {whole:.1e} is above the tolerance \
             {tolerance:e}; a step of {step:.3e} {size}, {enough}; chebyshev and krylov meet it \
             by themselves"
        )
    })
}
