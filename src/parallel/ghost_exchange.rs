//! The exchange of ghost rows between neighbouring blocks.

use crate::parallel::group::{Group, MOST_AT_ONCE};
use crate::parallel::partition::{Block, Exchange};
use mpi::ffi;
use mpi::traits::*;
use num_complex::Complex64;
use std::ops::Range;

/// A row of a distributed vector: a fixed number of values side by side.
pub trait VectorRow: Copy {
    /// Numbers in a row.
    const WIDTH: usize;
    /// Writes its numbers, [`Self::WIDTH`] of them.
    fn write_to(&self, numbers: &mut [f64]);
    /// The row of these numbers.
    fn of(numbers: &[f64]) -> Self;
}

impl VectorRow for f64 {
    const WIDTH: usize = 1;
    fn write_to(&self, numbers: &mut [f64]) {
        numbers[0] = *self;
    }
    fn of(numbers: &[f64]) -> Self {
        numbers[0]
    }
}

impl VectorRow for Complex64 {
    const WIDTH: usize = 2;
    fn write_to(&self, numbers: &mut [f64]) {
        numbers.copy_from_slice(&[self.re, self.im]);
    }
    fn of(numbers: &[f64]) -> Self {
        Self::new(numbers[0], numbers[1])
    }
}

/// Exchange of ghost rows with the neighbouring blocks, for vectors of up to `width` numbers a row.
pub struct GhostExchange {
    group: Group,
    neighbours: Vec<Neighbour>,
    requests: Vec<ffi::MPI_Request>,
}

struct Neighbour {
    rank: i32,
    rows: Vec<u32>,
    ghosts: Range<usize>,
    send: Vec<f64>,
    receive: Vec<f64>,
}

impl GhostExchange {
    /// The exchange of `block`'s ghosts over the ranks of `space`, with buffers for `width` numbers
    /// a row. Collective over `space`.
    pub fn new(space: &Group, block: &Block, width: usize) -> Self {
        let neighbours: Vec<Neighbour> = block
            .exchanges()
            .into_iter()
            .map(|Exchange { neighbour, send: rows, ghosts }| Neighbour {
                rank: neighbour as i32,
                send: vec![0.0; rows.len() * width],
                receive: vec![0.0; ghosts.len() * width],
                rows,
                ghosts,
            })
            .collect();
        let pieces: usize = neighbours
            .iter()
            .map(|n| n.send.len().div_ceil(MOST_AT_ONCE) + n.receive.len().div_ceil(MOST_AT_ONCE))
            .sum();
        Self { group: space.duplicate(), neighbours, requests: Vec::with_capacity(pieces) }
    }

    /// The ranks that exchange.
    pub fn group(&self) -> &Group {
        &self.group
    }

    /// Sends the rows of `vector` that the neighbours need, and posts the receives.
    pub fn start<R: VectorRow>(&mut self, vector: &[R]) {
        assert!(self.requests.is_empty(), "one exchange at a time");
        let communicator = self.group.communicator.as_raw();
        for neighbour in &mut self.neighbours {
            let length = neighbour.ghosts.len() * R::WIDTH;
            for piece in neighbour.receive[..length].chunks_mut(MOST_AT_ONCE) {
                let (buffer, count) = (piece.as_mut_ptr().cast(), piece.len() as i32);
                // SAFETY: the buffer is on the heap and has so many numbers. Nobody touches it
                // until `finish` has waited for the request: `start` refuses to run twice, and
                // `drop` leaves the buffer to MPI.
                self.requests.push(posted(|request| unsafe {
                    let (kind, from) = (ffi::RSMPI_DOUBLE, neighbour.rank);
                    ffi::MPI_Irecv(buffer, count, kind, from, 0, communicator, request)
                }));
            }
        }
        for neighbour in &mut self.neighbours {
            let length = neighbour.rows.len() * R::WIDTH;
            for (out, &row) in
                neighbour.send[..length].chunks_exact_mut(R::WIDTH).zip(&neighbour.rows)
            {
                vector[row as usize].write_to(out);
            }
            for piece in neighbour.send[..length].chunks(MOST_AT_ONCE) {
                let (buffer, count) = (piece.as_ptr().cast(), piece.len() as i32);
                // SAFETY: as above.
                self.requests.push(posted(|request| unsafe {
                    let (kind, to) = (ffi::RSMPI_DOUBLE, neighbour.rank);
                    ffi::MPI_Isend(buffer, count, kind, to, 0, communicator, request)
                }));
            }
        }
    }

    /// Waits, and copies the received rows into `ghosts`, the ghost rows of the vector.
    pub fn finish<R: VectorRow>(&mut self, ghosts: &mut [R]) {
        if self.requests.is_empty() {
            return;
        }
        // SAFETY: `start` made all requests; each is completed here, once.
        unsafe {
            ffi::MPI_Waitall(
                self.requests.len() as i32,
                self.requests.as_mut_ptr(),
                ffi::RSMPI_STATUSES_IGNORE,
            );
        }
        self.requests.clear();
        for neighbour in &self.neighbours {
            let rows = &mut ghosts[neighbour.ghosts.clone()];
            for (row, piece) in rows.iter_mut().zip(neighbour.receive.chunks_exact(R::WIDTH)) {
                *row = R::of(piece);
            }
        }
    }
}

/// The request that `post` makes.
fn posted(post: impl FnOnce(&mut ffi::MPI_Request) -> i32) -> ffi::MPI_Request {
    // SAFETY: a constant of the library, which is never written.
    let mut request = unsafe { ffi::RSMPI_REQUEST_NULL };
    // A failure ends the job.
    post(&mut request);
    request
}

impl Drop for GhostExchange {
    /// Does not free buffers that MPI may still use.
    fn drop(&mut self) {
        debug_assert!(self.requests.is_empty(), "an exchange was not finished");
        if !self.requests.is_empty() {
            std::mem::forget(std::mem::take(&mut self.neighbours));
        }
    }
}
