//! A watch on ranks that were stopped for ever (SIGSTOP): MPI waits for them without end.
//!
//! The ranks of a node watch each other in a ring, each the next one. A thread looks at the next
//! rank's state once a second, and counts how often in succession it finds it stopped. It counts
//! its own looks and no time: where the whole job is suspended (by Slurm, by a checkpoint of the
//! machine), the watch is suspended with it. A rank that a debugger holds is in another state.

use crate::base::log::eprint_wrapped;
use mpi::topology::SimpleCommunicator;
use mpi::traits::*;
use rustix::process::{Pid, Signal, kill_process};
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{Builder, JoinHandle, park_timeout, sleep};
use std::time::Duration;

/// Variable of the environment: the number of seconds after which a stopped rank ends the job; with
/// 0 it never does.
const TIMEOUT_VARIABLE: &str = "PHASEWARP_STOPPED_SECONDS";
/// The value of that variable where it is not set.
pub(crate) const USUAL_CHECKS: u32 = 60;
/// Time between two looks.
pub(crate) const PAUSE: Duration = Duration::from_secs(1);
/// How long a launcher may take to end a job of which a rank was killed.
const LAUNCHER: Duration = Duration::from_secs(10);
/// Far more than the thread needs; what it does not touch takes no memory.
pub(crate) const STACK: usize = 256 << 10;

/// The thread that watches another rank, until dropped.
pub(crate) struct RankWatch {
    thread: JoinHandle<()>,
    is_over: Arc<AtomicBool>,
}

impl RankWatch {
    /// Watches the next rank of this node. None where there is no other, where the system does not
    /// tell, or the user wants none. Collective over `world`, of all ranks.
    pub(crate) fn start(world: &SimpleCommunicator) -> Option<Self> {
        let rank = world.rank();
        let checks = checks().unwrap_or_else(|value| {
            if rank == 0 {
                eprint_wrapped(&format!(
                    "warning: {TIMEOUT_VARIABLE}={value} is not a number of seconds (0 or more, 0: \
                     never); using {USUAL_CHECKS}"
                ));
            }
            USUAL_CHECKS
        });
        let node = world.split_shared(rank);
        let mine = [u64::from(std::process::id()), own_start(), rank as u64];
        let mut all = vec![0u64; mine.len() * node.size() as usize];
        node.all_gather_into(&mine[..], &mut all[..]);
        let next = (node.rank() as usize + 1) % node.size() as usize;
        let &[id, start, rank] = all.chunks_exact(mine.len()).nth(next)? else { return None };
        if checks == 0 || id == mine[0] {
            return None;
        }
        let watched = WatchedRank {
            rank,
            id: Pid::from_raw(i32::try_from(id).ok()?)?,
            stat: File::open(format!("/proc/{id}/stat")).ok()?,
            checks,
        };
        // The number is that of another process where each rank has its own process table.
        if start == 0 || watched.look()?.start != start {
            return None;
        }
        let is_over = Arc::new(AtomicBool::new(false));
        let over = Arc::clone(&is_over);
        let thread = Builder::new().stack_size(STACK).spawn(move || watched.watch(&over));
        Some(Self { thread: thread.ok()?, is_over })
    }
}

impl Drop for RankWatch {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
        self.thread.thread().unpark();
    }
}

/// Whether MPI is between its start and its end.
pub(crate) fn is_running() -> bool {
    mpi::environment::is_initialized() && !mpi::environment::is_finalized()
}

/// Ends the job with exit code 1. Threads beside the first call MPI only for this, to ask whether
/// it is running, and, when one panics, for its rank.
///
/// MPI is started with the thread level `single`, as all else is called by one thread. At that
/// level the standard permits no such call from a second thread, and Open MPI leaves out locks. It
/// carries the call out all the same; at worst the call disturbs the first thread within MPI, whose
/// work no longer counts because the process is ending. There is no other way: the first thread
/// waits within a library and does not return. With a library that does not carry the call out, the
/// job waits as it would without it.
pub(crate) fn abort_job() {
    SimpleCommunicator::world().abort(1);
}

/// The number that [`TIMEOUT_VARIABLE`] gives; the error is a text that is none.
pub(crate) fn checks() -> Result<u32, String> {
    let Some(value) = std::env::var_os(TIMEOUT_VARIABLE) else { return Ok(USUAL_CHECKS) };
    let number = value.to_str().and_then(|text| text.parse().ok());
    number.ok_or_else(|| value.display().to_string())
}

