//! Propagation with an inflow that depends on time: a product of exponentials, each a Chebyshev
//! series (see [`crate::propagate::time_dependent_inflow`]).
//!
//! **Round-off.** Thousands of stages, each rounded to the size of the state, would have a much
//! larger error than one exponential: the coefficients are the same in every stage and the
//! auxiliary unknowns nearly so, so that their rounding errors add up. So a stage computes the
//! increment `(exp(−i(H−c)t) − 1) w`, with `J_0 − 1` in place of `J_0`; it is small for short
//! stages. The sum is compensated (Kahan 1965): the rounding error of each addition is stored and
//! added in the next stage. The rounding error of a run is then that of one exponential of its
//! length, for any number of stages.

use crate::matrix::block_matrix::BlockMatrix;
use crate::matrix::lanes::{LANES, Lanes};
use crate::propagate::bessel::bessel_series;
use crate::propagate::chebyshev::{Chebyshev, degree};
use crate::propagate::evolution::{BatchSpec, Evolution, InitialState, SeriesSize};
use crate::propagate::method::{BatchReport, Propagator, PropagatorSetting};
use crate::propagate::time_dependent_inflow::Schedule;
use num_complex::Complex64;

/// Relative errors below this are round-off, even if the plan's series has a smaller one.
const ROUND_OFF: f64 = 1e-15;

/// One Chebyshev series for each stage; made once, used for every batch.
pub struct CommutatorFree<'a> {
    chebyshev: Chebyshev,
    /// The state at the start of a stage, at the end `w(T)`, without the phases of the lanes.
    start: Vec<Lanes>,
    /// The rounding errors of the additions to it.
    rounded: Vec<Lanes>,
    schedule: &'a Schedule,
    series: Vec<f64>,
}

/// Degree of the series of one of `stages` equal parts of a run, for a mode whose series of the
/// whole run, of argument `tau = hT`, is cut at `whole_degree`. The truncation errors of the parts
/// multiply to that of the whole series.
pub fn stage_degree(scratch: &mut Vec<f64>, tau: f64, whole_degree: usize, stages: usize) -> usize {
    let rest = bessel_series(scratch, tau, 0.0);
    let cut = scratch.len().min(whole_degree + 1);
    let tail = rest + 2.0 * scratch[cut..].iter().map(|j| j.abs()).sum::<f64>();
    // (1 + share)^stages = 1 + tail.
    let share = tail.max(ROUND_OFF).ln_1p() / stages as f64;
    degree(scratch, tau / stages as f64, share).max(1)
}

impl<'a> CommutatorFree<'a> {
    /// Scratch for vectors of `matrix`, batches whose modes take at most the largest work of
    /// `setting`, and the exponentials of `schedule`.
    pub fn new(matrix: &BlockMatrix, setting: &PropagatorSetting, schedule: &'a Schedule) -> Self {
        // A stage's series is shorter than that of the whole run, except for additional terms for
        // its smaller error.
        let largest_degree = setting.largest_work + 60;
        let size = SeriesSize { largest_degree, applications: setting.applications };
        Self {
            chebyshev: Chebyshev::new(matrix, size),
            start: vec![Lanes::ZERO; matrix.rows()],
            rounded: vec![Lanes::ZERO; matrix.rows()],
            schedule,
            series: Vec::with_capacity(2 * largest_degree + 200),
        }
    }

    /// Adds the increment of a stage to the state, with the rounding errors of earlier additions.
    fn add_increment(&mut self) {
        let rows = self.start.iter_mut().zip(&mut self.rounded).zip(self.chebyshev.state());
        for ((state, rounded), increment) in rows {
            let parts = state.0.iter_mut().zip(&mut rounded.0).zip(&increment.0);
            for ((state, rounded), increment) in parts {
                [*state, *rounded] = added([*state, *rounded], *increment);
            }
        }
    }
}

impl Propagator for CommutatorFree<'_> {
    fn propagate(
        &mut self,
        system: &mut Evolution<'_>,
        batch: &BatchSpec,
        initial: &InitialState<'_>,
    ) -> crate::base::error::Result<BatchReport> {
        let stages = self.schedule.stages();
        let time = system.time / stages as f64;
        let most = self.chebyshev.largest_degree();
        let room = self.series.capacity();
        let stage = BatchSpec {
            work: std::array::from_fn(|l| {
                let interval = system.bounds.interval(batch.wavenumbers[l]);
                let tau = interval.half_width * system.time;
                stage_degree(&mut self.series, tau, batch.work[l], stages).min(most)
            }),
            ..batch.clone()
        };
        debug_assert_eq!(self.series.capacity(), room, "a series of the whole run did not fit");
        let longest = stage.largest_work();
        let (constants, mut report) = self.chebyshev.prepare(system, &stage, time);
        self.chebyshev.leave_out_identity();
        self.rounded.fill(Lanes::ZERO);
        for (i, row) in self.start.iter_mut().enumerate() {
            *row = initial.state.row(i);
        }
        for k in 0..stages {
            let (couplings, start) = (Some(self.schedule.stage(k)), &self.start);
            self.chebyshev.series(system, &constants, longest, couplings, start)?;
            self.add_increment();
        }
        report.applications *= stages;
        for l in 0..LANES {
            // (1 + tail)^stages − 1.
            report.tails[l] = (stages as f64 * report.tails[l].ln_1p()).exp_m1();
            // Not a power of the stage's phase, whose rounding error would grow with the number of
            // stages.
            let centre = system.bounds.interval(batch.wavenumbers[l]).centre;
            report.phases[l] = Complex64::new(0.0, -centre * system.time).exp();
        }
        Ok(report)
    }

    fn state(&self) -> &[Lanes] {
        &self.start
    }
}

/// The sum of `state` and `increment`, and the rounding error of this and of earlier additions, by
/// Knuth's exact sum of two numbers of any sizes.
fn added([state, rounded]: [f64; 2], increment: f64) -> [f64; 2] {
    let term = increment + rounded;
    let sum = state + term;
    let added = sum - state;
    [sum, (state - (sum - added)) + (term - added)]
}

#[cfg(test)]
mod tests {
    use super::added;

    /// A million increments, each smaller than a unit in the last place of the sum.
    #[test]
    fn rounding_errors_are_compensated() {
        let (increment, count) = (0.3 * f64::EPSILON, 1_000_000);
        let sums = (0..count).fold([1.0, 0.0], |sums, _| added(sums, increment));
        let expected = 1.0 + increment * f64::from(count);
        assert!((sums[0] - expected).abs() <= f64::EPSILON, "{sums:?}, {expected}");
        assert_eq!((0..count).fold(1.0, |sum, _| sum + increment), 1.0);
    }
}
