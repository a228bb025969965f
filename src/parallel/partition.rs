//! The partition of space and modes over the ranks: arithmetic only, no communication.
//!
//! Ranks form a mesh `space × modes`. Space blocks split the x-axes, never v; one layer of
//! neighbouring space cells (ghosts) carries the flux rows of their common faces; a periodic axis
//! is not split. Rank `r` has space block `r mod S` and mode group `r / S`.

use crate::base::error::{Error, Result};
use crate::base::row_major::{indices, number, position, volume};
use crate::problem::grid::{Axis, MAX_DIMENSION, PhaseSpace, SPACE_NAMES, for_each_cell};
use std::ops::Range;

/// The process mesh.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct ProcessMesh {
    /// Number of blocks along each x-axis.
    pub space: Vec<usize>,
    /// Number of mode groups.
    pub groups: usize,
}

/// Piece number `part` of `parts` nearly equal pieces of `range`.
pub fn split(range: &Range<usize>, parts: usize, part: usize) -> Range<usize> {
    let at = |k: usize| range.start + range.len() * k / parts;
    at(part)..at(part + 1)
}

/// Number of cells of the largest of `parts` parts of `axis`, each of whole elements.
pub fn largest_part(axis: &Axis, parts: usize) -> usize {
    axis.elements().div_ceil(parts) * axis.nodes.count()
}

/// The size of a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BlockSize {
    /// Points of space.
    pub points: usize,
    /// Cells.
    pub cells: usize,
    /// Ghost cells.
    pub ghosts: usize,
}

/// Piece number `part` of `parts` nearly equal pieces of the cells `range` of `axis`, each of whole
/// elements.
fn split_elements(axis: &Axis, range: &Range<usize>, parts: usize, part: usize) -> Range<usize> {
    let count = axis.nodes.count();
    let elements = split(&(range.start / count..range.end / count), parts, part);
    elements.start * count..elements.end * count
}

impl ProcessMesh {
    /// Number of space blocks `S`.
    pub fn blocks(&self) -> usize {
        self.space.iter().product()
    }

    /// Number of ranks.
    pub fn ranks(&self) -> usize {
        self.blocks() * self.groups
    }

    /// The size of the fullest block: the largest part of each axis, with neighbours on as many
    /// sides as any block has.
    pub fn fullest_block(&self, space: &PhaseSpace) -> BlockSize {
        let along = |a: usize| largest_part(&space.x[a], self.space[a]);
        let points: usize = (0..space.dimension()).map(along).product();
        let cells = points * space.velocity_cells();
        let sides = self.space.iter().map(|&parts| (parts - 1).min(2));
        let ghosts = sides.enumerate().map(|(a, sides)| sides * cells / along(a)).sum();
        BlockSize { points, cells, ghosts }
    }

    /// Checks that every block has at least one cell along each axis.
    ///
    /// # Errors
    /// [`Error::Ranks`], with the allowed numbers.
    pub fn validate(&self, space: &PhaseSpace) -> Result<()> {
        for (a, (&parts, axis)) in self.space.iter().zip(&space.x).enumerate() {
            if space.is_periodic(a) && parts != 1 {
                return Err(Error::Ranks(format!(
                    "--ranks-x: {parts} blocks along x-axis {a}, {}, which is periodic and stays \
                    whole; 1 does",
                    SPACE_NAMES[a]
                )));
            }
            let elements = axis.elements();
            if parts == 0 || parts > elements {
                return Err(Error::Ranks(format!(
                    "--ranks-x: {parts} blocks along x-axis {a} of {elements} cells; 1 to \
                     {elements} do"
                )));
            }
        }
        Ok(())
    }

    /// Position of space block `block` in the mesh of blocks.
    fn position(&self, block: usize) -> Vec<usize> {
        indices(block, &self.space)
    }

