//! The run loop allocates nothing: a counting allocator around the propagation of a batch by each propagator.

use phasewarp::base::progress::Progress;
use phasewarp::matrix::bounds::Bounds;
use phasewarp::matrix::lanes::LANES;
use phasewarp::parallel::communicator::{Communicator, World};
use phasewarp::parallel::partition::{Block, Mesh};
use phasewarp::plan::Plan;
use phasewarp::plan::layout::Resources;
use phasewarp::problem::case::{Case, Integrator};
use phasewarp::propagate::chebyshev::Chebyshev;
use phasewarp::propagate::classical::Classical;
use phasewarp::propagate::implicit::Implicit;
use phasewarp::propagate::krylov::Krylov;
use phasewarp::propagate::limiter::Reconstruction;
use phasewarp::propagate::method::{BatchSpec, Evolution, Initial, Propagator};
use phasewarp::propagate::propagator;
use phasewarp::solve::modes;
use phasewarp::solve::modes::{Besides, Leg, Task};
use phasewarp::solve::system::Problem;
use std::alloc::{GlobalAlloc, Layout, System};
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

struct Counting;

static ALLOCATIONS: AtomicUsize = AtomicUsize::new(0);

// SAFETY: the system's allocator, counted.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
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

/// The propagator that a run of `case` would have.
fn streamed(communicator: &Communicator, case: &Case, mesh: &Mesh, name: &str) {
    let allowed = Bounds::new(case).expect("V is finite");
    let block = Block::new(&case.space, mesh, 0);
    let sizes = (2 * LANES, 100);
    let mut problem = Problem::new(case, &allowed, communicator, block, sizes).expect("a problem");
    let bounds = problem.bounds(case, &allowed);
    let resources = Resources {
        ranks: 1,
        ..Resources::default()
    };
    let plan = Plan::with_bounds(case, bounds.clone(), &resources, 2.0).expect("a plan");
    let warp = plan.warp.as_ref().expect("a schrodingerized run");
    let setting = plan.propagator_setting(warp);
    let mut propagator =
        propagator(&setting, problem.schedule.as_ref(), &problem.matrix).expect("a propagator");
    let state = &problem.states[0];
    let rows = problem.matrix.rows();
    let initial = Initial::real(&state[..rows], problem.norm(communicator, state, false));
    let mut system = Evolution {
        matrix: &problem.matrix,
        exchange: &mut problem.exchange,
        space: &communicator.space,
        rate: bounds.rate,
        growth: bounds.growth,
        time: case.end,
        terms: problem.terms,
    };
    for work in [3, warp.largest_work() / 2, warp.largest_work()] {
        let batch = BatchSpec {
            modes: LANES,
            wavenumbers: std::array::from_fn(|l| 0.2 * l as f64),
            tolerances: [1e-8; LANES],
            work: [work; LANES],
        };
        let count = allocations(|| {
            let report = propagator.propagate(&mut system, &batch, &initial);
            assert!(report.is_ok_and(|r| r.applications > 0));
        });
        assert_eq!(count, 0, "{name}: allocations at degree {work}");
    }
    // The whole of a run, readings and sums included: as many for one batch as for all.
    let cells = problem.matrix.block.cells();
    let batches = &plan.layout.groups[0];
    assert!(batches.len() > 1, "{name}");
    let few = [1, batches.len()].map(|count| {
        allocations(|| {
            let recovered = modes::run(
                &Task {
                    communicator,
                    warp,
                    legs: &[Leg {
                        time: system.time,
                        moments_only: false,
                    }],
                    batches: &batches[..count],
                    initial: &[initial],
                    shares: std::slice::from_ref(&(0..cells)),
                    moments: None,
                },
                &mut system,
                &mut *propagator,
                &mut Progress::silent(),
                Besides::default(),
            );
            drop(recovered.expect("a unitary run"));
        })
    });
    assert_eq!(
        few[0], few[1],
        "{name}: allocations of one batch and of all"
    );
}

