//! The streamed Schrödingerized run: batches of modes are propagated, added to the recovered field, and dropped.
//!
//! Memory is a few phase-space vectors, whatever the number of modes. Contributions of batches are added in fixed point
//! (see [`crate::reproducible`]), so the field has the same bits for any mode groups and any order of batches.

use crate::communicator::Communicator;
use crate::error::{Error, Result};
use crate::matrix::{LANES, Lanes};
use crate::plan::{Batch, WarpPlan};
use crate::progress::Progress;
use crate::propagate::{BatchReport, BatchSpec, Evolution, Initial, Propagator};
use crate::recover::Reading;
use crate::reproducible::FixedPoint;
use num_complex::Complex64;
use std::ops::Range;

/// What round-off may add to the change of a mode's norm.
const UNITARITY_ROUND_OFF: f64 = 1e-12;

/// The recovered fields.
pub struct Recovered {
    /// `fields[k][r]`: `ũ(T)` of field `k` by reading `r`, on this rank's share of the block's cells.
    pub fields: Vec<Vec<Vec<f64>>>,
    /// Largest over the modes of (change of the norm) / (what its method allows plus 1e-12); at most 1. None where the
    /// method does not keep the norm.
    pub unitarity_defect: Option<f64>,
    /// Applications done by this rank's mode group.
    pub applications: usize,
}

/// A field as the fixed-point sums of its modes.
struct Sum {
    reading: Reading,
    fixed: FixedPoint,
    parts: Vec<i64>,
}

/// Runs the batches `mine` of `warp` for every field of `initial` and recovers the fields. `shares[g]` are the block's
/// cells that rank `g` of the mode groups keeps. Collective.
///
/// # Errors
/// [`Error::Unitarity`] when a mode's norm changed by more than its method allows.
pub fn streamed(
    communicator: &Communicator,
    system: &mut Evolution<'_>,
    (warp, propagator): (&WarpPlan, &mut dyn Propagator),
    mine: &[usize],
    initial: &[Initial<'_>],
    shares: &[Range<usize>],
    progress: &mut Progress,
) -> Result<Recovered> {
    let cells = system.matrix.block.cells();
    let sum = |field: &Initial<'_>, reading: &Reading| Sum {
        reading: *reading,
        fixed: FixedPoint::new(
            1.01 * warp.amplification(reading) * field.norm,
            warp.batches.len(),
        ),
        parts: vec![0; 2 * cells],
    };
    let mut sums: Vec<Vec<Sum>> = (initial.iter())
        .map(|field| warp.readings.iter().map(|r| sum(field, r)).collect())
        .collect();
    let mut defect: Option<f64> = None;
    let mut applications = 0;
    let mut outcome = Ok(());
    'batches: for &b in mine {
        let batch = &warp.batches[b];
        let spec = specification(warp, batch);
        for (field, sums) in initial.iter().zip(&mut sums) {
            let report = match propagator.propagate(system, &spec, field) {
                Ok(report) => report,
                Err(error) => {
                    outcome = Err(error);
                    break 'batches;
                }
            };
            let state = propagator.state();
            if report.unitary {
                match unitarity(system, state, (batch, &spec), &report, field) {
                    Ok(found) => defect = Some(defect.unwrap_or(0.0).max(found)),
                    Err(error) => {
                        outcome = Err(error);
                        break 'batches;
                    }
                }
            }
            for sum in sums {
                let mut weights = [Complex64::ZERO; LANES];
                for (l, weight) in weights.iter_mut().enumerate().take(batch.modes) {
                    *weight = warp.weight(batch.first + l, &sum.reading) * report.phases[l];
                }
                accumulate(&mut sum.parts, &sum.fixed, &weights, &state[..cells]);
            }
            applications += batch.modes * report.applications;
        }
        progress.advance(batch.degree);
    }
    communicator.world.agree(outcome)?;
    let share = |mut sum: Sum| {
        for (group, range) in shares.iter().enumerate() {
            let piece = &mut sum.parts[2 * range.start..2 * range.end];
            communicator.modes.sum_integers_to(group, piece);
        }
        let range = &shares[communicator.modes.rank()];
        let parts = sum.parts[2 * range.start..2 * range.end].chunks_exact(2);
        parts.map(|p| sum.fixed.join([p[0], p[1]])).collect()
    };
    // A rank without batches knows of no defect.
    let largest = communicator.world.max(defect.unwrap_or(-1.0));
    Ok(Recovered {
        fields: (sums.into_iter())
            .map(|sums| sums.into_iter().map(share).collect())
            .collect(),
        unitarity_defect: Some(largest).filter(|d| *d >= 0.0),
        applications,
    })
}

/// Largest change of a lane's norm as a fraction of what is allowed. Collective over the space group.
///
/// # Errors
/// [`Error::Unitarity`] where it is more.
fn unitarity(
    system: &Evolution<'_>,
    state: &[Lanes],
    (batch, spec): (&Batch, &BatchSpec),
    report: &BatchReport,
    initial: &Initial<'_>,
) -> Result<f64> {
    if initial.norm == 0.0 {
        return Ok(0.0);
    }
    let norms = norms(system, state, initial.norm);
    let mut defect: f64 = 0.0;
    for l in 0..batch.modes {
        let change = (norms[l] / initial.norm - 1.0).abs();
        let allowed = report.tails[l] + UNITARITY_ROUND_OFF;
        if change.is_nan() || change > allowed {
            return Err(Error::Unitarity {
                mode: batch.first + l,
                wavenumber: spec.wavenumbers[l],
                defect: change,
                allowed,
            });
        }
        defect = defect.max(change / allowed);
    }
    Ok(defect)
}

fn specification(warp: &WarpPlan, batch: &Batch) -> BatchSpec {
    let mut wavenumbers = [0.0; LANES];
    for (l, mu) in wavenumbers.iter_mut().enumerate() {
        *mu = warp.series.wavenumber(batch.first + l.min(batch.modes - 1));
    }
    BatchSpec {
        wavenumbers,
        degree: batch.degree,
    }
}

/// `‖w_l‖` by lane: summed over the velocities at each point of space, then exactly over space and ranks.
fn norms(system: &Evolution<'_>, state: &[Lanes], norm: f64) -> [f64; LANES] {
    let block = &system.matrix.block;
    let fixed = FixedPoint::new(2.0 * norm * norm, system.terms);
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
    let (own, aux) = state[..system.matrix.counted_rows()].split_at(block.cells());
    own.chunks(block.velocity_cells).for_each(&mut add);
    aux.chunks(1).for_each(&mut add);
    system.space.sum_integers(&mut totals);
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
