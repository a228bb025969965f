//! MPI: start and end, groups of ranks, agreement on errors, exact reductions, ghost exchange.
//!
//! A serial run has one rank. Nothing depends on timing, and all reductions are sums of integers,
//! maxima or minima. So results have the same bits on any number of ranks.

pub mod transpose;
pub mod vote;
pub(crate) mod watch;

use crate::base::error::{Error, Result};
use crate::base::fixed_point::{FixedPoint, larger};
use crate::base::machine;
use crate::parallel::partition::{Block, Exchange, ProcessMesh};
use mpi::collective::SystemOperation;
use mpi::datatype::{Partition, PartitionMut};
use mpi::ffi;
use mpi::topology::{Color, SimpleCommunicator};
use mpi::traits::*;
use mpi::traits::{Communicator as _, CommunicatorCollectives};
use num_complex::Complex64;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::ffi::OsStr;
use std::ops::Range;
use std::path::PathBuf;
use std::time::Instant;
use tempfile::TempDir;

/// MPI, from initialisation to the end of the process.
pub struct World {
    universe: mpi::environment::Universe,
    /// Dropped after MPI is finalised.
    _watch: Option<watch::RankWatch>,
    /// Where Open MPI keeps files of a process without a launcher. Removed after MPI is finalised.
    _session: Option<TempDir>,
    /// Seconds that MPI took to start.
    pub start_seconds: f64,
    /// The time at which MPI was started.
    pub started: Instant,
}

impl World {
    /// Starts MPI; a panic on any rank then ends the whole job, and so does a rank that was stopped
    /// for too long. Must be called before the program starts a thread, as it may set
    /// environment variables.
    ///
    /// Returns `None` when MPI was started before.
    pub fn start() -> Option<Self> {
        let started = Instant::now();
        let session = configure_open_mpi();
        let universe = mpi::initialize()?;
        let start_seconds = started.elapsed().as_secs_f64();
        let hook = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |info| {
            hook(info);
            if mpi::environment::is_initialized() && !mpi::environment::is_finalized() {
                let world = SimpleCommunicator::world();
                let line = format!("phasewarp: rank {} stopped; ending the job", world.rank());
                crate::base::log::report(&line);
                world.abort(1);
            }
        }));
        let watch = watch::RankWatch::start(&universe.world());
        Some(Self { universe, _watch: watch, _session: session, start_seconds, started })
    }

    /// All ranks, as one group.
    pub fn group(&self) -> Group {
        Group { communicator: self.universe.world() }
    }

    /// Name and version of the MPI library.
    pub fn library(&self) -> String {
        let text = mpi::environment::library_version().unwrap_or_default();
        text.split(',').next().unwrap_or("").trim().to_owned()
    }
}

impl Drop for World {
    /// Keeps Open MPI's components loaded. Open MPI unloads them while its own thread may still
    /// call them: about one command in a thousand ended with a segmentation fault (version 4.1.4).
    fn drop(&mut self) {
        machine::keep_libraries("/mca_");
    }
}

/// Settings of Open MPI that this program needs. The user's own settings take precedence; other MPI
/// libraries ignore these.
///
/// - The component for shared file pointers, which is not used here, is off. It copies the name of
///   every opened file into 256 bytes, and longer names abort the program (version 4.1.4).
/// - On one machine, messages use shared memory. The search for networks would take 0.2 s with the
///   library of Debian (`docs/performance.md`).
/// - A process without a launcher starts no daemon. The daemon takes longer to start than the
///   program, and one command in some thousand then waited for ever at its end, for a thread of
///   PMIx (version 4.1.4). Without a daemon, processes do not know of each other, and each needs a
///   directory of its own for what Open MPI keeps in files. It is made where the user's Open MPI
///   has its own, and returned. If it cannot be made, there is a daemon.
fn configure_open_mpi() -> Option<TempDir> {
    const BASE: &str = "OMPI_MCA_orte_tmpdir_base";
    let variable = |name: &str| std::env::var(name).ok();
    // SAFETY: no other thread reads the environment; see `World::start`.
    let set = |name: &str, value: &OsStr| unsafe { std::env::set_var(name, value) };
    let propose = |name: &str, value: &str| {
        if std::env::var_os(name).is_none() {
            set(name, value.as_ref());
        }
    };
    propose("OMPI_MCA_sharedfp", "^lockedfile");
    if on_one_machine(variable) {
        propose("OMPI_MCA_pml", "ob1");
    }
    // Ranks of Slurm without PMI, or a shell in a step.
    let in_a_step = std::env::var_os("SLURM_STEP_ID").is_some();
    if has_launcher(variable) || in_a_step {
        return None;
    }
    let base = std::env::var_os(BASE).map_or_else(std::env::temp_dir, PathBuf::from);
    let session = tempfile::Builder::new().prefix("phasewarp-").tempdir_in(base).ok()?;
    propose("OMPI_MCA_ess_singleton_isolated", "1");
    set(BASE, session.path().as_os_str());
    Some(session)
}

