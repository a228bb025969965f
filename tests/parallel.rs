//! Everything that ranks do together, against dense twins, on 1 to 4 ranks and every process mesh they admit.
//!
//! Without MPI around it, this program starts itself under `mpirun -np 1`, `2`, `3` and `4`, counts what passed and
//! compares the bits of what should not depend on ranks. A check that fails panics, and a panic ends its whole job. Two
//! controls show that a wrong expectation and a job that hangs are noticed.

#[path = "parallel/quantum.rs"]
mod quantum;
mod support;
#[path = "parallel/warped.rs"]
mod warped;

use faer::linalg::solvers::Solve;
use faer::{Mat, Side};
use num_complex::Complex64;
use phasewarp::case::{
    Case, Coefficients, Delta, Embedding, Integrator, Limiter, Method, OutputTime, ProfileChoice,
    Propagation, PropagatorMethod, RecoveryMethod, Shift,
};
use phasewarp::checkpoint::watch::{Verdict, Watch};
use phasewarp::checkpoint::{Standing, Times};
use phasewarp::classical::limiter::{Reconstruction, longest_step};
use phasewarp::classical::{Classical, EXACT, duhamel_panels};
use phasewarp::communicator::{Communicator, GhostExchange, Group, Vote, World};
use phasewarp::error::Error;
use phasewarp::matrix::blocking::{Blocking, Shape};
use phasewarp::matrix::kernel::{self, InstructionSet};
use phasewarp::matrix::{BlockMatrix, LANES, Lanes, Part, StepConstants};
use phasewarp::observables::{MOMENTS, VelocityFactors};
use phasewarp::partition::{Block, Mesh, Place, split};
use phasewarp::plan::{Batch, Bounds, INFLOW_GROWTH, Plan, Resources, WarpPlan};
use phasewarp::problem::Problem;
use phasewarp::progress::Progress;
use phasewarp::propagate::chebyshev::{Chebyshev, Interval, bessel_series};
use phasewarp::propagate::commutator_free::CommutatorFree;
use phasewarp::propagate::implicit::Implicit;
use phasewarp::propagate::krylov::Krylov;
use phasewarp::propagate::{
    BatchReport, BatchSpec, Company, Evolution, Initial, Propagator, company, propagator, work,
};
use phasewarp::spectrum::{extremes, gershgorin};
use phasewarp::varying;
use phasewarp::warp::{self, Besides, Leg, MomentsOf, Task};
use phasewarp::weights::Weights;
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
    ("number_of_ranks", number_of_ranks),
    ("reductions", reductions),
    ("agreement_on_errors", agreement_on_errors),
    ("votes", votes),
    ("verdicts", verdicts),
    ("ghost_exchange", ghost_exchange),
    ("long_messages", long_messages),
    ("transpose_and_back", warped::transpose_and_back),
    ("oracles", quantum::oracles),
    ("sparsity", quantum::sparsity_counted),
    ("norm_of_the_state", quantum::norm_of_the_state),
    ("warped_file", warped::warped_file),
    ("warped_files_refused", warped::warped_files_refused),
    ("matrix_entry_for_entry", matrix_entry_for_entry),
    ("application_of_all_parts", application_of_all_parts),
    ("adjoint", adjoint),
    ("one_step", one_step),
    ("blocked_steps", blocked_steps),
    ("chebyshev_propagation", chebyshev_propagation),
    ("krylov_propagation", krylov_propagation),
    (
        "orders_of_the_implicit_methods",
        orders_of_the_implicit_methods,
    ),
    ("long_implicit_steps", long_implicit_steps),
    ("spectrum_in_its_interval", spectrum_in_its_interval),
    ("dissipative_weights", dissipative_weights),
    ("classical_exponential", classical_exponential),
    ("orders_of_the_integrators", orders_of_the_integrators),
    ("limited_slopes", limited_slopes),
    ("extreme_eigenvalues", extreme_eigenvalues),
    ("recovered_field", recovered_field),
    ("results_before_the_end", results_before_the_end),
    ("modes_in_any_company", modes_in_any_company),
    ("fields_in_one_pass", fields_in_one_pass),
    ("shifted_field", shifted_field),
    ("varying_inflow_directly", varying_inflow_directly),
    ("varying_inflow_by_modes", varying_inflow_by_modes),
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

// ---------------------------------------------------------------------------------------------------------------------
// Twins and pieces.

/// A case and its dense system with auxiliary unknowns: cells in their order, then those of rows, or the common one.
struct Twin {
    name: &'static str,
    case: Case,
    /// Cells, without the auxiliary unknowns.
    cells: usize,
    /// `A`, homogeneous.
    generator: Dense,
    /// Rows with an auxiliary unknown of their own, ascending.
    inflow: Vec<usize>,
    /// `(row, auxiliary unknown, g_i)` where `κ_i ≠ 0`.
    coupled: Vec<(usize, usize, f64)>,
    /// `u(0)`.
    state: Vec<f64>,
}

impl Twin {
    fn new(name: &'static str, file: &str, overrides: &[&str]) -> Self {
        let case = case(file, overrides);
        let System {
            generator: a,
            inflow: b,
            draw,
        } = System::of_rows(&case);
        let cells = a.size;
        let enters: Vec<usize> = (0..cells).filter(|&i| b[i] != 0.0).collect();
        let embedding = case.warp.inflow;
        let inflow: Vec<usize> = match embedding {
            Embedding::Boundary => enters.clone(),
            Embedding::Full if !enters.is_empty() => (0..cells).collect(),
            _ => Vec::new(),
        };
        let shared = embedding == Embedding::Scalar && !enters.is_empty();
        let mut state: Vec<f64> = (0..cells)
            .map(|i| {
                case.fields[0]
                    .initial
                    .eval(&case.space.point(&case.space.cell(i)))
            })
            .collect();
        let size = cells + inflow.len() + usize::from(shared);
        let mut generator = Dense::from_fn(size, |i, j| {
            if i < cells && j < cells {
                a.at(i, j)
            } else {
                0.0
            }
        });
        // r' = 0. A given δ: κ_i = |b_i|/δ, r_i(0) = ±δ. Planned: κ_i² = 2 g_i θ, and δ² = Σ b_i²/(2 g_i θ) for the scalar.
        let growth = INFLOW_GROWTH / case.end;
        let largest = b.iter().fold(0.0f64, |m, b| m.max(b.abs()));
        let given = match case.warp.delta {
            Delta::Planned => None,
            Delta::Largest => Some(largest),
            Delta::Given(delta) => Some(delta),
        };
        let mut coupled = Vec::new();
        if shared {
            let sum: f64 = enters.iter().map(|&i| b[i] * b[i] / (2.0 * draw[i])).sum();
            let delta = given.unwrap_or((sum / growth).sqrt());
            for &i in &enters {
                generator.add(i, cells, b[i] / delta);
                coupled.push((i, cells, draw[i]));
            }
            state.push(delta);
        }
        for (m, &i) in inflow.iter().enumerate() {
            let coupling = given.map_or((2.0 * draw[i] * growth).sqrt(), |d| b[i].abs() / d);
            if b[i] == 0.0 {
                state.push(given.unwrap_or(0.0));
                continue;
            }
            generator.add(i, cells + m, coupling);
            coupled.push((i, cells + m, draw[i]));
            state.push(b[i] / coupling);
        }
        Self {
            name,
            case,
            cells,
            generator,
            inflow,
            coupled,
            state,
        }
    }

    /// `θ`: the largest `κ²/(2g)` of the auxiliary unknowns, summed over the rows that share one.
    fn theta(&self) -> f64 {
        let mut added = vec![0.0; self.size()];
        for &(i, m, draw) in &self.coupled {
            added[m] += self.generator.at(i, m).powi(2) / (2.0 * draw);
        }
        added.into_iter().fold(0.0, f64::max)
    }

    /// Those whose matrix couples every unknown to neighbours only.
    fn unshared() -> Vec<Self> {
        let neighbours = |twin: &Self| twin.case.warp.inflow != Embedding::Scalar;
        Self::all().into_iter().filter(neighbours).collect()
    }

    /// One, two and three dimensions, both interfaces, with and without inflow; no length is divisible by 2, 3 and 4.
    fn all() -> Vec<Self> {
        vec![
            Self::new(
                "example 1",
                "example1.toml",
                &["axis.0.x.cells=10", "axis.0.v.cells=8"],
            ),
            Self::new(
                "slopes, inflow",
                "slope_jump.toml",
                &[
                    "axis.0.x.cells=7",
                    "axis.0.v={lower=-1.0,upper=1.3,cells=9}",
                    "inflow.value='1 + x + 2*v'",
                ],
            ),
            Self::new(
                "well",
                "well.toml",
                &["axis.0.x.cells=11", "axis.0.v.cells=10"],
            ),
            Self::new(
                "conservative barrier, inflow",
                "inflow_barrier.toml",
                &[
                    "axis.0.x.cells=9",
                    "axis.0.v.cells=14",
                    "scheme.interface='conservative'",
                ],
            ),
            Self::new(
                "two dimensions, inflow",
                "barrier2d.toml",
                &[
                    "axis.0.x.cells=5",
                    "axis.0.v.cells=3",
                    "axis.1.x.cells=4",
                    "axis.1.v.cells=4",
                    "potential.0.value='0.2 + 0.1*x - 0.1*y'",
                    "inflow.value='1 if x < -1.2 else 0'",
                ],
            ),
            Self::new(
                "three dimensions",
                "step3d.toml",
                &[
                    "axis.0.x.cells=4",
                    "axis.0.v.cells=4",
                    "axis.1.x.cells=3",
                    "axis.1.v.cells=2",
                    "axis.2.x.cells=2",
                    "axis.2.v.cells=2",
                    "potential.1.value='0.1 + 0.05*y'",
                ],
            ),
            // Axes that close on themselves: the first, where layers are assembled and blocks are opened one after the other, and another.
            Self::new(
                "periodic, a jump at the end, inflow of velocities",
                "slope_jump.toml",
                &[
                    "axis.0.x={lower=-1.5,upper=1.5,cells=9,boundary='periodic'}",
                    "axis.0.v.cells=7",
                    "inflow.value='1 + x + 2*v'",
                ],
            ),
            Self::new(
                "periodic along the step",
                "periodic2d.toml",
                &[
                    "axis.0.x.cells=6",
                    "axis.0.v.cells=4",
                    "axis.1.x.cells=5",
                    "axis.1.v.cells=3",
                    "potential.0.value='0.1*y'",
                    "inflow.value='1 if x < -1.2 else 0'",
                ],
            ),
            Self::new(
                "periodic across the step, two cells along it",
                "periodic2d.toml",
                &[
                    "axis.0.x.boundary=periodic",
                    "axis.0.x.cells=4",
                    "axis.0.v.cells=6",
                    "axis.1.x={lower=-0.5,upper=0.5,cells=3}",
                    "axis.1.v.cells=3",
                    "scheme.interface='conservative'",
                ],
            ),
            // The other embeddings of the inflow, δ planned and given.
            Self::slopes(
                "full",
                &[
                    "axis.0.v={lower=-1.0,upper=1.31,cells=9}",
                    "solver.warp.inflow='full'",
                ],
            ),
            Self::slopes(
                "full, largest",
                &[
                    "axis.0.v={lower=-1.0,upper=1.32,cells=9}",
                    "solver.warp.inflow='full'",
                    "solver.warp.delta='max'",
                ],
            ),
            Self::slopes(
                "boundary, given",
                &[
                    "axis.0.v={lower=-1.0,upper=1.33,cells=9}",
                    "solver.warp.delta=4.5",
                ],
            ),
            Self::slopes(
                "scalar",
                &[
                    "axis.0.v={lower=-1.0,upper=1.34,cells=9}",
                    "solver.warp.inflow='scalar'",
                ],
            ),
            Self::slopes(
                "scalar, given",
                &[
                    "axis.0.v={lower=-1.0,upper=1.35,cells=9}",
                    "solver.warp.inflow='scalar'",
                    "solver.warp.delta=14",
                ],
            ),
            Self::new(
                "conservative barrier, scalar, largest",
                "inflow_barrier.toml",
                &[
                    "axis.0.x.cells=9",
                    "axis.0.v.cells=14",
                    "scheme.interface='conservative'",
                    "solver.warp.inflow='scalar'",
                    "solver.warp.delta='max'",
                ],
            ),
            Self::new(
                "two dimensions, scalar",
                "barrier2d.toml",
                &[
                    "axis.0.x.cells=5",
                    "axis.0.v.cells=3",
                    "axis.1.x.cells=4",
                    "axis.1.v.cells=4",
                    "inflow.value='1 if x < -1.2 else 0'",
                    "solver.warp.inflow='scalar'",
                ],
            ),
        ]
    }

    /// Each on a grid of its own, or their bits would be the same.
    fn slopes(name: &'static str, overrides: &[&str]) -> Self {
        let mut all = vec!["axis.0.x.cells=7", "inflow.value='1 + x + 2*v'"];
        all.extend(overrides);
        Self::new(name, "slope_jump.toml", &all)
    }

    fn size(&self) -> usize {
        self.generator.size
    }

    /// `f` of a state: cells only.
    fn field<'a>(&self, state: &'a [f64]) -> &'a [f64] {
        &state[..self.cells]
    }
}

