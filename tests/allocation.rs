//! The run loop allocates nothing: a counting allocator around the propagation of a batch.

use phasewarp::case::Case;
use phasewarp::communicator::{Communicator, World};
use phasewarp::matrix::LANES;
use phasewarp::partition::{Block, Mesh};
use phasewarp::plan::{Bounds, Plan, Resources};
use phasewarp::problem::Problem;
use phasewarp::propagate::commutator_free::CommutatorFree;
use phasewarp::propagate::{BatchSpec, Evolution, Initial, Propagator, propagator};
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

/// Batches of several degrees through the propagator of the case.
fn check(world: &World, case: &Case, name: &str) {
    let allowed = Bounds::new(case).expect("V is finite");
    let mesh = Mesh {
        space: vec![1],
        groups: 1,
    };
    let communicator = Communicator::new(world, &mesh);
    let block = Block::new(&case.space, &mesh, 0);
    let sizes = (2 * LANES, 100);
    let mut problem = Problem::new(case, &allowed, &communicator, block, sizes).expect("a problem");
    let bounds = problem.bounds(case, &allowed);
    let resources = Resources {
        ranks: 1,
        ..Resources::default()
    };
    let plan = Plan::with_bounds(case, bounds.clone(), &resources, 2.0).expect("a plan");
    let warp = plan.warp.as_ref().expect("a schrodingerized run");
    let mut propagator: Box<dyn Propagator> = match &problem.schedule {
        Some(schedule) => Box::new(CommutatorFree::new(&problem.matrix, warp, schedule)),
        None => propagator(&plan, warp, &problem.matrix),
    };
    let initial = Initial {
        state: &problem.states[0][..problem.matrix.rows()],
        norm: 1.0,
    };
    let mut system = Evolution {
        matrix: &problem.matrix,
        exchange: &mut problem.exchange,
        space: &communicator.space,
        rate: bounds.rate,
        growth: bounds.growth,
        time: case.end,
        terms: problem.terms,
    };
    for degree in [3, warp.largest_degree() / 2, warp.largest_degree()] {
        let batch = BatchSpec {
            wavenumbers: std::array::from_fn(|l| 0.2 * l as f64),
            degree,
        };
        let count = allocations(|| {
            let report = propagator.propagate(&mut system, &batch, &initial);
            assert!(report.is_ok_and(|r| r.applications >= degree.min(3)));
        });
        assert_eq!(count, 0, "{name}: allocations at degree {degree}");
    }
}

fn main() {
    let world = World::start().expect("MPI starts");
    let grid = ["axis.0.x.cells=24", "axis.0.v.cells=17"];
    let rows: [(&str, &[&str]); 3] = [
        ("example1", &[]),
        ("inflow_barrier", &["solver.warp.inflow=scalar"]),
        ("pulsed_inflow", &["solver.tolerance=1e-2"]),
    ];
    for (name, more) in rows {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("cases/{name}.toml"));
        let set: Vec<String> = grid.iter().chain(more).map(|s| (*s).to_owned()).collect();
        let case = Case::load(&path, &set).expect("a case of the repository");
        check(&world, &case, name);
    }
    // A control: the counter counts.
    assert!(allocations(|| drop(std::hint::black_box(vec![1.0; 100]))) > 0);
    println!("1 passed, 0 failed");
}
