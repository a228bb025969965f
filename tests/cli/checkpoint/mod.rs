//! Runs that are stopped and continued: after any fault, the result has the bits of an undisturbed
//! run.

mod damaged;
mod late;
mod stalled;
mod stopped;

use crate::launcher::send;
use crate::support::{
    Finished, Job, Stored, Summary, datasets, directory_on_disk as directory, equals_whole,
    json_of, nothing_unfinished, of_case,
};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// Settings of a run of more than half a second on two ranks, with 129 batches of modes.
const LONG: [&str; 5] = [
    "solver.tolerance=1e-3",
    "solver.warp.profile=exponential",
    "solver.warp.points=2048",
    "axis.0.x.cells=32",
    "axis.0.v.cells=24",
];

/// A checkpoint after nearly every batch.
pub const OFTEN: &str = "checkpoint.minutes=0.00001";

/// A result whose error is a message.
pub type Result<T> = std::result::Result<T, String>;

pub fn run() -> Job {
    of_case("run", "example1.toml").set(&LONG)
}

/// The datasets of an undisturbed run and its number of applications of the matrix.
pub static WHOLE: LazyLock<(BTreeMap<String, Stored>, usize)> = LazyLock::new(|| {
    let whole = directory();
    let summary = run().on(2).solve(whole.path()).expect("a whole run");
    let matvecs = count(&summary, "matvecs").expect("matvecs");
    assert_eq!(count(&summary, "matvecs_here"), Ok(matvecs));
    assert_eq!(summary.boolean("resumed"), Ok(false));
    assert_eq!(count(&summary, "checkpoints"), Ok(0));
    (datasets(whole.path()).expect("datasets"), matvecs)
});

pub fn count(summary: &Summary, key: &str) -> Result<usize> {
    summary.number(key).map(|n| n as usize)
}

pub fn io<T>(result: std::io::Result<T>) -> Result<T> {
    result.map_err(|e| e.to_string())
}

/// Continues the run in `directory` to its end. The result must have the bits of the undisturbed
/// run, and no application of the matrix that the checkpoint holds may be repeated.
pub fn ends_well(job: Job, directory: &Path) -> Result<Summary> {
    let done = match newest(directory) {
        Some(newest) => manifest(&newest)?["matvecs"].as_u64().unwrap_or(0) as usize,
        None => 0,
    };
    let summary = job.with(["--resume"]).solve(directory)?;
    same(directory, &summary)?;
    let (here, all) = (count(&summary, "matvecs_here")?, WHOLE.1);
    summary.require(here + done == all, || {
        format!("{done} applications in the checkpoint and {here} after it are not {all}")
    })?;
    summary.holds(nothing_unfinished(directory))?;
    Ok(summary)
}

/// Checks that the results have the bits of the undisturbed run.
pub fn same(directory: &Path, summary: &Summary) -> Result<()> {
    summary.holds(equals_whole(directory, &WHOLE.0, &[]))?;
    let (found, expected) = (count(summary, "matvecs")?, WHOLE.1);
    summary
        .require(found == expected, || format!("{found} applications, {expected} in the whole run"))
}

/// The complete generations of checkpoints in `directory`, the newest first.
pub fn generations(directory: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(directory.join("checkpoint"));
    let mut found: Vec<PathBuf> = (entries.into_iter().flatten().flatten())
        .map(|entry| entry.path())
        .filter(|path| path.join("manifest.json").exists())
        .collect();
    found.sort();
    found.reverse();
    found
}

pub fn newest(directory: &Path) -> Option<PathBuf> {
    generations(directory).into_iter().next()
}

pub fn manifest(generation: &Path) -> Result<Value> {
    Ok(json_of(generation.join("manifest.json"))?["manifest"].clone())
}

/// The processes that `parent` started. MPICH's launcher starts its ranks by a proxy, which is a
/// copy of the launcher at first.
pub fn children(parent: u32) -> Vec<u32> {
    let path = format!("/proc/{parent}/task/{parent}/children");
    let text = fs::read_to_string(path).unwrap_or_default();
    let started = text.split_whitespace().filter_map(|id| id.parse().ok());
    let name = |id: u32| fs::read_to_string(format!("/proc/{id}/comm")).unwrap_or_default();
    let ranks = |id| match name(id).trim() {
        "hydra_pmi_proxy" => children(id),
        "mpirun.mpich" => Vec::new(),
        _ => vec![id],
    };
    started.flat_map(ranks).collect()
}

fn is_alive(process: u32) -> bool {
    // A zombie counts as ended.
    let text = fs::read_to_string(format!("/proc/{process}/stat")).unwrap_or_default();
    !text.is_empty() && !text.contains(") Z")
}

