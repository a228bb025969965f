//! The shape of a blocking, chosen by a model of its time.

use crate::base::machine::{cache_per_core, last_cache_per_core};
use crate::matrix::block_matrix::BlockMatrix;
use std::ops::Range;

/// Most steps in one pass.
pub const MOST_LEVELS: usize = 16;
/// Most steps in a planned pass in more than one dimension: cells along the edges of strips are
/// read from memory again, and deeper passes were measured to be slower.
const MOST_LEVELS_IN_STRIPS: usize = 8;
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
    pub(super) fn part(self, share: f64) -> Self {
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
    pub(super) fn planned(
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
