//! Uniform random numbers, and numbers that are spread evenly without chance.

use rand_chacha::rand_core::Rng;

/// The fractional part of `k` times the golden ratio. Those of the first few `k`, however many,
/// fill `[0, 1)` evenly.
pub fn evenly_spread(k: usize) -> f64 {
    const GOLDEN: f64 = 1.618_033_988_749_895;
    (k as f64 * GOLDEN).fract()
}

/// A number below `count`, spread like [`evenly_spread`], exactly for any `count`.
pub fn evenly_spread_index(k: usize, count: usize) -> usize {
    const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;
    let part = u128::from((k as u64).wrapping_mul(GOLDEN));
    ((part * count as u128) >> 64) as usize
}

/// A number of 53 random bits, uniform in `[0, 1)`.
pub fn uniform(random: &mut impl Rng) -> f64 {
    (random.next_u64() >> 11) as f64 / (1u64 << 53) as f64
}
