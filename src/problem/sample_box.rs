//! Boxes in phase space and quasi-random sequences, at whose points formulas are sampled.

use crate::base::random::uniform;
use crate::problem::case::Case;
use crate::problem::grid::{AxisEnd, MAX_DIMENSION, PhaseSpace};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

/// The largest number of coordinates of a point: those of phase space. For an end of an axis, time
/// replaces that axis.
pub const MOST_DIMENSIONS: usize = 2 * MAX_DIMENSION;

/// A point by its coordinates along the axes; those beyond their number are 0.
pub type SamplePoint = [f64; MOST_DIMENSIONS];

/// A box in phase space, by its ends along the `2n` axes.
#[derive(Clone, Debug, PartialEq)]
pub struct SampleBox {
    /// Lower ends.
    pub lower: Vec<f64>,
    /// Upper ends.
    pub upper: Vec<f64>,
}

impl SampleBox {
    /// The whole of `space`, with the velocities extended on each side by the fraction `margin` of
    /// their width.
    pub fn whole(space: &PhaseSpace, margin: f64) -> Self {
        let n = space.dimension();
        let part = |a: usize| if a < n { 0.0 } else { margin };
        let axes = || space.axes().enumerate();
        Self {
            lower: axes().map(|(a, x)| x.lower - part(a) * (x.upper - x.lower)).collect(),
            upper: axes().map(|(a, x)| x.upper + part(a) * (x.upper - x.lower)).collect(),
        }
    }

    /// The points at which particles enter through an `end` of the box: the time takes the place of
    /// its axis.
    pub fn of_inflow(case: &Case, end: AxisEnd) -> Self {
        let mut found = Self::whole(&case.space, 0.0);
        (found.lower[end.axis], found.upper[end.axis]) = (0.0, case.end);
        found
    }

    /// The place of the point `unit` of the unit cube, along the first `dimensions` axes.
    pub fn at(&self, unit: &SamplePoint, dimensions: usize) -> SamplePoint {
        let mut place = [0.0; MOST_DIMENSIONS];
        for (a, at) in place.iter_mut().enumerate().take(dimensions) {
            *at = self.lower[a] + unit[a] * (self.upper[a] - self.lower[a]);
        }
        place
    }

    /// The centre of the box.
    pub fn centre(&self) -> SamplePoint {
        self.at(&[0.5; MOST_DIMENSIONS], self.lower.len())
    }

    /// The halves of the box along an axis.
    pub fn halves(&self, axis: usize) -> [Self; 2] {
        let middle = 0.5 * (self.lower[axis] + self.upper[axis]);
        let (mut below, mut above) = (self.clone(), self.clone());
        (below.upper[axis], above.lower[axis]) = (middle, middle);
        [below, above]
    }

    /// `∏ (upper − lower)` over the axes for which `counts` is true.
    pub fn volume(&self, counts: impl Fn(usize) -> bool) -> f64 {
        (0..self.lower.len()).filter(|a| counts(*a)).map(|a| self.width(a)).product()
    }

    fn width(&self, axis: usize) -> f64 {
        self.upper[axis] - self.lower[axis]
    }
}

/// The place of a box among equal ones, in widths of a box along each axis.
type BoxNumber = [i32; MOST_DIMENSIONS];

/// Equal boxes of a regular grid.
#[derive(Clone, Debug)]
pub struct BoxSet {
    /// Lower ends of the box with the number 0.
    lower: Vec<f64>,
    /// Widths of a box.
    widths: Vec<f64>,
    /// The numbers of the boxes, in order.
    numbers: Vec<BoxNumber>,
}

impl From<SampleBox> for BoxSet {
    fn from(own: SampleBox) -> Self {
        let widths = (0..own.lower.len()).map(|a| own.width(a)).collect();
        Self { lower: own.lower, widths, numbers: vec![[0; MOST_DIMENSIONS]] }
    }
}

impl BoxSet {
    /// Equal parts of the box `whole`, in sets of those that touch, on their faces at least.
    pub fn connected(boxes: &[SampleBox], whole: &SampleBox) -> Vec<Self> {
        let Some(first) = boxes.first() else { return Vec::new() };
        // The width of one box is rounded: the others' numbers would not be whole.
        let width = |a: usize| whole.width(a) / (whole.width(a) / first.width(a)).round();
        let grid = Self {
            lower: whole.lower.clone(),
            widths: (0..whole.lower.len()).map(width).collect(),
            numbers: Vec::new(),
        };
        let number = |own: &SampleBox| grid.number(&own.centre(), own.lower.len());
        let mut left: Vec<BoxNumber> = boxes.iter().map(number).collect();
        let mut sets = Vec::new();
        while let Some(first) = left.pop() {
            let mut numbers = vec![first];
            let mut next = 0;
            while let Some(own) = numbers.get(next).copied() {
                let touches = |other: &BoxNumber| {
                    own.iter().zip(other).all(|(own, other)| own.abs_diff(*other) <= 1)
                };
                numbers.extend(left.extract_if(.., |other| touches(other)));
                next += 1;
            }
            numbers.sort_unstable();
            sets.push(Self { numbers, ..grid.clone() });
        }
        sets
    }

