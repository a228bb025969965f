//! Moments at times that a leg passes, from one series.
//!
//! The terms `φ_k` of a Chebyshev series do not depend on the time; its coefficients do. So one
//! series gives a linear functional `M` of the state at any number of times `t ≤ T`:
//!
//! ```text
//! M exp(−iHt) x = e^{−ict} ( J_0(ht) M φ_0 + 2 Σ_k J_k(ht) M φ_k )
//! ```
//!
//! It is summed forwards, so that each term is available. Each term is read once: its moments, a
//! few numbers at each point of space, are added to the moments at every time. The state at `T` is
//! the sum of the terms, which takes a third vector.

use crate::matrix::block_matrix::BlockMatrix;
use crate::matrix::blocking::MOST_LEVELS;
use crate::matrix::blocking::fastest::FastestBlocking;
use crate::matrix::lanes::{LANES, Lanes};
use crate::matrix::observables::MomentsOf;
use crate::matrix::terms::TermRows;
use crate::propagate::bessel::bessel_series;
use crate::propagate::evolution::{BatchSpec, Evolution, MatrixShare, SeriesSize};
use num_complex::Complex64;
use std::ops::Range;

/// The moments of a batch at the times that a leg passes, and their scratch; made once.
pub struct IntermediateMoments<'a> {
    pub(crate) terms: PassedTerms<'a>,
    pub(crate) blocking: FastestBlocking,
}

/// Reads the terms of a series, each once.
pub(crate) struct PassedTerms<'a> {
    moments: &'a MomentsOf<'a>,
    /// `1/√π` of the cells.
    scales: Vec<f64>,
    /// The times, measured from the beginning of the leg.
    times: Vec<f64>,
    /// Factor of each lane at each time.
    weights: Vec<[Complex64; LANES]>,
    /// Number of terms at each time.
    lengths: Vec<usize>,
    /// Coefficients `J_0`, `2J_k` by time, term and lane.
    coefficients: Vec<f64>,
    /// The number of terms that there is room for.
    most_terms: usize,
    /// Factors of the terms of one pass through memory, by term and time.
    of_terms: Vec<[f64; 2 * LANES]>,
    /// Sums by point of space, time and moment.
    values: Vec<[f64; LANES]>,
    pub(crate) sum: Vec<Lanes>,
    series: Vec<f64>,
    /// The first of the terms that are expected.
    first: usize,
    /// The times to which these add.
    active: Range<usize>,
}

impl<'a> IntermediateMoments<'a> {
    /// Room for legs that pass at most `times` times in series of this `size`, with the blockings
    /// that are planned for its applications.
    pub fn new(
        matrix: &BlockMatrix,
        moments: &'a MomentsOf<'a>,
        times: usize,
        size: SeriesSize,
    ) -> Self {
        let SeriesSize { largest_degree, applications } = size;
        let points = matrix.block.space_cells();
        let terms = PassedTerms {
            scales: moments.pi.iter().map(|pi| 1.0 / pi.sqrt()).collect(),
            times: Vec::with_capacity(times),
            weights: Vec::with_capacity(times),
            lengths: Vec::with_capacity(times),
            coefficients: vec![0.0; times * (largest_degree + 1) * LANES],
            most_terms: largest_degree + 1,
            of_terms: Vec::with_capacity(times * MOST_LEVELS),
            values: vec![[0.0; LANES]; points * times * moments.count()],
            sum: vec![Lanes::ZERO; matrix.length()],
            series: Vec::with_capacity(2 * largest_degree + 200),
            first: 0,
            active: 0..0,
            moments,
        };
        Self { terms, blocking: FastestBlocking::planned_to_read(matrix, applications) }
    }

    /// These moments with another blocking of steps, whose tiles have all velocities.
    pub fn blocked(self, blocking: FastestBlocking) -> Self {
        Self { blocking, ..self }
    }

    /// Bytes on a rank with `points` points of space.
    pub fn bytes(share: &MatrixShare<'_>, points: u64, times: u64, largest_degree: u64) -> u64 {
        let space = &share.case.space;
        let (moments, velocities) = (space.dimension() as u64 + 2, space.velocity_cells());
        // A tile has all velocities.
        let order = FastestBlocking::bytes_of(share.rows, velocities as u64);
        8 * LANES as u64 * times * (largest_degree + 1 + points * moments)
            + 8 * points * velocities as u64
            + size_of::<Lanes>() as u64 * share.length
            + order
    }

