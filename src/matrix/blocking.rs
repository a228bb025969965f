//! Cache blocking in time: several steps in one pass through memory, for vectors that do not fit
//! into the cache of a core.
//!
//! Rows are gathered into tiles: the velocities at a cell of space (or at an element's nodes along
//! the first axis), or a range of them, with their auxiliary unknowns. A tile at level `m` holds
//! its rows of the vectors of steps `m` and `m − 1`. It may advance to `m + 1`, which overwrites
//! `m − 1`, once every tile that it is coupled to is at `m` or `m + 1`: both still hold step `m`,
//! which it reads, and neither needs its step `m − 1` any more. Every order with this rule does the
//! same operations on the same numbers, with the same bits as step after step.
//!
//! The order used here is a wavefront (as in Wellein et al. 2009 for stencils, Alappat et al. 2023
//! for powers of sparse matrices). Tiles are opened one after the other, along the first x-axis in
//! each strip of the other x-axes, for each range of velocities. Whenever a tile is opened, every
//! tile that may advance does so, up to level [`BlockingShape::depth`]. So the levels follow each
//! other a cell apart, and a tile is read from memory about once for all of them:
//!
//! ```text
//! level 3   x x x . . . .
//! level 2   x x x x . . .
//! level 1   x x x x x . .      next: the sixth cell to 1, the fifth to 2, the fourth to 3
//! ```
//!
//! Towards the edge of a strip every level ends a cell earlier, and the cells left out wait for the
//! next strip. The ends of a periodic axis are such edges, too: the first cells wait for the last
//! ones.
//!
//! Ghosts are like a tile that advances by an exchange. Towards them the levels end cell by cell,
//! and each exchange lets all these cells advance by one level. So there is one message a step, as
//! without blocking, for any depth of the neighbour. Nothing is computed twice, and all but a
//! margin of [`BlockingShape::depth`] cells is done while the first message is under way.

pub mod fastest;
mod shape;
mod tiling;

pub use crate::matrix::blocking::shape::{BlockingShape, Caches, MOST_LEVELS};

use crate::matrix::block_matrix::BlockMatrix;
use crate::matrix::blocking::tiling::{Neighbours, Tile, Tiling, for_each_in_strips};
use crate::matrix::lanes::{Lanes, StartRow, StepConstants};
use crate::parallel::communicator::GhostExchange;
use std::ops::Range;

/// Several steps of a recurrence.
#[derive(Clone, Copy)]
pub struct RecurrenceSteps<'a> {
    /// The scales, shifts and vectors of each step.
    pub levels: &'a [StepConstants],
    /// Couplings to the auxiliary unknowns that are no entries of the matrix (see
    /// [`BlockMatrix::step`]).
    pub couplings: Option<&'a [f64]>,
}

/// Tiles, and the order in which they do several steps.
#[derive(Clone, Debug)]
pub struct Blocking {
    shape: BlockingShape,
    tiles: Vec<Tile>,
    /// Ranges of auxiliary unknowns, by number among them.
    auxiliaries: Vec<Range<u32>>,
    /// The tile that advances next, and the level from which it does.
    order: Vec<(u32, u32)>,
    /// For each level, the place in `order` where its ghosts must have been received.
    exchanges: Vec<usize>,
}

impl Blocking {
    /// Whether steps can be blocked: no row is a sum over all ranks.
    pub fn possible(matrix: &BlockMatrix) -> bool {
        !matrix.has_common_unknown
    }

    /// The blocking of `shape`, for a matrix for which it is [`possible`](Self::possible).
    pub fn new(matrix: &BlockMatrix, shape: &BlockingShape) -> Self {
        Self::from_neighbours(matrix, shape, &Tiling::new(matrix, shape.parts).neighbours(matrix))
    }

    /// The blocking of `shape`, with the neighbours of tiles of as many parts or a multiple.
    fn from_neighbours(matrix: &BlockMatrix, shape: &BlockingShape, fine: &Neighbours) -> Self {
        assert!(Self::possible(matrix) && (1..=MOST_LEVELS).contains(&shape.depth));
        let tiling = Tiling::new(matrix, shape.parts);
        let neighbours = fine.merged(tiling.parts);
        let mut this = Self {
            shape: *shape,
            order: Vec::with_capacity(tiling.tiles.len() * shape.depth),
            tiles: Vec::new(),
            auxiliaries: Vec::new(),
            exchanges: Vec::new(),
        };
        let mut levels = vec![0u32; tiling.tiles.len()];
        let mut waiting = Vec::new();
        // Advances `tile`, and then all tiles that can, with the ghosts of `ghosts` levels
        // received. Tiles beyond the front are at level 0 and not open; only `tile` may leave level
        // 0.
        let mut open = |tile: usize, ghosts: u32, order: &mut Vec<(u32, u32)>| {
            waiting.push(tile);
            while let Some(t) = waiting.pop() {
                let (level, around) = (levels[t], neighbours.of(t));
                let closed = level == 0 && t != tile;
                let lacks = neighbours.border[t] && level >= ghosts;
                let behind = |n: &u32| levels[*n as usize] < level;
                let done = level as usize == shape.depth;
                if done || closed || lacks || around.iter().any(behind) {
                    continue;
                }
                order.push((t as u32, level));
                levels[t] += 1;
                waiting.extend(around.iter().map(|n| *n as usize));
                waiting.push(t);
            }
        };
        let mut sequence = Vec::with_capacity(tiling.tiles.len());
        for part in 0..tiling.parts {
            for_each_in_strips(&tiling.sizes(matrix), shape.width, |cell| {
                sequence.push(cell * tiling.parts + part);
            });
        }
        sequence.iter().for_each(|t| open(*t, 0, &mut this.order));
        if matrix.block.ghosts() > 0 {
            sequence.retain(|t| neighbours.border[*t]);
            for level in 0..shape.depth {
                this.exchanges.push(this.order.len());
                let ghosts = level as u32 + 1;
                sequence.iter().for_each(|t| open(*t, ghosts, &mut this.order));
            }
        }
        assert!(levels.iter().all(|l| *l as usize == shape.depth));
        (this.tiles, this.auxiliaries) = (tiling.tiles, tiling.auxiliaries);
        this
    }

