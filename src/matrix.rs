//! The distributed block matrix `(S, K)`, `S = (A+Aᵀ)/2`, `K = (A−Aᵀ)/2`, assembled from the scheme's rows.
//!
//! One pattern carries both: per entry a local column, `s` and `k`. `Aᵀ`'s rows come from the rows of the ghost layer,
//! computed here, so assembling needs no communication. A row's entries stand in the order of their global columns, so
//! sums have the same bits on any partition.
//!
//! Unknowns of a rank: its cells, then its auxiliary unknowns (see [`embedding`]), then its ghosts.

pub mod blocking;
pub mod embedding;
pub mod kernel;

pub use embedding::{Entering, Inflow};
pub use kernel::{LANES, Lanes, StartRow, StepConstants};

use crate::case::{Case, Embedding};
use crate::communicator::{GhostExchange, Group};
use crate::error::Result;
use crate::grid::{PhaseSpace, describe_point};
use crate::partition::{Block, Place};
use crate::scheme::{Row, Scheme};
use num_complex::Complex64;
use std::ops::Range;

/// Which matrix is applied to a real vector.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// `A = S + K`.
    Generator,
    /// `Aᵀ = S − K`.
    Transpose,
    /// `S`.
    Symmetric,
}

/// The rows of `(S, K)` that belong to this rank.
pub struct BlockMatrix {
    /// The block's numbering.
    pub block: Block,
    /// The rows that have an auxiliary unknown, or a share in the common one, in their order.
    pub inflow: Vec<Inflow>,
    /// Where a varying inflow comes from, row by row of `inflow`; empty for a constant one.
    pub entering: Entering,
    /// Whether one auxiliary unknown, of which every rank has a copy, serves all rows.
    shared: bool,
    /// Whether that has couplings, which its row sums over all ranks.
    summed: bool,
    /// Whether this rank's copy of it counts in sums: that of the block with the lowest corner.
    counts_shared: bool,
    /// Rows of `inflow` over all ranks.
    inflow_rows: usize,
    /// Value of an auxiliary unknown that is coupled to nothing.
    uncoupled: f64,
    offsets: Vec<usize>,
    columns: Vec<u32>,
    s: Vec<f64>,
    k: Vec<f64>,
    /// Runs of rows without ghost columns, and the others.
    interior: Vec<Range<usize>>,
    border: Vec<Range<usize>>,
}

