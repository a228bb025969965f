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

use crate::base::machine::{cache_per_core, last_cache_per_core};
use crate::matrix::block_matrix::BlockMatrix;
use crate::matrix::lanes::{Lanes, StartRow, StepConstants};
use crate::matrix::row_lines::RowLines;
use crate::parallel::communicator::GhostExchange;
use crate::parallel::partition::split;
use std::ops::Range;

/// Most steps in one pass.
pub const MOST_LEVELS: usize = 16;
/// The same as planned in more than one dimension: cells along the edges of strips are read from
/// memory again, and deeper passes were measured to be slower.
const MOST_LEVELS_IN_STRIPS: usize = 8;
/// Bytes of the vectors for a row: two batches and the start.
const BYTES_PER_ROW: f64 = 2.0 * size_of::<Lanes>() as f64 + 8.0;
/// Part of the cache that the tiles in use may fill: cache lines that map to the same set evict
/// each other before the cache is full.
const SHARE: f64 = 0.55;
/// The same for tiles that overflow the cache of a core a little, so that most of a pass is in it.
const LARGER_SHARE: f64 = 1.2;
/// Fewest rows of a tile that is not a whole cell.
const FEWEST_ROWS: usize = 64;
/// Time in ns of a row of a step whose data are in the cache of a core: its arithmetic. This and
/// the following times were measured (docs/performance.md); only their ratios matter.
const ARITHMETIC: f64 = 4.5;
/// Extra ns for each byte of the vectors that is read from memory.
const FROM_MEMORY: f64 = 0.04;
/// Extra ns for each byte that is read from the last-level cache; arithmetic hides most of it.
const FROM_LAST_CACHE: f64 = 0.004;
/// Extra ns for each tile.
const TILE: f64 = 80.0;
/// Least part of a step's time that blocking must save.
const LEAST_GAIN: f64 = 0.03;

/// The parameters of a blocking.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BlockingShape {
    /// Steps in one pass, at most [`MOST_LEVELS`].
    pub depth: usize,
    /// Cells of a strip along each x-axis but the first.
    pub width: usize,
    /// Ranges of velocities.
    pub parts: usize,
}