/// Every mesh of the ranks of `world` that the grid of `case` admits.
fn meshes(world: &World, case: &Case) -> Vec<Mesh> {
    fn visit(case: &Case, ranks: usize, parts: &mut Vec<usize>, list: &mut Vec<Mesh>) {
        let Some(axis) = case.space.x.get(parts.len()) else {
            list.push(Mesh {
                space: parts.clone(),
                groups: ranks,
            });
            return;
        };
        let most = case.space.most_blocks(parts.len()).min(axis.cells);
        for blocks in (1..=ranks.min(most)).filter(|b| ranks.is_multiple_of(*b)) {
            parts.push(blocks);
            visit(case, ranks / blocks, parts, list);
            parts.pop();
        }
    }
    let mut list = Vec::new();
    visit(case, world.group().size(), &mut Vec::new(), &mut list);
    assert!(list.iter().all(|m| m.ranks() == world.group().size()));
    list
}

/// This rank's part of a twin.
struct Piece {
    communicator: Communicator,
    matrix: BlockMatrix,
    exchange: GhostExchange,
    /// Number in the twin of each local row, then of each ghost.
    number: Vec<usize>,
}

impl Piece {
    fn new(twin: &Twin, communicator: Communicator, matrix: BlockMatrix) -> Self {
        let exchange = GhostExchange::new(&communicator.space, &matrix.block, 2 * LANES);
        let number = numbers(twin, &matrix);
        Self {
            communicator,
            matrix,
            exchange,
            number,
        }
    }

    fn assemble(world: &World, twin: &Twin, mesh: &Mesh) -> Self {
        let communicator = Communicator::new(world, mesh);
        assert_eq!(communicator.space.size(), mesh.blocks());
        assert_eq!(communicator.modes.size(), mesh.groups);
        let block = Block::new(&twin.case.space, mesh, communicator.space.rank());
        let mut matrix = BlockMatrix::assemble(&twin.case, block).expect("formulas are finite");
        let mut pi = vec![1.0; matrix.length()];
        matrix.couple(&communicator.space, &twin.case, &mut pi);
        assert!(pi.iter().all(|&pi| pi == 1.0), "{}", twin.name);
        Self::new(twin, communicator, matrix)
    }

    /// The local part of a vector of the twin; ghosts hold NaN until they are exchanged.
    fn scatter(&self, vector: &[f64]) -> Vec<f64> {
        let mut local = vec![f64::NAN; self.matrix.length()];
        for (local, &i) in local[..self.matrix.rows()].iter_mut().zip(&self.number) {
            *local = vector[i];
        }
        local
    }

    /// The whole vector, on every rank, from the rows of all; each has one owner in the space group.
    fn gather(&self, twin: &Twin, local: &[f64]) -> Vec<f64> {
        let rows = self.matrix.counted_rows();
        let space = &self.communicator.space;
        gather(
            space,
            twin.size(),
            (0..rows).map(|i| (self.number[i], local[i])),
        )
    }

    /// The whole `(S, K)`, dense.
    fn gather_matrix(&self, world: &World, twin: &Twin) -> (Dense, Dense) {
        let size = twin.size();
        let space = &self.communicator.space;
        assert_eq!(space.sum_count(self.matrix.counted_rows()), size);
        let (mut s, mut k) = (vec![f64::NEG_INFINITY; size * size], vec![0.0; 0]);
        k.clone_from(&s);
        for i in 0..self.matrix.rows() {
            let mut last = None;
            for (column, es, ek) in self.matrix.row(i) {
                let j = self.number[column];
                assert!(last < Some(j), "{}: row {i} is not in order", twin.name);
                last = Some(j);
                let place = self.number[i] * size + j;
                (s[place], k[place]) = (es, ek);
            }
        }
        // Over the world: all mode groups hold the same.
        world.group().max_into(&mut s);
        world.group().max_into(&mut k);
        let entry = |values: &[f64], i: usize, j: usize| match values[i * size + j] {
            f64::NEG_INFINITY => 0.0,
            value => value,
        };
        (
            Dense::from_fn(size, |i, j| entry(&s, i, j)),
            Dense::from_fn(size, |i, j| entry(&k, i, j)),
        )
    }
}

/// Number in the twin of each local row of `matrix`, then of each ghost.
fn numbers(twin: &Twin, matrix: &BlockMatrix) -> Vec<usize> {
    let mut number = vec![usize::MAX; matrix.length()];
    let velocities = matrix.block.velocity_cells;
    let (cells, rows) = (matrix.block.cells(), matrix.rows());
    matrix.block.for_each_own(|first, local| {
        (0..velocities).for_each(|v| number[local + v] = first + v);
    });
    matrix.block.for_each_ghost(|first, ghost| {
        (0..velocities).for_each(|v| number[rows + ghost + v] = first + v);
    });
    if twin.case.warp.inflow == Embedding::Scalar {
        number[cells..rows].fill(twin.cells);
        return number;
    }
    for (m, aux) in matrix.inflow.iter().enumerate() {
        let place = twin.inflow.binary_search(&number[aux.row as usize]);
        number[cells + m] = twin.cells + place.expect("a row with inflow");
    }
    number
}

/// Entries of a vector of length `size`, from all ranks of `group`, on every rank. Every entry has one owner.
fn gather(group: &Group, size: usize, entries: impl Iterator<Item = (usize, f64)>) -> Vec<f64> {
    let mut values = vec![f64::NEG_INFINITY; size];
    let mut owned = 0;
    for (i, value) in entries {
        values[i] = value;
        owned += 1;
    }
    assert_eq!(group.sum_count(owned), size, "every entry has one owner");
    group.max_into(&mut values);
    assert!(
        !values.contains(&f64::NEG_INFINITY),
        "every entry has an owner"
    );
    values
}

/// Calls `check` with every twin, mesh and piece.
fn for_every_piece(world: &World, mut check: impl FnMut(&Twin, &Mesh, &mut Piece)) {
    for twin in Twin::all() {
        for mesh in meshes(world, &twin.case) {
            check(&twin, &mesh, &mut Piece::assemble(world, &twin, &mesh));
        }
    }
}

/// A vector of the twin that is the same on any ranks.
fn random(twin: &Twin, seed: u64) -> Vec<f64> {
    (0..twin.size()).map(|i| noise(i, seed)).collect()
}

/// The problem as a run sets it up, with weights where it takes them; and what the twin becomes by them.
struct Weighted {
    communicator: Communicator,
    problem: Problem,
    bounds: Bounds,
    number: Vec<usize>,
    /// `π`, by the numbers of the twin.
    pi: Vec<f64>,
    /// `D A D⁻¹`.
    generator: Dense,
    /// `D u(0)`.
    state: Vec<f64>,
}

impl Weighted {
    fn new(world: &World, twin: &Twin, mesh: &Mesh) -> Self {
        let communicator = Communicator::new(world, mesh);
        let block = Block::new(&twin.case.space, mesh, communicator.space.rank());
        let allowed = Bounds::new(&twin.case).expect("V is finite");
        let problem = Problem::new(&twin.case, &allowed, &communicator, block, (2 * LANES, 100))
            .expect("weights are found");
        let bounds = problem.bounds(&twin.case, &allowed);
        // Left alone, the hat interface grows as it likes.
        let round_off = 1e-14 * bounds.rate;
        assert!(bounds.growth <= allowed.growth + round_off || !twin.case.warp.weights);
        let number = numbers(twin, &problem.matrix);
        let rows = problem.matrix.counted_rows();
        let entries = (0..rows).map(|i| (number[i], problem.weights.pi[i]));
        let pi = gather(&communicator.space, twin.size(), entries);
        Self {
            generator: twin.generator.weighted(&pi),
            state: twin
                .state
                .iter()
                .zip(&pi)
                .map(|(u, pi)| u * pi.sqrt())
                .collect(),
            communicator,
            problem,
            bounds,
            number,
            pi,
        }
    }
}

// ---------------------------------------------------------------------------------------------------------------------
// The checks.

fn number_of_ranks(world: &World) {
    let asked: usize = std::env::var(RANKS)
        .expect("set by the parent")
        .parse()
        .expect("a number");
    let group = world.group();
    assert_eq!(group.size(), asked);
    assert_eq!(group.sum_count(1), asked);
    assert_eq!(group.max_count(group.rank()), asked - 1);
    // Each rank once.
    let mut seen = vec![0; asked];
    seen[group.rank()] = 1;
    group.sum_integers(&mut seen);
    assert!(seen.iter().all(|&s| s == 1));
}

fn reductions(world: &World) {
    let group = world.group();
    let (rank, size) = (group.rank(), group.size());
    assert!(group.same(u64::MAX) && group.same(0));
    assert_eq!(group.same(7 + u64::from(rank + 1 == size)), size == 1);
    // A sum that plain addition would get wrong, dealt out to the ranks.
    let terms: Vec<f64> = (0..3000)
        .map(|i| noise(i, 1) * 10f64.powi(i as i32 % 7 * 4 - 12))
        .flat_map(|t| [t, -t, 1e-9 * t])
        .collect();
    let mine: Vec<f64> = terms.iter().skip(rank).step_by(size).copied().collect();
    let bound = terms.iter().fold(0.0, |m: f64, t| m.max(t.abs()));
    let exact: f64 = terms.iter().skip(2).step_by(3).sum();
    let sum = group.sum(bound, terms.len(), mine.iter().copied());
    assert!((sum - exact).abs() < 1e-22 * bound, "{sum} {exact}");
    assert_eq!(group.sum_terms(&mine).to_bits(), sum.to_bits());
    report_bits(world, "a sum", &[sum]);
    // Not a number anywhere is not a number everywhere.
    let mut spoilt = mine.clone();
    if rank == size - 1 {
        spoilt[0] = f64::NAN;
    }
    assert!(group.sum_terms(&spoilt).is_nan());
    assert_eq!(group.sum_terms(&[]), 0.0);

    let values = |r: usize| [-1.0 - r as f64, 0.5 * r as f64, -1e300 * r as f64];
    let mut most = values(rank);
    group.max_into(&mut most);
    assert_eq!(most, [-1.0, 0.5 * (size - 1) as f64, 0.0]);
    assert_eq!(group.max(f64::NEG_INFINITY), f64::NEG_INFINITY);
    let one = if rank == 0 { f64::NAN } else { f64::INFINITY };
    assert!(group.max(one).is_nan());

    // More than goes in one message; a root that is not rank 0.
    let length = (1 << 20) + 3;
    let mut numbers: Vec<i64> = (0..length).map(|i| i * (rank as i64 + 1)).collect();
    let factor = (size * (size + 1) / 2) as i64;
    let mut rooted = numbers.clone();
    group.sum_integers(&mut numbers);
    assert!(
        numbers
            .iter()
            .enumerate()
            .all(|(i, &n)| n == i as i64 * factor)
    );
    group.sum_integers_to(size - 1, &mut rooted);
    let expected = if rank == size - 1 {
        factor
    } else {
        rank as i64 + 1
    };
    assert!(
        rooted
            .iter()
            .enumerate()
            .all(|(i, &n)| n == i as i64 * expected)
    );

    let text = |r: usize| format!("rank {r} says µ ").repeat(100_000);
    assert_eq!(group.broadcast_text(&text(rank)), text(0));
    assert_eq!(group.broadcast_text(""), "");
}

fn agreement_on_errors(world: &World) {
    let group = world.group();
    let (rank, size) = (group.rank(), group.size());
    assert_eq!(group.agree(Ok(rank)).expect("all are well"), rank);
    // Every set of ranks that fail, with an exit code of 2 on even ranks and of 1 on odd ones.
    for failing in 1..1usize << size {
        let mine = if failing >> rank & 1 == 0 {
            Ok(rank)
        } else if rank.is_multiple_of(2) {
            Err(Error::Ranks(format!("rank {rank} of {failing}: ünknown")))
        } else {
            Err(Error::NotFinite(format!("rank {rank} of {failing}")))
        };
        let lowest = failing.trailing_zeros() as usize;
        let error = group.agree(mine).expect_err("one failed");
        assert!(
            error
                .to_string()
                .contains(&format!("rank {lowest} of {failing}")),
            "{failing}: {error}"
        );
        assert_eq!(
            error.exit_code(),
            if lowest.is_multiple_of(2) { 2 } else { 1 }
        );
        let remote = matches!(error, Error::Remote { rank, .. } if rank == lowest);
        assert_eq!(remote, rank != lowest);
    }
}

fn votes(world: &World) {
    let group = world.group();
    let (rank, size) = (group.rank(), group.size());
    let mut vote = Vote::new(&group);
    for round in 0..20 {
        // Another rank is late each time, which nobody waits for in `post`.
        if round % size == rank {
            std::thread::sleep(Duration::from_millis(2));
        }
        assert!(!vote.is_posted());
        vote.post(1 << (rank + round));
        assert!(vote.is_posted());
        if round % 2 == 0 {
            while !vote.is_over() {
                std::thread::yield_now();
            }
        }
        assert_eq!(vote.take(), ((1 << size) - 1) << round);
    }
}

/// What a rank sees of a stage with so many batches, each of which takes a moment: how often it wrote, and how it ended.
fn stage(
    communicator: &Communicator,
    times: &Times,
    batches: usize,
    last: Standing,
) -> (usize, Verdict) {
    let mut watch = Watch::new(communicator, times.clone());
    watch.expect(|| 0);
    let (mut left, mut written) = (batches, 0);
    loop {
        let standing = if left > 0 { Standing::Working } else { last };
        match watch.ask(communicator, standing) {
            Verdict::GoOn => {
                watch.begin(standing);
                std::thread::sleep(Duration::from_millis(u64::from(left > 0)));
                left = left.saturating_sub(1);
            }
            Verdict::Write => {
                // All ranks are here, or this hangs.
                communicator.world.barrier();
                written += 1;
                watch.wrote(Duration::from_micros(10));
            }
            end => return (written, end),
        }
    }
}

