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
mod products;

use crate::matrix::bundles::Bundles;
use crate::matrix::inflow::{AuxiliaryRow, VaryingInflow};
use crate::matrix::instruction_set::InstructionSet;
use crate::matrix::kernel::LineStep;
use crate::matrix::lanes::{Lanes, StartRow, StepConstants};
use crate::matrix::row_lines::RowLines;
use crate::matrix::rows::{AssemblySize, Rows};
use crate::matrix::velocity_lines::VelocityLines;
use crate::parallel::communicator::{GhostExchange, Group};
use crate::parallel::partition::Block;
use std::ops::Range;

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
    /// Memory that the assembly took.
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
