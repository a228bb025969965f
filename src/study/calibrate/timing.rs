//! Seconds of pieces of work, and the line through them.

use crate::base::error::Result;

/// Parts of the time; a power of two.
pub const PARTS: usize = 64;
/// Seconds of a trial that is long enough to measure a rate; shorter trials are repeated with more
/// parts of the time.
pub const LONG_ENOUGH: f64 = 0.25;
/// Most times that a trial is repeated.
const REPEATS: f64 = 9.0;

/// Seconds that work of this cost took, the same on all ranks.
#[derive(Clone, Copy, Debug)]
pub struct Timed {
    /// Seconds.
    pub seconds: f64,
    /// Cost, as the plan counts it.
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

/// The line through the first of [`PARTS`] parts of the time and so many parts more that they take
/// long enough to tell.
///
/// # Errors
/// Those of `trial`.
pub fn line(trial: &mut impl FnMut(usize) -> Result<Timed>) -> Result<LinearCost> {
    // The first of all also finds its way into the memory.
    trial(1)?;
    let (mut part, first) = (1, repeated(&mut || trial(1))?);
    let mut last = first;
    // A slow moment is not long enough by itself: there must be more to do than at first.
    while (last.seconds < LONG_ENOUGH || last.cost < 2.0 * first.cost) && part < PARTS {
        part *= 2;
        last = trial(part)?;
    }
    if part > 1 {
        last = repeated(&mut || trial(part))?;
    }
    let more = last.cost - first.cost;
    let rate = match more > 0.0 {
        true => ((last.seconds - first.seconds) / more).max(0.0),
        // The whole work was measured.
        false => last.seconds / last.cost.max(1.0),
    };
    Ok(LinearCost { rate, fixed: (last.seconds - rate * last.cost).max(0.0) })
}

/// The mean of a trial that is repeated while that takes little: a run, too, has slow moments.
///
/// # Errors
/// Those of `trial`.
pub fn repeated(trial: &mut impl FnMut() -> Result<Timed>) -> Result<Timed> {
    let Timed { seconds: first, cost } = trial()?;
    let times = (2.0 * LONG_ENOUGH / first.max(1e-9)).clamp(1.0, REPEATS).floor();
    let mut sum = first;
    for _ in 1..times as usize {
        sum += trial()?.seconds;
    }
    Ok(Timed { seconds: sum / times, cost })
}