fn verdicts(world: &World) {
    let all = world.group();
    let size = all.size();
    for blocks in (1..=size).filter(|blocks| size.is_multiple_of(*blocks)) {
        let mesh = Mesh {
            space: vec![blocks],
            groups: size / blocks,
        };
        let communicator = Communicator::new(world, &mesh);
        let group = communicator.modes.rank();
        let last = group + 1 == mesh.groups;
        // Ranks of different groups have different numbers of batches, the first none at all.
        let batches = 7 * group;
        let same = |(written, end): (usize, Verdict), expected: Verdict| {
            assert_eq!(end, expected);
            assert!(all.same(written as u64));
            written
        };
        let never = Times::default();
        let seen = stage(&communicator, &never, batches, Standing::Finished);
        assert_eq!(same(seen, Verdict::Finished), 0);
        // The last group fails, after its batches.
        let end = if last {
            Standing::Failed
        } else {
            Standing::Finished
        };
        same(stage(&communicator, &never, batches, end), Verdict::Failed);
        // A checkpoint with each vote.
        let always = Times {
            every: Some(Duration::ZERO),
            ..Times::default()
        };
        let seen = stage(&communicator, &always, batches + 5, Standing::Finished);
        assert!(same(seen, Verdict::Finished) > 0);
        // One rank is told to stop.
        let stop = Times::default();
        let told = all.rank() + 1 == size;
        stop.stop.store(told, std::sync::atomic::Ordering::Relaxed);
        let seen = stage(&communicator, &stop, batches + 50, Standing::Finished);
        same(seen, Verdict::StopAsTold);
        // The time is over; or just long enough for some batches; or for all.
        for (milliseconds, expected) in [
            (0, Verdict::StopInTime),
            (30, Verdict::StopInTime),
            (1_000_000, Verdict::Finished),
        ] {
            let wall = Some((Instant::now(), Duration::from_millis(milliseconds)));
            let times = Times {
                wall,
                ..Times::default()
            };
            let many = if expected == Verdict::Finished {
                batches
            } else {
                10_000
            };
            same(
                stage(&communicator, &times, many, Standing::Finished),
                expected,
            );
        }
    }
}

fn ghost_exchange(world: &World) {
    for_every_piece(world, |twin, mesh, piece| {
        let rows = piece.matrix.rows();
        let value = |i: usize, seed| noise(piece.number[i], seed);
        for seed in 0..3 {
            // Real numbers and batches through the same buffers.
            let mut real: Vec<f64> = (0..rows).map(|i| value(i, seed)).collect();
            let mut batch: Vec<Lanes> = (0..rows)
                .map(|i| Lanes(std::array::from_fn(|l| value(i, 100 * seed + l as u64))))
                .collect();
            real.resize(piece.matrix.length(), f64::NAN);
            batch.resize(piece.matrix.length(), Lanes([f64::NAN; 2 * LANES]));
            piece.exchange.start(&real[..rows]);
            piece.exchange.finish(&mut real[rows..]);
            piece.exchange.start(&batch[..rows]);
            piece.exchange.finish(&mut batch[rows..]);
            for i in 0..piece.matrix.length() {
                assert_eq!(real[i], value(i, seed), "{} {mesh:?} {i}", twin.name);
                for l in 0..2 * LANES {
                    assert_eq!(batch[i].0[l], value(i, 100 * seed + l as u64));
                }
            }
        }
        // Every ghost is where its block says.
        for (ghost, &i) in piece.number[rows..].iter().enumerate() {
            assert_eq!(piece.matrix.block.place(i), Some(Place::Ghost(ghost)));
        }
    });
}

/// A ghost layer of more numbers than go in one message.
fn long_messages(world: &World) {
    let ranks = world.group().size();
    let (cells, velocities) = ("axis.0.x.cells=5", 70_000);
    let case = case(
        "example1.toml",
        &[cells, &format!("axis.0.v.cells={velocities}")],
    );
    let mesh = Mesh {
        space: vec![ranks],
        groups: 1,
    };
    let communicator = Communicator::new(world, &mesh);
    let block = Block::new(&case.space, &mesh, communicator.space.rank());
    assert!(ranks == 1 || 2 * LANES * block.ghosts() > 1 << 20);
    let mut exchange = GhostExchange::new(&communicator.space, &block, 2 * LANES);
    let row = |global: usize| Lanes(std::array::from_fn(|l| (global * 2 * LANES + l) as f64));
    let mut own = vec![Lanes::ZERO; block.cells()];
    block.for_each_own(|first, local| {
        (0..velocities).for_each(|v| own[local + v] = row(first + v));
    });
    let mut ghosts = vec![Lanes::ZERO; block.ghosts()];
    exchange.start(&own);
    exchange.finish(&mut ghosts);
    block.for_each_ghost(|first, ghost| {
        (0..velocities).for_each(|v| assert_eq!(ghosts[ghost + v], row(first + v)));
    });
}

fn matrix_entry_for_entry(world: &World) {
    for_every_piece(world, |twin, mesh, piece| {
        let name = format!("{}, {mesh:?}", twin.name);
        let (s, k) = piece.gather_matrix(world, twin);
        // The scalar's δ is a sum, exact here and rounded there.
        let round_off = match twin.case.warp.inflow {
            Embedding::Scalar => 1e-15 * twin.generator.largest(),
            _ => 0.0,
        };
        assert_same(&name, &s, &twin.generator.symmetric(), round_off);
        assert_same(&name, &k, &twin.generator.skew(), round_off);
        let space = &piece.communicator.space;
        let coupled = piece.matrix.inflow.iter().filter(|aux| aux.coupling != 0.0);
        assert_eq!(
            space.sum_count(coupled.count()),
            twin.coupled.len(),
            "{name}"
        );
        for (m, r) in piece.matrix.auxiliary(0, twin.case.enters()).enumerate() {
            let m = piece.number[piece.matrix.block.cells() + m];
            assert!((r - twin.state[m]).abs() <= 1e-14 * r.abs(), "{name}: {r}");
        }
        // In weighted unknowns.
        let mut weighted = Weighted::new(world, twin, mesh);
        let (s, k) = {
            let matrix = std::mem::replace(
                &mut weighted.problem.matrix,
                Piece::assemble(world, twin, mesh).matrix,
            );
            Piece::new(twin, Communicator::new(world, mesh), matrix).gather_matrix(world, twin)
        };
        let tolerance = 1e-14 * weighted.generator.largest();
        assert_same(&name, &s, &weighted.generator.symmetric(), tolerance);
        assert_same(&name, &k, &weighted.generator.skew(), tolerance);
        let local = &weighted.problem.states[0][..weighted.problem.matrix.rows()];
        for (i, u) in local.iter().enumerate() {
            let expected = weighted.state[weighted.number[i]];
            assert!(
                (u - expected).abs() <= 1e-14 * expected.abs(),
                "{name}: {u} {expected}"
            );
        }
    });
}

fn application_of_all_parts(world: &World) {
    for_every_piece(world, |twin, mesh, piece| {
        let x = random(twin, 2);
        for (part, expected) in [
            (Part::Generator, twin.generator.apply(&x)),
            (Part::Transpose, twin.generator.transposed().apply(&x)),
            (Part::Symmetric, twin.generator.symmetric().apply(&x)),
        ] {
            let mut y = vec![f64::NAN; piece.matrix.length()];
            let mut local = piece.scatter(&x);
            piece
                .matrix
                .apply(&mut piece.exchange, part, &mut y, &mut local);
            let found = piece.gather(twin, &y);
            let name = format!("{}, {mesh:?}, {part:?}", twin.name);
            assert_close(&name, &found, &expected, 1e-14 * twin.generator.largest());
            report_bits(world, &format!("{part:?} of {}", twin.name), &found);
        }
    });
}

/// `⟨y, A x⟩ = ⟨Aᵀ y, x⟩` of what is distributed.
fn adjoint(world: &World) {
    for_every_piece(world, |twin, mesh, piece| {
        let (mut x, mut y) = (
            piece.scatter(&random(twin, 3)),
            piece.scatter(&random(twin, 4)),
        );
        let mut ax = vec![f64::NAN; piece.matrix.length()];
        let mut aty = ax.clone();
        piece
            .matrix
            .apply(&mut piece.exchange, Part::Generator, &mut ax, &mut x);
        piece
            .matrix
            .apply(&mut piece.exchange, Part::Transpose, &mut aty, &mut y);
        let product = |a: &[f64], b: &[f64], sign: fn(f64) -> f64| {
            let terms: Vec<f64> = (0..piece.matrix.counted_rows())
                .map(|i| sign(a[i] * b[i]))
                .collect();
            piece.communicator.space.sum_terms(&terms)
        };
        let (left, right) = (product(&y, &ax, |t| t), product(&aty, &x, |t| t));
        let scale = product(&y, &ax, f64::abs);
        assert!(
            (left - right).abs() <= 1e-15 * scale * (twin.size() as f64).sqrt(),
            "{} {mesh:?}: {left} {right}",
            twin.name
        );
        // The generator is not its own adjoint, or the test would see nothing.
        let mut ay = vec![f64::NAN; piece.matrix.length()];
        piece
            .matrix
            .apply(&mut piece.exchange, Part::Generator, &mut ay, &mut y);
        assert!((left - product(&ay, &x, |t| t)).abs() > 1e-6 * scale);
    });
}

/// `y ← a ((−iμS + K) x + i c x) + y + coefficient · start`, the start being real, complex or nothing.
fn one_step(world: &World) {
    let lane = |l: usize, seed| std::array::from_fn::<f64, LANES, _>(|m| noise(m * 8 + l, seed));
    let constants = StepConstants {
        scale: lane(0, 5),
        shift: lane(1, 6),
        wavenumber: lane(2, 7).map(|mu| 10.0 * mu),
        coefficient: lane(3, 8),
    };
    for_every_piece(world, |twin, mesh, piece| {
        let complex = |i: usize, l: usize, seed: u64| {
            Complex64::new(noise(i * LANES + l, seed), noise(i * LANES + l, seed + 50))
        };
        let local = |seed: u64| -> Vec<Lanes> {
            let lanes = |&i: &usize| {
                Lanes(std::array::from_fn(|l| match l < LANES {
                    true => complex(i, l, seed).re,
                    false => complex(i, l - LANES, seed).im,
                }))
            };
            let rows = piece.matrix.rows();
            let mut list: Vec<Lanes> = piece.number[..rows].iter().map(lanes).collect();
            list.resize(piece.matrix.length(), Lanes([f64::NAN; 2 * LANES]));
            list
        };
        let (y, mut x, start) = (local(20), local(21), local(22));
        let rows = piece.matrix.rows();
        let real: Vec<f64> = (piece.number[..rows].iter())
            .map(|&i| noise(i, 23))
            .collect();
        let nothing: &[()] = &[];
        let (mut plain, mut from_real, mut from_complex) = (y.clone(), y.clone(), y);
        let (matrix, exchange) = (&piece.matrix, &mut piece.exchange);
        matrix.step(exchange, &constants, None, &mut plain, &mut x, nothing);
        matrix.step(exchange, &constants, None, &mut from_real, &mut x, &real);
        matrix.step(
            exchange,
            &constants,
            None,
            &mut from_complex,
            &mut x,
            &start,
        );
        let (s, k) = (twin.generator.symmetric(), twin.generator.skew());
        let scale = twin.generator.largest() * 10.0;
        // The same to round-off by every instruction set, but for the row that is a sum over all ranks.
        for set in InstructionSet::all() {
            let mut other = local(20);
            let step = kernel::stepper_for(set);
            step(matrix, 0..rows, &constants, &mut other, &x, &start);
            for i in (0..rows).filter(|&i| Some(i) != matrix.shared_row()) {
                for (a, b) in other[i].0.iter().zip(&from_complex[i].0) {
                    let near = (a - b).abs() <= 1e-14 * scale;
                    assert!(near, "{} {mesh:?} {set:?} row {i}: {a} {b}", twin.name);
                }
            }
        }
        for l in 0..LANES {
            let [a, c, mu, coefficient] = [
                constants.scale[l],
                constants.shift[l],
                constants.wavenumber[l],
                constants.coefficient[l],
            ];
            for (local, &i) in piece.number[..piece.matrix.rows()].iter().enumerate() {
                let mut hx = Complex64::new(0.0, c) * complex(i, l, 21);
                for j in 0..twin.size() {
                    hx += Complex64::new(k.at(i, j), -mu * s.at(i, j)) * complex(j, l, 21);
                }
                let expected = a * hx + complex(i, l, 20);
                for (found, expected) in [
                    (&plain, expected),
                    (&from_real, expected + coefficient * noise(i, 23)),
                    (&from_complex, expected + coefficient * complex(i, l, 22)),
                ] {
                    let Lanes(row) = found[local];
                    let found = Complex64::new(row[l], row[LANES + l]);
                    assert!(
                        (found - expected).norm() <= 1e-14 * scale,
                        "{} {mesh:?} row {i} lane {l}: {found} {expected}",
                        twin.name
                    );
                }
            }
        }
    });
}

