//! Lanczos: the exponential in a Krylov space, restarted in time.
//!
//! With `H̃ = H − c`, `c` the centre of the spectral interval (see
//! [`crate::propagate::chebyshev`]), the recurrence
//!
//! ```text
//! β_j u_{j+1} = (−iμS + K + ic + iα_j) u_j + β_{j−1} u_{j−1},     u_0 = w/‖w‖
//! ```
//!
//! gives orthonormal `v_j = i^j u_j` with `H̃ v_j = β_{j−1} v_{j−1} + α_j v_j + β_j v_{j+1}`: in
//! these vectors `H̃` is the real tridiagonal `T_m` of the `α` and `β`, and
//!
//! ```text
//! exp(−iHτ) w ≈ ‖w‖ e^{−icτ} Σ_j y_j v_j,     y = exp(−iT_m τ) e_0
//! ```
//!
//! (Park and Light 1986). Two bounds on its error, relative to `‖w‖`, choose the step `τ`:
//!
//! - before: twice that of the best polynomial of degree `m − 1` on the interval, hence at most
//!   `4 Σ_{k≥m} |J_k(hτ)|`;
//! - after: the residual, `β_{m−1} ∫_0^τ |(exp(−iT_m s))_{m−1,0}| ds`, since `exp(−iHs)` is unitary
//!   (Hochbruck and Lubich 1997; Saad 1992). The integral is taken as an upper sum over steps in
//!   which the integrand rises.
//!
//! A step is the longest for which one of the bounds is within the mode's tolerance times `τ/T`, so
//! the whole run meets the tolerance. The basis is not reorthogonalised: lost orthogonality costs
//! the exponential no accuracy (Druskin and Knizhnerman 1991).

use crate::base::bisect::bisect;
use crate::base::error::{Error, Result};
use crate::base::memory::NamedBytes;
use crate::matrix::block_matrix::BlockMatrix;
use crate::matrix::bounds::SpectralInterval;
use crate::matrix::lanes::{LANES, Lanes, StepConstants};
use crate::propagate::bessel::bessel_series;
use crate::propagate::evolution::{BatchSpec, Evolution, InitialState, MatrixShare};
use crate::propagate::method::{
    BatchCoupling, BatchReport, Descriptor, ModeDemand, Propagator, PropagatorSetting, RunWork,
};
use crate::propagate::tridiagonal::{
    BoundedStep, DIMENSION, ResidualLimits, TridiagonalExponential,
};
use num_complex::Complex64;

/// Number of pieces, of a step guaranteed beforehand, in which the residual is integrated.
const PIECES: f64 = 32.0;

/// A-priori bound on the relative error of a Krylov space of dimension `m` for `x = hτ`.
fn bound_before(scratch: &mut Vec<f64>, m: usize, x: f64) -> f64 {
    bessel_series(scratch, x, 0.0);
    4.0 * scratch.iter().skip(m).map(|j| j.abs()).sum::<f64>()
}

/// The longest `x = hτ`, at most `most`, for which dimension `m` keeps the error below `slope · x`.
fn longest(scratch: &mut Vec<f64>, m: usize, slope: f64, most: f64) -> f64 {
    // For x > m the terms of the series have only begun to decrease.
    let most = most.min(m as f64);
    if bound_before(scratch, m, most) <= slope * most {
        return most;
    }
    let [longest, _] = bisect(0.0, most, 40, |x| bound_before(scratch, m, x) <= slope * x);
    longest
}

/// The least dimension that keeps the error below `allowed` for `x = hτ`; [`DIMENSION`] if none
/// does.
fn dimension(scratch: &mut Vec<f64>, x: f64, allowed: f64) -> usize {
    bessel_series(scratch, x, 0.0);
    let mut rest = 0.0;
    let mut m = scratch.len();
    while m > 1 && rest + 4.0 * scratch[m - 1].abs() <= allowed {
        rest += 4.0 * scratch[m - 1].abs();
        m -= 1;
    }
    m.min(DIMENSION)
}

/// Largest number of applications of a mode: those of the steps that the a-priori bound allows.
fn applications(scratch: &mut Vec<f64>, demand: &ModeDemand) -> usize {
    let &ModeDemand { half_width, time, tolerance, step } = demand;
    if half_width == 0.0 {
        return 1;
    }
    let span = half_width * time;
    let most = half_width * step.unwrap_or(time).min(time);
    let step = longest(scratch, DIMENSION, tolerance / span, most);
    let whole = (span / step).floor();
    let left = (span - whole * step).max(0.0);
    let last =
        if left > 1e-12 * span { dimension(scratch, left, tolerance * left / span) } else { 0 };
    let each = dimension(scratch, step, tolerance * step / span);
    whole as usize * each + last
}