    /// Space cells of block `block`, one range an x-axis.
    pub fn ranges(&self, space: &PhaseSpace, block: usize) -> Vec<Range<usize>> {
        let position = self.position(block);
        let split = |(a, axis): (usize, &Axis)| {
            split_elements(axis, &(0..axis.cells), self.space[a], position[a])
        };
        space.x.iter().enumerate().map(split).collect()
    }

    /// The part of block `block` that rank `group` of its mode groups writes out: a piece along the
    /// first x-axis.
    pub fn share(&self, space: &PhaseSpace, block: usize, group: usize) -> Vec<Range<usize>> {
        let mut ranges = self.ranges(space, block);
        ranges[0] = split_elements(&space.x[0], &ranges[0], self.groups, group);
        ranges
    }
}

/// The exchange with a neighbour.
pub struct Exchange {
    /// The neighbour's block.
    pub neighbour: usize,
    /// Local numbers of the cells that the neighbour needs.
    pub send: Vec<u32>,
    /// The rows of the neighbour's cells among the ghosts of this block.
    pub ghosts: Range<usize>,
}

/// A layer of a neighbour's cells.
#[derive(Clone, Debug)]
pub struct GhostLayer {
    /// The neighbouring block.
    pub neighbour: usize,
    /// The neighbour's cells that are needed here.
    ghost: Vec<Range<usize>>,
    /// The cells of this block that the neighbour needs.
    edge: Vec<Range<usize>>,
    /// Ghosts before this slab.
    start: usize,
}

/// Numbering of the unknowns of one space block: its cells row-major, then its ghosts slab by slab.
#[derive(Clone, Debug)]
pub struct Block {
    /// Space cells, one range an x-axis.
    pub ranges: Vec<Range<usize>>,
    /// Velocity cells at a point of space.
    pub velocity_cells: usize,
    /// Velocity cells along the last axis.
    pub velocity_line: usize,
    /// Whether the first x-axis is periodic: the first cells of the block along it are next to the
    /// last ones.
    pub first_axis_is_periodic: bool,
    slabs: Vec<GhostLayer>,
    shape: Vec<usize>,
}

/// A run of space cells that two boxes share.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CommonRun {
    /// Number of its first cell in the one box, row-major.
    pub from: usize,
    /// Number of its first cell in the other box.
    pub to: usize,
    /// Number of cells.
    pub length: usize,
}

/// The space cells that the boxes `from` and `to` share, line by line along the last axis.
pub fn common_runs(from: &[Range<usize>], to: &[Range<usize>]) -> Vec<CommonRun> {
    let both = from.iter().zip(to);
    let mut common: Vec<Range<usize>> =
        both.map(|(a, b)| a.start.max(b.start)..a.end.min(b.end)).collect();
    let Some(last) = common.last_mut() else {
        return Vec::new();
    };
    let length = last.len();
    last.end = last.end.min(last.start + 1);
    let mut runs = Vec::new();
    for_each_cell(&common, |i| {
        if let (Some(from), Some(to)) = (position(from, i), position(to, i)) {
            runs.push(CommonRun { from, to, length });
        }
    });
    runs
}

/// The place of an unknown on a rank.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LocalIndex {
    /// A cell of the block, by local number.
    Own(usize),
    /// A ghost, by number among the ghosts.
    Ghost(usize),
}

impl Block {
    /// The block `block` of `mesh`.
    pub fn new(space: &PhaseSpace, mesh: &ProcessMesh, block: usize) -> Self {
        let ranges = mesh.ranges(space, block);
        let place = mesh.position(block);
        let velocity_cells = space.velocity_cells();
        let mut slabs = Vec::new();
        let mut start = 0;
        for (a, range) in ranges.iter().enumerate() {
            let stride: usize = mesh.space[a + 1..].iter().product();
            let layer = |i: usize| {
                let mut layer = ranges.clone();
                layer[a] = i..i + 1;
                layer
            };
            let mut add = |neighbour: usize, ghost: usize, edge: usize| {
                let slab = GhostLayer { neighbour, ghost: layer(ghost), edge: layer(edge), start };
                start += volume(&slab.ghost) * velocity_cells;
                slabs.push(slab);
            };
            if place[a] > 0 {
                add(block - stride, range.start - 1, range.start);
            }
            if place[a] + 1 < mesh.space[a] {
                add(block + stride, range.end, range.end - 1);
            }
        }
        Self {
            ranges,
            velocity_cells,
            velocity_line: space.v.last().map_or(1, |axis| axis.cells),
            first_axis_is_periodic: space.is_periodic(0),
            slabs,
            shape: space.x.iter().map(|a| a.cells).collect(),
        }
    }

