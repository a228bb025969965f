//! Assembly of a block's rows of `(S, K)` from the scheme's rows of `A`, layer by layer along the
//! first x-axis.
//!
//! An entry `A_ij` adds `½ A_ij` to entry `(i, j)` of `S` and of `K`, and `½ A_ij` and `−½ A_ij` to
//! their entry `(j, i)`. A row of `A` draws on cells of its own layer and of the two adjacent ones,
//! so contributions to three layers are collected at a time. Each row of `A`, ghosts included, is
//! evaluated once, and at most three layers are stored uncompressed.
//!
//! Layers are those of elements, as a row draws on all cells of its element.
//!
//! For degree 0, equal rows are evaluated once (see `CellsWithEqualRows`).
//!
//! If the first axis is periodic, the last layer is adjacent to the first. Contributions of the
//! first layer to the last are stored until then. Rows of the last layer are evaluated once more at
//! the beginning, for their contributions to the first.

use crate::base::error::Result;
use crate::matrix::block_matrix::BlockMatrix;
use crate::matrix::bundles::Bundles;
use crate::matrix::equal_rows::CellsWithEqualRows;
use crate::matrix::inflow::{AuxiliaryRow, InflowRows, VaryingInflow};
use crate::matrix::row_lines::MatrixEntry;
use crate::matrix::rows::{AssemblySize, Rows, RowsBuilder};
use crate::matrix::velocity_lines::VelocityLines;
use crate::parallel::partition::{Block, LocalIndex};
use crate::problem::case::{Case, Embedding};
use crate::problem::grid::PhaseSpace;
use crate::scheme::rows::{Row, Scheme};
use std::ops::Range;

/// Bytes of the layers that are collected and sorted at a time, on a block with `layers` layers of
/// `rows` rows, with so many contributions to a row.
pub fn layer_bytes(layers: u64, rows: u64, contributions_per_row: f64) -> u64 {
    let stored = stored_layers(layers as usize) as u64 * rows;
    (stored as f64 * contributions_per_row * size_of::<Contribution>() as f64) as u64
}

/// Number of layers for which there is memory at a time, on a block with `layers` layers: up to
/// three are collected, and one is sorted.
fn stored_layers(layers: usize) -> usize {
    layers.min(COLLECTED) + 1
}

/// Number of layers that a row contributes to: its own and the two adjacent ones.
const COLLECTED: usize = 3;

/// The contribution of a row of `A` to row `row` of a layer.
#[derive(Clone, Copy)]
struct Contribution {
    /// Row, counted in the layer.
    row: u32,
    /// Local column.
    column: u32,
    /// Global column, by which entries are sorted.
    key: usize,
    s: f64,
    k: f64,
}

/// Scratch for sorting a layer.
#[derive(Default)]
struct Sorter {
    ends: Vec<usize>,
    sorted: Vec<Contribution>,
    entries: Vec<MatrixEntry>,
}

impl Sorter {
    /// Passes the `rows` rows of `layer` to `take`, in order, and empties the layer. Entries are
    /// sorted by global column, and those of the same column are added. These are at most two, so
    /// that their sum does not depend on the order.
    fn drain(
        &mut self,
        layer: &mut Vec<Contribution>,
        rows: usize,
        mut take: impl FnMut(&mut Vec<MatrixEntry>),
    ) {
        let Self { ends, sorted, entries } = self;
        ends.clear();
        ends.resize(rows + 1, 0);
        for part in &*layer {
            ends[part.row as usize + 1] += 1;
        }
        for i in 0..rows {
            ends[i + 1] += ends[i];
        }
        // Only for the length: every element is overwritten.
        sorted.clear();
        sorted.extend_from_slice(layer);
        for part in layer.drain(..) {
            let next = &mut ends[part.row as usize];
            sorted[*next] = part;
            *next += 1;
        }
        let mut start = 0;
        for &end in &ends[..rows] {
            let row = &mut sorted[start..end];
            row.sort_unstable_by_key(|part| part.key);
            entries.clear();
            for (n, part) in row.iter().enumerate() {
                match entries.last_mut() {
                    Some(last) if n > 0 && row[n - 1].key == part.key => {
                        last.1 += part.s;
                        last.2 += part.k;
                    }
                    _ => entries.push((part.column, part.s, part.k)),
                }
            }
            take(entries);
            start = end;
        }
    }
}