/// Scratch of the Krylov propagator for one rank; made once, used for every batch.
pub struct Krylov {
    /// `u_j`, one vector with its ghosts after the other.
    basis: Vec<Lanes>,
    /// Length of a vector of the basis.
    length: usize,
    /// `w`, without the lanes' phases.
    state: Vec<Lanes>,
    /// The longest step that the case gives, if any.
    step: Option<f64>,
    /// `α_j` and `β_j` by lane.
    alpha: Vec<[f64; LANES]>,
    beta: Vec<[f64; LANES]>,
    projected: TridiagonalExponential,
    series: Vec<f64>,
}

/// The limits of a step of a mode.
struct StepLimits {
    /// The step that the a-priori bound guarantees.
    guaranteed: f64,
    /// The longest step allowed.
    longest: f64,
    /// The tolerance of the whole `time`.
    tolerance: f64,
    time: f64,
}

impl Krylov {
    /// Scratch for vectors of `matrix`; no step longer than `step`.
    pub fn new(matrix: &BlockMatrix, step: Option<f64>) -> Self {
        let length = matrix.length();
        Self {
            basis: vec![Lanes::ZERO; (DIMENSION + 1) * length],
            length,
            state: vec![Lanes::ZERO; matrix.rows()],
            step,
            alpha: vec![[0.0; LANES]; DIMENSION],
            beta: vec![[0.0; LANES]; DIMENSION],
            projected: TridiagonalExponential::new(),
            series: Vec::with_capacity(400),
        }
    }

    /// Builds `u_0, …, u_m` and their `α`, `β` from the state, whose norms are `norms`. Collective
    /// over the space group.
    fn build(
        &mut self,
        system: &mut Evolution<'_>,
        constants: &mut StepConstants,
        norms: &[f64; LANES],
        m: usize,
        sizes: &[f64; LANES],
    ) {
        let rows = self.state.len();
        let inverse = norms.map(|n| if n > 0.0 { 1.0 / n } else { 0.0 });
        for (u, w) in self.basis[..rows].iter_mut().zip(&self.state) {
            *u = scaled(w, &inverse);
        }
        for j in 0..m {
            let (past, future) = self.basis.split_at_mut((j + 1) * self.length);
            let (past, x) = past.split_at_mut(j * self.length);
            let y = &mut future[..self.length];
            if j == 0 {
                y[..rows].fill(Lanes::ZERO);
            } else {
                let previous = &past[(j - 1) * self.length..];
                for (y, u) in y[..rows].iter_mut().zip(previous) {
                    *y = scaled(u, &self.beta[j - 1]);
                }
            }
            let nothing: &[()] = &[];
            let exchange = &mut *system.exchange;
            system.matrix.step(exchange, constants, None, y, x, nothing);
            let [alpha, square] = orthogonalise(system, x, y, sizes);
            let mut inverse = [0.0; LANES];
            for l in 0..LANES {
                // An invariant Krylov space is exact: the rest of the recurrence is round-off.
                let beta = if square[l] < 0.0 { 0.0 } else { square[l].sqrt() };
                let closed = beta <= f64::EPSILON * sizes[l];
                self.beta[j][l] = if closed { 0.0 } else { beta };
                inverse[l] = if closed { 0.0 } else { 1.0 / beta };
            }
            self.alpha[j] = alpha;
            for y in &mut y[..rows] {
                *y = scaled(y, &inverse);
            }
        }
    }

    /// The step and dimension that the a-priori bound guarantees: each lane's step, at most the
    /// time `left` of `time`, and the dimension that suffices for all of them.
    fn steps_by_bound(
        &mut self,
        intervals: &[SpectralInterval; LANES],
        batch: &BatchSpec,
        time: f64,
        left: &[f64; LANES],
    ) -> ([f64; LANES], usize) {
        let mut steps = [0.0; LANES];
        let mut m = 1;
        for l in (0..LANES).filter(|&l| left[l] > 0.0) {
            let (h, slope) = (intervals[l].half_width, batch.tolerances[l] / time);
            let most = self.step.unwrap_or(time).min(left[l]);
            let series = &mut self.series;
            if h == 0.0 {
                steps[l] = most;
                continue;
            }
            steps[l] = longest(series, DIMENSION, slope / h, h * most) / h;
            if steps[l] >= most * (1.0 - 1e-12) {
                steps[l] = most;
            }
            m = m.max(dimension(series, h * steps[l], slope * steps[l]));
        }
        (steps, m)
    }

