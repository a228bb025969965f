//! Groups of ranks: messages to all, gathered values, reductions, agreement on errors.
//!
//! All reductions are sums of integers, maxima or minima, so that results have the same bits on any
//! number of ranks. [`sums`] has those of floating-point numbers.

mod sums;

use crate::base::error::{Error, Result};
use crate::parallel::partition::split;
use mpi::collective::SystemOperation;
use mpi::datatype::{Partition, PartitionMut};
use mpi::ffi;
use mpi::topology::{Color, SimpleCommunicator};
use mpi::traits::*;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::ops::Range;

/// Most elements handed to MPI in one call; counts are C ints, and a bounded piece keeps MPI's own
/// buffers small.
pub(super) const MOST_AT_ONCE: usize = 1 << 20;

/// A group of ranks.
pub struct Group {
    pub(super) communicator: SimpleCommunicator,
}

impl Group {
    /// The ranks of a communicator.
    pub(super) fn new(communicator: SimpleCommunicator) -> Self {
        Self { communicator }
    }

    /// A group of the same ranks, with messages of its own.
    pub(super) fn duplicate(&self) -> Self {
        Self::new(self.communicator.duplicate())
    }

    /// This process's rank in the group.
    pub fn rank(&self) -> usize {
        self.communicator.rank() as usize
    }

    /// Whether this process is the first of the group.
    pub fn is_first(&self) -> bool {
        self.rank() == 0
    }

    /// Number of ranks.
    pub fn size(&self) -> usize {
        self.communicator.size() as usize
    }

    /// Waits for all.
    pub fn barrier(&self) {
        self.communicator.barrier();
    }

    /// The communicator as HDF5 takes it.
    pub fn raw(&self) -> ffi::MPI_Comm {
        self.communicator.as_raw()
    }

    /// Replaces `values` by those of rank 0. Collective.
    pub fn broadcast_words(&self, values: &mut [u64]) {
        self.communicator.process_at_rank(0).broadcast_into(values);
    }

    /// Rank 0's text, on every rank.
    pub fn broadcast_text(&self, text: &str) -> String {
        let root = self.communicator.process_at_rank(0);
        let mut length = text.len() as u64;
        root.broadcast_into(&mut length);
        let mut bytes =
            if self.is_first() { text.as_bytes().to_vec() } else { vec![0; length as usize] };
        for piece in bytes.chunks_mut(MOST_AT_ONCE) {
            root.broadcast_into(piece);
        }
        String::from_utf8_lossy(&bytes).into_owned()
    }

    /// Elementwise maximum over the ranks; NaN on any rank gives NaN. Allocates nothing.
    pub fn max_into(&self, values: &mut [f64]) {
        const PIECE: usize = 512;
        let (mut keys, mut result) = ([0i64; PIECE], [0i64; PIECE]);
        for piece in values.chunks_mut(PIECE) {
            let (keys, result) = (&mut keys[..piece.len()], &mut result[..piece.len()]);
            // MPI_MAX is undefined for NaN: values become ordered integers, with NaN above
            // infinity.
            for (key, &value) in keys.iter_mut().zip(&*piece) {
                *key = ordered_key(value);
            }
            self.communicator.all_reduce_into(&*keys, result, SystemOperation::max());
            for (value, &key) in piece.iter_mut().zip(&*result) {
                *value = from_ordered_key(key);
            }
        }
    }

    /// Reduces one number over the ranks; allocates nothing.
    ///
    /// Integers are signed, as MPICH 4.0 compares unsigned ones as if they were signed.
    fn reduced(&self, value: i64, operation: SystemOperation) -> i64 {
        let mut result = 0;
        (self.communicator).all_reduce_into(&value, &mut result, operation);
        result
    }

    /// Largest value over the ranks, NaN if one is; allocates nothing.
    pub fn max(&self, value: f64) -> f64 {
        from_ordered_key(self.reduced(ordered_key(value), SystemOperation::max()))
    }

    /// Sum of counts over the ranks.
    pub fn sum_count(&self, value: usize) -> usize {
        self.sum_modulo(value as u64) as usize
    }

    /// Largest count over the ranks; counts are below 2^63.
    pub fn max_count(&self, value: usize) -> usize {
        debug_assert!(i64::try_from(value).is_ok());
        self.reduced(value as i64, SystemOperation::max()) as usize
    }

    /// This rank's piece of `range`, of which each rank has a nearly equal one.
    pub fn piece_of(&self, range: &Range<usize>) -> Range<usize> {
        split(range, self.size(), self.rank())
    }

