//! The streamed Schrödingerized run: batches of modes are propagated, added to the recovered field, and dropped.
//!
//! Memory is a few phase-space vectors, whatever the number of modes, and the sums of one field at a time. Contributions of modes
//! are added in fixed point (see [`crate::reproducible`]), so the field has the same bits for any mode groups, any batches
//! of independent modes and any order.

use crate::communicator::{Communicator, Group};
use crate::error::{Error, Result};
use crate::matrix::{LANES, Lanes};
use crate::plan::{Batch, WarpPlan};
use crate::progress::Progress;
use crate::propagate::{BatchReport, BatchSpec, Evolution, Initial, Propagator};
use crate::recover::Reading;
use crate::reproducible::FixedPoint;
use num_complex::Complex64;
use std::ops::Range;
use std::time::Instant;

/// What round-off may add to the change of a mode's norm.
const UNITARITY_ROUND_OFF: f64 = 1e-12;

/// The recovered fields.
#[derive(Clone, Debug, Default)]
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
    /// Seconds that this rank took for its batches.
    pub busy_seconds: f64,
}

/// A field read as the fixed-point sums of its modes.
struct Sum {
    reading: Reading,
    fixed: FixedPoint,
    parts: Vec<i64>,
}

impl Sum {
    /// Room for `cells` sums over the modes of `warp`, whose vectors are at most `size` long.
    fn new(warp: &WarpPlan, reading: &Reading, size: f64, cells: usize) -> Self {
        Self {
            reading: *reading,
            fixed: FixedPoint::new(1.01 * size * warp.amplification(reading), warp.modes),
            parts: vec![0; 2 * cells],
        }
    }

    /// Adds `Re Σ_l weight_l w_l`, lane by lane, so that it does not matter which modes are together.
    fn add(&mut self, weights: &[Complex64; LANES], state: &[Lanes]) {
        let re: [f64; LANES] = weights.map(|w| w.re);
        let im: [f64; LANES] = weights.map(|w| w.im);
        for (sum, Lanes(w)) in self.parts.chunks_exact_mut(2).zip(state) {
            let (mut coarse, mut fine) = ([0; LANES], [0; LANES]);
            for l in 0..LANES {
                [coarse[l], fine[l]] = self.fixed.split(re[l] * w[l] - im[l] * w[LANES + l]);
            }
            sum[0] += coarse.iter().sum::<i64>();
            sum[1] += fine.iter().sum::<i64>();
        }
    }

    /// The field on this rank's share of the cells. Collective over `modes`.
    fn share(mut self, modes: &Group, shares: &[Range<usize>]) -> Vec<f64> {
        for (group, range) in shares.iter().enumerate() {
            let piece = &mut self.parts[2 * range.start..2 * range.end];
            modes.sum_integers_to(group, piece);
        }
        let range = &shares[modes.rank()];
        let parts = self.parts[2 * range.start..2 * range.end].chunks_exact(2);
        parts.map(|p| self.fixed.join([p[0], p[1]])).collect()
    }
}

/// What the batches of a rank tell besides the fields.
struct Told {
    /// Largest change of a norm, as a fraction of what is allowed.
    defect: Option<f64>,
    /// Smallest `‖w_l(T)‖/‖w_l(0)‖`.
    kept: f64,
    applications: usize,
    solves: usize,
}

