//! Reads a term of a series that is summed forwards: adds it to the sum of the terms, and its
//! moments to those at several times.
//!
//! Like the steps of [`kernel`](crate::matrix::kernel), this is compiled for each instruction set.

use crate::matrix::instruction_set::{InstructionSet, Vectorized};
use crate::matrix::lanes::{LANES, Lanes};
use crate::matrix::observables::MOMENTS;
use crate::matrix::vector::{Vector, multiply_add};
use std::ops::Range;

/// The readings of a term on some rows: whole points of space, then perhaps auxiliary unknowns.
pub struct TermRows<'a> {
    /// The term.
    pub term: &'a [Lanes],
    /// Factor of the term in the sum.
    pub coefficient: &'a [f64; LANES],
    /// The sum.
    pub sum: &'a mut [Lanes],
    /// `1/√π` of the cells among these rows.
    pub scales: &'a [f64],
    /// The contribution of a velocity cell to each moment, per unit of `f`.
    pub factors: &'a [[f64; MOMENTS]],
    /// Dimensions of space.
    pub dimension: usize,
    /// Number of times with moments.
    pub times: usize,
    /// The times to whose moments the term adds.
    pub active: Range<usize>,
    /// Factors of the term at each of these times: real parts, then imaginary parts.
    pub weights: &'a [[f64; 2 * LANES]],
    /// The moments, by point, time and moment (density, momenta, energy).
    pub values: &'a mut [[f64; LANES]],
}

impl Vectorized for TermRows<'_> {
    #[inline(always)]
    fn run<V: Vector, const FMA: bool, const ROWS: usize, const WHOLE: bool>(self) {
        match self.dimension {
            1 => read_some::<FMA, 3>(self),
            2 => read_some::<FMA, 4>(self),
            _ => read_some::<FMA, 5>(self),
        }
    }
}

impl TermRows<'_> {
    /// Reads the term.
    pub fn read(self) {
        InstructionSet::here().run(self);
    }
}

/// Adds the term to the sum, and its `COUNT` moments to those at the active times.
#[inline(always)]
fn read_some<const FMA: bool, const COUNT: usize>(rows: TermRows<'_>) {
    let TermRows {
        term, coefficient, sum, scales, factors, times, active, weights, values, ..
    } = rows;
    let coefficients: [f64; 2 * LANES] = std::array::from_fn(|part| coefficient[part % LANES]);
    let nv = factors.len();
    let points = values.chunks_exact_mut(times * COUNT).zip(scales.chunks_exact(nv));
    for (point, (values, scales)) in points.enumerate() {
        let here = point * nv..(point + 1) * nv;
        let mut moments = [[0.0; 2 * LANES]; COUNT];
        let cells = term[here.clone()].iter().zip(&mut sum[here]).zip(scales).zip(factors);
        for (((Lanes(row), Lanes(sum)), scale), factors) in cells {
            for m in 0..COUNT {
                let factor = scale * factors[if m + 1 < COUNT { m } else { MOMENTS - 1 }];
                for part in 0..2 * LANES {
                    moments[m][part] = multiply_add::<FMA>(factor, row[part], moments[m][part]);
                }
            }
            *sum = added::<FMA>(&coefficients, row, sum);
        }
        let values = &mut values[active.start * COUNT..active.end * COUNT];
        let (values, _) = values.as_chunks_mut::<COUNT>();
        for (values, weights) in values.iter_mut().zip(weights) {
            // The black box keeps the compiler from vectorising over times, which takes six times
            // as long.
            let mut new: [[f64; LANES]; COUNT] = *std::hint::black_box(&*values);
            for (new, moments) in new.iter_mut().zip(&moments) {
                for l in 0..LANES {
                    new[l] = multiply_add::<FMA>(weights[l], moments[l], new[l]);
                }
                for l in 0..LANES {
                    new[l] = multiply_add::<FMA>(weights[LANES + l], moments[LANES + l], new[l]);
                }
            }
            *values = new;
        }
    }
    for (Lanes(row), Lanes(sum)) in term.iter().zip(sum).skip(scales.len()) {
        *sum = added::<FMA>(&coefficients, row, sum);
    }
}

/// `sum` plus `coefficients` times a row of a term.
#[inline(always)]
fn added<const FMA: bool>(
    coefficients: &[f64; 2 * LANES],
    row: &[f64; 2 * LANES],
    sum: &[f64; 2 * LANES],
) -> [f64; 2 * LANES] {
    let mut new = *sum;
    for part in 0..2 * LANES {
        new[part] = multiply_add::<FMA>(coefficients[part], row[part], new[part]);
    }
    new
}
