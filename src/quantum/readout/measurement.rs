//! Measurements of a quantum computer, drawn from their exact distributions, and their errors.
//!
//! An overlap `o = Re⟨χ|F⟩` is measured as a probability of one qubit or outcome:
//!
//! | | probability | estimate | distribution |
//! |---|---|---|---|
//! | Hadamard test, N shots | `(1 + o)/2` | `2k/N − 1` | `k` binomial |
//! | its amplitude estimation, M evaluations | `(1 + o)/2 = sin² θ` | `−cos(2πy/M)` | below |
//! | all-zero outcome, where `o ≥ 0`, N shots | `o²` | `√(k/N)` | `k` binomial |
//!
//! **Amplitude estimation** (Brassard, Høyer, Mosca and Tapp 2002) is phase estimation of the
//! Grover iterate, whose eigenvalues are `e^{±2iθ}`, by a register of `M` values. With `ω = θ/π` or
//! `1 − θ/π`, each half of the time, it gives `y` with probability
//!
//! ```text
//! sin²(πMd) / (M² sin²(πd)),   d = ω − y/M,
//! ```
//!
//! and `|sin²(πy/M) − a| ≤ 2π√(a(1−a))/M + π²/M²` with probability at least `8/π²`. The median of
//! [`RUNS`] of them keeps this bound unless more than half of them fail. A run takes `M − 1`
//! iterates, each with the preparation and its inverse, and one preparation: `2M − 1`.
//!
//! **Shots.** Hoeffding: `|2k/N − 1 − o| > ε` has probability at most `2e^{−Nε²/2}`. Chernoff:
//! `|√(k/N) − o| > ε` has probability at most `2e^{−Nε²}`, as the relative entropy of two coins is
//! at least the square of the distance of the roots.

use crate::quantum::readout::random::Stream;
use std::f64::consts::PI;

/// The least probability with which a bound of this file holds.
pub const CONFIDENCE: f64 = 0.95;

/// Runs of amplitude estimation whose median is taken: with fewer the median fails more often than
/// `1 − CONFIDENCE`.
pub const RUNS: usize = 7;

/// `ln(2/(1 − CONFIDENCE))`.
fn log_of_doubt() -> f64 {
    (2.0 / (1.0 - CONFIDENCE)).ln()
}

/// An estimate of an overlap and its standard error, from what was counted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// The estimate.
    pub value: f64,
    /// Standard error of the estimate; for amplitude estimation, the bound on its error.
    pub error: f64,
}

/// A Hadamard test of `overlap`.
pub fn hadamard(stream: &mut Stream, overlap: f64, shots: u64) -> Estimate {
    let count = stream.binomial(shots, 0.5 * (1.0 + overlap));
    let n = shots as f64;
    let value = 2.0 * count as f64 / n - 1.0;
    // With one more of each outcome, so that all shots being alike does not make it certain.
    let p = (count as f64 + 1.0) / (n + 2.0);
    Estimate { value, error: 2.0 * (p * (1.0 - p) / n).sqrt() }
}

/// `|overlap|` from how often `shots` are all zero.
pub fn all_zero(stream: &mut Stream, overlap: f64, shots: u64) -> Estimate {
    let count = stream.binomial(shots, overlap * overlap);
    let n = shots as f64;
    let value = (count as f64 / n).sqrt();
    let p = (count as f64 + 1.0) / (n + 2.0);
    Estimate { value, error: 0.5 * ((1.0 - p) / n).sqrt() }
}

/// Amplitude estimation of `overlap`: the median of [`RUNS`] runs with `evaluations` values of the
/// register.
pub fn amplitude_estimation(stream: &mut Stream, overlap: f64, evaluations: u64) -> Estimate {
    // The amplitude is √((1 + o)/2).
    let amplitude = (0.5 * (1.0 + overlap)).clamp(0.0, 1.0).sqrt();
    let value = -(2.0 * estimated_angle(stream, amplitude, evaluations)).cos();
    Estimate { value, error: amplitude_bound(value, evaluations as f64) }
}

/// The angle `θ` in `[0, π/2]` of an `amplitude` `sin θ`, however small: the median of [`RUNS`]
/// runs of amplitude estimation.
fn estimated_angle(stream: &mut Stream, amplitude: f64, evaluations: u64) -> f64 {
    let phase = amplitude.asin() / PI;
    let mut outcomes: [u64; RUNS] = std::array::from_fn(|_| {
        // The eigenphases are ±θ/π, and either is found.
        let sign = if stream.bits() & 1 == 0 { 1.0 } else { -1.0 };
        let y = phase_estimation(stream, sign * phase, evaluations);
        y.min(evaluations - y)
    });
    outcomes.sort_unstable();
    PI * outcomes[RUNS / 2] as f64 / evaluations as f64
}

