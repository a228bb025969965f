//! Chebyshev series of the evolution.
//!
//! With the spectrum of `H` in `[c − h, c + h]`, `H̃ = (H − c)/h`, `τ = hT` and
//! `φ_k = (−i)^k T_k(H̃) x`,
//!
//! ```text
//! exp(−iHT) x = e^{−icT} ( J_0(τ) φ_0 + 2 Σ_k J_k(τ) φ_k )
//! φ_{k+1}     = (2/h)(−iμS + K + ic) φ_k + φ_{k−1}
//! ```
//!
//! (Tal-Ezer and Kosloff 1984). Since `‖φ_k‖ ≤ ‖x‖`, cutting the series at `K` costs at most
//! `2 Σ_{k>K} |J_k(τ)|`.
//!
//! It is summed backwards (Clenshaw 1955), with `G = (1/h)(−iμS + K + ic)`, `a_0 = J_0` and
//! `a_k = 2J_k`:
//!
//! ```text
//! b_k = a_k x + 2G b_{k+1} + b_{k+2},   k = K … 1,     b_{K+1} = b_{K+2} = 0
//! Σ a_k φ_k = a_0 x + G b_1 + b_2
//! ```
//!
//! This takes as many applications as forwards, but only two vectors a mode and none for the sum:
//! the start `x` is mostly real and common to the modes of a batch. For moments at intermediate
//! times the series is summed forwards (see [`crate::propagate::intermediate_moments`]). Each lane
//! has its own degree, with zero coefficients above it, so its bits do not depend on other lanes.
//!
//! The interval is guaranteed, not estimated: see [`crate::matrix::bounds`].

use crate::base::bisect::bisect_whole;
use crate::base::error::{Error, Result};
use crate::base::memory::NamedBytes;
use crate::matrix::block_matrix::BlockMatrix;
use crate::matrix::blocking::fastest::FastestBlocking;
use crate::matrix::blocking::{MOST_LEVELS, RecurrenceSteps};
use crate::matrix::lanes::{LANES, Lanes, StartRow, StepConstants};
use crate::propagate::bessel::bessel_series;
use crate::propagate::evolution::{
    BatchSpec, Evolution, InitialState, MatrixShare, SeriesSize, StateRows,
};
use crate::propagate::intermediate_moments::IntermediateMoments;
use crate::propagate::method::{
    BatchCoupling, BatchReport, Descriptor, ModeDemand, Propagator, PropagatorSetting, RunWork,
};
use num_complex::Complex64;
use std::time::Instant;

/// The largest `τ` for which the series itself is computed; beyond it, it is bounded.
pub const LONGEST_SUMMED: f64 = 1e4;

/// The least degree `K` with `2 Σ_{k>K} |J_k(τ)| ≤ tail`; for long series at most some units more,
/// from `J_k(k sech α) ≤ exp(−k(α − tanh α))/√(2πk tanh α)` (DLMF 10.14.5) and a geometric series.
pub fn degree(scratch: &mut Vec<f64>, tau: f64, tail: f64) -> usize {
    if tau <= LONGEST_SUMMED {
        bessel_series(scratch, tau, tail);
        return scratch.len() - 1;
    }
    least_degree(tau, tail, long_guess(tau, tail))
}

/// A bound on `2 Σ_{k>K} |J_k(τ)|` for `K = degree ≥ τ`: see [`degree`].
fn long_rest(tau: f64, degree: f64) -> f64 {
    let k = degree + 1.0;
    let alpha = (k / tau).acosh();
    let slope = alpha.tanh();
    let first = (-k * (alpha - slope)).exp() / (std::f64::consts::TAU * k * slope).sqrt();
    2.0 * first / (1.0 - (-alpha).exp())
}