    /// Whether any rank says so. Collective.
    pub fn any(&self, mine: bool) -> bool {
        self.max_count(usize::from(mine)) > 0
    }

    /// Least count over the ranks; counts are below 2^63.
    pub fn min_count(&self, value: usize) -> usize {
        debug_assert!(i64::try_from(value).is_ok());
        self.reduced(value as i64, SystemOperation::min()) as usize
    }

    /// Whether all ranks give the same number.
    pub fn same(&self, value: u64) -> bool {
        let value = value as i64;
        let largest = self.reduced(value, SystemOperation::max());
        largest == self.reduced(value, SystemOperation::min())
    }

    /// Adds a few integers over the ranks, elementwise, in place; allocates nothing.
    pub fn sum_integers(&self, values: &mut [i64]) {
        let mut result = [0i64; 32];
        for piece in values.chunks_mut(result.len()) {
            let result = &mut result[..piece.len()];
            self.communicator.all_reduce_into(&*piece, result, SystemOperation::sum());
            piece.copy_from_slice(result);
        }
    }

    /// Gathers values on all ranks, bit by bit, in the same vector. Each value is zero on all ranks
    /// but one.
    pub fn gathered(&self, mut values: Vec<f64>) -> Vec<f64> {
        if self.size() == 1 {
            return values;
        }
        // As integers: a sum over the ranks keeps every bit.
        let mut bits = vec![0i64; values.len().min(MOST_AT_ONCE)];
        let mut sums = bits.clone();
        for piece in values.chunks_mut(MOST_AT_ONCE) {
            let (bits, sums) = (&mut bits[..piece.len()], &mut sums[..piece.len()]);
            bits.iter_mut().zip(&*piece).for_each(|(bits, x)| *bits = x.to_bits() as i64);
            self.communicator.all_reduce_into(&*bits, sums, SystemOperation::sum());
            piece.iter_mut().zip(&*sums).for_each(|(x, bits)| *x = f64::from_bits(*bits as u64));
        }
        values
    }

    /// Sum over the ranks, modulo 2^64.
    pub fn sum_modulo(&self, value: u64) -> u64 {
        self.reduced(value as i64, SystemOperation::sum()) as u64
    }

    /// Sums integers over the ranks on rank `root`; on other ranks `values` do not change.
    /// Collective.
    pub fn sum_integers_to(&self, root: usize, values: &mut [i64]) {
        if self.size() == 1 {
            return;
        }
        let process = self.communicator.process_at_rank(root as i32);
        let mine = self.rank() == root;
        let length = if mine { values.len().min(MOST_AT_ONCE) } else { 0 };
        let mut result = vec![0i64; length];
        for piece in values.chunks_mut(MOST_AT_ONCE) {
            if mine {
                let result = &mut result[..piece.len()];
                process.reduce_into_root(&*piece, result, SystemOperation::sum());
                piece.copy_from_slice(result);
            } else {
                process.reduce_into(&*piece, SystemOperation::sum());
            }
        }
    }

    /// Sends `messages[r]` to rank `r`; returns the received messages, by sending rank. Collective.
    pub fn exchanged(&self, messages: &[Vec<u64>]) -> Vec<Vec<u64>> {
        let size = self.size();
        let lengths: Vec<u64> = messages.iter().map(|message| message.len() as u64).collect();
        let mut coming = vec![0u64; size];
        self.communicator.all_to_all_into(&lengths[..], &mut coming[..]);
        let piece = (MOST_AT_ONCE / size).max(1);
        let longest = messages.iter().map(Vec::len).max().unwrap_or(0);
        let mut received = vec![Vec::new(); size];
        for first in (0..self.max_count(longest)).step_by(piece) {
            let part = |length: u64| (length as usize).saturating_sub(first).min(piece);
            let [to, from] = [&lengths, &coming]
                .map(|lengths| lengths.iter().map(|n| part(*n) as i32).collect::<Vec<i32>>());
            let sent: Vec<u64> = (messages.iter().zip(&to))
                .flat_map(|(message, n)| message.iter().skip(first).take(*n as usize).copied())
                .collect();
            let total = from.iter().map(|n| *n as usize).sum();
            let mut buffer = vec![0u64; total];
            self.communicator.all_to_all_varcount_into(
                &Partition::new(&sent[..], &to[..], offsets(&to)),
                &mut PartitionMut::new(&mut buffer[..], &from[..], offsets(&from)),
            );
            let mut rest = &buffer[..];
            for (received, n) in received.iter_mut().zip(&from) {
                let (mine, others) = rest.split_at(*n as usize);
                received.extend_from_slice(mine);
                rest = others;
            }
        }
        received
    }

