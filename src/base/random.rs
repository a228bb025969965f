//! Uniform random numbers.

use rand_chacha::rand_core::Rng;

/// A number of 53 random bits, uniform in `[0, 1)`.
pub fn uniform(random: &mut impl Rng) -> f64 {
    (random.next_u64() >> 11) as f64 / (1u64 << 53) as f64
}
