//! Sums that do not depend on order, hence neither on the number of ranks nor on the process mesh.
//!
//! Every term is split into two fixed-point integers relative to a bound known beforehand. Integers
//! add exactly in any order. Each of the two keeps `BITS` bits of a term, fewer where there are so
//! many terms that their sum would overflow: the sum of up to a thousand terms is exact but for
//! `2^-100` of the bound a term.

/// Most bits of a part: less than the digits of a double, so that one addition rounds and converts.
const BITS: i32 = 51;

/// `1.5 · 2^52`. Added to it, a number of magnitude up to `2^51` is rounded to an integer, ties to
/// even, which is then in the last bits of the sum (Dekker 1971).
const MAGIC: f64 = 6755399441055744.0;

/// The fixed-point representation for at most `count` terms of magnitude at most `bound`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FixedPoint {
    coarse: f64,
    fine: f64,
}

/// The larger number; NaN if one is. Without a branch, for vector operations.
#[inline(always)]
pub fn larger(a: f64, b: f64) -> f64 {
    if b > a || b.is_nan() { b } else { a }
}

impl FixedPoint {
    /// A representation for `count` terms of magnitude at most `bound` (finite, not negative).
    pub fn new(bound: f64, count: usize) -> Self {
        let room = (count.max(1) as f64).log2().ceil() as i32 + 1;
        let bits = BITS.min(61 - room);
        let exponent = if bound > 0.0 { bound.log2().ceil() as i32 } else { 0 };
        // Kept within the exponents of normal numbers, so that scaling is exact.
        Self { coarse: 2f64.powi((bits - exponent).clamp(-1000, 1000)), fine: 2f64.powi(bits + 1) }
    }

    /// The two integers of `x`; without branches, calls and conversions, so that loops over it are
    /// vectorised on any processor.
    #[inline(always)]
    pub fn split(&self, x: f64) -> [i64; 2] {
        let scaled = x * self.coarse;
        let shifted = scaled + MAGIC;
        let rest = (scaled - (shifted - MAGIC)) * self.fine;
        [shifted, rest + MAGIC].map(|y| (y.to_bits() as i64).wrapping_sub(MAGIC.to_bits() as i64))
    }

    /// The number that two summed integers stand for.
    pub fn join(&self, [coarse, fine]: [i64; 2]) -> f64 {
        // Cut so that every partial result is exact until the last addition.
        let high = (coarse >> 32) as f64 * 4294967296.0;
        let low = (coarse & 0xffff_ffff) as f64 + fine as f64 / self.fine;
        // Adding zero turns a negative zero into a positive one.
        (high + low) / self.coarse + 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn order_does_not_matter_and_the_sum_is_right(
            mut terms in prop::collection::vec(-1.0e3..1.0e3f64, 1..300),
            scale in -200i32..200,
            turn in 0usize..300,
        ) {
            let unit = 2f64.powi(scale);
            for t in &mut terms { *t *= unit; }
            let fixed = FixedPoint::new(1e3 * unit, terms.len());
            let sum = |list: &[f64]| {
                let mut total = [0i64; 2];
                for &t in list {
                    let s = fixed.split(t);
                    total = [total[0] + s[0], total[1] + s[1]];
                }
                fixed.join(total)
            };
            let first = sum(&terms);
            let len = terms.len();
            terms.rotate_left(turn % len);
            prop_assert_eq!(first.to_bits(), sum(&terms).to_bits());
            let plain: f64 = terms.iter().sum();
            prop_assert!((first - plain).abs() <= 1e-10 * unit * 1e3);
        }
    }

    #[test]
    fn small_terms_beside_large_ones_are_kept() {
        let fixed = FixedPoint::new(1.0, 1 << 20);
        let mut total = [0i64; 2];
        for x in [1.0, 1e-20, -1.0, 3e-20] {
            let s = fixed.split(x);
            total = [total[0] + s[0], total[1] + s[1]];
        }
        assert!((fixed.join(total) - 4e-20).abs() < 1e-22);
    }

    #[test]
    fn extremes() {
        for bound in [0.0, 1e-300, 1e300] {
            let fixed = FixedPoint::new(bound, 10);
            let x = 0.7 * bound;
            assert!((fixed.join(fixed.split(x)) - x).abs() <= 1e-15 * bound);
        }
    }
}