    /// Number of unknowns of the block.
    pub fn cells(&self) -> usize {
        self.space_cells() * self.velocity_cells
    }

    /// Number of its space cells.
    pub fn space_cells(&self) -> usize {
        volume(&self.ranges)
    }

    /// Number of ghost unknowns.
    pub fn ghosts(&self) -> usize {
        self.slabs.iter().map(|s| volume(&s.ghost) * self.velocity_cells).sum()
    }

    /// The block's space cells widened to its ghosts, for evaluating rows there.
    pub fn wide_ranges(&self) -> Vec<Range<usize>> {
        self.ranges
            .iter()
            .zip(&self.shape)
            .map(|(r, &cells)| r.start.saturating_sub(1)..(r.end + 1).min(cells))
            .collect()
    }

    /// The exchange with each neighbour.
    pub fn exchanges(&self) -> Vec<Exchange> {
        self.slabs
            .iter()
            .map(|slab| {
                let mut send = Vec::new();
                for_each_cell(&slab.edge, |i| {
                    if let Some(position) = position(&self.ranges, i) {
                        let first = position * self.velocity_cells;
                        send.extend((first..first + self.velocity_cells).map(|r| r as u32));
                    }
                });
                let length = volume(&slab.ghost) * self.velocity_cells;
                let ghosts = slab.start..slab.start + length;
                Exchange { neighbour: slab.neighbour, send, ghosts }
            })
            .collect()
    }

    fn space_index(&self, i: &[usize; MAX_DIMENSION]) -> usize {
        number(self.shape.iter().copied(), i.iter().copied())
    }

    /// The place of global unknown `index`; `None` if it is neither in the block nor a ghost of it.
    pub fn local(&self, index: usize) -> Option<LocalIndex> {
        let (mut rest, v) = (index / self.velocity_cells, index % self.velocity_cells);
        let mut i = [0; MAX_DIMENSION];
        for (a, &cells) in self.shape.iter().enumerate().rev() {
            i[a] = rest % cells;
            rest /= cells;
        }
        if let Some(position) = position(&self.ranges, &i) {
            return Some(LocalIndex::Own(position * self.velocity_cells + v));
        }
        self.slabs.iter().find_map(|slab| {
            let position = position(&slab.ghost, &i)?;
            Some(LocalIndex::Ghost(slab.start + position * self.velocity_cells + v))
        })
    }

    /// Calls `visit(first global unknown, first local number)` for each space cell of the block.
    pub fn for_each_own(&self, mut visit: impl FnMut(usize, usize)) {
        let mut local = 0;
        for_each_cell(&self.ranges, |i| {
            visit(self.space_index(i) * self.velocity_cells, local);
            local += self.velocity_cells;
        });
    }

