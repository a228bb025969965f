//! Ends a job whose ranks wait for ever within a library: for each other, or for one that failed.

use crate::base::error::{Error, Result};
use crate::base::log::eprint_wrapped;
use crate::parallel::communicator::watch::{PAUSE, STACK, USUAL_CHECKS, abort_job, checks};
use crate::parallel::group::Group;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread::Builder;

/// Reports `error` and ends the job with exit code 1, after as many seconds as a rank may be
/// stopped, unless what is returned is dropped before. The time in which the whole job is suspended
/// does not count. None where the user wants none.
fn deadline(error: &Error) -> Option<Sender<()>> {
    let message = format!("error: {error}");
    let checks = checks().unwrap_or(USUAL_CHECKS);
    let (open, closed) = channel::<()>();
    let wait = move || {
        for _ in 0..checks {
            if closed.recv_timeout(PAUSE) != Err(RecvTimeoutError::Timeout) {
                return;
            }
        }
        eprint_wrapped(&message);
        abort_job();
    };
    let thread = Builder::new().name("deadline".to_owned()).stack_size(STACK);
    (checks > 0 && thread.spawn(wait).is_ok()).then_some(open)
}

impl Group {
    /// Agrees on an outcome as [`agree`](Self::agree) does, for work that is collective within a
    /// library. If that fails on some ranks only, the others may wait within it for ever: then the
    /// job ends with the error.
    ///
    /// # Errors
    /// As [`agree`](Self::agree).
    pub fn agree_in_time<T>(&self, outcome: Result<T>) -> Result<T> {
        let open = outcome.as_ref().err().map(deadline);
        let agreed = self.agree(outcome);
        drop(open);
        agreed
    }

    /// Does `work`, which is collective within a library and takes little time, and agrees on its
    /// outcome. If it does not end, because all ranks wait within it, the job ends with the error
    /// `late`. Collective.
    ///
    /// # Errors
    /// As [`agree`](Self::agree).
    pub fn in_time<T>(&self, late: &Error, work: impl FnOnce() -> Result<T>) -> Result<T> {
        let open = (self.is_first()).then(|| deadline(late));
        let agreed = self.agree_in_time(work());
        drop(open);
        agreed
    }
}
