//! Inflow that depends on time: `f' = A f + b(t)`.
//!
//! A step of length `h` from `t` is two exponentials of length `h/2`, each with a constant inflow: the commutator-free
//! scheme of order 4 (Blanes and Moan 2006; Alvermann and Fehske 2011, CF4:2) with the Gauss nodes `t + (½ ∓ √3/6) h`,
//! where `b` is `b_1` and `b_2`:
//!
//! ```text
//! first  half: b̄ = (½ + √3/3) b_1 + (½ − √3/3) b_2
//! second half: b̄ = (½ − √3/3) b_1 + (½ + √3/3) b_2
//! ```
//!
//! (`A` itself is constant, and the two weights add up to 1.) Schrödingerization of a stage, whose generator is constant,
//! is exact: what is recovered from the modes is the product of the stages' real exponentials. So the error of the time
//! steps is that of the same scheme applied to `f' = A f + b(t)` directly, and one real vector tells how many steps a
//! tolerance takes: they are doubled, and from the ratio `q` by which the distance `d` of two runs fell (16 at order 4, less
//! where the steps are too long or `b` is rough; 16 at most is believed, and 4 until there is a ratio) the error of the
//! finer of them is `d/(q − 1)`, that of the coarser `d q/(q − 1)`.
//!
//! The couplings of a stage are `κ_i = b̄_i/δ_i`, `r_i(0) = δ_i`, with the `δ_i` that make the largest of them over the stages
//! what [`crate::matrix::embedding`] allows.

use crate::base::error::{Error, LESS_MEMORY, Result};
use crate::base::machine::available_memory;
use crate::base::text::bytes_text;
use crate::matrix::block_matrix::BlockMatrix;
use crate::matrix::bounds::INFLOW_GROWTH;
use crate::parallel::communicator::{Communicator, GhostExchange};
use crate::problem::case::{Case, Delta, Embedding};
use crate::problem::grid::describe_point;
use crate::propagate::classical::Classical;

/// The part of the tolerance that the time steps may take.
pub const TIME_SHARE: f64 = 0.2;
/// Steps of the first run, and most steps.
const STEPS: (usize, usize) = (8, 1 << 13);
/// Smallest tolerance: the round-off of some thousand stages stays well below its share.
const SMALLEST: f64 = 2e-12;
/// Times at which the inflow is looked at before it is stepped.
const SAMPLES: usize = 256;
/// Poisson probabilities left out of a stage of the real exponential.
const NEGLIGIBLE: f64 = 1e-16;

/// Gauss nodes of a step of unit length.
pub fn nodes() -> [f64; 2] {
    let half = 3f64.sqrt() / 6.0;
    [0.5 - half, 0.5 + half]
}

/// Weights of `b_1` and `b_2` in the two halves of a step.
pub fn halves() -> [[f64; 2]; 2] {
    let third = 3f64.sqrt() / 3.0;
    [[0.5 + third, 0.5 - third], [0.5 - third, 0.5 + third]]
}

/// The inflow in stages: what is constant on each half of each step.
#[derive(Clone, Debug, Default)]
pub struct Schedule {
    /// Steps; there are two stages a step.
    pub steps: usize,
    /// `κ_i` by stage, then row by row of [`BlockMatrix::inflow`], in weighted unknowns.
    pub couplings: Vec<f64>,
    /// Largest `|κ_i|` over the stages.
    pub envelope: Vec<f64>,
    /// The auxiliary unknowns, in weighted unknowns.
    pub unknowns: Vec<f64>,
    /// Relative l2 error of the field from the steps.
    pub error: f64,
    /// `‖f(T)‖`.
    pub norm: f64,
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
    let h = case.end / steps as f64;
    let mut values = Vec::with_capacity(2 * steps * matrix.inflow.len());
    for step in 0..steps {
        let at = |c: f64| -> Vec<f64> {
            (matrix.entering.values(field, (step as f64 + c) * h)).collect()
        };
        let [first, second] = nodes().map(at);
        for [u, w] in halves() {
            values.extend(first.iter().zip(&second).map(|(a, b)| u * a + w * b));
        }
    }
    values
}