/// An outcome of canonical phase estimation of `e^{2πi phase}` with a register of `size` values.
///
/// Outcomes are visited from the nearest to the phase outwards: the probability beyond the first
/// `k` is about `1/k`.
fn phase_estimation(stream: &mut Stream, phase: f64, size: u64) -> u64 {
    let m = size as f64;
    let scaled = phase * m;
    let nearest = scaled.round();
    let distance = scaled - nearest;
    let sine = (PI * distance).sin();
    let mut left = stream.uniform();
    let wrapped = |offset: i64| (nearest as i64 + offset).rem_euclid(size as i64) as u64;
    // 0, then alternately on the side where the phase is and on the other.
    let side = if distance >= 0.0 { 1 } else { -1 };
    for k in 0..size as i64 {
        let offset = if k % 2 == 1 { side * (k + 1) / 2 } else { -side * (k / 2) };
        // sin²(π(Δ − k)) is that of Δ.
        let below = m * (PI * (distance - offset as f64) / m).sin();
        let probability = if below == 0.0 { 1.0 } else { (sine / below).powi(2) };
        if left < probability {
            return wrapped(offset);
        }
        left -= probability;
    }
    // Round-off of the sum of all.
    wrapped(0)
}

/// Bound on the error of an overlap `o` by amplitude estimation, with probability [`CONFIDENCE`].
pub fn amplitude_bound(overlap: f64, evaluations: f64) -> f64 {
    let m = evaluations;
    // Twice that of the probability a, 2√(a(1−a)) = √(1 − o²).
    2.0 * (PI * (1.0 - overlap * overlap).max(0.0).sqrt() / m + (PI / m).powi(2))
}

/// Bound on the error of a Hadamard test, with probability [`CONFIDENCE`].
pub fn hadamard_bound(shots: f64) -> f64 {
    (2.0 * log_of_doubt() / shots).sqrt()
}

/// Bound on the error of [`all_zero`], with probability [`CONFIDENCE`].
pub fn all_zero_bound(shots: f64) -> f64 {
    (log_of_doubt() / shots).sqrt()
}

/// Shots that bring [`hadamard_bound`] down to `error`.
pub fn hadamard_shots(error: f64) -> f64 {
    (2.0 * log_of_doubt() / (error * error)).ceil().max(1.0)
}

/// Shots that bring [`all_zero_bound`] down to `error`.
pub fn all_zero_shots(error: f64) -> f64 {
    (log_of_doubt() / (error * error)).ceil().max(1.0)
}

/// Evaluations, a power of two, that bring [`amplitude_bound`] down to `error` whatever the
/// overlap.
pub fn evaluations(error: f64) -> f64 {
    // 2(π/m + π²/m²) ≤ e at m ≥ π(1 + √(1 + 2e))/e.
    let least = PI * (1.0 + (1.0 + 2.0 * error).sqrt()) / error;
    least.log2().ceil().max(1.0).exp2()
}

/// Bound on the relative error of `√P = sin θ` by amplitude estimation, `|θ̂ − θ| ≤ π/M`.
pub fn root_bound(probability: f64, evaluations: f64) -> f64 {
    PI / (evaluations * probability.sqrt())
}

/// Evaluations, a power of two, that bring [`root_bound`] down to `error`.
pub fn root_evaluations(probability: f64, error: f64) -> f64 {
    root_bound(probability, error).log2().ceil().max(1.0).exp2()
}

/// `√(P̂/P)` for a `P̂` from the number of successes in `trials` preparations.
pub fn root_by_successes(stream: &mut Stream, probability: f64, trials: u64) -> f64 {
    let successes = stream.binomial(trials, probability);
    (successes as f64 / (trials as f64 * probability)).sqrt()
}

/// `√(P̂/P)` for a `P̂` by amplitude estimation.
pub fn root_by_estimation(stream: &mut Stream, probability: f64, evaluations: u64) -> f64 {
    let amplitude = probability.sqrt();
    estimated_angle(stream, amplitude, evaluations).sin() / amplitude
}

/// Part by which an overlap may be too small after exact amplitude amplification with a `√P` that
/// is off by the part `error`. The angle after `2r + 1` evolutions is off by
/// `δ ≤ (2r + 1) tan(π/(4r + 2)) error ≤ √3 error`, and the overlap is `cos δ` times as large.
pub fn amplification_loss(error: f64) -> f64 {
    1.5 * error * error
}

