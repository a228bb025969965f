//! Everything that ranks do together, against dense twins, on 1 to 4 ranks and every process mesh they admit.
//!
//! Without MPI around it, this program starts itself under `mpirun -np 1`, `2`, `3` and `4`, counts what passed and
//! compares the bits of what should not depend on ranks. A check that fails panics, and a panic ends its whole job. Two
//! controls show that a wrong expectation and a job that hangs are noticed.

mod assembly;
mod classical;
mod dense_twins;
mod exchange;
mod propagators;
mod quantum;
mod recovery;
mod reductions;
#[path = "../support/mod.rs"]
mod support;
mod time_dependent;
mod warped;
mod weights;

use dense_twins::*;
use faer::linalg::solvers::Solve;
use faer::{Mat, Side};
use num_complex::Complex64;
use phasewarp::base::error::Error;
use phasewarp::base::progress::Progress;
use phasewarp::matrix::block_matrix::{BlockMatrix, Operator};
use phasewarp::matrix::blocking::{Blocking, BlockingShape, Steps};
use phasewarp::matrix::bounds::{Bounds, INFLOW_GROWTH};
use phasewarp::matrix::kernel;
use phasewarp::matrix::kernel::InstructionSet;
use phasewarp::matrix::lanes::{LANES, Lanes, StepConstants};
use phasewarp::matrix::observables::{MOMENTS, VelocityFactors};
use phasewarp::matrix::weights::Weights;
use phasewarp::parallel::communicator::vote::Vote;
use phasewarp::parallel::communicator::{Communicator, GhostExchange, Group, World};
use phasewarp::parallel::partition::{Block, LocalIndex, Mesh, split};
use phasewarp::plan::Plan;
use phasewarp::plan::balance::Batch;
use phasewarp::plan::layout::Resources;
use phasewarp::problem::case::{
    Case, Coefficients, Delta, Embedding, Integrator, Limiter, Method, OutputTime, ProfileChoice,
    Propagation, PropagatorMethod, RecoveryMethod, Shift,
};
use phasewarp::propagate::chebyshev::{Chebyshev, Interval, bessel_series};
use phasewarp::propagate::classical::{Classical, EXACT, duhamel_panels};
use phasewarp::propagate::implicit::Implicit;
use phasewarp::propagate::krylov::Krylov;
use phasewarp::propagate::limiter::{Reconstruction, longest_step};
use phasewarp::propagate::method::{
    BatchCoupling, BatchReport, BatchSpec, Evolution, Initial, Propagator,
};
use phasewarp::propagate::time_dependent_inflow;
use phasewarp::propagate::{Span, descriptor, propagator, work};
use phasewarp::schrodingerization::warp_plan::WarpPlan;
use phasewarp::solve::checkpoint::watch::{Standing, Times};
use phasewarp::solve::checkpoint::watch::{Verdict, Watch};
use phasewarp::solve::modes;
use phasewarp::solve::modes::{Besides, Leg, Task};
use phasewarp::solve::spectrum::{extremes, gershgorin};
use phasewarp::solve::sum::MomentsOf;
use phasewarp::solve::system::Problem;
use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::ops::Range;
use std::process::{Child, Command, ExitCode, ExitStatus, Stdio};
use std::time::{Duration, Instant};
use support::dense::{
    Dense, System, assert_close, assert_same, case, distance, evolve, exponential, noise, norm,
};
use support::limited::limited_right_hand_side;

/// Number of ranks a child is started on.
const RANKS: &str = "PHASEWARP_TEST_RANKS";
/// What a child does instead of the checks.
const CONTROL: &str = "PHASEWARP_TEST_CONTROL";
/// After this a job is ended.
const PATIENCE: Duration = Duration::from_secs(120);

type Check = fn(&World);