/// Several steps in one trip through memory have the bits of step after step, whatever the shape: strips and ranges that do
/// not divide, more levels than cells, trips of fewer steps than the blocking is made for; with the inflow of a stage too.
fn blocked_steps(world: &World) {
    const LEVELS: usize = 7;
    let shapes = [
        (2, 1, 1),
        (3, 2, 1),
        (LEVELS, 1, 3),
        (LEVELS, 3, 2),
        (LEVELS, 100, 1000),
    ];
    let levels: Vec<StepConstants> = (0..LEVELS as u64)
        .map(|k| {
            let lane = |seed| std::array::from_fn::<f64, LANES, _>(|l| noise(l, 10 * k + seed));
            StepConstants {
                scale: lane(1).map(|a| 0.01 * a),
                shift: lane(2),
                wavenumber: lane(3),
                coefficient: lane(4),
            }
        })
        .collect();
    let mut blocked = 0;
    for_every_piece(world, |twin, mesh, piece| {
        if !Blocking::possible(&piece.matrix) {
            assert!(piece.matrix.shared_row().is_some());
            return;
        }
        let rows = piece.matrix.rows();
        let vector = |seed: usize| -> Vec<Lanes> {
            let row = |i| Lanes(std::array::from_fn(|l| noise(i, (100 * seed + l) as u64)));
            let mut list: Vec<Lanes> = piece.number[..rows].iter().copied().map(row).collect();
            list.resize(piece.matrix.length(), Lanes([f64::NAN; 2 * LANES]));
            list
        };
        let start: Vec<f64> = (0..rows).map(|i| noise(i, 5)).collect();
        let couplings: Vec<f64> = (0..piece.matrix.inflow.len())
            .map(|m| noise(m, 6))
            .collect();
        for couplings in [None, Some(&couplings[..])] {
            let mut run = |blocking: Option<&Blocking>, steps: usize| {
                let (mut y, mut x) = (vector(1), vector(2));
                let (matrix, exchange) = (&piece.matrix, &mut piece.exchange);
                let vectors = (&mut y, &mut x);
                let levels = &levels[..steps];
                matrix.steps(exchange, blocking, levels, couplings, vectors, &start);
                let bits = |v: &[Lanes]| -> Vec<_> {
                    v[..rows].iter().map(|r| r.0.map(f64::to_bits)).collect()
                };
                (bits(&y), bits(&x))
            };
            for (depth, width, parts) in shapes {
                let shape = Shape {
                    depth,
                    width,
                    parts,
                };
                let blocking = Blocking::new(&piece.matrix, &shape);
                for steps in [depth, depth - 1] {
                    let same = run(Some(&blocking), steps) == run(None, steps);
                    assert!(same, "{} {mesh:?} {shape:?}, {steps} steps", twin.name);
                    blocked += 1;
                }
            }
            // A step fewer is another result, or the test would see nothing.
            assert!(run(None, LEVELS) != run(None, LEVELS - 2));
        }
    });
    assert!(blocked > 0);
}

/// Wavenumbers of a batch, from none to more than plans ask for.
const WAVENUMBERS: [f64; LANES] = [0.0, 0.05, 0.3, 1.0, 2.0, 4.0, 9.0, 20.0];

/// `exp(−i(μS + iK)T) u` for each of `wavenumbers` by Taylor series, the work dealt out to the ranks.
fn references(
    world: &World,
    weighted: &Weighted,
    wavenumbers: &[f64],
    time: f64,
) -> Vec<Vec<Complex64>> {
    let group = world.group();
    let (s, k) = (weighted.generator.symmetric(), weighted.generator.skew());
    (wavenumbers.iter().enumerate())
        .map(|(l, &mu)| {
            let mut flat = vec![f64::NEG_INFINITY; 2 * s.size];
            if l % group.size() == group.rank() {
                let state = evolve(&s, &k, mu, &weighted.state, time);
                flat = state.iter().flat_map(|z| [z.re, z.im]).collect();
            }
            group.max_into(&mut flat);
            flat.chunks(2).map(|z| Complex64::new(z[0], z[1])).collect()
        })
        .collect()
}

/// `√Σ|x_i|²`.
fn size(x: &[Complex64]) -> f64 {
    x.iter().map(|z| z.norm_sqr()).sum::<f64>().sqrt()
}

/// `‖x − y‖`.
fn apart(x: &[Complex64], y: &[Complex64]) -> f64 {
    let difference: Vec<Complex64> = x.iter().zip(y).map(|(a, b)| a - b).collect();
    size(&difference)
}

impl Weighted {
    /// Propagates the state with `wavenumbers` over `time`; the report, and `w(T)` and the leading term of its error for each
    /// mode, by the numbers of the twin.
    fn propagate(
        &mut self,
        propagator: &mut dyn Propagator,
        batch: &BatchSpec,
        time: f64,
    ) -> (BatchReport, Vec<Vec<Complex64>>, Vec<Vec<Complex64>>) {
        let (rows, unknowns) = (self.problem.matrix.rows(), self.state.len());
        let mut system = Evolution {
            matrix: &self.problem.matrix,
            exchange: &mut self.problem.exchange,
            space: &self.communicator.space,
            rate: self.bounds.rate,
            growth: self.bounds.growth,
            time,
            terms: self.problem.terms,
        };
        let initial = Initial::real(&self.problem.states[0][..rows], norm(&self.state));
        let report = (propagator.propagate(&mut system, batch, &initial)).expect("it converges");
        let all = |lanes: &[Lanes], l: usize, phase: Complex64| -> Vec<Complex64> {
            let part = |part: usize| {
                let counted = 0..self.problem.matrix.counted_rows();
                let entries = counted.map(|i| (self.number[i], lanes[i].0[part * LANES + l]));
                gather(&self.communicator.space, unknowns, entries)
            };
            (part(0).iter().zip(&part(1)))
                .map(|(&re, &im)| Complex64::new(re, im) * phase)
                .collect()
        };
        let state = |l: usize| all(propagator.state(), l, report.phases[l]);
        let error = |l: usize| all(propagator.step_error()?, l, report.phases[l]).into();
        (
            report,
            (0..batch.modes).map(state).collect(),
            (0..batch.modes).filter_map(error).collect(),
        )
    }
}

/// Against `exp(−i(μS + iK)T) u`; the norm is kept; a series that is cut keeps the promise of its tail.
fn chebyshev_propagation(world: &World) {
    for twin in Twin::all() {
        let time = twin.case.end;
        // The weights are the same on any mesh, and so is the reference.
        let mut reference = None;
        for mesh in meshes(world, &twin.case) {
            let mut weighted = Weighted::new(world, &twin, &mesh);
            let reference =
                reference.get_or_insert_with(|| references(world, &weighted, &WAVENUMBERS, time));
            let Bounds { rate, growth, .. } = weighted.bounds;
            let degrees = |tail: f64| {
                let mut series = Vec::new();
                WAVENUMBERS.map(|mu| {
                    let tau = Interval::new(mu, rate, growth).half_width * time;
                    bessel_series(&mut series, tau, tail);
                    series.len() - 1
                })
            };
            let whole = degrees(1e-16).into_iter().max().unwrap_or(0);
            let matrix = &weighted.problem.matrix;
            let shape = Shape {
                depth: 5,
                width: 2,
                parts: 2,
            };
            let blocking = Blocking::possible(matrix).then(|| Blocking::new(matrix, &shape));
            let mut chebyshev = Chebyshev::blocked(matrix, whole, None);
            let mut blocked = Chebyshev::blocked(matrix, whole, blocking);
            for tolerance in [1e-16, 1e-6] {
                let work = degrees(tolerance);
                let batch = BatchSpec {
                    modes: LANES,
                    wavenumbers: WAVENUMBERS,
                    tolerances: [tolerance; LANES],
                    work,
                };
                let (report, found, errors) = weighted.propagate(&mut chebyshev, &batch, time);
                assert!(errors.is_empty() && report.solves == 0);
                assert_eq!(report.applications, work.iter().sum::<usize>());
                let (_, same, _) = weighted.propagate(&mut blocked, &batch, time);
                assert!(same == found, "{}, {mesh:?}: blocked", twin.name);
                let full = norm(&weighted.state);
                for l in 0..LANES {
                    let error = apart(&found[l], &reference[l]) / full;
                    let change = size(&found[l]) / full - 1.0;
                    let tail = report.tails[l];
                    let at = format!(
                        "{}, {mesh:?}, mu = {}, degree {}: error {error:e}, tail {tail:e}, norm {change:e}",
                        twin.name, WAVENUMBERS[l], work[l]
                    );
                    assert!(
                        error <= 1e-12 + tail && change.abs() <= 1e-12 + tail,
                        "{at}"
                    );
                    // Each series is long enough for its lane, and no longer.
                    assert!(tail <= tolerance * (1.0 + 1e-9) + 1e-15, "{at}");
                    assert!(tolerance < 1e-9 || tail > 1e-9, "{at}");
                }
            }
        }
    }
}

/// The Krylov propagator meets each mode's tolerance, takes no more applications than planned, keeps norms, and has the
/// same bits on every mesh.
fn krylov_propagation(world: &World) {
    for mut twin in Twin::unshared() {
        let time = twin.case.end;
        let mut reference = None;
        for mesh in meshes(world, &twin.case) {
            let mut weighted = Weighted::new(world, &twin, &mesh);
            let reference =
                reference.get_or_insert_with(|| references(world, &weighted, &WAVENUMBERS, time));
            for (tolerance, step) in [(1e-11, None), (1e-4, Some(0.03 * time))] {
                twin.case.propagator = Propagation {
                    method: PropagatorMethod::Krylov,
                    step,
                };
                let mut krylov = Krylov::new(&weighted.problem.matrix, step);
                let mut scratch = Vec::new();
                let planned = WAVENUMBERS.map(|mu| {
                    work(
                        &twin.case,
                        &weighted.bounds,
                        mu,
                        (time, tolerance),
                        &mut scratch,
                    )
                });
                let batch = BatchSpec {
                    modes: LANES,
                    wavenumbers: WAVENUMBERS,
                    tolerances: [tolerance; LANES],
                    work: [0; LANES],
                };
                let (report, found, errors) = weighted.propagate(&mut krylov, &batch, time);
                assert!(errors.is_empty() && report.solves == 0 && report.unitary);
                let full = norm(&weighted.state);
                for l in 0..LANES {
                    let error = apart(&found[l], &reference[l]) / full;
                    let change = size(&found[l]) / full - 1.0;
                    let at = format!(
                        "{}, {mesh:?}, mu = {}, tolerance {tolerance:e}: error {error:e}, bound {:e}, norm {change:e}",
                        twin.name, WAVENUMBERS[l], report.tails[l]
                    );
                    assert!(report.tails[l] <= tolerance * (1.0 + 1e-9) + 1e-13, "{at}");
                    assert!(error <= 1e-12 + report.tails[l], "{at}");
                    assert!(change.abs() <= 1e-12, "{at}");
                }
                let most = planned.into_iter().max().unwrap_or(0);
                let took = report.applications / LANES;
                assert!(took <= most, "{}: {took} {most}", twin.name);
                // A long step is as long as it may be: more than a basis is used, and fewer than single steps.
                assert!(step.is_none() || took >= 34, "{}: {took}", twin.name);
                let flat: Vec<f64> = found.iter().flatten().flat_map(|z| [z.re, z.im]).collect();
                let name = format!("Krylov for {} at {tolerance:e}", twin.name);
                report_bits(world, &name, &flat);
            }
        }
    }
}

/// Crank–Nicolson converges with order 2 and keeps norms, backward Euler with order 1 and loses them; the leading term of
/// the error is the error. On every mesh.
fn orders_of_the_implicit_methods(world: &World) {
    const SLOW: [f64; 2] = [0.0, 0.5];
    let mut wavenumbers = [SLOW[1]; LANES];
    wavenumbers[..SLOW.len()].copy_from_slice(&SLOW);
    for twin in Twin::unshared() {
        let mut reference = None;
        for mesh in meshes(world, &twin.case) {
            let mut weighted = Weighted::new(world, &twin, &mesh);
            let time = 1.0 / weighted.bounds.rate;
            let reference =
                reference.get_or_insert_with(|| references(world, &weighted, &SLOW, time));
            let full = norm(&weighted.state);
            for (order, coarse) in [(2, 8), (1, 32)] {
                let mut runs = Vec::new();
                for steps in [coarse, 2 * coarse] {
                    let matrix = &weighted.problem.matrix;
                    let mut implicit = Implicit::new(matrix, order, mesh.blocks() > 1)
                        .expect("the pattern is analysed");
                    let batch = BatchSpec {
                        modes: SLOW.len(),
                        wavenumbers,
                        tolerances: [1e-6; LANES],
                        work: [steps; LANES],
                    };
                    let (report, found, errors) = weighted.propagate(&mut implicit, &batch, time);
                    assert_eq!(report.solves, SLOW.len() * steps);
                    assert!(report.applications >= report.solves);
                    assert_eq!(report.unitary, order == 2);
                    runs.push((report, found, errors));
                }
                for l in 0..SLOW.len() {
                    let error = |run: usize| apart(&runs[run].1[l], &reference[l]) / full;
                    let found = (error(0) / error(1)).log2();
                    let change = size(&runs[1].1[l]) / full - 1.0;
                    let rest: Vec<Complex64> = (runs[1].1[l].iter().zip(&runs[1].2[l]))
                        .map(|(w, e)| w - e)
                        .collect();
                    let missed = apart(&rest, &reference[l]) / full / error(1);
                    let at = format!(
                        "{}, {mesh:?}, mu = {}, order {order}: {found}, error {:e}, norm {change:e}, leading term misses {missed}",
                        twin.name,
                        SLOW[l],
                        error(1)
                    );
                    assert!((found - order as f64).abs() < 0.1, "{at}");
                    assert!(error(1) > 1e-7 && missed < 0.2, "{at}");
                    if order == 2 {
                        assert!(change.abs() <= 1e-13 + runs[1].0.tails[l], "{at}");
                        assert!(runs[1].0.tails[l] < 1e-10, "{at}");
                    } else {
                        assert!(change < -1e-6, "{at}");
                    }
                }
            }
        }
    }
}

