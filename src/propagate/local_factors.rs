//! Sparse LU factors of `M = I − aG` on this rank's rows.
//!
//! The unknowns are eliminated front by front ([`crate::propagate::elimination`]). Rows are
//! exchanged only among the pivots of a front, so that the size of the factors does not depend on
//! the values. This is stable: the Hermitian part of `M` is `I`, and that of what is left after an
//! elimination is at least `I`.

use crate::base::error::Result;
use crate::matrix::block_matrix::BlockMatrix;
use crate::propagate::elimination::{Elimination, Front, zeros};
use crate::propagate::evolution::Evolution;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::lu::partial_pivoting::factor::{lu_in_place, lu_in_place_scratch};
use faer::linalg::matmul::matmul;
use faer::linalg::triangular_solve::solve_lower_triangular_in_place;
use faer::{Accum, MatMut, Par};
use num_complex::Complex64;

/// A mode for which `M` is solved.
#[derive(Clone, Copy, Debug)]
pub struct ShiftedMode {
    /// `a`.
    pub shift: f64,
    /// `μ`.
    pub wavenumber: f64,
}

/// The factors of `M` on this rank's rows.
pub(super) struct LocalFactors {
    order: Elimination,
    /// The factors, front by front, with the inverses of the pivots.
    values: Vec<Complex64>,
    /// What parts have subtracted from their rows below, column by column.
    waiting: Vec<Complex64>,
    /// The row of the front at each place, for rows of the current front.
    local: Vec<u32>,
    /// The pivot of its front that comes at each place.
    exchanges: Vec<u32>,
    /// A vector in the order of elimination.
    ordered: Vec<Complex64>,
    /// Pivots of a front, before they are exchanged.
    pivots: Vec<Complex64>,
    inverse: Vec<u32>,
    scratch: MemBuffer,
    /// The mode of the factors.
    pub(super) mode: ShiftedMode,
}

/// The entries of a front, each matrix column by column.
struct Entries<'a> {
    /// Number of its pivots.
    pivots: usize,
    /// Number of its rows below.
    below: usize,
    /// The rows of the pivots.
    upper: &'a mut [Complex64],
    /// The columns of the pivots in the rows below.
    lower: &'a mut [Complex64],
    /// What is subtracted from the rows below.
    rest: &'a mut [Complex64],
}

impl Entries<'_> {
    /// The entry in row `i` and column `j` of the front, of which one is a pivot.
    fn at(&mut self, i: usize, j: usize) -> &mut Complex64 {
        let Self { pivots, below, .. } = *self;
        if i < pivots {
            &mut self.upper[i + j * pivots]
        } else {
            &mut self.lower[i - pivots + j * below]
        }
    }

    /// Adds what a part has subtracted from its rows below, which are `rows` of the front.
    fn add(&mut self, part: &[Complex64], rows: &[u32]) {
        let Self { pivots, below, .. } = *self;
        let (above, others) = rows.split_at(rows.partition_point(|&i| (i as usize) < pivots));
        for (&j, column) in rows.iter().zip(part.chunks_exact(rows.len())) {
            let j = j as usize;
            let (to_pivots, to_others) = column.split_at(above.len());
            let upper = &mut self.upper[j * pivots..][..pivots];
            for (&i, value) in above.iter().zip(to_pivots) {
                upper[i as usize] += value;
            }
            let lower = if j < pivots {
                &mut self.lower[j * below..][..below]
            } else {
                &mut self.rest[(j - pivots) * below..][..below]
            };
            for (&i, value) in others.iter().zip(to_others) {
                lower[i as usize - pivots] += value;
            }
        }
    }

    /// Eliminates the pivots, and inverts each; `exchanges` are their rows in the order taken.
    fn eliminate(&mut self, exchanges: &mut [u32], inverse: &mut [u32], scratch: &mut MemBuffer) {
        let Self { pivots, below, .. } = *self;
        let mut upper =
            MatMut::from_column_major_slice_mut(&mut *self.upper, pivots, pivots + below);
        let mut lower = MatMut::from_column_major_slice_mut(&mut *self.lower, below, pivots);
        let rest = MatMut::from_column_major_slice_mut(&mut *self.rest, below, below);
        let inverse = &mut inverse[..pivots];
        let stack = MemStack::new(scratch);
        lu_in_place(upper.as_mut(), exchanges, inverse, Par::Seq, stack, Default::default());
        let (square, right) = upper.as_ref().split_at_col(pivots);
        let columns = lower.as_mut().transpose_mut();
        solve_lower_triangular_in_place(square.transpose(), columns, Par::Seq);
        matmul(rest, Accum::Add, lower.as_ref(), right, -Complex64::ONE, Par::Seq);
        for pivot in self.upper.iter_mut().step_by(pivots + 1).take(pivots) {
            *pivot = pivot.inv();
        }
    }
}

impl LocalFactors {
    pub(super) fn new(matrix: &BlockMatrix) -> Result<Self> {
        let order = Elimination::new(matrix)?;
        let (count, most) = (order.count(), order.most_pivots());
        Ok(Self {
            values: zeros(order.entries())?,
            waiting: zeros(order.most_waiting())?,
            local: vec![0; count],
            exchanges: vec![0; count],
            ordered: zeros(count)?,
            pivots: zeros(most)?,
            inverse: vec![0; most],
            scratch: MemBuffer::new(lu_in_place_scratch::<u32, Complex64>(
                most,
                most,
                Par::Seq,
                Default::default(),
            )),
            order,
            mode: ShiftedMode { shift: 0.0, wavenumber: 0.0 },
        })
    }