/// The checks, by name.
const CHECKS: [(&str, Check); 35] = [
    ("number_of_ranks", reductions::number_of_ranks),
    ("reductions", reductions::reductions),
    ("agreement_on_errors", reductions::agreement_on_errors),
    ("votes", reductions::votes),
    ("verdicts", reductions::verdicts),
    ("ghost_exchange", exchange::ghost_exchange),
    ("long_messages", exchange::long_messages),
    ("transpose_and_back", warped::transpose_and_back),
    ("oracles", quantum::oracles),
    ("sparsity", quantum::sparsity_counted),
    ("norm_of_the_state", quantum::norm_of_the_state),
    ("warped_file", warped::warped_file),
    ("warped_files_refused", warped::warped_files_refused),
    ("matrix_entry_for_entry", assembly::matrix_entry_for_entry),
    (
        "application_of_all_parts",
        assembly::application_of_all_parts,
    ),
    ("adjoint", assembly::adjoint),
    ("one_step", assembly::one_step),
    ("blocked_steps", assembly::blocked_steps),
    ("chebyshev_propagation", propagators::chebyshev_propagation),
    ("krylov_propagation", propagators::krylov_propagation),
    (
        "orders_of_the_implicit_methods",
        propagators::orders_of_the_implicit_methods,
    ),
    ("long_implicit_steps", propagators::long_implicit_steps),
    (
        "spectrum_in_its_interval",
        propagators::spectrum_in_its_interval,
    ),
    ("dissipative_weights", weights::dissipative_weights),
    ("classical_exponential", classical::classical_exponential),
    (
        "orders_of_the_integrators",
        classical::orders_of_the_integrators,
    ),
    ("limited_slopes", classical::limited_slopes),
    ("extreme_eigenvalues", weights::extreme_eigenvalues),
    ("recovered_field", recovery::recovered_field),
    ("results_before_the_end", recovery::results_before_the_end),
    ("modes_in_any_company", recovery::modes_in_any_company),
    ("fields_in_one_pass", recovery::fields_in_one_pass),
    ("shifted_field", recovery::shifted_field),
    (
        "varying_inflow_directly",
        time_dependent::varying_inflow_directly,
    ),
    (
        "varying_inflow_by_modes",
        time_dependent::varying_inflow_by_modes,
    ),
];

fn main() -> ExitCode {
    match std::env::var(RANKS) {
        Ok(ranks) => child(ranks.parse().expect("a number of ranks")),
        Err(_) => parent(),
    }
}

// ---------------------------------------------------------------------------------------------------------------------
// The parent: starts jobs, counts.

/// A running `mpirun` of this program.
struct Job {
    mpirun: Child,
    output: tempfile::TempDir,
    deadline: Instant,
}

/// What became of a job.
struct Outcome {
    /// `None` where it took too long and was ended.
    status: Option<ExitStatus>,
    stdout: String,
    stderr: String,
}

impl Job {
    fn start(ranks: usize, control: Option<&str>, arguments: &[String]) -> Self {
        let output = tempfile::tempdir().expect("a directory for output");
        let file = |name: &str| File::create(output.path().join(name)).expect("a file for output");
        let program = std::env::current_exe().expect("a path of this program");
        let mut command = Command::new("mpirun");
        command
            .args(["--bind-to", "none", "-np", &ranks.to_string()])
            .arg(program)
            .args(arguments)
            .env(RANKS, ranks.to_string())
            // As root, and with more ranks than cores: Open MPI 4, then 5.
            .env("OMPI_ALLOW_RUN_AS_ROOT", "1")
            .env("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1")
            .env("OMPI_MCA_rmaps_base_oversubscribe", "1")
            .env("OMPI_MCA_mpi_yield_when_idle", "1")
            .env("PRTE_MCA_rmaps_default_mapping_policy", ":oversubscribe")
            .stdin(Stdio::null())
            .stdout(file("stdout"))
            .stderr(file("stderr"));
        if let Some(control) = control {
            command.env(CONTROL, control);
        }
        let mpirun = command.spawn().expect("mpirun starts");
        Self {
            mpirun,
            output,
            deadline: Instant::now() + PATIENCE,
        }
    }

    fn text(&self, name: &str) -> String {
        let bytes = std::fs::read(self.output.path().join(name)).expect("the output is readable");
        String::from_utf8_lossy(&bytes).into_owned()
    }

    /// Ends `mpirun`, which ends the ranks: asks first, then insists.
    fn end(&mut self) {
        let _ = Command::new("kill")
            .arg(self.mpirun.id().to_string())
            .status();
        for _ in 0..50 {
            if let Ok(Some(_)) = self.mpirun.try_wait() {
                return;
            }
            std::thread::sleep(Duration::from_millis(100));
        }
        let _ = self.mpirun.kill();
        let _ = self.mpirun.wait();
    }