/// Steps with `Δt‖H‖` around 1000, as in the paper's set-up, against dense solves.
fn long_implicit_steps(world: &World) {
    const STEPS: usize = 2;
    let wavenumbers = [0.0, 5.0, 370.0, 370.0, 370.0, 370.0, 370.0, 370.0];
    let batch = BatchSpec {
        modes: 3,
        wavenumbers,
        tolerances: [1e-6; LANES],
        work: [STEPS; LANES],
    };
    for twin in Twin::unshared() {
        let mut expected: BTreeMap<(usize, usize), Vec<Complex64>> = BTreeMap::new();
        for mesh in meshes(world, &twin.case) {
            let mut weighted = Weighted::new(world, &twin, &mesh);
            let step = 1000.0 / (2.0 * 370.0 * weighted.bounds.rate);
            let (s, k) = (weighted.generator.symmetric(), weighted.generator.skew());
            for order in [2, 1] {
                let matrix = &weighted.problem.matrix;
                let mut implicit = Implicit::new(matrix, order, mesh.blocks() > 1)
                    .expect("the pattern is analysed");
                let time = STEPS as f64 * step;
                let (_, found, _) = weighted.propagate(&mut implicit, &batch, time);
                for l in 0..batch.modes {
                    let mu = wavenumbers[l];
                    let expected = expected.entry((order, l)).or_insert_with(|| {
                        let a = if order == 2 { 0.5 * step } else { step };
                        let shifted = Mat::from_fn(s.size, s.size, |i, j| {
                            let unit = f64::from(u8::from(i == j));
                            Complex64::new(unit - a * k.at(i, j), a * mu * s.at(i, j))
                        });
                        let factors = shifted.partial_piv_lu();
                        let mut w =
                            Mat::from_fn(s.size, 1, |i, _| Complex64::from(weighted.state[i]));
                        for _ in 0..STEPS {
                            let z = factors.solve(&w);
                            w = if order == 2 { &z + &z - &w } else { z };
                        }
                        (0..s.size).map(|i| w[(i, 0)]).collect()
                    });
                    let error = apart(&found[l], expected) / norm(&weighted.state);
                    assert!(
                        error <= 1e-11,
                        "{}, {mesh:?}, mu = {mu}, order {order}: {error:e}",
                        twin.name
                    );
                }
            }
        }
    }
}

/// Eigenvalues of `μS + iK`, ascending.
fn eigenvalues(s: &Dense, k: &Dense, mu: f64) -> Vec<f64> {
    let h = Mat::from_fn(s.size, s.size, |i, j| {
        Complex64::new(mu * s.at(i, j), k.at(i, j))
    });
    h.self_adjoint_eigenvalues(Side::Lower)
        .expect("the eigenvalues of a Hermitian matrix")
}

/// One block, all ranks in its mode groups.
fn one_block(world: &World, case: &Case) -> Mesh {
    Mesh {
        space: vec![1; case.space.dimension()],
        groups: world.group().size(),
    }
}

/// The spectrum of `μS + iK` lies in the interval of the Chebyshev series, for what the growth is known to be.
fn spectrum_in_its_interval(world: &World) {
    let mut twins = Twin::all();
    let grid = ["axis.0.x.cells=18", "axis.0.v.cells=16"];
    let with = |set: &'static str| [grid[0], grid[1], set];
    let none = "solver.warp.weights='none'";
    let conservative = "scheme.interface='conservative'";
    twins.push(Twin::new("example 1, hat", "example1.toml", &grid));
    twins.push(Twin::new("no weights", "example1.toml", &with(none)));
    twins.push(Twin::new("well, hat", "well.toml", &grid));
    twins.push(Twin::new(
        "well, conservative",
        "well.toml",
        &with(conservative),
    ));
    let group = world.group();
    let mut turn = 0;
    for twin in twins {
        let weighted = Weighted::new(world, &twin, &one_block(world, &twin.case));
        let Bounds { rate, growth, .. } = weighted.bounds;
        let (s, k) = (weighted.generator.symmetric(), weighted.generator.skew());
        for mu in [0.0, 0.4, 2.0, 7.0, 30.0] {
            // The work dealt out to the ranks.
            turn += 1;
            if turn % group.size() != group.rank() {
                continue;
            }
            let values = eigenvalues(&s, &k, mu);
            let (low, high) = (values[0], values[values.len() - 1]);
            let holds = |growth: f64| {
                let Interval { centre, half_width } = Interval::new(mu, rate, growth);
                let slack = 1e-13 * half_width;
                centre - half_width - slack <= low && high <= centre + half_width + slack
            };
            let at = format!("{}, mu = {mu}: [{low}, {high}], growth {growth}", twin.name);
            assert!(holds(growth), "{at}");
            // The growth matters: without it the interval is too small, where weights were left out.
            if twin.name == "no weights" && mu >= 7.0 {
                assert!(!holds(0.0), "{at}");
            }
        }
    }
}

/// `½ max_j (Aᵀπ)_j/π_j` over the cells.
fn certificate(twin: &Twin, pi: &[f64]) -> f64 {
    let column = |j: usize| {
        let sum: f64 = (0..twin.cells)
            .map(|i| twin.generator.at(i, j) * pi[i])
            .sum();
        0.5 * sum / pi[j]
    };
    (0..twin.cells)
        .map(column)
        .fold(f64::NEG_INFINITY, f64::max)
}

fn dissipative_weights(world: &World) {
    for twin in Twin::all() {
        let rate = twin.generator.largest();
        let mut highest = None;
        for mesh in meshes(world, &twin.case) {
            let name = format!("{}, {mesh:?}", twin.name);
            let weighted = Weighted::new(world, &twin, &mesh);
            let weights = &weighted.problem.weights;
            let claimed = weights.certificate;
            let found = certificate(&twin, &weighted.pi);
            assert!(
                (claimed - found).abs() <= 1e-13 * rate,
                "{name}: {claimed} {found}"
            );
            assert!(weighted.pi.iter().all(|&pi| pi >= 1.0), "{name}");
            // Only trapped particles leave some growth, between walls or around an axis.
            let trapped = [
                "well",
                "periodic, a jump at the end, inflow of velocities",
                "periodic along the step",
            ];
            let trapped = trapped.contains(&twin.name);
            assert_eq!(claimed > 1e-6, trapped, "{name}: {claimed}");
            for (pi, &i) in weights.pi.iter().zip(&weighted.number) {
                assert_eq!(*pi, weighted.pi[i], "{name}: ghosts too");
            }
            for (m, &i) in twin.inflow.iter().enumerate() {
                assert_eq!(weighted.pi[twin.cells + m], weighted.pi[i], "{name}");
            }
            // The weight of a common unknown keeps Σ κ²/(2g).
            let theta = |a: &Dense| -> f64 {
                let added = |&(i, m, draw): &(usize, usize, f64)| a.at(i, m).powi(2) / (2.0 * draw);
                twin.coupled.iter().map(added).sum()
            };
            let (before, after) = (theta(&twin.generator), theta(&weighted.generator));
            assert!(
                (before - after).abs() <= 1e-13 * before,
                "{name}: {before} {after}"
            );
            let most = weighted.pi.iter().copied().fold(0.0, f64::max);
            let least = weighted.pi.iter().copied().fold(f64::INFINITY, f64::min);
            assert_eq!(weights.spread, (most / least).sqrt(), "{name}");

            // What it certifies: no eigenvalue of S above it, inflow couplings aside.
            let theta = twin.theta();
            let allowed = weighted.bounds.growth;
            if twin.coupled.is_empty() {
                assert_eq!(allowed, claimed, "{name}");
            } else {
                assert!(
                    allowed <= claimed.max(theta) * (1.0 + 1e-12),
                    "{name}: {allowed} {theta}"
                );
            }
            let highest = *highest.get_or_insert_with(|| {
                let s = weighted.generator.symmetric();
                *eigenvalues(&s, &Dense::zero(s.size), 1.0)
                    .last()
                    .expect("there are some")
            });
            assert!(
                highest <= allowed + 1e-13 * rate,
                "{name}: {highest} {allowed}"
            );

            // Without weights the certificate is half the largest column sum: larger, where weights were needed.
            let mut piece = Piece::assemble(world, &twin, &mesh);
            let space = &piece.communicator.space;
            let none = Weights::none(&piece.matrix, &mut piece.exchange, space);
            let expected = certificate(&twin, &vec![1.0; twin.size()]);
            assert!(
                (none.certificate - expected).abs() <= 1e-14 * rate,
                "{name}"
            );
            assert!(none.pi.iter().all(|&pi| pi == 1.0));
            if weighted.bounds.weighted {
                assert!(weights.sweeps > 0 && most > 1.0, "{name}");
                assert!(claimed < 0.5 * none.certificate, "{name}");
                report_bits(world, &format!("weights of {}", twin.name), &weighted.pi);
            } else {
                assert_eq!((most, claimed), (1.0, none.certificate), "{name}");
            }
        }
    }
}

fn classical_exponential(world: &World) {
    for twin in Twin::all() {
        let time = twin.case.end;
        let expected = exponential(&twin.generator, &twin.state, time);
        for mesh in meshes(world, &twin.case) {
            let name = format!("{}, {mesh:?}", twin.name);
            let mut weighted = Weighted::new(world, &twin, &mesh);
            let rate = weighted.bounds.rate;
            let problem = &mut weighted.problem;
            let mut state = problem.states[0].clone();
            Classical::new(&problem.matrix).exponential(
                &mut problem.exchange,
                &mut state,
                (rate, time),
                EXACT,
            );
            let entries = (0..problem.matrix.counted_rows()).map(|i| {
                let number = weighted.number[i];
                (number, state[i] / weighted.pi[number].sqrt())
            });
            let found = gather(&weighted.communicator.space, twin.size(), entries);
            let error = distance(&found, &expected);
            assert!(error <= 1e-13, "{name}: {error:e}");
            let change = distance(twin.field(&expected), twin.field(&twin.state));
            assert!(change > 0.1, "{name}: the state moves by {change}");
            report_bits(world, &format!("exponential of {}", twin.name), &found);
        }
    }
}

fn orders_of_the_integrators(world: &World) {
    for twin in Twin::all() {
        if twin.coupled.is_empty() {
            continue;
        }
        let time = twin.case.end;
        let expected = exponential(&twin.generator, &twin.state, time);
        for mesh in meshes(world, &twin.case) {
            let mut piece = Piece::assemble(world, &twin, &mesh);
            for (integrator, order) in [(Integrator::ForwardEuler, 1.0), (Integrator::SspRk3, 3.0)]
            {
                let coarse = (8.0 * twin.generator.largest() * time).ceil() as usize;
                let errors = [coarse, 2 * coarse].map(|steps| {
                    let mut state = piece.scatter(&twin.state);
                    Classical::new(&piece.matrix).steps(
                        &mut piece.exchange,
                        &mut state,
                        integrator,
                        time,
                        steps,
                    );
                    distance(&piece.gather(&twin, &state), &expected)
                });
                let found = (errors[0] / errors[1]).log2();
                assert!(
                    (found - order).abs() < 0.1,
                    "{}, {mesh:?}, {integrator:?}: order {found}, errors {errors:?}",
                    twin.name
                );
            }
        }
    }
}

