//! This rank's part of the grid.

use crate::matrix::sampling::SampledCells;
use crate::parallel::communicator::{Communicator, Group};
use crate::parallel::partition::Block;
use crate::plan::Plan;
use crate::problem::grid::PhaseSpace;
use std::ops::Range;

/// This rank's part of the grid.
pub struct RankCells {
    /// The space block.
    pub block: Block,
    /// `ranges[g]`: the block's cells whose results rank `g` of its mode groups has.
    pub ranges: Vec<Range<usize>>,
    /// This rank's range.
    pub mine: Range<usize>,
    /// The space cells of this rank's range, one range for each x-axis.
    pub share: Vec<Range<usize>>,
}

impl RankCells {
    /// The part of this rank of `communicator` on the mesh of `plan`.
    pub fn new(space: &PhaseSpace, plan: &Plan, communicator: &Communicator) -> Self {
        let mesh = &plan.layout.mesh;
        let (in_space, group) = (communicator.space.rank(), communicator.modes.rank());
        let block = Block::new(space, mesh, in_space);
        let first = block.ranges[0].start;
        let layer = block.cells() / block.ranges[0].len();
        let ranges: Vec<Range<usize>> = (0..mesh.groups)
            .map(|g| {
                let piece = &mesh.share(space, in_space, g)[0];
                (piece.start - first) * layer..(piece.end - first) * layer
            })
            .collect();
        Self {
            mine: ranges[group].clone(),
            share: mesh.share(space, in_space, group),
            ranges,
            block,
        }
    }

    /// The values of all cells of the block, then zeros up to `length`. `mine` are the values of
    /// this rank's cells. Collective over the mode groups.
    pub fn gathered(&self, modes: &Group, mine: &[f64], length: usize) -> Vec<f64> {
        let mut all = vec![0.0; length];
        all[self.mine.clone()].copy_from_slice(mine);
        modes.gathered(all)
    }

    /// The rank's cells, to be sampled.
    pub fn part(&self) -> SampledCells<'_> {
        SampledCells { block: &self.block, cells: self.mine.clone(), ranges: &self.share }
    }
}
