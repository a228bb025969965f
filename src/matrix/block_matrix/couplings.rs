//! The inflow of a rank's rows, and couplings to auxiliary unknowns that are not entries of the
//! matrix.

use crate::matrix::block_matrix::BlockMatrix;
use crate::matrix::inflow::AuxiliaryRow;
use crate::matrix::lanes::{LANES, Lanes, StepConstants};
use crate::parallel::communicator::{GhostExchange, Group};
use std::ops::Range;

impl BlockMatrix {
    /// `y ← y + b` in the rows `rows`, with a `b` for each row of [`inflow`](Self::inflow). Does
    /// nothing if `b` is empty.
    pub fn add_inflow(&self, b: &[f64], rows: Range<usize>, y: &mut [f64]) {
        let first = self.inflow.partition_point(|aux| (aux.row as usize) < rows.start);
        let inside = self.inflow.iter().zip(b).skip(first);
        for (aux, b) in inside.take_while(|(aux, _)| (aux.row as usize) < rows.end) {
            y[aux.row as usize] += b;
        }
    }

    /// Adds the contribution of couplings outside the matrix to a step of the rows `range` of
    /// [`inflow`](Self::inflow) and of their auxiliary unknowns, without a common one.
    pub(crate) fn step_couplings(
        &self,
        constants: &StepConstants,
        range: Range<usize>,
        couplings: &[f64],
        y: &mut [Lanes],
        x: &[Lanes],
    ) {
        let cells = self.block.cells();
        for (m, coupling) in range.zip(couplings) {
            let (i, half) = (self.inflow[m].row as usize, 0.5 * coupling);
            let r = if self.has_common_unknown { cells } else { cells + m };
            add_coupled(constants, 1.0, half, &x[r].0, &mut y[i].0);
            if !self.has_common_unknown {
                add_coupled(constants, -1.0, half, &x[i].0, &mut y[r].0);
            }
        }
    }

    /// Adds the couplings of the common auxiliary unknown to a step of its row:
    /// `y_r ← a(−iμ − 1) ½ Σ κ_i x_i + y_r`. Collective over the space group.
    pub(crate) fn step_shared(
        &self,
        exchange: &GhostExchange,
        constants: &StepConstants,
        couplings: impl Iterator<Item = f64> + Clone,
        y: &mut [Lanes],
        x: &[Lanes],
    ) {
        let share =
            |(aux, coupling): (&AuxiliaryRow, f64)| x[aux.row as usize].0.map(|x| coupling * x);
        let terms = self.inflow.iter().zip(couplings).map(share);
        let total: [f64; 2 * LANES] = exchange.group().sum_lanes(self.inflow_rows, terms);
        let row = self.block.cells();
        add_coupled(constants, -1.0, 0.5, &total, &mut y[row].0);
    }

    /// Half the norm of the couplings `couplings` to auxiliary unknowns, row by row of
    /// [`inflow`](Self::inflow). Collective over `space`.
    pub fn coupling_norm(&self, space: &Group, couplings: &[f64]) -> f64 {
        if self.has_common_unknown {
            let squares = couplings.iter().map(|k| [k * k]);
            let [sum] = space.sum_lanes(self.inflow_rows, squares);
            return 0.5 * sum.sqrt();
        }
        0.5 * space.max(couplings.iter().fold(0.0, |most, k| f64::max(most, k.abs())))
    }
}

/// `y ← a(−iμ + sign) half x + y`: an entry `s = half`, `k = sign · half`.
#[inline(always)]
fn add_coupled(
    constants: &StepConstants,
    sign: f64,
    half: f64,
    x: &[f64; 2 * LANES],
    y: &mut [f64; 2 * LANES],
) {
    for l in 0..LANES {
        let (mu, a) = (constants.wavenumber[l], half * constants.scale[l]);
        let (re, im) = (x[l], x[LANES + l]);
        y[l] += a * (mu * im + sign * re);
        y[LANES + l] += a * (sign * im - mu * re);
    }
}
