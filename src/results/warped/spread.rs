//! Modes of a field that are spread over the ranks, and the rounds in which each rank gets all
//! modes of some cells.

use crate::base::error::Result;
use crate::base::row_major::DatasetBox;
use crate::parallel::communicator::Communicator;
use crate::parallel::communicator::transpose::Transpose;
use crate::parallel::partition::Block;
use crate::plan::memory::ExchangedModes;
use crate::problem::grid::PhaseSpace;
use crate::schrodingerization::transform::Transform;
use crate::solve::rank_modes::RankModes;
use num_complex::Complex64;
use std::ops::Range;

/// Name of the axis in `p`.
pub const POINTS: &str = "p";

/// The distribution of the modes of a field.
pub struct Spread<'a> {
    /// The process mesh.
    pub communicator: &'a Communicator,
    /// The grid.
    pub space: &'a PhaseSpace,
    /// The block of this rank.
    pub block: &'a Block,
    /// `modes[g]`: the modes that rank `g` of the mode groups keeps, ascending.
    pub modes: &'a [Vec<usize>],
    /// `π` of the block's cells; the stored modes are those of `√π w`.
    pub pi: &'a [f64],
    /// Bytes of a rank's buffers ([`crate::plan::memory::BUFFERS`]), or of one cell if that needs
    /// more.
    pub buffers: u64,
}

impl Spread<'_> {
    /// Largest number of cells of a rank in a round.
    pub fn cells_at_once(&self, points: usize) -> usize {
        let counts = self.modes.iter().map(|modes| modes.len() as u64);
        let exchanged = ExchangedModes {
            modes: counts.clone().sum(),
            most: counts.max().unwrap_or(0),
            groups: self.modes.len() as u64,
            points: points as u64,
            cells: self.block.cells() as u64,
        };
        exchanged.cells_at_once(self.buffers) as usize
    }

    /// Calls `visit` in each round with the cells of each rank of the mode groups, and with this
    /// rank's slab of the grid. There are as many rounds as the slowest rank of the world needs;
    /// ranks that finish earlier have no cells in the last ones. Collective if `visit` is.
    ///
    /// # Errors
    /// Those of `visit`.
    pub fn rounds(
        &self,
        most: usize,
        mut visit: impl FnMut(&[Range<usize>], &DatasetBox) -> Result<()>,
    ) -> Result<()> {
        let (rank, ranks) = (self.communicator.modes.rank(), self.communicator.modes.size());
        let shape: Vec<usize> = (self.block.ranges.iter().map(Range::len))
            .chain(self.space.v.iter().map(|axis| axis.cells))
            .collect();
        let count = DatasetBox::pieces(&shape, most).count().div_ceil(ranks);
        let rounds = self.communicator.world.max_count(count);
        // Pieces follow each other in the order of the cells.
        let mut pieces = DatasetBox::pieces(&shape, most);
        let mut next = 0;
        for _ in 0..rounds {
            let mut mine = DatasetBox::of(&vec![0..0; shape.len()]);
            let cells: Vec<Range<usize>> = (0..ranks)
                .map(|r| {
                    let first = next;
                    if let Some(piece) = pieces.next() {
                        next += piece.size();
                        if r == rank {
                            mine = piece;
                        }
                    }
                    first..next
                })
                .collect();
            for (start, range) in mine.start.iter_mut().zip(&self.block.ranges) {
                *start += range.start;
            }
            visit(&cells, &mine)?;
        }
        Ok(())
    }

    /// The transposition between all cells of a mode and all modes of a cell, in a round.
    pub fn transpose(&self, transform: &Transform) -> Transpose<'_> {
        let most = self.cells_at_once(transform.points());
        Transpose::new(&self.communicator.modes, self.modes.to_vec(), most)
    }

    /// A buffer for all modes of the cells of a round.
    pub fn modes_of_a_round(&self, transform: &Transform) -> Vec<Complex64> {
        vec![Complex64::ZERO; self.cells_at_once(transform.points()) * transform.modes()]
    }

    /// The phases of all modes. Collective over the mode groups.
    pub fn phases(&self, kept: &RankModes) -> Vec<Complex64> {
        let count: usize = self.modes.iter().map(Vec::len).sum();
        let mut parts = vec![f64::NEG_INFINITY; 2 * count];
        for (&l, progress) in kept.modes().iter().zip(kept.progress()) {
            (parts[2 * l], parts[2 * l + 1]) = (progress.phase.re, progress.phase.im);
        }
        self.communicator.modes.max_into(&mut parts);
        let (pairs, _) = parts.as_chunks();
        pairs.iter().map(|&[re, im]| Complex64::new(re, im)).collect()
    }

    /// Checks that these are the modes of `kept` and of `transform`.
    pub fn fits(&self, kept: &RankModes, transform: &Transform) {
        let mine = &self.modes[self.communicator.modes.rank()];
        assert_eq!(kept.modes(), &mine[..], "the modes of this rank");
        let all: usize = self.modes.iter().map(Vec::len).sum();
        assert_eq!(all, transform.modes(), "the modes of the series");
    }
}

/// A slab of cells with all points in `p`.
pub fn with_points(slab: &DatasetBox, points: usize) -> DatasetBox {
    let mut slab = slab.clone();
    slab.start.push(0);
    slab.count.push(points);
    slab
}
