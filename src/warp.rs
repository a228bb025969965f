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
    /// `plateau[r]`: `ũ(T)` of the first field by the plateau's reading `r`, likewise.
    pub plateau: Vec<Vec<f64>>,
    /// Largest over the modes of (change of the norm) / (what its method allows plus 1e-12); at most 1. None where the
    /// method does not keep the norm.
    pub unitarity_defect: Option<f64>,
    /// Smallest `‖w_l(T)‖/‖w_l(0)‖` over the modes of all ranks; none where the state is zero.
    pub norm_kept: Option<f64>,
    /// Leading term of the error that the time step leaves in each field by the first reading, like `fields`; empty where
    /// the method meets its tolerance by itself.
    pub step_errors: Vec<Vec<f64>>,
    /// By field, the norm of what modes may add to it whose step is too long for the leading term.
    pub step_beyond: Vec<f64>,
    /// Applications done by this rank's mode group.
    pub applications: usize,
    /// Linear systems solved by this rank's mode group.
    pub solves: usize,
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
    let sum = |field: &Initial<'_>, reading: &Reading, size: f64| Sum {
        reading: *reading,
        fixed: FixedPoint::new(
            1.01 * size * warp.amplification(reading) * field.norm,
            warp.batches.len(),
        ),
        parts: vec![0; 2 * cells],
    };
    let mut sums: Vec<Vec<Sum>> = (initial.iter().enumerate())
        .map(|(k, field)| {
            let plateau = if k == 0 { &warp.plateau[..] } else { &[] };
            let readings = warp.readings.iter().chain(plateau);
            readings.map(|r| sum(field, r, 1.0)).collect()
        })
        .collect();
    let mut step_sums: Vec<Sum> = Vec::new();
    if propagator.step_error().is_some() {
        // T Δt^q c G^(q+1) w, G at most as large as H of the last mode.
        let last = warp.series.wavenumber(warp.modes.saturating_sub(1));
        let size = propagator.largest_step_error(system, last);
        step_sums.extend(
            initial
                .iter()
                .map(|field| sum(field, &warp.readings[0], size)),
        );
    }
    let mut beyond = vec![0.0; initial.len()];
    let mut defect: Option<f64> = None;
    let mut kept = f64::INFINITY;
    let (mut applications, mut solves) = (0, 0);
    let mut outcome = Ok(());
    'batches: for &b in mine {
        let batch = &warp.batches[b];
        let spec = specification(warp, batch);
        for (k, (field, sums)) in initial.iter().zip(&mut sums).enumerate() {
            let report = match propagator.propagate(system, &spec, field) {
                Ok(report) => report,
                Err(error) => {
                    outcome = Err(error);
                    break 'batches;
                }
            };
            let state = propagator.state();
            match norms_kept(system, state, (batch, &spec), &report, field) {
                Ok((ratio, found)) => {
                    kept = kept.min(ratio);
                    defect = found.map_or(defect, |d| Some(defect.unwrap_or(0.0).max(d)));
                }
                Err(error) => {
                    outcome = Err(error);
                    break 'batches;
                }
            }
            let add = |sum: &mut Sum, state: &[Lanes], parts: &[f64; LANES]| {
                let mut weights = [Complex64::ZERO; LANES];
                for (l, weight) in weights.iter_mut().enumerate().take(batch.modes) {
                    let factor = parts[l] * report.phases[l];
                    *weight = warp.weight(batch.first + l, &sum.reading) * factor;
                }
                accumulate(&mut sum.parts, &sum.fixed, &weights, &state[..cells]);
            };
            sums.iter_mut()
                .for_each(|sum| add(sum, state, &[1.0; LANES]));
            if let Some(error) = propagator.step_error() {
                // No mode is further off than its two states are long: where the leading term is, it is cut to that.
                let most = 2.0 * field.norm;
                let size = propagator.largest_step_error(system, spec.wavenumbers[batch.modes - 1]);
                let sizes = sizes(system, error, size * field.norm);
                let parts = sizes.map(|s| if s > most { most / s } else { 1.0 });
                for l in (0..batch.modes).filter(|l| parts[*l] < 1.0) {
                    let weight = warp.weight(batch.first + l, &warp.readings[0]);
                    beyond[k] += most * weight.norm();
                }
                add(&mut step_sums[k], error, &parts);
            }
            applications += report.applications;
            solves += report.solves;
        }
        progress.advance(batch.work);
    }
    communicator.world.agree(outcome)?;
    let share = |mut sum: Sum| -> Vec<f64> {
        for (group, range) in shares.iter().enumerate() {
            let piece = &mut sum.parts[2 * range.start..2 * range.end];
            communicator.modes.sum_integers_to(group, piece);
        }
        let range = &shares[communicator.modes.rank()];
        let parts = sum.parts[2 * range.start..2 * range.end].chunks_exact(2);
        parts.map(|p| sum.fixed.join([p[0], p[1]])).collect()
    };
    // A rank without batches knows of no defect and no norm.
    let smallest = -communicator.world.max(-kept);
    let largest = communicator.world.max(defect.unwrap_or(-1.0));
    let mut fields: Vec<Vec<Vec<f64>>> = (sums.into_iter())
        .map(|sums| sums.into_iter().map(share).collect())
        .collect();
    let plateau =
        (fields.first_mut()).map_or(Vec::new(), |first| first.split_off(warp.readings.len()));
    Ok(Recovered {
        fields,
        plateau,
        step_beyond: (beyond.iter())
            .map(|b| communicator.modes.sum_terms(&[*b]))
            .collect(),
        step_errors: step_sums.into_iter().map(share).collect(),
        unitarity_defect: Some(largest).filter(|d| *d >= 0.0),
        norm_kept: Some(smallest).filter(|r| r.is_finite()),
        applications,
        solves,
    })
}

