//! Several ways to do the steps of a run, and the choice of the fastest.

use crate::matrix::block_matrix::BlockMatrix;
use crate::matrix::blocking::Blocking;
use crate::matrix::blocking::shape::{BlockingShape, Caches};
use crate::matrix::blocking::tiling::{FEWEST_ROWS, Tiling};
use crate::matrix::lanes::Lanes;

/// Bytes of the vectors for a row: two batches and the start.
pub(super) const BYTES_PER_ROW: f64 = 2.0 * size_of::<Lanes>() as f64 + 8.0;
/// Part of the cache that the tiles in use may fill: cache lines that map to the same set evict
/// each other before the cache is full.
pub(super) const SHARE: f64 = 0.55;
/// Part of the cache of a core that larger tiles fill: they overflow it a little, so that most of a
/// pass is in it.
const LARGER_SHARE: f64 = 1.2;

/// Ways to do the steps of a run, of which the first passes find the fastest. All have the same
/// bits. Ranks that split space may choose differently.
///
/// Machines differ in the speed of the last-level cache, from that of memory to ten times as much,
/// and in the part of it that a core can use. So the candidates are single steps, and the blockings
/// of least modelled time whose tiles in use fit into the last-level cache, into the cache of a
/// core, and nearly into it.
#[derive(Clone, Debug)]
pub struct FastestBlocking {
    /// `None`: single steps.
    candidates: Vec<Option<Blocking>>,
    /// Least seconds of a step with each candidate so far.
    seconds: Vec<f64>,
    /// Passes that were timed.
    timed: usize,
    /// Passes since then that had fewer steps than the candidate.
    short: usize,
}

impl FastestBlocking {
    /// Passes with each candidate that are timed.
    const TRIALS: usize = 2;
    /// Most passes with fewer steps than the candidate that are left out one after the other. The
    /// last pass of a series may be short; some runs have no others.
    const MOST_SHORT: usize = 3;
    /// Steps in whose time the candidates are made, about.
    const STEPS_OF_PLANNING: usize = 12;
    /// Least ratio of all steps to those of the timed passes and of the planning.
    const LEAST_RATIO: usize = 3;

    /// Bytes of all candidates while they are made, for this number of rows with `velocities` at a
    /// cell. A tile has at least these or [`FEWEST_ROWS`] rows.
    pub fn most_bytes(rows: u64, velocities: u64) -> u64 {
        Self::bytes_of(rows, velocities.clamp(1, FEWEST_ROWS as u64))
    }

    /// Bytes of all candidates while they are made, for this number of rows in tiles of at least
    /// `tile_rows`: for each tile its part in up to three orders of at most [`MOST_LEVELS`] levels,
    /// and its neighbours.
    pub fn bytes_of(rows: u64, tile_rows: u64) -> u64 {
        480 * rows / tile_rows
    }

    /// The candidates for `matrix` on this machine and so many `steps` in all; for few steps the
    /// shape for the last-level cache alone.
    pub fn planned(matrix: &BlockMatrix, steps: usize) -> Self {
        Self::planned_for(matrix, steps, Caches::here())
    }

    /// The candidates of [`planned`](Self::planned) on a machine with these caches.
    pub fn planned_for(matrix: &BlockMatrix, steps: usize, caches: Caches) -> Self {
        let parts = matrix.independent_velocities();
        Self::of_shapes(matrix, steps, &Self::shapes(matrix, caches, BYTES_PER_ROW, parts))
    }

    /// The candidates for steps whose results are read at once and added to a third vector. A tile
    /// then has all velocities.
    pub fn planned_to_read(matrix: &BlockMatrix, steps: usize) -> Self {
        let bytes = BYTES_PER_ROW + size_of::<Lanes>() as f64;
        Self::of_shapes(matrix, steps, &Self::shapes(matrix, Caches::here(), bytes, 1))
    }

    /// The fastest of `candidates`, which are not empty.
    pub fn of(candidates: Vec<Option<Blocking>>) -> Self {
        assert!(!candidates.is_empty());
        Self { seconds: vec![f64::INFINITY; candidates.len()], candidates, timed: 0, short: 0 }
    }

    /// The shapes of least modelled time, without repetition: with the last-level cache first, then
    /// as if it were as slow as memory; `None` for single steps. `vectors` are the bytes of vectors
    /// for a row, and a tile has one of at most `most_parts` parts of the velocities.
    fn shapes(
        matrix: &BlockMatrix,
        caches: Caches,
        vectors: f64,
        most_parts: usize,
    ) -> Vec<Option<BlockingShape>> {
        if !Blocking::possible(matrix) {
            return vec![None];
        }
        let of_a_core = Caches { last: caches.own, ..caches };
        let mut shapes = Vec::new();
        for caches in [caches.part(SHARE), of_a_core.part(SHARE), of_a_core.part(LARGER_SHARE)] {
            let shape = BlockingShape::planned(matrix, caches, vectors, most_parts);
            if !shapes.contains(&shape) {
                shapes.push(shape);
            }
        }
        shapes
    }

    /// Single steps and blockings of `shapes`; the first of them alone for few steps.
    pub(super) fn of_shapes(
        matrix: &BlockMatrix,
        steps: usize,
        shapes: &[Option<BlockingShape>],
    ) -> Self {
        let timed = 1 + shapes.iter().flatten().map(|shape| shape.depth).sum::<usize>();
        let overhead = Self::STEPS_OF_PLANNING + Self::TRIALS * timed;
        let few = steps < Self::LEAST_RATIO * overhead;
        let shapes = if few { &shapes[..1] } else { shapes };
        let single = (!few && !shapes.contains(&None)).then_some(None);
        let most = shapes.iter().flatten().map(|shape| shape.parts).max();
        let fine = most.map(|parts| Tiling::new(matrix, parts).neighbours(matrix));
        let blocking = |shape: &Option<BlockingShape>| {
            let (shape, fine) = shape.as_ref().zip(fine.as_ref())?;
            Some(Blocking::from_neighbours(matrix, shape, fine))
        };
        Self::of(shapes.iter().map(blocking).chain(single).collect())
    }

    /// All candidates.
    pub fn all(&self) -> &[Option<Blocking>] {
        &self.candidates
    }

    /// The blocking of the next pass; `None` for single steps.
    pub fn current(&self) -> Option<&Blocking> {
        self.candidates[self.chosen()].as_ref()
    }

    /// Most steps in the next pass.
    pub fn depth(&self) -> usize {
        self.current().map_or(1, Blocking::depth)
    }

    /// The pass took `seconds` for so many `steps`, at most [`depth`](Self::depth).
    pub fn passed(&mut self, steps: usize, seconds: f64) {
        if self.timed == Self::TRIALS * self.candidates.len() {
            return;
        }
        if steps < self.depth() && self.short < Self::MOST_SHORT {
            self.short += 1;
            return;
        }
        let least = &mut self.seconds[self.timed % self.candidates.len()];
        *least = least.min(seconds / steps as f64);
        self.timed += 1;
        self.short = 0;
    }

    /// The candidate of the next pass.
    fn chosen(&self) -> usize {
        let count = self.candidates.len();
        if self.timed < Self::TRIALS * count {
            return self.timed % count;
        }
        let faster = |a: &usize, b: &usize| self.seconds[*a].total_cmp(&self.seconds[*b]);
        (0..count).min_by(faster).unwrap_or(0)
    }
}