    /// Gathers equally many numbers of each rank on rank 0, rank after rank; empty on other ranks.
    /// Collective.
    pub fn gather_counts(&self, values: &[u64]) -> Vec<u64> {
        let root = self.communicator.process_at_rank(0);
        if !self.is_first() {
            root.gather_into(values);
            return Vec::new();
        }
        let mut all = vec![0; values.len() * self.size()];
        root.gather_into_root(values, &mut all[..]);
        all
    }

    /// Does `work` on the first rank; the others get the default value, or its error. Collective.
    ///
    /// # Errors
    /// As `work`, the same on all ranks.
    pub fn on_first_rank<T: Default>(&self, work: impl FnOnce() -> Result<T>) -> Result<T> {
        self.agree(if self.is_first() { work() } else { Ok(T::default()) })
    }

    /// What `work` finds on the first rank, on every rank. It holds neither infinity nor NaN, as it
    /// is sent as JSON. Collective.
    ///
    /// # Errors
    /// As `work`, the same on all ranks.
    pub fn of_first_rank<T: Serialize + DeserializeOwned>(
        &self,
        work: impl FnOnce() -> Result<T>,
    ) -> Result<T> {
        let text = self.on_first_rank(|| {
            serde_json::to_string(&work()?).map_err(|e| Error::Input(e.to_string()))
        })?;
        serde_json::from_str(&self.broadcast_text(&text)).map_err(|e| Error::Input(e.to_string()))
    }

    /// Makes all ranks agree: `Ok` if all ranks have `Ok`, otherwise the lowest failing rank's
    /// error on all.
    ///
    /// # Errors
    /// The agreed error; [`Error::Remote`] if it is another rank's.
    pub fn agree<T>(&self, result: Result<T>) -> Result<T> {
        let size = self.size();
        let first = self.min_count(if result.is_err() { self.rank() } else { size });
        if first == size {
            return result;
        }
        let root = self.communicator.process_at_rank(first as i32);
        let (mut about, mut message) = match &result {
            Err(error) if self.rank() == first => (
                [error.exit_code(), i32::from(error.leaves_files_open())],
                error.to_string().into_bytes(),
            ),
            _ => ([0, 0], Vec::new()),
        };
        let mut length = message.len() as u64;
        root.broadcast_into(&mut about[..]);
        root.broadcast_into(&mut length);
        message.resize(length as usize, 0);
        root.broadcast_into(&mut message[..]);
        match result {
            Err(error) if self.rank() == first => Err(error),
            _ => Err(Error::Remote {
                rank: first,
                message: String::from_utf8_lossy(&message).into_owned(),
                code: about[0],
                files_open: about[1] != 0,
            }),
        }
    }

    /// Number of ranks that share this rank's memory.
    pub fn ranks_on_node(&self) -> usize {
        self.communicator.split_shared(0).size() as usize
    }

    /// The ranks that give the same `color`, in the order of their ranks.
    pub(super) fn split(&self, color: usize) -> Group {
        let part = self.communicator.split_by_color(Color::with_value(color as i32));
        Self::new(part.expect("a colour is given"))
    }
}

/// Offsets of consecutive parts of these lengths.
fn offsets(lengths: &[i32]) -> Vec<i32> {
    let mut end = 0;
    let mut place = |length: &i32| {
        end += length;
        end - length
    };
    lengths.iter().map(&mut place).collect()
}

/// Maps floats to integers in the same order, NaN above all.
fn ordered_key(value: f64) -> i64 {
    if value.is_nan() {
        return i64::MAX;
    }
    turned((value + 0.0).to_bits() as i64)
}

fn from_ordered_key(key: i64) -> f64 {
    if key == i64::MAX { f64::NAN } else { f64::from_bits(turned(key) as u64) }
}

/// Inverts all bits of a negative number but the sign, so that integers are ordered as floats; its
/// own inverse.
fn turned(bits: i64) -> i64 {
    if bits < 0 { bits ^ i64::MAX } else { bits }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_keep_the_order() {
        let list = [f64::NEG_INFINITY, -1e300, -1.0, -1e-300, 0.0, 1e-300, 2.0, f64::INFINITY];
        for pair in list.windows(2) {
            assert!(ordered_key(pair[0]) < ordered_key(pair[1]));
        }
        for value in list {
            assert_eq!(from_ordered_key(ordered_key(value)), value);
        }
        assert!(from_ordered_key(ordered_key(f64::NAN)).is_nan());
    }
}