/// The rows that have an auxiliary unknown or are coupled to the common one, and the sources of a
/// time-dependent inflow.
fn inflow_rows(
    case: &Case,
    scheme: &Scheme<'_>,
    block: &Block,
    equal_rows: &CellsWithEqualRows,
    row: &mut Row,
) -> InflowRows {
    let varies = case.varies();
    let listed = |row: &Row| match case.warp.inflow {
        Embedding::Full => true,
        Embedding::Boundary | Embedding::Scalar if varies => !row.sources.is_empty(),
        Embedding::Boundary | Embedding::Scalar if case.enters() => {
            row.inflow.iter().any(|&b| b != 0.0)
        }
        Embedding::Boundary | Embedding::Scalar => row.inflow_rate != 0.0,
    };
    let mut rows = InflowRows {
        list: Vec::new(),
        entering: VaryingInflow::default(),
        shared: case.embeds() && case.warp.inflow == Embedding::Scalar,
    };
    if !case.embeds() {
        return rows;
    }
    block.for_each_own(|global, local| {
        // An earlier cell equals it only if it draws on no inflow.
        if equal_rows.earlier(local).is_some() {
            return;
        }
        for v in 0..block.velocity_cells {
            scheme.row(row, global + v);
            if listed(row) {
                rows.list.push(AuxiliaryRow {
                    row: (local + v) as u32,
                    values: row.inflow,
                    damping: row.damping,
                    strength: scheme.inflow_strength(row),
                    coupling: 0.0,
                });
                if varies {
                    rows.entering.push(row);
                }
            }
        }
    });
    rows
}

/// The global and local number of an unknown, or of the first one of a space cell.
#[derive(Clone, Copy)]
struct UnknownNumbers {
    global: usize,
    local: usize,
}

/// The space cells of a block and its ghosts, by layer along the first x-axis.
struct Layers<'a> {
    equal_rows: &'a CellsWithEqualRows,
    /// The first unknown of each space cell, layer by layer.
    cells: Vec<UnknownNumbers>,
    /// The block's layers, by element of the first x-axis.
    range: Range<usize>,
    /// Unknowns of a layer of the whole grid.
    global_size: usize,
    /// Unknowns of a layer of the block.
    local_size: usize,
    /// Velocity cells at a point of space.
    velocities: usize,
    /// Rows of the block, auxiliary unknowns included: ghosts are numbered from here on.
    rows: usize,
}

impl<'a> Layers<'a> {
    /// The layers of `block`, which has `rows` rows.
    fn new(
        space: &PhaseSpace,
        block: &Block,
        equal_rows: &'a CellsWithEqualRows,
        rows: usize,
    ) -> Self {
        let velocities = block.velocity_cells;
        let leading = &space.x[0];
        let count = leading.nodes.count();
        let range = block.ranges[0].start / count..block.ranges[0].end / count;
        let mut this = Self {
            equal_rows,
            cells: Vec::with_capacity(block.space_cells() + block.ghosts() / velocities),
            global_size: space.cells() / leading.elements(),
            local_size: block.cells() / range.len(),
            range,
            velocities,
            rows,
        };
        let cells = &mut this.cells;
        block.for_each_own(|global, local| cells.push(UnknownNumbers { global, local }));
        block.for_each_ghost(|global, ghost| {
            let local = rows + ghost;
            cells.push(UnknownNumbers { global, local });
        });
        let size = this.global_size;
        this.cells.sort_by_key(|cell| cell.global / size);
        this
    }

