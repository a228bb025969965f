//! Readings of the modes, added up in fixed point (see [`crate::base::fixed_point`]): the field, or
//! its moments only.

use crate::base::fixed_point::FixedPoint;
use crate::matrix::lanes::{LANES, Lanes};
use crate::matrix::observables::{MOMENTS, MomentsOf};
use crate::parallel::communicator::Group;
use crate::schrodingerization::recovery::Reading;
use crate::schrodingerization::warp_plan::WarpPlan;
use crate::solve::snapshot::BoxValues;
use num_complex::Complex64;
use std::ops::Range;

/// The fixed-point sums of the modes by a reading, one for each cell of the space block, or one for
/// each point and moment.
pub struct ModeSum<'a> {
    pub(crate) reading: Reading,
    /// Numbers at a point of space.
    width: usize,
    fixed: [FixedPoint; MOMENTS],
    /// Two integers a number.
    pub(crate) parts: Vec<i64>,
    moments: Option<&'a MomentsOf<'a>>,
}

impl<'a> ModeSum<'a> {
    /// Storage for the sums over the modes of `warp`, whose vectors are at most `size` long, at
    /// `points` points of space with `velocities` cells each.
    pub fn of_field(
        warp: &WarpPlan,
        reading: &Reading,
        size: f64,
        points: usize,
        velocities: usize,
    ) -> Self {
        let bound = 1.01 * size * warp.amplification(reading);
        Self {
            reading: *reading,
            width: velocities,
            fixed: [FixedPoint::new(bound, warp.modes); MOMENTS],
            parts: vec![0; 2 * points * velocities],
            moments: None,
        }
    }

    /// Storage for the sums of the moments only, at `points` points of space.
    pub fn of_moments(
        warp: &WarpPlan,
        reading: &Reading,
        size: f64,
        points: usize,
        moments: &'a MomentsOf<'a>,
    ) -> Self {
        // By Cauchy–Schwarz: the norm of the factors times the norm of the summed values.
        let bound = 1.01 * size * warp.amplification(reading) / moments.least.sqrt();
        let fixed = moments.factors.norms().map(|q| FixedPoint::new(q * bound, warp.modes));
        Self {
            reading: *reading,
            width: MOMENTS,
            fixed,
            parts: vec![0; 2 * points * MOMENTS],
            moments: Some(moments),
        }
    }

    /// Adds `Re Σ_l weight_l w_l`, lane by lane, so that the result does not depend on the batches.
    /// `state` is on the block's cells. Allocates nothing.
    pub fn add(&mut self, weights: &[Complex64; LANES], state: &[Lanes]) {
        let re: [f64; LANES] = weights.map(|w| w.re);
        let im: [f64; LANES] = weights.map(|w| w.im);
        let read = |Lanes(w): &Lanes| -> [f64; LANES] {
            std::array::from_fn(|l| re[l] * w[l] - im[l] * w[LANES + l])
        };
        let Some(MomentsOf { factors, pi, .. }) = self.moments else {
            for (sum, row) in self.parts.chunks_exact_mut(2).zip(state) {
                put(&self.fixed[0], sum, read(row));
            }
            return;
        };
        let nv = factors.cells();
        let points = self.parts.chunks_exact_mut(2 * MOMENTS);
        for (sums, (cells, pi)) in points.zip(state.chunks_exact(nv).zip(pi.chunks_exact(nv))) {
            let mut moments = [[0.0; LANES]; MOMENTS];
            for ((row, pi), factors) in cells.iter().zip(pi).zip(factors.each()) {
                let (values, scale) = (read(row), 1.0 / pi.sqrt());
                for (moment, factor) in moments.iter_mut().zip(factors) {
                    for l in 0..LANES {
                        moment[l] += factor * scale * values[l];
                    }
                }
            }
            for (m, sum) in sums.chunks_exact_mut(2).enumerate() {
                put(&self.fixed[m], sum, moments[m]);
            }
        }
    }

    /// Adds the moments at each point of space, by lane: density, momenta, energy. Allocates
    /// nothing.
    pub fn add_moments<'b>(&mut self, points: impl Iterator<Item = &'b [[f64; LANES]]>) {
        for (sums, moments) in self.parts.chunks_exact_mut(2 * MOMENTS).zip(points) {
            for (m, values) in moments.iter().enumerate() {
                // The energy is the last.
                let m = if m + 1 < moments.len() { m } else { MOMENTS - 1 };
                put(&self.fixed[m], &mut sums[2 * m..2 * m + 2], *values);
            }
        }
    }

    /// The integers, two a number.
    pub(crate) fn numbers(&self) -> BoxValues<'_, i64> {
        BoxValues { width: self.width, values: &self.parts }
    }

    /// The sums on this rank's share of the cells, `shares[g]` being rank `g`'s; moments point by
    /// point, [`MOMENTS`] each. Collective over `modes`.
    pub fn share(mut self, modes: &Group, velocities: usize, shares: &[Range<usize>]) -> Vec<f64> {
        let width = self.width;
        let numbers = |cells: &Range<usize>| {
            let points = cells.start / velocities..cells.end / velocities;
            2 * width * points.start..2 * width * points.end
        };
        for (group, range) in shares.iter().enumerate() {
            modes.sum_integers_to(group, &mut self.parts[numbers(range)]);
        }
        let parts = self.parts[numbers(&shares[modes.rank()])].chunks_exact(2);
        // Of a field all are the same.
        parts.enumerate().map(|(k, p)| self.fixed[k % MOMENTS].join([p[0], p[1]])).collect()
    }
}

/// Adds the lanes of a number to its two integers.
#[inline(always)]
fn put(fixed: &FixedPoint, sum: &mut [i64], values: [f64; LANES]) {
    let (mut coarse, mut fine) = ([0; LANES], [0; LANES]);
    for l in 0..LANES {
        [coarse[l], fine[l]] = fixed.split(values[l]);
    }
    sum[0] += coarse.iter().sum::<i64>();
    sum[1] += fine.iter().sum::<i64>();
}
