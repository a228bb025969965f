//! Controls: jobs that must fail, or be ended. A wrong expectation fails its job, and the harness
//! ends a job that hangs. Jobs whose ranks fail, stop or die are in `failing`.

use crate::dense_twins::Twin;
use crate::failing;
use crate::job::{CONTROL, Job, TIME_LIMIT, left_of, print_process, processes};
use crate::pieces::{Piece, meshes};
use crate::support::dense::assert_same;
use phasewarp::parallel::communicator::World;

/// Starts the job of a control. Returns whether it ended as it must, and its report.
type Control = fn() -> (bool, String);

/// The controls by name.
pub const CONTROLS: [(&str, Control); 9] = [
    ("control_wrong: a wrong expectation fails", wrong),
    ("control_hang: a job that hangs is ended", hang),
    ("control_options: options do not select checks", options),
    ("deadline_met: work in time is not ended", failing::in_time),
    ("deadline_off: a deadline of 0 seconds ends nothing", failing::without_deadline),
    ("deadline_missed: all ranks wait", failing::late),
    ("deadline_of_an_error: other ranks wait", failing::alone),
    ("killed_rank: the job ends", failing::killed),
    ("stopped_rank: the job ends", failing::stopped),
];

/// Runs the part of a rank in the control `name`.
pub fn run(name: &str, world: &World) {
    match name {
        "wrong" => rank_with_a_wrong_expectation(world),
        "hang" => rank_that_hangs(world),
        other => failing::run(other, world),
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
    let outcome = Job::start(2, &[(CONTROL, "wrong")], &[]).outcome(|_| false);
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
    let job = Job::start(2, &[(CONTROL, "hang")], &[]);
    let outcome = job.outcome(|text| processes(text).len() == 2);
    let started = processes(&outcome.stdout);
    let left = left_of(&started);
    let ended = outcome.status.is_none() && started.len() == 2 && left.is_empty();
    let reason = format!("of {started:?} remain {left:?}\n{}", outcome.report());
    (ended, reason)
}

/// Rank 1 sleeps longer than the harness waits, so that no barrier is passed.
fn rank_that_hangs(world: &World) {
    print_process(world.group().rank());
    if world.group().rank() == 1 {
        std::thread::sleep(2 * TIME_LIMIT);
    }
}
