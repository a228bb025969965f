//! The streamed Schrödingerized run: batches of modes are propagated, added to the recovered field, and dropped.
//!
//! Memory is a few phase-space vectors, whatever the number of modes. Contributions of batches are added in fixed point
//! (see [`crate::reproducible`]), so the field has the same bits for any mode groups and any order of batches.

use crate::communicator::{Communicator, GhostExchange};
use crate::error::{Error, Result};
use crate::matrix::{BlockMatrix, LANES, Lanes};
use crate::plan::{Batch, Bounds, WarpPlan};
use crate::progress::Progress;
use crate::propagate::chebyshev::{BatchSpec, Chebyshev};
use crate::reproducible::FixedPoint;
use num_complex::Complex64;
use std::ops::Range;

/// What round-off may add to the change of a mode's norm.
const UNITARITY_ROUND_OFF: f64 = 1e-12;

/// The recovered state.
pub struct Recovered {
    /// `ũ(T)` read at each recovery point, on this rank's share of the block's cells.
    pub fields: Vec<Vec<f64>>,
    /// Largest over the modes of (change of the norm) / (what its truncated series allows plus 1e-12); at most 1.
    pub unitarity_defect: f64,
    /// Applications done by this rank's mode group.
    pub applications: usize,
}

/// The state to propagate and its norm.
pub struct Initial<'a> {
    /// `ũ(0)`, this rank's rows.
    pub state: &'a [f64],
    /// `‖ũ(0)‖` over all ranks of the space group.
    pub norm: f64,
    /// Space cells and auxiliary unknowns over all ranks of the space group: terms of a norm.
    pub terms: usize,
}

/// Runs the batches `mine` of `warp` and recovers the field. `shares[g]` are the block's cells that rank `g`
/// of the mode groups keeps. Collective.
///
/// # Errors
/// [`Error::Unitarity`] when a mode's norm changed by more than its truncated series allows.
pub fn streamed(
    communicator: &Communicator,
    (matrix, exchange): (&BlockMatrix, &mut GhostExchange),
    (warp, bounds, time): (&WarpPlan, &Bounds, f64),
    mine: &[usize],
    initial: &Initial<'_>,
    shares: &[Range<usize>],
    progress: &mut Progress,
) -> Result<Recovered> {
    let cells = matrix.block.cells();
    let mut propagator = Chebyshev::new(matrix, warp.largest_degree());
    let mut sums: Vec<Vec<i64>> = warp.recovery.iter().map(|_| vec![0; 2 * cells]).collect();
    let fixed: Vec<FixedPoint> = (warp.recovery.iter())
        .map(|p| {
            FixedPoint::new(
                1.01 * p.exp() * warp.amplification * initial.norm,
                warp.batches.len(),
            )
        })
        .collect();
    let mut defect: f64 = 0.0;
    let mut applications = 0;
    let mut outcome = Ok(());
    for &b in mine {
        let batch = &warp.batches[b];
        let spec = specification(warp, batch);
        let constants = (bounds.rate, bounds.growth, time);
        let report = propagator.propagate(matrix, exchange, &spec, constants, initial.state);
        let norms = norms(communicator, matrix, &propagator.sum, initial);
        for l in 0..batch.modes {
            let change = (norms[l] / initial.norm - 1.0).abs();
            let allowed = report.tails[l] + UNITARITY_ROUND_OFF;
            defect = defect.max(if initial.norm > 0.0 {
                change / allowed
            } else {
                0.0
            });
            let kept = initial.norm == 0.0 || change <= allowed;
            if !kept && outcome.is_ok() {
                outcome = Err(Error::Unitarity {
                    mode: batch.first + l,
                    wavenumber: spec.wavenumbers[l],
                    defect: change,
                    allowed,
                });
            }
        }
        if outcome.is_err() {
            break;
        }
        for ((sum, fixed), &p) in sums.iter_mut().zip(&fixed).zip(&warp.recovery) {
            let mut weights = [Complex64::ZERO; LANES];
            for (l, weight) in weights.iter_mut().enumerate().take(batch.modes) {
                *weight = warp.weight(batch.first + l, p) * report.phases[l];
            }
            accumulate(sum, fixed, &weights, &propagator.sum[..cells]);
        }
        applications += batch.modes * batch.degree;
        progress.advance(batch.degree);
    }
    communicator.world.agree(outcome)?;
    let fields = (sums.iter_mut().zip(&fixed))
        .map(|(sum, fixed)| {
            for (group, range) in shares.iter().enumerate() {
                let piece = &mut sum[2 * range.start..2 * range.end];
                communicator.modes.sum_integers_to(group, piece);
            }
            let range = &shares[communicator.modes.rank()];
            sum[2 * range.start..2 * range.end]
                .chunks_exact(2)
                .map(|parts| fixed.join([parts[0], parts[1]]))
                .collect()
        })
        .collect();
    Ok(Recovered {
        fields,
        unitarity_defect: communicator.world.max(defect),
        applications,
    })
}

fn specification(warp: &WarpPlan, batch: &Batch) -> BatchSpec {
    let mut wavenumbers = [0.0; LANES];
    for (l, mu) in wavenumbers.iter_mut().enumerate() {
        *mu = warp
            .profile
            .wavenumber(batch.first + l.min(batch.modes - 1));
    }
    BatchSpec {
        wavenumbers,
        degree: batch.degree,
    }
}

/// `‖w_l‖` by lane: summed over the velocities at each point of space, then exactly over space and ranks.
fn norms(
    communicator: &Communicator,
    matrix: &BlockMatrix,
    sum: &[Lanes],
    initial: &Initial<'_>,
) -> [f64; LANES] {
    let fixed = FixedPoint::new(2.0 * initial.norm * initial.norm, initial.terms);
    let mut totals = [0i64; 2 * LANES];
    let mut add = |rows: &[Lanes]| {
        let mut squares = [0.0; LANES];
        for Lanes(w) in rows {
            for l in 0..LANES {
                squares[l] += w[l] * w[l] + w[LANES + l] * w[LANES + l];
            }
        }
        for l in 0..LANES {
            let parts = fixed.split(squares[l]);
            totals[2 * l] += parts[0];
            totals[2 * l + 1] += parts[1];
        }
    };
    let (own, aux) = sum.split_at(matrix.block.cells());
    own.chunks(matrix.block.velocity_cells).for_each(&mut add);
    aux.chunks(1).for_each(&mut add);
    communicator.space.sum_integers(&mut totals);
    std::array::from_fn(|l| fixed.join([totals[2 * l], totals[2 * l + 1]]).sqrt())
}

/// Adds `Re Σ_l weight_l w_l` to the fixed-point sums.
fn accumulate(sums: &mut [i64], fixed: &FixedPoint, weights: &[Complex64; LANES], state: &[Lanes]) {
    let re: [f64; LANES] = weights.map(|w| w.re);
    let im: [f64; LANES] = weights.map(|w| w.im);
    for (sum, Lanes(w)) in sums.chunks_exact_mut(2).zip(state) {
        let mut lanes = [0.0; LANES];
        for l in 0..LANES {
            lanes[l] = re[l] * w[l] - im[l] * w[LANES + l];
        }
        let parts = fixed.split(lanes.iter().sum());
        sum[0] += parts[0];
        sum[1] += parts[1];
    }
}
