//! Implicit steps: Crank–Nicolson and backward Euler.
//!
//! With `G = −iμS + K` and `Δt = T/n`,
//!
//! ```text
//! Crank–Nicolson    (I − Δt/2 G) w' = (I + Δt/2 G) w     w' = 2z − w,  (I − Δt/2 G) z = w
//! backward Euler    (I − Δt G) w' = w                    w' = z,       (I − Δt G) z = w
//! ```
//!
//! Crank–Nicolson is unitary; backward Euler damps a component of frequency `ω` by `(1 +
//! ω²Δt²)^{−½}` a step. Both commute with `G`, so the result alone gives the leading term of the
//! error at `T`: `n` steps are `exp(nΔt G')` with `G' = (2/Δt) artanh(Δt G/2) = G + Δt²G³/12 + …`
//! and `G' = −(1/Δt) ln(I − Δt G) = G + Δt G²/2 + …`, so
//!
//! ```text
//! w_n − w(T) ≈ T Δt²/12 G³ w_n        and        w_n − w(T) ≈ T Δt/2 G² w_n
//! ```
//!
//! Modes are propagated one after the other, so that one set of factors is stored.

use crate::base::error::{Error, Result};
use crate::base::memory::NamedBytes;
use crate::matrix::block_matrix::BlockMatrix;
use crate::matrix::lanes::{LANES, Lanes};
use crate::propagate::elimination::Elimination;
use crate::propagate::evolution::{BatchSpec, Evolution, InitialState, MatrixShare};
use crate::propagate::local_factors::ShiftedMode;
use crate::propagate::method::{
    BatchCoupling, BatchReport, Descriptor, ModeDemand, Propagator, PropagatorSetting, RunWork,
};
use crate::propagate::shifted::{REFINEMENTS, RESTART, ShiftedSolver, factor_bytes_per_row};
use num_complex::Complex64;

/// Crank–Nicolson (order 2) or backward Euler (order 1), with the scratch of one rank.
pub struct Implicit {
    order: usize,
    system: ShiftedSolver,
    /// `w`, `z` and a scratch vector, of one mode.
    mode: Vec<Complex64>,
    solved: Vec<Complex64>,
    /// `w(T)` of the batch.
    state: Vec<Lanes>,
    /// The leading term of the error of `state`.
    error: Vec<Lanes>,
}

/// Number of complex vectors of the matrix's length.
fn vectors(split: bool) -> usize {
    // w and z; residual, preconditioned vector and basis of the solver.
    2 + 2 + 1 + if split { RESTART } else { REFINEMENTS }
}

impl Implicit {
    /// The method of `order` 1 or 2; `split` says that space is split over ranks.
    ///
    /// # Errors
    /// [`crate::base::error::Error::Factors`]. Not collective.
    pub fn new(matrix: &BlockMatrix, order: usize, split: bool) -> Result<Self> {
        Ok(Self {
            order,
            system: ShiftedSolver::new(matrix, split)?,
            mode: vec![Complex64::ZERO; matrix.length()],
            solved: vec![Complex64::ZERO; matrix.length()],
            state: vec![Lanes::ZERO; matrix.rows()],
            error: vec![Lanes::ZERO; matrix.rows()],
        })
    }

    /// The factor of `G^(order + 1) w` in the leading term of the error after `steps` steps over
    /// `time`.
    fn leading(&self, time: f64, steps: usize) -> f64 {
        let dt = time / steps as f64;
        match self.order {
            2 => time * dt * dt / 12.0,
            _ => 0.5 * time * dt,
        }
    }
}

fn set_lane(lanes: &mut [Lanes], l: usize, values: &[Complex64]) {
    lanes.iter_mut().zip(values).for_each(|(row, value)| row.set_lane(l, *value));
}