/// `A f + b` with slopes, against the naive twin; and a step, which stays between the least and the largest value.
fn limited_slopes(world: &World) {
    for mut twin in Twin::unshared() {
        for limiter in [Limiter::Minmod, Limiter::VanLeer] {
            twin.case.limiter = limiter;
            // Noise, and data with long monotone pieces; the auxiliary unknowns hold the inflow in both.
            for data in ["noise", "waves"] {
                let mut x = twin.state.clone();
                for (i, x) in x[..twin.cells].iter_mut().enumerate() {
                    let p = twin.case.space.point(&twin.case.space.cell(i));
                    *x = match data {
                        "noise" => noise(i, 11),
                        _ => (2.0 * p[0] + 3.0 * p[1] - p[2] + 2.5 * p[3] - p[4] + p[5]).sin(),
                    };
                }
                let expected = limited_right_hand_side(&twin.case, twin.field(&x));
                let linear = twin.generator.apply(&x);
                let added = distance(&expected, twin.field(&linear));
                assert!(added > 0.01, "{}: slopes add {added}", twin.name);
                for mesh in meshes(world, &twin.case) {
                    let name = format!("{}, {mesh:?}, {limiter:?}, {data}", twin.name);
                    let mut piece = Piece::assemble(world, &twin, &mesh);
                    let mut reconstruction = Reconstruction::new(&twin.case, &piece.matrix, 0)
                        .expect("formulas are finite")
                        .expect("a limiter");
                    let rows = piece.matrix.rows();
                    let mut local = piece.scatter(&x);
                    let mut image = vec![f64::NAN; piece.matrix.length()];
                    let exchange = &mut piece.exchange;
                    (piece.matrix).apply(exchange, Part::Generator, &mut image, &mut local);
                    reconstruction.add(exchange, &mut image, &local, rows);
                    let found = piece.gather(&twin, &image);
                    let tolerance = 2e-14 * twin.generator.largest();
                    assert_close(&name, twin.field(&found), &expected, tolerance);
                    report_bits(
                        world,
                        &format!("slopes of {}, {limiter:?}, {data}", twin.name),
                        &found,
                    );

                    // One longest step of forward Euler keeps the bounds, zero being what enters.
                    if !twin.inflow.is_empty() {
                        continue;
                    }
                    let dt = longest_step(limiter) / transport_and_force(&twin);
                    let mut state = piece.scatter(&x);
                    Classical::new(&piece.matrix)
                        .with_slopes(Some(reconstruction))
                        .steps(
                            &mut piece.exchange,
                            &mut state,
                            Integrator::ForwardEuler,
                            dt,
                            1,
                        );
                    let after = piece.gather(&twin, &state);
                    let change: Vec<f64> =
                        (x.iter().zip(&expected)).map(|(x, f)| x + dt * f).collect();
                    assert_close(&name, &after, &change, 1e-13);
                    let bounds = |values: &[f64]| {
                        values
                            .iter()
                            .fold([0.0f64; 2], |[low, high], &x| [low.min(x), high.max(x)])
                    };
                    let ([low, high], [least, most]) = (bounds(&x), bounds(&after));
                    let bounded = least >= low - 1e-14 && most <= high + 1e-14;
                    assert!(bounded, "{name}: [{least}, {most}] of [{low}, {high}]");
                }
            }
        }
    }
}

/// `max |A_ii|`.
fn transport_and_force(twin: &Twin) -> f64 {
    (0..twin.cells)
        .map(|i| -twin.generator.at(i, i))
        .fold(0.0, f64::max)
}

/// Both ends of the spectrum of `S`, with and without weights, and Gershgorin's bounds, against all eigenvalues.
fn extreme_eigenvalues(world: &World) {
    for twin in Twin::all() {
        let mut expected: BTreeMap<bool, (f64, f64)> = BTreeMap::new();
        for mesh in meshes(world, &twin.case) {
            let mut weighted = Weighted::new(world, &twin, &mesh);
            let mut piece = Piece::assemble(world, &twin, &mesh);
            let terms = weighted.problem.terms;
            for with_weights in [false, true] {
                if with_weights && !weighted.bounds.weighted {
                    continue;
                }
                let s = if with_weights {
                    weighted.generator.symmetric()
                } else {
                    twin.generator.symmetric()
                };
                let (low, high) = *expected.entry(with_weights).or_insert_with(|| {
                    let values = eigenvalues(&s, &Dense::zero(s.size), 1.0);
                    (values[0], values[values.len() - 1])
                });
                let name = format!("{}, {mesh:?}, weights {with_weights}", twin.name);
                let (matrix, exchange) = if with_weights {
                    (&weighted.problem.matrix, &mut weighted.problem.exchange)
                } else {
                    (&piece.matrix, &mut piece.exchange)
                };
                let space = &piece.communicator.space;
                let [lower, upper] = gershgorin(matrix, space);
                let radius = |i: usize| -> f64 {
                    let others = s.row(i).iter().map(|x| x.abs()).sum::<f64>();
                    others - s.at(i, i).abs()
                };
                let least = (0..s.size)
                    .map(|i| s.at(i, i) - radius(i))
                    .fold(f64::INFINITY, f64::min);
                let most = (0..s.size)
                    .map(|i| s.at(i, i) + radius(i))
                    .fold(f64::NEG_INFINITY, f64::max);
                let round_off = 1e-13 * s.largest();
                assert!(
                    (lower - least).abs() <= round_off,
                    "{name}: {lower} {least}"
                );
                assert!((upper - most).abs() <= round_off, "{name}: {upper} {most}");

                let norm = lower.abs().max(upper.abs());
                let found = extremes(matrix, exchange, space, norm, terms, 2000);
                for (end, exact) in [(found.highest, high), (found.lowest, low)] {
                    let off = (end.value - exact).abs();
                    assert!(
                        off <= end.residual + round_off,
                        "{name}: {end:?}, {exact} expected"
                    );
                    // A residual is first order in the vector's error, the value second.
                    assert!(
                        end.converged && off <= 1e-7 * norm,
                        "{name}: {end:?}, {exact} expected"
                    );
                }
                // Three steps do not do, and the residual says so.
                let few = extremes(matrix, exchange, space, norm, terms, 3);
                assert!(!few.highest.converged && few.steps == 3, "{name}: {few:?}");
                assert!(
                    few.highest.value <= high + round_off && few.lowest.value >= low - round_off
                );
                report_bits(
                    world,
                    &format!("spectrum of {}, weights {with_weights}", twin.name),
                    &[
                        found.highest.value,
                        found.lowest.value,
                        found.highest.residual,
                        found.lowest.residual,
                    ],
                );
            }
        }
    }
}
/// How a field is recovered: profile, reading, coefficients, tolerance, propagator and its number of steps.
type Recovery = (
    ProfileChoice,
    RecoveryMethod,
    Coefficients,
    f64,
    PropagatorMethod,
    Option<u32>,
);

/// Profiles, readings and coefficients, with tolerances that each can afford here; propagators.
const RECOVERIES: [Recovery; 15] = {
    use Coefficients::{Analytic, Sampled};
    use ProfileChoice::{Acl, Designed, Exponential, Gaussian, LowSomma, Planned, Smooth};
    use PropagatorMethod::{BackwardEuler, Chebyshev, CrankNicolson, Krylov};
    use RecoveryMethod::{Integral, LeastSquares, Point};
    [
        (Designed, Point, Analytic, 1e-9, Chebyshev, None),
        (Designed, Integral, Analytic, 1e-7, Chebyshev, None),
        (Planned, LeastSquares, Analytic, 1e-6, Chebyshev, None),
        (Designed, Point, Analytic, 1e-9, Krylov, None),
        (Gaussian, Point, Analytic, 1e-4, Chebyshev, None),
        (Gaussian, Point, Analytic, 1e-9, Chebyshev, None),
        (Gaussian, LeastSquares, Sampled, 1e-6, Chebyshev, None),
        (LowSomma { c: None }, Point, Analytic, 1e-8, Chebyshev, None),
        (
            LowSomma { c: None },
            Integral,
            Sampled,
            1e-5,
            Chebyshev,
            None,
        ),
        (Smooth { order: 8 }, Point, Sampled, 1e-4, Chebyshev, None),
        (
            Exponential { alpha: 1.0 },
            Point,
            Sampled,
            3e-2,
            Chebyshev,
            None,
        ),
        (
            Acl { beta: 0.75 },
            LeastSquares,
            Analytic,
            3e-2,
            Chebyshev,
            None,
        ),
        (Gaussian, Point, Analytic, 1e-9, Krylov, None),
        (Gaussian, Point, Analytic, 1e-4, CrankNicolson, Some(20)),
        (Gaussian, Point, Analytic, 1e-3, BackwardEuler, Some(40)),
    ]
};

/// What each mode group keeps of a block's cells: a piece of its first axis.
fn shares(block: &Block, groups: usize) -> Vec<Range<usize>> {
    let leading = block.ranges[0].len();
    let layer = block.cells() / leading;
    (0..groups)
        .map(|group| split(&(0..leading), groups, group))
        .map(|piece| piece.start * layer..piece.end * layer)
        .collect()
}

/// What the streamed run recovers on this mesh, whole and without weights, by each reading; and its plan.
fn stream(
    world: &World,
    case: &Case,
    mesh: &Mesh,
    weighted: &mut Weighted,
    ratio: f64,
    norm: f64,
) -> (WarpPlan, Vec<Vec<f64>>) {
    let own = |plan: &Plan, group: usize| plan.layout.groups[group].clone();
    let (plan, fields, applications) = stream_in(world, case, mesh, weighted, (ratio, norm), own);
    assert_eq!(applications, plan.applications);
    (plan, fields)
}

/// The same with the batches that `batches` gives each mode group; and the applications it took.
fn stream_in(
    world: &World,
    case: &Case,
    mesh: &Mesh,
    weighted: &mut Weighted,
    (ratio, norm): (f64, f64),
    batches: impl Fn(&Plan, usize) -> Vec<Batch>,
) -> (WarpPlan, Vec<Vec<f64>>, usize) {
    let problem = &mut weighted.problem;
    let resources = Resources {
        ranks: world.group().size(),
        ranks_x: Some(mesh.space.clone()),
        memory_per_rank: None,
    };
    let plan = Plan::with_bounds(case, weighted.bounds.clone(), &resources, ratio).expect("a plan");
    assert_eq!(plan.layout.mesh, *mesh);
    let warp_plan = plan.warp.as_ref().expect("a schrodingerized run");
    let rows = problem.matrix.rows();
    let initial = Initial::real(&problem.states[0][..rows], norm);
    let mut propagator: Box<dyn Propagator> = match &problem.schedule {
        Some(schedule) => Box::new(CommutatorFree::new(&problem.matrix, warp_plan, schedule)),
        None => propagator(&plan, warp_plan, &problem.matrix).expect("a propagator"),
    };
    let mut system = Evolution {
        matrix: &problem.matrix,
        exchange: &mut problem.exchange,
        space: &weighted.communicator.space,
        rate: weighted.bounds.rate,
        growth: weighted.bounds.growth,
        time: case.end,
        terms: problem.terms,
    };
    let shares = shares(&problem.matrix.block, mesh.groups);
    let group = weighted.communicator.modes.rank();
    let recovered = warp::run(
        &Task {
            communicator: &weighted.communicator,
            warp: warp_plan,
            legs: &[Leg {
                time: system.time,
                moments_only: false,
            }],
            batches: &batches(&plan, group),
            initial: &[initial],
            shares: &shares,
            moments: None,
        },
        &mut system,
        &mut *propagator,
        &mut Progress::silent(),
        Besides::default(),
    )
    .expect("a unitary run");
    assert!(recovered.unitarity_defect.unwrap_or(0.0) <= 1.0);
    let applications = weighted
        .communicator
        .modes
        .sum_count(recovered.applications);
    let fields = recovered.fields[0].iter().map(|field| {
        assert_eq!(field.len(), shares[group].clone().len());
        let entries = shares[group]
            .clone()
            .zip(field)
            .map(|(i, u)| (weighted.number[i], u / problem.weights.pi[i].sqrt()));
        gather(&world.group(), case.space.cells(), entries)
    });
    (warp_plan.clone(), fields.collect(), applications)
}

