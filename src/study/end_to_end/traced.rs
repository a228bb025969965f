//! The density at a point by tracing characteristics back.

use crate::base::checksum::indices;
use crate::problem::case::Case;
use crate::problem::exact::Tracer;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use std::time::Instant;

/// Traces of a quadrature or of Monte Carlo at most.
const MOST_TRACES: usize = 1 << 24;
/// Traces of Monte Carlo between two looks at its deviation: no fewer are ever taken.
pub(super) const BATCH: usize = 4096;

/// The density at a point, by tracing characteristics.
#[derive(Default)]
pub(super) struct TracedDensity {
    pub density: f64,
    pub traces: usize,
    pub seconds: f64,
    /// Largest `f₀` of those traced.
    pub largest: f64,
    /// Most jumps on a characteristic of those traced.
    pub crossings: usize,
}

/// The velocities of the box, mapped from the unit cube.
fn velocity_point(case: &Case, point: &[f64; 6], part: &[f64]) -> [f64; 6] {
    let mut at = *point;
    for (a, (axis, part)) in case.space.v.iter().zip(part).enumerate() {
        at[3 + a] = axis.lower + part * (axis.upper - axis.lower);
    }
    at
}

/// Volume of the velocity box.
pub(super) fn velocity_volume(case: &Case) -> f64 {
    case.space.v.iter().map(|v| v.upper - v.lower).product()
}

impl TracedDensity {
    /// By the midpoint rule, twice as fine until it changes by `ε/2` or less twice in a row.
    pub fn by_quadrature(
        case: &Case,
        tracer: &Tracer<'_>,
        point: &[f64; 6],
        accuracy: f64,
    ) -> Self {
        let started = Instant::now();
        let n = case.space.dimension();
        let mut found = Self { density: f64::NAN, ..Self::default() };
        let (mut agreed, mut each) = (0, 16usize);
        while agreed < 2 && each.pow(n as u32) <= MOST_TRACES {
            let count = each.pow(n as u32);
            let (mut sum, lengths) = (0.0, vec![each; n]);
            for k in 0..count {
                let part = indices(k, &lengths).into_iter().rev();
                let part: Vec<f64> = part.map(|j| (j as f64 + 0.5) / each as f64).collect();
                let value = tracer.value(&velocity_point(case, point, &part), case.end);
                found.largest = found.largest.max(value.abs());
                sum += value;
            }
            let density = velocity_volume(case) * sum / count as f64;
            let change = (density - found.density).abs();
            agreed = if change <= 0.5 * accuracy * density.abs() { agreed + 1 } else { 0 };
            (found.density, found.traces) = (density, found.traces + count);
            each *= 2;
        }
        found.seconds = started.elapsed().as_secs_f64();
        // Not timed: the number of jumps is for the quantum cost only.
        for k in 0..1000 {
            let part = vec![(f64::from(k) + 0.5) / 1000.0; n];
            let mut crossings = 0;
            let at = velocity_point(case, point, &part);
            tracer.follow_with(&at, case.end, &mut |_| crossings += 1);
            found.crossings = found.crossings.max(crossings);
        }
        found
    }

    /// The density by uniform velocities, [`BATCH`] by batch, until `1.96 σ/√n` is `ε` of the mean.
    pub fn by_monte_carlo(
        case: &Case,
        tracer: &Tracer<'_>,
        point: &[f64; 6],
        accuracy: f64,
    ) -> Self {
        let started = Instant::now();
        let n = case.space.dimension();
        let mut random = ChaCha8Rng::seed_from_u64(0);
        let (mut sum, mut squares, mut traces) = (0.0f64, 0.0f64, 0usize);
        loop {
            for _ in 0..BATCH {
                let part: Vec<f64> =
                    (0..n).map(|_| (random.next_u64() >> 11) as f64 / 2f64.powi(53)).collect();
                let value = tracer.value(&velocity_point(case, point, &part), case.end);
                (sum, squares, traces) = (sum + value, squares + value * value, traces + 1);
            }
            let count = traces as f64;
            let mean = sum / count;
            let deviation = (squares / count - mean * mean).max(0.0).sqrt();
            let met = 1.96 * deviation / count.sqrt() <= accuracy * mean.abs();
            if met || traces >= MOST_TRACES {
                return Self {
                    density: velocity_volume(case) * mean,
                    traces,
                    seconds: started.elapsed().as_secs_f64(),
                    ..Self::default()
                };
            }
        }
    }
}
