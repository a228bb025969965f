//! A rank that is stopped (SIGSTOP) and never goes on ends the job; a job that is suspended as a
//! whole goes on.

use super::{Result, children, generations};
use crate::full::ALL;
use crate::launcher::send;
use crate::support::{
    Finished, Job, Stored, case, check_all, datasets, directory_on_disk as directory, equals_whole,
    nothing_unfinished,
};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::LazyLock;
use std::time::{Duration, Instant};

/// After so many seconds a stopped rank ends these jobs.
const BOUND: u64 = 2;
/// What mpirun and a busy machine may add to that.
const MORE: Duration = Duration::from_secs(20);

fn job(kind: &str) -> Job {
    let small = ["axis.0.x.cells=32", "axis.0.v.cells=24", "solver.warp.points=2048"];
    let settings = ["solver.tolerance=1e-3", "solver.warp.profile=exponential", ALL];
    let job = Job::new(["run", &case("example1.toml"), "--mode", kind]).set(&small).set(&settings);
    // Checkpoints are seen, and take little time.
    job.set(&["checkpoint.minutes=0.001"])
        .environment("PHASEWARP_STOPPED_SECONDS", &BOUND.to_string())
}

/// Runs a job; when it has a checkpoint, `meet` gets its ranks.
fn met(job: &Job, path: &Path, mut meet: impl FnMut(&[u32])) -> Result<Finished> {
    let mut is_met = false;
    let finished = job.clone().closely().into(path).run_while(|mpirun, _| {
        let ranks = children(mpirun.id());
        if !is_met && ranks.len() == job.ranks() && !generations(path).is_empty() {
            is_met = true;
            meet(&ranks);
        }
    })?;
    if is_met { Ok(finished) } else { Err(finished.report("over before there was a checkpoint")) }
}

#[test]
fn a_rank_that_is_stopped_for_ever_ends_the_job() {
    check_all(&[("streamed", 2, 0), ("full", 4, 2)], |&(kind, ranks, stopped)| {
        let place = directory();
        let path = place.path();
        let mut since = Instant::now();
        let finished = met(&job(kind).on(ranks), path, |ranks| {
            send("-STOP", ranks[stopped]);
            since = Instant::now();
        })?;
        let took = since.elapsed();
        let said = (finished.errors.clone() + &finished.others).matches("was stopped by a").count();
        if finished.code == Some(0) || said != 1 {
            return Err(finished.report("an error and one message expected"));
        }
        if took > Duration::from_secs(BOUND) + MORE {
            return Err(finished.report(&format!("ended {took:?} after a rank was stopped")));
        }
        job(kind).on(5 - ranks).with(["--resume"]).into(path).succeed()?;
        same(path)
    });
}

/// Also where the ranks go on one after the other.
#[test]
fn a_job_that_is_suspended_as_a_whole_goes_on() {
    check_all(&[("streamed", 3), ("full", 2)], |&(kind, ranks)| {
        let place = directory();
        let finished = met(&job(kind).on(ranks), place.path(), |ranks| {
            ranks.iter().for_each(|&rank| send("-STOP", rank));
            std::thread::sleep(Duration::from_secs(BOUND + 2));
            for &rank in ranks {
                send("-CONT", rank);
                std::thread::sleep(Duration::from_millis(100));
            }
        })?;
        if finished.code != Some(0) {
            return Err(finished.report("goes on"));
        }
        same(place.path())
    });
}

/// A number that is none is said.
#[test]
fn a_bound_that_is_no_number_is_said() {
    let job = Job::new(["check", &case("example1.toml")]).on(2);
    let finished = job.environment("PHASEWARP_STOPPED_SECONDS", "1m").succeed().expect("an end");
    finished.contains(&finished.errors, &["PHASEWARP_STOPPED_SECONDS=1m", "60"]).unwrap();
}

/// The datasets of an undisturbed run, which do not depend on its kind.
static WHOLE: LazyLock<BTreeMap<String, Stored>> = LazyLock::new(|| {
    let place = directory();
    job("streamed").solve(place.path()).expect("a whole run");
    datasets(place.path()).expect("datasets")
});

/// The bits of a whole run, and nothing that a run leaves unfinished.
fn same(path: &Path) -> Result<()> {
    // The plan has the kind of the run.
    equals_whole(path, &WHOLE, &["/plan"])?;
    nothing_unfinished(path)
}
