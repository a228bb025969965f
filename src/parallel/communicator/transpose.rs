//! Distributed transpose: between ranks that have some modes of every cell and ranks that have
//! every mode of some cells.
//!
//! ```text
//! by mode   rank g has  x_l(i)  for its own modes l and all cells i
//! by cell   rank g has  x_l(i)  for all modes l and its own cells i
//! ```
//!
//! The caller transposes the cells in rounds of limited size, so that buffers stay small for any
//! field. In a round the ranks form a ring: in step `s` each sends to `rank + s` and receives from
//! `rank − s`, in pieces whose length fits a C int. A rank copies its own part.

use crate::parallel::group::{Group, MOST_AT_ONCE};
use mpi::point_to_point::send_receive_into;
use mpi::traits::Communicator as _;
use num_complex::Complex64;
use std::ops::Range;

/// The distribution of the modes, and the buffers of an exchange.
pub struct Transpose<'a> {
    group: &'a Group,
    /// `modes[g]`: the modes of rank `g`, in the order in which it keeps them.
    modes: Vec<Vec<usize>>,
    /// Number of all modes.
    count: usize,
    /// Most cells of a rank in a round.
    cells: usize,
    /// Most elements of a message.
    most: usize,
    send: Vec<Complex64>,
    receive: Vec<Complex64>,
}

impl<'a> Transpose<'a> {
    /// The transpose over `group`, whose rank `g` has `modes[g]`, in rounds of at most `cells`
    /// cells a rank. The lists contain each of `0..` once.
    pub fn new(group: &'a Group, modes: Vec<Vec<usize>>, cells: usize) -> Self {
        Self::in_pieces(group, modes, cells, MOST_AT_ONCE)
    }

    /// The transposition as [`new`](Self::new) makes it, with messages of at most `most` elements.
    pub fn in_pieces(group: &'a Group, modes: Vec<Vec<usize>>, cells: usize, most: usize) -> Self {
        assert_eq!(modes.len(), group.size(), "a list of modes for each rank");
        let buffer = vec![Complex64::ZERO; buffer(&modes, cells)];
        Self {
            count: modes.iter().map(Vec::len).sum(),
            send: buffer.clone(),
            receive: buffer,
            group,
            modes,
            cells,
            most,
        }
    }

    /// Number of all modes.
    pub fn modes(&self) -> usize {
        self.count
    }

    /// Number of ranks.
    fn size(&self) -> usize {
        self.group.size()
    }

    /// This rank's number.
    pub fn rank(&self) -> usize {
        self.group.rank()
    }

    /// Transposes from modes to cells:
    /// `all[(i − cells[rank].start)·modes + l] = by_mode[k·stride + i]`, `l` being the `k`-th mode
    /// of the rank that has it, for the cells `cells[rank]` of each rank. Collective over the
    /// group; allocates nothing.
    pub fn to_cells(
        &mut self,
        by_mode: &[Complex64],
        stride: usize,
        cells: &[Range<usize>],
        all: &mut [Complex64],
    ) {
        let (rank, size, count) = (self.rank(), self.size(), self.count);
        let own = cells[rank].len();
        for (k, &l) in self.modes[rank].iter().enumerate() {
            scatter(&by_mode[k * stride..][cells[rank].clone()], all, l, count);
        }
        for Partners { to, from } in partners(rank, size) {
            let length = cells[to].len();
            for k in 0..self.modes[rank].len() {
                let line = &by_mode[k * stride..][cells[to].clone()];
                self.send[k * length..][..length].copy_from_slice(line);
            }
            let outgoing = Message { rank: to, length: self.modes[rank].len() * length };
            let incoming = Message { rank: from, length: self.modes[from].len() * own };
            self.swap(outgoing, incoming);
            for (k, &l) in self.modes[from].iter().enumerate() {
                scatter(&self.receive[k * own..][..own], all, l, count);
            }
        }
    }

    /// The inverse of [`to_cells`](Self::to_cells). Collective over the group; allocates nothing.
    pub fn to_modes(
        &mut self,
        all: &[Complex64],
        cells: &[Range<usize>],
        by_mode: &mut [Complex64],
        stride: usize,
    ) {
        let (rank, size, count) = (self.rank(), self.size(), self.count);
        let own = cells[rank].len();
        for (k, &l) in self.modes[rank].iter().enumerate() {
            gather(&mut by_mode[k * stride..][cells[rank].clone()], all, l, count);
        }
        for Partners { to, from } in partners(rank, size) {
            for (k, &l) in self.modes[to].iter().enumerate() {
                gather(&mut self.send[k * own..][..own], all, l, count);
            }
            let length = cells[from].len();
            let outgoing = Message { rank: to, length: self.modes[to].len() * own };
            let incoming = Message { rank: from, length: self.modes[rank].len() * length };
            self.swap(outgoing, incoming);
            for k in 0..self.modes[rank].len() {
                let line = &mut by_mode[k * stride..][cells[from].clone()];
                line.copy_from_slice(&self.receive[k * length..][..length]);
            }
        }
    }

    /// Sends the packed elements and receives others, in as many pieces as the longest message
    /// between any two ranks needs: equally many on every rank.
    fn swap(&mut self, outgoing: Message, incoming: Message) {
        let process = |rank: usize| self.group.communicator.process_at_rank(rank as i32);
        let (to, from) = (process(outgoing.rank), process(incoming.rank));
        for start in (0..buffer(&self.modes, self.cells)).step_by(self.most) {
            let piece = |length: usize| start.min(length)..(start + self.most).min(length);
            let into = &mut self.receive[piece(incoming.length)];
            send_receive_into(&self.send[piece(outgoing.length)], &to, into, &from);
        }
    }
}

/// The ranks to which a rank sends, and from which it receives, in a step.
struct Partners {
    to: usize,
    from: usize,
}

/// The partners of `rank` among `size` ranks, step by step: each other rank once.
fn partners(rank: usize, size: usize) -> impl Iterator<Item = Partners> {
    let of = move |step| Partners { to: (rank + step) % size, from: (rank + size - step) % size };
    (1..size).map(of)
}

/// A message to or from a rank.
struct Message {
    rank: usize,
    /// Elements.
    length: usize,
}

/// Elements of the longest message: one rank's modes in another's cells.
fn buffer(modes: &[Vec<usize>], cells: usize) -> usize {
    match modes.len() {
        1 => 0,
        _ => modes.iter().map(Vec::len).max().unwrap_or(0) * cells,
    }
}

/// Copies mode `l` of `count`, cell after cell, to its place among the modes of each cell.
fn scatter(line: &[Complex64], all: &mut [Complex64], l: usize, count: usize) {
    for (x, cell) in line.iter().zip(all.chunks_exact_mut(count)) {
        cell[l] = *x;
    }
}

/// The inverse of [`scatter`].
fn gather(line: &mut [Complex64], all: &[Complex64], l: usize, count: usize) {
    for (x, cell) in line.iter_mut().zip(all.chunks_exact(count)) {
        *x = cell[l];
    }
}
