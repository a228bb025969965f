//! The semi-discrete system integrated directly: `f' = A f + b`.
//!
//! The auxiliary unknowns of the matrix carry the inflow, so the system is homogeneous here: `u' =
//! A u`. [`Classical::exponential`] is the reference that defines the tolerance. Explicit steps may
//! use slopes, see [`crate::propagate::limiter`].

use crate::base::progress::Progress;
use crate::base::quadrature::{QuadraturePoint, gauss_legendre};
use crate::matrix::block_matrix::{BlockMatrix, Operator};
use crate::matrix::bounds::Bounds;
use crate::parallel::communicator::GhostExchange;
use crate::problem::case::{Case, Integrator, LiouvilleField};
use crate::propagate::inflow_panels::{InflowPanels, NODES};
use crate::propagate::limiter::{Reconstruction, longest_step};
use std::ops::Range;

/// Poisson probabilities below this are left out for the reference.
pub const EXACT: f64 = 1e-18;
/// Poisson probabilities below this are left out if three digits suffice.
pub const ROUGH: f64 = 1e-5;

/// Poisson probability `e^{−λ} λ^k / k!`.
fn poisson(lambda: f64, k: usize) -> f64 {
    if lambda == 0.0 {
        return if k == 0 { 1.0 } else { 0.0 };
    }
    (k as f64 * lambda.ln() - lambda - libm::lgamma(k as f64 + 1.0)).exp()
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
struct PoissonWeights {
    window: Range<usize>,
    /// One for each `k` of the window.
    weights: Vec<f64>,
}

impl PoissonWeights {
    fn new(lambda: f64, negligible: f64) -> Self {
        let window = poisson_window(lambda, negligible);
        // By ratios from the largest outwards: relative errors stay at round-off, unlike with
        // `lgamma`.
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
        Self { window, weights }
    }

    /// The weight of term `k`; `None` below and above the window.
    fn get(&self, k: usize) -> Option<f64> {
        self.weights.get(k.checked_sub(self.window.start)?).copied()
    }
}

/// Longest panel of [`Classical::duhamel`], as a part of `1/rate`: 16 nodes integrate a function
/// that varies with the rate to round-off.
const LONGEST_PANEL: f64 = 4.0;

/// Panels of [`Classical::duhamel`] for the inflow of `case`, and the largest `rate` of change.
pub fn duhamel_panels(case: &Case, rate: f64) -> InflowPanels {
    InflowPanels::new(case, LONGEST_PANEL / rate)
}

/// Applications of `A` that [`Classical::duhamel`] takes, but for the part of the last panel after
/// its last node.
pub fn duhamel_applications(rate: f64, panels: &InflowPanels) -> usize {
    let rule = gauss_legendre(NODES);
    // From the last node to the end of the part before: of a panel not every part is asked for.
    let mut left = 0.0;
    panels.sum(|part| {
        let mut now = part[0] - left;
        let applications = |point: &QuadraturePoint| {
            let at = point.moved_to(part).node;
            poisson_window(rate * (at - std::mem::replace(&mut now, at)).max(0.0), EXACT).end
        };
        let count = rule.iter().map(applications).sum();
        left = part[1] - now;
        count
    })
}

/// The length of a propagation, and the largest rate of change.
#[derive(Clone, Copy, Debug)]
pub struct ClassicalSpan {
    /// Bound on the rates: `max |A_ii|`, for elements `‖A‖`.
    pub rate: f64,
    /// Length of time.
    pub time: f64,
}

/// Integrates real vectors; scratch is made once.
pub struct Classical<'a> {
    matrix: &'a BlockMatrix,
    image: Vec<f64>,
    stage: Vec<f64>,
    sum: Vec<f64>,
    reconstruction: Option<Reconstruction>,
    /// The current `b_i`, in weighted unknowns, row by row of the matrix's `inflow`; empty if the
    /// matrix contains the inflow.
    inflow: Vec<f64>,
    /// An inflow that depends on time, and `√π_i` of its rows.
    source: Option<(&'a LiouvilleField, Vec<f64>)>,
    /// The start time of a state, for an inflow that depends on time.
    begin: f64,
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
            inflow: Vec::new(),
            source: None,
            begin: 0.0,
            progress: Progress::silent(),
        }
    }

    /// The integrator of a case, with its inflow if that depends on time; `pi` are the weights.
    pub fn of(case: &'a Case, matrix: &'a BlockMatrix, pi: &[f64]) -> Self {
        let this = Self { begin: case.start_time, ..Self::new(matrix) };
        if case.varies() { this.with_source(&case.fields[0], pi) } else { this }
    }

    /// This integrator with the inflow of `field`, which depends on time, in unknowns weighted by
    /// `√π`.
    pub fn with_source(self, field: &'a LiouvilleField, pi: &[f64]) -> Self {
        let root = |aux: &crate::matrix::inflow::AuxiliaryRow| pi[aux.row as usize].sqrt();
        let roots = self.matrix.inflow.iter().map(root).collect();
        Self { source: Some((field, roots)), ..self }
    }

    /// Sets `b` to these constant values, row by row of the matrix's `inflow`, in weighted
    /// unknowns.
    pub fn set_inflow(&mut self, values: impl Iterator<Item = f64>) {
        self.inflow.clear();
        self.inflow.extend(values);
    }

    /// Sets `inflow` to `b` at `time` after the start, in weighted unknowns.
    fn set_inflow_at(&mut self, time: f64) {
        if let Some((field, roots)) = &self.source {
            let values = self.matrix.entering.values(field, self.begin + time);
            self.inflow.clear();
            self.inflow.extend(values.zip(roots).map(|(b, root)| b * root));
        }
    }

    /// `state ← state(time)` of `f' = A f + b(t)`: `exp(A time) state + ∫ exp(A (time − s)) b(s)
    /// ds`, the integral by Gauss's rule on `panels`, on which `b` is smooth. Between nodes there
    /// is no inflow; at a node `s` with weight `w`, `w b(s)` is added. Collective over the space
    /// group.
    pub fn duhamel(
        &mut self,
        exchange: &mut GhostExchange,
        state: &mut [f64],
        span: ClassicalSpan,
        panels: &InflowPanels,
    ) {
        let rule = gauss_legendre(NODES);
        let mut now = 0.0;
        for panel in panels.each() {
            for point in &rule {
                let QuadraturePoint { node: at, weight } = point.moved_to(panel);
                self.inflow.clear();
                self.exponential(exchange, state, ClassicalSpan { time: at - now, ..span }, EXACT);
                now = at;
                self.set_inflow_at(at);
                for (aux, b) in self.matrix.inflow.iter().zip(&self.inflow) {
                    state[aux.row as usize] += weight * b;
                }
            }
        }
        self.inflow.clear();
        self.exponential(exchange, state, ClassicalSpan { time: span.time - now, ..span }, EXACT);
    }

    /// `state ← state(t)` at the end `t` of each leg of `case`, one after the other, by its
    /// integrator with the rate of `bounds`. Then calls `at_end` with the number of the leg and the
    /// state. Collective over the space group.
    pub fn integrate_legs(
        &mut self,
        exchange: &mut GhostExchange,
        case: &Case,
        bounds: &Bounds,
        state: &mut [f64],
        mut at_end: impl FnMut(usize, &[f64]),
    ) {
        let legs = case.legs().into_iter().zip(classical_steps(case, bounds));
        for (leg, (time, steps)) in legs.enumerate() {
            let span = ClassicalSpan { rate: bounds.rate, time };
            self.integrate(exchange, case, span, steps, state);
            at_end(leg, state);
        }
    }

    /// `state ← state(time)` by the integrator of `case`, in so many explicit `steps`; the
    /// exponential knows how many terms it takes. Collective over the space group.
    fn integrate(
        &mut self,
        exchange: &mut GhostExchange,
        case: &Case,
        span: ClassicalSpan,
        steps: usize,
        state: &mut [f64],
    ) {
        match case.classical.integrator {
            Integrator::Exponential if self.source.is_some() => {
                let panels = duhamel_panels(case, span.rate);
                self.duhamel(exchange, state, span, &panels);
            }
            Integrator::Exponential => self.exponential(exchange, state, span, EXACT),
            integrator => self.steps(exchange, state, integrator, span.time, steps),
        }
    }

    /// This integrator, which reports its steps to `progress`.
    pub fn with_progress(self, progress: Progress) -> Self {
        Self { progress, ..self }
    }

    /// This integrator with limited slopes in its explicit steps. The exponential does not use
    /// them.
    pub fn with_slopes(self, reconstruction: Option<Reconstruction>) -> Self {
        Self { reconstruction, ..self }
    }

    /// `state ← exp(A time) state`, with `rate ≥ max |A_ii|`: `exp(At) = Σ_k e^{−λ} λ^k/k! Q^k`,
    /// `λ = rate·t`, `Q = I + A/rate ≥ 0`. For data of one sign all terms have that sign, so
    /// nothing cancels (uniformisation, Jensen 1953). Terms below `negligible` are left out
    /// ([`EXACT`], [`ROUGH`]). For degrees above 0, with `rate ≥ ‖A‖`, `Q` is no contraction: the
    /// time is split into parts that limit cancellation. Collective over the space group.
    pub fn exponential(
        &mut self,
        exchange: &mut GhostExchange,
        state: &mut [f64],
        span: ClassicalSpan,
        negligible: f64,
    ) {
        let courant = span.rate * span.time;
        if courant == 0.0 {
            // No transport: inflow enters no cell.
            return;
        }
        let parts = exponential_parts(courant, self.matrix.by_elements);
        let weights = PoissonWeights::new(span.rate * (span.time / parts as f64), negligible);
        for _ in 0..parts {
            self.apply_series(exchange, state, span.rate, &weights);
        }
    }

    /// `state ← Σ_k weight_k Q^k state` over the terms that have a weight. Collective over the
    /// space group.
    fn apply_series(
        &mut self,
        exchange: &mut GhostExchange,
        state: &mut [f64],
        rate: f64,
        weights: &PoissonWeights,
    ) {
        let rows = self.matrix.rows();
        self.sum[..rows].fill(0.0);
        let Self { matrix, sum, inflow, image, progress, .. } = self;
        let mut terms = ExponentialTerms { matrix, inflow, rate, weights, sum };
        let (mut x, mut next) = (&mut *state, &mut image[..]);
        let end = weights.window.end;
        for first in (0..end).step_by(TOGETHER) {
            let range = first..end.min(first + TOGETHER);
            let count = range.len();
            match matrix.layer() {
                Some(layer) => terms.add_together(layer, range, [x, next]),
                None => terms.add_one_by_one(exchange, range, [x, next]),
            }
            if count % 2 == 1 {
                std::mem::swap(&mut x, &mut next);
            }
            progress.advance(count);
        }
        progress.finish();
        state[..rows].copy_from_slice(&self.sum[..rows]);
    }

    /// `steps` steps of forward Euler, or of the third-order strong-stability-preserving
    /// Runge–Kutta method (Shu and Osher 1988), of length `time/steps`. Collective over the space
    /// group.
    pub fn steps(
        &mut self,
        exchange: &mut GhostExchange,
        state: &mut [f64],
        integrator: Integrator,
        time: f64,
        steps: usize,
    ) {
        let dt = time / steps as f64;
        for step in 0..steps {
            let now = step as f64 * dt;
            match integrator {
                Integrator::ForwardEuler => self.euler(exchange, state, now, dt),
                Integrator::SspRk3 => self.ssp_rk3(exchange, state, now, dt),
                Integrator::Exponential => unreachable!("the exponential takes no steps"),
            }
            self.progress.advance(1);
        }
        self.progress.finish();
    }

    /// A step of the Runge–Kutta method: `u1 = E u`, `u2 = ¾ u + ¼ E u1`, `u ← ⅓ u + ⅔ E u2`, with
    /// `E u = u + dt (A u + b)`, `b` at `now`, `now + dt`, `now + dt/2`.
    fn ssp_rk3(&mut self, exchange: &mut GhostExchange, state: &mut [f64], now: f64, dt: f64) {
        let rows = self.matrix.rows();
        let mut stage = std::mem::take(&mut self.stage);
        stage[..rows].copy_from_slice(&state[..rows]);
        for (keep, add, later) in [(0.0, 1.0, 0.0), (0.75, 0.25, 1.0), (1.0 / 3.0, 2.0 / 3.0, 0.5)]
        {
            self.euler(exchange, &mut stage, now + later * dt, dt);
            for (s, u) in stage[..rows].iter_mut().zip(&*state) {
                *s = keep * u + add * *s;
            }
        }
        state[..rows].copy_from_slice(&stage[..rows]);
        self.stage = stage;
    }

    /// `state ← state + dt (A state + b(now))`, with slopes if there are any.
    fn euler(&mut self, exchange: &mut GhostExchange, state: &mut [f64], now: f64, dt: f64) {
        let rows = self.matrix.rows();
        self.matrix.apply(exchange, Operator::Generator, &mut self.image, state);
        self.set_inflow_at(now);
        self.matrix.add_inflow(&self.inflow, 0..rows, &mut self.image);
        if let Some(reconstruction) = &mut self.reconstruction {
            reconstruction.add(exchange, &mut self.image, state, rows);
        }
        for (x, a) in state[..rows].iter_mut().zip(&self.image) {
            *x += dt * a;
        }
    }
}