/// Looks at the inflow all through the run; the largest `|b_i|`, on this rank.
///
/// # Errors
/// [`Error::Formula`] where it is not finite. Not collective.
pub fn sampled(case: &Case, matrix: &BlockMatrix) -> Result<f64> {
    let field = &case.fields[0];
    let mut largest: f64 = 0.0;
    for k in 0..=SAMPLES {
        let time = case.end * k as f64 / SAMPLES as f64;
        for (m, value) in matrix.entering.values(field, time).enumerate() {
            if !value.is_finite() {
                let (value, point) = matrix.entering.worst(field, m, time);
                let place = describe_point(case.space.dimension(), &point);
                return Err(field
                    .entering()
                    .undefined(value, format!("{place}, t = {time}")));
            }
            largest = largest.max(value.abs());
        }
    }
    Ok(largest)
}

/// `‖f‖`, the weights undone, of what `f` gives row by row of the block's cells. Collective over the space group.
fn norm(
    communicator: &Communicator,
    case: &Case,
    matrix: &BlockMatrix,
    f: impl Fn(usize) -> f64,
) -> f64 {
    let nv = matrix.block.velocity_cells;
    let square = |c: usize| [(c * nv..(c + 1) * nv).map(|i| f(i) * f(i)).sum::<f64>()];
    let points = 0..matrix.block.cells() / nv;
    let [sum] = (communicator.space).sum_lanes(case.space.space_cells(), points.map(square));
    sum.sqrt()
}

