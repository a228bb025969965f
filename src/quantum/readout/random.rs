//! Streams of random numbers for simulated measurements.
//!
//! Each estimate of each observable at each cell has a stream of its own: ChaCha with 8 rounds, the
//! seed, observable and estimator in its key and the cell as the number of the stream. What is
//! drawn for a cell thus depends neither on other cells nor on ranks.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use rand_distr::{Binomial, Distribution, Gamma, Open01};

/// The number that a stream is for; no two numbers share a stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StreamKey {
    /// Number of the space cell, over the whole grid.
    pub cell: u64,
    /// Number of the observable.
    pub observable: u32,
    /// Number of the estimator.
    pub estimator: u32,
}

/// A stream of random numbers.
#[derive(Clone, Debug)]
pub struct Stream(ChaCha8Rng);

impl Stream {
    /// The stream of `key` under `seed`.
    pub fn new(seed: u64, key: StreamKey) -> Self {
        let mut bytes = [0; 32];
        bytes[..8].copy_from_slice(&seed.to_le_bytes());
        bytes[8..12].copy_from_slice(&key.observable.to_le_bytes());
        bytes[12..16].copy_from_slice(&key.estimator.to_le_bytes());
        let mut generator = ChaCha8Rng::from_seed(bytes);
        generator.set_stream(key.cell);
        Self(generator)
    }

    /// 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.0.next_u64()
    }

    /// A uniform number in (0, 1).
    pub fn uniform(&mut self) -> f64 {
        Open01.sample(&mut self.0)
    }

    /// Successes of `trials`, each of probability `p`.
    ///
    /// [`Binomial`] takes `1 − p`, rounded, to the power of `trials`: with `trials = 2^50` and
    /// `p = 2.66e-16` its mean is 26 % low. More than `LARGEST` trials are therefore halved first.
    /// The `k`-th smallest of `n` uniform numbers has a beta distribution of parameters `k` and
    /// `n + 1 − k`. Of the numbers below and above it, one side counts all or not at all, and the
    /// other is a binomial again, half as long (Devroye 1986, section X.4.3).
    pub fn binomial(&mut self, trials: u64, p: f64) -> u64 {
        /// Trials that `Binomial` takes with an error of its probabilities below 10^−9.
        const LARGEST: u64 = 1 << 24;
        let (mut n, mut p, mut successes) = (trials, p.clamp(0.0, 1.0), 0);
        while n > LARGEST && p > 0.0 && p < 1.0 {
            let k = n.div_ceil(2);
            let (below, above) = (self.gamma(k), self.gamma(n + 1 - k));
            let median = below / (below + above);
            if median <= p {
                successes += k;
                n -= k;
                p = ((p - median) / (1.0 - median)).min(1.0);
            } else {
                n = k - 1;
                p /= median;
            }
        }
        let rest = Binomial::new(n, p).expect("p is a probability");
        successes + rest.sample(&mut self.0)
    }

    /// A number of the gamma distribution of a whole shape, at least 1.
    fn gamma(&mut self, shape: u64) -> f64 {
        Gamma::new(shape as f64, 1.0).expect("a shape above 0").sample(&mut self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ANY: StreamKey = StreamKey { cell: 5, observable: 1, estimator: 2 };

    #[test]
    fn streams_differ_in_everything_they_are_for() {
        let first = |seed, key| Stream::new(seed, key).bits();
        let all = [
            first(1, ANY),
            first(2, ANY),
            first(1 << 32, ANY),
            first(1, StreamKey { cell: 6, ..ANY }),
            first(1, StreamKey { cell: 5 | 1 << 32, ..ANY }),
            first(1, StreamKey { observable: 2, ..ANY }),
            first(1, StreamKey { estimator: 1, ..ANY }),
        ];
        for (i, a) in all.iter().enumerate() {
            assert!(all[..i].iter().all(|b| a != b));
        }
        assert_eq!(first(1, ANY), all[0]);
    }

    /// χ² of counts against a binomial's probabilities, over the outcomes expected at least 10
    /// times; and the number of these outcomes.
    fn chi_square(n: u64, p: f64, seeds: u64) -> (f64, usize) {
        let mut counts = vec![0u64; n as usize + 1];
        for seed in 0..seeds {
            counts[Stream::new(seed, ANY).binomial(n, p) as usize] += 1;
        }
        let (mut term, mut sum, mut terms) = ((1.0 - p).powi(n as i32), 0.0, 0);
        for (k, &count) in counts.iter().enumerate() {
            let expected = term * seeds as f64;
            if expected >= 10.0 {
                sum += (count as f64 - expected).powi(2) / expected;
                terms += 1;
            }
            term *= (n as f64 - k as f64) / (k as f64 + 1.0) * p / (1.0 - p);
        }
        (sum, terms)
    }

    #[test]
    fn binomials_are_distributed_as_they_should() {
        for (n, p) in [(10, 0.3), (16, 0.9), (17, 0.5), (40, 0.02), (101, 0.37), (90, 0.97)] {
            let (chi, terms) = chi_square(n, p, 20_000);
            let freedom = terms as f64 - 1.0;
            // Four standard deviations of χ².
            assert!(
                terms > 2 && chi < freedom + 4.0 * (2.0 * freedom).sqrt(),
                "{n} {p}: {chi} {terms}"
            );
        }
        // Control: another probability is noticed.
        let mut off = 0.0;
        for seed in 0..2000 {
            off += Stream::new(seed, ANY).binomial(101, 0.37) as f64 / 2000.0;
        }
        assert!((off - 101.0 * 0.37).abs() < 0.5 && (off - 101.0 * 0.4).abs() > 2.0);
    }

    #[test]
    fn large_binomials_have_their_mean_and_variance() {
        for (n, p) in [
            (1_000_000u64, 0.5),
            (1 << 50, 0.3),
            (1 << 50, 1e-9),
            // 1 − p is rounded: without halving the mean is 26 % low.
            (1 << 50, 2.66e-16),
            (10_000_000_000, 1.0 - 1e-6),
        ] {
            let spread = (n as f64 * p * (1.0 - p)).sqrt();
            let draws = 4000;
            let (mut mean, mut square) = (0.0, 0.0);
            for seed in 0..draws {
                let z = (Stream::new(seed, ANY).binomial(n, p) as f64 - n as f64 * p) / spread;
                mean += z / draws as f64;
                square += z * z / draws as f64;
            }
            assert!(mean.abs() < 4.0 / (draws as f64).sqrt(), "{n} {p}: mean {mean}");
            assert!(
                (square - 1.0).abs() < 4.0 * (2.0 / draws as f64).sqrt(),
                "{n} {p}: variance {square}"
            );
        }
    }

    #[test]
    fn certain_outcomes() {
        let mut stream = Stream::new(3, ANY);
        for n in [0, 1, 16, 17, 1 << 40] {
            assert_eq!(stream.binomial(n, 0.0), 0);
            assert_eq!(stream.binomial(n, 1.0), n);
            assert!(stream.binomial(n, 0.5) <= n);
        }
    }
}