/// About the degree at which [`long_rest`] is `tail`, mostly less than one away: with
/// `k = τ cosh α`, the exponent is `τ(α cosh α − sinh α) ≈ τα³/3 (1 + α²/10)`, and the factor
/// before it about `2/√(2πτα³)`.
fn long_guess(tau: f64, tail: f64) -> f64 {
    let mut alpha = (3.0 * (-tail.ln()).max(1.0) / tau).cbrt();
    for _ in 0..2 {
        let square = alpha * alpha;
        let factor = std::f64::consts::TAU * tau * square * alpha;
        let exponent = (-tail.ln() - 0.5 * (0.25 * factor).ln() + 0.5 * alpha).max(0.1);
        alpha = (3.0 * exponent / (tau * (1.0 + 0.1 * square))).cbrt();
    }
    // cosh α − 1.
    let square = alpha * alpha;
    tau + 0.5 * tau * square * (1.0 + square / 12.0) - 1.0
}

/// The least whole number above `⌈τ⌉` at which [`long_rest`] is at most `tail`, whatever `guess`
/// is.
fn least_degree(tau: f64, tail: f64, guess: f64) -> usize {
    let (mut low, mut high) = (tau.ceil(), 2.0 * tau + 100.0);
    let mut probe = guess.ceil();
    // Where the first guess was wrong by little, its neighbours end the search.
    let mut step = 1.0;
    while low < probe && probe < high {
        let above = long_rest(tau, probe) > tail;
        *(if above { &mut low } else { &mut high }) = probe;
        if high - low <= 1.0 {
            return high as usize;
        }
        probe += if above { step } else { -step };
        step *= 2.0;
    }
    let [_, least] = bisect_whole(low as usize, high as usize, |k| long_rest(tau, k as f64) > tail);
    least
}

/// The coefficient of term `k` in each lane.
fn coefficient(coefficients: &[f64], k: usize) -> [f64; LANES] {
    coefficients.as_chunks().0[k]
}

/// The step that leads from term `k` to the next one, and adds `coefficient` times the start.
fn level(constants: &StepConstants, k: usize, coefficient: [f64; LANES]) -> StepConstants {
    let mut constants = StepConstants { coefficient, ..constants.clone() };
    if k > 0 {
        constants.scale.iter_mut().for_each(|a| *a *= 2.0);
    }
    constants
}

/// Scratch of the Chebyshev propagator for one rank; made once, used for every batch.
pub struct Chebyshev {
    /// `b_k`; at the end `w(T)` of the batch, without the lanes' phases.
    pub(crate) current: Vec<Lanes>,
    /// `b_{k+1}`.
    previous: Vec<Lanes>,
    /// `a_k` by lane, `LANES` to a degree.
    coefficients: Vec<f64>,
    /// `J_0 − 1` by lane.
    first_less_one: [f64; LANES],
    series: Vec<f64>,
    blocking: FastestBlocking,
    /// The coefficients of the steps of one pass through memory.
    levels: Vec<StepConstants>,
}

impl Chebyshev {
    /// Scratch for vectors of `matrix` and series of this `size`, with the fastest of the blockings
    /// that are planned for its applications.
    pub fn new(matrix: &BlockMatrix, size: SeriesSize) -> Self {
        let SeriesSize { largest_degree, applications } = size;
        Self::blocked(matrix, largest_degree, FastestBlocking::planned(matrix, applications))
    }

    /// Scratch as [`new`](Self::new) makes it, with the given blocking of steps.
    pub fn blocked(matrix: &BlockMatrix, largest_degree: usize, blocking: FastestBlocking) -> Self {
        let vector = || vec![Lanes::ZERO; matrix.length()];
        Self {
            current: vector(),
            previous: vector(),
            coefficients: vec![0.0; (largest_degree + 1) * LANES],
            first_less_one: [0.0; LANES],
            series: Vec::with_capacity(2 * largest_degree + 200),
            levels: Vec::with_capacity(MOST_LEVELS),
            blocking,
        }
    }

    /// Largest degree there is room for.
    pub fn largest_degree(&self) -> usize {
        self.coefficients.len() / LANES - 1
    }

