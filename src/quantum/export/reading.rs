//! Registers of qubits, the grid in `p`, and the field after a measurement of the final state.

use crate::base::error::{Error, Result};
use crate::matrix::observables::VelocityFactors;
use crate::problem::case::Case;
use crate::schrodingerization::profile::series::points;
use crate::schrodingerization::warp_plan::WarpPlan;
use num_complex::Complex64;
use serde::Serialize;

/// The largest number of qubits that are exported.
pub const MOST_QUBITS: usize = 12;

pub(super) fn norm(x: &[Complex64]) -> f64 {
    x.iter().map(Complex64::norm_sqr).sum::<f64>().sqrt()
}

/// The real parts of `x`.
pub(super) fn real_parts(x: &[Complex64]) -> Vec<f64> {
    x.iter().map(|x| x.re).collect()
}

/// Qubits of each register.
pub(super) struct CircuitRegisters {
    pub p: usize,
    /// Qubits of each axis, `(x1..xn, v1..vn)`.
    pub phase_space: Vec<usize>,
    /// Qubits of the label of the inflow: 1 where something enters, else 0.
    pub label: usize,
}

impl CircuitRegisters {
    /// The registers of `case` with `points` points in `p` and `rows` unknowns.
    ///
    /// # Errors
    /// [`Error::Input`] for more than [`MOST_QUBITS`] qubits.
    pub(super) fn new(case: &Case, points: usize, rows: usize) -> Result<Self> {
        let bits = |count: usize| count.trailing_zeros() as usize;
        let registers = Self {
            p: bits(points),
            phase_space: case.space.axes().map(|a| bits(a.cells)).collect(),
            label: usize::from(rows > case.space.cells()),
        };
        if registers.total() > MOST_QUBITS {
            let Self { p, phase_space, label } = &registers;
            return Err(Error::Input(format!(
                "{}: {} qubits ({p} of p, {phase_space:?} of the axes, {label} for what enters); \
                 at most {MOST_QUBITS} are exported: fewer cells, a shorter time.end or a larger \
                 solver.tolerance take less",
                case.name,
                registers.total()
            )));
        }
        Ok(registers)
    }

    pub(super) fn total(&self) -> usize {
        self.p + self.phase_space.iter().sum::<usize>() + self.label
    }
}

/// The grid in `p`: `p_k = lower + k · period/points`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PointGrid {
    /// `N_p`.
    #[serde(skip)]
    pub points: usize,
    /// `L`, the first point.
    pub lower: f64,
    /// `P`.
    pub period: f64,
    /// `k◇`, of the point where the field is read.
    pub recovery_index: usize,
    /// `p◇`.
    pub recovery: f64,
}

impl PointGrid {
    /// The grid of `warp`, with a point at `p◇`; of sampled coefficients the grid that is given.
    ///
    /// # Errors
    /// [`Error::Input`] for a given number of points that is no power of two.
    pub(super) fn new(name: &str, warp: &WarpPlan) -> Result<Self> {
        let series = &warp.series;
        let given = points(series);
        let points = given.next_power_of_two();
        if series.last_is_unpaired && given != points {
            return Err(Error::Input(format!(
                "{name}: {given} points in p; a register of qubits takes a power of two: \
                 solver.warp.points = {points}"
            )));
        }
        let (point, period) = (warp.readings[0].point, series.period);
        let width = period / points as f64;
        let steps = (point - warp.interval[0]) / width;
        let (lower, index) = if series.last_is_unpaired {
            (warp.interval[0], (steps - 1e-9).ceil())
        } else {
            (point - steps.floor() * width, steps.floor())
        };
        // Whole periods are free, and e^{p◇} is that of p◇ itself, not of an image.
        let lower = lower + (index / points as f64).floor() * period;
        let recovery_index = index.rem_euclid(points as f64) as usize;
        let recovery = lower + recovery_index as f64 * width;
        Ok(Self { points, lower, period, recovery_index, recovery })
    }
}

/// The exported state: its case, where its amplitudes are, and the field that is read from it.
#[derive(Clone, Copy)]
pub(super) struct ExportedState<'a> {
    pub case: &'a Case,
    pub registers: &'a CircuitRegisters,
    pub grid: &'a PointGrid,
    pub reading: &'a MeasuredField,
    /// `C_w`.
    pub norm_of_state: f64,
}

/// The field that a measurement of the final state leaves, and its probabilities.
pub(super) struct MeasuredField {
    /// `√π f/C_w e^{−p◇}`: the real part of the state at `p◇`, in the block of `f`.
    pub block: Vec<f64>,
    /// Norm of that block with its imaginary part, squared.
    pub in_block: f64,
    /// Norm of the state at `p◇`, squared: `P_p`.
    pub in_slice: f64,
    /// `√π`.
    pub weights: Vec<f64>,
    /// `f(T)`.
    pub field: Vec<f64>,
}

impl MeasuredField {
    /// The reading of the normalised `state`, whose norm was `norm_of_state`. `pi` are the weights
    /// of the cells.
    pub(super) fn new(
        state: &[Complex64],
        grid: &PointGrid,
        pi: &[f64],
        norm_of_state: f64,
    ) -> Self {
        let slice: Vec<Complex64> =
            state.iter().skip(grid.recovery_index).step_by(grid.points).copied().collect();
        let cells = pi.len();
        let square = |x: &[Complex64]| norm(x).powi(2);
        let weights: Vec<f64> = pi.iter().map(|pi| pi.sqrt()).collect();
        let block = real_parts(&slice[..cells]);
        let scale = grid.recovery.exp() * norm_of_state;
        let field = block.iter().zip(&weights).map(|(v, d)| scale * v / d).collect();
        Self { in_block: square(&slice[..cells]), in_slice: square(&slice), block, weights, field }
    }

    /// Real parts of the overlaps with the moment states, of density and momenta by space cell.
    pub(super) fn overlaps(&self, factors: &VelocityFactors, dimension: usize) -> Vec<Vec<f64>> {
        let (velocities, size) = (factors.cells(), self.in_block.sqrt());
        let of = |k: usize| {
            let blocks = self.block.chunks_exact(velocities);
            let cells = blocks.zip(self.weights.chunks_exact(velocities));
            let overlap = |(v, d): (&[f64], &[f64])| {
                let (mut product, mut square) = (0.0, 0.0);
                for ((v, d), q) in v.iter().zip(d).zip(factors.each()) {
                    product += q[k] / d * v;
                    square += (q[k] / d).powi(2);
                }
                product / (square.sqrt() * size)
            };
            cells.map(overlap).collect()
        };
        (0..=dimension).map(of).collect()
    }
}
