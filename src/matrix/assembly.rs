//! Assembly of a block's rows of `(S, K)` from the scheme's rows of `A`, layer by layer along the first x-axis.
//!
//! An entry `A_ij` gives `½ A_ij` to entry `(i, j)` of `S` and of `K`, and `½ A_ij`, `−½ A_ij` to entry `(j, i)`. A row of `A` draws on
//! cells of its own layer and of the two next to it, so three layers are collected at a time, each row of `A`, those of ghosts
//! included, is evaluated once, and never are more than three layers kept that are not yet compressed. Where the first axis is
//! periodic, the last layer is next to the first: what the first gives to it waits, and its rows are evaluated beforehand for what
//! they give to the first.

use crate::base::error::Result;
use crate::matrix::block_matrix::BlockMatrix;
use crate::matrix::embedding::{Entering, Inflow};
use crate::matrix::rows::{Builder, Entry};
use crate::parallel::partition::{Block, Place};
use crate::problem::case::{Case, Embedding};
use crate::scheme::rows::{Row, Scheme};

/// What a row of `A` adds to row `row` of a layer.
#[derive(Clone, Copy)]
struct Part {
    /// Row, counted in the layer.
    row: u32,
    /// Local column.
    column: u32,
    /// Global column.
    key: usize,
    s: f64,
    k: f64,
}

/// The parts of one layer's rows.
#[derive(Default)]
struct Layer(Vec<Part>);

/// What sorting a layer needs.
#[derive(Default)]
struct Sorter {
    ends: Vec<usize>,
    sorted: Vec<Part>,
    entries: Vec<Entry>,
}