/// The streamed run by every profile and propagator: within its tolerance of `exp(AT) f0`, or as far from it as the
/// step's error says; with the same bits on every mesh, or for every number of mode groups.
fn recovered_field(world: &World) {
    use PropagatorMethod::{BackwardEuler, Chebyshev, CrankNicolson, Krylov};
    let ranks = world.group().size();
    for mut twin in Twin::all() {
        let time = twin.case.end;
        let expected = exponential(&twin.generator, &twin.state, time);
        let expected = twin.field(&expected);
        for (profile, recovery, coefficients, tolerance, method, steps) in RECOVERIES {
            // What one unknown shares with all rows, only the Chebyshev series applies.
            if twin.case.warp.inflow == Embedding::Scalar && method != Chebyshev {
                continue;
            }
            twin.case.tolerance = tolerance;
            twin.case.warp.profile = profile;
            twin.case.warp.recovery_method = recovery;
            twin.case.warp.coefficients = coefficients;
            twin.case.propagator = Propagation {
                method,
                step: steps.map(|n| time / f64::from(n)),
            };
            let what =
                format!("{profile:?}, {recovery:?}, {coefficients:?}, {tolerance:e}, {method:?}");
            let mut unsplit: Option<Vec<f64>> = None;
            // The mesh that does not split space first.
            let mut meshes = meshes(world, &twin.case);
            meshes.sort_by_key(Mesh::blocks);
            for mesh in meshes {
                let name = format!("{}, {mesh:?}, {what}", twin.name);
                let mut weighted = Weighted::new(world, &twin, &mesh);
                let problem = &mut weighted.problem;
                let ratio = problem.probe(&weighted.communicator, weighted.bounds.rate, &[time]);
                let truth = norm(&weighted.state) / norm(expected);
                assert!(
                    (truth..1.5 * truth).contains(&ratio),
                    "{name}: {ratio} {truth}"
                );
                let resources = Resources {
                    ranks,
                    ranks_x: Some(mesh.space.clone()),
                    memory_per_rank: None,
                };
                let plan =
                    Plan::with_bounds(&twin.case, weighted.bounds.clone(), &resources, ratio)
                        .expect("a plan");
                assert_eq!(plan.layout.mesh, mesh);
                let warp_plan = plan.warp.as_ref().expect("a schrodingerized run");

                let rows = problem.matrix.rows();
                let initial = Initial::real(&problem.states[0][..rows], norm(&weighted.state));
                let mut propagator =
                    propagator(&plan, warp_plan, &problem.matrix).expect("a propagator");
                let mut system = Evolution {
                    matrix: &problem.matrix,
                    exchange: &mut problem.exchange,
                    space: &weighted.communicator.space,
                    rate: weighted.bounds.rate,
                    growth: weighted.bounds.growth,
                    time,
                    terms: problem.terms,
                };
                let shares = shares(&problem.matrix.block, mesh.groups);
                let group = weighted.communicator.modes.rank();
                let batches = &plan.layout.groups[group];
                let recovered = warp::run(
                    &Task {
                        communicator: &weighted.communicator,
                        warp: warp_plan,
                        legs: &[Leg {
                            time: system.time,
                            moments_only: false,
                        }],
                        batches,
                        initial: &[initial],
                        shares: &shares,
                        moments: None,
                    },
                    &mut system,
                    &mut *propagator,
                    &mut Progress::silent(),
                    Besides::default(),
                )
                .expect("a unitary run");
                let planned = batches.iter().flat_map(|b| &b.modes);
                let planned: usize = planned.map(|&l| warp_plan.work[l]).sum();
                let (applications, solves) = (recovered.applications, recovered.solves);
                match method {
                    Chebyshev => assert_eq!((applications, solves), (planned, 0), "{name}"),
                    Krylov => assert!(applications <= planned && solves == 0, "{name}"),
                    _ => assert_eq!(solves, planned, "{name}"),
                }
                // Who keeps norms is checked for it; what is lost is reported.
                let kept = recovered.norm_kept.expect("a state that is not zero");
                match recovered.unitarity_defect {
                    Some(defect) => assert!(defect <= 1.0 && method != BackwardEuler, "{name}"),
                    None => assert!(method == BackwardEuler && kept < 0.9999, "{name}: {kept}"),
                }
                let loss = 1.0 - kept;
                assert!(
                    method != CrankNicolson || loss.abs() < 1e-11,
                    "{name}: {loss}"
                );

                assert_eq!(recovered.fields[0].len(), 2);
                let all = |field: &Vec<f64>| {
                    assert_eq!(field.len(), shares[group].clone().len());
                    let entries = shares[group].clone().zip(field).map(|(i, u)| {
                        let number = weighted.number[i];
                        (number, u / weighted.pi[number].sqrt())
                    });
                    gather(&world.group(), twin.cells, entries)
                };
                let fields: Vec<Vec<f64>> = recovered.fields[0].iter().map(all).collect();
                let error = distance(&fields[0], expected);
                if steps.is_some() {
                    let leading = norm(&all(&recovered.step_errors[0])) / norm(expected);
                    let found = leading / error;
                    assert!((0.5..2.0).contains(&found), "{name}: {leading:e} {error:e}");
                    let name = format!("the field of {} by {method:?}", twin.name);
                    if mesh.blocks() == 1 {
                        report_bits(world, &name, &fields.concat());
                    }
                    let unsplit = unsplit.get_or_insert_with(|| fields[0].clone());
                    let difference = distance(&fields[0], unsplit);
                    // Residuals of round-off, amplified by the recovery.
                    let amplified =
                        warp_plan.amplification * norm(&weighted.state) / norm(expected);
                    let allowed = 2e-16 * f64::from(steps.unwrap_or(0)) * amplified;
                    assert!(
                        difference <= allowed,
                        "{name}, {mesh:?}: {difference:e} {allowed:e}"
                    );
                    continue;
                }
                assert!(recovered.step_errors.is_empty(), "{name}");
                assert!(error <= tolerance, "{name}: error {error:e}");
                // The second recovery point tells how large it is.
                let estimate = distance(&fields[1], &fields[0]) / warp_plan.seen / error;
                let factor = if profile == ProfileChoice::Gaussian {
                    3.0
                } else {
                    5.0
                };
                assert!(
                    (1.0 / factor..factor).contains(&estimate),
                    "{name}: {estimate}"
                );
                let name = format!("the field of {} by {what}", twin.name);
                report_bits(world, &name, &fields.concat());
            }
        }
    }
}

/// Modes dealt to the groups one by one, in batches of 1 to 8 of no order.
fn mixed(plan: &Plan, group: usize) -> Vec<Batch> {
    let (modes, groups) = (
        plan.warp.as_ref().map_or(0, |w| w.modes),
        plan.layout.groups.len(),
    );
    let mut mine: Vec<usize> = (0..modes).filter(|l| l % groups == group).collect();
    // Far ones side by side.
    mine.sort_by_key(|l| (7 * l) % 11);
    let mut batches = Vec::new();
    while !mine.is_empty() {
        let count = (batches.len() % LANES + 1).min(mine.len());
        let modes: Vec<usize> = mine.drain(..count).collect();
        batches.push(Batch { modes, cost: 0 });
    }
    batches
}

/// What is read at output times, fields and moments alone, is within the tolerance of `exp(At) f0` there, by every propagator,
/// with the same bits on every mesh that may have them; and the moments are those of the field.
fn results_before_the_end(world: &World) {
    use PropagatorMethod::{Chebyshev, CrankNicolson, Krylov};
    const PARTS: [(f64, bool); 3] = [(0.23, true), (0.4, false), (0.71, true)];
    let ranks = world.group().size();
    for mut twin in Twin::all() {
        let time = twin.case.end;
        twin.case.times = PARTS
            .map(|(part, fields)| OutputTime {
                time: part * time,
                fields,
            })
            .to_vec();
        let legs = Leg::all(&twin.case);
        assert_eq!(
            legs.iter().map(|l| l.moments_only).collect::<Vec<_>>(),
            [false, true, false, false]
        );
        let exact = [0.23, 0.4, 0.71, 1.0].map(|part| {
            twin.field(&exponential(&twin.generator, &twin.state, part * time))
                .to_vec()
        });
        let factors = VelocityFactors::new(&twin.case.space);
        for (method, tolerance) in [(Chebyshev, 1e-9), (Krylov, 1e-5), (CrankNicolson, 1e-3)] {
            if twin.case.warp.inflow == Embedding::Scalar && method != Chebyshev {
                continue;
            }
            twin.case.tolerance = tolerance;
            twin.case.propagator = Propagation {
                method,
                step: (method == CrankNicolson).then_some(time / 90.0),
            };
            for mesh in meshes(world, &twin.case) {
                if method == CrankNicolson && mesh.blocks() > 1 {
                    continue;
                }
                let name = format!("{}, {mesh:?}, {method:?}", twin.name);
                let mut weighted = Weighted::new(world, &twin, &mesh);
                let problem = &mut weighted.problem;
                let ratio = problem.probe(
                    &weighted.communicator,
                    weighted.bounds.rate,
                    &twin.case.legs(),
                );
                let largest = exact
                    .iter()
                    .map(|f| norm(&weighted.state) / norm(f))
                    .fold(1.0, f64::max);
                assert!(
                    (largest..1.5 * largest).contains(&ratio),
                    "{name}: {ratio} {largest}"
                );
                let resources = Resources {
                    ranks,
                    ranks_x: Some(mesh.space.clone()),
                    memory_per_rank: None,
                };
                let plan =
                    Plan::with_bounds(&twin.case, weighted.bounds.clone(), &resources, ratio)
                        .expect("a plan");
                let warp_plan = plan.warp.as_ref().expect("a schrodingerized run");
                let rows = problem.matrix.rows();
                let initial = Initial::real(&problem.states[0][..rows], norm(&weighted.state));
                let mut propagator =
                    propagator(&plan, warp_plan, &problem.matrix).expect("a propagator");
                let shares = shares(&problem.matrix.block, mesh.groups);
                let group = weighted.communicator.modes.rank();
                let mut system = Evolution {
                    matrix: &problem.matrix,
                    exchange: &mut problem.exchange,
                    space: &weighted.communicator.space,
                    rate: weighted.bounds.rate,
                    growth: weighted.bounds.growth,
                    time,
                    terms: problem.terms,
                };
                let moments = MomentsOf {
                    factors: &factors,
                    pi: &problem.weights.pi[..problem.matrix.block.cells()],
                };
                let recovered = warp::run(
                    &Task {
                        communicator: &weighted.communicator,
                        warp: warp_plan,
                        legs: &legs,
                        batches: &plan.layout.groups[group],
                        initial: &[initial],
                        shares: &shares,
                        moments: Some(&moments),
                    },
                    &mut system,
                    &mut *propagator,
                    &mut Progress::silent(),
                    Besides::default(),
                )
                .expect("a unitary run");
                let planned: usize = plan.layout.groups[group]
                    .iter()
                    .flat_map(|b| &b.modes)
                    .map(|&l| warp_plan.work[l])
                    .sum();
                match method {
                    Chebyshev => assert_eq!(recovered.applications, planned, "{name}"),
                    Krylov => assert!(recovered.applications <= planned, "{name}"),
                    _ => assert_eq!(recovered.solves, planned, "{name}"),
                }
                let all = |u: &[f64]| {
                    let entries = shares[group].clone().zip(u).map(|(i, u)| {
                        let number = weighted.number[i];
                        (number, u / weighted.pi[number].sqrt())
                    });
                    gather(&world.group(), twin.cells, entries)
                };
                let early = &recovered.early[0];
                let mut bits = Vec::new();
                for (found, exact) in [
                    (&early[0], &exact[0]),
                    (&early[2], &exact[2]),
                    (&recovered.fields[0][0], &exact[3]),
                ] {
                    let found = all(found);
                    let error = distance(&found, exact);
                    assert!(error <= tolerance, "{name}: {error:e}");
                    // The tolerance is not met by standing still.
                    assert!(
                        distance(twin.field(&twin.state), exact) > 10.0 * tolerance,
                        "{name}"
                    );
                    bits.extend(found);
                }
                // Sums over the velocities at each point, gathered as if they were the first cells there.
                let nv = factors.cells();
                let (sums, _) = early[1].as_chunks::<MOMENTS>();
                assert_eq!(sums.len() * nv, shares[group].len(), "{name}");
                let size = norm(&exact[1]);
                let exact: Vec<[f64; MOMENTS]> = factors.at_points(&exact[1]).collect();
                for m in 0..MOMENTS {
                    let entries = shares[group]
                        .clone()
                        .step_by(nv)
                        .zip(sums)
                        .map(|(i, sums)| (weighted.number[i] / nv, sums[m]));
                    let found = gather(&world.group(), twin.cells / nv, entries);
                    let exact: Vec<f64> = exact.iter().map(|sums| sums[m]).collect();
                    let apart: Vec<f64> = found.iter().zip(&exact).map(|(a, b)| a - b).collect();
                    // A sum of so many velocities, each in its own direction off.
                    let allowed = tolerance * factors.norms()[m] * size;
                    assert!(
                        norm(&apart) <= allowed,
                        "{name}, moment {m}: {:e} {allowed:e}",
                        norm(&apart)
                    );
                    assert!(
                        m > 0 || norm(&exact) > 100.0 * allowed,
                        "{name}, moment {m}"
                    );
                    bits.extend(found);
                }
                report_bits(
                    world,
                    &format!("results before the end of {} by {method:?}", twin.name),
                    &bits,
                );
            }
        }
    }
}

/// Where the modes of a batch are independent, or go one after the other, the field has the same bits and takes as many
/// applications whatever modes are together; a Krylov basis, whose dimension is that of the longest, is seen to have others.
fn modes_in_any_company(world: &World) {
    let methods = [
        (PropagatorMethod::Chebyshev, None),
        (PropagatorMethod::CrankNicolson, Some(5.0)),
        (PropagatorMethod::Krylov, None),
    ];
    for (method, steps) in methods {
        let mut alike = true;
        for mut twin in Twin::unshared() {
            let time = twin.case.end;
            twin.case.tolerance = 1e-4;
            twin.case.propagator = Propagation {
                method,
                step: steps.map(|n| time / n),
            };
            for mesh in meshes(world, &twin.case) {
                let mut weighted = Weighted::new(world, &twin, &mesh);
                let size = norm(&weighted.state);
                let mut run = |batches: fn(&Plan, usize) -> Vec<Batch>| {
                    let case = &twin.case;
                    let found = stream_in(world, case, &mesh, &mut weighted, (2.0, size), batches);
                    let bits = found.1.concat().into_iter().map(f64::to_bits);
                    (bits.collect::<Vec<u64>>(), found.2)
                };
                let planned = run(|plan, group| plan.layout.groups[group].clone());
                let mixed = run(mixed);
                let same = planned == mixed;
                alike &= same;
                let name = format!("{}, {mesh:?}, {method:?}", twin.name);
                assert!(same || company(method) == Company::Coupled, "{name}");
            }
        }
        assert_eq!(alike, company(method) != Company::Coupled, "{method:?}");
    }
    for scene in Varying::all() {
        let mut case = scene.twin.case.clone();
        case.tolerance = 1e-4;
        for mesh in meshes(world, &case) {
            let mut weighted = scene.weighted(world, &case, &mesh);
            let size =
                (weighted.problem).norm(&weighted.communicator, &weighted.problem.states[0], false);
            let mut run = |batches: fn(&Plan, usize) -> Vec<Batch>| {
                let found = stream_in(world, &case, &mesh, &mut weighted, (2.0, size), batches);
                let bits = found.1.concat().into_iter().map(f64::to_bits);
                (bits.collect::<Vec<u64>>(), found.2)
            };
            let planned = run(|plan, group| plan.layout.groups[group].clone());
            assert!(run(mixed) == planned, "{}, {mesh:?}", scene.name);
        }
    }
}