    /// The least box around all boxes.
    pub fn hull(&self) -> SampleBox {
        let end = |a: usize, number: i32| self.lower[a] + f64::from(number) * self.widths[a];
        let numbers = |a: usize| self.numbers.iter().map(move |number| number[a]);
        let axes = || 0..self.lower.len();
        SampleBox {
            lower: axes().map(|a| end(a, numbers(a).min().unwrap_or(0))).collect(),
            upper: axes().map(|a| end(a, numbers(a).max().unwrap_or(0) + 1)).collect(),
        }
    }

    /// The place of the point `unit` of the unit cube, along the first `dimensions` axes: each box
    /// has an equal part of its first coordinate.
    pub fn at(&self, unit: &SamplePoint, dimensions: usize) -> SamplePoint {
        let count = self.numbers.len();
        let along = unit[0] * count as f64;
        let number = self.numbers[(along as usize).min(count - 1)];
        let mut place = [0.0; MOST_DIMENSIONS];
        for (a, at) in place.iter_mut().enumerate().take(dimensions) {
            let within = if a == 0 { along.fract() } else { unit[a] };
            *at = self.lower[a] + (f64::from(number[a]) + within) * self.widths[a];
        }
        place
    }

    /// Whether `place` is in one of the boxes, without their upper ends, along the first
    /// `dimensions` axes.
    pub fn contains(&self, place: &SamplePoint, dimensions: usize) -> bool {
        self.numbers.binary_search(&self.number(place, dimensions)).is_ok()
    }

    /// The sum over the boxes of `∏ (upper − lower)` over the axes for which `counts` is true.
    pub fn volume(&self, counts: impl Fn(usize) -> bool) -> f64 {
        let widths = self.widths.iter().enumerate().filter(|(a, _)| counts(*a));
        self.numbers.len() as f64 * widths.map(|(_, width)| width).product::<f64>()
    }

    /// The number of the box around `place`, along the first `dimensions` axes.
    fn number(&self, place: &SamplePoint, dimensions: usize) -> BoxNumber {
        let along = |a: usize| ((place[a] - self.lower[a]) / self.widths[a]).floor() as i32;
        std::array::from_fn(|a| if a < dimensions { along(a) } else { 0 })
    }
}

/// The sequence of a replicate: the points `frac(s + k α)`, `k = 1, 2, …`, with `α_i = φ^{−i}`,
/// `φ^{d+1} = φ + 1` (M. Roberts, "The unreasonable effectiveness of quasirandom sequences", 2018:
/// the additive recurrence of low discrepancy in `d` dimensions) and a random shift `s`. Sequences
/// of different seeds are independent and unbiased.
pub struct SampleSequence {
    shift: Vec<f64>,
    step: Vec<f64>,
    /// Where resampling of its points begins, in `[0, 1)`.
    pub offset: f64,
}

impl SampleSequence {
    /// The sequence of the replicate with this `seed` in `dimensions` dimensions.
    pub fn new(dimensions: usize, seed: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut root: f64 = 2.0;
        for _ in 0..64 {
            root = (1.0 + root).powf(1.0 / (dimensions + 1) as f64);
        }
        Self {
            shift: (0..dimensions).map(|_| uniform(&mut random)).collect(),
            step: (1..=dimensions).map(|i| root.powi(-(i as i32))).collect(),
            offset: uniform(&mut random),
        }
    }

    /// Point `k` in the unit cube.
    pub fn point(&self, k: usize) -> SamplePoint {
        let mut point = [0.0; MOST_DIMENSIONS];
        for (x, (shift, step)) in point.iter_mut().zip(self.shift.iter().zip(&self.step)) {
            *x = (shift + (k + 1) as f64 * step).fract();
        }
        point
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sequences_fill_the_cube_evenly() {
        for dimensions in 1..=MOST_DIMENSIONS {
            let sequence = SampleSequence::new(dimensions, 3);
            let count = 4096;
            for axis in 0..dimensions {
                let values = (0..count).map(|k| sequence.point(k)[axis]);
                let mean: f64 = values.sum::<f64>() / f64::from(count as u32);
                // Random points would be 4.5e-3 off.
                assert!((mean - 0.5).abs() < 3e-3, "{dimensions} {axis}: {mean}");
            }
            // The part in which all coordinates are below 0.7.
            let below = (0..count)
                .filter(|k| sequence.point(*k)[..dimensions].iter().all(|x| *x < 0.7))
                .count();
            let expected = 0.7f64.powi(dimensions as i32);
            let found = below as f64 / f64::from(count as u32);
            assert!((found - expected).abs() < 0.01, "{dimensions}: {found} {expected}");
        }
    }
}
