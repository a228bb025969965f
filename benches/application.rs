//! Rate of the fused Chebyshev step, step after step and blocked, beside a triad, the bandwidth in
//! the cache of a core and its peak of fused multiply-adds, measured in the same run.
//!
//! A step reads `b_{k+1}` and reads and writes `b_{k+2}`, 48 bytes a row and mode, and the start,
//! which the modes of a batch share: 49 bytes. (Summed forwards it was 80: read `φ_k`; read and
//! write `φ_{k−1}` and the sum.) The share of the triad's bandwidth that 49 bytes account for is 1
//! where every step goes through memory, and above 1 in cache or blocked.

use criterion::{Criterion, Throughput};
mod support;

use phasewarp::base::machine::{cache_per_core, last_cache_per_core, processor_seconds};
use phasewarp::matrix::block_matrix::BlockMatrix;
use phasewarp::matrix::blocking::Blocking;
use phasewarp::matrix::blocking::fastest::FastestBlocking;
use phasewarp::matrix::instruction_set::{InstructionSet, Vectorized};
use phasewarp::matrix::lanes::{LANES, Lanes, StepConstants};
use phasewarp::matrix::vector::Vector;
use phasewarp::matrix::weights::Weights;
use phasewarp::parallel::communicator::{Communicator, GhostExchange, World};
use phasewarp::parallel::partition::{Block, ProcessMesh};
use std::hint::black_box;
use std::time::Duration;
use support::{constants, load};

/// Bytes a row, mode and step in the model.
const MODEL_BYTES: f64 = 48.0 + 8.0 / LANES as f64;
/// The same of a series summed forwards, for comparison.
const FORWARD_BYTES: f64 = 80.0;
/// Repetitions of which the median is quoted.
const REPEATS: usize = 7;

/// The median of the processor's seconds: what else runs on the machine takes none of them, though
/// it does take cache and bandwidth.
fn median(mut run: impl FnMut()) -> f64 {
    run();
    let mut seconds: Vec<f64> = (0..REPEATS)
        .map(|_| {
            let start = processor_seconds();
            run();
            processor_seconds() - start
        })
        .collect();
    seconds.sort_by(f64::total_cmp);
    seconds[REPEATS / 2]
}

/// Bytes per second of `a ← b + s c` on three arrays of `n` numbers.
fn triad(n: usize) -> f64 {
    let (mut a, b, c) = (vec![0.0; n], vec![1.0; n], vec![2.0; n]);
    let times = (8 << 20) / n + 1;
    let seconds = median(|| {
        for _ in 0..times {
            for ((a, b), c) in a.iter_mut().zip(&b).zip(&c) {
                *a = b + 3.0 * c;
            }
            black_box(&mut a);
        }
    });
    24.0 * (n * times) as f64 / seconds
}

/// Fused multiply-adds of vectors in registers alone, as the inner loop is compiled.
struct RegisterLoop<'a> {
    turns: usize,
    sums: &'a mut [f64; LANES],
}

impl RegisterLoop<'_> {
    /// Sums of a turn where there are 32 registers, and where there are 16 for half a vector each:
    /// enough for every unit to have one that waits for no other.
    const SUMS: [usize; 2] = [16, 6];

    #[inline(always)]
    fn of<V: Vector, const SUMS: usize>(self) {
        let [a, b] = [1.0, 1e-9].map(|value| V::splat(black_box(value)));
        let mut sums = [V::splat(black_box(0.0)); SUMS];
        for _ in 0..self.turns {
            // No `map`: it would be compiled apart, for the portable instruction set.
            for sum in &mut sums {
                *sum = sum.add_product(a, b);
            }
        }
        for sum in sums {
            sum.store(self.sums);
            black_box(&mut *self.sums);
        }
    }
}

impl Vectorized for RegisterLoop<'_> {
    #[inline(always)]
    fn run<V: Vector, const FMA: bool, const ROWS: usize, const WHOLE: bool>(self) {
        if WHOLE {
            self.of::<V, { RegisterLoop::SUMS[0] }>();
        } else {
            self.of::<V, { RegisterLoop::SUMS[1] }>();
        }
    }
}

/// Fused multiply-adds of a core a second.
fn multiply_add_peak() -> f64 {
    let turns = 1 << 24;
    let wide = InstructionSet::here() == InstructionSet::Avx512;
    let sums = RegisterLoop::SUMS[usize::from(!wide)];
    let mut scratch = [0.0; LANES];
    let seconds = median(|| InstructionSet::here().run(RegisterLoop { turns, sums: &mut scratch }));
    (turns * sums * LANES) as f64 / seconds
}

