//! The inner loop: one step of a Chebyshev or Lanczos recurrence for a batch of modes, in one pass over the matrix.
//!
//! ```text
//! y   ← a ((−iμ S + K) x + i c x) + y        per lane: a = scale, c = shift, μ = wavenumber
//! sum ← sum + coefficient · y               where the step adds up a series
//! ```
//!
//! Vectors are `[row][re: B lanes][im: B lanes]`: every operation is vertical over modes. The same loop is compiled
//! three times, for AVX-512, for AVX2 with FMA and for any processor; which one runs is decided once at start.

use super::BlockMatrix;
use crate::communicator::VectorRow;
use std::ops::Range;

/// Modes in a batch, `B`.
pub const LANES: usize = 8;

/// A row of a batch vector: real parts, then imaginary parts.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(64))]
pub struct Lanes(pub [f64; 2 * LANES]);

impl Lanes {
    /// All zero.
    pub const ZERO: Lanes = Lanes([0.0; 2 * LANES]);
}

impl VectorRow for Lanes {
    const WIDTH: usize = 2 * LANES;
    fn numbers(&self) -> &[f64] {
        &self.0
    }
    fn numbers_mut(&mut self) -> &mut [f64] {
        &mut self.0
    }
}

/// What a step needs besides the matrix, per lane.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub struct StepConstants {
    /// `a`.
    pub scale: [f64; LANES],
    /// `c`, the centre of the spectral interval.
    pub shift: [f64; LANES],
    /// `μ`.
    pub wavenumber: [f64; LANES],
    /// What of the new vector is added to the sum.
    pub coefficient: [f64; LANES],
}

#[inline(always)]
fn multiply_add<const FMA: bool>(a: f64, b: f64, c: f64) -> f64 {
    if FMA { a.mul_add(b, c) } else { a * b + c }
}

/// The loop over rows. `FMA` only where the processor has it: elsewhere `mul_add` is a slow library call. Without `SUM`
/// nothing is added up, and `sum` may be empty.
#[inline(always)]
fn step_rows<const FMA: bool, const SUM: bool>(
    matrix: &BlockMatrix,
    rows: Range<usize>,
    constants: &StepConstants,
    y: &mut [Lanes],
    x: &[Lanes],
    sum: &mut [Lanes],
) {
    for i in rows {
        // Re and Im of S x and K x.
        let (mut sr, mut si) = ([0.0; LANES], [0.0; LANES]);
        let (mut kr, mut ki) = ([0.0; LANES], [0.0; LANES]);
        for (column, s, k) in matrix.rows.row(i) {
            // SAFETY: every column is below the length of the matrix, see `BlockMatrix::new`, which `step` asserts `x` has.
            let value = unsafe { &x.get_unchecked(column).0 };
            for l in 0..LANES {
                sr[l] = multiply_add::<FMA>(s, value[l], sr[l]);
                si[l] = multiply_add::<FMA>(s, value[LANES + l], si[l]);
                kr[l] = multiply_add::<FMA>(k, value[l], kr[l]);
                ki[l] = multiply_add::<FMA>(k, value[LANES + l], ki[l]);
            }
        }
        let own = &x[i].0;
        let out = &mut y[i].0;
        for l in 0..LANES {
            let (a, c, mu) = (
                constants.scale[l],
                constants.shift[l],
                constants.wavenumber[l],
            );
            // (−iμ S + K + ic)(re + i im) = (μ S im + K re − c im) + i(−μ S re + K im + c re)
            let re = multiply_add::<FMA>(mu, si[l], kr[l]);
            let im = multiply_add::<FMA>(-mu, sr[l], ki[l]);
            let re = multiply_add::<FMA>(-c, own[LANES + l], re);
            let im = multiply_add::<FMA>(c, own[l], im);
            let re = multiply_add::<FMA>(a, re, out[l]);
            let im = multiply_add::<FMA>(a, im, out[LANES + l]);
            out[l] = re;
            out[LANES + l] = im;
        }
        if SUM {
            let total = &mut sum[i].0;
            for l in 0..LANES {
                let coefficient = constants.coefficient[l];
                total[l] = multiply_add::<FMA>(coefficient, out[l], total[l]);
                total[LANES + l] =
                    multiply_add::<FMA>(coefficient, out[LANES + l], total[LANES + l]);
            }
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f")]
fn step_avx512<const SUM: bool>(
    matrix: &BlockMatrix,
    rows: Range<usize>,
    constants: &StepConstants,
    y: &mut [Lanes],
    x: &[Lanes],
    sum: &mut [Lanes],
) {
    step_rows::<true, SUM>(matrix, rows, constants, y, x, sum);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn step_avx2<const SUM: bool>(
    matrix: &BlockMatrix,
    rows: Range<usize>,
    constants: &StepConstants,
    y: &mut [Lanes],
    x: &[Lanes],
    sum: &mut [Lanes],
) {
    step_rows::<true, SUM>(matrix, rows, constants, y, x, sum);
}

/// Name of the instruction set the loop runs with here.
pub fn instruction_set() -> &'static str {
    #[cfg(target_arch = "x86_64")]
    {
        if std::is_x86_feature_detected!("avx512f") {
            return "avx512";
        }
        if std::is_x86_feature_detected!("avx2") && std::is_x86_feature_detected!("fma") {
            return "avx2";
        }
    }
    if cfg!(target_arch = "aarch64") {
        "neon"
    } else {
        "generic"
    }
}

/// Steps the rows of `runs`; without `SUM` nothing is added to `sum`, which may be empty.
pub fn step<const SUM: bool>(
    matrix: &BlockMatrix,
    runs: &[Range<usize>],
    constants: &StepConstants,
    y: &mut [Lanes],
    x: &[Lanes],
    sum: &mut [Lanes],
) {
    assert!(x.len() == matrix.length(), "vector and matrix do not fit");
    for rows in runs.iter().cloned() {
        #[cfg(target_arch = "x86_64")]
        match instruction_set() {
            // SAFETY: the processor was asked.
            "avx512" => unsafe { step_avx512::<SUM>(matrix, rows, constants, y, x, sum) },
            "avx2" => unsafe { step_avx2::<SUM>(matrix, rows, constants, y, x, sum) },
            _ => step_rows::<false, SUM>(matrix, rows, constants, y, x, sum),
        }
        // Every aarch64 processor has fused multiply-add.
        #[cfg(not(target_arch = "x86_64"))]
        step_rows::<{ cfg!(target_arch = "aarch64") }, SUM>(matrix, rows, constants, y, x, sum);
    }
}
