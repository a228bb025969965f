//! The modes that a rank stores: all rows of its space block for each mode that it computes.

use crate::matrix::lanes::{LANES, Lanes};
use crate::plan::balance::Batch;
use crate::plan::memory::RANK_MODE_BYTES;
use num_complex::Complex64;
use serde::{Deserialize, Serialize};

/// Modes of the whole warped field on a rank, mode by mode, each as long as the block has rows:
///
/// ```text
/// w(p) = Σ_l Re[ factor_l e^{iμ_l p} phase_l x_l ],   l ≥ 0
/// ```
///
/// in weighted unknowns; see [`crate::schrodingerization::profile::series::Series::factor`]. Phases
/// are stored apart from the modes, so that a stored mode continues with the same bits as one that
/// was never stored.
pub struct RankModes {
    rows: usize,
    /// The modes, ascending.
    modes: Vec<usize>,
    /// `values[k·rows + i]`: row `i` of mode `modes[k]`.
    values: Vec<Complex64>,
    progress: Vec<ModeProgress>,
}

/// Progress of a mode.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ModeProgress {
    /// Number of legs over which it was propagated.
    pub legs: usize,
    /// The factor `phase_l`.
    pub phase: Complex64,
    /// Norm of the mode before the first leg, over all ranks of the space group, or a bound on it.
    pub norm: f64,
    /// Allowed change of the norm since then, relative to the norm.
    pub allowed: f64,
}

const _: () = assert!(size_of::<(usize, ModeProgress)>() as u64 == RANK_MODE_BYTES);

impl ModeProgress {
    /// Initial progress of a mode of norm `norm`.
    pub fn start(norm: f64) -> Self {
        Self { legs: 0, phase: Complex64::ONE, norm, allowed: 0.0 }
    }
}

impl RankModes {
    /// Storage for `modes` of `rows` rows each, filled with zeros.
    pub fn new(rows: usize, mut modes: Vec<usize>) -> Self {
        modes.sort_unstable();
        Self {
            rows,
            values: vec![Complex64::ZERO; rows * modes.len()],
            progress: vec![ModeProgress::start(0.0); modes.len()],
            modes,
        }
    }

    /// Rows of a mode.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// The modes, ascending.
    pub fn modes(&self) -> &[usize] {
        &self.modes
    }

    /// All values, `rows` numbers a mode, in the order of [`modes`](Self::modes).
    pub fn values(&self) -> &[Complex64] {
        &self.values
    }

    /// All values for writing, `rows` numbers a mode, in the order of [`modes`](Self::modes).
    pub fn values_mut(&mut self) -> &mut [Complex64] {
        &mut self.values
    }

    /// Progress of each mode, in the order of [`modes`](Self::modes).
    pub fn progress(&self) -> &[ModeProgress] {
        &self.progress
    }

    /// Progress of each mode for writing, in the order of [`modes`](Self::modes).
    pub fn progress_mut(&mut self) -> &mut [ModeProgress] {
        &mut self.progress
    }

    fn index_of(&self, mode: usize) -> Option<usize> {
        self.modes.binary_search(&mode).ok()
    }

    /// Progress of `mode`; `None` if this rank does not store it.
    pub fn progress_of(&self, mode: usize) -> Option<ModeProgress> {
        self.index_of(mode).map(|k| self.progress[k])
    }

    /// The rows of `mode`; `None` if this rank does not store it.
    pub fn mode(&self, mode: usize) -> Option<&[Complex64]> {
        let first = self.index_of(mode)? * self.rows;
        Some(&self.values[first..first + self.rows])
    }

    /// The rows of `mode` for writing, with its new `progress`; `None` if this rank does not store
    /// it.
    pub fn replace(&mut self, mode: usize, progress: ModeProgress) -> Option<&mut [Complex64]> {
        let k = self.index_of(mode)?;
        self.progress[k] = progress;
        Some(&mut self.values[k * self.rows..(k + 1) * self.rows])
    }

    /// Stores lane `l` of `state` for `modes[l]`, with `progress[l]`; ignores modes of other ranks.
    pub fn store(&mut self, modes: &[usize], progress: &[ModeProgress; LANES], state: &[Lanes]) {
        for (l, &mode) in modes.iter().enumerate() {
            let Some(kept) = self.replace(mode, progress[l]) else {
                continue;
            };
            kept.iter_mut().zip(state).for_each(|(x, row)| *x = row.lane(l));
        }
    }

    /// Loads the mode of each lane of `batch` into `state`; ignores modes of other ranks.
    pub fn load(&self, batch: &Batch, state: &mut [Lanes]) {
        for l in 0..LANES {
            let Some(kept) = self.mode(batch.mode(l)) else {
                continue;
            };
            state.iter_mut().zip(kept).for_each(|(row, x)| row.set_lane(l, *x));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lanes_come_back() {
        let (rows, all) = (5, [7, 2, 11, 4, 0, 9, 3, 8, 21, 1]);
        let mut kept = RankModes::new(rows, all.to_vec());
        assert_eq!(kept.modes(), [0, 1, 2, 3, 4, 7, 8, 9, 11, 21]);
        let gone = |kept: &RankModes| kept.progress().iter().filter(|p| p.legs == 1).count();
        assert_eq!(gone(&kept), 0);
        let value = |mode: usize, i: usize| Complex64::new(mode as f64 + 0.5, i as f64 - 3.0);
        let progress = |mode: usize| ModeProgress {
            legs: 1,
            phase: Complex64::new(0.0, mode as f64),
            ..ModeProgress::start(2.0)
        };
        // A full batch, a partial one, and a mode of another rank.
        let batches: [&[usize]; 3] = [&[7, 2, 11, 4, 0, 9, 3, 8], &[21, 1], &[6]];
        for (stored, batch) in [0, 8, 10].into_iter().zip(batches) {
            assert_eq!(gone(&kept), stored);
            let mut state = vec![Lanes::ZERO; rows];
            for (i, row) in state.iter_mut().enumerate() {
                for (l, &mode) in batch.iter().enumerate() {
                    row.set_lane(l, value(mode, i));
                }
            }
            let progress = std::array::from_fn(|l| progress(batch[l.min(batch.len() - 1)]));
            kept.store(batch, &progress, &state);
        }
        assert!(kept.mode(6).is_none() && kept.progress_of(6).is_none());
        for batch in &batches[..2] {
            let mut state = vec![Lanes::ZERO; rows];
            kept.load(&Batch { modes: batch.to_vec(), cost: 0 }, &mut state);
            for (i, row) in state.iter().enumerate() {
                for l in 0..LANES {
                    let mode = batch[l.min(batch.len() - 1)];
                    assert_eq!(row.lane(l), value(mode, i));
                    assert_eq!(kept.progress_of(mode), Some(progress(mode)));
                    assert_eq!(kept.mode(mode).map(|x| x[i]), Some(value(mode, i)));
                }
            }
        }
    }
}
