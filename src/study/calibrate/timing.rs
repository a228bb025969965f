//! Seconds of pieces of work, and the line through them.

use crate::base::error::Result;

/// Number of equal parts that the time is divided into; a power of two.
pub const PARTS: usize = 64;
/// Seconds of a trial that is long enough to measure a rate; shorter trials are repeated with more
/// parts of the time.
pub const LONG_ENOUGH: f64 = 0.25;
/// Largest number of runs of a trial.
const REPEATS: f64 = 9.0;

/// Seconds that work of this cost took, the same on all ranks.
#[derive(Clone, Copy, Debug)]
pub struct TimedWork {
    /// Seconds that the work took.
    pub seconds: f64,
    /// Cost of the work, as the plan counts it.
    pub cost: f64,
}

/// `seconds = fixed + rate · cost`.
#[derive(Clone, Copy, Debug)]
pub struct LinearCost {
    /// Seconds at no cost.
    pub fixed: f64,
    /// Seconds a unit of cost.
    pub rate: f64,
}

/// Predicted seconds to solve.
#[derive(Clone, Copy, Debug)]
pub struct SolveTime {
    /// Seconds in all.
    pub solve: f64,
    /// Seconds of an application.
    pub application: f64,
}

/// The line through the seconds of `trial(1)` and `trial(n)`, where `trial(n)` does `n` of
/// [`PARTS`] parts of the work. `n` is doubled until the trial is [`LONG_ENOUGH`].
///
/// # Errors
/// Those of `trial`.
pub fn line(trial: &mut impl FnMut(usize) -> Result<TimedWork>) -> Result<LinearCost> {
    // The first trial also touches its memory for the first time, and does not count.
    trial(1)?;
    let (mut part, first) = (1, repeated(&mut || trial(1))?);
    let mut last = first;
    // A trial may be long for other reasons than its work: the cost must have doubled, too.
    while (last.seconds < LONG_ENOUGH || last.cost < 2.0 * first.cost) && part < PARTS {
        part *= 2;
        last = trial(part)?;
    }
    if part > 1 {
        last = repeated(&mut || trial(part))?;
    }
    let more = last.cost - first.cost;
    let rate = if more > 0.0 {
        ((last.seconds - first.seconds) / more).max(0.0)
    } else {
        // The whole work was measured.
        last.seconds / last.cost.max(1.0)
    };
    Ok(LinearCost { rate, fixed: (last.seconds - rate * last.cost).max(0.0) })
}

/// The mean of a trial, repeated if it is short. The mean, as a run has slow moments, too.
///
/// # Errors
/// Those of `trial`.
pub fn repeated(trial: &mut impl FnMut() -> Result<TimedWork>) -> Result<TimedWork> {
    let TimedWork { seconds: first, cost } = trial()?;
    let times = (2.0 * LONG_ENOUGH / first.max(1e-9)).clamp(1.0, REPEATS).floor();
    let mut sum = first;
    for _ in 1..times as usize {
        sum += trial()?.seconds;
    }
    Ok(TimedWork { seconds: sum / times, cost })
}
