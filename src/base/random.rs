//! Uniform random numbers, and numbers that are spread evenly without chance.

use rand_chacha::rand_core::Rng;

/// The fractional part of `k` times the golden ratio. Those of the first few `k`, however many,
/// fill `[0, 1)` evenly.
pub fn evenly_spread(k: usize) -> f64 {
    const GOLDEN: f64 = 1.618_033_988_749_895;
    (k as f64 * GOLDEN).fract()
}

/// A number of 53 random bits, uniform in `[0, 1)`.
pub fn uniform(random: &mut impl Rng) -> f64 {
    (random.next_u64() >> 11) as f64 / (1u64 << 53) as f64
}