    /// The step of lane `l` in the space of dimension `m`: the longest from the guaranteed one to
    /// the longest allowed that the integrated residual allows.
    fn step_by_residual(&mut self, l: usize, m: usize, limits: &StepLimits) -> BoundedStep {
        let &StepLimits { guaranteed, longest, tolerance, time } = limits;
        let (alpha, beta) = (&self.alpha, &self.beta);
        let found = self.projected.decompose(m, |j| (alpha[j][l], beta[j][l]));
        let mut step = BoundedStep { length: guaranteed, error: tolerance * guaranteed / time };
        if found && guaranteed > 0.0 {
            let (piece, beta) = (guaranteed / PIECES, self.beta[m - 1][l]);
            let limits = ResidualLimits { beta, piece, longest, slope: tolerance / time };
            let reach = self.projected.follow(m, &limits);
            if reach.length >= guaranteed {
                step = BoundedStep { length: reach.length.min(longest), error: reach.error };
            }
            // The step covers the remaining time up to round-off.
            if longest - step.length <= 1e-12 * time {
                step.length = longest;
            }
        }
        step
    }

    /// `w ← Σ_j c_j u_j`.
    fn combine(&mut self, coefficients: &[Lanes]) {
        for (j, Lanes(c)) in coefficients.iter().enumerate() {
            let u = &self.basis[j * self.length..];
            for (w, Lanes(u)) in self.state.iter_mut().zip(u) {
                if j == 0 {
                    *w = Lanes::ZERO;
                }
                for l in 0..LANES {
                    let (re, im) = (c[l], c[LANES + l]);
                    w.0[l] += re * u[l] - im * u[LANES + l];
                    w.0[LANES + l] += re * u[LANES + l] + im * u[l];
                }
            }
        }
    }
}

/// Makes `y` orthogonal to `u = x`, the last vector of the basis. Returns `α = ⟨u, iy⟩` and then
/// `‖y‖²` by lane, at most `sizes` and four times their squares. Collective over the space group.
fn orthogonalise(
    system: &Evolution<'_>,
    x: &[Lanes],
    y: &mut [Lanes],
    sizes: &[f64; LANES],
) -> [[f64; LANES]; 2] {
    let alpha = system.lane_sums(sizes, |i| {
        let (Lanes(u), Lanes(y)) = (&x[i], &y[i]);
        std::array::from_fn(|l| u[LANES + l] * y[l] - u[l] * y[LANES + l])
    });
    let square = system.lane_sums(&sizes.map(|h| 4.0 * h * h), |i| {
        let (Lanes(u), Lanes(y)) = (&x[i], &mut y[i]);
        std::array::from_fn(|l| {
            y[l] -= alpha[l] * u[LANES + l];
            y[LANES + l] += alpha[l] * u[l];
            y[l] * y[l] + y[LANES + l] * y[LANES + l]
        })
    });
    [alpha, square]
}

/// A row times a factor for each lane.
#[inline(always)]
fn scaled(Lanes(row): &Lanes, factors: &[f64; LANES]) -> Lanes {
    Lanes(std::array::from_fn(|l| factors[l % LANES] * row[l]))
}

impl Propagator for Krylov {
    fn propagate(
        &mut self,
        system: &mut Evolution<'_>,
        batch: &BatchSpec,
        initial: &InitialState<'_>,
    ) -> Result<BatchReport> {
        let time = system.time;
        let intervals = (batch.wavenumbers).map(|mu| system.bounds.interval(mu));
        let phases = intervals.map(|i| Complex64::new(0.0, -i.centre * time).exp());
        let mut report = BatchReport::unitary(phases);
        let mut constants = StepConstants {
            scale: [1.0; LANES],
            shift: intervals.map(|i| i.centre),
            wavenumber: batch.wavenumbers,
            coefficient: [0.0; LANES],
        };
        // ‖H − c‖, or 1 if the spectral interval is a point.
        let sizes = intervals.map(|i| if i.half_width > 0.0 { i.half_width } else { 1.0 });
        self.state.iter_mut().enumerate().for_each(|(i, w)| *w = initial.state.row(i));
        let any_is_nonzero = initial.norms.iter().any(|norm| *norm > 0.0);
        let mut left = [time; LANES];
        while left.iter().any(|&t| t > 0.0) && any_is_nonzero {
            let (steps, m) = self.steps_by_bound(&intervals, batch, time, &left);
            let squares = initial.norms.map(|norm| 2.0 * norm * norm);
            let norms = system.lane_norms(&squares, &self.state);
            self.build(system, &mut constants, &norms, m, &sizes);
            report.applications += batch.modes * m;

            let mut coefficients = [Lanes::ZERO; DIMENSION];
            for l in 0..LANES {
                let limits = StepLimits {
                    guaranteed: steps[l],
                    longest: self.step.unwrap_or(time).min(left[l]),
                    tolerance: batch.tolerances[l],
                    time,
                };
                let BoundedStep { length: tau, error } = self.step_by_residual(l, m, &limits);
                report.tails[l] += error + f64::EPSILON;
                left[l] -= tau;
                // v_j = i^j u_j.
                let mut power = Complex64::from(norms[l]);
                for (c, y) in coefficients.iter_mut().zip(self.projected.exponential(m, tau)) {
                    c.set_lane(l, power * y);
                    power *= Complex64::I;
                }
            }
            self.combine(&coefficients[..m]);
            if system.interruption.after(m) {
                return Err(Error::Interrupted);
            }
        }
        Ok(report)
    }