/// Norms of the lanes of a batch, each at most `bound`. Collective over the space group.
fn sizes(system: &Evolution<'_>, lanes: &[Lanes], bound: f64) -> [f64; LANES] {
    let square = |i: usize| {
        let w = &lanes[i].0;
        std::array::from_fn(|l| w[l] * w[l] + w[LANES + l] * w[LANES + l])
    };
    (system.lane_sums(&[bound * bound; LANES], square)).map(f64::sqrt)
}

/// Smallest ratio of a lane's norm to what it was, infinite where that was zero; and, where the method keeps norms, the
/// largest change as a fraction of what is allowed. Collective over the space group.
///
/// # Errors
/// [`Error::Unitarity`] where it is more.
fn norms_kept(
    system: &Evolution<'_>,
    state: &[Lanes],
    (batch, spec): (&Batch, &BatchSpec),
    report: &BatchReport,
    initial: &Initial<'_>,
) -> Result<(f64, Option<f64>)> {
    if initial.norm == 0.0 {
        return Ok((f64::INFINITY, report.unitary.then_some(0.0)));
    }
    let squares = system.lane_sums(&[initial.norm * initial.norm; LANES], |i| {
        let Lanes(w) = &state[i];
        std::array::from_fn(|l| w[l] * w[l] + w[LANES + l] * w[LANES + l])
    });
    let (mut kept, mut defect) = (f64::INFINITY, 0.0f64);
    for l in 0..batch.modes {
        let ratio = squares[l].sqrt() / initial.norm;
        kept = kept.min(ratio);
        let change = (ratio - 1.0).abs();
        let allowed = report.tails[l] + UNITARITY_ROUND_OFF;
        if report.unitary && (change.is_nan() || change > allowed) {
            return Err(Error::Unitarity {
                mode: batch.first + l,
                wavenumber: spec.wavenumbers[l],
                defect: change,
                allowed,
            });
        }
        defect = defect.max(change / allowed);
    }
    Ok((kept, report.unitary.then_some(defect)))
}

fn specification(warp: &WarpPlan, batch: &Batch) -> BatchSpec {
    let mode = |l: usize| batch.first + l.min(batch.modes - 1);
    BatchSpec {
        modes: batch.modes,
        wavenumbers: std::array::from_fn(|l| warp.series.wavenumber(mode(l))),
        tolerances: std::array::from_fn(|l| warp.mode_tolerance(mode(l))),
        work: batch.work,
    }
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