    /// The coefficients of `exp(−iHt)`, `t = time`, up to the degree of each lane, and what the
    /// steps need.
    pub(crate) fn prepare(
        &mut self,
        system: &Evolution<'_>,
        batch: &BatchSpec,
        time: f64,
    ) -> (StepConstants, BatchReport) {
        let degree = batch.largest_work();
        let mut report = BatchReport::unitary([Complex64::ZERO; LANES]);
        report.applications = batch.work[..batch.modes].iter().sum();
        let mut constants = StepConstants {
            scale: [0.0; LANES],
            shift: [0.0; LANES],
            wavenumber: batch.wavenumbers,
            coefficient: [0.0; LANES],
        };
        for l in 0..LANES {
            let interval = system.bounds.interval(batch.wavenumbers[l]);
            // Without motion the spectrum is one point, and the series has one term.
            let still = interval.half_width == 0.0;
            constants.scale[l] = if still { 0.0 } else { 1.0 / interval.half_width };
            constants.shift[l] = interval.centre;
            report.phases[l] = Complex64::new(0.0, -interval.centre * time).exp();
            let rest = bessel_series(&mut self.series, interval.half_width * time, 0.0);
            // From J_0 + 2 Σ J_{2k} = 1, without the cancellation of J_0 − 1.
            self.first_less_one[l] = -2.0 * self.series.iter().skip(2).step_by(2).sum::<f64>();
            // A lane ends at its own degree: its bits do not depend on other lanes of the batch.
            let cut = self.series.len().min(batch.work[l] + 1);
            report.tails[l] = rest + 2.0 * self.series[cut..].iter().map(|j| j.abs()).sum::<f64>();
            self.series.truncate(cut);
            for k in 0..=degree {
                let j = self.series.get(k).copied().unwrap_or(0.0);
                self.coefficients[k * LANES + l] = if k == 0 { j } else { 2.0 * j };
            }
        }
        (constants, report)
    }

    /// After [`prepare`](Self::prepare): replaces the coefficients of the exponential by those of
    /// `exp(−i(H−c)t) − 1`, which are small for small `t`.
    pub(crate) fn leave_out_identity(&mut self) {
        self.coefficients[..LANES].copy_from_slice(&self.first_less_one);
    }

    /// The first vectors of a recurrence: zero, and the given `coefficient` times `start`.
    fn begin<R: StartRow>(&mut self, rows: usize, coefficient: &[f64; LANES], start: &[R]) {
        self.previous.fill(Lanes::ZERO);
        self.current.fill(Lanes::ZERO);
        for (i, current) in self.current[..rows].iter_mut().enumerate() {
            // `current` is zero here, so the sum has the same bits on any processor.
            R::add_unfused(start, i, coefficient, current);
        }
    }

    /// The series of degree `degree` from [`prepare`](Self::prepare) of `start`, into `current`;
    /// with the `couplings` of a stage, if the inflow varies. Collective over the space group.
    ///
    /// # Errors
    /// [`Error::Interrupted`].
    pub(crate) fn series<R: StartRow>(
        &mut self,
        system: &mut Evolution<'_>,
        constants: &StepConstants,
        degree: usize,
        couplings: Option<&[f64]>,
        start: &[R],
    ) -> Result<()> {
        let (matrix, exchange) = (system.matrix, &mut *system.exchange);
        let first = coefficient(&self.coefficients, degree);
        self.begin(matrix.rows(), &first, start);
        let mut left = degree;
        while left > 0 {
            self.levels.clear();
            let levels =
                system.interruption.applications_until_check(left.min(self.blocking.depth()));
            let level = |k| level(constants, k, coefficient(&self.coefficients, k));
            self.levels.extend((left - levels..left).rev().map(level));
            let steps = RecurrenceSteps { levels: &self.levels, couplings };
            let (y, x) = (&mut self.previous, &mut self.current);
            let began = Instant::now();
            matrix.steps(exchange, self.blocking.current(), &steps, y, x, start);
            self.blocking.passed(levels, began.elapsed().as_secs_f64());
            left -= levels;
            if system.interruption.after(levels) {
                return Err(Error::Interrupted);
            }
        }
        Ok(())
    }

