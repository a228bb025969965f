//! Vectors with a number for each mode of a batch, in registers.
//!
//! Automatic vectorisation of loops over lanes fails when several rows are summed at once: the
//! compiler shuffles registers, which is three times as slow for elements of degree 1. So there are
//! explicit vectors for each instruction set.

#[cfg(target_arch = "x86_64")]
use std::arch::x86_64::{
    __m256d, __m512d, _mm256_fmadd_pd, _mm256_loadu_pd, _mm256_set1_pd, _mm256_storeu_pd,
    _mm512_fmadd_pd, _mm512_loadu_pd, _mm512_set1_pd, _mm512_storeu_pd,
};

/// Modes in a batch, `B`.
pub const LANES: usize = 8;

/// `a b + c`, rounded once if `FMA` is set.
#[inline(always)]
pub(crate) fn multiply_add<const FMA: bool>(a: f64, b: f64, c: f64) -> f64 {
    if FMA { a.mul_add(b, c) } else { a * b + c }
}

/// A number for each mode of a batch.
pub trait Vector: Copy {
    /// A vector with one number in every lane.
    fn splat(value: f64) -> Self;

    /// Loads from memory.
    fn load(from: &[f64; LANES]) -> Self;

    /// Stores to memory.
    fn store(self, to: &mut [f64; LANES]);

    /// `self + a b`, lane by lane.
    fn add_product(self, a: Self, b: Self) -> Self;
}

/// A vector for any processor, with fused multiply-add if `FMA` is set.
#[derive(Clone, Copy)]
pub struct Portable<const FMA: bool>([f64; LANES]);

impl<const FMA: bool> Vector for Portable<FMA> {
    #[inline(always)]
    fn splat(value: f64) -> Self {
        Self([value; LANES])
    }

    #[inline(always)]
    fn load(from: &[f64; LANES]) -> Self {
        Self(*from)
    }

    #[inline(always)]
    fn store(self, to: &mut [f64; LANES]) {
        *to = self.0;
    }

    #[inline(always)]
    fn add_product(self, a: Self, b: Self) -> Self {
        Self(std::array::from_fn(|l| multiply_add::<FMA>(a.0[l], b.0[l], self.0[l])))
    }
}

/// One register of AVX-512; only for functions that are compiled for it.
#[cfg(target_arch = "x86_64")]
#[derive(Clone, Copy)]
pub(crate) struct Avx512(__m512d);

// SAFETY of all that follows: loads and stores access whole arrays. The processor has the
// instructions, as `kernel` uses these types only in functions that it calls after it has checked
// this.
#[cfg(target_arch = "x86_64")]
impl Vector for Avx512 {
    #[inline(always)]
    fn splat(value: f64) -> Self {
        // SAFETY: see above.
        Self(unsafe { _mm512_set1_pd(value) })
    }

    #[inline(always)]
    fn load(from: &[f64; LANES]) -> Self {
        // SAFETY: see above.
        Self(unsafe { _mm512_loadu_pd(from.as_ptr()) })
    }

    #[inline(always)]
    fn store(self, to: &mut [f64; LANES]) {
        // SAFETY: see above.
        unsafe { _mm512_storeu_pd(to.as_mut_ptr(), self.0) }
    }

    #[inline(always)]
    fn add_product(self, a: Self, b: Self) -> Self {
        // SAFETY: see above.
        Self(unsafe { _mm512_fmadd_pd(a.0, b.0, self.0) })
    }
}

/// Two registers of AVX2; only for functions that are compiled for it and for FMA.
#[cfg(target_arch = "x86_64")]
#[derive(Clone, Copy)]
pub(crate) struct Avx2([__m256d; 2]);

#[cfg(target_arch = "x86_64")]
impl Vector for Avx2 {
    #[inline(always)]
    fn splat(value: f64) -> Self {
        // SAFETY: see above.
        Self([unsafe { _mm256_set1_pd(value) }; 2])
    }

    #[inline(always)]
    fn load(from: &[f64; LANES]) -> Self {
        let (halves, _) = from.as_chunks::<{ LANES / 2 }>();
        // SAFETY: see above.
        Self([0, 1].map(|half| unsafe { _mm256_loadu_pd(halves[half].as_ptr()) }))
    }

    #[inline(always)]
    fn store(self, to: &mut [f64; LANES]) {
        let (halves, _) = to.as_chunks_mut::<{ LANES / 2 }>();
        for (half, register) in halves.iter_mut().zip(self.0) {
            // SAFETY: see above.
            unsafe { _mm256_storeu_pd(half.as_mut_ptr(), register) }
        }
    }

    #[inline(always)]
    fn add_product(self, a: Self, b: Self) -> Self {
        // SAFETY: see above.
        Self([0, 1].map(|half| unsafe { _mm256_fmadd_pd(a.0[half], b.0[half], self.0[half]) }))
    }
}