    /// The layer of a global unknown.
    fn of(&self, global: usize) -> usize {
        global / self.global_size
    }

    /// The space cells of each layer.
    fn each(&self) -> impl DoubleEndedIterator<Item = &[UnknownNumbers]> {
        (self.cells).chunk_by(|a, b| self.of(a.global) == self.of(b.global))
    }

    /// The unknowns of those space cells among `cells` whose rows are evaluated.
    fn unknowns(&self, cells: &[UnknownNumbers]) -> impl Iterator<Item = UnknownNumbers> {
        let velocities = self.velocities;
        let evaluated = cells.iter().filter(|cell| self.equal_rows.are_evaluated(cell.global));
        evaluated.flat_map(move |&UnknownNumbers { global, local }| {
            (0..velocities).map(move |v| UnknownNumbers { global: global + v, local: local + v })
        })
    }
}

/// Collects the contributions of the rows of `A`.
struct Collector<'a> {
    block: &'a Block,
    layers: &'a Layers<'a>,
    /// The layer whose rows are being evaluated.
    current: usize,
    /// Contributions to the layer before it, to it and to the next.
    window: [Vec<Contribution>; COLLECTED],
    /// Contributions of the first layer to the last one around a periodic axis.
    wrapped: Vec<Contribution>,
}

impl Collector<'_> {
    /// Adds an entry to local row `target` in `layer` of the block, unless it equals an earlier
    /// row.
    fn put(&mut self, target: usize, layer: usize, column: UnknownNumbers, [s, k]: [f64; 2]) {
        if self.layers.equal_rows.earlier(target).is_some() {
            return;
        }
        let list = match (layer + 1).checked_sub(self.current) {
            Some(next @ 0..=2) => &mut self.window[next],
            Some(_) => &mut self.wrapped,
            None => return,
        };
        let first = (layer - self.layers.range.start) * self.layers.local_size;
        list.push(Contribution {
            row: (target - first) as u32,
            column: column.local as u32,
            key: column.global,
            s,
            k,
        });
    }

    /// Adds the contributions of row `i` of `A`, which is in the current layer, to `S` and `K`.
    fn add(&mut self, i: UnknownNumbers, row: &Row) {
        let cells = self.block.cells();
        for &(global, value) in &row.entries {
            let local = match self.block.local(global) {
                Some(LocalIndex::Own(j)) => j,
                Some(LocalIndex::Ghost(g)) => self.layers.rows + g,
                None => continue,
            };
            let (j, half) = (UnknownNumbers { global, local }, 0.5 * value);
            let diagonal = i.local == j.local;
            if i.local < cells {
                let pair = if diagonal { [value, 0.0] } else { [half, half] };
                self.put(i.local, self.current, j, pair);
            }
            if !diagonal && j.local < cells {
                self.put(j.local, self.layers.of(j.global), i, [half, -half]);
            }
        }
    }

    /// Adds the contributions of the last layer to the first one around a periodic axis.
    fn add_wrapped(&mut self, scheme: &Scheme<'_>, row: &mut Row) {
        let layers = self.layers;
        let last = layers.each().next_back().unwrap_or_default();
        for i in layers.unknowns(last) {
            scheme.row(row, i.global);
            for &(column, value) in row.entries.iter().filter(|e| layers.of(e.0) == 0) {
                if let Some(LocalIndex::Own(j)) = self.block.local(column)
                    && self.layers.equal_rows.earlier(j).is_none()
                {
                    self.window[1].push(Contribution {
                        row: j as u32,
                        column: i.local as u32,
                        key: i.global,
                        s: 0.5 * value,
                        k: -0.5 * value,
                    });
                }
            }
        }
    }
}

