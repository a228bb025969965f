//! A pass over two terms of a series that is summed forwards: into the sum of the terms, and their
//! moments into those at several times.
//!
//! As the steps of [`kernel`](crate::matrix::kernel), compiled for each instruction set.

use crate::matrix::kernel::InstructionSet;
use crate::matrix::lanes::{LANES, Lanes, multiply_add};
use crate::matrix::observables::MOMENTS;
use std::ops::Range;

/// What both terms of a pass are multiplied by at a time: parts that multiply the real parts of
/// the lanes, then those that multiply the imaginary parts.
pub type TermWeights = [[f64; 2 * LANES]; 2];

/// What a pass reads and writes.
pub struct TermPass<'a> {
    /// Both terms, on the rows.
    pub terms: [&'a [Lanes]; 2],
    /// What they are multiplied by in the sum.
    pub coefficients: [[f64; LANES]; 2],
    /// The sum, on the rows.
    pub sum: &'a mut [Lanes],
    /// `1/√π` of the cells.
    pub scales: &'a [f64],
    /// What a velocity cell adds to each moment, for each unit of `f` in it.
    pub factors: &'a [[f64; MOMENTS]],
    /// Dimensions of space.
    pub dimension: usize,
    /// At how many times there are moments.
    pub times: usize,
    /// Those to which these terms still add.
    pub active: Range<usize>,
    /// What the terms are multiplied by at each of these.
    pub weights: &'a [TermWeights],
    /// The moments by point of space, time, and moment: density, momenta, energy.
    pub values: &'a mut [[f64; LANES]],
}

impl TermPass<'_> {
    /// Does the pass.
    pub fn run(self) {
        match InstructionSet::here() {
            // SAFETY: the processor was asked.
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx512 => unsafe { avx512(self) },
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx2 => unsafe { avx2(self) },
            _ => pass::<{ cfg!(target_arch = "aarch64") }>(self),
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f")]
fn avx512(terms: TermPass<'_>) {
    pass::<true>(terms);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn avx2(terms: TermPass<'_>) {
    pass::<true>(terms);
}

#[inline(always)]
fn pass<const FMA: bool>(terms: TermPass<'_>) {
    match terms.dimension {
        1 => pass_of::<FMA, 3>(terms),
        2 => pass_of::<FMA, 4>(terms),
        _ => pass_of::<FMA, 5>(terms),
    }
}

/// The pass for `COUNT` moments.
#[inline(always)]
fn pass_of<const FMA: bool, const COUNT: usize>(pass: TermPass<'_>) {
    let TermPass {
        terms, coefficients, sum, scales, factors, times, active, weights, values, ..
    } = pass;
    let (nv, cells) = (factors.len(), scales.len());
    let points = values.chunks_exact_mut(times * COUNT);
    for (point, values) in points.enumerate().take(cells / nv) {
        let rows = point * nv..(point + 1) * nv;
        let [first, second] = terms.map(|term| &term[rows.clone()]);
        let mut moments = [[[0.0; 2 * LANES]; COUNT]; 2];
        let cells = first.iter().zip(second).zip(&mut sum[rows.clone()]);
        for ((cells, scale), factors) in cells.zip(&scales[rows]).zip(factors) {
            let ((Lanes(first), Lanes(second)), Lanes(sum)) = cells;
            add_terms::<FMA>(&coefficients, [first, second], sum);
            for m in 0..COUNT {
                // The energy is the last.
                let factor = scale * factors[if m + 1 < COUNT { m } else { MOMENTS - 1 }];
                for part in 0..2 * LANES {
                    moments[0][m][part] =
                        multiply_add::<FMA>(factor, first[part], moments[0][m][part]);
                    moments[1][m][part] =
                        multiply_add::<FMA>(factor, second[part], moments[1][m][part]);
                }
            }
        }
        let values = &mut values[active.start * COUNT..active.end * COUNT];
        for (values, weights) in values.chunks_exact_mut(COUNT).zip(weights) {
            for (m, value) in values.iter_mut().enumerate() {
                for (weights, moments) in weights.iter().zip(&moments) {
                    for l in 0..LANES {
                        let (re, im) = (weights[l], weights[LANES + l]);
                        value[l] = multiply_add::<FMA>(re, moments[m][l], value[l]);
                        value[l] = multiply_add::<FMA>(im, moments[m][LANES + l], value[l]);
                    }
                }
            }
        }
    }
    for (i, Lanes(sum)) in sum.iter_mut().enumerate().skip(cells) {
        add_terms::<FMA>(&coefficients, terms.map(|term| &term[i].0), sum);
    }
}

/// Adds both terms of a row to its sum.
#[inline(always)]
fn add_terms<const FMA: bool>(
    coefficients: &[[f64; LANES]; 2],
    terms: [&[f64; 2 * LANES]; 2],
    sum: &mut [f64; 2 * LANES],
) {
    for (coefficient, term) in coefficients.iter().zip(terms) {
        for part in 0..2 * LANES {
            sum[part] = multiply_add::<FMA>(coefficient[part % LANES], term[part], sum[part]);
        }
    }
}
