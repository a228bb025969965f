//! Tests that the time loop allocates nothing. An allocator counts the allocations of a batch by
//! each propagator, of classical steps, and of runs with one batch and with all batches.

mod support;

use phasewarp::base::progress::Progress;
use phasewarp::matrix::blocking::fastest::FastestBlocking;
use phasewarp::matrix::blocking::{Blocking, BlockingShape};
use phasewarp::matrix::lanes::LANES;
use phasewarp::matrix::observables::{MomentsOf, VelocityFactors};
use phasewarp::parallel::communicator::World;
use phasewarp::parallel::partition::ProcessMesh;
use phasewarp::plan::Plan;
use phasewarp::plan::layout::Resources;
use phasewarp::problem::case::{Case, Integrator};
use phasewarp::propagate::chebyshev::Chebyshev;
use phasewarp::propagate::classical::Classical;
use phasewarp::propagate::evolution::{BatchSpec, SeriesSize};
use phasewarp::propagate::implicit::Implicit;
use phasewarp::propagate::krylov::Krylov;
use phasewarp::propagate::limiter::Reconstruction;
use phasewarp::propagate::method::Propagator;
use phasewarp::solve::modes::{self, RunHooks};
use phasewarp::solve::stage::Task;
use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};
use support::dense::case;
use support::prepared::{Parts, Prepared, parts, prepare};

struct Counting;

static ALLOCATIONS: AtomicUsize = AtomicUsize::new(0);

// SAFETY: all calls go to the system's allocator; only a counter is added.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
        // SAFETY: what the caller promises is what the system's allocator asks.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { System.dealloc(at, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn allocations(work: impl FnOnce()) -> usize {
    let before = ALLOCATIONS.load(Ordering::Relaxed);
    work();
    ALLOCATIONS.load(Ordering::Relaxed) - before
}

fn main() {
    // MPI starts once in a process.
    let world = World::start().expect("MPI starts");
    let checks = [the_counter_counts, series_and_lanczos, implicit_steps, classical_steps, runs];
    for check in checks {
        check(&world);
    }
    println!("{} passed, 0 failed", checks.len());
}

/// A case of the repository on 24 × 17 cells, with further overrides.
fn small(file: &str, set: &[&str]) -> Case {
    let cells = ["axis.0.x.cells=24", "axis.0.v.cells=17"];
    case(file, &[&cells, set].concat())
}

/// A case prepared on one rank.
fn prepared(world: &World, case: &Case) -> Prepared {
    let mesh = ProcessMesh { space: vec![1], groups: 1 };
    prepare(world, case, &mesh)
}

/// Control: an allocation is counted.
fn the_counter_counts(_: &World) {
    assert!(allocations(|| drop(std::hint::black_box(vec![1.0; 100]))) > 0);
}

/// The number of allocations of a propagator for a full batch, with `work` terms or steps.
fn of_a_batch(parts: &mut Parts<'_>, propagator: &mut dyn Propagator, work: usize) -> usize {
    let batch = BatchSpec {
        modes: LANES,
        wavenumbers: std::array::from_fn(|l| 0.2 * l as f64),
        tolerances: [1e-8; LANES],
        work: [work; LANES],
    };
    // The plan of a run does this for all of its modes.
    for mu in batch.wavenumbers {
        parts.evolution.bounds.interval(mu);
    }
    allocations(|| {
        let report = propagator.propagate(&mut parts.evolution, &batch, &parts.initial[0]);
        assert!(report.is_ok_and(|r| r.applications > 0));
    })
}

/// Neither the Chebyshev series nor Lanczos allocates anything.
fn series_and_lanczos(world: &World) {
    let case = small("example1.toml", &[]);
    let mut prepared = prepared(world, &case);
    let mut parts = parts(&mut prepared, case.end);
    let size = SeriesSize { largest_degree: 100, applications: 1000 };
    let mut chebyshev = Chebyshev::new(parts.evolution.matrix, size);
    let shape = |depth| BlockingShape { depth, width: 1, parts: 1 };
    let several = [Some(4), Some(7), None];
    let several = several.map(|d| d.map(|d| Blocking::new(parts.evolution.matrix, &shape(d))));
    let several = FastestBlocking::of(several.into());
    let mut blocked = Chebyshev::blocked(parts.evolution.matrix, 100, several);
    for degree in [3, 40, 100] {
        let count = of_a_batch(&mut parts, &mut chebyshev, degree);
        assert_eq!(count, 0, "allocations at degree {degree}");
        let count = of_a_batch(&mut parts, &mut blocked, degree);
        assert_eq!(count, 0, "allocations of blocked steps at degree {degree}");
    }
    let mut krylov = Krylov::new(parts.evolution.matrix, None);
    let count = of_a_batch(&mut parts, &mut krylov, 0);
    assert_eq!(count, 0, "allocations of Lanczos");
}