impl Sorter {
    /// Passes the `rows` rows of `layer` to `take`, in order, and empties it: entries by rising global column, those of the same
    /// column added up. There are two at most, and their sum does not depend on their order.
    fn drain(&mut self, layer: &mut Layer, rows: usize, mut take: impl FnMut(&mut Vec<Entry>)) {
        let Self {
            ends,
            sorted,
            entries,
        } = self;
        ends.clear();
        ends.resize(rows + 1, 0);
        for part in &layer.0 {
            ends[part.row as usize + 1] += 1;
        }
        for i in 0..rows {
            ends[i + 1] += ends[i];
        }
        // Each place is written; what stands there before does not matter.
        sorted.clear();
        sorted.extend_from_slice(&layer.0);
        for part in layer.0.drain(..) {
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

/// The rows that have an auxiliary unknown, or a share in the common one; and where a varying inflow comes from.
struct Listing<'a> {
    case: &'a Case,
    inflow: Vec<Inflow>,
    entering: Entering,
}

impl Listing<'_> {
    /// Whether `row`'s inflow is an entry of the matrix: couplings that vary with time are none.
    fn coupled(&self, row: &Row) -> bool {
        !self.case.varies() && row.inflow.iter().any(|&b| b != 0.0)
    }

    fn visit(&mut self, row: &Row, local: usize) {
        let varies = self.case.varies();
        let listed = match self.case.warp.inflow {
            Embedding::Full => self.case.embeds(),
            Embedding::Boundary | Embedding::Scalar if varies => !row.ghosts.is_empty(),
            Embedding::Boundary | Embedding::Scalar if self.case.enters() => self.coupled(row),
            Embedding::Boundary | Embedding::Scalar => row.draw > 0.0,
        };
        if listed {
            self.inflow.push(Inflow {
                row: local as u32,
                values: row.inflow,
                draw: row.draw,
                coupling: 0.0,
            });
            if varies {
                self.entering.push(row);
            }
        }
    }
}

/// The unknowns of space cells that are given by the numbers of their first ones, global and local.
fn unknowns(cells: &[(usize, usize)], nv: usize) -> impl Iterator<Item = (usize, usize)> {
    let velocities =
        move |&(global, local): &(usize, usize)| (0..nv).map(move |v| (global + v, local + v));
    cells.iter().flat_map(velocities)
}

impl BlockMatrix {
    /// Assembles this rank's rows; couplings to auxiliary unknowns are zero until [`couple`](Self::couple).
    ///
    /// # Errors
    /// [`crate::base::error::Error::Formula`] where `V` or the inflow is not finite. Not collective.
    pub fn assemble(case: &Case, block: Block) -> Result<Self> {
        let scheme = Scheme::new(case, &block.wide_ranges())?;
        let nv = block.velocity_cells;
        let cells = block.cells();
        let mut row = Row::default();

        // Auxiliary unknowns stand before the ghosts: their number comes first.
        let mut listing = Listing {
            case,
            inflow: Vec::new(),
            entering: Entering::default(),
        };
        if case.embeds() {
            block.for_each_own(|global, local| {
                for v in 0..nv {
                    scheme.row(&mut row, global + v);
                    listing.visit(&row, local + v);
                }
            });
        }
        let Listing {
            inflow, entering, ..
        } = listing;
        let shared = case.embeds() && case.warp.inflow == Embedding::Scalar;
        let rows = cells + if shared { 1 } else { inflow.len() };

        // The space cells layer by layer, ghosts among them: global and local number of their first unknown.
        let range = block.ranges[0].clone();
        let layer_cells = cells / range.len();
        let global_layer = case.space.cells() / case.space.x[0].cells;
        let mut layers = Vec::with_capacity(block.space_cells() + block.ghosts() / nv);
        block.for_each_own(|global, local| layers.push((global, local)));
        block.for_each_ghost(|global, ghost| layers.push((global, rows + ghost)));
        layers.sort_by_key(|(global, _)| global / global_layer);

        let local = |place: Place| match place {
            Place::Own(j) => j,
            Place::Ghost(g) => rows + g,
        };
        let enters_at = |aux: &Inflow| !case.varies() && aux.enters();
        let mut coupled = inflow
            .iter()
            .enumerate()
            .filter(|(_, aux)| enters_at(aux))
            .peekable();
        let mut builder = Builder::with_capacity(rows);
        let mut sorter = Sorter::default();
        // Those of the layer before, of this one and of the next.
        let mut collected: [Layer; 3] = Default::default();
        // What the first layer gives to the last one, where that is not the next; and what the last one gives to the first.
        let mut turned = Layer::default();
        let by_layer =
            |a: &(usize, usize), b: &(usize, usize)| a.0 / global_layer == b.0 / global_layer;
        if case.space.is_periodic(0) && range.len() > 2 {
            let last = layers.chunk_by(by_layer).next_back();
            for (global, i) in unknowns(last.unwrap_or_default(), nv) {
                scheme.row(&mut row, global);
                let first = row.entries.iter().filter(|e| e.0 < global_layer);
                for &(column, value) in first {
                    if let Some(Place::Own(j)) = block.place(column) {
                        collected[1].0.push(Part {
                            row: j as u32,
                            column: i as u32,
                            key: global,
                            s: 0.5 * value,
                            k: -0.5 * value,
                        });
                    }
                }
            }
        }
        let mut done = 0;
        let mut finish = |layer: &mut Layer, builder: &mut Builder| {
            sorter.drain(layer, layer_cells, |entries| {
                if let Some((m, _)) = coupled.next_if(|(_, aux)| aux.row as usize == done) {
                    let column = if shared { cells } else { cells + m };
                    entries.push((column as u32, 0.0, 0.0));
                }
                builder.push(entries);
                done += 1;
            });
        };
        let mut next = range.start;
        for layer in layers.chunk_by(by_layer) {
            let a = layer[0].0 / global_layer;
            next = a + 1;
            for (global, i) in unknowns(layer, nv) {
                scheme.row(&mut row, global);
                let own = i < cells;
                for &(column, value) in &row.entries {
                    let Some(place) = block.place(column) else {
                        continue;
                    };
                    let j = local(place);
                    let half = 0.5 * value;
                    let mut put = |target: usize, layer: usize, part: (usize, usize, f64, f64)| {
                        let (column, key, s, k) = part;
                        let list = match (layer + 1).checked_sub(a) {
                            Some(next @ 0..=2) => &mut collected[next],
                            Some(_) => &mut turned,
                            None => return,
                        };
                        list.0.push(Part {
                            row: (target - (layer - range.start) * layer_cells) as u32,
                            column: column as u32,
                            key,
                            s,
                            k,
                        });
                    };
                    match (own, i == j) {
                        (true, true) => put(i, a, (i, global, value, 0.0)),
                        (true, false) => put(i, a, (j, column, half, half)),
                        (false, _) => {}
                    }
                    if i != j && j < cells {
                        put(j, column / global_layer, (i, global, half, -half));
                    }
                }
            }
            if next == range.end {
                collected[1].0.append(&mut turned.0);
            }
            // Nothing more comes to the layer before.
            if a > range.start {
                finish(&mut collected[0], &mut builder);
            }
            collected.rotate_left(1);
        }
        if next == range.end {
            finish(&mut collected[0], &mut builder);
        }
        scheme.inflow_is_finite(&row)?;
        if shared {
            // Its row is a sum over all ranks, see `embedding`.
            builder.push(&[]);
        } else {
            for aux in &inflow {
                let entry = [(aux.row, 0.0, 0.0)];
                builder.push(if enters_at(aux) { &entry } else { &[] });
            }
        }
        Ok(Self::new(
            block,
            builder.finish(),
            (inflow, entering, shared),
        ))
    }
}