    /// Factorises this rank's part of `M` of `mode`.
    pub(super) fn factorise(&mut self, matrix: &BlockMatrix, mode: ShiftedMode) {
        self.mode = mode;
        let Self { order, values, waiting, local, .. } = self;
        values.fill(Complex64::ZERO);
        let (mut parts, mut end) = (Vec::<&Front>::new(), 0);
        let mut rows = Vec::new();
        let mut left = &mut values[..];
        for front in &order.fronts {
            let below = &order.rows[front.below.clone()];
            let places = front.pivots.clone().chain(below.iter().map(|&i| i as usize));
            places.zip(0..).for_each(|(place, i)| local[place] = i);
            let (pivots, square) = (front.pivots.len(), front.waiting());
            let (own, others) = left.split_at_mut(front.entries());
            left = others;
            let (upper, lower) = own.split_at_mut(pivots * (pivots + below.len()));
            let (before, rest) = waiting.split_at_mut(end);
            let rest = &mut rest[..square];
            rest.fill(Complex64::ZERO);
            let mut entries = Entries { pivots, below: below.len(), upper, lower, rest };
            set(&mut entries, order, front, local, matrix, mode);
            let mut start = end;
            for part in parts.drain(parts.len() - front.parts..).rev() {
                rows.clear();
                rows.extend(order.rows[part.below.clone()].iter().map(|&i| local[i as usize]));
                let from = start - part.waiting();
                entries.add(&before[from..start], &rows);
                start = from;
            }
            let exchanges = &mut self.exchanges[front.pivots.clone()];
            entries.eliminate(exchanges, &mut self.inverse, &mut self.scratch);
            waiting.copy_within(end..end + square, start);
            parts.push(front);
            end = start + square;
        }
    }

    /// `x ←` (this rank's part of `M`)`⁻¹ x`.
    pub(super) fn precondition(&mut self, x: &mut [Complex64]) {
        for (y, &i) in self.ordered.iter_mut().zip(&self.order.unknowns) {
            *y = x[i as usize];
        }
        self.solve_lower();
        self.solve_upper();
        for (y, &i) in self.ordered.iter().zip(&self.order.unknowns) {
            x[i as usize] = *y;
        }
    }

    /// The first half of a solve: front by front, subtracts from the rows below.
    fn solve_lower(&mut self) {
        let Self { order, values, ordered, pivots, exchanges, .. } = self;
        let mut start = 0;
        for front in &order.fronts {
            let (own, rows) = (front.pivots.clone(), &order.rows[front.below.clone()]);
            let count = own.len();
            let values = &values[start..start + front.entries()];
            start += values.len();
            let (upper, lower) = values.split_at(count * (count + rows.len()));
            pivots[..count].copy_from_slice(&ordered[own.clone()]);
            for (place, &i) in own.clone().zip(&exchanges[own.clone()]) {
                ordered[place] = pivots[i as usize];
            }
            for (j, place) in own.clone().enumerate() {
                let value = ordered[place];
                let column = &upper[j * count..(j + 1) * count];
                for (y, entry) in ordered[place + 1..own.end].iter_mut().zip(&column[j + 1..]) {
                    *y -= entry * value;
                }
                let column = &lower[j * rows.len()..(j + 1) * rows.len()];
                for (&i, entry) in rows.iter().zip(column) {
                    ordered[i as usize] -= entry * value;
                }
            }
        }
    }

    /// The second half: front by front, from the last one, the pivots from the rows below.
    fn solve_upper(&mut self) {
        let Self { order, values, ordered, .. } = self;
        let mut end = values.len();
        for front in order.fronts.iter().rev() {
            let (own, rows) = (front.pivots.clone(), &order.rows[front.below.clone()]);
            let count = own.len();
            end -= front.entries();
            let (square, right) = values[end..].split_at(count * count);
            for (&i, column) in rows.iter().zip(right.chunks_exact(count)) {
                let value = ordered[i as usize];
                for (y, entry) in ordered[own.clone()].iter_mut().zip(column) {
                    *y -= entry * value;
                }
            }
            for (j, column) in square.chunks_exact(count).enumerate().rev() {
                let (before, own) = ordered[own.clone()].split_at_mut(j);
                own[0] *= column[j];
                for (y, entry) in before.iter_mut().zip(column) {
                    *y -= entry * own[0];
                }
            }
        }
    }

    pub(super) fn count(&self) -> usize {
        self.order.count()
    }

    /// `y ← Mx`. Collective over the space group.
    pub(super) fn apply(
        &self,
        system: &mut Evolution<'_>,
        y: &mut [Complex64],
        x: &mut [Complex64],
    ) {
        system.matrix.apply_mode(system.exchange, self.mode.wavenumber, y, x);
        for (y, x) in y.iter_mut().zip(&x[..self.count()]) {
            *y = x - self.mode.shift * *y;
        }
    }
}

/// Adds the entries of `M` in rows and columns of the pivots of `front`.
fn set(
    entries: &mut Entries<'_>,
    order: &Elimination,
    front: &Front,
    local: &[u32],
    matrix: &BlockMatrix,
    ShiftedMode { shift: a, wavenumber: mu }: ShiftedMode,
) {
    for (i, place) in front.pivots.clone().enumerate() {
        *entries.at(i, i) += 1.0;
        for (column, s, k) in matrix.row(order.unknowns[place] as usize) {
            let Some(&to) =
                order.places.get(column).filter(|&&to| to as usize >= front.pivots.start)
            else {
                continue;
            };
            let j = local[to as usize] as usize;
            *entries.at(i, j) += Complex64::new(-a * k, a * mu * s);
            if j >= entries.pivots {
                // S is symmetric, K skew.
                *entries.at(j, i) += Complex64::new(a * k, a * mu * s);
            }
        }
    }
}