/// Preparations that amplitude estimation takes, over its runs.
pub fn preparations(evaluations: f64) -> f64 {
    RUNS as f64 * (2.0 * evaluations - 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quantum::readout::random::StreamKey;
    use crate::quantum::test_support::exponent;

    fn stream(seed: u64) -> Stream {
        let key = StreamKey { cell: 11, observable: 0, estimator: 0 };
        Stream::new(seed, key)
    }

    /// Mean and root mean square of the errors over `seeds` draws.
    fn errors(seeds: u64, truth: f64, draw: impl Fn(&mut Stream) -> Estimate) -> (f64, f64) {
        let (mut mean, mut square) = (0.0, 0.0);
        for seed in 0..seeds {
            let error = draw(&mut stream(seed)).value - truth;
            mean += error / seeds as f64;
            square += error * error / seeds as f64;
        }
        (mean, square.sqrt())
    }

    const OVERLAPS: [f64; 5] = [-0.83, -0.01, 0.0, 0.2, 0.6];

    #[test]
    fn errors_of_a_hadamard_test_fall_like_the_root_of_the_shots() {
        for o in OVERLAPS {
            let shots = [64, 512, 4096, 1 << 15, 1 << 20];
            let points = shots.map(|n| {
                let (mean, spread) = errors(2000, o, |s| hadamard(s, o, n));
                let expected = ((1.0 - o * o) / n as f64).sqrt();
                // Unbiased, and of the variance it should have.
                assert!(mean.abs() < 4.0 * expected / 2000f64.sqrt(), "{o} {n}: bias {mean:e}");
                assert!((spread / expected - 1.0).abs() < 0.08, "{o} {n}: {spread:e} {expected:e}");
                (n as f64, spread)
            });
            let slope = exponent(&points);
            assert!((slope + 0.5).abs() < 0.02, "{o}: {slope}");
        }
    }

    #[test]
    fn errors_of_amplitude_estimation_fall_like_the_evaluations() {
        for o in OVERLAPS {
            let points: Vec<(f64, f64)> = (4..14)
                .map(|m| {
                    // Averaged over a step of the register: a phase on its grid is found exactly.
                    let theta = (0.5 * (1.0 + o)).sqrt().asin();
                    let square: f64 = (0..20)
                        .map(|k| {
                            let theta = theta + PI * f64::from(k) / 20.0 / f64::from(1 << m);
                            let o = -(2.0 * theta).cos();
                            errors(50, o, |s| amplitude_estimation(s, o, 1 << m)).1.powi(2)
                        })
                        .sum();
                    (f64::from(1 << m), (square / 20.0).sqrt())
                })
                .collect();
            let slope = exponent(&points);
            assert!((slope + 1.0).abs() < 0.06, "{o}: {slope}");
        }
    }

    #[test]
    fn errors_of_the_square_root_are_half_those_of_the_hadamard_test() {
        let points = [256, 4096, 1 << 16].map(|n| {
            let spread = errors(2000, 0.4, |s| all_zero(s, 0.4, n)).1;
            let of_hadamard = errors(2000, 0.4, |s| hadamard(s, 0.4, n)).1;
            assert!((of_hadamard / spread - 2.0).abs() < 0.2, "{n}: {of_hadamard:e} {spread:e}");
            (n as f64, spread)
        });
        assert!((exponent(&points) + 0.5).abs() < 0.03);
    }

    #[test]
    fn bounds_hold_with_the_stated_probability() {
        let seeds = 1000;
        // Three standard deviations of a count that should be CONFIDENCE or more.
        let least = CONFIDENCE - 3.0 * (CONFIDENCE * (1.0 - CONFIDENCE) / seeds as f64).sqrt();
        let share = |holds: &dyn Fn(&mut Stream) -> bool| {
            (0..seeds).filter(|seed| holds(&mut stream(*seed))).count() as f64 / seeds as f64
        };
        for o in OVERLAPS {
            for n in [10u64, 100, 10_000] {
                let off = |e: Estimate, truth: f64| (e.value - truth).abs();
                let held = share(&|s| off(hadamard(s, o, n), o) <= hadamard_bound(n as f64));
                assert!(held >= least, "Hadamard {o} {n}: {held}");
                let held = share(&|s| off(all_zero(s, o, n), o.abs()) <= all_zero_bound(n as f64));
                assert!(held >= least, "root {o} {n}: {held}");
                // Control: a third of the bound does not hold so often.
                let held = share(&|s| off(hadamard(s, o, n), o) <= hadamard_bound(n as f64) / 3.0);
                assert!(o.abs() > 0.5 || held < least, "control {o} {n}: {held}");
            }
            for m in [8u64, 64, 1024] {
                let held = share(&|s| {
                    (amplitude_estimation(s, o, m).value - o).abs() <= amplitude_bound(o, m as f64)
                });
                assert!(held >= least, "amplitude {o} {m}: {held}");
            }
        }
    }

    /// However small the probability is.
    #[test]
    fn roots_by_estimation_are_within_their_bound() {
        let seeds = 400;
        let least = CONFIDENCE - 3.0 * (CONFIDENCE * (1.0 - CONFIDENCE) / seeds as f64).sqrt();
        let mut loose = 0;
        for probability in [0.3, 1e-3, 1e-9, 1e-16, 3e-22] {
            for error in [0.1, 1e-2] {
                let evaluations = root_evaluations(probability, error);
                let bound = root_bound(probability, evaluations);
                let off = |seed| {
                    let found =
                        root_by_estimation(&mut stream(seed), probability, evaluations as u64);
                    (found - 1.0).abs()
                };
                let all: Vec<f64> = (0..seeds).map(off).collect();
                let held = |bound: f64| {
                    all.iter().filter(|off| **off <= bound).count() as f64 / seeds as f64
                };
                assert!(held(bound) >= least, "{probability:e} {error}: {}", held(bound));
                // A phase on the register's grid is found exactly.
                loose += usize::from(held(bound / 30.0) >= least);
            }
        }
        assert!(loose <= 3, "{loose} of 10 bounds are loose");
    }

    #[test]
    fn standard_errors_follow_from_the_counts() {
        for o in OVERLAPS {
            let n = 4000;
            let found = hadamard(&mut stream(1), o, n).error;
            assert!(
                (found / ((1.0 - o * o) / n as f64).sqrt() - 1.0).abs() < 0.1,
                "{o}: {found:e}"
            );
        }
        // All shots alike, and still not certain.
        assert!(hadamard(&mut stream(1), 1.0, 100).error > 0.0);
        assert!(all_zero(&mut stream(1), 0.0, 100).error > 0.0);
    }

    /// All outcomes' probabilities by the definition: |1/M Σ_k e^{2πik(φ − y/M)}|².
    fn by_definition(phase: f64, size: u64) -> Vec<f64> {
        let of = |y: u64| {
            let angle = 2.0 * PI * (phase - y as f64 / size as f64);
            let (re, im) = (0..size)
                .map(|k| (angle * k as f64).sin_cos())
                .fold((0.0, 0.0), |(re, im), (s, c)| (re + c, im + s));
            (re * re + im * im) / (size * size) as f64
        };
        (0..size).map(of).collect()
    }

    #[test]
    fn phases_are_distributed_as_in_the_register() {
        for (phase, size) in [(0.3, 16u64), (0.03, 16), (0.5, 8), (0.999, 32), (0.71, 7)] {
            let expected = by_definition(phase, size);
            assert!((expected.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            let seeds = 20_000;
            let mut counts = vec![0.0; size as usize];
            for seed in 0..seeds {
                counts[phase_estimation(&mut stream(seed), phase, size) as usize] += 1.0;
            }
            for (y, (count, p)) in counts.iter().zip(&expected).enumerate() {
                let mean = p * seeds as f64;
                let spread = (mean * (1.0 - p)).sqrt().max(1.0);
                assert!((count - mean).abs() <= 4.5 * spread, "{phase} {size} {y}: {count} {mean}");
            }
        }
    }

    #[test]
    fn planned_shots_meet_the_bound_and_are_the_fewest() {
        for error in [0.9, 0.1, 1e-3, 1e-6] {
            let n = hadamard_shots(error);
            assert!(hadamard_bound(n) <= error && (n == 1.0 || hadamard_bound(n - 1.0) > error));
            let n = all_zero_shots(error);
            assert!(all_zero_bound(n) <= error && (n == 1.0 || all_zero_bound(n - 1.0) > error));
            let m = evaluations(error);
            assert!(amplitude_bound(0.0, m) <= error && amplitude_bound(0.0, 0.5 * m) > error);
        }
    }

    #[test]
    fn the_median_of_all_runs_has_the_stated_confidence() {
        let fails = 1.0 - 8.0 / (PI * PI);
        let choose =
            |n: usize, k: usize| (0..k).fold(1.0, |c, i| c * (n - i) as f64 / (i + 1) as f64);
        let most_fail = |runs: usize| -> f64 {
            let of = |k: usize| {
                choose(runs, k) * fails.powi(k as i32) * (1.0 - fails).powi((runs - k) as i32)
            };
            (runs.div_ceil(2)..=runs).map(of).sum()
        };
        assert!(most_fail(RUNS) <= 1.0 - CONFIDENCE);
        assert!(most_fail(RUNS - 2) > 1.0 - CONFIDENCE);
    }
}