/// Implicit methods allocate in the factorisation, once for each mode, and never in the time loop.
fn implicit_steps(world: &World) {
    let case = small("example1.toml", &[]);
    let mut prepared = prepared(world, &case);
    let mut parts = parts(&mut prepared, case.end);
    for order in [1, 2] {
        let few = [1, 2, 50].map(|steps| {
            let implicit = Implicit::new(parts.evolution.matrix, order, false);
            let mut implicit = implicit.expect("the pattern is analysed");
            of_a_batch(&mut parts, &mut implicit, steps);
            of_a_batch(&mut parts, &mut implicit, steps)
        });
        assert_eq!(few, [few[0]; 3], "allocations of 1, 2 and 50 steps");
    }
}

/// Classical time steps with limited slopes allocate nothing.
fn classical_steps(world: &World) {
    let set = [
        "solver.method=classical",
        "scheme.limiter=van-leer",
        "solver.classical.integrator=ssp-rk3",
    ];
    let case = small("slope_jump.toml", &set);
    let system = &mut prepared(world, &case).system;
    let slopes = Reconstruction::new(&case, &system.matrix, 0).expect("formulas are finite");
    assert!(slopes.is_some());
    let mut classical = Classical::new(&system.matrix).with_slopes(slopes);
    for integrator in [Integrator::ForwardEuler, Integrator::SspRk3] {
        let (exchange, state) = (&mut system.exchange, &mut system.states[0]);
        let count = allocations(|| classical.steps(exchange, state, integrator, 0.1, 10));
        assert_eq!(count, 0, "allocations of {integrator:?}");
    }
}

/// Runs with a shared inflow unknown, with a time-dependent inflow, without inflow, and with
/// elements, each with the propagator of its plan.
fn runs(world: &World) {
    for (file, set) in [
        ("inflow_barrier.toml", "solver.warp.inflow=scalar"),
        ("pulsed_inflow.toml", "solver.tolerance=1e-2"),
        ("example1.toml", "solver.tolerance=1e-6"),
    ] {
        allocations_of_a_run(world, &small(file, &[set]), file);
    }
    let many = small("example1.toml", &["output.moments_every=0.05"]);
    allocations_of_a_run(world, &many, "moments on the way");
    for (file, set) in [
        ("inflow_barrier.toml", "scheme.degree=2"),
        ("smooth-beams.toml", "axis.0.v.degree=3"),
        ("partial_reflection.toml", "solver.tolerance=1e-10"),
    ] {
        let set = ["axis.0.x.cells=8", "axis.0.v.cells=6", set];
        allocations_of_a_run(world, &small(file, &set), &format!("elements of {file}"));
    }
}

fn allocations_of_a_run(world: &World, case: &Case, name: &str) {
    let mut prepared = prepared(world, case);
    let resources = Resources { ranks: 1, ..Resources::default() };
    let plan = Plan::with_bounds(case, prepared.bounds.clone(), &resources, 2.0).expect("a plan");
    let warp = plan.warp.as_ref().expect("a schrodingerized run");
    let mut parts = parts(&mut prepared, case.end);
    let mut propagator = parts.propagator(&plan);
    for work in [3, warp.largest_work() / 2, warp.largest_work()] {
        let count = of_a_batch(&mut parts, &mut *propagator, work);
        assert_eq!(count, 0, "{name}: allocations at degree {work}");
    }
    // A whole run with its readings and sums allocates as often for one batch as for all batches.
    let cells = 0..parts.pi.len();
    let batches = &plan.layout.groups[0];
    let passes = warp.legs.iter().any(|leg| !leg.passed.is_empty());
    assert_eq!(passes, !case.output.times.is_empty(), "{name}");
    let factors = VelocityFactors::new(&case.space);
    let moments = MomentsOf { factors: &factors, pi: parts.pi, least: 1.0 };
    assert!(batches.len() > 1, "{name}");
    let few = [1, batches.len()].map(|count| {
        allocations(|| {
            let task = Task {
                communicator: parts.communicator,
                warp,
                legs: &warp.legs,
                batches: &batches[..count],
                initial: &parts.initial,
                shares: std::slice::from_ref(&cells),
                moments: Some(&moments),
            };
            let (system, progress) = (&mut parts.evolution, &mut Progress::silent());
            let recovered =
                modes::run(&task, system, &mut *propagator, progress, RunHooks::default());
            drop(recovered.expect("a unitary run"));
        })
    });
    assert_eq!(few[0], few[1], "{name}: allocations of one batch and of all");
}
