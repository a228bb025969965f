//! The modes that a rank keeps: all rows of its space block for each of the modes it computes.

use crate::matrix::{LANES, Lanes};
use num_complex::Complex64;

/// Modes of the whole warped field on a rank, mode by mode, each as long as the block has rows:
///
/// ```text
/// w(p) = Σ_l Re[ factor_l e^{iμ_l p} x_l ],   l ≥ 0
/// ```
///
/// in weighted unknowns; see [`crate::profile::Series::factor`].
pub struct KeptModes {
    rows: usize,
    /// Ascending.
    modes: Vec<usize>,
    /// `values[k·rows + i]`: row `i` of mode `modes[k]`.
    values: Vec<Complex64>,
    /// How many modes were stored, those stored twice once.
    present: usize,
    stored: Vec<bool>,
}

impl KeptModes {
    /// Room for `modes` of `rows` rows each, zero so far.
    pub fn new(rows: usize, mut modes: Vec<usize>) -> Self {
        modes.sort_unstable();
        Self {
            rows,
            values: vec![Complex64::ZERO; rows * modes.len()],
            stored: vec![false; modes.len()],
            present: 0,
            modes,
        }
    }

    /// Bytes that `modes` of `rows` rows each take.
    pub fn bytes(rows: u64, modes: u64) -> u64 {
        rows * modes * size_of::<Complex64>() as u64
    }

    /// Rows of a mode.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// The modes, ascending.
    pub fn modes(&self) -> &[usize] {
        &self.modes
    }

    /// All of them, `rows` numbers a mode, in the order of [`modes`](Self::modes).
    pub fn values(&self) -> &[Complex64] {
        &self.values
    }

    /// The same, to be written; all modes count as stored.
    pub fn values_mut(&mut self) -> &mut [Complex64] {
        self.stored.fill(true);
        self.present = self.modes.len();
        &mut self.values
    }

    /// How many modes were stored so far.
    pub fn present(&self) -> usize {
        self.present
    }

    /// Whether `mode` is one of them.
    pub fn has(&self, mode: usize) -> bool {
        self.place(mode).is_some_and(|k| self.stored[k])
    }

    fn place(&self, mode: usize) -> Option<usize> {
        self.modes.binary_search(&mode).ok()
    }

    /// Row by row, `mode`; `None` where this rank does not keep it.
    pub fn mode(&self, mode: usize) -> Option<&[Complex64]> {
        let first = self.place(mode)? * self.rows;
        Some(&self.values[first..first + self.rows])
    }

    /// Row by row, `mode`, to be written, which then counts as stored; `None` where this rank does not keep it.
    pub fn mode_mut(&mut self, mode: usize) -> Option<&mut [Complex64]> {
        let k = self.place(mode)?;
        self.present += usize::from(!std::mem::replace(&mut self.stored[k], true));
        Some(&mut self.values[k * self.rows..(k + 1) * self.rows])
    }

    /// Stores lane `l` of `state` for `modes[l]`, times `phases[l]`; modes of other ranks are left out.
    pub fn store(&mut self, modes: &[usize], phases: &[Complex64; LANES], state: &[Lanes]) {
        for (l, &mode) in modes.iter().enumerate() {
            let Some(kept) = self.mode_mut(mode) else {
                continue;
            };
            for (x, Lanes(w)) in kept.iter_mut().zip(state) {
                *x = phases[l] * Complex64::new(w[l], w[LANES + l]);
            }
        }
    }

    /// Loads `modes[l]` into lane `l` of `state`, and the last of them into the lanes that are left.
    pub fn load(&self, modes: &[usize], state: &mut [Lanes]) {
        for l in 0..LANES {
            let mode = modes.get(l).or(modes.last());
            let Some(kept) = mode.and_then(|&mode| self.mode(mode)) else {
                continue;
            };
            for (x, Lanes(w)) in kept.iter().zip(state.iter_mut()) {
                (w[l], w[LANES + l]) = (x.re, x.im);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lanes_come_back_with_their_phases() {
        let (rows, all) = (5, [7, 2, 11, 4, 0, 9, 3, 8, 21, 1]);
        let mut kept = KeptModes::new(rows, all.to_vec());
        assert_eq!(kept.modes(), [0, 1, 2, 3, 4, 7, 8, 9, 11, 21]);
        let value = |mode: usize, i: usize| Complex64::new(mode as f64 + 0.5, i as f64 - 3.0);
        // A full batch, one that is not, and a mode of another rank.
        let batches: [&[usize]; 3] = [&[7, 2, 11, 4, 0, 9, 3, 8], &[21, 1], &[6]];
        for (stored, batch) in [0, 8, 10].into_iter().zip(batches) {
            assert_eq!(kept.present(), stored);
            let mut state = vec![Lanes::ZERO; rows];
            for (i, Lanes(w)) in state.iter_mut().enumerate() {
                for (l, &mode) in batch.iter().enumerate() {
                    let x = value(mode, i);
                    (w[l], w[LANES + l]) = (x.re, x.im);
                }
            }
            let phases = std::array::from_fn(|l| Complex64::new(0.0, l as f64 + 1.0));
            assert!(batch.iter().all(|mode| !kept.has(*mode)));
            kept.store(batch, &phases, &state);
            // Again: counted once.
            kept.store(batch, &phases, &state);
        }
        assert_eq!(kept.present(), 10);
        assert!(kept.mode(6).is_none() && !kept.has(6));
        for batch in &batches[..2] {
            let mut state = vec![Lanes::ZERO; rows];
            kept.load(batch, &mut state);
            for (i, Lanes(w)) in state.iter().enumerate() {
                for l in 0..LANES {
                    let (k, mode) = (l.min(batch.len() - 1), batch[l.min(batch.len() - 1)]);
                    let expected = Complex64::new(0.0, k as f64 + 1.0) * value(mode, i);
                    assert_eq!(Complex64::new(w[l], w[LANES + l]), expected);
                }
            }
        }
    }
}
