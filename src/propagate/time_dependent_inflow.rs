//! Inflow that depends on time: `f' = A f + b(t)`.
//!
//! A step of length `h` from `t` is two exponentials of length `h/2`, each with a constant inflow:
//! the commutator-free scheme of order 4 (Blanes and Moan 2006; Alvermann and Fehske 2011, CF4:2)
//! with the Gauss nodes `t + (½ ∓ √3/6) h`, where `b` is `b_1` and `b_2`:
//!
//! ```text
//! first  half: b̄ = (½ + √3/3) b_1 + (½ − √3/3) b_2
//! second half: b̄ = (½ − √3/3) b_1 + (½ + √3/3) b_2
//! ```
//!
//! (`A` itself is constant, and the two weights add up to 1.) Schrödingerization of a stage, whose
//! generator is constant, is exact: the modes recover the product of the stages' real exponentials.
//! So the error of the time steps is that of the same scheme applied to `f' = A f + b(t)` directly,
//! and one real vector shows how many steps a tolerance needs. The number of steps is doubled; let
//! the distance `d` of two runs fall by the ratio `q` (16 at order 4, less if the steps are too
//! long or `b` is rough). The error of the finer run is `d/(q − 1)`, that of the coarser one `d
//! q/(q − 1)`. At most `q = 16` is trusted, and `q = 4` before there is a ratio. The field of the
//! most steps is kept: the distance of the recovered field to it is the error of the run, up to
//! that of these steps.
//!
//! The couplings of a stage are `κ_i = b̄_i/δ_i`, `r_i(0) = δ_i`, with `δ_i` such that the largest
//! coupling over the stages is the largest that [`crate::matrix::embedding`] allows.

use crate::base::error::{Error, LESS_MEMORY, Result};
use crate::base::memory;
use crate::base::text::bytes_text;
use crate::matrix::block_matrix::BlockMatrix;
use crate::matrix::bounds::INFLOW_GROWTH;
use crate::matrix::inflow::{AuxiliaryRow, UndefinedSource};
use crate::parallel::communicator::{Communicator, GhostExchange};
use crate::problem::case::{Case, Embedding};
use crate::problem::grid::describe_point;
use crate::propagate::classical::{Classical, ClassicalSpan};
use std::ops::Range;

/// The part of the tolerance that the time steps may take.
pub const TIME_SHARE: f64 = 0.2;
/// Steps of the first run.
const FEWEST_STEPS: usize = 8;
const MOST_STEPS: usize = 1 << 13;
/// Smallest tolerance: the round-off of some thousand stages stays well below its share.
const SMALLEST: f64 = 2e-12;
/// Number of times at which the inflow is sampled before the steps are chosen.
const SAMPLES: usize = 256;
/// Poisson probabilities left out of a stage of the real exponential.
const NEGLIGIBLE: f64 = 1e-16;

/// Gauss nodes of a step of unit length.
fn nodes() -> [f64; 2] {
    let half = 3f64.sqrt() / 6.0;
    [0.5 - half, 0.5 + half]
}

/// The inflow in the two halves of a step, by its values at the [`nodes`].
fn half_step_values([b1, b2]: [f64; 2]) -> [f64; 2] {
    let third = 3f64.sqrt() / 3.0;
    let (large, small) = (0.5 + third, 0.5 - third);
    [large * b1 + small * b2, small * b1 + large * b2]
}

