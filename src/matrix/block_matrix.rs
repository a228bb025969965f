//! The distributed block matrix `(S, K)`, `S = (A+Aᵀ)/2`, `K = (A−Aᵀ)/2`, assembled from the
//! scheme's rows.
//!
//! `S` and `K` share one sparsity pattern: an entry has a local column, `s` and `k`. The rows of
//! `Aᵀ` need rows of ghosts, which are evaluated on this rank, so that assembly needs no
//! communication. Entries of a row are in the order of their global columns, so that sums have the
//! same bits on any partition.
//!
//! Unknowns of a rank: its cells, then its auxiliary unknowns (see [`crate::matrix::embedding`]),
//! then its ghosts.

mod couplings;

use crate::matrix::bundles::{Bundles, WIDTH};
use crate::matrix::inflow::{AuxiliaryRow, VaryingInflow};
use crate::matrix::kernel::{InstructionSet, LineStep, Vectorized};
use crate::matrix::lanes::{Lanes, StartRow, StepConstants};
use crate::matrix::row_lines::{RowLines, for_nodes};
use crate::matrix::rows::{AssemblySize, Rows};
use crate::matrix::vector::Vector;
use crate::matrix::velocity_lines::{NodeValue, ProductFactors, VelocityLines};
use crate::parallel::communicator::{GhostExchange, Group};
use crate::parallel::partition::Block;
use num_complex::Complex64;
use std::ops::{Mul, Range};

/// Number of rows whose products with a real vector are passed on while they are in the first
/// cache.
const PIECE: usize = 2048;

/// The matrix that is applied to a real vector.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Operator {
    /// `A = S + K`.
    Generator,
    /// `Aᵀ = S − K`.
    Transpose,
    /// `S`.
    Symmetric,
}

/// The products of lines with a real vector, without fused multiply-add, so that the bits are the
/// same for every instruction set.
struct RowProducts<'a> {
    matrix: &'a BlockMatrix,
    lines: &'a [Range<usize>],
    operator: Operator,
    y: &'a mut [f64],
    x: &'a [f64],
}

impl Vectorized for RowProducts<'_> {
    #[inline(always)]
    fn run<V: Vector, const FMA: bool, const ROWS: usize, const WHOLE: bool>(self) {
        self.matrix.sum_lines(self.lines, self.operator, self.y, self.x);
    }
}

/// The rows of `(S, K)` that belong to this rank.
pub struct BlockMatrix {
    /// The block's numbering.
    pub block: Block,
    /// The rows that have an auxiliary unknown, or are coupled to the common one, in order.
    pub inflow: Vec<AuxiliaryRow>,
    /// The sources of a time-dependent inflow for each row of `inflow`; empty if it is constant.
    pub entering: VaryingInflow,
    /// Whether all rows share one common auxiliary unknown, of which every rank has a copy.
    pub(crate) has_common_unknown: bool,
    /// Whether the common unknown has couplings; its row then is a sum over all ranks.
    pub(crate) common_is_coupled: bool,
    /// Largest growth that these couplings add, for degrees above 0.
    pub(crate) common_growth: f64,
    /// Whether an axis has a degree above 0.
    pub(crate) by_elements: bool,
    /// Nodes of an element along the first space axis.
    pub(crate) first_axis_nodes: usize,
    /// The lines along which forces act on elements, until rows are gathered.
    pub(crate) velocity_lines: VelocityLines,
    /// Whether this rank's copy of the common unknown counts in sums. It is on the block with the
    /// lowest corner.
    pub(crate) counts_common: bool,
    /// Rows of `inflow` over all ranks.
    pub(crate) inflow_rows: usize,
    /// Initial value of an auxiliary unknown without couplings.
    pub(crate) uncoupled: f64,
    pub(crate) rows: Rows,
    /// Memory of the assembly.
    pub(crate) assembly: AssemblySize,
    /// Lines that are applied to real vectors together.
    pub(crate) bundles: Bundles,
    /// Runs of lines of `rows` without ghost columns.
    pub(crate) interior: Vec<Range<usize>>,
    /// Runs of lines with ghost columns.
    pub(crate) border: Vec<Range<usize>>,
}

