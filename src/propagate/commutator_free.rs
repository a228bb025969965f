//! Propagation where the inflow depends on time: a product of exponentials, each a Chebyshev series
//! (see [`crate::propagate::time_dependent_inflow`]).

use crate::matrix::block_matrix::BlockMatrix;
use crate::matrix::lanes::{LANES, Lanes};
use crate::propagate::bessel::bessel_series;
use crate::propagate::chebyshev::{Chebyshev, degree};
use crate::propagate::evolution::{BatchSpec, Evolution, Initial};
use crate::propagate::method::{BatchReport, Propagator};
use crate::propagate::time_dependent_inflow::Schedule;
use num_complex::Complex64;

/// Relative errors below this are round-off, whatever the plan's series leaves.
const ROUND_OFF: f64 = 1e-15;

/// A Chebyshev series a stage; made once, used for every batch.
pub struct CommutatorFree<'a> {
    chebyshev: Chebyshev,
    /// What a stage starts from, but for the lanes' phases.
    start: Vec<Lanes>,
    schedule: &'a Schedule,
    series: Vec<f64>,
}

/// Degree of the series of one of `stages` equal parts of a run, for a mode whose series of the
/// whole run, of argument `tau = hT`, is cut at `whole_degree`: each part may leave its share of
/// what that leaves.
pub fn stage_degree(scratch: &mut Vec<f64>, tau: f64, whole_degree: usize, stages: usize) -> usize {
    let rest = bessel_series(scratch, tau, 0.0);
    let cut = scratch.len().min(whole_degree + 1);
    let tail = rest + 2.0 * scratch[cut..].iter().map(|j| j.abs()).sum::<f64>();
    let share = tail.max(ROUND_OFF) / stages as f64;
    degree(scratch, tau / stages as f64, share).max(1)
}

impl<'a> CommutatorFree<'a> {
    /// Scratch for vectors of `matrix` and batches whose modes take at most `largest_work`.
    pub fn new(matrix: &BlockMatrix, largest_work: usize, schedule: &'a Schedule) -> Self {
        // A stage's series is shorter than that of the whole run, but for what its smaller error
        // takes.
        let largest = largest_work + 60;
        Self {
            chebyshev: Chebyshev::new(matrix, largest),
            start: vec![Lanes::ZERO; matrix.rows()],
            schedule,
            series: Vec::with_capacity(2 * largest + 200),
        }
    }
}

impl Propagator for CommutatorFree<'_> {
    fn propagate(
        &mut self,
        system: &mut Evolution<'_>,
        batch: &BatchSpec,
        initial: &Initial<'_>,
    ) -> crate::base::error::Result<BatchReport> {
        let stages = self.schedule.stages();
        let time = system.time / stages as f64;
        let most = self.chebyshev.largest_degree();
        let stage = BatchSpec {
            work: std::array::from_fn(|l| {
                let interval = system.bounds.interval(batch.wavenumbers[l]);
                let tau = interval.half_width * system.time;
                stage_degree(&mut self.series, tau, batch.work[l], stages).min(most)
            }),
            ..batch.clone()
        };
        let longest = stage.largest_work();
        let (constants, mut report) = self.chebyshev.prepare(system, &stage, time);
        for (i, row) in self.start.iter_mut().enumerate() {
            *row = initial.state.row(i);
        }
        for k in 0..stages {
            if k > 0 {
                let rows = self.start.len();
                self.start.copy_from_slice(&self.chebyshev.current[..rows]);
            }
            let (couplings, start) = (Some(self.schedule.stage(k)), &self.start);
            let (matrix, exchange) = (system.matrix, &mut *system.exchange);
            self.chebyshev.series(matrix, exchange, &constants, longest, couplings, start);
        }
        report.applications *= stages;
        for l in 0..LANES {
            report.tails[l] *= stages as f64;
            report.phases[l] = report.phases[l].powu(stages as u32);
            report.phases[l] /= Complex64::from(report.phases[l].norm());
        }
        Ok(report)
    }

    fn state(&self) -> &[Lanes] {
        self.chebyshev.state()
    }
}