impl BlockMatrix {
    /// Assembles this rank's rows; couplings to auxiliary unknowns are zero until [`couple`](Self::couple).
    ///
    /// # Errors
    /// [`crate::error::Error::Formula`] where `V` or the inflow is not finite. Not collective.
    pub fn assemble(case: &Case, block: Block) -> Result<Self> {
        let scheme = Scheme::new(case, &block.wide_ranges())?;
        let nv = block.velocity_cells;
        let cells = block.cells();
        let mut row = Row::default();

        // First pass: how many entries each local row gets from A and from Aᵀ, and which rows have inflow.
        let mut counts = vec![0u32; cells + 1];
        let mut inflow = Vec::new();
        let mut entering = Entering::default();
        let (embedding, enters, varies) = (case.warp.inflow, case.enters(), case.varies());
        let shared = enters && embedding == Embedding::Scalar;
        // Couplings that vary with time are no entries of the matrix.
        let coupled = |row: &Row| !varies && row.inflow.iter().any(|&b| b != 0.0);
        let listed = |row: &Row| match embedding {
            Embedding::Full => enters,
            Embedding::Boundary | Embedding::Scalar if varies => !row.ghosts.is_empty(),
            Embedding::Boundary | Embedding::Scalar => coupled(row),
        };
        let mut count = |row: &Row, own: Option<usize>| {
            for &(column, _) in &row.entries {
                if let Some(Place::Own(j)) = block.place(column)
                    && Some(j) != own
                {
                    counts[j] += 1;
                }
            }
            if let Some(i) = own {
                counts[i] += row.entries.len() as u32 + u32::from(coupled(row));
            }
        };
        block.for_each_own(|global, local| {
            for v in 0..nv {
                scheme.row(&mut row, global + v);
                count(&row, Some(local + v));
                if listed(&row) {
                    inflow.push(Inflow {
                        row: (local + v) as u32,
                        values: row.inflow,
                        draw: row.draw,
                        coupling: 0.0,
                    });
                    if varies {
                        entering.push(&row);
                    }
                }
            }
        });
        block.for_each_ghost(|global, _| {
            for v in 0..nv {
                scheme.row(&mut row, global + v);
                count(&row, None);
            }
        });
        scheme.inflow_is_finite(&row)?;

        let auxiliaries = if shared { 1 } else { inflow.len() };
        let rows = cells + auxiliaries;
        let mut offsets = Vec::with_capacity(rows + 1);
        let mut total = 0;
        for &count in &counts[..cells] {
            offsets.push(total);
            total += count as usize;
        }
        let (mut columns, mut s, mut k) = (vec![0u32; total], vec![0.0; total], vec![0.0; total]);

        // Second pass: the entries, unsorted.
        let mut next = offsets.clone();
        let local = |place: Place| match place {
            Place::Own(j) => j,
            Place::Ghost(g) => rows + g,
        } as u32;
        let mut put = |i: usize, column: u32, half: f64, sign: f64| {
            let at = next[i];
            columns[at] = column;
            s[at] = half;
            k[at] = sign * half;
            next[i] += 1;
        };
        block.for_each_own(|global, first| {
            for v in 0..nv {
                let i = first + v;
                scheme.row(&mut row, global + v);
                for &(column, value) in &row.entries {
                    let Some(place) = block.place(column) else {
                        continue;
                    };
                    if place == Place::Own(i) {
                        // Diagonal: s = a, k = 0.
                        put(i, i as u32, value, 0.0);
                        continue;
                    }
                    put(i, local(place), 0.5 * value, 1.0);
                    if let Place::Own(j) = place {
                        put(j, i as u32, 0.5 * value, -1.0);
                    }
                }
            }
        });
        block.for_each_ghost(|global, first| {
            for v in 0..nv {
                scheme.row(&mut row, global + v);
                for &(column, value) in &row.entries {
                    if let Some(Place::Own(j)) = block.place(column) {
                        put(j, (rows + first + v) as u32, 0.5 * value, -1.0);
                    }
                }
            }
        });
        let enters_at = |aux: &Inflow| !varies && aux.enters();
        for (m, aux) in inflow.iter().enumerate().filter(|(_, aux)| enters_at(aux)) {
            let column = if shared { cells } else { cells + m };
            put(aux.row as usize, column as u32, 0.0, 1.0);
        }

        // Sort each row by global column, add up entries of the same column, close the gaps.
        let mut global = vec![0usize; block.ghosts()];
        block.for_each_ghost(|first, ghost| {
            for v in 0..nv {
                global[ghost + v] = first + v;
            }
        });
        let ghost_global = global;
        let all = case.space.cells();
        let mut entries: Vec<(usize, u32, f64, f64)> = Vec::new();
        let mut kept = 0;
        let mut own_first = Vec::with_capacity(block.space_cells());
        block.for_each_own(|first, _| own_first.push(first));
        for i in 0..cells {
            entries.clear();
            let end = if i + 1 < cells { offsets[i + 1] } else { total };
            for at in offsets[i]..end {
                let column = columns[at] as usize;
                let key = if column < cells {
                    own_first[column / nv] + column % nv
                } else if column < rows {
                    all + own_first[i / nv] + i % nv
                } else {
                    ghost_global[column - rows]
                };
                entries.push((key, columns[at], s[at], k[at]));
            }
            entries.sort_by_key(|e| e.0);
            entries.dedup_by(|next, kept| {
                let same = next.0 == kept.0;
                if same {
                    kept.2 += next.2;
                    kept.3 += next.3;
                }
                same
            });
            offsets[i] = kept;
            for &(_, column, es, ek) in &entries {
                (columns[kept], s[kept], k[kept]) = (column, es, ek);
                kept += 1;
            }
        }
        columns.truncate(kept);
        s.truncate(kept);
        k.truncate(kept);
        if shared {
            // Its row is a sum over all ranks, see `embedding`.
            offsets.push(columns.len());
        } else {
            for aux in &inflow {
                offsets.push(columns.len());
                if enters_at(aux) {
                    columns.push(aux.row);
                    s.push(0.0);
                    k.push(0.0);
                }
            }
        }
        offsets.push(columns.len());

        let mut this = Self {
            counts_shared: block.ranges.iter().all(|r| r.start == 0),
            block,
            inflow,
            entering,
            shared,
            summed: false,
            inflow_rows: 0,
            uncoupled: 0.0,
            offsets,
            columns,
            s,
            k,
            interior: Vec::new(),
            border: Vec::new(),
        };
        this.find_border();
        Ok(this)
    }