struct Steps {
    matrix: BlockMatrix,
    exchange: GhostExchange,
    vectors: [Vec<Lanes>; 2],
    start: Vec<f64>,
    constants: StepConstants,
}

impl Steps {
    fn new(world: &World, case: &str, set: &[String]) -> Self {
        let case = load(case, set);
        let mesh = ProcessMesh { space: vec![1; case.space.dimension()], groups: 1 };
        let communicator = Communicator::new(world, &mesh);
        let block = Block::new(&case.space, &mesh, 0);
        let mut matrix = BlockMatrix::assemble(&case, block).expect("finite formulas");
        if case.space.degree() > 0 {
            let weights = Weights::volumes(&matrix, &case.space);
            matrix.scale(&weights.pi);
            matrix.gather_elements();
        }
        let exchange = GhostExchange::new(&communicator.space, &matrix.block, 2 * LANES);
        let vector = || vec![Lanes([0.5; 2 * LANES]); matrix.length()];
        Self {
            vectors: [vector(), vector()],
            start: vec![0.5; matrix.rows()],
            exchange,
            constants: constants(),
            matrix,
        }
    }

    fn run(&mut self, blocking: Option<&Blocking>, trips: usize) {
        let levels = vec![self.constants.clone(); blocking.map_or(1, Blocking::depth)];
        let [y, x] = &mut self.vectors;
        for _ in 0..trips {
            let steps =
                phasewarp::matrix::blocking::RecurrenceSteps { levels: &levels, couplings: None };
            (self.matrix).steps(&mut self.exchange, blocking, &steps, y, x, &self.start);
        }
    }
}

/// What the machine can do, measured in the same run.
struct Peaks {
    /// Bytes a second from and to memory.
    memory: f64,
    /// Fused multiply-adds of a core a second.
    multiply_adds: f64,
}

impl Peaks {
    /// Measures and prints them.
    fn measured() -> Self {
        let memory = triad(8 << 20);
        // Three arrays of numbers that fill half of a cache.
        let [cache, last] =
            [cache_per_core(), last_cache_per_core()].map(|bytes| triad(bytes as usize / 48));
        let multiply_adds = multiply_add_peak();
        println!(
            "triad: {:.1} GB/s, in half of the {} KiB of a core {:.1} GB/s, in half of its {} MiB \
            of the last cache {:.1} GB/s; FMA peak of a core {:.1} GFlop/s; {}, {LANES} modes in a \
            batch",
            memory / 1e9,
            cache_per_core() >> 10,
            cache / 1e9,
            last_cache_per_core() >> 20,
            last / 1e9,
            2e-9 * multiply_adds,
            InstructionSet::here().name()
        );
        Self { memory, multiply_adds }
    }
}

/// A grid on which the step is measured.
struct Grid {
    name: &'static str,
    case: &'static str,
    /// Position axes, each with a velocity axis, and cells along each.
    dimension: usize,
    cells: usize,
    degree: usize,
}

const fn grid(
    name: &'static str,
    case: &'static str,
    dimension: usize,
    cells: usize,
    degree: usize,
) -> Grid {
    Grid { name, case, dimension, cells, degree }
}

impl Grid {
    /// Its settings, as `--set` has them.
    fn settings(&self) -> Vec<String> {
        let axes = (0..self.dimension).flat_map(|d| ["x", "v"].map(|axis| (d, axis)));
        let cells = axes.map(|(d, axis)| format!("axis.{d}.{axis}.cells={}", self.cells));
        let degree = (self.degree > 0).then(|| format!("scheme.degree={}", self.degree));
        cells.chain(degree).collect()
    }
}