    /// The series of degree `degree` from [`prepare`](Self::prepare) of `start`, into `current`,
    /// summed forwards, with its terms read into `passed`. Collective over the space group.
    ///
    /// # Errors
    /// [`Error::Interrupted`].
    fn forwards<R: StartRow>(
        &mut self,
        system: &mut Evolution<'_>,
        constants: &StepConstants,
        degree: usize,
        start: &[R],
        passed: &mut IntermediateMoments<'_>,
    ) -> Result<()> {
        let (matrix, exchange) = (system.matrix, &mut *system.exchange);
        let rows = matrix.rows();
        self.begin(rows, &[1.0; LANES], start);
        let IntermediateMoments { terms, blocking } = passed;
        terms.announce(0..1);
        terms.read(0, 0..rows, &self.current, &self.coefficients);
        let mut done = 0;
        while done < degree {
            let most = blocking.depth().min(degree - done);
            let to = done + system.interruption.applications_until_check(most);
            self.levels.clear();
            self.levels.extend((done..to).map(|k| level(constants, k, [0.0; LANES])));
            terms.announce(done + 1..to + 1);
            let steps = RecurrenceSteps { levels: &self.levels, couplings: None };
            let vectors = [&mut self.previous, &mut self.current];
            let at_end = &self.coefficients[..];
            let mut read = |level, rows, term: &[Lanes]| terms.read(level, rows, term, at_end);
            let began = Instant::now();
            matrix.steps_and_read::<()>(
                exchange,
                blocking.current(),
                &steps,
                vectors,
                &[],
                &mut read,
            );
            blocking.passed(to - done, began.elapsed().as_secs_f64());
            if system.interruption.after(to - done) {
                return Err(Error::Interrupted);
            }
            done = to;
        }
        std::mem::swap(&mut self.current, &mut terms.sum);
        Ok(())
    }
}

impl Propagator for Chebyshev {
    fn propagate(
        &mut self,
        system: &mut Evolution<'_>,
        batch: &BatchSpec,
        initial: &InitialState<'_>,
    ) -> Result<BatchReport> {
        let (constants, report) = self.prepare(system, batch, system.time);
        let degree = batch.largest_work();
        match initial.state {
            StateRows::Real(start) => self.series(system, &constants, degree, None, start)?,
            StateRows::Lanes(start) => self.series(system, &constants, degree, None, start)?,
        }
        Ok(report)
    }

    fn propagate_past(
        &mut self,
        system: &mut Evolution<'_>,
        batch: &BatchSpec,
        initial: &InitialState<'_>,
        passed: &mut IntermediateMoments<'_>,
    ) -> Result<BatchReport> {
        let (constants, report) = self.prepare(system, batch, system.time);
        passed.terms.prepare(system, batch);
        let degree = batch.largest_work();
        match initial.state {
            StateRows::Real(start) => self.forwards(system, &constants, degree, start, passed)?,
            StateRows::Lanes(start) => self.forwards(system, &constants, degree, start, passed)?,
        }
        Ok(report)
    }

    fn state(&self) -> &[Lanes] {
        &self.current
    }
}

/// The descriptor of the Chebyshev series of the exponential.
pub struct ChebyshevMethod;

impl Descriptor for ChebyshevMethod {
    fn batch_coupling(&self) -> BatchCoupling {
        BatchCoupling::Independent
    }

    fn work(&self, demand: &ModeDemand, scratch: &mut Vec<f64>) -> usize {
        degree(scratch, demand.half_width * demand.time, demand.tolerance)
    }

    fn applications_per_work(&self) -> usize {
        1
    }

    fn passes_times(&self) -> bool {
        true
    }

    fn arrays(&self, share: &MatrixShare<'_>) -> Vec<NamedBytes> {
        // For an inflow that varies, the start of a stage and its rounding errors are stored beside
        // the recurrence.
        let vectors = 2 + 2 * u64::from(share.case.varies());
        let batch = vectors * size_of::<Lanes>() as u64 * share.length;
        let velocities = share.case.space.velocity_cells() as u64;
        vec![
            NamedBytes::new(format!("batch of {LANES} modes"), batch),
            NamedBytes::new(
                "orders of blocked steps",
                FastestBlocking::most_bytes(share.rows, velocities),
            ),
        ]
    }