    /// Sorts the rows into runs that need ghosts and runs that do not.
    fn find_border(&mut self) {
        let rows = self.rows();
        let touches = |i: usize| {
            self.columns[self.offsets[i]..self.offsets[i + 1]]
                .iter()
                .any(|&c| c as usize >= rows)
        };
        let (mut interior, mut border): (Vec<Range<usize>>, Vec<Range<usize>>) = Default::default();
        for i in 0..rows {
            let list = if touches(i) {
                &mut border
            } else {
                &mut interior
            };
            match list.last_mut() {
                Some(last) if last.end == i => last.end = i + 1,
                _ => list.push(i..i + 1),
            }
        }
        (self.interior, self.border) = (interior, border);
    }

    /// Auxiliary unknowns of this rank.
    pub fn auxiliaries(&self) -> usize {
        if self.shared { 1 } else { self.inflow.len() }
    }

    /// Unknowns of this rank: cells and auxiliary ones.
    pub fn rows(&self) -> usize {
        self.block.cells() + self.auxiliaries()
    }

    /// The row of the unknown that all ranks share, where there is one; [`row`](Self::row) lists this rank's part of it.
    pub fn shared_row(&self) -> Option<usize> {
        self.shared.then(|| self.block.cells())
    }

    /// The first so many rows count in sums over ranks; a copy of a common unknown, the last row, counts once.
    pub fn counted_rows(&self) -> usize {
        self.rows() - usize::from(self.shared && !self.counts_shared)
    }

    /// Length of vectors the matrix is applied to: rows and ghosts.
    pub fn length(&self) -> usize {
        self.rows() + self.block.ghosts()
    }

    /// Number of entries.
    pub fn entries(&self) -> usize {
        self.columns.len()
    }

