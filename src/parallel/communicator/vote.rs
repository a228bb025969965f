//! A nonblocking vote: the outcome is the bitwise or over the ranks.
//!
//! Every rank posts the same number of votes, each at its own time, and polls for the outcome,
//! which is known once all ranks have posted. So ranks of different speeds exchange requests
//! without waiting.

use crate::parallel::group::Group;
use mpi::collective::SystemOperation;
use mpi::ffi;
use mpi::traits::*;

/// The votes of a group, one after the other.
pub struct Vote {
    /// A duplicate communicator: other collectives may run in between.
    group: Group,
    /// The value that this rank posted, and the outcome. MPI owns both between `post` and the end
    /// of the vote.
    ballots: Box<[u64; 2]>,
    request: ffi::MPI_Request,
    posted: bool,
}

impl Vote {
    /// Votes of the ranks of `group`. Collective.
    pub fn new(group: &Group) -> Self {
        Self {
            group: group.duplicate(),
            ballots: Box::default(),
            // SAFETY: a constant of the library, which is never written.
            request: unsafe { ffi::RSMPI_REQUEST_NULL },
            posted: false,
        }
    }

    /// Whether this rank has posted a vote whose outcome it has not taken.
    pub fn is_posted(&self) -> bool {
        self.posted
    }

    /// Posts this rank's bits for the next vote, after the outcome of the last one was taken.
    pub fn post(&mut self, bits: u64) {
        assert!(!self.posted, "one vote at a time");
        self.ballots[0] = bits;
        self.posted = true;
        let ballots = self.ballots.as_mut_ptr();
        // SAFETY: both numbers are on the heap. Nobody touches them until `take` has waited for the
        // request: another `post` is refused before, and `drop` leaves them to MPI.
        unsafe {
            ffi::MPI_Iallreduce(
                ballots.cast(),
                ballots.add(1).cast(),
                1,
                ffi::RSMPI_UINT64_T,
                SystemOperation::bitwise_or().as_raw(),
                self.group.communicator.as_raw(),
                &mut self.request,
            );
        }
    }

    /// Whether the outcome is known.
    pub fn is_over(&mut self) -> bool {
        let mut over = 0;
        // SAFETY: the request was made by `post`, or is the null request, which is over.
        unsafe { ffi::MPI_Test(&mut self.request, &mut over, ffi::RSMPI_STATUS_IGNORE) };
        over != 0
    }

    /// Waits for the outcome and returns it.
    pub fn take(&mut self) -> u64 {
        // SAFETY: as in `is_over`.
        unsafe { ffi::MPI_Wait(&mut self.request, ffi::RSMPI_STATUS_IGNORE) };
        self.posted = false;
        self.ballots[1]
    }
}

impl Drop for Vote {
    /// Does not free numbers that MPI may still use.
    fn drop(&mut self) {
        debug_assert!(!self.posted, "a vote's outcome was not taken");
        if self.posted {
            std::mem::forget(std::mem::take(&mut self.ballots));
        }
    }
}