/// A fault that is injected into a run.
#[derive(Clone, Copy, Debug)]
pub enum Fault {
    /// SIGKILL of this rank.
    Rank(usize),
    /// SIGKILL of mpirun.
    Launcher,
    /// SIGUSR1 to mpirun.
    Signal,
    /// SIGTERM to mpirun.
    Terminate,
    /// SIGINT to mpirun.
    Interrupt,
    /// This signal to this rank.
    Send(&'static str, usize),
    /// SIGSTOP of this rank, and SIGCONT half a second later.
    Pause(usize),
}

/// Whether a process is the program and has already installed its handlers of stop signals.
pub fn takes_requests(process: u32) -> bool {
    let text = fs::read_to_string(format!("/proc/{process}/status")).unwrap_or_default();
    // Before it starts the program, the process is a copy of mpirun.
    if !text.starts_with("Name:\tphasewarp\n") {
        return false;
    }
    let caught = text.lines().find_map(|line| line.strip_prefix("SigCgt:"));
    let caught = caught.and_then(|bits| u64::from_str_radix(bits.trim(), 16).ok()).unwrap_or(0);
    [libc::SIGUSR1, libc::SIGTERM, libc::SIGINT]
        .iter()
        .all(|signal| caught >> (signal - 1) & 1 == 1)
}

/// The end of a run with a fault.
pub struct Faulty {
    pub finished: Finished,
    /// Whether the fault came before the run was over.
    pub injected: bool,
    /// Whether all ranks had installed their signal handlers when the fault came.
    pub begun: bool,
    /// Whether mpirun did not end after its ranks and was killed.
    pub hung: bool,
}

/// Time that mpirun may take to end after its ranks.
const AFTER_RANKS: Duration = Duration::from_secs(20);

/// Runs a job and injects a fault at the first moment that `now` accepts. Returns after all ranks
/// have ended.
pub fn with_fault(job: &Job, fault: Fault, now: impl FnMut(Duration) -> bool) -> Result<Finished> {
    inject(job, fault, now).map(|faulty| faulty.finished)
}

/// The same, with the state of the run at the fault.
pub fn inject(job: &Job, fault: Fault, mut now: impl FnMut(Duration) -> bool) -> Result<Faulty> {
    let (mut ranks, mut injected, mut begun) = (Vec::new(), false, false);
    let (mut alone, mut hung) = (None, false);
    let finished = job.clone().closely().run_while(|mpirun, since| {
        if injected {
            if children(mpirun.id()).into_iter().any(is_alive) {
                alone = None;
            } else if since > *alone.get_or_insert(since) + AFTER_RANKS && !hung {
                hung = true;
                send("-KILL", mpirun.id());
            }
            return;
        }
        ranks = children(mpirun.id());
        if ranks.is_empty() || !now(since) {
            return;
        }
        injected = true;
        begun = ranks.len() == job.ranks() && ranks.iter().all(|&rank| takes_requests(rank));
        let of = |rank: usize| ranks[rank.min(ranks.len() - 1)];
        match fault {
            Fault::Rank(rank) => send("-KILL", of(rank)),
            Fault::Launcher => send("-KILL", mpirun.id()),
            Fault::Signal => send("-USR1", mpirun.id()),
            Fault::Terminate => send("-TERM", mpirun.id()),
            Fault::Interrupt => send("-INT", mpirun.id()),
            Fault::Send(signal, rank) => send(signal, of(rank)),
            Fault::Pause(rank) => {
                send("-STOP", of(rank));
                std::thread::sleep(Duration::from_millis(500));
                send("-CONT", of(rank));
            }
        }
    })?;
    // Ranks whose mpirun is gone end by themselves a moment later.
    let waiting = Instant::now();
    while ranks.iter().any(|&rank| is_alive(rank)) {
        if waiting.elapsed() > Duration::from_secs(20) {
            return Err(finished.report("ranks outlive mpirun by 20 s"));
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    Ok(Faulty { finished, injected, begun, hung })
}

/// Starts a run with checkpoints and stops it by SIGUSR1 after the second one.
pub fn stopped(ranks: usize) -> Result<TempDir> {
    let directory = directory();
    let path = directory.path();
    let job = run().on(ranks).set(&[OFTEN]).into(path);
    let finished = with_fault(&job, Fault::Signal, |_| generations(path).len() == 2)?;
    if finished.code == Some(75) && finished.errors.contains("--resume") {
        Ok(directory)
    } else {
        Err(finished.report("exit code 75 and the option --resume expected"))
    }
}
