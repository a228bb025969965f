//! What overlapping the ghost exchange with the inner rows is worth: a fused step of a batch on two
//! ranks that split space.
//!
//! Four figures a grid, microseconds a step, the least of many short turns (so that others on the
//! machine count little): the rows alone; the exchange alone; the exchange finished before the rows
//! start; and the step as runs do it, the inner rows between start and finish. Starts itself under
//! `mpirun -np 2`.

mod support;

use phasewarp::matrix::block_matrix::BlockMatrix;
use phasewarp::matrix::lanes::{LANES, Lanes, StepConstants};
use phasewarp::parallel::communicator::{Communicator, GhostExchange, World};
use phasewarp::parallel::partition::{Block, ProcessMesh};
use std::process::Command;
use std::time::Instant;
use support::{constants, load};

/// Set for the ranks that measure.
const CHILD: &str = "PHASEWARP_BENCH_CHILD";
/// Turns of which the least is quoted.
const TURNS: usize = 100;
/// Seconds a turn takes, about.
const TURN: f64 = 0.005;

struct Split {
    matrix: BlockMatrix,
    exchange: GhostExchange,
    /// Of a block that has no neighbours: with it a step exchanges nothing.
    nothing: GhostExchange,
    vectors: [Vec<Lanes>; 2],
    start: Vec<f64>,
    constants: StepConstants,
}

impl Split {
    fn new(world: &World, case: &str, set: &[String]) -> Self {
        let case = load(case, set);
        let mesh = |blocks: usize| {
            let mut space = vec![1; case.space.dimension()];
            space[0] = blocks;
            ProcessMesh { space, groups: 1 }
        };
        let ranks = world.group().size();
        let communicator = Communicator::new(world, &mesh(ranks));
        let block = Block::new(&case.space, &mesh(ranks), communicator.space.rank());
        let matrix = BlockMatrix::assemble(&case, block).expect("finite formulas");
        let whole = Block::new(&case.space, &mesh(1), 0);
        let vector = || vec![Lanes([0.5; 2 * LANES]); matrix.length()];
        Self {
            vectors: [vector(), vector()],
            start: vec![0.5; matrix.rows()],
            exchange: GhostExchange::new(&communicator.space, &matrix.block, 2 * LANES),
            nothing: GhostExchange::new(&communicator.space, &whole, 2 * LANES),
            constants: constants(),
            matrix,
        }
    }

    fn step(&mut self, exchanged: bool) {
        let [y, x] = &mut self.vectors;
        let exchange = if exchanged { &mut self.exchange } else { &mut self.nothing };
        (self.matrix).step(exchange, &self.constants, None, y, x, &self.start);
        std::mem::swap(y, x);
    }

    fn exchange(&mut self) {
        let (x, rows) = (&mut self.vectors[1], self.matrix.rows());
        self.exchange.start(&x[..rows]);
        self.exchange.finish(&mut x[rows..]);
    }
}

/// The four figures, in seconds a step.
fn measure(world: &World, split: &mut Split) -> [f64; 4] {
    let group = world.group();
    let mut turn = |what: usize, count: usize| {
        group.barrier();
        let start = Instant::now();
        for _ in 0..count {
            match what {
                0 => split.step(false),
                1 => split.exchange(),
                2 => {
                    split.exchange();
                    split.step(false);
                }
                _ => split.step(true),
            }
        }
        group.max(start.elapsed().as_secs_f64()) / count as f64
    };
    let count = (TURN / turn(2, 20)).ceil() as usize;
    let mut seconds = [f64::INFINITY; 4];
    for _ in 0..TURNS {
        for (what, least) in seconds.iter_mut().enumerate() {
            *least = least.min(turn(what, count));
        }
    }
    seconds
}

fn main() {
    if std::env::var_os(CHILD).is_none() {
        let program = std::env::current_exe().expect("a path of this program");
        let status = Command::new("mpirun")
            .args(["-np", "2"])
            .arg(program)
            .env(CHILD, "1")
            .env("OMPI_ALLOW_RUN_AS_ROOT", "1")
            .env("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1")
            .status();
        assert!(status.is_ok_and(|s| s.success()), "mpirun failed");
        return;
    }
    let world = World::start().expect("MPI starts");
    let is_first = world.group().rank() == 0;
    if is_first {
        println!(
            "{:<8} {:>8} {:>8} {:>10} {:>10} {:>10} {:>8}",
            "grid", "ghosts", "rows us", "exchange", "one after", "overlapped", "saved"
        );
    }
    let square = |n: usize| ["x", "v"].map(|a| format!("axis.0.{a}.cells={n}")).to_vec();
    let four = |n: usize| {
        (0..2)
            .flat_map(|d| ["x", "v"].map(|a| format!("axis.{d}.{a}.cells={n}")))
            .collect::<Vec<_>>()
    };
    for (name, case, set) in [
        ("32x32", "example1.toml", square(32)),
        ("64x64", "example1.toml", square(64)),
        ("128x128", "example1.toml", square(128)),
        ("256x256", "example1.toml", square(256)),
        ("512x512", "example1.toml", square(512)),
        ("16^4", "barrier2d.toml", four(16)),
        ("24^4", "barrier2d.toml", four(24)),
    ] {
        let mut split = Split::new(&world, case, &set);
        let [rows, exchange, after, overlapped] = measure(&world, &mut split);
        if is_first {
            println!(
                "{name:<8} {:>8} {:>8.1} {:>10.1} {:>10.1} {:>10.1} {:>7.1}%",
                split.matrix.block.ghosts(),
                1e6 * rows,
                1e6 * exchange,
                1e6 * after,
                1e6 * overlapped,
                100.0 * (1.0 - overlapped / after)
            );
        }
    }
}