fn main() {
    let world = World::start().expect("MPI starts");
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("cases/example1.toml");
    let set = ["axis.0.x.cells=24", "axis.0.v.cells=17"].map(str::to_owned);
    let case = Case::load(&path, &set).expect("a case of the repository");
    let bounds = Bounds::new(&case).expect("V is finite");
    let mesh = Mesh {
        space: vec![1],
        groups: 1,
    };
    let communicator = Communicator::new(&world, &mesh);
    let block = Block::new(&case.space, &mesh, 0);
    let sizes = (2 * LANES, 100);
    let mut problem = Problem::new(&case, &bounds, &communicator, block, sizes).expect("a problem");
    let rows = problem.matrix.rows();
    let norm = problem.norm(&communicator, &problem.states[0], false);
    let initial = Initial::real(&problem.states[0][..rows], norm);
    let mut system = Evolution {
        matrix: &problem.matrix,
        exchange: &mut problem.exchange,
        space: &communicator.space,
        rate: bounds.rate,
        growth: bounds.growth,
        time: case.end,
        terms: problem.terms,
    };
    let mut count = |propagator: &mut dyn Propagator, work: usize| {
        let batch = BatchSpec {
            modes: LANES,
            wavenumbers: std::array::from_fn(|l| 0.2 * l as f64),
            tolerances: [1e-8; LANES],
            work: [work; LANES],
        };
        allocations(|| {
            let report = propagator.propagate(&mut system, &batch, &initial);
            assert!(report.is_ok_and(|r| r.applications > 0));
        })
    };
    let mut chebyshev = Chebyshev::new(&problem.matrix, 100);
    for degree in [3, 40, 100] {
        let count = count(&mut chebyshev, degree);
        assert_eq!(count, 0, "allocations at degree {degree}");
    }
    let mut krylov = Krylov::new(&problem.matrix, None);
    assert_eq!(count(&mut krylov, 0), 0, "allocations of Lanczos");
    // Implicit methods allocate where they factorise, once for each mode, and never in the time loop.
    for order in [1, 2] {
        let few = [1, 2, 50].map(|steps| {
            let made = Implicit::new(&problem.matrix, order, false);
            let mut implicit = made.expect("the pattern is analysed");
            // The factors' room grows with the first modes.
            count(&mut implicit, steps);
            count(&mut implicit, steps)
        });
        assert_eq!(few, [few[0]; 3], "allocations of 1, 2 and 50 steps");
    }
    // The classical steps, with slopes.
    let set = [
        "axis.0.x.cells=24",
        "axis.0.v.cells=17",
        "solver.method=classical",
        "scheme.limiter=van-leer",
        "solver.classical.integrator=ssp-rk3",
    ];
    let path = path.with_file_name("slope_jump.toml");
    let case = Case::load(&path, &set.map(str::to_owned)).expect("a case of the repository");
    let bounds = Bounds::new(&case).expect("V is finite");
    let block = Block::new(&case.space, &mesh, 0);
    let mut problem =
        Problem::new(&case, &bounds, &communicator, block, (1, 100)).expect("a problem");
    let slopes = Reconstruction::new(&case, &problem.matrix, 0).expect("formulas are finite");
    assert!(slopes.is_some());
    let mut classical = Classical::new(&problem.matrix).with_slopes(slopes);
    for integrator in [Integrator::ForwardEuler, Integrator::SspRk3] {
        let (exchange, state) = (&mut problem.exchange, &mut problem.states[0]);
        let count = allocations(|| classical.steps(exchange, state, integrator, 0.1, 10));
        assert_eq!(count, 0, "allocations of {integrator:?}");
    }
    // Every embedding of the inflow, and one that varies.
    for (name, more) in [
        ("inflow_barrier", "solver.warp.inflow=scalar"),
        ("pulsed_inflow", "solver.tolerance=1e-2"),
        ("example1", "solver.tolerance=1e-6"),
    ] {
        let path = path.with_file_name(format!("{name}.toml"));
        let set = ["axis.0.x.cells=24", "axis.0.v.cells=17", more].map(str::to_owned);
        let case = Case::load(&path, &set).expect("a case of the repository");
        streamed(&communicator, &case, &mesh, name);
    }
    // A control: the counter counts.
    assert!(allocations(|| drop(std::hint::black_box(vec![1.0; 100]))) > 0);
    println!("1 passed, 0 failed");
}