    /// Sets the times that the next leg passes, and the factor of each lane, without the phase of
    /// the leg itself.
    pub fn begin(&mut self, times: &[f64], weights: &[Complex64; LANES]) {
        let terms = &mut self.terms;
        terms.times.clear();
        terms.times.extend_from_slice(times);
        terms.weights.clear();
        terms.weights.resize(times.len(), *weights);
        terms.lengths.clear();
        terms.lengths.resize(times.len(), 0);
    }

    /// By point of space, the moments at time number `time` of the leg, by lane: density, momenta,
    /// energy.
    pub fn at(&self, time: usize) -> impl Iterator<Item = &[[f64; LANES]]> {
        let terms = &self.terms;
        let (count, times) = (terms.moments.count(), terms.times.len());
        let points = terms.values.chunks_exact(times * count);
        points.map(move |values| &values[time * count..(time + 1) * count])
    }
}

impl PassedTerms<'_> {
    /// Computes the coefficients of the terms at each time, each lane up to its own degree.
    pub(crate) fn prepare(&mut self, system: &Evolution<'_>, batch: &BatchSpec) {
        self.values.fill([0.0; LANES]);
        self.sum.fill(Lanes::ZERO);
        for (t, &time) in self.times.iter().enumerate() {
            let from = t * self.most_terms * LANES;
            let coefficients = &mut self.coefficients[from..from + self.most_terms * LANES];
            coefficients.fill(0.0);
            for l in 0..LANES {
                let interval = system.bounds.interval(batch.wavenumbers[l]);
                self.weights[t][l] *= Complex64::new(0.0, -interval.centre * time).exp();
                let tau = interval.half_width * time;
                bessel_series(&mut self.series, tau, batch.tolerances[l]);
                self.series.truncate(batch.work[l] + 1);
                self.lengths[t] = self.lengths[t].max(self.series.len());
                for (k, j) in self.series.iter().enumerate() {
                    coefficients[k * LANES + l] = if k == 0 { *j } else { 2.0 * j };
                }
            }
        }
    }

    /// Announces the terms that come next.
    pub(crate) fn announce(&mut self, terms: Range<usize>) {
        // Later times take more terms.
        let ended = self.lengths.iter().take_while(|length| **length <= terms.start).count();
        self.first = terms.start;
        self.active = ended..self.lengths.len();
        self.of_terms.clear();
        for k in terms {
            for t in self.active.clone() {
                let from = (t * self.most_terms + k) * LANES;
                let coefficients = &self.coefficients[from..from + LANES];
                let mut weights = [0.0; 2 * LANES];
                for (l, a) in coefficients.iter().enumerate() {
                    weights[l] = a * self.weights[t][l].re;
                    weights[LANES + l] = -a * self.weights[t][l].im;
                }
                self.of_terms.push(weights);
            }
        }
    }

    /// Reads some rows of the `level`-th of these terms: whole points of space, or auxiliary
    /// unknowns. `at_end` are the coefficients of the series at the end of the leg, by term and
    /// lane.
    pub(crate) fn read(
        &mut self,
        level: usize,
        rows: Range<usize>,
        term: &[Lanes],
        at_end: &[f64],
    ) {
        let (k, cells) = (self.first + level, self.scales.len());
        let own = rows.start.min(cells)..rows.end.min(cells);
        let (nv, times) = (self.moments.factors.cells(), self.lengths.len());
        let width = times * self.moments.count();
        TermRows {
            term: &term[rows.clone()],
            coefficient: at_end[k * LANES..].first_chunk().unwrap_or(&[0.0; LANES]),
            sum: &mut self.sum[rows],
            scales: &self.scales[own.clone()],
            factors: self.moments.factors.each(),
            dimension: self.moments.factors.dimension(),
            times,
            active: self.active.clone(),
            weights: &self.of_terms[level * self.active.len()..],
            values: &mut self.values[own.start / nv * width..own.end / nv * width],
        }
        .read();
    }
}