    /// Most steps in one pass.
    pub fn depth(&self) -> usize {
        self.shape.depth
    }

    /// Its parameters.
    pub fn shape(&self) -> BlockingShape {
        self.shape
    }
}

impl BlockMatrix {
    /// Several steps, with the result of as many calls of [`step`](Self::step): from `x` and the
    /// vector before it, `y`, to the last two, in the same places. Collective over the space group.
    pub fn steps<R: StartRow>(
        &self,
        exchange: &mut GhostExchange,
        blocking: Option<&Blocking>,
        steps: &RecurrenceSteps<'_>,
        y: &mut Vec<Lanes>,
        x: &mut Vec<Lanes>,
        start: &[R],
    ) {
        self.steps_and_read(exchange, blocking, steps, [y, x], start, &mut |_, _, _| {});
    }

    /// Does these steps as [`steps`](Self::steps) does, with calls of `read(step, rows, vector)` as
    /// soon as rows of a vector are computed. Rows come in runs of whole tiles.
    pub fn steps_and_read<R: StartRow>(
        &self,
        exchange: &mut GhostExchange,
        blocking: Option<&Blocking>,
        steps: &RecurrenceSteps<'_>,
        [y, x]: [&mut Vec<Lanes>; 2],
        start: &[R],
        read: &mut impl FnMut(usize, Range<usize>, &[Lanes]),
    ) {
        let &RecurrenceSteps { levels, couplings } = steps;
        let Some(blocking) = blocking.filter(|_| levels.len() > 1) else {
            for (level, constants) in levels.iter().enumerate() {
                self.step(exchange, constants, couplings, y, x, start);
                std::mem::swap(y, x);
                read(level, 0..self.rows(), x);
            }
            return;
        };
        assert!(levels.len() <= blocking.depth() && x.len() == y.len());
        let rows = self.rows();
        // Level `m` is in `vectors[m % 2]`.
        let mut vectors: [&mut [Lanes]; 2] = [x, y];
        // `advance` goes up to the place in the order at which the next exchange is due.
        let order = &blocking.order;
        let mut ends = blocking.exchanges.iter().copied().chain([order.len()]);
        let mut from = 0;
        if !blocking.exchanges.is_empty() {
            exchange.start(&vectors[0][..rows]);
            from = ends.next().unwrap_or(0);
            self.advance(blocking, &order[..from], steps, &mut vectors, start, read);
            exchange.finish(&mut vectors[0][rows..]);
        }
        for (level, to) in (0..levels.len()).zip(ends) {
            if level > 0 {
                let vector = &mut *vectors[level % 2];
                exchange.start(&vector[..rows]);
                exchange.finish(&mut vector[rows..]);
            }
            self.advance(blocking, &order[from..to], steps, &mut vectors, start, read);
            from = to;
        }
        if levels.len() % 2 == 1 {
            std::mem::swap(y, x);
        }
    }

    /// Advances the tiles of `order`.
    fn advance<R: StartRow>(
        &self,
        blocking: &Blocking,
        order: &[(u32, u32)],
        steps: &RecurrenceSteps<'_>,
        vectors: &mut [&mut [Lanes]; 2],
        start: &[R],
        read: &mut impl FnMut(usize, Range<usize>, &[Lanes]),
    ) {
        let (behind, _) = self.rows.lines().line_and_node(self.block.cells());
        let [even, odd] = vectors;
        for &(tile, level) in order {
            let Some(constants) = steps.levels.get(level as usize) else {
                continue;
            };
            let (y, x) = if level % 2 == 0 { (&mut **odd, &**even) } else { (&mut **even, &**odd) };
            let Tile { lines, auxiliaries } = &blocking.tiles[tile as usize];
            let lines = lines.start as usize..lines.end as usize;
            self.step_lines(lines.clone(), constants, y, x, start);
            for row in self.rows.lines().rows_of_cells(lines.start) {
                read(level as usize, row..row + lines.len(), y);
            }
            let ranges = auxiliaries.start as usize..auxiliaries.end as usize;
            for own in &blocking.auxiliaries[ranges] {
                let own = own.start as usize..own.end as usize;
                let lines = behind + own.start..behind + own.end;
                self.step_lines(lines, constants, y, x, start);
                if let Some(couplings) = steps.couplings {
                    self.step_couplings(constants, own.clone(), &couplings[own.clone()], y, x);
                }
                let cells = self.block.cells();
                read(level as usize, cells + own.start..cells + own.end, y);
            }
        }
    }
}

#[cfg(test)]
mod tests;