    /// Calls `visit(first global unknown, first ghost number)` for each ghost space cell.
    pub fn for_each_ghost(&self, mut visit: impl FnMut(usize, usize)) {
        for slab in &self.slabs {
            let mut ghost = slab.start;
            for_each_cell(&slab.ghost, |i| {
                visit(self.space_index(i) * self.velocity_cells, ghost);
                ghost += self.velocity_cells;
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn space(x: &[usize], v: &[usize]) -> PhaseSpace {
        let axis = |&cells: &usize| Axis::new(0.0, 1.0, cells);
        PhaseSpace {
            x: x.iter().map(axis).collect(),
            v: v.iter().map(axis).collect(),
            periodic: [false; MAX_DIMENSION],
        }
    }

    #[test]
    fn common_runs_are_the_cells_in_both_boxes() {
        // One [start, end] an axis.
        type Ends = &'static [[usize; 2]];
        let boxes: [[Ends; 2]; 5] = [
            [&[[2, 7]], &[[4, 9]]],
            [&[[0, 3]], &[[3, 5]]],
            [&[[0, 4], [1, 6]], &[[2, 9], [0, 4]]],
            [&[[0, 4], [1, 6]], &[[2, 9], [6, 8]]],
            [&[[1, 3], [0, 4], [2, 5]], &[[0, 2], [1, 4], [0, 9]]],
        ];
        let ranges = |ends: Ends| ends.iter().map(|e| e[0]..e[1]).collect::<Vec<_>>();
        for [a, b] in boxes.map(|pair| pair.map(ranges)) {
            let (a, b) = (&a[..], &b[..]);
            let mut expected = Vec::new();
            for_each_cell(a, |i| {
                expected.extend(position(b, i).map(|to| (position(a, i).unwrap(), to)));
            });
            let found: Vec<(usize, usize)> = (common_runs(a, b).iter())
                .flat_map(|run| (0..run.length).map(|k| (run.from + k, run.to + k)))
                .collect();
            assert_eq!(found, expected, "{a:?} {b:?}");
        }
    }

    #[test]
    fn blocks_cover_the_grid_once_and_neighbours_agree() {
        for (x, v, blocks) in [
            (vec![7], vec![3], vec![3]),
            (vec![5, 4], vec![2, 3], vec![2, 3]),
            (vec![3, 4, 5], vec![2, 1, 2], vec![3, 2, 2]),
        ] {
            let space = space(&x, &v);
            let mesh = ProcessMesh { space: blocks, groups: 2 };
            let all: Vec<Block> =
                (0..mesh.blocks()).map(|b| Block::new(&space, &mesh, b)).collect();
            let mut owner = vec![usize::MAX; space.cells()];
            for (b, block) in all.iter().enumerate() {
                let nv = block.velocity_cells;
                block.for_each_own(|global, local| {
                    for k in 0..nv {
                        assert_eq!(owner[global + k], usize::MAX);
                        owner[global + k] = b;
                        assert_eq!(block.local(global + k), Some(LocalIndex::Own(local + k)));
                    }
                });
            }
            assert!(owner.iter().all(|&o| o != usize::MAX));
            let fullest = mesh.fullest_block(&space);
            let most = |size: fn(&Block) -> usize| all.iter().map(size).max();
            assert_eq!(most(Block::space_cells), Some(fullest.points));
            assert_eq!(most(Block::cells), Some(fullest.cells));
            // A block with neighbours on all sides may have fewer cells.
            assert!(most(Block::ghosts).is_some_and(|ghosts| ghosts <= fullest.ghosts));
            for (b, block) in all.iter().enumerate() {
                let mut ghosts = vec![usize::MAX; block.ghosts()];
                let nv = block.velocity_cells;
                block.for_each_ghost(|global, ghost| {
                    for k in 0..nv {
                        assert_eq!(block.local(global + k), Some(LocalIndex::Ghost(ghost + k)));
                        ghosts[ghost + k] = global + k;
                    }
                });
                // The rows that a neighbour sends match, in order, the ghosts that are stored here.
                for exchange in block.exchanges() {
                    let other = exchange.neighbour;
                    let Exchange { send, .. } = all[other]
                        .exchanges()
                        .into_iter()
                        .find(|e| e.neighbour == b)
                        .expect("neighbours are mutual");
                    let mut sent = Vec::new();
                    all[other].for_each_own(|global, local| {
                        for k in 0..nv {
                            if let Some(at) = send.iter().position(|&s| s as usize == local + k) {
                                sent.push((at, global + k));
                            }
                        }
                    });
                    sent.sort_unstable();
                    let sent: Vec<usize> = sent.into_iter().map(|s| s.1).collect();
                    assert_eq!(sent, ghosts[exchange.ghosts]);
                }
            }
        }
    }
}