/// Terms of an exponential that are added in one pass through memory.
const TOGETHER: usize = 4;

/// Terms `Q^k x` of an exponential, one after the other, `Q x = x + (A x + b)/rate`.
struct ExponentialTerms<'a> {
    matrix: &'a BlockMatrix,
    /// `b`, see [`Classical::set_inflow`].
    inflow: &'a [f64],
    rate: f64,
    weights: &'a PoissonWeights,
    /// The sum of the terms so far.
    sum: &'a mut [f64],
}

impl ExponentialTerms<'_> {
    /// Adds term `k`, which is `x`, and turns `A x` into the next one, in some rows.
    fn add(&mut self, rows: Range<usize>, k: usize, image: &mut [f64], x: &[f64]) {
        // A constant inflow is an unknown 1 that stays 1.
        self.matrix.add_inflow(self.inflow, rows.clone(), image);
        let x = &x[rows.clone()];
        if let Some(weight) = self.weights.get(k) {
            self.sum[rows.clone()].iter_mut().zip(x).for_each(|(sum, x)| *sum += weight * x);
        }
        image[rows].iter_mut().zip(x).for_each(|(a, x)| *a = x + *a / self.rate);
    }

    /// Adds terms of which the first is `x`. The term after the last is then in the first vector
    /// for an even number of terms, in the second for an odd one.
    fn add_one_by_one(
        &mut self,
        exchange: &mut GhostExchange,
        terms: Range<usize>,
        [mut x, mut next]: [&mut [f64]; 2],
    ) {
        let matrix = self.matrix;
        for k in terms {
            let add = |rows: Range<usize>, image: &mut [f64], x: &[f64]| {
                self.add(rows, k, image, x);
            };
            matrix.apply_then(exchange, Operator::Generator, next, x, add);
            std::mem::swap(&mut x, &mut next);
        }
    }

    /// Adds terms as [`add_one_by_one`](Self::add_one_by_one) does, but in one pass through memory,
    /// `layer` rows at a time. Each term lags one layer behind the previous one, so that its inputs
    /// are complete and the rows that it overwrites are no longer needed.
    fn add_together(&mut self, layer: usize, terms: Range<usize>, [x, next]: [&mut [f64]; 2]) {
        let (matrix, cells) = (self.matrix, self.matrix.block.cells());
        let mut step = |term: usize, rows: Range<usize>| {
            let (from, to) = match term % 2 {
                0 => (&*x, &mut *next),
                _ => (&*next, &mut *x),
            };
            matrix.apply_run(rows, Operator::Generator, to, from, &mut |rows, image, x| {
                self.add(rows, terms.start + term, image, x);
            });
        };
        // Auxiliary unknowns do not change.
        (0..terms.len()).for_each(|term| step(term, cells..matrix.rows()));
        let layers = cells / layer;
        for front in 0..layers + terms.len() - 1 {
            for term in 0..terms.len() {
                if let Some(at) = front.checked_sub(term).filter(|at| *at < layers) {
                    step(term, at * layer..(at + 1) * layer);
                }
            }
        }
    }
}

