//! The couplings of the elements of a velocity line.

use crate::matrix::velocity_lines::pass::{FaceTerms, LinePass, NodeValue};
use crate::problem::grid::Axis;
use std::ops::Range;

/// The matrices of the reference element in the weighted unknowns.
#[derive(Clone, Debug)]
pub(super) struct LineElement {
    pub(super) nodes: usize,
    /// `Skew`, column by column.
    pub(super) skew: Vec<f64>,
    /// `l`.
    pub(super) left: Vec<f64>,
    /// `r`.
    pub(super) right: Vec<f64>,
    /// Largest absolute value of a coupling of rate 1.
    pub(super) largest: f64,
}

impl LineElement {
    pub(super) fn new(axis: &Axis) -> Self {
        let (reference, nodes) = (axis.nodes.reference(), axis.nodes.count());
        let root = |m: usize| reference.weights[m].sqrt();
        let derivative = |m: usize, n: usize| root(m) * reference.derivative[m][n] / root(n);
        let skew = |m: usize, n: usize| 0.5 * (derivative(m, n) - derivative(n, m));
        let over_root = |values: &[f64]| -> Vec<f64> {
            values.iter().enumerate().map(|(m, value)| value / root(m)).collect()
        };
        let (left, right) = (over_root(&reference.left), over_root(&reference.right));
        let skew: Vec<f64> = (0..nodes * nodes).map(|c| skew(c % nodes, c / nodes)).collect();
        let most = |list: &[f64]| list.iter().fold(0.0, |most, c: &f64| f64::max(most, c.abs()));
        let largest = most(&skew).max(most(&left).powi(2)).max(most(&right).powi(2));
        Self { nodes, skew, left, right, largest }
    }

    /// This element with lengths that the compiler knows.
    #[inline(always)]
    pub(super) fn sized<const NODES: usize>(&self) -> SizedElement<'_, NODES> {
        let (columns, _) = self.skew.as_chunks::<NODES>();
        let array = |values| -> &[f64; NODES] { <&[f64; NODES]>::try_from(values).expect("sized") };
        SizedElement {
            skew: columns.try_into().expect("a column for each node"),
            left: array(&self.left[..]),
            right: array(&self.right[..]),
        }
    }
}

/// A [`LineElement`] of `NODES` nodes.
#[derive(Clone, Copy)]
pub(super) struct SizedElement<'a, const NODES: usize> {
    skew: &'a [[f64; NODES]; NODES],
    left: &'a [f64; NODES],
    right: &'a [f64; NODES],
}

impl<const NODES: usize> SizedElement<'_, NODES> {
    /// The trace with the values `of` the polynomials in the element that begins with row `first`.
    #[inline(always)]
    fn trace<P: LinePass>(of: &[f64; NODES], pass: &P, first: usize, stride: usize) -> P::Value {
        let mut sum = P::Value::zero();
        for (n, factor) in of.iter().enumerate() {
            sum = sum.plus(*factor, pass.value(first + n * stride));
        }
        sum
    }

    /// The terms of the face below an element, zero at the ends of the line.
    #[inline(always)]
    fn face_below<P: LinePass>(
        self,
        element: usize,
        line: &LineRows,
        pass: &P,
    ) -> FaceTerms<P::Value> {
        if element == 0 || element == line.elements {
            return FaceTerms { below: P::Value::zero(), above: P::Value::zero() };
        }
        let first = line.first + element * NODES * line.stride;
        let below = Self::trace(self.right, pass, first - NODES * line.stride, line.stride);
        pass.face(below, Self::trace(self.left, pass, first, line.stride))
    }

    /// Adds the couplings of `COUNT` rows of an element, from its node `from` on.
    #[inline(always)]
    fn add_rows<P: LinePass, const COUNT: usize>(
        self,
        from: usize,
        rows: &ElementRows<P::Value>,
        pass: &mut P,
    ) {
        let &ElementRows { first, stride, lower, upper } = rows;
        let mut sums = [P::Value::zero(); COUNT];
        for n in 0..NODES {
            let value = pass.value(first + n * stride);
            for m in 0..COUNT {
                sums[m] = sums[m].plus(self.skew[n][from + m], value);
            }
        }
        for m in 0..COUNT {
            let node = from + m;
            let sum = pass.skew(sums[m]).plus(self.right[node], upper);
            pass.add(first + node * stride, sum.plus(self.left[node], lower));
        }
    }

    /// Adds the couplings of some elements of a line, `ROWS` rows at a time, or all rows of an
    /// element if `WHOLE`.
    #[inline(always)]
    pub(super) fn add_line<P: LinePass, const ROWS: usize, const WHOLE: bool>(
        self,
        line: &LineRows,
        pass: &mut P,
    ) {
        let &LineRows { first, stride, ref wanted, .. } = line;
        let mut lower = self.face_below(wanted.start, line, pass);
        for element in wanted.clone() {
            let upper = self.face_below(element + 1, line, pass);
            let rows = ElementRows {
                first: first + element * NODES * stride,
                stride,
                lower: lower.above,
                upper: upper.below,
            };
            if WHOLE {
                self.add_rows::<P, NODES>(0, &rows, pass);
            } else {
                let whole = NODES / ROWS * ROWS;
                for from in (0..whole).step_by(ROWS) {
                    self.add_rows::<P, ROWS>(from, &rows, pass);
                }
                for from in whole..NODES {
                    self.add_rows::<P, 1>(from, &rows, pass);
                }
            }
            lower = upper;
        }
    }
}

/// The rows of an element, and the terms of its faces.
struct ElementRows<T> {
    first: usize,
    stride: usize,
    /// Factor of `l`.
    lower: T,
    /// Factor of `r`.
    upper: T,
}

/// The rows of a line.
pub(super) struct LineRows {
    pub(super) first: usize,
    pub(super) stride: usize,
    pub(super) elements: usize,
    /// The elements whose rows are wanted.
    pub(super) wanted: Range<usize>,
}
