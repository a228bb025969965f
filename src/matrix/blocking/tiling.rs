//! The tiles of a blocking, and which of them are coupled.

use crate::matrix::block_matrix::BlockMatrix;
use crate::matrix::row_lines::RowLines;
use crate::parallel::partition::split;
use std::ops::Range;

/// Fewest rows of a tile that is not a whole cell.
pub(super) const FEWEST_ROWS: usize = 64;

/// Lines that advance together.
#[derive(Clone, Debug)]
pub(super) struct Tile {
    /// Lines of cells.
    pub(super) lines: Range<u32>,
    /// The tile's auxiliary unknowns, as indices into those of the blocking.
    pub(super) auxiliaries: Range<u32>,
}

/// Calls `visit` with the row-major number of every cell of a box of `sizes`. Strips of all axes
/// but the first follow each other, each along the first axis.
pub(super) fn for_each_in_strips(sizes: &[usize], width: usize, mut visit: impl FnMut(usize)) {
    let (along, sizes) = (sizes[0], &sizes[1..]);
    let section: usize = sizes.iter().product();
    // The cells of a section by the strip they are in.
    let mut order: Vec<(Vec<usize>, usize)> = (0..section)
        .map(|cell| {
            let mut rest = cell;
            let mut strip = vec![0; sizes.len()];
            for (a, size) in sizes.iter().enumerate().rev() {
                strip[a] = rest % size / width;
                rest /= size;
            }
            (strip, cell)
        })
        .collect();
    order.sort();
    for strip in order.chunk_by(|a, b| a.0 == b.0) {
        for i in 0..along {
            strip.iter().for_each(|(_, cell)| visit(i * section + cell));
        }
    }
}

/// The tiles: `parts` nearly equal ranges of velocities at each cell, or at an element's nodes
/// along the first axis. Elements of velocity lines are not parted.
pub(super) struct Tiling {
    lines: RowLines,
    pub(super) parts: usize,
    velocities: usize,
    /// Velocities that are in one tile.
    unit: usize,
    pub(super) tiles: Vec<Tile>,
    /// The auxiliary unknowns of each tile.
    pub(super) auxiliaries: Vec<Range<u32>>,
}

impl Tiling {
    pub(super) fn new(matrix: &BlockMatrix, parts: usize) -> Self {
        let velocities = matrix.block.velocity_cells;
        let lines = *matrix.stored().lines();
        let cells = matrix.block.space_cells() / lines.nodes;
        let unit = matrix.stored().velocity_lines().unit();
        let parts = parts.clamp(1, velocities / unit);
        let mut this = Self {
            lines,
            parts,
            velocities,
            unit,
            tiles: Vec::with_capacity(cells * parts),
            auxiliaries: Vec::new(),
        };
        // The auxiliary unknowns of cells below a row.
        let below = |row: usize| matrix.inflow.partition_point(|aux| (aux.row as usize) < row);
        for cell in 0..cells {
            for part in 0..parts {
                let Range { start, end } = split(&(0..velocities / unit), parts, part);
                let range = start * unit..end * unit;
                let first = this.auxiliaries.len() as u32;
                for row in matrix.stored().lines().rows_of_cells(cell * velocities + range.start) {
                    let [from, to] = [row, row + range.len()].map(|row| below(row) as u32);
                    if from < to {
                        this.auxiliaries.push(from..to);
                    }
                }
                let start = (cell * velocities) as u32;
                this.tiles.push(Tile {
                    lines: start + range.start as u32..start + range.end as u32,
                    auxiliaries: first..this.auxiliaries.len() as u32,
                });
            }
        }
        this
    }

    /// Cells along each space axis: elements along the first.
    pub(super) fn sizes(&self, matrix: &BlockMatrix) -> Vec<usize> {
        let mut sizes: Vec<usize> = matrix.block.ranges.iter().map(Range::len).collect();
        sizes[0] /= self.lines.nodes;
        sizes
    }