/// Longest part `‖A‖t` of an exponential for degrees above 0: by `‖Q‖^k ≤ 2^{k/2}`, round-off grows
/// in a part by at most `e^{(√2 − 1)‖A‖t}`, a factor of 28.
const LONGEST_PART: f64 = 8.0;

/// Number of parts of an exponential over `courant = rate · time`.
fn exponential_parts(courant: f64, by_elements: bool) -> usize {
    if by_elements { (courant / LONGEST_PART).ceil().max(1.0) as usize } else { 1 }
}

/// Steps of the classical method, leg by leg.
pub fn classical_steps(case: &Case, bounds: &Bounds) -> Vec<usize> {
    let rate = bounds.rate;
    let steps = |&time: &f64| match case.classical.integrator {
        // The results of such a run are written at the end only: one leg.
        Integrator::Exponential if case.varies() => {
            duhamel_applications(rate, &duhamel_panels(case, rate))
        }
        Integrator::Exponential => {
            let parts = exponential_parts(rate * time, case.is_galerkin());
            parts * poisson_window(rate * time / parts as f64, EXACT).end
        }
        Integrator::ForwardEuler | Integrator::SspRk3 => {
            (rate * time / (case.classical.cfl * longest_step(case.scheme.limiter))).ceil().max(1.0)
                as usize
        }
    };
    case.legs().iter().map(steps).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn poisson_weights_sum_to_one_and_have_the_right_mean() {
        for lambda in [1e-3, 0.7, 13.0, 127.0, 5000.0, 1e9] {
            let found = PoissonWeights::new(lambda, EXACT);
            // The memory grows with the width of the distribution, not with its mean.
            assert!(found.weights.len() as f64 <= 20.0 * (lambda.sqrt() + 1.0), "{lambda}");
            assert_eq!(found.get(found.window.end), None);
            assert_eq!(found.get(found.window.start.wrapping_sub(1)), None);
            let weights = || found.window.clone().map(|k| (k, found.get(k).unwrap_or(0.0)));
            let sum: f64 = weights().map(|(_, weight)| weight).sum();
            let mean: f64 = weights().map(|(k, weight)| k as f64 * weight).sum();
            assert!((sum - 1.0).abs() < 1e-14);
            assert!((mean / lambda - 1.0).abs() < 1e-12, "{lambda}: {mean}");
        }
    }

    /// Applications over panels are those from node to node, though parts are counted together.
    #[test]
    fn applications_over_panels_are_those_of_all_nodes() {
        let text = "[[axis]]\nx = { lower = 0, upper = 1, cells = 4 }\n\
                    v = { lower = 0.5, upper = 1, cells = 4 }\n\
                    [[potential]]\nvalue = \"0\"\n[initial]\nf = \"0\"\n\
                    [inflow]\nvalue = \"1 + cos(t) if t < 0.3 else 0\"\n[time]\nend = 1\n";
        let case = Case::parse("test", text, &[]).expect("a case");
        for rate in [1.0, 100.0, 300.0, 1000.0] {
            let panels = duhamel_panels(&case, rate);
            let (mut now, mut count) = (0.0, 0);
            for part in panels.each() {
                let length = part[1] - part[0];
                assert!(rate * length < LONGEST_PANEL * (1.0 + 1e-9), "{rate}: {part:?}");
                for point in gauss_legendre(NODES) {
                    let at = point.moved_to(part).node;
                    count +=
                        poisson_window(rate * (at - std::mem::replace(&mut now, at)), EXACT).end;
                }
            }
            let counted = duhamel_applications(rate, &panels);
            assert!(counted.abs_diff(count) <= count / 500, "{rate}: {counted} for {count}");
        }
    }
}
