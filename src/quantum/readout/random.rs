//! Random numbers by their place: Philox 4x32-10 (Salmon, Moraes, Dror and Shaw 2011), a bijection of 128-bit counters under a 64-bit key.
//!
//! A [`Stream`] has the seed for a key and says in the counter what it is for, so that what is drawn for a cell depends on nothing that was
//! drawn before, nor on who draws it.

use std::f64::consts::TAU;

/// Counter `x` under key `k`.
fn philox([mut a, mut b, mut c, mut d]: [u32; 4], [mut k, mut l]: [u32; 2]) -> [u32; 4] {
    const MULTIPLIERS: [u32; 2] = [0xd251_1f53, 0xcd9e_8d57];
    const WEYL: [u32; 2] = [0x9e37_79b9, 0xbb67_ae85];
    for _ in 0..10 {
        let [first, second] = [(MULTIPLIERS[0], a), (MULTIPLIERS[1], c)]
            .map(|(m, x)| u64::from(m) * u64::from(x))
            .map(|product| [(product >> 32) as u32, product as u32]);
        [a, b, c, d] = [second[0] ^ b ^ k, second[1], first[0] ^ d ^ l, first[1]];
        (k, l) = (k.wrapping_add(WEYL[0]), l.wrapping_add(WEYL[1]));
    }
    [a, b, c, d]
}

/// What a stream of random numbers is for; streams of different purposes have no counter in common.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Purpose {
    /// Number of the space cell, over the whole grid.
    pub cell: u64,
    /// The observable, below 2^8.
    pub observable: u32,
    /// How it is estimated, below 2^8.
    pub estimator: u32,
}

/// A stream of random numbers.
#[derive(Clone, Debug)]
pub struct Stream {
    key: [u32; 2],
    counter: [u32; 4],
    /// Half of a block, not used yet.
    left: Option<u64>,
}

impl Stream {
    /// The stream of `purpose` under `seed`.
    pub fn new(seed: u64, purpose: Purpose) -> Self {
        let (low, high) = (purpose.cell as u32, (purpose.cell >> 32) as u32);
        Self {
            key: [seed as u32, (seed >> 32) as u32],
            // The first word counts blocks; no stream takes 2^32 of them.
            counter: [0, purpose.observable << 8 | purpose.estimator, low, high],
            left: None,
        }
    }

    /// 64 random bits.
    pub fn bits(&mut self) -> u64 {
        if let Some(bits) = self.left.take() {
            return bits;
        }
        let block = philox(self.counter, self.key);
        self.counter[0] = self.counter[0].wrapping_add(1);
        let [first, second] = [[block[0], block[1]], [block[2], block[3]]]
            .map(|[a, b]| u64::from(b) << 32 | u64::from(a));
        self.left = Some(second);
        first
    }

    /// Uniform in (0, 1): odd multiples of 2^−53.
    pub fn uniform(&mut self) -> f64 {
        let steps = (self.bits() >> 12 << 1) | 1;
        steps as f64 / (1u64 << 53) as f64
    }

    /// Standard normal (Box and Muller 1958).
    fn normal(&mut self) -> f64 {
        let (radius, turn) = (self.uniform(), self.uniform());
        (-2.0 * libm::log(radius)).sqrt() * libm::cos(TAU * turn)
    }

    /// Gamma of shape at least 1 (Marsaglia and Tsang 2000).
    fn gamma(&mut self, shape: f64) -> f64 {
        let d = shape - 1.0 / 3.0;
        let c = 1.0 / (9.0 * d).sqrt();
        loop {
            let x = self.normal();
            let root = 1.0 + c * x;
            if root <= 0.0 {
                continue;
            }
            let v = root * root * root;
            if libm::log(self.uniform()) < 0.5 * x * x + d - d * v + d * libm::log(v) {
                return d * v;
            }
        }
    }

    /// Successes of `trials`, each of probability `p`.
    ///
    /// The `k`-th smallest of `n` uniform numbers has a beta distribution, of parameters `k` and `n + 1 − k`. Of those below it and above it, one
    /// side is all counted or not at all, and the other is a binomial again, half as long (Devroye 1986, section X.4.3).
    pub fn binomial(&mut self, trials: u64, p: f64) -> u64 {
        /// So few are drawn one by one.
        const FEW: u64 = 16;
        let (mut n, mut p, mut successes) = (trials, p.clamp(0.0, 1.0), 0);
        while n > FEW && p > 0.0 && p < 1.0 {
            let k = n.div_ceil(2);
            let (below, above) = (self.gamma(k as f64), self.gamma((n + 1 - k) as f64));
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
        if p <= 0.0 {
            return successes;
        }
        if p >= 1.0 {
            return successes + n;
        }
        successes + (0..n).filter(|_| self.uniform() < p).count() as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ANY: Purpose = Purpose { cell: 5, observable: 1, estimator: 2 };

    #[test]
    fn known_answers() {
        // From the authors' own test vectors.
        let pi = [0x243f_6a88, 0x85a3_08d3, 0x1319_8a2e, 0x0370_7344];
        for (counter, key, answer) in [
            ([0; 4], [0; 2], [0x6627_e8d5, 0xe169_c58d, 0xbc57_ac4c, 0x9b00_dbd8]),
            ([u32::MAX; 4], [u32::MAX; 2], [0x408f_276d, 0x41c8_3b0e, 0xa20b_c7c6, 0x6d54_51fd]),
            (pi, [0xa409_3822, 0x299f_31d0], [0xd16c_fe09, 0x94fd_cceb, 0x5001_e420, 0x2412_6ea1]),
        ] {
            assert_eq!(philox(counter, key), answer);
        }
    }

    #[test]
    fn streams_differ_in_everything_they_are_for() {
        let first = |seed, purpose| Stream::new(seed, purpose).bits();
        let all = [
            first(1, ANY),
            first(2, ANY),
            first(1 << 32, ANY),
            first(1, Purpose { cell: 6, ..ANY }),
            first(1, Purpose { cell: 5 | 1 << 32, ..ANY }),
            first(1, Purpose { observable: 2, ..ANY }),
            first(1, Purpose { estimator: 1, ..ANY }),
        ];
        for (i, a) in all.iter().enumerate() {
            assert!(all[..i].iter().all(|b| a != b));
        }
        assert_eq!(first(1, ANY), all[0]);
    }

    /// χ² of counts against a binomial's probabilities, over the outcomes expected at least 10 times; and how many there are.
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
        for (n, p) in
            [(1_000_000u64, 0.5), (1 << 50, 0.3), (1 << 50, 1e-9), (10_000_000_000, 1.0 - 1e-6)]
        {
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