    /// The entries of local row `i`: `(local column, s, k)`, in the order of global columns; of a common auxiliary
    /// unknown's row, those to this rank's cells.
    pub fn row(&self, i: usize) -> impl Iterator<Item = (usize, f64, f64)> + '_ {
        let range = self.offsets[i]..self.offsets[i + 1];
        let common = if self.shared && i == self.block.cells() {
            &self.inflow[..]
        } else {
            &[]
        };
        let half = |aux: &Inflow| (aux.row as usize, 0.5 * aux.coupling, -0.5 * aux.coupling);
        let entries = range.map(|e| (self.columns[e] as usize, self.s[e], self.k[e]));
        entries.chain(common.iter().map(half))
    }

    /// Replaces `A` by `D A D⁻¹`, `D = diag(√π)`; `pi` covers rows and ghosts.
    pub fn scale(&mut self, pi: &[f64]) {
        for i in 0..self.rows() {
            for e in self.offsets[i]..self.offsets[i + 1] {
                let j = self.columns[e] as usize;
                if i == j {
                    continue;
                }
                let ratio = (pi[i] / pi[j]).sqrt();
                let forward = (self.s[e] + self.k[e]) * ratio;
                let back = (self.s[e] - self.k[e]) / ratio;
                self.s[e] = 0.5 * (forward + back);
                self.k[e] = 0.5 * (forward - back);
            }
        }
    }

    fn apply_rows(&self, rows: &[Range<usize>], part: Part, y: &mut [f64], x: &[f64]) {
        let sign = match part {
            Part::Generator => 1.0,
            Part::Transpose => -1.0,
            Part::Symmetric => 0.0,
        };
        for range in rows {
            for i in range.clone() {
                let mut sum = 0.0;
                for e in self.offsets[i]..self.offsets[i + 1] {
                    sum += (self.s[e] + sign * self.k[e]) * x[self.columns[e] as usize];
                }
                y[i] = sum;
            }
        }
    }

    /// `y ← (S ± K) x` or `S x` for real vectors; `x`'s ghosts are refreshed. Collective over the space group.
    pub fn apply(&self, exchange: &mut GhostExchange, part: Part, y: &mut [f64], x: &mut [f64]) {
        let rows = self.rows();
        exchange.start(&x[..rows]);
        self.apply_rows(&self.interior, part, y, x);
        exchange.finish(&mut x[rows..]);
        self.apply_rows(&self.border, part, y, x);
        if self.summed && part != Part::Generator {
            let share = |aux: &Inflow| [aux.coupling * x[aux.row as usize]];
            let [sum] =
                (exchange.group()).sum_lanes(self.inflow_rows, self.inflow.iter().map(share));
            y[self.block.cells()] = if part == Part::Transpose {
                sum
            } else {
                0.5 * sum
            };
        }
    }

    /// One fused step for a batch of modes, `x`'s ghosts being refreshed: `y ← a((−iμS + K)x + icx) + y + coefficient · start`,
    /// with `couplings` to the auxiliary unknowns that are no entries of the matrix: those of a stage where the inflow varies,
    /// row by row of [`inflow`](Self::inflow). Collective over the space group.
    pub fn step<R: StartRow>(
        &self,
        exchange: &mut GhostExchange,
        constants: &StepConstants,
        couplings: Option<&[f64]>,
        y: &mut [Lanes],
        x: &mut [Lanes],
        start: &[R],
    ) {
        let rows = self.rows();
        let step = kernel::stepper(self, x);
        exchange.start(&x[..rows]);
        for run in &self.interior {
            step(self, run.clone(), constants, y, x, start);
        }
        exchange.finish(&mut x[rows..]);
        for run in &self.border {
            step(self, run.clone(), constants, y, x, start);
        }
        if self.summed {
            let couplings = self.inflow.iter().map(|aux| aux.coupling);
            self.step_shared(exchange, constants, couplings, y, x);
        }
        if let Some(couplings) = couplings {
            self.step_couplings(constants, (0..self.inflow.len(), couplings), y, x);
            if self.shared {
                self.step_shared(exchange, constants, couplings.iter().copied(), y, x);
            }
        }
    }

    /// `y ← (−iμS + K)x` for one mode, `x`'s ghosts being refreshed. Collective over the space group.
    pub fn apply_mode(
        &self,
        exchange: &mut GhostExchange,
        mu: f64,
        y: &mut [Complex64],
        x: &mut [Complex64],
    ) {
        let rows = self.rows();
        let apply = |runs: &[Range<usize>], y: &mut [Complex64], x: &[Complex64]| {
            for i in runs.iter().cloned().flatten() {
                let mut sum = Complex64::ZERO;
                for e in self.offsets[i]..self.offsets[i + 1] {
                    sum += Complex64::new(self.k[e], -mu * self.s[e]) * x[self.columns[e] as usize];
                }
                y[i] = sum;
            }
        };
        exchange.start(&x[..rows]);
        apply(&self.interior, y, x);
        exchange.finish(&mut x[rows..]);
        apply(&self.border, y, x);
    }

    /// Sum over all unknowns of the group of `term(local row)`, not negative and at most `bound` a space cell: first
    /// over the velocities at one point of space, which are always together, then exactly.
    pub fn sum_rows(
        &self,
        group: &Group,
        bound: f64,
        count: usize,
        term: impl Fn(usize) -> f64,
    ) -> f64 {
        let nv = self.block.velocity_cells;
        let cells = self.block.cells();
        let space = (0..cells / nv).map(|c| (c * nv..(c + 1) * nv).map(&term).sum::<f64>());
        let aux = (cells..self.counted_rows()).map(&term);
        group.sum(bound, count, space.chain(aux))
    }
}

/// `value` at the centres of the block's cells `cells`.
pub fn sample_with(
    space: &PhaseSpace,
    block: &Block,
    cells: &Range<usize>,
    value: impl Fn(&[f64; 6]) -> f64,
) -> Vec<f64> {
    let mut values = Vec::with_capacity(cells.len());
    block.for_each_own(|global, local| {
        for v in 0..block.velocity_cells {
            if cells.contains(&(local + v)) {
                values.push(value(&space.point(&space.cell(global + v))));
            }
        }
    });
    values
}

/// A formula at the centres of this rank's cells.
///
/// # Errors
/// [`crate::error::Error::Formula`] where `f0` is not finite. Not collective.
pub fn sample(
    space: &PhaseSpace,
    block: &Block,
    formula: &crate::expression::Expression,
    time: f64,
) -> Result<Vec<f64>> {
    let mut values = Vec::with_capacity(block.cells());
    let mut failure = None;
    block.for_each_own(|global, _| {
        for v in 0..block.velocity_cells {
            let point = space.point(&space.cell(global + v));
            let [x, y, z, vx, vy, vz] = point;
            let value = formula.eval(&[x, y, z, vx, vy, vz, time]);
            if !value.is_finite() && failure.is_none() {
                failure = Some(formula.undefined(value, describe_point(space.dimension(), &point)));
            }
            values.push(value);
        }
    });
    match failure {
        Some(error) => Err(error),
        None => Ok(values),
    }
}