/// Several fields on one matrix and in one pass over the modes have the bits they have alone, on every mesh the same.
fn fields_in_one_pass(world: &World) {
    let sizes = [("x", 0, 4), ("v", 0, 3), ("x", 1, 5), ("v", 1, 4)];
    let mut settings: Vec<String> = (sizes.iter())
        .map(|(kind, axis, cells)| format!("axis.{axis}.{kind}.cells={cells}"))
        .collect();
    settings.push("solver.tolerance=1e-5".to_owned());
    let settings: Vec<&str> = settings.iter().map(String::as_str).collect();
    let case = case("example3.toml", &settings);
    assert_eq!(case.fields.len(), 3);
    for mesh in meshes(world, &case) {
        let communicator = Communicator::new(world, &mesh);
        let block = Block::new(&case.space, &mesh, communicator.space.rank());
        let bounds = Bounds::new(&case).expect("V is finite");
        let sizes = (2 * LANES, 100);
        let mut problem =
            Problem::new(&case, &bounds, &communicator, block, sizes).expect("weights are found");
        let bounds = problem.bounds(&case, &bounds);
        let resources = Resources {
            ranks: world.group().size(),
            ranks_x: Some(mesh.space.clone()),
            memory_per_rank: None,
        };
        let plan = Plan::with_bounds(&case, bounds.clone(), &resources, 2.0).expect("a plan");
        let warp_plan = plan.warp.as_ref().expect("a schrodingerized run");
        let rows = problem.matrix.rows();
        let initial: Vec<Initial<'_>> = (problem.states.iter())
            .map(|state| Initial::real(&state[..rows], problem.norm(&communicator, state, false)))
            .collect();
        let shares = shares(&problem.matrix.block, mesh.groups);
        let mut system = Evolution {
            matrix: &problem.matrix,
            exchange: &mut problem.exchange,
            space: &communicator.space,
            rate: bounds.rate,
            growth: bounds.growth,
            time: case.end,
            terms: problem.terms,
        };
        let mut recover = |initial: &[Initial<'_>]| {
            let mut propagator = propagator(&plan, warp_plan, system.matrix).expect("a propagator");
            let recovered = warp::run(
                &Task {
                    communicator: &communicator,
                    warp: warp_plan,
                    legs: &[Leg {
                        time: system.time,
                        moments_only: false,
                    }],
                    batches: &plan.layout.groups[communicator.modes.rank()],
                    initial,
                    shares: &shares,
                    moments: None,
                },
                &mut system,
                &mut *propagator,
                &mut Progress::silent(),
                Besides::default(),
            );
            recovered.expect("a unitary run")
        };
        let together = recover(&initial);
        assert_eq!(together.fields.len(), 3);
        let mut applications = 0;
        for (k, field) in initial.iter().enumerate() {
            let alone = recover(std::slice::from_ref(field));
            applications += alone.applications;
            for (a, b) in alone.fields[0].iter().zip(&together.fields[k]) {
                let same = a.iter().zip(b).all(|(a, b)| a.to_bits() == b.to_bits());
                assert!(same, "field {k}, {mesh:?}");
                let moves = a.iter().any(|a| *a != 0.0);
                assert!(moves || a.is_empty(), "field {k}, {mesh:?}");
            }
        }
        assert_eq!(together.applications, applications);
    }
}

/// A run with `u = e^{σt} ũ` against the sum over the modes of a matrix that really is `A − σ`: the program shifts only what it
/// reads.
fn shifted_field(world: &World) {
    for (sigma, name) in [(0.8, "slopes, inflow"), (-0.5, "example 1")] {
        let mut twin = (Twin::all().into_iter().find(|t| t.name == name)).expect("a twin");
        let time = twin.case.end;
        twin.case.warp.shift = Shift::Given(sigma);
        twin.case.tolerance = 1e-7;
        let mut reference: Option<Vec<f64>> = None;
        for mesh in meshes(world, &twin.case) {
            let mut weighted = Weighted::new(world, &twin, &mesh);
            let size = norm(&weighted.state);
            let (plan, fields) = stream(world, &twin.case, &mesh, &mut weighted, 3.0, size);
            let twin = &twin;
            let reference = reference.get_or_insert_with(|| {
                let mut shifted = weighted.generator.symmetric();
                (0..shifted.size).for_each(|i| shifted.add(i, i, -sigma));
                let k = weighted.generator.skew();
                let mut sum = vec![0.0; twin.size()];
                for l in 0..plan.modes {
                    let mu = plan.series.wavenumber(l);
                    // e^{σT} e^{p◇} ṽ(p◇) at p◇ = 0.
                    let factor = (sigma * time).exp() * plan.series.factor(l);
                    let mode = evolve(&shifted, &k, mu, &weighted.state, time);
                    for (sum, w) in sum.iter_mut().zip(mode) {
                        *sum += (factor * w).re;
                    }
                }
                let unweighted = sum.iter().zip(&weighted.pi).map(|(u, pi)| u / pi.sqrt());
                unweighted.take(twin.cells).collect()
            });
            let error = distance(&fields[0], reference);
            // But for the series, each cut at its share.
            assert!(error <= 1e-8, "{name}, {mesh:?}: {error:e}");
            let expected = exponential(&twin.generator, &twin.state, time);
            let error = distance(&fields[0], twin.field(&expected));
            assert!(error <= 1e-7, "{name}, {mesh:?}: {error:e}");
        }
    }
}

/// Scenes with an inflow `b(1 + sin ωt)`, and `f(T)` by one dense exponential: `1`, `sin ωt` and `cos ωt` obey a linear system.
struct Varying {
    name: &'static str,
    twin: Twin,
    expected: Vec<f64>,
}

impl Varying {
    /// The problem of `case`, one like this scene's, on `mesh`; without a dense twin.
    fn weighted(&self, world: &World, case: &Case, mesh: &Mesh) -> Weighted {
        let communicator = Communicator::new(world, mesh);
        let block = Block::new(&case.space, mesh, communicator.space.rank());
        let allowed = Bounds::new(case).expect("V is finite");
        let sizes = (2 * LANES, 100);
        let problem = Problem::new(case, &allowed, &communicator, block, sizes)
            .expect("weights and steps are found");
        Weighted {
            number: numbers(&self.twin, &problem.matrix),
            bounds: problem.bounds(case, &allowed),
            communicator,
            problem,
            pi: Vec::new(),
            generator: Dense::zero(0),
            state: Vec::new(),
        }
    }

    fn all() -> Vec<Self> {
        let omega = 3.0;
        let scene = |name, file: &str, formula: &str, overrides: &[&str]| {
            let with = |time: &str| {
                let value = format!("inflow.value='({formula})*{time}'");
                let mut all = overrides.to_vec();
                all.push(&value);
                Twin::new(name, file, &all)
            };
            // The twin with the inflow at time zero gives A and b; its auxiliary unknowns are left alone.
            let constant = with("1");
            let cells = constant.cells;
            let system = System::of_rows(&constant.case);
            let mut dense = Dense::from_fn(cells + 3, |i, j| match i < cells && j < cells {
                true => system.generator.at(i, j),
                false => 0.0,
            });
            let mut state = constant.field(&constant.state).to_vec();
            for (i, &b) in system.inflow.iter().enumerate() {
                dense.add(i, cells, b);
                dense.add(i, cells + 1, b);
            }
            dense.add(cells + 1, cells + 2, omega);
            dense.add(cells + 2, cells + 1, -omega);
            state.extend([1.0, 0.0, 1.0]);
            let mut expected = exponential(&dense, &state, constant.case.end);
            expected.truncate(cells);
            let mut twin = with(&format!("(1 + sin({omega}*t))"));
            // Rows that draw on the inflow have an unknown, whatever enters now.
            if twin.case.warp.inflow == Embedding::Boundary {
                twin.inflow = (0..cells).filter(|&i| system.draw[i] > 0.0).collect();
            }
            let unknowns =
                twin.inflow.len() + usize::from(twin.case.warp.inflow == Embedding::Scalar);
            twin.generator = Dense::zero(cells + unknowns);
            Self {
                name,
                twin,
                expected,
            }
        };
        let slopes = [
            "axis.0.x.cells=7",
            "axis.0.v={lower=-1.0,upper=1.3,cells=9}",
        ];
        let with = |more: &[&'static str]| [&slopes[..], more].concat();
        let formula = "1 + x + 2*v";
        vec![
            scene("varying", "slope_jump.toml", formula, &with(&[])),
            scene(
                "varying, full",
                "slope_jump.toml",
                "0.9 + x + 2*v",
                &with(&["solver.warp.inflow='full'", "solver.warp.delta='max'"]),
            ),
            scene(
                "varying, scalar",
                "slope_jump.toml",
                "1.1 + x + 2*v",
                &with(&["solver.warp.inflow='scalar'"]),
            ),
            scene(
                "varying, two dimensions",
                "barrier2d.toml",
                "1 if x < -1.2 else 0",
                &[
                    "axis.0.x.cells=5",
                    "axis.0.v.cells=3",
                    "axis.1.x.cells=4",
                    "axis.1.v.cells=4",
                ],
            ),
        ]
    }
}

/// Duhamel's formula to round-off; forward Euler, SSP-RK3 and the commutator-free stages with their orders.
fn varying_inflow_directly(world: &World) {
    for scene in Varying::all() {
        let (case, expected) = (&scene.twin.case, &scene.expected);
        let time = case.end;
        for mesh in meshes(world, case) {
            let name = format!("{}, {mesh:?}", scene.name);
            let communicator = Communicator::new(world, &mesh);
            let block = Block::new(&case.space, &mesh, communicator.space.rank());
            let direct = Case {
                method: Method::Classical,
                ..case.clone()
            };
            let bounds = Bounds::new(&direct).expect("V is finite");
            let mut problem = Problem::new(&direct, &bounds, &communicator, block, (1, 100))
                .expect("no weights are needed");
            assert!(problem.schedule.is_none());
            let rate = bounds.rate;
            let number = numbers(&scene.twin, &problem.matrix);
            let cells = problem.matrix.block.cells();
            let pi = problem.weights.pi.clone();
            let mut run =
                |work: &mut dyn FnMut(&mut Classical<'_>, &mut GhostExchange, &mut [f64])| {
                    let mut state = problem.states[0].clone();
                    let mut classical =
                        Classical::new(&problem.matrix).with_source(&case.fields[0], &pi);
                    work(&mut classical, &mut problem.exchange, &mut state);
                    let entries = (0..cells).map(|i| (number[i], state[i]));
                    gather(&communicator.space, scene.twin.cells, entries)
                };
            let found = run(&mut |classical, exchange, state| {
                classical.duhamel(exchange, state, (rate, time), duhamel_panels(rate * time));
            });
            let error = distance(&found, expected);
            assert!(error <= 1e-12, "{name}: Duhamel {error:e}");
            report_bits(world, &format!("Duhamel of {}", scene.name), &found);

            let order =
                |name: &str, order: f64, coarse: usize, run: &mut dyn FnMut(usize) -> Vec<f64>| {
                    let errors = [coarse, 2 * coarse].map(|steps| distance(&run(steps), expected));
                    let found = (errors[0] / errors[1]).log2();
                    assert!(
                        (found - order).abs() < 0.25,
                        "{name}: order {found}, {errors:?}"
                    );
                };
            let steps = (8.0 * rate * time).ceil() as usize;
            for (integrator, theory) in [(Integrator::ForwardEuler, 1.0), (Integrator::SspRk3, 3.0)]
            {
                order(
                    &format!("{name}, {integrator:?}"),
                    theory,
                    steps,
                    &mut |steps| {
                        run(&mut |classical, exchange, state| {
                            classical.steps(exchange, state, integrator, time, steps);
                        })
                    },
                );
            }
            let block = Block::new(&case.space, &mesh, communicator.space.rank());
            let matrix = BlockMatrix::assemble(case, block).expect("finite formulas");
            order(&format!("{name}, commutator-free"), 4.0, 16, &mut |steps| {
                let values = varying::stage_values(case, &matrix, steps);
                let rows = matrix.inflow.len();
                run(&mut |classical, exchange, state| {
                    for stage in 0..2 * steps {
                        let held = &values[stage * rows..(stage + 1) * rows];
                        classical.hold(held.iter().copied());
                        let part = time / (2 * steps) as f64;
                        classical.exponential(exchange, state, (rate, part), EXACT);
                    }
                })
            });
        }
    }
}

/// The streamed run with an inflow that varies, within its tolerance, its steps within their share of it; the same bits on
/// every mesh.
fn varying_inflow_by_modes(world: &World) {
    for mut scene in Varying::all() {
        for tolerance in [1e-4, 1e-8] {
            scene.twin.case.tolerance = tolerance;
            for mesh in meshes(world, &scene.twin.case) {
                let name = format!("{}, {mesh:?}, {tolerance:e}", scene.name);
                let twin = &scene.twin;
                let mut weighted = scene.weighted(world, &twin.case, &mesh);
                let (problem, bounds) = (&mut weighted.problem, &weighted.bounds);
                let schedule = problem.schedule.as_ref().expect("steps");
                assert!(schedule.error <= varying::TIME_SHARE * tolerance, "{name}");
                assert_eq!(bounds.stages, 2 * schedule.steps);
                let communicator = &weighted.communicator;
                let ratio = problem.probe(communicator, bounds.rate, &[twin.case.end]);
                let size = problem.norm(communicator, &problem.states[0], false);
                let (_, fields) = stream(world, &twin.case, &mesh, &mut weighted, ratio, size);
                let error = distance(&fields[0], &scene.expected);
                assert!(error <= tolerance, "{name}: error {error:e}");
                let name = format!("the field of {} at {tolerance:e}", scene.name);
                report_bits(world, &name, &fields.concat());
            }
        }
    }
}