impl BlockMatrix {
    /// Sorts the lines into runs that need ghosts and runs that do not. Elements of velocity lines
    /// are not parted.
    pub(crate) fn find_border(&mut self) {
        let rows = self.rows();
        let touches = |i: usize| self.rows.stored_row(i).any(|(column, ..)| column >= rows);
        let (mut interior, mut border): (Vec<Range<usize>>, Vec<Range<usize>>) = Default::default();
        let (count, unit) = (self.rows.line_count(), self.rows.velocity_lines().unit());
        for first in (0..count).step_by(unit) {
            let lines = first..count.min(first + unit);
            let at_border = lines.clone().any(|line| self.rows.lines().rows(line).any(touches));
            let list = if at_border { &mut border } else { &mut interior };
            match list.last_mut() {
                Some(last) if last.end == lines.start => last.end = lines.end,
                _ => list.push(lines),
            }
        }
        (self.interior, self.border) = (interior, border);
    }

    /// Gathers the rows of elements into lines of nodes along the first space axis, and takes the
    /// couplings along velocity axes out of them, for the kernels. The rows must be those of the
    /// unknowns weighted by volumes, and must not be changed afterwards.
    pub fn gather_elements(&mut self) {
        let nodes = self.first_axis_nodes;
        if nodes > 1 {
            let cells = self.block.cells();
            let stride = cells / self.block.ranges[0].len();
            let velocity_lines = std::mem::take(&mut self.velocity_lines);
            if !velocity_lines.is_empty() {
                self.replace_rows(self.rows.without(&velocity_lines));
            }
            let lines = RowLines { nodes, stride, cells };
            self.replace_rows(self.rows.gathered(lines, velocity_lines));
            self.find_border();
        }
        self.bundle();
    }

    /// Finds the rows that are applied to real vectors together. Must be called again when rows
    /// have changed.
    pub(crate) fn bundle(&mut self) {
        let lines = match self.rows.lines() {
            RowLines { nodes: 1, .. } => {
                let stride = self.block.velocity_cells;
                RowLines { nodes: 1, stride, cells: self.block.cells() }
            }
            lines => *lines,
        };
        self.bundles = Bundles::of(&self.rows, lines);
    }

    /// Number of auxiliary unknowns of this rank.
    pub fn auxiliaries(&self) -> usize {
        if self.has_common_unknown { 1 } else { self.inflow.len() }
    }

    /// The global number of the cell of each auxiliary unknown; `u64::MAX` for the common one.
    pub fn auxiliary_cells(&self) -> Vec<u64> {
        if self.has_common_unknown {
            return vec![u64::MAX];
        }
        let nv = self.block.velocity_cells;
        let mut firsts = vec![0; self.block.space_cells()];
        self.block.for_each_own(|global, local| firsts[local / nv] = global);
        let cell = |row: usize| (firsts[row / nv] + row % nv) as u64;
        self.inflow.iter().map(|aux| cell(aux.row as usize)).collect()
    }

    /// Number of unknowns of this rank: cells and auxiliary unknowns.
    pub fn rows(&self) -> usize {
        self.block.cells() + self.auxiliaries()
    }

    /// The row of the common auxiliary unknown, if there is one; [`row`](Self::row) gives this
    /// rank's part of it.
    pub fn shared_row(&self) -> Option<usize> {
        self.has_common_unknown.then(|| self.block.cells())
    }

    /// Number of rows, from the first, that count in sums over ranks. The common unknown is the
    /// last row, and only one of its copies counts.
    pub fn counted_rows(&self) -> usize {
        self.rows() - usize::from(self.has_common_unknown && !self.counts_common)
    }

    /// Length of vectors the matrix is applied to: rows and ghosts.
    pub fn length(&self) -> usize {
        self.rows() + self.block.ghosts()
    }

