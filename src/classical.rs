//! The semi-discrete system integrated directly: `f' = A f + b`.
//!
//! The inflow is carried by the auxiliary unknowns of the matrix, so the system is homogeneous here: `u' = A u`.
//! [`Classical::exponential`] is the reference that the tolerance is defined by. The steps take slopes, see [`limiter`].

pub mod limiter;

use crate::case::Integrator;
use crate::communicator::GhostExchange;
use crate::matrix::{BlockMatrix, Part};
use crate::progress::Progress;
use limiter::Reconstruction;
use std::ops::Range;

/// Poisson probabilities below this are left out for the reference.
pub const EXACT: f64 = 1e-18;
/// And where three digits do.
pub const ROUGH: f64 = 1e-5;

/// `ln(k!)`.
fn log_factorial(k: usize) -> f64 {
    libm::lgamma(k as f64 + 1.0)
}

/// Poisson probability `e^{−λ} λ^k / k!`.
fn poisson(lambda: f64, k: usize) -> f64 {
    if lambda == 0.0 {
        return if k == 0 { 1.0 } else { 0.0 };
    }
    (k as f64 * lambda.ln() - lambda - log_factorial(k)).exp()
}

/// The `k` at which the Poisson probability is not below `negligible`.
pub fn poisson_window(lambda: f64, negligible: f64) -> Range<usize> {
    let mode = lambda.floor() as usize;
    let mut end = mode + 1;
    while poisson(lambda, end) > negligible {
        end += 1;
    }
    let mut start = mode;
    while start > 0 && poisson(lambda, start - 1) > negligible {
        start -= 1;
    }
    start..end
}

/// Poisson probabilities over [`poisson_window`], scaled to sum 1 exactly up to round-off.
fn poisson_weights(lambda: f64, negligible: f64) -> (usize, Vec<f64>) {
    let window = poisson_window(lambda, negligible);
    // From the largest outwards by ratios: relative errors stay at round-off, which `lgamma` would spoil.
    let mode = (lambda.floor() as usize).clamp(window.start, window.end - 1);
    let mut weights = vec![1.0; window.len()];
    for k in mode + 1..window.end {
        weights[k - window.start] = weights[k - 1 - window.start] * lambda / k as f64;
    }
    for k in (window.start..mode).rev() {
        weights[k - window.start] = weights[k + 1 - window.start] * (k + 1) as f64 / lambda;
    }
    let sum: f64 = weights.iter().sum();
    weights.iter_mut().for_each(|w| *w /= sum);
    (window.start, weights)
}

/// Integrates real vectors; scratch is made once.
pub struct Classical<'a> {
    matrix: &'a BlockMatrix,
    image: Vec<f64>,
    stage: Vec<f64>,
    sum: Vec<f64>,
    reconstruction: Option<Reconstruction>,
    progress: Progress,
}

impl<'a> Classical<'a> {
    /// Scratch for vectors of `matrix`.
    pub fn new(matrix: &'a BlockMatrix) -> Self {
        let vector = || vec![0.0; matrix.length()];
        Self {
            matrix,
            image: vector(),
            stage: vector(),
            sum: vector(),
            reconstruction: None,
            progress: Progress::silent(),
        }
    }

    /// Says how far it is.
    pub fn with_progress(self, progress: Progress) -> Self {
        Self { progress, ..self }
    }

    /// With slopes in the steps; the exponential is that of `A` and takes none.
    pub fn with_slopes(self, reconstruction: Option<Reconstruction>) -> Self {
        Self {
            reconstruction,
            ..self
        }
    }

    /// `state ← exp(A time) state`, with `rate ≥ max |A_ii|`: `exp(At) = Σ_k e^{−λ} λ^k/k! Q^k`, `λ = rate·t`,
    /// `Q = I + A/rate ≥ 0`. All terms are of one sign where the data are, so nothing cancels (uniformisation,
    /// Jensen 1953), those below `negligible` left out ([`EXACT`], [`ROUGH`]). Collective over the space group.
    pub fn exponential(
        &mut self,
        exchange: &mut GhostExchange,
        state: &mut [f64],
        (rate, time): (f64, f64),
        negligible: f64,
    ) {
        let rows = self.matrix.rows();
        let (start, weights) = poisson_weights(rate * time, negligible);
        self.sum[..rows].fill(0.0);
        for k in 0..start + weights.len() {
            if k >= start {
                let w = weights[k - start];
                for (sum, x) in self.sum[..rows].iter_mut().zip(&*state) {
                    *sum += w * x;
                }
            }
            self.matrix
                .apply(exchange, Part::Generator, &mut self.image, state);
            for (x, a) in state[..rows].iter_mut().zip(&self.image) {
                *x += a / rate;
            }
            self.progress.advance(1);
        }
        self.progress.finish();
        state[..rows].copy_from_slice(&self.sum[..rows]);
    }

    /// `steps` steps of forward Euler, or of the third-order strong-stability-preserving Runge–Kutta method (Shu and
    /// Osher 1988), of length `time/steps`. Collective over the space group.
    pub fn steps(
        &mut self,
        exchange: &mut GhostExchange,
        state: &mut [f64],
        integrator: Integrator,
        time: f64,
        steps: usize,
    ) {
        let rows = self.matrix.rows();
        let dt = time / steps as f64;
        for _ in 0..steps {
            match integrator {
                Integrator::ForwardEuler | Integrator::Exponential => {
                    self.euler(exchange, state, dt);
                }
                Integrator::SspRk3 => {
                    // u1 = E u, u2 = ¾ u + ¼ E u1, u ← ⅓ u + ⅔ E u2, with E u = u + dt A u.
                    let mut stage = std::mem::take(&mut self.stage);
                    stage[..rows].copy_from_slice(&state[..rows]);
                    for (keep, add) in [(0.0, 1.0), (0.75, 0.25), (1.0 / 3.0, 2.0 / 3.0)] {
                        self.euler(exchange, &mut stage, dt);
                        for (s, u) in stage[..rows].iter_mut().zip(&*state) {
                            *s = keep * u + add * *s;
                        }
                    }
                    state[..rows].copy_from_slice(&stage[..rows]);
                    self.stage = stage;
                }
            }
            self.progress.advance(1);
        }
        self.progress.finish();
    }

    /// `state ← state + dt A state`, with slopes where there are some.
    fn euler(&mut self, exchange: &mut GhostExchange, state: &mut [f64], dt: f64) {
        let rows = self.matrix.rows();
        self.matrix
            .apply(exchange, Part::Generator, &mut self.image, state);
        if let Some(reconstruction) = &mut self.reconstruction {
            reconstruction.add(exchange, &mut self.image, state, rows);
        }
        for (x, a) in state[..rows].iter_mut().zip(&self.image) {
            *x += dt * a;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn poisson_weights_sum_to_one_and_have_the_right_mean() {
        for lambda in [1e-3, 0.7, 13.0, 127.0, 5000.0] {
            let (start, weights) = poisson_weights(lambda, EXACT);
            let sum: f64 = weights.iter().sum();
            let mean: f64 = weights
                .iter()
                .enumerate()
                .map(|(k, w)| (start + k) as f64 * w)
                .sum();
            assert!((sum - 1.0).abs() < 1e-14);
            assert!((mean / lambda - 1.0).abs() < 1e-12, "{lambda}: {mean}");
        }
    }
}
