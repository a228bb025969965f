//! What passes over velocity lines read and write: a step of a batch of modes, or a product.

use crate::matrix::lanes::Lanes;
use crate::matrix::vector::Vector;
use num_complex::Complex64;
use std::ops::Mul;

/// A number, or a number for each mode, at a node of a line.
pub trait NodeValue: Copy {
    /// Zero.
    fn zero() -> Self;

    /// `self + factor · value`.
    fn plus(self, factor: f64, value: Self) -> Self;
}

impl NodeValue for f64 {
    #[inline(always)]
    fn zero() -> Self {
        0.0
    }

    #[inline(always)]
    fn plus(self, factor: f64, value: Self) -> Self {
        self + factor * value
    }
}

impl NodeValue for Complex64 {
    #[inline(always)]
    fn zero() -> Self {
        Self::ZERO
    }

    #[inline(always)]
    fn plus(self, factor: f64, value: Self) -> Self {
        self + value * factor
    }
}

impl<V: Vector> NodeValue for [V; 2] {
    #[inline(always)]
    fn zero() -> Self {
        [V::splat(0.0); 2]
    }

    #[inline(always)]
    fn plus(self, factor: f64, [re, im]: Self) -> Self {
        let factor = V::splat(factor);
        [self[0].add_product(factor, re), self[1].add_product(factor, im)]
    }
}

/// The terms of the face between two elements: the factor of `r` in the element below and that of
/// `l` in the element above.
#[derive(Clone, Copy)]
pub(super) struct FaceTerms<T> {
    pub(super) below: T,
    pub(super) above: T,
}

/// What a pass over lines reads and writes.
pub(super) trait LinePass {
    type Value: NodeValue;

    /// Whether the vectors have rows below `end`; rows of lines that are within are not checked
    /// again.
    fn is_within(&self, end: usize) -> bool;

    /// The value in a row.
    fn value(&self, row: usize) -> Self::Value;

    /// What `Skew x` contributes.
    #[inline(always)]
    fn skew(&self, sum: Self::Value) -> Self::Value {
        sum
    }

    /// The terms of a face with the trace `below` it, `R₋`, and `above` it, `L`.
    fn face(&self, below: Self::Value, above: Self::Value) -> FaceTerms<Self::Value>;

    /// Adds `g sum` to the result in a row.
    fn add(&mut self, row: usize, sum: Self::Value);
}

/// The step of a batch of modes, `y ← a (−iμS + K) x + y`.
pub(super) struct StepPass<'a, V> {
    pub(super) y: &'a mut [Lanes],
    pub(super) x: &'a [Lanes],
    /// `a g`.
    pub(super) scale: V,
    /// `½ α sign(g) μ`, and minus that.
    pub(super) dissipation: [V; 2],
}

impl<V: Vector> LinePass for StepPass<'_, V> {
    type Value = [V; 2];

    #[inline(always)]
    fn is_within(&self, end: usize) -> bool {
        end <= self.x.len() && end <= self.y.len()
    }

    #[inline(always)]
    fn value(&self, row: usize) -> [V; 2] {
        // SAFETY: lines are within the rows that `add_sized` has checked.
        unsafe { self.x.get_unchecked(row) }.load()
    }

    #[inline(always)]
    fn face(&self, below: [V; 2], above: [V; 2]) -> FaceTerms<[V; 2]> {
        let [re, im] = above.plus(-1.0, below);
        let [plus, minus] = self.dissipation;
        let ([to_re, to_im], zero) = (<[V; 2]>::zero().plus(0.5, above), <[V; 2]>::zero());
        let [from_re, from_im] = zero.plus(-0.5, below);
        FaceTerms {
            below: [to_re.add_product(plus, im), to_im.add_product(minus, re)],
            above: [from_re.add_product(minus, im), from_im.add_product(plus, re)],
        }
    }

    #[inline(always)]
    fn add(&mut self, row: usize, sum: [V; 2]) {
        // SAFETY: as above.
        let y = unsafe { self.y.get_unchecked_mut(row) };
        let [re, im]: [V; 2] = y.load();
        y.store([re.add_product(self.scale, sum[0]), im.add_product(self.scale, sum[1])]);
    }
}

/// The products with real or complex numbers.
pub(super) struct ProductPass<'a, T> {
    pub(super) y: &'a mut [T],
    pub(super) x: &'a [T],
    /// `g`.
    pub(super) rate: f64,
    /// The factor of `K`.
    pub(super) skew: f64,
    /// `½ α sign(g)` times the factor of `S`.
    pub(super) dissipation: T,
}

impl<T: NodeValue + Mul<Output = T>> LinePass for ProductPass<'_, T> {
    type Value = T;

    #[inline(always)]
    fn is_within(&self, end: usize) -> bool {
        end <= self.x.len() && end <= self.y.len()
    }

    #[inline(always)]
    fn value(&self, row: usize) -> T {
        self.x[row]
    }

    #[inline(always)]
    fn skew(&self, sum: T) -> T {
        T::zero().plus(self.skew, sum)
    }

    #[inline(always)]
    fn face(&self, below: T, above: T) -> FaceTerms<T> {
        let jump = self.dissipation * above.plus(-1.0, below);
        FaceTerms {
            below: jump.plus(0.5 * self.skew, above),
            above: T::zero().plus(-1.0, jump.plus(0.5 * self.skew, below)),
        }
    }

    #[inline(always)]
    fn add(&mut self, row: usize, sum: T) {
        self.y[row] = self.y[row].plus(self.rate, sum);
    }
}

/// The factors of `S` and `K` in a product.
#[derive(Clone, Copy, Debug)]
pub struct ProductFactors<T> {
    /// Factor of `S`.
    pub s: T,
    /// Factor of `K`.
    pub k: f64,
}