/// The start of this process, as [`ProcessState::start`]; 0 if unknown.
fn own_start() -> u64 {
    let look = File::open("/proc/self/stat").ok().and_then(|stat| ProcessState::at(&stat));
    look.map_or(0, |look| look.start)
}

/// What the system says of a process.
#[derive(Debug, PartialEq, Eq)]
struct ProcessState {
    /// `T` where a signal stopped it.
    state: u8,
    /// When it started, in the system's ticks. With its number it names one process of a machine.
    start: u64,
}

impl ProcessState {
    /// Reads `/proc/…/stat`; none of a process that has ended. Allocates nothing.
    fn at(stat: &File) -> Option<Self> {
        let mut text = [0; 1024];
        let length = stat.read_at(&mut text, 0).ok()?;
        Self::parse(&text[..length])
    }

    /// As in `12 (name) T 1 …`, where the name may be anything.
    fn parse(text: &[u8]) -> Option<Self> {
        let name_end = text.iter().rposition(|&byte| byte == b')')?;
        let mut fields = text.get(name_end + 2..)?.split(|&byte| byte == b' ');
        let state = *fields.next()?.first()?;
        // The 22nd field of all; the state is the third.
        let start = std::str::from_utf8(fields.nth(22 - 4)?).ok()?.parse().ok()?;
        Some(Self { state, start })
    }
}

/// The rank that is watched.
struct WatchedRank {
    rank: u64,
    id: Pid,
    /// Open, so that it never shows another process of the same number.
    stat: File,
    /// Looks in succession that find it stopped before the job is ended.
    checks: u32,
}

impl WatchedRank {
    fn look(&self) -> Option<ProcessState> {
        ProcessState::at(&self.stat)
    }

    /// Returns when it is over, or the other process is. Allocates nothing until the job is ended.
    fn watch(&self, is_over: &AtomicBool) {
        let mut stopped = 0;
        while stopped < self.checks {
            park_timeout(PAUSE);
            if is_over.load(Ordering::Relaxed) {
                return;
            }
            match self.look() {
                Some(ProcessState { state: b'T', .. }) => stopped += 1,
                Some(_) => stopped = 0,
                None => return,
            }
        }
        self.end_job();
    }

    /// Launchers end a job of which a rank was killed. Where one does not, this rank ends it.
    fn end_job(&self) {
        eprint_wrapped(&format!(
            "phasewarp: rank {} (process {}) was stopped by a signal {} s ago; ending the job",
            self.rank,
            self.id.as_raw_nonzero(),
            self.checks
        ));
        let _ = kill_process(self.id, Signal::KILL);
        sleep(LAUNCHER);
        if is_running() {
            abort_job();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_state_is_read_whatever_the_name_is() {
        let rest = " T 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 777 20 21";
        let expected = ProcessState { state: b'T', start: 777 };
        for name in ["phasewarp", "a) R 1 2 (b", ") S"] {
            let text = format!("12 ({name}){rest}\n");
            assert_eq!(ProcessState::parse(text.as_bytes()).as_ref(), Some(&expected), "{text}");
        }
        assert_eq!(ProcessState::parse(b"12 (name"), None);
        assert_eq!(ProcessState::parse(b""), None);
    }

    /// A process of this test is stopped, goes on, and ends.
    #[test]
    fn a_process_is_seen_stopped_running_and_ended() {
        let mut child = std::process::Command::new("sleep").arg("60").spawn().expect("a process");
        let stat = File::open(format!("/proc/{}/stat", child.id())).expect("its state");
        let id = Pid::from_child(&child);
        let seen = |wanted: Option<u8>| {
            (0..500).any(|_| {
                sleep(Duration::from_millis(10));
                ProcessState::at(&stat).map(|look| look.state) == wanted
            })
        };
        kill_process(id, Signal::STOP).expect("a signal");
        assert!(seen(Some(b'T')), "{:?}", ProcessState::at(&stat));
        kill_process(id, Signal::CONT).expect("a signal");
        assert!(seen(Some(b'S')), "{:?}", ProcessState::at(&stat));
        child.kill().expect("a signal");
        child.wait().expect("an end");
        assert!(seen(None), "{:?}", ProcessState::at(&stat));
        assert!(own_start() > 0);
    }
}