/// The inflow in stages: constant on each half of each step.
#[derive(Clone, Debug, Default)]
pub struct Schedule {
    /// Number of steps, of two stages each.
    pub steps: usize,
    /// `κ_i` by stage, then row by row of [`BlockMatrix::inflow`], in weighted unknowns.
    pub couplings: Vec<f64>,
    /// Largest `|κ_i|` over the stages.
    pub envelope: Vec<f64>,
    /// The auxiliary unknowns, in weighted unknowns.
    pub unknowns: Vec<f64>,
    /// Growth that the inflow adds for elements with one unknown for all rows.
    pub common_growth: f64,
    /// Relative l2 error of the field from the steps.
    pub error: f64,
    /// Norm `‖f(T)‖` of the field at the end.
    pub norm: f64,
    /// The weighted field at the end by the most steps that were tried, without modes, on the
    /// block's cells.
    pub reference: Vec<f64>,
    /// Relative l2 error of `reference`.
    pub reference_error: f64,
    /// Whether the error of the reference follows from runs with three numbers of steps. From two
    /// numbers it may be five times too large.
    pub order_is_seen: bool,
    /// Whether the inflow jumps in time: different numbers of steps may err alike then.
    pub jumps: bool,
}

impl Schedule {
    /// Number of stages.
    pub fn stages(&self) -> usize {
        2 * self.steps
    }

    /// The couplings of a stage.
    pub fn stage(&self, stage: usize) -> &[f64] {
        let rows = self.envelope.len();
        &self.couplings[stage * rows..(stage + 1) * rows]
    }
}

/// `b̄_i` by stage, then row by row of [`BlockMatrix::inflow`].
pub fn stage_values(case: &Case, matrix: &BlockMatrix, steps: usize) -> Vec<f64> {
    let field = &case.fields[0];
    let h = case.duration() / steps as f64;
    let mut values = Vec::with_capacity(2 * steps * matrix.inflow.len());
    for step in 0..steps {
        let at = |c: f64| -> Vec<f64> {
            (matrix.entering.values(field, case.start_time + (step as f64 + c) * h)).collect()
        };
        let [first, second] = nodes().map(at);
        for half in 0..2 {
            let both = first.iter().zip(&second);
            values.extend(both.map(|(a, b)| half_step_values([*a, *b])[half]));
        }
    }
    values
}

/// `Σ rate max b̄²` with the largest square of each ghost's `b̄` over the stages, row by row of
/// [`BlockMatrix::inflow`].
fn largest_strengths(case: &Case, matrix: &BlockMatrix, steps: usize) -> Vec<f64> {
    let formula = case.fields[0].entering();
    let h = case.duration() / steps as f64;
    let square = |point: &[f64; 6]| {
        let stages = (0..steps).flat_map(|step| {
            let at = |c: f64| formula.at_point(point, case.start_time + (step as f64 + c) * h);
            half_step_values(nodes().map(at))
        });
        stages.fold(0.0, |most: f64, b| most.max(b * b))
    };
    matrix.entering.sums(square).collect()
}

/// The time of sample `k` of the inflow, from 0 to [`SAMPLES`]. The first and the last one are just
/// inside of the run: no step sees what the inflow is at its ends, where it may jump.
fn sample_time(case: &Case, k: usize) -> f64 {
    const AT_END: f64 = 1e-9;
    let place = (k as f64 / SAMPLES as f64).clamp(AT_END, 1.0 - AT_END);
    case.start_time + case.duration() * place
}

/// Samples the inflow over the whole run; returns the largest `|b_i|` on this rank.
///
/// # Errors
/// [`Error::Formula`] where it is not finite. Not collective.
pub fn largest_inflow(case: &Case, matrix: &BlockMatrix) -> Result<f64> {
    let field = &case.fields[0];
    let mut largest: f64 = 0.0;
    for k in 0..=SAMPLES {
        let time = sample_time(case, k);
        for (m, value) in matrix.entering.values(field, time).enumerate() {
            if !value.is_finite() {
                let UndefinedSource { value, point } = matrix.entering.undefined(field, m, time);
                let place = describe_point(case.space.dimension(), &point);
                return Err(field.entering().undefined(value, format!("{place}, t = {time}")));
            }
            largest = largest.max(value.abs());
        }
    }
    Ok(largest)
}