impl Propagator for Implicit {
    fn propagate(
        &mut self,
        system: &mut Evolution<'_>,
        batch: &BatchSpec,
        initial: &InitialState<'_>,
    ) -> Result<BatchReport> {
        let steps = batch.largest_work();
        let dt = system.time / steps as f64;
        // The part of the step that is implicit.
        let a = if self.order == 2 { 0.5 * dt } else { dt };
        let leading = self.leading(system.time, steps);
        let mut report = BatchReport {
            unitary: self.order == 2,
            ..BatchReport::unitary([Complex64::ONE; LANES])
        };
        self.state.fill(Lanes::ZERO);
        self.error.fill(Lanes::ZERO);
        let rows = system.matrix.rows();
        for l in (0..batch.modes).filter(|&l| initial.norms[l] > 0.0) {
            let mu = batch.wavenumbers[l];
            self.system.factorise(system, ShiftedMode { shift: a, wavenumber: mu });
            for (i, w) in self.mode[..rows].iter_mut().enumerate() {
                *w = initial.state.row(i).lane(l);
            }
            for _ in 0..steps {
                // No step increases the norm, except by round-off.
                let norm = 1.001 * initial.norms[l];
                let found = self.system.solve(system, &mut self.solved, &self.mode, norm)?;
                for (w, z) in self.mode[..rows].iter_mut().zip(&self.solved) {
                    *w = match self.order {
                        2 => 2.0 * z - *w,
                        _ => *z,
                    };
                }
                report.tails[l] += 2.0 * found.residual + f64::EPSILON;
                report.applications += found.applications;
                report.solves += 1;
                if system.interruption.after(found.applications.max(1)) {
                    return Err(Error::Interrupted);
                }
            }
            set_lane(&mut self.state, l, &self.mode[..rows]);
            for _ in 0..=self.order {
                let (y, x) = (&mut self.solved, &mut self.mode);
                system.matrix.apply_mode(system.exchange, mu, y, x);
                std::mem::swap(y, x);
                report.applications += 1;
            }
            self.mode[..rows].iter_mut().for_each(|e| *e *= leading);
            set_lane(&mut self.error, l, &self.mode[..rows]);
        }
        Ok(report)
    }

    fn state(&self) -> &[Lanes] {
        &self.state
    }

    fn step_error(&self) -> Option<&[Lanes]> {
        Some(&self.error)
    }

    fn largest_step_error(&self, system: &Evolution<'_>, mu: f64, steps: usize) -> f64 {
        let interval = system.bounds.interval(mu);
        let size = interval.centre.abs() + interval.half_width;
        self.leading(system.time, steps) * size.powi(self.order as i32 + 1)
    }

    fn step_order(&self) -> i32 {
        self.order as i32
    }
}

/// Equal steps over `time`, none longer than `step`: `⌈T/step⌉`.
pub fn steps(step: f64, time: f64) -> usize {
    // A quotient within round-off of a whole number is that number.
    (time / step * (1.0 - 1e-12)).ceil().max(1.0) as usize
}

/// The descriptor of an implicit method.
pub struct ImplicitMethod {
    pub(super) name: &'static str,
    pub(super) order: usize,
}

impl Descriptor for ImplicitMethod {
    fn batch_coupling(&self) -> BatchCoupling {
        BatchCoupling::Sequential
    }

    fn work(&self, demand: &ModeDemand, _scratch: &mut Vec<f64>) -> usize {
        demand.step.map_or(0, |step| steps(step, demand.time))
    }

    fn applications_per_work(&self) -> usize {
        20
    }

    /// A Krylov solver is needed in addition to the factors.
    fn cost_of_splitting(&self) -> f64 {
        20.0
    }

    fn arrays(&self, share: &MatrixShare<'_>) -> Vec<NamedBytes> {
        let &MatrixShare { case, bounds, mesh, rows, length, .. } = share;
        let vectors = vectors(share.mesh.blocks() > 1) as u64;
        let batch = 2 * size_of::<Lanes>() as u64 * rows;
        let measured = bounds.assembled.map_or(1.0, |found| found.factors_over_estimate);
        let factors = measured * factor_bytes_per_row(case, bounds, mesh) * rows as f64;
        vec![
            NamedBytes::new(format!("batch of {LANES} modes"), batch),
            NamedBytes::new("vectors of the solver", vectors * 16 * length),
            NamedBytes::new("factors", factors as u64),
        ]
    }

    fn factor_bytes(&self, matrix: &BlockMatrix) -> Result<u64> {
        Ok(Elimination::new(matrix)?.bytes())
    }

    fn summary(&self, work: &RunWork) -> String {
        let step = work.step.unwrap_or(work.time);
        format!("{}: {} steps of {step:.6e}", self.name, work.steps)
    }

    fn propagator(
        &self,
        setting: &PropagatorSetting,
        matrix: &BlockMatrix,
    ) -> Result<Box<dyn Propagator>> {
        let made = Implicit::new(matrix, self.order, setting.split)?;
        Ok(Box::new(made))
    }
}
