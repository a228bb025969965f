//! Rate of the fused Chebyshev step beside a triad measured in the same run.
//!
//! Each figure is microseconds per mode and application, and the share of the triad's bandwidth that the 80-byte model
//! (read v_k; read and write v_{k−1} and the sum) accounts for: above 1 where the vectors stay in cache.

use criterion::{Criterion, Throughput};
use phasewarp::case::Case;
use phasewarp::communicator::{Communicator, GhostExchange, World};
use phasewarp::matrix::{BlockMatrix, LANES, Lanes, StepConstants};
use phasewarp::partition::{Block, Mesh};
use std::hint::black_box;
use std::time::{Duration, Instant};

/// Bytes a row, mode and step in the model.
const MODEL_BYTES: f64 = 80.0;
/// Repetitions of which the median is quoted.
const REPEATS: usize = 7;

fn median(mut run: impl FnMut()) -> f64 {
    run();
    let mut seconds: Vec<f64> = (0..REPEATS)
        .map(|_| {
            let start = Instant::now();
            run();
            start.elapsed().as_secs_f64()
        })
        .collect();
    seconds.sort_by(f64::total_cmp);
    seconds[REPEATS / 2]
}

/// Bytes per second of `a ← b + s c` on arrays far larger than the caches.
fn triad() -> f64 {
    let n = 8 << 20;
    let (mut a, b, c) = (vec![0.0; n], vec![1.0; n], vec![2.0; n]);
    let seconds = median(|| {
        for i in 0..n {
            a[i] = b[i] + 3.0 * c[i];
        }
        black_box(&mut a);
    });
    24.0 * n as f64 / seconds
}

struct Steps {
    matrix: BlockMatrix,
    exchange: GhostExchange,
    vectors: [Vec<Lanes>; 3],
    constants: StepConstants,
}

impl Steps {
    fn new(world: &World, case: &str, set: &[String]) -> Self {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("cases")
            .join(case);
        let case = Case::load(&path, set).expect("a case of the repository");
        let mesh = Mesh {
            space: vec![1; case.space.dimension()],
            groups: 1,
        };
        let communicator = Communicator::new(world, &mesh);
        let block = Block::new(&case.space, &mesh, 0);
        let matrix = BlockMatrix::assemble(&case, block).expect("finite formulas");
        let exchange = GhostExchange::new(&communicator.space, &matrix.block, 2 * LANES);
        let vector = || vec![Lanes([0.5; 2 * LANES]); matrix.length()];
        Self {
            vectors: [vector(), vector(), vector()],
            exchange,
            constants: StepConstants {
                scale: [1e-3; LANES],
                shift: [0.1; LANES],
                wavenumber: std::array::from_fn(|l| 0.1 * l as f64),
                coefficient: [1e-3; LANES],
            },
            matrix,
        }
    }

    fn run(&mut self, steps: usize) {
        let [y, x, sum] = &mut self.vectors;
        for _ in 0..steps {
            self.matrix
                .step(&mut self.exchange, &self.constants, y, x, sum);
            std::mem::swap(y, x);
        }
    }
}

fn main() {
    let world = World::start().expect("MPI starts");
    let triad = triad();
    println!(
        "triad: {:.1} GB/s; {}",
        triad / 1e9,
        phasewarp::matrix::instruction_set()
    );
    let square = |n: usize| ["x", "v"].map(|a| format!("axis.0.{a}.cells={n}")).to_vec();
    let four = |n: usize| {
        (0..2)
            .flat_map(|d| ["x", "v"].map(|a| format!("axis.{d}.{a}.cells={n}")))
            .collect::<Vec<_>>()
    };
    let mut criterion = Criterion::default()
        .sample_size(10)
        .warm_up_time(Duration::from_millis(200))
        .measurement_time(Duration::from_secs(1))
        .configure_from_args();
    for (name, case, set) in [
        ("32x32", "example1.toml", square(32)),
        ("64x64", "example1.toml", square(64)),
        ("128x128", "example1.toml", square(128)),
        ("16^4", "barrier2d.toml", four(16)),
    ] {
        let mut steps = Steps::new(&world, case, &set);
        let rows = steps.matrix.rows();
        let count = (1 << 20) / rows + 1;
        let seconds = median(|| steps.run(count)) / count as f64;
        let per_mode = seconds / LANES as f64;
        println!(
            "{name}: {:.2} us per mode and application; {:.2} of the triad in the {MODEL_BYTES}-byte model",
            1e6 * per_mode,
            MODEL_BYTES * rows as f64 / per_mode / triad
        );
        let mut group = criterion.benchmark_group("step");
        group.throughput(Throughput::Elements((rows * LANES) as u64));
        group.bench_function(name, |b| b.iter(|| steps.run(1)));
        group.finish();
    }
    criterion.final_summary();
}