    /// The tile of a row of cells.
    fn tile_of(&self, row: usize) -> usize {
        let (line, _) = self.lines.line_and_node(row);
        let (cell, v) = (line / self.velocities, line % self.velocities);
        // The ranges of `split`.
        cell * self.parts + ((v / self.unit + 1) * self.parts - 1) / (self.velocities / self.unit)
    }

    /// The tiles to which each tile is coupled by an entry.
    pub(super) fn neighbours(&self, matrix: &BlockMatrix) -> Neighbours {
        let cells = matrix.block.cells();
        let ghosts = matrix.rows();
        let mut found = Neighbours {
            parts: self.parts,
            ends: Vec::with_capacity(self.tiles.len()),
            tiles: Vec::new(),
            border: vec![false; self.tiles.len()],
        };
        let mut seen = vec![u32::MAX; self.tiles.len()];
        for (t, Tile { lines, .. }) in self.tiles.iter().enumerate() {
            seen[t] = t as u32;
            // An auxiliary unknown is coupled to its own row only, in the same tile.
            let lines = lines.start as usize..lines.end as usize;
            for i in lines.flat_map(|line| self.lines.rows_of_cells(line)) {
                for (column, _, _) in matrix.row(i) {
                    if column >= cells {
                        found.border[t] |= column >= ghosts;
                        continue;
                    }
                    let other = self.tile_of(column);
                    if seen[other] != t as u32 {
                        seen[other] = t as u32;
                        found.tiles.push(other as u32);
                    }
                }
            }
            found.ends.push(found.tiles.len());
        }
        found
    }
}

/// The tiles to which each tile is coupled.
pub(super) struct Neighbours {
    /// Tiles of a cell.
    parts: usize,
    pub(super) ends: Vec<usize>,
    tiles: Vec<u32>,
    /// Whether a tile is coupled to ghosts.
    pub(super) border: Vec<bool>,
}

impl Neighbours {
    pub(super) fn of(&self, tile: usize) -> &[u32] {
        let start = tile.checked_sub(1).map_or(0, |before| self.ends[before]);
        &self.tiles[start..self.ends[tile]]
    }

    /// The neighbours of tiles of fewer parts, a divisor of these.
    pub(super) fn merged(&self, parts: usize) -> Self {
        assert_eq!(self.parts % parts, 0, "ranges of velocities do not nest");
        let each = self.parts / parts;
        let count = self.ends.len() / each;
        let mut merged = Self {
            parts,
            ends: Vec::with_capacity(count),
            tiles: Vec::new(),
            border: self.border.chunks(each).map(|parts| parts.contains(&true)).collect(),
        };
        let mut seen = vec![u32::MAX; count];
        for tile in 0..count {
            seen[tile] = tile as u32;
            for other in (tile * each..(tile + 1) * each).flat_map(|fine| self.of(fine)) {
                let other = *other as usize / each;
                if seen[other] != tile as u32 {
                    seen[other] = tile as u32;
                    merged.tiles.push(other as u32);
                }
            }
            merged.ends.push(merged.tiles.len());
        }
        merged
    }
}

impl BlockMatrix {
    /// Most ranges of velocities that are not coupled to each other, but for a few cells of space.
    /// They are as small as is worth a tile; in more than one dimension they have the size of a
    /// line of the last axis at least, as a jump in `x` couples only velocities along `x`. Each has
    /// an element of velocity at least. One if a force acts.
    pub(super) fn independent_velocities(&self) -> usize {
        let (nv, count) = (self.block.velocity_cells, self.block.space_cells());
        let coupled = |cell: &usize| {
            let rows = cell * nv..(cell + 1) * nv;
            let within = |i: usize| self.row(i).any(|(j, _, _)| j != i && rows.contains(&j));
            rows.clone().any(within)
        };
        if 8 * (0..count).filter(coupled).count() > count {
            return 1;
        }
        let line = if self.block.ranges.len() == 1 { 1 } else { self.block.velocity_line };
        let rows = line * self.stored().lines().nodes;
        let elements = nv / self.stored().velocity_lines().unit();
        (nv / (line * FEWEST_ROWS.div_ceil(rows))).clamp(1, elements)
    }
}