/// Whether the inflow on this rank jumps in time, looked for where it changes most from one sample
/// to the next. Not collective.
fn jumps(case: &Case, matrix: &BlockMatrix) -> bool {
    /// A smooth change falls by as many factors of two.
    const HALVINGS: u32 = 20;
    let at = |time: f64| -> Vec<f64> { matrix.entering.values(&case.fields[0], time).collect() };
    let change = |a: &[f64], b: &[f64]| {
        a.iter().zip(b).fold(0.0, |most: f64, (a, b)| most.max((a - b).abs()))
    };
    let (mut largest, mut place, mut last) = (0.0, 0, at(sample_time(case, 0)));
    for k in 1..=SAMPLES {
        let next = at(sample_time(case, k));
        let found = change(&last, &next);
        if found > largest {
            (largest, place) = (found, k);
        }
        last = next;
    }
    if place == 0 {
        return false;
    }
    let (mut low, mut high) = (sample_time(case, place - 1), sample_time(case, place));
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        let between = at(middle);
        if change(&at(low), &between) > change(&between, &at(high)) {
            high = middle
        } else {
            low = middle
        }
    }
    change(&at(low), &at(high)) > 0.5 * largest
}

/// Refuses a number of steps whose couplings, in this run and the one before, do not fit into
/// memory. Not collective.
///
/// # Errors
/// [`Error::Memory`].
fn check_memory(matrix: &BlockMatrix, steps: usize) -> Result<()> {
    let needed = 3 * 8 * steps as u64 * matrix.inflow.len() as u64;
    let available = memory::available();
    let available = available.together.min(available.alone);
    if needed <= available {
        return Ok(());
    }
    Err(Error::Memory {
        needed: bytes_text(needed),
        available: bytes_text(available),
        detail: format!("couplings of {steps} steps of an inflow that depends on time"),
        remedies: LESS_MEMORY.to_owned(),
    })
}

/// The field of a schedule.
pub struct WeightedField<'a> {
    /// Weights `π` of the rows.
    pub weights: &'a [f64],
    /// The weighted field at time zero.
    pub state: &'a [f64],
    /// Bound on `max |A_ii|`.
    pub rate: f64,
}

/// A run of the real field with a given number of steps.
struct RealRun {
    /// `b̄_i`, stage by stage.
    values: Vec<f64>,
    /// The weighted field at the end.
    state: Vec<f64>,
}

/// Searches the number of steps by runs of the real field.
struct StepSearch<'a> {
    case: &'a Case,
    matrix: &'a BlockMatrix,
    communicator: &'a Communicator,
    start: &'a WeightedField<'a>,
    /// `√π` of the rows with inflow.
    roots: Vec<f64>,
    /// Whether the inflow jumps in time.
    jumps: bool,
}

