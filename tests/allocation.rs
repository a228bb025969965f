//! The run loop allocates nothing: a counting allocator around the propagation of a batch.

use phasewarp::case::{Case, Integrator};
use phasewarp::classical::Classical;
use phasewarp::classical::limiter::Reconstruction;
use phasewarp::communicator::{Communicator, World};
use phasewarp::matrix::LANES;
use phasewarp::partition::{Block, Mesh};
use phasewarp::plan::Bounds;
use phasewarp::problem::Problem;
use phasewarp::propagate::BatchSpec;
use phasewarp::propagate::chebyshev::Chebyshev;
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
    let span = (bounds.rate, bounds.growth, case.end);
    let mut propagator = Chebyshev::new(&problem.matrix, 100);
    let rows = problem.matrix.rows();
    for degree in [3, 40, 100] {
        let batch = BatchSpec {
            wavenumbers: std::array::from_fn(|l| 0.2 * l as f64),
            degree,
        };
        let count = allocations(|| {
            let exchange = &mut problem.exchange;
            propagator.propagate(
                &problem.matrix,
                exchange,
                &batch,
                span,
                &problem.states[0][..rows],
            );
        });
        assert_eq!(count, 0, "allocations at degree {degree}");
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
    // A control: the counter counts.
    assert!(allocations(|| drop(std::hint::black_box(vec![1.0; 100]))) > 0);
    println!("1 passed, 0 failed");
}