/// Whether a launcher started this process.
fn has_launcher(variable: impl Fn(&str) -> Option<String>) -> bool {
    // Open MPI's own launcher, and those of Slurm and other batch systems.
    ["OMPI_COMM_WORLD_SIZE", "PMIX_RANK", "PMI_RANK"].iter().any(|name| variable(name).is_some())
}

/// Whether all ranks are on this machine: the launcher's variables count as many local ranks as
/// ranks in all, or there is no launcher. Every rank of a job gets the same answer.
fn on_one_machine(variable: impl Fn(&str) -> Option<String>) -> bool {
    match (variable("OMPI_COMM_WORLD_SIZE"), variable("OMPI_COMM_WORLD_LOCAL_SIZE")) {
        (Some(all), Some(here)) => all == here,
        _ => !has_launcher(variable),
    }
}

/// Most elements handed to MPI in one call; counts are C ints, and a bounded piece keeps MPI's own
/// buffers small.
const MOST_AT_ONCE: usize = 1 << 20;

/// A group of ranks.
pub struct Group {
    communicator: SimpleCommunicator,
}

impl Group {
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

    /// Sum over the ranks of `count` terms in all, each of magnitude at most `bound`; `terms` are
    /// this rank's. The bits do not depend on the ranks. NaN if the bound is not finite.
    pub fn sum(&self, bound: f64, count: usize, terms: impl Iterator<Item = f64>) -> f64 {
        if !bound.is_finite() {
            return f64::NAN;
        }
        let [sum] = self.fixed_sums([FixedPoint::new(bound, count)], terms.map(|term| [term]));
        sum
    }

    /// Sums `N` lists of terms at once, each by its own representation. Allocates nothing.
    pub(crate) fn fixed_sums<const N: usize>(
        &self,
        fixed: [FixedPoint; N],
        terms: impl Iterator<Item = [f64; N]>,
    ) -> [f64; N] {
        let mut totals = [[0i64; 2]; N];
        for term in terms {
            for l in 0..N {
                let parts = fixed[l].split(term[l]);
                totals[l][0] += parts[0];
                totals[l][1] += parts[1];
            }
        }
        self.sum_integers(totals.as_flattened_mut());
        std::array::from_fn(|l| fixed[l].join(totals[l]))
    }

    /// Sums `N` lists of terms at once, as [`sum`](Self::sum) does each. Their bounds are found
    /// first. NaN if a term is not finite. Allocates nothing.
    pub fn sum_lanes<const N: usize>(
        &self,
        count: usize,
        terms: impl Iterator<Item = [f64; N]> + Clone,
    ) -> [f64; N] {
        let mut bounds = [0.0f64; N];
        for term in terms.clone() {
            for (bound, x) in bounds.iter_mut().zip(term) {
                *bound = larger(*bound, x.abs());
            }
        }
        self.max_into(&mut bounds);
        let fixed = bounds.map(|bound| FixedPoint::new(finite(bound), count));
        // Terms without a finite bound have no integers.
        let known = |term: [f64; N]| -> [f64; N] {
            std::array::from_fn(|l| if bounds[l].is_finite() { term[l] } else { 0.0 })
        };
        let sums = self.fixed_sums(fixed, terms.map(known));
        std::array::from_fn(|l| if bounds[l].is_finite() { sums[l] } else { f64::NAN })
    }