    /// Number of stored rows; equal rows are stored once.
    pub fn distinct_rows(&self) -> usize {
        self.rows.templates()
    }

    /// The stored rows, for the kernels.
    pub fn stored(&self) -> &Rows {
        &self.rows
    }

    /// Memory that the assembly took.
    pub fn assembly_size(&self) -> AssemblySize {
        self.assembly
    }

    /// Bytes of the rows.
    pub fn bytes(&self) -> usize {
        self.rows.bytes() + self.bundles.bytes()
    }

    /// The entries `(local column, s, k)` of local row `i`: first those of the nodes of its line,
    /// then the others in the order of global columns. The row of the common auxiliary unknown has
    /// only the entries of this rank's cells.
    pub fn row(&self, i: usize) -> impl Iterator<Item = (usize, f64, f64)> + '_ {
        let common =
            if self.has_common_unknown && i == self.block.cells() { &self.inflow[..] } else { &[] };
        let half = |aux: &AuxiliaryRow| (aux.row as usize, 0.5 * aux.coupling, -0.5 * aux.coupling);
        self.rows.row(i).chain(common.iter().map(half))
    }

    /// Replaces `A` by `D A D⁻¹`, `D = diag(√π)`; `pi` covers rows and ghosts.
    pub fn scale(&mut self, pi: &[f64]) {
        self.bundles = Bundles::default();
        let plain = |i: usize| self.rows.row(i).all(|(j, ..)| pi[j] == pi[i]);
        self.replace_rows(self.rows.changed(plain, |i, entries| {
            for (column, s, k) in entries {
                let j = *column as usize;
                if i == j {
                    continue;
                }
                let ratio = (pi[i] / pi[j]).sqrt();
                let forward = (*s + *k) * ratio;
                let back = (*s - *k) / ratio;
                *s = 0.5 * (forward + back);
                *k = 0.5 * (forward - back);
            }
        }));
    }

    /// Replaces the rows, and notes the memory of both.
    pub(crate) fn replace_rows(&mut self, rows: Rows) {
        self.assembly.add_change(&self.rows, &rows);
        self.rows = rows;
    }

    /// The products of lines with a real vector.
    pub(crate) fn apply_rows(
        &self,
        lines: &[Range<usize>],
        operator: Operator,
        y: &mut [f64],
        x: &[f64],
    ) {
        InstructionSet::here().run(RowProducts { matrix: self, lines, operator, y, x });
    }

    #[inline(always)]
    fn sum_lines(&self, rows: &[Range<usize>], operator: Operator, y: &mut [f64], x: &[f64]) {
        // One loop for each operator, so that the choice is outside the loop.
        match operator {
            Operator::Generator => self.sum_entries(rows, |s, k| s + k, y, x),
            Operator::Transpose => self.sum_entries(rows, |s, k| s - k, y, x),
            Operator::Symmetric => self.sum_entries(rows, |s, _| s, y, x),
        }
        let k = match operator {
            Operator::Generator => 1.0,
            Operator::Transpose => -1.0,
            Operator::Symmetric => 0.0,
        };
        for run in rows {
            self.add_velocity_lines(run, ProductFactors { s: 1.0, k }, y, x);
        }
    }

    /// Adds the products along velocity axes in some lines.
    #[inline(always)]
    fn add_velocity_lines<T: NodeValue + Mul<Output = T>>(
        &self,
        lines: &Range<usize>,
        factors: ProductFactors<T>,
        y: &mut [T],
        x: &[T],
    ) {
        let (of_rows, of_cells) = (self.rows.lines(), self.rows.lines().of_cells());
        let of_cells = lines.start.min(of_cells)..lines.end.min(of_cells);
        let velocity_lines = self.rows.velocity_lines();
        if !velocity_lines.is_empty() {
            velocity_lines.add_products(of_rows, of_cells, factors, y, x);
        }
    }

    #[inline(always)]
    fn sum_entries(
        &self,
        runs: &[Range<usize>],
        entry: impl Fn(f64, f64) -> f64,
        y: &mut [f64],
        x: &[f64],
    ) {
        assert!(x.len() >= self.rows.reach(), "vector and matrix do not fit");
        for run in runs {
            match self.rows.lines().nodes {
                1 => self.sum_nodes::<1>(run.clone(), &entry, y, x),
                nodes => for_nodes!(nodes, NODES => {
                    self.sum_nodes::<NODES>(run.clone(), &entry, y, x)
                }),
            }
        }
    }

    /// Adds the products of row `i` with all columns but the nodes of its line to `sum`.
    #[inline(always)]
    fn add_others(
        &self,
        [template, i]: [usize; 2],
        entry: impl Fn(f64, f64) -> f64,
        x: &[f64],
        sum: f64,
    ) -> f64 {
        (self.rows.others(template, i))
            // SAFETY: every column is below the reach of the rows, which `x` has.
            .map(|(j, s, k)| entry(s, k) * unsafe { x.get_unchecked(j) })
            .fold(sum, |sum, term| sum + term)
    }

    /// The products of lines that are single rows.
    #[inline(always)]
    fn sum_single(
        &self,
        lines: Range<usize>,
        entry: &impl Fn(f64, f64) -> f64,
        y: &mut [f64],
        x: &[f64],
    ) {
        let behind = self.rows.lines().cells - self.rows.lines().of_cells();
        for line in lines {
            let i = line + behind;
            y[i] = self.add_others([self.rows.template(line), i], entry, x, 0.0);
        }
    }

    /// The products of lines, of which those of cells have `NODES` rows. With one row a line, the
    /// lines that may be in bundles are treated in the same way.
    #[inline(always)]
    fn sum_nodes<const NODES: usize>(
        &self,
        lines: Range<usize>,
        entry: &impl Fn(f64, f64) -> f64,
        y: &mut [f64],
        x: &[f64],
    ) {
        let of_cells = if NODES == 1 { self.bundles.lines() } else { self.rows.lines().of_cells() };
        let stride = self.rows.lines().stride;
        let (mut next, end) = (lines.start, lines.end.min(of_cells));
        while next < end {
            let (line, first) = (next, self.rows.lines().first(next));
            if line + WIDTH <= end
                && let Some(like) = self.bundles.at(line)
            {
                self.bundles.apply::<NODES>(like, [first, stride], entry, y, x);
                next += WIDTH;
                continue;
            }
            next += 1;
            let template = self.rows.template(line);
            let nodes: [f64; NODES] = std::array::from_fn(|n| x[first + n * stride]);
            for m in 0..NODES {
                let dense = self.rows.dense_row(template + m);
                let terms = nodes.iter().zip(dense).map(|(x, k)| entry(0.0, *k) * x);
                let sum = terms.fold(0.0, |sum, term| sum + term);
                let i = first + m * stride;
                y[i] = self.add_others([template + m, i], entry, x, sum);
            }
        }
        self.sum_single(lines.start.max(of_cells)..lines.end.max(of_cells), entry, y, x);
    }

    /// `y ← (S ± K) x` or `S x` for real vectors; refreshes the ghosts of `x`. Collective over the
    /// space group.
    pub fn apply(
        &self,
        exchange: &mut GhostExchange,
        operator: Operator,
        y: &mut [f64],
        x: &mut [f64],
    ) {
        self.apply_then(exchange, operator, y, x, |_, _, _| {});
        if self.common_is_coupled && operator != Operator::Generator {
            let share = |aux: &AuxiliaryRow| [aux.coupling * x[aux.row as usize]];
            let [sum] =
                (exchange.group()).sum_lanes(self.inflow_rows, self.inflow.iter().map(share));
            y[self.block.cells()] = if operator == Operator::Transpose { sum } else { 0.5 * sum };
        }
    }

    /// The same without the row of a common auxiliary unknown, which is a sum over all ranks. Calls
    /// `then` with rows, `y` and `x` as soon as these products are done, while they are in cache.
    pub fn apply_then(
        &self,
        exchange: &mut GhostExchange,
        operator: Operator,
        y: &mut [f64],
        x: &mut [f64],
        mut then: impl FnMut(Range<usize>, &mut [f64], &[f64]),
    ) {
        let rows = self.rows();
        // The rows of a line of an element are not contiguous.
        let is_by_rows = self.rows.lines().nodes == 1;
        let mut apply = |runs: &[Range<usize>], y: &mut [f64], x: &[f64]| {
            if !is_by_rows {
                return self.apply_rows(runs, operator, y, x);
            }
            for run in runs {
                self.apply_run(run.clone(), operator, y, x, &mut then);
            }
        };
        exchange.start(&x[..rows]);
        apply(&self.interior, y, x);
        exchange.finish(&mut x[rows..]);
        apply(&self.border, y, x);
        if !is_by_rows {
            then(0..rows, y, x);
        }
    }

    /// `y ← (S ± K) x` or `S x` in rows that are lines and whose ghosts, if any, are there. Calls
    /// `then` with rows, `y` and `x` piece by piece, while they are in cache.
    pub(crate) fn apply_run(
        &self,
        rows: Range<usize>,
        operator: Operator,
        y: &mut [f64],
        x: &[f64],
        then: &mut impl FnMut(Range<usize>, &mut [f64], &[f64]),
    ) {
        for start in rows.clone().step_by(PIECE) {
            let piece = start..rows.end.min(start + PIECE);
            self.apply_rows(std::slice::from_ref(&piece), operator, y, x);
            then(piece, y, x);
        }
    }

    /// Number of rows of a layer of cells along the first space axis, if the rows of a layer draw
    /// only on it, on the two adjacent ones and on auxiliary unknowns. So it is for degree 0 on a
    /// block without ghosts whose first axis is not periodic.
    pub(crate) fn layer(&self) -> Option<usize> {
        let stands_alone =
            !self.by_elements && self.block.ghosts() == 0 && !self.block.first_axis_is_periodic;
        stands_alone.then(|| self.block.cells() / self.block.ranges[0].len())
    }

    /// The step of some lines, with the instruction set of this processor.
    pub(crate) fn step_lines<R: StartRow>(
        &self,
        lines: Range<usize>,
        constants: &StepConstants,
        y: &mut [Lanes],
        x: &[Lanes],
        start: &[R],
    ) {
        let matrix = &self.rows;
        InstructionSet::here().run(LineStep { matrix, lines, constants, y, x, start });
    }

    /// One fused step for a batch of modes, `y ← a((−iμS + K)x + icx) + y + coefficient · start`;
    /// refreshes the ghosts of `x`. `couplings` are those to auxiliary unknowns that are not in the
    /// matrix, one for each row of [`inflow`](Self::inflow): those of a stage with a time-dependent
    /// inflow. Collective over the space group.
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
        exchange.start(&x[..rows]);
        for lines in &self.interior {
            self.step_lines(lines.clone(), constants, y, x, start);
        }
        exchange.finish(&mut x[rows..]);
        for lines in &self.border {
            self.step_lines(lines.clone(), constants, y, x, start);
        }
        if self.common_is_coupled {
            let couplings = self.inflow.iter().map(|aux| aux.coupling);
            self.step_shared(exchange, constants, couplings, y, x);
        }
        if let Some(couplings) = couplings {
            self.step_couplings(constants, 0..self.inflow.len(), couplings, y, x);
            if self.has_common_unknown {
                self.step_shared(exchange, constants, couplings.iter().copied(), y, x);
            }
        }
    }

    /// `y ← (−iμS + K)x` for one mode; refreshes the ghosts of `x`. Collective over the space
    /// group.
    pub fn apply_mode(
        &self,
        exchange: &mut GhostExchange,
        mu: f64,
        y: &mut [Complex64],
        x: &mut [Complex64],
    ) {
        let rows = self.rows();
        let apply = |runs: &[Range<usize>], y: &mut [Complex64], x: &[Complex64]| {
            let lines = self.rows.lines();
            for i in runs.iter().cloned().flatten().flat_map(|line| lines.rows(line)) {
                let mut sum = Complex64::ZERO;
                for (j, s, k) in self.rows.stored_row(i) {
                    sum += Complex64::new(k, -mu * s) * x[j];
                }
                y[i] = sum;
            }
            let factors = ProductFactors { s: Complex64::new(0.0, -mu), k: 1.0 };
            runs.iter().for_each(|run| self.add_velocity_lines(run, factors, y, x));
        };
        exchange.start(&x[..rows]);
        apply(&self.interior, y, x);
        exchange.finish(&mut x[rows..]);
        apply(&self.border, y, x);
    }

    /// Sum over all unknowns of the group of `term(local row)`, which is not negative and at most
    /// `bound` in a space cell. It is first summed over the velocities at a point of space, which
    /// are never split over ranks, and then exactly.
    pub fn sum_rows(
        &self,
        group: &Group,
        bound: f64,
        count: usize,
        term: impl Fn(usize) -> f64,
    ) -> f64 {
        group.sum(bound, count, self.pieces().map(|rows| rows.map(&term).sum()))
    }

    /// Groups of rows that are on one rank in any partition: the velocities at each point of space,
    /// then each auxiliary unknown. An unknown that the ranks share counts on the first rank.
    pub fn pieces(&self) -> impl Iterator<Item = Range<usize>> + Clone + use<> {
        let (nv, cells) = (self.block.velocity_cells, self.block.cells());
        let points = (0..cells / nv).map(move |c| c * nv..(c + 1) * nv);
        points.chain((cells..self.counted_rows()).map(|i| i..i + 1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parallel::partition::ProcessMesh;
    use crate::problem::case::Case;

    const CASE: &str = "[[axis]]\nx = { lower = -1, upper = 1, cells = 40 }\n\
                        v = { lower = -1.5, upper = 1.5, cells = 14 }\n\
                        [[potential]]\nwhere = \"x < 0\"\nvalue = \"0.2\"\n\
                        [[potential]]\nvalue = \"0\"\n\
                        [initial]\nf = \"exp(-x^2)\"\n[time]\nend = 1.0\n";

    /// Products of bundles have the same bits as row by row sums.
    #[test]
    fn bundles_keep_the_bits_of_rows() {
        for (degree, flux) in [("0", "1"), ("1", "1"), ("3", "0.5"), ("4", "1"), ("8", "0")] {
            let settings = [format!("scheme.degree={degree}"), format!("scheme.flux={flux}")];
            let case = Case::parse("case", CASE, &settings).expect("a case");
            let mesh = ProcessMesh { space: vec![1], groups: 1 };
            let block = Block::new(&case.space, &mesh, 0);
            let mut matrix = BlockMatrix::assemble(&case, block).expect("finite formulas");
            matrix.gather_elements();
            let (rows, lines) = (matrix.rows(), matrix.rows.line_count());
            let bundled = (0..lines).filter(|l| matrix.bundles.at(*l).is_some());
            assert!(WIDTH * bundled.count() > lines / 3, "degree {degree}: few lines in bundles");
            let x: Vec<f64> = (0..matrix.length()).map(|i| (0.7 * i as f64).sin()).collect();
            for operator in [Operator::Generator, Operator::Transpose, Operator::Symmetric] {
                let entry = |s: f64, k: f64| match operator {
                    Operator::Generator => s + k,
                    Operator::Transpose => s - k,
                    Operator::Symmetric => s,
                };
                let mut y = vec![0.0; rows];
                // The second range starts within a bundle.
                matrix.apply_rows(&[0..3, 3..lines], operator, &mut y, &x);
                for (i, y) in y.iter().enumerate() {
                    let terms = matrix.row(i).map(|(j, s, k)| entry(s, k) * x[j]);
                    assert_eq!(*y, terms.fold(0.0, |sum, term| sum + term), "{operator:?} {i}");
                }
            }
        }
    }
}