    fn state(&self) -> &[Lanes] {
        &self.state
    }
}

/// The descriptor of the Krylov propagator.
pub struct KrylovMethod;

impl Descriptor for KrylovMethod {
    fn batch_coupling(&self) -> BatchCoupling {
        BatchCoupling::Coupled
    }

    fn work(&self, demand: &ModeDemand, scratch: &mut Vec<f64>) -> usize {
        applications(scratch, demand)
    }

    fn applications_per_work(&self) -> usize {
        2
    }

    fn arrays(&self, share: &MatrixShare<'_>) -> Vec<NamedBytes> {
        let (lanes, vectors) = (size_of::<Lanes>() as u64, DIMENSION as u64 + 1);
        vec![
            NamedBytes::new(format!("batch of {LANES} modes"), lanes * share.rows),
            NamedBytes::new("Krylov space", vectors * lanes * share.length),
        ]
    }

    fn summary(&self, work: &RunWork) -> String {
        let &RunWork { least, most, .. } = work;
        let capped = (work.step).map_or(String::new(), |s| format!(", steps of at most {s:e}"));
        format!("krylov: at most {least} to {most} applications a mode{capped}")
    }

    fn propagator(
        &self,
        setting: &PropagatorSetting,
        matrix: &BlockMatrix,
    ) -> Result<Box<dyn Propagator>> {
        Ok(Box::new(Krylov::new(matrix, setting.propagation.step)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all(scratch: &mut Vec<f64>, half_width: f64, longest_step: f64, tolerance: f64) -> usize {
        let demand = ModeDemand { half_width, time: 1.0, tolerance, step: Some(longest_step) };
        applications(scratch, &demand)
    }

    #[test]
    fn steps_and_dimensions_keep_their_bounds_and_no_more() {
        let mut scratch = Vec::new();
        for slope in [1e-3, 1e-8, 1e-14, 1e-18] {
            let x = longest(&mut scratch, DIMENSION, slope, f64::INFINITY);
            assert!(bound_before(&mut scratch, DIMENSION, x) <= slope * x);
            assert!(bound_before(&mut scratch, DIMENSION, 1.001 * x) > slope * 1.001 * x);
            for part in [0.05, 0.3, 1.0] {
                let (x, allowed) = (part * x, slope * part * x);
                let m = dimension(&mut scratch, x, allowed);
                assert!(m <= DIMENSION && bound_before(&mut scratch, m, x) <= allowed);
                assert!(m == 1 || bound_before(&mut scratch, m - 1, x) > allowed);
            }
        }
    }

    #[test]
    fn planned_applications_cover_the_time() {
        let mut scratch = Vec::new();
        for (span, tolerance) in [(0.1, 1e-6), (20.0, 1e-6), (500.0, 1e-12)] {
            let whole = all(&mut scratch, span, 1.0, tolerance);
            // A Chebyshev series of that accuracy covers the time in one piece: it is shorter, but
            // not by much.
            bessel_series(&mut scratch, span, tolerance);
            let degree = scratch.len() - 1;
            assert!(whole >= degree && whole <= 6 * degree + DIMENSION, "{span}: {whole} {degree}");
            // Shorter steps cost more.
            let short = all(&mut scratch, span, 0.01, tolerance);
            assert!(short > whole, "{short} {whole}");
        }
        assert_eq!(all(&mut scratch, 0.0, 1.0, 1e-6), 1);
    }
}