    /// Sums of terms by the part that each belongs to, of `parts` parts with at most `count` terms
    /// in all. Their bounds are found first. NaN if a term of the part is not finite. Collective.
    pub fn sum_by_part(
        &self,
        count: usize,
        parts: usize,
        terms: impl Iterator<Item = (usize, f64)> + Clone,
    ) -> Vec<f64> {
        let mut bounds = vec![0.0f64; parts];
        for (part, x) in terms.clone() {
            bounds[part] = larger(bounds[part], x.abs());
        }
        self.max_into(&mut bounds);
        let fixed: Vec<FixedPoint> =
            bounds.iter().map(|b| FixedPoint::new(finite(*b), count)).collect();
        let mut totals = vec![[0i64; 2]; parts];
        for (part, x) in terms.filter(|(part, _)| bounds[*part].is_finite()) {
            let [coarse, fine] = fixed[part].split(x);
            totals[part] = [totals[part][0] + coarse, totals[part][1] + fine];
        }
        self.sum_integers(totals.as_flattened_mut());
        let sum = |((fixed, total), bound): ((&FixedPoint, [i64; 2]), f64)| match bound.is_finite()
        {
            true => fixed.join(total),
            false => f64::NAN,
        };
        fixed.iter().zip(totals).zip(bounds).map(sum).collect()
    }

    /// Sum over the ranks of terms whose bound is not known beforehand: the largest is found first.
    pub fn sum_terms(&self, terms: &[f64]) -> f64 {
        let count = self.sum_count(terms.len());
        let [sum] = self.sum_lanes(count, terms.iter().map(|term| [*term]));
        sum
    }

    /// Does `work` on the first rank; the others get the default value, or its error. Collective.
    ///
    /// # Errors
    /// As `work`, the same on all ranks.
    pub fn on_first_rank<T: Default>(&self, work: impl FnOnce() -> Result<T>) -> Result<T> {
        self.agree(if self.is_first() { work() } else { Ok(T::default()) })
    }

    /// What `work` finds on the first rank, on every rank. Collective.
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
    fn split(&self, color: usize) -> Group {
        let part = self.communicator.split_by_color(Color::with_value(color as i32));
        Group { communicator: part.expect("a colour is given") }
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

/// A bound of which fixed-point numbers can be made: 0 in place of one that is not finite.
fn finite(bound: f64) -> f64 {
    if bound.is_finite() { bound } else { 0.0 }
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

/// The process mesh as communicators.
pub struct Communicator {
    /// All ranks.
    pub world: Group,
    /// The ranks that share this rank's modes and split space.
    pub space: Group,
    /// The ranks that share this rank's space block and split the modes.
    pub modes: Group,
}

impl Communicator {
    /// Splits `world` into the process mesh (see [`crate::parallel::partition`]).
    pub fn new(world: &World, mesh: &ProcessMesh) -> Self {
        let world = world.group();
        let rank = world.rank();
        Self {
            space: world.split(rank / mesh.blocks()),
            modes: world.split(rank % mesh.blocks()),
            world,
        }
    }
}

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
        Self {
            group: Group { communicator: space.communicator.duplicate() },
            neighbours,
            requests: Vec::with_capacity(pieces),
        }
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
    #[test]
    fn one_machine_is_recognised() {
        let ask = |set: &[(&str, &str)]| {
            on_one_machine(|name| {
                set.iter().find(|(key, _)| *key == name).map(|(_, value)| (*value).to_owned())
            })
        };
        let (all, here) = ("OMPI_COMM_WORLD_SIZE", "OMPI_COMM_WORLD_LOCAL_SIZE");
        assert!(ask(&[]), "no launcher");
        assert!(ask(&[("PMIX_RANK", "1"), (all, "3"), (here, "3")]));
        assert!(!ask(&[("PMIX_RANK", "1"), (all, "12"), (here, "3")]));
        // Slurm's launcher does not set Open MPI's variables: the ranks may be on any node.
        assert!(!ask(&[("PMIX_RANK", "1")]));
        assert!(!ask(&[("PMI_RANK", "0")]));
    }

    #[test]
    fn launchers_are_recognised() {
        let ask = |set: &str| has_launcher(|name| (name == set).then(|| "0".to_owned()));
        assert!(["OMPI_COMM_WORLD_SIZE", "PMIX_RANK", "PMI_RANK"].into_iter().all(ask));
        // A shell within a job of Slurm.
        assert!(!ask("SLURM_JOB_ID"));
    }
}