/// Calls `finish` with the contributions of the rows of `A` to each layer of `block`, one after the
/// other, as soon as a layer is complete.
fn collect_layers(
    space: &PhaseSpace,
    scheme: &Scheme<'_>,
    block: &Block,
    layers: &Layers<'_>,
    row: &mut Row,
    mut finish: impl FnMut(&mut Vec<Contribution>),
) {
    let range = layers.range.clone();
    let mut collector = Collector {
        block,
        layers,
        current: range.start,
        window: Default::default(),
        wrapped: Vec::new(),
    };
    if space.is_periodic(0) && range.len() > 2 {
        collector.add_wrapped(scheme, row);
    }
    let mut next = range.start;
    for layer in layers.each() {
        collector.current = layers.of(layer[0].global);
        next = collector.current + 1;
        for i in layers.unknowns(layer) {
            scheme.row(row, i.global);
            collector.add(i, row);
        }
        let Collector { window, wrapped, .. } = &mut collector;
        if next == range.end {
            window[1].append(wrapped);
        }
        // The layer before is complete.
        if next > range.start + 1 {
            finish(&mut window[0]);
        }
        window.rotate_left(1);
    }
    if next == range.end {
        finish(&mut collector.window[0]);
    }
}

/// The rows of `block`, layer by layer, then those of its auxiliary unknowns. Rows that are coupled
/// to an auxiliary unknown have an entry for it, zero so far. Also returns the memory it took.
fn rows_by_layers(
    case: &Case,
    scheme: &Scheme<'_>,
    block: &Block,
    equal_rows: &CellsWithEqualRows,
    inflow: &InflowRows,
    row: &mut Row,
) -> (Rows, AssemblySize) {
    let rows = block.cells() + if inflow.shared { 1 } else { inflow.list.len() };
    let layers = Layers::new(&case.space, block, equal_rows, rows);
    // Time-dependent couplings are not stored in the matrix.
    let enters_at = |aux: &AuxiliaryRow| !case.varies() && aux.enters();
    let coupled = inflow.list.iter().enumerate();
    let mut coupled = coupled.filter(|(_, aux)| enters_at(aux)).peekable();
    let mut builder = RowsBuilder::with_capacity(rows);
    let mut sorter = Sorter::default();
    // The largest layer in each of the lists, which are used in turn.
    let (mut done, mut largest) = (0, [0; COLLECTED]);
    collect_layers(&case.space, scheme, block, &layers, row, |layer| {
        let list = &mut largest[done / layers.local_size % COLLECTED];
        *list = layer.len().max(*list);
        sorter.drain(layer, layers.local_size, |entries| {
            if let Some((m, _)) = coupled.next_if(|(_, aux)| aux.row as usize == done) {
                let column = block.cells() + if inflow.shared { 0 } else { m };
                entries.push((column as u32, 0.0, 0.0));
            }
            match equal_rows.earlier(done) {
                Some(earlier) => builder.repeat(earlier),
                None => builder.push(entries),
            }
            done += 1;
        });
    });
    if inflow.shared {
        // The row of the common unknown is a sum over all ranks, see `embedding`.
        builder.push(&[]);
    } else {
        for aux in &inflow.list {
            let entry = [(aux.row, 0.0, 0.0)];
            builder.push(if enters_at(aux) { &entry } else { &[] });
        }
    }
    let stored = largest.iter().sum::<usize>() + largest.iter().max().unwrap_or(&0);
    let stored_rows = stored_layers(layers.range.len()) * layers.local_size;
    let contributions_per_row = stored as f64 / stored_rows as f64;
    let rows = builder.finish();
    let bytes = rows.bytes() + Rows::bytes_to_find_equal(rows.templates());
    (rows, AssemblySize { contributions_per_row, bytes, changed_bytes: bytes })
}