/// Runs the batches `mine` of `warp` for every field of `initial`, one field after the other, and recovers the fields.
/// `shares[g]` are the block's cells that rank `g` of the mode groups keeps. Collective.
///
/// # Errors
/// [`Error::Unitarity`] when a mode's norm changed by more than its method allows.
pub fn streamed(
    communicator: &Communicator,
    system: &mut Evolution<'_>,
    (warp, propagator): (&WarpPlan, &mut dyn Propagator),
    mine: &[Batch],
    initial: &[Initial<'_>],
    shares: &[Range<usize>],
    progress: &mut Progress,
) -> Result<Recovered> {
    let cells = system.matrix.block.cells();
    let (world, modes) = (&communicator.world, &communicator.modes);
    let mut told = Told {
        defect: None,
        kept: f64::INFINITY,
        applications: 0,
        solves: 0,
    };
    let mut recovered = Recovered::default();
    for (k, field) in initial.iter().enumerate() {
        let plateau = if k == 0 { &warp.plateau[..] } else { &[] };
        let sum = |reading, size| Sum::new(warp, reading, size * field.norm, cells);
        let readings = warp.readings.iter().chain(plateau);
        let mut sums: Vec<Sum> = readings.map(|r| sum(r, 1.0)).collect();
        let mut step_sum = propagator.step_error().is_some().then(|| {
            // T Δt^q c G^(q+1) w, G at most as large as H of the last mode.
            let last = warp.series.wavenumber(warp.modes.saturating_sub(1));
            let size = propagator.largest_step_error(system, last);
            sum(&warp.readings[0], size)
        });
        let mut beyond = Vec::with_capacity(warp.modes);
        let started = Instant::now();
        let outcome = mine.iter().try_for_each(|batch| {
            let into = (&mut sums[..], step_sum.as_mut(), &mut beyond);
            add_batch(
                system,
                (warp, &mut *propagator),
                batch,
                field,
                into,
                &mut told,
            )?;
            progress.advance(batch.cost);
            Ok(())
        });
        recovered.busy_seconds += started.elapsed().as_secs_f64();
        world.agree(outcome)?;
        let share = |sum: Sum| sum.share(modes, shares);
        let mut found: Vec<Vec<f64>> = sums.into_iter().map(share).collect();
        if k == 0 {
            recovered.plateau = found.split_off(warp.readings.len());
        }
        recovered.fields.push(found);
        recovered.step_errors.extend(step_sum.map(share));
        recovered.step_beyond.push(modes.sum_terms(&beyond));
    }
    // A rank without batches knows of no defect and no norm.
    let smallest = -world.max(-told.kept);
    let largest = world.max(told.defect.unwrap_or(-1.0));
    recovered.unitarity_defect = Some(largest).filter(|d| *d >= 0.0);
    recovered.norm_kept = Some(smallest).filter(|r| r.is_finite());
    recovered.applications = told.applications;
    recovered.solves = told.solves;
    Ok(recovered)
}

/// Propagates `field` in the modes of a batch and adds them to its sums, to that of its step's error, and to what is beyond
/// that. Collective over the space group; allocates nothing.
fn add_batch(
    system: &mut Evolution<'_>,
    (warp, propagator): (&WarpPlan, &mut dyn Propagator),
    batch: &Batch,
    field: &Initial<'_>,
    (sums, step_sum, beyond): (&mut [Sum], Option<&mut Sum>, &mut Vec<f64>),
    told: &mut Told,
) -> Result<()> {
    let cells = system.matrix.block.cells();
    let spec = specification(warp, batch);
    let report = propagator.propagate(system, &spec, field)?;
    let state = propagator.state();
    let (ratio, found) = norms_kept(system, state, (batch, &spec), &report, field)?;
    told.kept = told.kept.min(ratio);
    told.defect = found.map_or(told.defect, |d| Some(told.defect.unwrap_or(0.0).max(d)));
    told.applications += report.applications;
    told.solves += report.solves;
    let weights = |reading: &Reading, parts: &[f64; LANES]| {
        let mut weights = [Complex64::ZERO; LANES];
        for (l, &mode) in batch.modes.iter().enumerate() {
            weights[l] = warp.weight(mode, reading) * (parts[l] * report.phases[l]);
        }
        weights
    };
    for sum in sums {
        let weights = weights(&sum.reading, &[1.0; LANES]);
        sum.add(&weights, &state[..cells]);
    }
    if let (Some(sum), Some(error)) = (step_sum, propagator.step_error()) {
        // No mode is further off than its two states are long: where the leading term is, it is cut to that.
        let most = 2.0 * field.norm;
        let bounds = (spec.wavenumbers).map(|mu| propagator.largest_step_error(system, mu));
        let sizes = sizes(system, error, bounds.map(|b| b * field.norm));
        let parts = sizes.map(|s| if s > most { most / s } else { 1.0 });
        for (mode, _) in batch
            .modes
            .iter()
            .zip(&parts)
            .filter(|(_, part)| **part < 1.0)
        {
            beyond.push(most * warp.weight(*mode, &warp.readings[0]).norm());
        }
        let weights = weights(&sum.reading, &parts);
        sum.add(&weights, &error[..cells]);
    }
    Ok(())
}

/// Norms of the lanes of a batch, each at most its bound. Collective over the space group.
fn sizes(system: &Evolution<'_>, lanes: &[Lanes], bounds: [f64; LANES]) -> [f64; LANES] {
    let square = |i: usize| {
        let w = &lanes[i].0;
        std::array::from_fn(|l| w[l] * w[l] + w[LANES + l] * w[LANES + l])
    };
    (system.lane_sums(&bounds.map(|b| b * b), square)).map(f64::sqrt)
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
    for (l, &mode) in batch.modes.iter().enumerate() {
        let ratio = squares[l].sqrt() / initial.norm;
        kept = kept.min(ratio);
        let change = (ratio - 1.0).abs();
        let allowed = report.tails[l] + UNITARITY_ROUND_OFF;
        if report.unitary && (change.is_nan() || change > allowed) {
            return Err(Error::Unitarity {
                mode,
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
    let mode = |l: usize| batch.modes[l.min(batch.modes.len() - 1)];
    BatchSpec {
        modes: batch.modes.len(),
        wavenumbers: std::array::from_fn(|l| warp.series.wavenumber(mode(l))),
        tolerances: std::array::from_fn(|l| warp.mode_tolerance(mode(l))),
        work: std::array::from_fn(|l| warp.work[mode(l)]),
    }
}