impl StepSearch<'_> {
    /// The run of `steps` steps. Collective.
    fn run(&self, exchange: &mut GhostExchange, steps: usize) -> Result<RealRun> {
        let world = &self.communicator.world;
        world.agree(check_memory(self.matrix, steps))?;
        let values = stage_values(self.case, self.matrix, steps);
        let (rows, stages) = (self.matrix.inflow.len(), 2 * steps);
        let span =
            ClassicalSpan { rate: self.start.rate, time: self.case.duration() / stages as f64 };
        let mut state = self.start.state.to_vec();
        let mut classical = Classical::new(self.matrix);
        // Ranks without inflow take part in the exchanges of the others.
        for k in 0..stages {
            let stage = &values[k * rows..(k + 1) * rows];
            classical.set_inflow(stage.iter().zip(&self.roots).map(|(b, root)| b * root));
            classical.exponential(exchange, &mut state, span, NEGLIGIBLE);
        }
        Ok(RealRun { values, state })
    }

    /// `‖f‖` of the weighted values `f(row)` on the cells, without the weights. Collective over the
    /// space group.
    fn norm(&self, f: impl Fn(usize) -> f64) -> f64 {
        let matrix = self.matrix;
        // For degrees above 0 the weights are volumes, which belong to the norm.
        let unweighted =
            |i: usize| if matrix.by_elements { f(i) } else { f(i) / self.start.weights[i].sqrt() };
        let square = |rows: Range<usize>| [rows.map(|i| unweighted(i) * unweighted(i)).sum()];
        let points = matrix.pieces().take(matrix.block.space_cells());
        let count = self.case.space.space_cells();
        let [sum]: [f64; 1] = self.communicator.space.sum_lanes(count, points.map(square));
        sum.sqrt()
    }

    /// The growth by each row from one unknown for all rows, times `δ²`: `π b²/(2 g)`, for elements
    /// `½ π Σ rate b²`. `most` are the largest `|b̄|` of the rows over the stages.
    fn halved_strengths(&self, most: &[f64], steps: usize) -> Vec<f64> {
        if self.matrix.by_elements {
            let strengths = largest_strengths(self.case, self.matrix, steps);
            let weighted = strengths.iter().zip(&self.roots);
            return weighted.map(|(strength, root)| 0.5 * root * root * strength).collect();
        }
        let rows = self.matrix.inflow.iter().zip(&self.roots).zip(most);
        rows.map(|((aux, root), b)| {
            let weighted = root * b;
            match *b {
                0.0 => 0.0,
                _ => weighted * weighted / (2.0 * aux.damping),
            }
        })
        .collect()
    }

    /// Whether the steps of a run resolve the inflow. Without this check, two runs that both miss a
    /// pulse would agree. Collective over the space group.
    fn resolves_inflow(&self, run: &RealRun, largest: f64) -> bool {
        let found = run.values.iter().fold(0.0, |m: f64, b| m.max(b.abs()));
        self.communicator.space.max(found) >= 0.9 * largest
    }
}

/// Refuses a tolerance below the round-off of so many stages.
///
/// # Errors
/// [`Error::Tolerance`].
fn refuse_small_tolerance(case: &Case) -> Result<()> {
    if case.tolerance >= SMALLEST {
        return Ok(());
    }
    Err(Error::Tolerance {
        place: case.places.tolerance.clone(),
        tolerance: case.tolerance,
        smallest: SMALLEST,
        ratio: 1.0,
        growth: 0.0,
    })
}

/// The error of an inflow that varies too fast: `steps` steps leave `error`, above `goal`.
fn varies_too_fast(search: &StepSearch<'_>, steps: usize, error: f64, goal: f64) -> Error {
    let place = search.case.fields[0].entering().place();
    let remedies = if search.jumps {
        "it jumps: end the run at the jump and continue it (run --continue), make the jump smooth, \
         or take a larger solver.tolerance"
    } else {
        "a smoother function of t, a smaller time.end or a larger solver.tolerance"
    };
    Error::Input(format!(
        "{place}: what enters changes too fast for {steps} steps of time: the field is known to \
         {error:.1e}, {goal:.1e} wanted; {remedies}"
    ))
}