    /// Waits for the end, or for `enough` to say that there is nothing more to wait for; then, and when it takes too
    /// long, ends the job.
    fn outcome(mut self, enough: impl Fn(&str) -> bool) -> Outcome {
        let status = loop {
            if let Some(status) = self.mpirun.try_wait().expect("mpirun can be waited for") {
                break Some(status);
            }
            if Instant::now() > self.deadline || enough(&self.text("stdout")) {
                self.end();
                break None;
            }
            std::thread::sleep(Duration::from_millis(50));
        };
        Outcome {
            status,
            stdout: self.text("stdout"),
            stderr: self.text("stderr"),
        }
    }
}

/// Counts, and says what failed.
#[derive(Default)]
struct Tally {
    passed: usize,
    failed: usize,
}

impl Tally {
    fn count(&mut self, name: &str, passed: bool, reason: &str) {
        if passed {
            self.passed += 1;
            println!("test {name} ... ok");
        } else {
            self.failed += 1;
            println!("test {name} ... FAILED\n{reason}");
        }
    }
}

/// What each quantity's bits were, and how often they were reported.
type Bits = BTreeMap<String, (BTreeSet<String>, usize)>;

fn parent() -> ExitCode {
    let started = Instant::now();
    let filter: Vec<String> = std::env::args()
        .skip(1)
        .filter(|a| !a.starts_with('-'))
        .collect();
    let wanted = |name: &str| filter.is_empty() || filter.iter().any(|f| name.contains(f.as_str()));
    let mut tally = Tally::default();
    let mut bits = Bits::new();
    let names: Vec<&str> = CHECKS
        .iter()
        .map(|check| check.0)
        .filter(|n| wanted(n))
        .collect();
    for ranks in 1..=4 {
        run_checks(ranks, &names, &mut tally, &mut bits);
    }
    compare_bits(&bits, filter.is_empty(), &mut tally);
    if wanted("control_wrong") {
        control_wrong(&mut tally);
    }
    if wanted("control_hang") {
        control_hang(&mut tally);
    }
    println!(
        "\ntest result: {}. {} passed, {} failed; finished in {:.1} s",
        if tally.failed == 0 { "ok" } else { "FAILED" },
        tally.passed,
        tally.failed,
        started.elapsed().as_secs_f64()
    );
    ExitCode::from(u8::from(tally.failed > 0))
}

/// Runs the checks `names` on so many ranks: in one job, or in several if some fail, each beginning after the last
/// failure.
fn run_checks(ranks: usize, names: &[&str], tally: &mut Tally, bits: &mut Bits) {
    let mut left = names;
    while !left.is_empty() {
        let arguments: Vec<String> = left.iter().map(|n| (*n).to_owned()).collect();
        let outcome = Job::start(ranks, None, &arguments).outcome(|_| false);
        for line in outcome.stdout.lines() {
            if let Some((hash, name)) = line.strip_prefix("bits ").and_then(|l| l.split_once(' ')) {
                let entry = bits.entry(name.to_owned()).or_default();
                entry.0.insert(hash.to_owned());
                entry.1 += 1;
            }
        }
        let passed = |name: &str| {
            outcome
                .stdout
                .lines()
                .any(|l| l == format!("passed {name}"))
        };
        let through = left.iter().take_while(|name| passed(name)).count();
        for name in &left[..through] {
            tally.count(&format!("{name} on {ranks} ranks"), true, "");
        }
        left = &left[through..];
        let reason = match outcome.status {
            None => format!("took longer than {PATIENCE:?}\n{}", outcome.stderr),
            Some(status) => format!("{status}\n{}", outcome.stderr),
        };
        if let Some((name, rest)) = left.split_first() {
            tally.count(&format!("{name} on {ranks} ranks"), false, &reason);
            left = rest;
        } else {
            let ended_well = outcome.status.is_some_and(|s| s.success());
            tally.count(
                &format!("end of the job on {ranks} ranks"),
                ended_well,
                &reason,
            );
        }
    }
}

/// The same bits for any ranks and mesh; other bits for other quantities, or the comparison would see nothing.
fn compare_bits(bits: &Bits, all: bool, tally: &mut Tally) {
    let mut others = BTreeSet::new();
    for (name, (hashes, times)) in bits {
        let own = others.is_disjoint(hashes);
        let passed = hashes.len() == 1 && *times >= 4 && own;
        let reason = format!("{} different in {times}; its own: {own}", hashes.len());
        tally.count(&format!("bits of {name}"), passed, &reason);
        others.extend(hashes.iter().cloned());
    }
    if all {
        let reason = format!("{} quantities", bits.len());
        tally.count("bits were compared", bits.len() >= 50, &reason);
    }
}

