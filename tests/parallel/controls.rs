//! Controls of the harness: a wrong expectation fails its job, and a job that hangs is ended.

use crate::dense_twins::Twin;
use crate::job::{Job, TIME_LIMIT};
use crate::pieces::{Piece, meshes};
use crate::support::dense::assert_same;
use phasewarp::parallel::communicator::World;
use std::process::{Command, Stdio};
use std::time::Duration;

/// Starts the job of a control. Returns whether the harness found the fault, and the report of the
/// job.
type Control = fn() -> (bool, String);

/// The controls by name.
pub const CONTROLS: [(&str, Control); 3] = [
    ("control_wrong: a wrong expectation fails", wrong),
    ("control_hang: a job that hangs is ended", hang),
    ("control_options: options do not select checks", options),
];

/// Runs the part of a rank in the control `name`.
pub fn run(name: &str, world: &World) {
    match name {
        "wrong" => rank_with_a_wrong_expectation(world),
        "hang" => rank_that_hangs(world),
        other => panic!("no such control: {other}"),
    }
}

/// Options of Rust's own harness and their values do not select checks.
fn options() -> (bool, String) {
    let given = ["--test-threads", "2", "adjoint", "--nocapture", "--color=never", "votes"];
    let found = crate::parts_of_names(given.iter().map(|word| (*word).to_owned()));
    (found == ["adjoint", "votes"], format!("{found:?}"))
}

/// The right comparison passes. The wrong one names the entry and fails the job.
fn wrong() -> (bool, String) {
    let outcome = Job::start(2, Some("wrong"), &[]).outcome(|_| false);
    let (out, err) = (&outcome.stdout, &outcome.stderr);
    let noticed = outcome.status.is_some_and(|s| !s.success())
        && out.contains("passed the right expectation")
        && err.contains("the wrong expectation: entry (1, 2) is ")
        && !out.contains("passed the wrong expectation");
    (noticed, outcome.report())
}

/// Compares a distributed matrix with its dense twin, then with a copy that has one changed entry.
fn rank_with_a_wrong_expectation(world: &World) {
    let twin = Twin::all().swap_remove(0);
    let is_first = world.group().rank() == 0;
    for mesh in meshes(world, &twin.case) {
        let piece = Piece::assemble(world, &twin, &mesh);
        let (found, _) = piece.gather_matrix(world, &twin);
        let mut expected = twin.generator.symmetric();
        assert_same("the right expectation", &found, &expected, 0.0);
        if is_first {
            println!("passed the right expectation");
        }
        expected.add(1, 2, 1e-9);
        assert_same("the wrong expectation", &found, &expected, 1e-10);
        if is_first {
            println!("passed the wrong expectation");
        }
    }
}

/// The job is ended, and none of its processes remains.
fn hang() -> (bool, String) {
    let processes = |text: &str| -> Vec<u32> {
        (text.lines())
            .filter_map(|line| line.strip_prefix("process ")?.trim().parse().ok())
            .collect()
    };
    let outcome = Job::start(2, Some("hang"), &[]).outcome(|text| processes(text).len() == 2);
    let started = processes(&outcome.stdout);
    let mut left = started.clone();
    for _ in 0..100 {
        left.retain(|&process| exists(process));
        if left.is_empty() {
            break;
        }
        std::thread::sleep(Duration::from_millis(100));
    }
    let ended = outcome.status.is_none() && started.len() == 2 && left.is_empty();
    let reason = format!("of {started:?} remain {left:?}\n{}", outcome.report());
    (ended, reason)
}

/// Whether a process exists; signal 0 only checks this.
fn exists(process: u32) -> bool {
    let mut kill = Command::new("kill");
    kill.args(["-0", &process.to_string()]).stderr(Stdio::null());
    kill.status().is_ok_and(|status| status.success())
}

/// Rank 1 sleeps longer than the harness waits, so that no barrier is passed.
fn rank_that_hangs(world: &World) {
    println!("process {}", std::process::id());
    if world.group().rank() == 1 {
        std::thread::sleep(2 * TIME_LIMIT);
    }
}