/// Finds the number of steps that `case.tolerance` needs, and the couplings of their stages.
/// Collective.
///
/// # Errors
/// [`Error::Formula`] if the inflow is not finite, [`Error::Tolerance`] for a tolerance below the
/// round-off of so many stages, [`Error::Input`] if the inflow varies too fast.
pub fn schedule(
    case: &Case,
    matrix: &BlockMatrix,
    exchange: &mut GhostExchange,
    communicator: &Communicator,
    start: &WeightedField<'_>,
) -> Result<Schedule> {
    let largest = communicator.world.agree(largest_inflow(case, matrix))?;
    let largest = communicator.space.max(largest);
    let jumps = communicator.space.any(jumps(case, matrix));
    refuse_small_tolerance(case)?;
    let roots = (matrix.inflow.iter()).map(|aux| start.weights[aux.row as usize].sqrt()).collect();
    let search = StepSearch { case, matrix, communicator, start, roots, jumps };
    let goal = TIME_SHARE * case.tolerance;
    // The run of half as many steps, and the distance of the last two runs.
    let (mut coarse, mut last) = (search.run(exchange, FEWEST_STEPS)?, f64::NAN);
    let mut steps = FEWEST_STEPS;
    let (run, mut schedule) = loop {
        let fine = search.run(exchange, 2 * steps)?;
        let norm = search.norm(|i| fine.state[i]);
        let distance = match search.norm(|i| fine.state[i] - coarse.state[i]) {
            0.0 => 0.0,
            distance => distance / norm,
        };
        let order_is_seen = !last.is_nan() || distance == 0.0;
        let ratio =
            if last.is_nan() || distance == 0.0 { 4.0 } else { (last / distance).clamp(1.5, 16.0) };
        last = distance;
        let error = distance / (ratio - 1.0);
        // The schedule of so many steps, which leave this error, before its couplings are known.
        let accepted = |steps: usize, left: f64| Schedule {
            steps,
            error: left,
            norm,
            reference: fine.state[..matrix.block.cells()].to_vec(),
            reference_error: error,
            order_is_seen,
            jumps,
            ..Schedule::default()
        };
        if error * ratio <= goal && search.resolves_inflow(&coarse, largest) {
            break (coarse, accepted(steps, error * ratio));
        }
        if error <= goal && search.resolves_inflow(&fine, largest) {
            let schedule = accepted(2 * steps, error);
            break (fine, schedule);
        }
        if 2 * steps >= MOST_STEPS || error.is_nan() {
            return Err(varies_too_fast(&search, 2 * steps, error, goal));
        }
        (coarse, steps) = (fine, 2 * steps);
    };
    schedule.couple(&search, run.values, largest);
    Ok(schedule)
}

impl Schedule {
    /// Couplings and auxiliary unknowns from the values `b̄_i`, stage by stage, where `largest` is
    /// the largest inflow. Collective over the space group.
    fn couple(&mut self, search: &StepSearch<'_>, values: Vec<f64>, largest: f64) {
        let (inflow, roots) = (&search.matrix.inflow, &search.roots);
        let (space, warp) = (&search.communicator.space, &search.case.warp);
        let rows = inflow.len();
        let allowed = INFLOW_GROWTH / search.case.duration();
        let given = warp.delta.given(largest);
        let mut most = vec![0.0f64; rows];
        for stage in values.chunks(rows.max(1)) {
            for (most, b) in most.iter_mut().zip(stage) {
                *most = most.max(b.abs());
            }
        }
        let scalar = warp.inflow == Embedding::Scalar;
        let deltas: Vec<f64> = if scalar {
            let terms = search.halved_strengths(&most, self.steps).into_iter().map(|term| [term]);
            let [sum] = space.sum_lanes(space.sum_count(rows), terms);
            let delta = given.unwrap_or((sum / allowed).sqrt());
            self.common_growth = if delta > 0.0 { sum / (delta * delta) } else { 0.0 };
            self.unknowns = vec![delta];
            vec![delta; rows]
        } else {
            let own = |(aux, most): (&AuxiliaryRow, &f64)| match given {
                Some(delta) => delta,
                None if *most == 0.0 => 0.0,
                None => most / aux.planned_coupling(allowed, search.matrix.by_elements),
            };
            let deltas: Vec<f64> = inflow.iter().zip(&most).map(own).collect();
            self.unknowns = deltas.iter().zip(roots).map(|(d, root)| d * root).collect();
            deltas
        };
        let coupling = |m: usize, b: f64| match (deltas[m] > 0.0, scalar) {
            (false, _) => 0.0,
            (true, true) => b * (roots[m] / deltas[m]),
            (true, false) => b / deltas[m],
        };
        self.couplings = values;
        for stage in self.couplings.chunks_mut(rows.max(1)) {
            (stage.iter_mut().enumerate()).for_each(|(m, k)| *k = coupling(m, *k));
        }
        self.envelope = (most.iter().enumerate()).map(|(m, &b)| coupling(m, b)).collect();
    }
}
