//! Space cells with equal rows of `(S, K)`, relative to the diagonal. Only one of them is
//! evaluated.
//!
//! For degree 0, a row of `(S, K)` is determined by its velocity, by the slopes and jumps of `V` at
//! its space cell, and by the numbers of the neighbouring space cells. The part of a neighbour's
//! row that draws from the cell depends only on the jump at their common face. Space cells that
//! agree in all of this have equal rows, at equal distances from the diagonal. A row that draws on
//! the inflow has its own values, or its own auxiliary unknown: a cell with such a row is like no
//! other.

use crate::parallel::partition::{Block, LocalIndex};
use crate::problem::case::{Case, Embedding};
use crate::problem::grid::{Cell, PhaseSpace, for_each_cell};
use crate::scheme::rows::{Row, Scheme};
use std::collections::{HashMap, HashSet};

/// For each space cell of a block, the first cell that has equal rows.
pub(super) struct CellsWithEqualRows {
    /// For each space cell of the block, the first one with equal rows.
    first: Vec<usize>,
    /// The first unknowns of the space cells, with ghosts, whose rows of `A` are evaluated: those
    /// of the cells whose row equals that of no earlier cell, and of their neighbours. None if all
    /// are evaluated.
    evaluated: Option<HashSet<usize>>,
    /// Velocity cells at a point of space.
    velocities: usize,
}

/// A space cell of a block.
struct SpaceCell {
    /// Number of the cell in the block.
    number: usize,
    /// The cell of phase space at its first velocity.
    index: Cell,
    /// The first unknowns of the cells next to it, lower and upper along each axis.
    neighbours: Vec<Option<usize>>,
}

impl SpaceCell {
    fn new(space: &PhaseSpace, number: usize, i: &[usize]) -> Self {
        let mut index = Cell::default();
        index[..i.len()].copy_from_slice(i);
        let next = |(a, step): (usize, i64)| {
            let mut next = index;
            next[a] = space.wrap(a, index[a] as i64 + step)?;
            Some(space.index(&next))
        };
        let sides = (0..space.dimension()).flat_map(|a| [(a, -1), (a, 1)]);
        Self { number, index, neighbours: sides.map(next).collect() }
    }

    /// The numbers that determine its rows.
    fn kind(&self, space: &PhaseSpace, scheme: &Scheme<'_>, block: &Block) -> Vec<u64> {
        let potential = &scheme.potential;
        let first = space.index(&self.index);
        let local = self.number * block.velocity_cells;
        let mut kind = Vec::new();
        for a in 0..space.dimension() {
            let slope = potential.slope(&self.index, a);
            let jumps =
                [potential.jump_below(&self.index, a), potential.jump_above(&self.index, a)];
            kind.extend([slope, jumps[0], jumps[1]].map(f64::to_bits));
        }
        for neighbour in &self.neighbours {
            let Some(global) = *neighbour else {
                kind.extend([0, 0, 0]);
                continue;
            };
            let (is_ghost, at) = match block.local(global) {
                Some(LocalIndex::Own(at)) => (1, at),
                Some(LocalIndex::Ghost(at)) => (2, at),
                None => (3, 0),
            };
            kind.extend([
                is_ghost,
                global.wrapping_sub(first) as u64,
                at.wrapping_sub(local) as u64,
            ]);
        }
        kind
    }
}

impl CellsWithEqualRows {
    /// Every cell of `block` is treated as different.
    pub fn none(block: &Block) -> Self {
        let first = (0..block.space_cells()).collect();
        Self { first, evaluated: None, velocities: block.velocity_cells }
    }

    /// The cells of `block` that are alike.
    pub fn new(case: &Case, scheme: &Scheme<'_>, block: &Block, row: &mut Row) -> Self {
        let mut this = Self::none(block);
        if case.is_galerkin() || case.embeds() && case.warp.inflow == Embedding::Full {
            return this;
        }
        let velocities = block.velocity_cells;
        let mut kinds: HashMap<Vec<u64>, Option<usize>> = HashMap::new();
        let mut evaluated = HashSet::new();
        let mut draws = |cell: &Cell| {
            let first = case.space.index(cell);
            case.embeds()
                && (first..first + velocities).any(|i| {
                    scheme.row(row, i);
                    row.inflow_rate != 0.0
                })
        };
        let mut number = 0;
        for_each_cell(&block.ranges, |i| {
            let cell = SpaceCell::new(&case.space, number, &i[..case.space.dimension()]);
            let like = *kinds
                .entry(cell.kind(&case.space, scheme, block))
                .or_insert_with(|| (!draws(&cell.index)).then_some(number));
            this.first[number] = like.unwrap_or(number);
            if this.first[number] == number {
                evaluated.insert(case.space.index(&cell.index));
                evaluated.extend(cell.neighbours.iter().flatten());
            }
            number += 1;
        });
        this.evaluated = Some(evaluated);
        this
    }

    /// The earlier row of the block that row `row` equals, if there is one.
    pub fn earlier(&self, row: usize) -> Option<usize> {
        let cell = row / self.velocities;
        let first = self.first[cell];
        (first != cell).then(|| row - (cell - first) * self.velocities)
    }

    /// Whether the rows of `A` at the space cell whose first unknown is `global` are evaluated.
    pub fn are_evaluated(&self, global: usize) -> bool {
        self.evaluated.as_ref().is_none_or(|list| list.contains(&global))
    }
}
