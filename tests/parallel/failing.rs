//! Jobs whose ranks fail alone, are late, are stopped or are killed: they end in a bounded time,
//! with one message.

use crate::job::{CONTROL, Job, Outcome, left_of, print_process, processes};
use crate::support::launcher::send;
use phasewarp::base::error::{Error, Result};
use phasewarp::parallel::communicator::World;
use std::thread::sleep;
use std::time::{Duration, Instant};

/// Seconds after which a rank that waits or is stopped ends these jobs.
const BOUND: &str = "1";
/// Longer than that.
const LONGER: Duration = Duration::from_secs(3);
/// Longer than a job may take.
const FOR_EVER: Duration = Duration::from_secs(120);
/// What a busy machine and a launcher may add to the bound.
const MORE: Duration = Duration::from_secs(30);

/// Runs the part of a rank in the job `name`.
pub fn run(name: &str, world: &World) {
    match name {
        "in time" => rank_in_time(world),
        "late" => rank_that_waits(world),
        "alone" => rank_whose_partner_fails(world),
        "interrupted" => rank_that_is_interrupted(world),
        other => panic!("no such control: {other}"),
    }
}

fn start(name: &str, bound: &str) -> Job {
    let environment = [(CONTROL, name), ("PHASEWARP_STOPPED_SECONDS", bound)];
    Job::start(2, &environment, &[])
}

/// What the work of a rank is late with.
fn late_error() -> Error {
    Error::Ranks("the work takes too long".to_owned())
}

/// How often the job wrote `text`.
fn count(outcome: &Outcome, text: &str) -> usize {
    [&outcome.stdout, &outcome.stderr].map(|written| written.matches(text).count()).iter().sum()
}

/// Work that ends in time, well or with an error of one rank, is not ended, nor is what follows.
pub fn in_time() -> (bool, String) {
    let outcome = start("in time", BOUND).outcome(|_| false);
    let passed = outcome.success() && count(&outcome, "passed in time") == 1;
    (passed && count(&outcome, "error") == 0, outcome.report())
}

fn rank_in_time(world: &World) {
    let group = world.group();
    let rank = group.rank();
    assert_eq!(group.in_time(&late_error(), || Ok(rank)).expect("no rank fails"), rank);
    let work = || match rank {
        0 => Ok(()),
        _ => Err(Error::NotFinite("of rank 1".to_owned())),
    };
    let error = group.in_time(&late_error(), work).expect_err("rank 1 fails");
    assert!(error.to_string().contains("of rank 1"), "{error}");
    sleep(LONGER);
    group.barrier();
    if rank == 0 {
        println!("passed in time");
    }
}

/// A bound of 0 seconds means never.
pub fn without_deadline() -> (bool, String) {
    let mut since = Instant::now();
    let outcome = start("late", "0").outcome(|text| {
        if processes(text).len() < 2 {
            since = Instant::now();
        }
        since.elapsed() > LONGER
    });
    // The harness ended it.
    (outcome.status.is_none() && count(&outcome, "too long") == 0, outcome.report())
}

/// If all ranks wait within the work, one ends the job.
pub fn late() -> (bool, String) {
    ends("late", |_| {}, "error: the work takes too long", Some(1))
}

fn rank_that_waits(world: &World) {
    print_process(world.group().rank());
    let waits = || -> Result<()> {
        sleep(FOR_EVER);
        Ok(())
    };
    let _ = world.group().in_time(&late_error(), waits);
}

/// If one rank fails and the other waits, the one that fails ends the job with its error.
pub fn alone() -> (bool, String) {
    ends("alone", |_| {}, "of rank 1", Some(1))
}

fn rank_whose_partner_fails(world: &World) {
    print_process(world.group().rank());
    if world.group().rank() == 0 {
        sleep(FOR_EVER);
    }
    let failed: Result<()> = Err(Error::NotFinite("of rank 1".to_owned()));
    let _ = world.group().agree_in_time(failed);
}

/// SIGKILL of a rank: the launcher ends the job.
pub fn killed() -> (bool, String) {
    ends("interrupted", |process| send("-KILL", process), "signal 9", None)
}

/// SIGSTOP of a rank: another one ends the job.
pub fn stopped() -> (bool, String) {
    ends("interrupted", |process| send("-STOP", process), "was stopped by a signal", None)
}

/// The last rank is at work, and the others wait for it.
fn rank_that_is_interrupted(world: &World) {
    print_process(world.group().rank());
    if world.group().rank() == 1 {
        sleep(FOR_EVER);
    }
    world.group().barrier();
}

/// Whether a job ends by itself in time, with an error and one `message`, and leaves no process,
/// after `harm` was done to its last rank.
fn ends(name: &str, harm: impl Fn(u32), message: &str, code: Option<i32>) -> (bool, String) {
    let mut met = None;
    let outcome = start(name, BOUND).outcome(|text| {
        if let ([_, (_, process)], None) = (&processes(text)[..], met) {
            met = Some(Instant::now());
            harm(*process);
        }
        false
    });
    let took = met.map(|met| met.elapsed());
    let left = left_of(&processes(&outcome.stdout));
    let ended = outcome.status.and_then(|status| status.code());
    let failed = !outcome.success() && code.is_none_or(|code| ended == Some(code));
    let said = count(&outcome, message);
    let good = failed && said == 1 && left.is_empty() && took.is_some_and(|took| took < MORE);
    let report = outcome.report();
    (good, format!("after {took:?}, {message:?} {said} times, {left:?} remain\n{report}"))
}