/// A comparison that must fail does, on the entry that is wrong, and fails the job; the one before it passes.
fn control_wrong(tally: &mut Tally) {
    let outcome = Job::start(2, Some("wrong"), &[]).outcome(|_| false);
    let (out, err) = (&outcome.stdout, &outcome.stderr);
    let noticed = outcome.status.is_some_and(|s| !s.success())
        && out.contains("passed the right expectation")
        && err.contains("the wrong expectation: entry (1, 2) is ")
        && !out.contains("passed the wrong expectation");
    let reason = format!("{:?}\n{out}{err}", outcome.status);
    tally.count("control_wrong: a wrong expectation fails", noticed, &reason);
}

/// A job that hangs is ended, and no rank of it is left.
fn control_hang(tally: &mut Tally) {
    let processes = |text: &str| -> Vec<u32> {
        (text.lines())
            .filter_map(|line| line.strip_prefix("process ")?.trim().parse().ok())
            .collect()
    };
    let outcome = Job::start(2, Some("hang"), &[]).outcome(|text| processes(text).len() == 2);
    let started = processes(&outcome.stdout);
    let mut left = started.clone();
    for _ in 0..100 {
        // Signal 0 asks whether there is such a process.
        left.retain(|process| {
            let mut kill = Command::new("kill");
            kill.args(["-0", &process.to_string()])
                .stderr(Stdio::null());
            kill.status().is_ok_and(|s| s.success())
        });
        if left.is_empty() {
            break;
        }
        std::thread::sleep(Duration::from_millis(100));
    }
    let ended = outcome.status.is_none() && started.len() == 2 && left.is_empty();
    let reason = format!("{:?}; of {started:?} are left {left:?}", outcome.status);
    tally.count("control_hang: a job that hangs is ended", ended, &reason);
}

// ---------------------------------------------------------------------------------------------------------------------
// The child: one rank of a job.

fn child(ranks: usize) -> ExitCode {
    let world = World::start().expect("MPI starts");
    assert_eq!(world.group().size(), ranks, "ranks got and asked for");
    let speaks = world.group().rank() == 0;
    match std::env::var(CONTROL).as_deref() {
        Ok("wrong") => wrong_expectation(&world),
        Ok("hang") => hang(&world),
        Ok(other) => panic!("no such control: {other}"),
        Err(_) => {
            for wanted in std::env::args().skip(1) {
                let (name, check) = (CHECKS.iter().find(|c| c.0 == wanted)).expect("a check");
                let started = Instant::now();
                check(&world);
                world.group().barrier();
                if speaks {
                    println!("passed {name}");
                    eprintln!("{name}: {:.2} s", started.elapsed().as_secs_f64());
                }
            }
        }
    }
    world.group().barrier();
    ExitCode::SUCCESS
}

/// Prints a fingerprint of `values`, which the parent compares with those of other ranks and meshes.
fn report_bits(world: &World, name: &str, values: &[f64]) {
    if world.group().rank() == 0 {
        let hash = values
            .iter()
            .flat_map(|v| v.to_bits().to_le_bytes())
            .fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
                (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
            });
        println!("bits {hash:016x} {name}");
    }
}

/// The control: one entry of the twin is changed, and the comparison must stop the job.
fn wrong_expectation(world: &World) {
    let twin = Twin::all().swap_remove(0);
    let speaks = world.group().rank() == 0;
    for mesh in meshes(world, &twin.case) {
        let piece = Piece::assemble(world, &twin, &mesh);
        let found = piece.gather_matrix(world, &twin);
        assert_same(
            "the right expectation",
            &found.0,
            &twin.generator.symmetric(),
            0.0,
        );
        if speaks {
            println!("passed the right expectation");
        }
        let mut wrong = twin.generator.symmetric();
        wrong.add(1, 2, 1e-9);
        assert_same("the wrong expectation", &found.0, &wrong, 1e-10);
        if speaks {
            println!("passed the wrong expectation");
        }
    }
}

/// The control: rank 1 never comes.
fn hang(world: &World) {
    println!("process {}", std::process::id());
    if world.group().rank() == 1 {
        std::thread::sleep(2 * PATIENCE);
    }
}