const GRIDS: &[Grid] = &[
    grid("32x32", "example1.toml", 1, 32, 0),
    grid("64x64", "example1.toml", 1, 64, 0),
    grid("128x128", "example1.toml", 1, 128, 0),
    grid("256x256", "example1.toml", 1, 256, 0),
    grid("512x512", "example1.toml", 1, 512, 0),
    // About as many rows as 128x128.
    grid("degree 1, 64x64 elements", "example1.toml", 1, 64, 1),
    grid("degree 2, 42x42 elements", "example1.toml", 1, 42, 2),
    grid("degree 3, 32x32 elements", "example1.toml", 1, 32, 3),
    grid("degree 4, 26x26 elements", "example1.toml", 1, 26, 4),
    grid("degree 8, 14x14 elements", "example1.toml", 1, 14, 8),
    // As many rows as 512x512.
    grid("degree 1, 256x256 elements", "example1.toml", 1, 256, 1),
    grid("degree 3, 128x128 elements", "example1.toml", 1, 128, 3),
    grid("degree 8, 56x56 elements", "example1.toml", 1, 56, 8),
    // A force acts: nodes along v are coupled, too.
    grid("slope jump, 128x128", "slope_jump.toml", 1, 128, 0),
    grid("slope jump, degree 1, 64x64 elements", "slope_jump.toml", 1, 64, 1),
    grid("slope jump, degree 2, 42x42 elements", "slope_jump.toml", 1, 42, 2),
    grid("slope jump, degree 4, 26x26 elements", "slope_jump.toml", 1, 26, 4),
    grid("slope jump, degree 8, 14x14 elements", "slope_jump.toml", 1, 14, 8),
    grid("harmonic step, 128x128", "harmonic_step.toml", 1, 128, 0),
    grid("harmonic step, degree 4, 26x26 elements", "harmonic_step.toml", 1, 26, 4),
    grid("6^4", "barrier2d.toml", 2, 6, 0),
    grid("16^4", "barrier2d.toml", 2, 16, 0),
    grid("24^4", "barrier2d.toml", 2, 24, 0),
    grid("degree 1, 12^4 elements", "barrier2d.toml", 2, 12, 1),
    grid("8^6", "step3d.toml", 3, 8, 0),
    grid("example 3, 16^4", "example3.toml", 2, 16, 0),
    grid("example 3, 24^4", "example3.toml", 2, 24, 0),
    grid("example 3, 32^4", "example3.toml", 2, 32, 0),
];

/// Measures the step on a grid, step after step and blocked.
fn measure(grid: &Grid, world: &World, peaks: &Peaks, criterion: &mut Criterion) {
    let name = grid.name;
    let mut steps = Steps::new(world, grid.case, &grid.settings());
    let rows = steps.matrix.rows();
    let candidates = FastestBlocking::planned(&steps.matrix, 1000);
    let blockings: Vec<&Blocking> = candidates.all().iter().flatten().collect();
    if blockings.is_empty() {
        println!("{name}: in cache, not blocked");
    }
    let mut before = None;
    for blocking in [None].into_iter().chain(blockings.into_iter().map(Some)) {
        let depth = blocking.map_or(1, Blocking::depth);
        let trips = (1 << 20) / rows / depth + 1;
        let seconds = median(|| steps.run(blocking, trips)) / (trips * depth) as f64;
        let each = seconds / (rows * LANES) as f64;
        let how = blocking.map_or("step after step".to_owned(), |b| {
            let shape = b.shape();
            format!(
                "{} steps, strips of {}, {} ranges of velocities",
                shape.depth, shape.width, shape.parts
            )
        });
        let multiply_adds = steps.matrix.stored().multiply_adds() as f64 / rows as f64;
        println!(
            "{name}, {how}: {:.2} ns a row, mode and step, {:.1} us a mode; {:.2} of the triad at \
            {MODEL_BYTES} bytes, {:.1} GB/s at {FORWARD_BYTES}; {:.2} of the FMA peak{}",
            1e9 * each,
            1e6 * seconds / LANES as f64,
            MODEL_BYTES / each / peaks.memory,
            1e-9 * FORWARD_BYTES / each,
            multiply_adds / each / peaks.multiply_adds,
            before.map_or(String::new(), |b: f64| format!("; {:.2} times as fast", b / each))
        );
        before = before.or(Some(each));
        let mut group = criterion.benchmark_group("step");
        group.throughput(Throughput::Elements((rows * LANES * depth) as u64));
        let label = format!("{name}, {how}");
        group.bench_function(&label, |b| b.iter(|| steps.run(blocking, 1)));
        group.finish();
    }
}

fn main() {
    let world = World::start().expect("MPI starts");
    let peaks = Peaks::measured();
    // A word on the command line leaves out grids that it is not part of.
    let wanted = std::env::args().skip(1).find(|word| !word.starts_with('-')).unwrap_or_default();
    let mut criterion = Criterion::default()
        .sample_size(10)
        .warm_up_time(Duration::from_millis(200))
        .measurement_time(Duration::from_secs(1))
        .configure_from_args();
    for grid in GRIDS.iter().filter(|grid| grid.name.contains(&wanted)) {
        measure(grid, &world, &peaks, &mut criterion);
    }
    criterion.final_summary();
}