/// Refuses so many steps that their couplings, in this run and the one before, do not fit into the memory. Not collective.
///
/// # Errors
/// [`Error::Memory`].
fn fits(matrix: &BlockMatrix, steps: usize) -> Result<()> {
    let needed = 3 * 8 * steps as u64 * matrix.inflow.len() as u64;
    let available = available_memory();
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

/// Finds the number of steps that `case.tolerance` takes, and the couplings of their stages; `start` is the weighted field
/// at time zero. Collective.
///
/// # Errors
/// [`Error::Formula`] where the inflow is not finite, [`Error::Tolerance`] for one below what so many roundings allow,
/// [`Error::Input`] where it varies too fast.
pub fn schedule(
    case: &Case,
    matrix: &BlockMatrix,
    exchange: &mut GhostExchange,
    communicator: &Communicator,
    (pi, start, rate): (&[f64], &[f64], f64),
) -> Result<Schedule> {
    let space = &communicator.space;
    let largest = communicator.world.agree(sampled(case, matrix))?;
    let largest = space.max(largest);
    let root: Vec<f64> = matrix
        .inflow
        .iter()
        .map(|aux| pi[aux.row as usize].sqrt())
        .collect();
    if case.tolerance < SMALLEST {
        return Err(Error::Tolerance {
            place: case.tolerance_place.clone(),
            tolerance: case.tolerance,
            smallest: SMALLEST,
            ratio: 1.0,
            growth: 0.0,
        });
    }
    let goal = TIME_SHARE * case.tolerance;
    // The run with half as many steps: its field, its inflow; and the last distance.
    let mut before: Option<(Vec<f64>, Vec<f64>)> = None;
    let mut last = f64::NAN;
    let mut steps = STEPS.0;
    let (values, error, end) = loop {
        communicator.world.agree(fits(matrix, steps))?;
        let values = stage_values(case, matrix, steps);
        let largest_of =
            |values: &[f64]| space.max(values.iter().fold(0.0, |m: f64, b| m.max(b.abs())));
        let mut state = start.to_vec();
        let stage_time = case.end / (2 * steps) as f64;
        let mut classical = Classical::new(matrix);
        for stage in values.chunks(matrix.inflow.len().max(1)) {
            classical.hold(stage.iter().zip(&root).map(|(b, root)| b * root));
            classical.exponential(exchange, &mut state, (rate, stage_time), NEGLIGIBLE);
        }
        if matrix.inflow.is_empty() {
            // Ranks that nothing enters take part in the others' exchanges.
            for _ in 0..2 * steps {
                classical.exponential(exchange, &mut state, (rate, stage_time), NEGLIGIBLE);
            }
        }
        let end = norm(communicator, case, matrix, |i| state[i] / pi[i].sqrt());
        if let Some((coarse, coarse_values)) = before.take() {
            let distance = norm(communicator, case, matrix, |i| {
                (state[i] - coarse[i]) / pi[i].sqrt()
            });
            let distance = if distance == 0.0 { 0.0 } else { distance / end };
            let fell = if last.is_nan() || distance == 0.0 {
                4.0
            } else {
                (last / distance).clamp(1.5, 16.0)
            };
            last = distance;
            let error = distance / (fell - 1.0);
            // Steps so long that they miss a pulse agree too.
            let seen = |values: &[f64]| largest_of(values) >= 0.9 * largest;
            if error * fell <= goal && seen(&coarse_values) {
                steps /= 2;
                break (coarse_values, error * fell, end);
            }
            if error <= goal && seen(&values) {
                break (values, error, end);
            }
            if steps >= STEPS.1 || error.is_nan() {
                return Err(Error::Input(format!(
                    "{}: what enters changes too fast for {steps} steps of time: the field is known to {error:.1e}, \
                     {goal:.1e} wanted; a smoother function of t, a smaller time.end or a larger solver.tolerance",
                    case.fields[0].entering().place()
                )));
            }
        }
        before = Some((state, values));
        steps *= 2;
    };
    let mut schedule = Schedule {
        steps,
        error,
        norm: end,
        ..Schedule::default()
    };
    couple(
        case,
        matrix,
        communicator,
        (values, &root, largest),
        &mut schedule,
    );
    Ok(schedule)
}

/// From `b̄_i` to couplings and auxiliary unknowns. Collective over the space group.
fn couple(
    case: &Case,
    matrix: &BlockMatrix,
    communicator: &Communicator,
    (values, root, largest): (Vec<f64>, &[f64], f64),
    schedule: &mut Schedule,
) {
    let rows = matrix.inflow.len();
    let space = &communicator.space;
    let allowed = INFLOW_GROWTH / case.end;
    let given = match case.warp.delta {
        Delta::Planned => None,
        Delta::Largest => Some(largest),
        Delta::Given(delta) => Some(delta),
    };
    let mut most = vec![0.0f64; rows];
    for stage in values.chunks(rows.max(1)) {
        for (most, b) in most.iter_mut().zip(stage) {
            *most = most.max(b.abs());
        }
    }
    schedule.couplings = values;
    if case.warp.inflow == Embedding::Scalar {
        let count = space.sum_count(rows);
        let share = |((aux, root), b): ((&crate::matrix::embedding::Inflow, &f64), &f64)| {
            let weighted = root * b;
            [if *b == 0.0 {
                0.0
            } else {
                weighted * weighted / (2.0 * aux.draw)
            }]
        };
        let [sum] = space.sum_lanes(count, matrix.inflow.iter().zip(root).zip(&most).map(share));
        let delta = given.unwrap_or((sum / allowed).sqrt());
        let scale = |root: &f64| if delta > 0.0 { root / delta } else { 0.0 };
        for stage in schedule.couplings.chunks_mut(rows.max(1)) {
            stage
                .iter_mut()
                .zip(root)
                .for_each(|(k, root)| *k *= scale(root));
        }
        schedule.envelope = most
            .iter()
            .zip(root)
            .map(|(b, root)| b * scale(root))
            .collect();
        schedule.unknowns = vec![delta];
        return;
    }
    let delta: Vec<f64> = (matrix.inflow.iter().zip(&most))
        .map(|(aux, most)| match given {
            Some(delta) => delta,
            None if *most == 0.0 => 0.0,
            None => most / (2.0 * aux.draw * allowed).sqrt(),
        })
        .collect();
    let ratio = |b: f64, delta: f64| if delta > 0.0 { b / delta } else { 0.0 };
    for stage in schedule.couplings.chunks_mut(rows.max(1)) {
        stage
            .iter_mut()
            .zip(&delta)
            .for_each(|(k, delta)| *k = ratio(*k, *delta));
    }
    schedule.envelope = most
        .iter()
        .zip(&delta)
        .map(|(b, delta)| ratio(*b, *delta))
        .collect();
    schedule.unknowns = delta
        .iter()
        .zip(root)
        .map(|(delta, root)| delta * root)
        .collect();
}