    fn summary(&self, work: &RunWork) -> String {
        format!("chebyshev: degree {} to {}", work.least, work.most)
    }

    fn propagator(
        &self,
        setting: &PropagatorSetting,
        matrix: &BlockMatrix,
    ) -> Result<Box<dyn Propagator>> {
        let (largest_degree, applications) = (setting.largest_work, setting.applications);
        Ok(Box::new(Chebyshev::new(matrix, SeriesSize { largest_degree, applications })))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bessel_functions() {
        let mut j = Vec::new();
        for tau in [1e-3, 0.5, 1.0, 10.0, 63.2, 500.0, 4000.0] {
            let left = bessel_series(&mut j, tau, 0.0);
            assert_eq!(left, 0.0);
            for k in [0usize, 1, 2, 7] {
                if k < j.len() {
                    let exact = libm::jn(k as i32, tau);
                    assert!((j[k] - exact).abs() < 1e-12, "J_{k}({tau}) = {} {exact}", j[k]);
                }
            }
            // Parseval: J_0² + 2 Σ J_k² = 1.
            let square = j[0] * j[0] + 2.0 * j[1..].iter().map(|x| x * x).sum::<f64>();
            assert!((square - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn degrees_of_long_series_are_bounds_and_close() {
        let (mut scratch, mut all) = (Vec::new(), Vec::new());
        for tau in [1.1e4, 3e4] {
            bessel_series(&mut all, tau, 0.0);
            for tail in [0.1, 1e-6, 1e-14] {
                let degree = degree(&mut scratch, tau, tail);
                let rest: f64 = all[degree + 1..].iter().map(|j| 2.0 * j.abs()).sum();
                let exact = bessel_series(&mut scratch, tau, tail);
                assert!(rest <= tail && exact <= tail);
                assert!(
                    degree as f64 <= 1.01 * scratch.len() as f64,
                    "{tau} {tail}: {degree} {}",
                    scratch.len()
                );
            }
        }
    }

    /// One degree less has a larger bound than the tail, whatever the first guess was.
    #[test]
    fn degrees_of_long_series_are_the_least_of_their_bound() {
        let mut scratch = Vec::new();
        for tau in [1.0001e4, 2.7e4, 1.3e5, 9.9e5, 1.6e6] {
            let mut last = usize::MAX;
            for tail in [1e-300, 1e-60, 1e-14, 1e-9, 3e-6, 1e-3, 0.1, 0.9, 2.0, 1e3] {
                let found = degree(&mut scratch, tau, tail);
                // The bound itself, from the end of a bracket of whole numbers.
                let k = found as f64;
                let bound = |k: f64| {
                    let alpha = (k / tau).acosh();
                    let root = (std::f64::consts::TAU * k * alpha.tanh()).sqrt();
                    2.0 * (-k * (alpha - alpha.tanh())).exp() / root / (1.0 - (-alpha).exp())
                };
                assert!(k > tau && found <= last, "{tau} {tail}: {found} after {last}");
                assert!(bound(k + 1.0) <= tail, "{tau} {tail}: {found}");
                let least = k == tau.ceil() + 1.0 || bound(k) > tail;
                assert!(least, "{tau} {tail}: {found} is not the least");
                last = found;
            }
        }
    }

    #[test]
    fn the_cut_keeps_its_promise() {
        let (mut all, mut cut) = (Vec::new(), Vec::new());
        for tau in [0.3, 20.0, 300.0] {
            bessel_series(&mut all, tau, 0.0);
            let left = bessel_series(&mut cut, tau, 1e-6);
            let rest: f64 = all[cut.len()..].iter().map(|j| 2.0 * j.abs()).sum();
            assert!(left <= 1e-6 && (rest - left).abs() < 1e-15);
            // One term fewer does not suffice.
            assert!(left + 2.0 * cut[cut.len() - 1].abs() > 1e-6);
        }
    }
}