impl BlockMatrix {
    /// Assembles this rank's rows; couplings to auxiliary unknowns are zero until
    /// [`couple`](Self::couple).
    ///
    /// # Errors
    /// [`crate::base::error::Error::Formula`] if `V` or the inflow is not finite. Not collective.
    pub fn assemble(case: &Case, block: Block) -> Result<Self> {
        let scheme = Scheme::new(case, &block.wide_ranges())?;
        let mut row = Row::default();
        // Auxiliary unknowns are numbered before the ghosts, so their count must be known first.
        let equal_rows = CellsWithEqualRows::new(case, &scheme, &block, &mut row);
        let inflow = inflow_rows(case, &scheme, &block, &equal_rows, &mut row);
        let (rows, size) = rows_by_layers(case, &scheme, &block, &equal_rows, &inflow, &mut row);
        scheme.inflow_is_finite(&row)?;
        let velocity_lines =
            VelocityLines::new(&case.space, &block, &scheme.potential, case.scheme.flux);
        let InflowRows { list, entering, shared } = inflow;
        let mut this = Self {
            counts_common: block.ranges.iter().all(|r| r.start == 0),
            block,
            inflow: list,
            entering,
            has_common_unknown: shared,
            common_is_coupled: false,
            common_growth: 0.0,
            by_elements: case.is_galerkin(),
            first_axis_nodes: case.space.x[0].nodes.count(),
            velocity_lines,
            inflow_rows: 0,
            uncoupled: 0.0,
            rows,
            assembly: size,
            bundles: Bundles::default(),
            interior: Vec::new(),
            border: Vec::new(),
        };
        this.find_border();
        if !this.by_elements {
            this.bundle();
        }
        Ok(this)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parallel::partition::ProcessMesh;

    /// Rows that repeat those of alike cells equal rows that are all evaluated, with and without
    /// inflow, around periodic axes and next to ghosts.
    #[test]
    fn rows_of_alike_cells_are_those_evaluated() {
        let rows: [(&str, &[&str], [usize; 2]); 6] = [
            ("example3.toml", &[], [1, 1]),
            ("example3.toml", &[], [2, 2]),
            ("example1.toml", &["axis.0.x.cells=40", "axis.0.v.cells=24"], [3, 1]),
            ("periodic2d.toml", &[], [1, 1]),
            ("inflow_barrier.toml", &["solver.warp.inflow=scalar"], [2, 1]),
            ("inflow_barrier.toml", &["solver.warp.inflow=full"], [2, 1]),
        ];
        for (name, settings, blocks) in rows {
            let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("cases").join(name);
            let settings: Vec<String> = settings.iter().map(|set| set.to_string()).collect();
            let case = Case::load(&path, &settings).expect("a case of the repository");
            let space = blocks[..case.space.dimension()].to_vec();
            let mesh = ProcessMesh { space, groups: 1 };
            let mut repeated = 0;
            for number in 0..mesh.blocks() {
                let block = Block::new(&case.space, &mesh, number);
                let scheme = Scheme::new(&case, &block.wide_ranges()).expect("V is finite");
                let mut row = Row::default();
                let some = CellsWithEqualRows::new(&case, &scheme, &block, &mut row);
                let [found, all] = [some, CellsWithEqualRows::none(&block)].map(|equal_rows| {
                    let mut row = Row::default();
                    let inflow = inflow_rows(&case, &scheme, &block, &equal_rows, &mut row);
                    repeated +=
                        (0..block.cells()).filter(|i| equal_rows.earlier(*i).is_some()).count();
                    rows_by_layers(&case, &scheme, &block, &equal_rows, &inflow, &mut row).0
                });
                assert_eq!((found.len(), found.reach()), (all.len(), all.reach()), "{name}");
                for i in 0..all.len() {
                    assert!(found.row(i).eq(all.row(i)), "{name} {blocks:?} row {i}");
                }
            }
            let is_full = case.warp.inflow == Embedding::Full;
            assert_eq!(repeated > 0, !is_full, "{name}: {repeated} rows repeated");
        }
    }
}
