//! Tests all common work of ranks against dense references, on 1 to 4 ranks and on every process
//! mesh that they allow.
//!
//! If it is not started by mpirun, this program starts itself under `mpirun -np 1`, `2`, `3` and
//! `4`, counts the checks that pass, and compares the bits of results that must not depend on the
//! number of ranks. A failed check panics, which ends its job. Controls show that the harness finds
//! a wrong expectation and a job that hangs, and that ranks which fail, stop or die end their job.

mod assembly;
mod bits;
mod classical;
mod collectives;
mod controls;
mod dense_twins;
mod exact;
mod exchange;
mod failing;
mod job;
mod pieces;
mod propagators;
mod quantum;
mod recovery;
mod reductions;
mod spectrum;
mod streamed;
#[path = "../support/mod.rs"]
mod support;
mod time_dependent;
mod warped;
mod weights;

use bits::Bits;
use job::{CONTROL, Job, RANKS};
use phasewarp::parallel::communicator::World;
use std::ops::RangeInclusive;
use std::process::ExitCode;
use std::time::Instant;

/// A check that all ranks of a job run together.
struct Check {
    name: &'static str,
    run: fn(&World),
    /// The numbers of ranks it runs on.
    ranks: RangeInclusive<usize>,
}

/// The table of checks: each line has a check and its numbers of ranks.
macro_rules! checks {
    ($($room:ident::$name:ident on $ranks:expr;)*) => {
        const CHECKS: &[Check] = &[$(Check {
            name: stringify!($name),
            run: $room::$name,
            ranks: $ranks,
        }),*];
    };
}

const EVERY: RangeInclusive<usize> = 1..=4;

checks! {
    reductions::number_of_ranks on EVERY;
    reductions::reductions on EVERY;
    reductions::agreement_on_errors on EVERY;
    reductions::votes on EVERY;
    reductions::looks_of_unequal_blocks on EVERY;
    reductions::verdicts on EVERY;
    exact::jumps_are_integrated on EVERY;
    exact::filaments_are_integrated on EVERY;
    exact::corners_are_integrated on EVERY;
    exact::a_step_in_space_is_integrated on EVERY;
    exact::smooth_data_take_the_grid on EVERY;
    exact::sheets_are_followed_together on EVERY;
    exchange::ghost_exchange on EVERY;
    exchange::long_messages on EVERY;
    exchange::transpose_and_back on EVERY;
    quantum::oracles on EVERY;
    quantum::sparsity on EVERY;
    quantum::norm_of_the_state on EVERY;
    warped::warped_file on EVERY;
    warped::warped_files_refused on EVERY;
    collectives::few_reductions on EVERY;
    assembly::matrix_entry_for_entry on EVERY;
    assembly::application_of_all_parts on EVERY;
    assembly::adjoint on EVERY;
    assembly::one_step on EVERY;
    assembly::blocked_steps on EVERY;
    assembly::planned_blockings on EVERY;
    propagators::chebyshev_propagation on EVERY;
    propagators::krylov_propagation on EVERY;
    propagators::orders_of_the_implicit_methods on EVERY;
    propagators::long_implicit_steps on EVERY;
    spectrum::spectrum_in_its_interval on EVERY;
    weights::dissipative_weights on EVERY;
    weights::volumes on EVERY;
    classical::classical_exponential on EVERY;
    classical::orders_of_the_integrators on EVERY;
    classical::limited_slopes on EVERY;
    spectrum::extreme_eigenvalues on EVERY;
    recovery::recovered_field on EVERY;
    recovery::results_before_the_end on EVERY;
    recovery::changed_norms_are_refused on EVERY;
    recovery::modes_in_any_batch on EVERY;
    recovery::fields_in_one_pass on EVERY;
    recovery::shifted_field on EVERY;
    time_dependent::varying_inflow_directly on EVERY;
    time_dependent::varying_inflow_by_modes on EVERY;
    time_dependent::short_pulses_are_seen on EVERY;
}

fn main() -> ExitCode {
    match std::env::var(RANKS) {
        Ok(ranks) => child(ranks.parse().expect("a number of ranks")),
        Err(_) => parent(),
    }
}

/// Counts the checks and prints their results.
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

/// Starts the jobs. The arguments are parts of the names of checks; without arguments, all checks
/// run.
fn parent() -> ExitCode {
    let started = Instant::now();
    let filter = parts_of_names(std::env::args().skip(1));
    let wanted = |name: &str| filter.is_empty() || filter.iter().any(|part| name.contains(part));
    let mut tally = Tally::default();
    let mut bits = Bits::default();
    for ranks in EVERY.filter(|&ranks| job::bears(ranks)) {
        let chosen = CHECKS.iter().filter(|check| check.ranks.contains(&ranks));
        let names: Vec<&str> = chosen.map(|check| check.name).filter(|name| wanted(name)).collect();
        run_checks(ranks, &names, &mut tally, &mut bits);
    }
    // With fewer numbers of ranks, there are fewer fingerprints.
    let least = if job::bears(*EVERY.end()) { 4 } else { 2 };
    bits.compare(least, filter.is_empty(), &mut tally);
    for (name, control) in controls::CONTROLS {
        if wanted(name) {
            let (noticed, reason) = control();
            tally.count(name, noticed, &reason);
        }
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

/// The arguments that are parts of names. Options of Rust's own harness and their values are left
/// out: the value of `--test-threads 2` would select no check.
fn parts_of_names(arguments: impl Iterator<Item = String>) -> Vec<String> {
    const WITH_VALUES: [&str; 5] = ["--test-threads", "--skip", "--color", "--format", "--logfile"];
    let mut value_follows = false;
    let is_part = |word: &String| {
        let is_value = std::mem::replace(&mut value_follows, WITH_VALUES.contains(&word.as_str()));
        !is_value && !word.starts_with('-')
    };
    arguments.filter(is_part).collect()
}

/// Runs the checks `names` on `ranks` ranks in one job. If a check fails, the remaining checks run
/// in another job.
fn run_checks(ranks: usize, names: &[&str], tally: &mut Tally, bits: &mut Bits) {
    let mut left = names;
    while !left.is_empty() {
        let outcome = Job::start(ranks, &[], left).outcome(|_| false);
        bits.read(&outcome.stdout);
        let passed = |name: &str| (outcome.stdout.lines()).any(|l| l == format!("passed {name}"));
        let count = left.iter().take_while(|name| passed(name)).count();
        for name in &left[..count] {
            tally.count(&format!("{name} on {ranks} ranks"), true, "");
        }
        left = &left[count..];
        if let Some((name, rest)) = left.split_first() {
            tally.count(&format!("{name} on {ranks} ranks"), false, &outcome.report());
            left = rest;
        } else {
            let name = format!("end of the job on {ranks} ranks");
            tally.count(&name, outcome.success(), &outcome.report());
        }
    }
}

/// One rank of a job: runs a control, or the checks that the arguments name.
fn child(ranks: usize) -> ExitCode {
    let world = World::start().expect("MPI starts");
    assert_eq!(world.group().size(), ranks, "ranks started and asked for");
    let is_first = world.group().rank() == 0;
    if let Ok(control) = std::env::var(CONTROL) {
        controls::run(&control, &world);
    } else {
        for name in std::env::args().skip(1) {
            let check = CHECKS.iter().find(|check| check.name == name);
            let started = Instant::now();
            (check.expect("a check").run)(&world);
            world.group().barrier();
            if is_first {
                println!("passed {name}");
                eprintln!("{name}: {:.2} s", started.elapsed().as_secs_f64());
            }
        }
    }
    world.group().barrier();
    ExitCode::SUCCESS
}
