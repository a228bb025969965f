//! Stop signals that come when the modes are finished: while the error is measured, and while
//! results are written. The run ends as if there had been none.

use super::{Result, children};
use crate::launcher::send;
use crate::support::{
    Finished, Job, Stored, case, check_all, datasets, directory_on_disk as directory, equals_whole,
    holds, nothing_unfinished, on_results,
};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::LazyLock;
use std::time::Duration;

/// Measuring the error takes longer than the modes, as the inflow depends on time.
fn job() -> Job {
    let grid = ["axis.0.x.cells=60", "axis.0.v.cells=60", "exact={f='0'}"];
    let settings = ["solver.tolerance=0.1", "solver.verify=true"];
    Job::new(["run", &case("pulsed_inflow.toml")]).set(&grid).set(&settings)
}

/// An undisturbed run: its datasets, and the seconds from its start to the end of the modes and to
/// the end of measuring the error.
static WHOLE: LazyLock<(BTreeMap<String, Stored>, [f64; 2])> = LazyLock::new(|| {
    let place = directory();
    let summary = job().solve(place.path()).expect("a whole run");
    let lap = |name: &str| summary.value["seconds"][name].as_f64().unwrap_or(0.0);
    let before = summary.value["wall_seconds"].as_f64().expect("seconds");
    let end = before - lap("write") - lap("observables");
    (datasets(place.path()).expect("datasets"), [end - lap("verify"), end])
});

/// Sends a signal once, when `now` says so, to a process without mpirun, to mpirun, or to a rank.
fn signalled(
    job: &Job,
    path: &Path,
    (signal, to_rank): (&str, bool),
    mut now: impl FnMut(Duration) -> bool,
) -> Result<(Finished, bool)> {
    let mut sent = false;
    let finished = job.clone().closely().into(path).run_while(|process, since| {
        if !sent && now(since) {
            sent = true;
            let ranks = children(process.id());
            let rank = ranks.last().copied().filter(|_| to_rank);
            send(signal, rank.unwrap_or(process.id()));
        }
    })?;
    Ok((finished, sent))
}

/// It ended well, with the bits of the whole run and nothing unfinished.
fn ended_well(finished: &Finished, path: &Path) -> Result<()> {
    if finished.code != Some(0) {
        return Err(finished.report("exit code 0 expected"));
    }
    let as_whole = equals_whole(path, &WHOLE.0, &[]).and_then(|()| nothing_unfinished(path));
    as_whole.map_err(|what| finished.report(&what))?;
    on_results("check-result", path).succeed().map(drop)
}

#[test]
fn signals_while_the_error_is_measured_change_nothing() {
    let [modes, measured] = WHOLE.1;
    // Halves the time in which the error is measured: a signal that comes while the modes are
    // solved ends the run with a checkpoint, one that comes later meets the results. All signals
    // have the same handler.
    let all = (0.3 * modes, 3.0 * measured);
    let (mut low, mut high) = all;
    let mut middle = 0.5 * (modes + measured);
    for _ in 0..40 {
        let place = directory();
        let path = place.path();
        let mut is_late = false;
        let (finished, sent) = signalled(&job(), path, ("-TERM", false), |since| {
            let now = since.as_secs_f64() >= middle;
            is_late = holds(path, ".partial") || holds(path, "result.h5");
            now
        })
        .expect("an end");
        match finished.code {
            Some(75) | None => low = middle,
            _ if is_late || !sent => high = middle,
            _ => return ended_well(&finished, path).unwrap(),
        }
        // Runs on a busy machine differ: after a wrong turn from the beginning.
        if high - low < 0.02 {
            (low, high) = all;
        }
        middle = 0.5 * (low + high);
    }
    panic!("no signal came while the error was measured");
}

#[test]
fn signals_while_results_are_written_change_nothing() {
    let rows = [(1, "-INT", true), (1, "-USR1", true), (2, "-USR1", false), (3, "-TERM", true)];
    check_all(&rows, |&(ranks, signal, to_rank)| {
        // Files may be there too shortly to be seen.
        for _ in 0..25 {
            let place = directory();
            let path = place.path();
            let job = if ranks == 1 { job() } else { job().on(ranks) };
            let (finished, sent) =
                signalled(&job, path, (signal, to_rank && ranks > 1), |_| holds(path, ".partial"))?;
            if sent {
                return ended_well(&finished, path);
            }
        }
        Err(format!("{signal}: no signal came while results were written"))
    });
}