/// Lines that advance together.
#[derive(Clone, Debug)]
struct Tile {
    /// Lines of cells.
    lines: Range<u32>,
    /// The tile's auxiliary unknowns, as indices into [`Blocking::auxiliaries`].
    auxiliaries: Range<u32>,
}

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

    /// The same, with the neighbours of tiles of as many parts or a multiple.
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

    /// The same for a machine with these caches.
    pub fn planned_for(matrix: &BlockMatrix, steps: usize, caches: Caches) -> Self {
        let parts = matrix.independent_velocities();
        Self::of_shapes(matrix, steps, &Self::shapes(matrix, caches, BYTES_PER_ROW, parts))
    }

    /// The same for steps whose results are read at once and added to a third vector. A tile then
    /// has all velocities.
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
    fn of_shapes(matrix: &BlockMatrix, steps: usize, shapes: &[Option<BlockingShape>]) -> Self {
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

/// Bytes of the caches of a core.
#[derive(Clone, Copy, Debug)]
pub struct Caches {
    /// The cache of the core alone.
    pub own: f64,
    /// The core's share of the last-level cache.
    pub last: f64,
}

impl Caches {
    /// The caches of this machine.
    pub fn here() -> Self {
        Self { own: cache_per_core() as f64, last: last_cache_per_core() as f64 }
    }

    /// The part of them that vectors may fill.
    fn part(self, share: f64) -> Self {
        Self { own: share * self.own, last: share * self.last }
    }
}

/// Memory and traffic of a blocking of given depth and width.
struct BlockingCost {
    /// Tiles in use.
    sections: f64,
    /// Bytes that a step moves, relative to unblocked steps.
    traffic: f64,
    depth: usize,
    width: usize,
}

impl BlockingShape {
    /// The shape of least modelled time whose tiles in use fit into the last-level cache; none if
    /// it is not faster than single steps. `vectors` are the bytes of vectors for a row, and a tile
    /// has one of at most `most_parts` parts of the velocities.
    ///
    /// The time of a row is that of its arithmetic, its share of the overhead of a tile, and the
    /// time to load its bytes from the last-level cache and, unless all data fit into it, from
    /// memory. With blocking, bytes are loaded from memory once for several steps. If the tiles in
    /// use fit into the cache of a core, so they are from the last-level cache. Where the
    /// last-level cache is larger, this counts for whole cells only: ranges of velocities lie apart
    /// by strides near a power of two, and may evict each other.
    fn planned(
        matrix: &BlockMatrix,
        caches: Caches,
        vectors: f64,
        most_parts: usize,
    ) -> Option<Self> {
        let rows = matrix.rows() as f64;
        let bytes = vectors + matrix.bytes() as f64 / rows;
        if bytes * rows <= caches.own {
            return None;
        }
        let from_memory = if bytes * rows <= caches.last { 0.0 } else { bytes * FROM_MEMORY };
        let from_last_cache = bytes * FROM_LAST_CACHE;
        let step_by_step = from_memory + from_last_cache;
        let mut best = (step_by_step - LEAST_GAIN * (ARITHMETIC + step_by_step), None);
        // Powers of two: the ranges of more parts are within those of fewer.
        for parts in (0..).map(|k| 1 << k).take_while(|parts| *parts <= most_parts) {
            let nodes = matrix.stored().lines().nodes;
            let tile = nodes * matrix.block.velocity_cells.div_ceil(parts);
            let a_tile = bytes * tile as f64;
            for BlockingCost { sections, traffic, depth, width } in Self::all(matrix) {
                if sections * a_tile > caches.last {
                    continue;
                }
                let whole = parts == 1 || caches.last <= caches.own;
                let in_own = whole && sections * a_tile <= caches.own;
                let again = if in_own { traffic } else { 1.0 };
                let time = traffic * from_memory + again * from_last_cache + TILE / tile as f64;
                if time < best.0 {
                    best = (time, Some(Self { depth, width, parts }));
                }
            }
        }
        best.1
    }

    /// All depths and widths.
    fn all(matrix: &BlockMatrix) -> impl Iterator<Item = BlockingCost> {
        let block = &matrix.block;
        let nodes = matrix.stored().lines().nodes;
        let across = &block.ranges[1..];
        let widest = across.iter().map(Range::len).max().unwrap_or(1);
        let wide = block.wide_ranges();
        let most = if across.is_empty() { MOST_LEVELS } else { MOST_LEVELS_IN_STRIPS };
        let deepest = most.min(block.ranges[0].len() / nodes);
        let widths = (0..).map(|k| 1 << k).take_while(move |w| *w < 2 * widest);
        let all = widths.flat_map(move |width| (2..=deepest).map(move |depth| (depth, width)));
        all.map(move |(depth, width)| {
            // Along the edge of a strip, `depth` cells are read once more.
            let (mut section, mut edges) = (1.0, 1.0);
            for axis in across {
                let (cells, open) = (width.min(axis.len()) as f64, depth as f64);
                let cut = width < axis.len();
                section *= if cut { cells + 0.5 * open } else { cells };
                edges *= if cut { 1.0 + open / cells } else { 1.0 };
            }
            // Towards ghosts `depth` cells wait for them level by level; on a periodic axis, for
            // the cells at the other end.
            let waiting: f64 = (block.ranges.iter().zip(&wide).enumerate())
                .map(|(a, (own, wide))| {
                    let around = if a == 0 && block.first_axis_is_periodic { 2 } else { 0 };
                    let sides = (wide.len() - own.len() + around) as f64;
                    let cells = if a == 0 { own.len() / nodes } else { own.len() };
                    0.5 * sides * depth as f64 / cells as f64
                })
                .sum();
            let sections = section * (depth + 2) as f64;
            BlockingCost { sections, traffic: edges / depth as f64 + waiting, depth, width }
        })
    }
}

/// Calls `visit` with the row-major number of every cell of a box of `sizes`. Strips of all axes
/// but the first follow each other, each along the first axis.
fn for_each_in_strips(sizes: &[usize], width: usize, mut visit: impl FnMut(usize)) {
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
struct Tiling {
    lines: RowLines,
    parts: usize,
    velocities: usize,
    /// Velocities that are in one tile.
    unit: usize,
    tiles: Vec<Tile>,
    /// The auxiliary unknowns of each tile.
    auxiliaries: Vec<Range<u32>>,
}

impl Tiling {
    fn new(matrix: &BlockMatrix, parts: usize) -> Self {
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
    fn sizes(&self, matrix: &BlockMatrix) -> Vec<usize> {
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
    fn neighbours(&self, matrix: &BlockMatrix) -> Neighbours {
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
struct Neighbours {
    /// Tiles of a cell.
    parts: usize,
    ends: Vec<usize>,
    tiles: Vec<u32>,
    /// Whether a tile is coupled to ghosts.
    border: Vec<bool>,
}

impl Neighbours {
    fn of(&self, tile: usize) -> &[u32] {
        let start = tile.checked_sub(1).map_or(0, |before| self.ends[before]);
        &self.tiles[start..self.ends[tile]]
    }

    /// The neighbours of tiles of fewer parts, a divisor of these.
    fn merged(&self, parts: usize) -> Self {
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
    fn independent_velocities(&self) -> usize {
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

    /// The same, with calls of `read(step, rows, vector)` as soon as rows of a vector are computed.
    /// Rows come in runs of whole tiles.
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
mod tests {
    use super::*;
    use crate::parallel::partition::{Block, ProcessMesh};
    use crate::problem::case::Case;
    use std::collections::BTreeSet;

    /// The matrix of a step of `V` on as many elements along `x` and `v`.
    fn matrix(degree: usize, elements: usize) -> BlockMatrix {
        matrix_of("where = \"x < 0\"\nvalue = \"0.2\"", degree, [elements; 2])
    }

    /// The matrix of a potential that is 0 where it is not given, on `elements` along `x` and `v`.
    fn matrix_of(potential: &str, degree: usize, elements: [usize; 2]) -> BlockMatrix {
        matrix_of_block(potential, degree, elements, -1.5, 1)
    }

    /// The same of the first of `blocks` blocks, for velocities from `lower` on.
    fn matrix_of_block(
        potential: &str,
        degree: usize,
        elements: [usize; 2],
        lower: f64,
        blocks: usize,
    ) -> BlockMatrix {
        let axis = |name: &str, lower: f64, upper: f64, elements: usize| {
            format!("{name} = {{ lower = {lower}, upper = {upper}, cells = {elements} }}\n")
        };
        let text = format!(
            "[[axis]]\n{}{}[[potential]]\n{potential}\n\
             [[potential]]\nvalue = \"0\"\n[scheme]\ndegree = {degree}\n\
             [initial]\nf = \"exp(-x^2)\"\n[time]\nend = 1.0\n",
            axis("x", -1.0, 1.0, elements[0]),
            axis("v", lower, 1.5, elements[1])
        );
        let case = Case::parse("case", &text, &[]).expect("a case");
        let block = Block::new(&case.space, &ProcessMesh { space: vec![blocks], groups: 1 }, 0);
        let mut matrix = BlockMatrix::assemble(&case, block).expect("finite formulas");
        matrix.gather_elements();
        matrix
    }

    /// The shape for a core with 1 MiB of its own and 16 MiB of the last-level cache.
    fn planned(degree: usize, elements: usize) -> Option<[usize; 3]> {
        let matrix = matrix(degree, elements);
        let caches = Caches { own: 1048576.0, last: 16777216.0 }.part(SHARE);
        let parts = matrix.independent_velocities();
        let shape = BlockingShape::planned(&matrix, caches, BYTES_PER_ROW, parts)?;
        Some([shape.depth, shape.width, shape.parts])
    }

    /// Small grids are not blocked, nor elements in the last-level cache whose tiles do not fit
    /// into that of a core. For grids in memory, tiles in the last-level cache have many levels.
    #[test]
    fn blocking_is_where_the_model_saves_time() {
        for (degree, elements, expected) in [
            (0, 32, None),
            (0, 128, Some([14, 1, 1])),
            (0, 512, Some([16, 1, 1])),
            (3, 8, None),
            // 290 bytes a row: four tiles of 512 rows take 594 kB, and 577 kB may be filled.
            (3, 32, None),
            (4, 26, None),
            (8, 14, None),
            (8, 28, Some([16, 1, 2])),
        ] {
            assert_eq!(planned(degree, elements), expected, "degree {degree}, {elements}");
        }
    }

    /// The neighbours of merged tiles are those of the rows of these tiles.
    #[test]
    fn merged_tiles_have_the_neighbours_of_their_rows() {
        let step = "where = \"x < 0\"\nvalue = \"0.2\"";
        // Of two blocks, with particles at rest, which are not coupled to ghosts.
        let rests = matrix_of_block(step, 0, [24, 8], -0.1, 2);
        let all = [(0, 24), (2, 9)]
            .map(|(degree, elements)| (degree, elements, matrix_of(step, degree, [elements; 2])));
        for (degree, elements, matrix) in all.into_iter().chain([(0, 12, rests)]) {
            let fine = Tiling::new(&matrix, 8).neighbours(&matrix);
            for parts in [1, 2, 4, 8] {
                let (merged, own) = (fine.merged(parts), Tiling::new(&matrix, parts));
                let own = own.neighbours(&matrix);
                assert!(own.ends.len() >= elements * parts && merged.border == own.border);
                for tile in 0..own.ends.len() {
                    let [a, b] = [&merged, &own].map(|n| BTreeSet::from_iter(n.of(tile)));
                    assert_eq!(a, b, "degree {degree}, {parts} parts, tile {tile}");
                }
            }
        }
    }

    /// A force in few cells couples the velocities of an element. No range of velocities is a part
    /// of an element, so that ranges nest for any number of elements.
    #[test]
    fn ranges_of_velocities_nest_where_a_force_acts_in_few_cells() {
        let force = "where = \"x < -0.9\"\nvalue = \"x + 0.9\"";
        for (degree, elements) in [(8, [20, 15]), (8, [20, 7]), (3, [20, 30])] {
            let matrix = matrix_of(force, degree, elements);
            let most = matrix.independent_velocities();
            assert!(1 < most && most <= elements[1], "{most} ranges of {} elements", elements[1]);
            let most = 1 << most.ilog2();
            let shape = |parts| Some(BlockingShape { depth: 2, width: 1, parts });
            let all = FastestBlocking::of_shapes(&matrix, 1000, &[shape(most), shape(most / 2)]);
            let parts: Vec<_> = all.all().iter().flatten().map(|b| b.shape().parts).collect();
            assert_eq!(parts, [most, most / 2]);
        }
    }

    /// Each candidate is timed twice, and the least time counts. The last pass of a series may be
    /// shorter, and does not count.
    #[test]
    fn the_fastest_candidate_is_kept() {
        let matrix = matrix(0, 8);
        let shape = |depth| BlockingShape { depth, width: 1, parts: 1 };
        let deep = |depth| Some(Blocking::new(&matrix, &shape(depth)));
        let mut fastest = FastestBlocking::of(vec![None, deep(2), deep(3)]);
        for (depth, seconds) in [(1, 0.5), (2, 0.6), (3, 3.0), (1, 0.9), (2, 9.0), (3, 1.2)] {
            assert_eq!(fastest.depth(), depth);
            if depth > 1 {
                fastest.passed(1, 0.0);
            }
            fastest.passed(depth, seconds);
        }
        // 0.5, 0.3 and 0.4 seconds a step.
        assert_eq!(fastest.depth(), 2);
        fastest.passed(2, 100.0);
        assert_eq!(fastest.depth(), 2);
    }

    /// Where no series is as long as a pass, passes are timed as they are.
    #[test]
    fn candidates_deeper_than_every_series_are_timed() {
        let matrix = matrix(0, 8);
        let deep =
            |depth| Some(Blocking::new(&matrix, &BlockingShape { depth, width: 1, parts: 1 }));
        let mut fastest = FastestBlocking::of(vec![deep(6), deep(5), None]);
        for _ in 0..20 {
            let depth = fastest.depth();
            // Series of 4 steps, of 1 second a step with blocking, and of half of it without.
            match depth {
                1 => fastest.passed(1, 0.5),
                _ => fastest.passed(4, 4.0),
            }
        }
        assert_eq!(fastest.depth(), 1);
    }

    /// Where there are too few steps for trials, the first shape is taken as it is.
    #[test]
    fn few_steps_are_not_tried_in_several_ways() {
        let matrix = matrix(0, 8);
        let shape = |depth| Some(BlockingShape { depth, width: 1, parts: 1 });
        // 12 steps for the planning and 2 (1 + 2 + 3) timed ones, and three times as many.
        for (steps, expected) in [(71, vec![2]), (72, vec![2, 3, 1]), (1000, vec![2, 3, 1])] {
            let fastest = FastestBlocking::of_shapes(&matrix, steps, &[shape(2), shape(3)]);
            let depths = fastest.all().iter().map(|c| c.as_ref().map_or(1, Blocking::depth));
            assert_eq!(depths.collect::<Vec<_>>(), expected, "{steps} steps");
        }
        let single = FastestBlocking::of_shapes(&matrix, 10, &[None, shape(3)]);
        assert_eq!((single.all().len(), single.depth()), (1, 1));
    }
}
