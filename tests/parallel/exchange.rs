//! Tests the messages between ranks: ghost layers, and the transpose between modes and cells.

use crate::pieces::{for_every_piece, meshes};
use crate::support::dense::{case, noise};
use crate::support::prepared::block_of;
use num_complex::Complex64;
use phasewarp::matrix::lanes::{LANES, Lanes};
use phasewarp::parallel::communicator::transpose::Transpose;
use phasewarp::parallel::communicator::{Communicator, GhostExchange, Group, World};
use phasewarp::parallel::partition::{LocalIndex, ProcessMesh};
use std::ops::Range;

/// Every ghost gets the value of its owner; real numbers and batches use the same buffers.
pub fn ghost_exchange(world: &World) {
    for_every_piece(world, |twin, mesh, piece| {
        let rows = piece.matrix.rows();
        let value = noise;
        let values = |i, seed| std::array::from_fn(|l| value(i, 100 * seed + l as u64));
        for seed in 0..3 {
            let mut real = piece.reals(|i| value(i, seed));
            let mut batch = piece.batch(|i| values(i, seed));
            piece.exchange.start(&real[..rows]);
            piece.exchange.finish(&mut real[rows..]);
            piece.exchange.start(&batch[..rows]);
            piece.exchange.finish(&mut batch[rows..]);
            for (i, &number) in piece.number.iter().enumerate() {
                assert_eq!(real[i], value(number, seed), "{} {mesh:?} {i}", twin.name);
                assert_eq!(batch[i].0, values(number, seed), "{} {mesh:?} {i}", twin.name);
            }
        }
        // Every ghost is at the position that the block gives.
        for (ghost, &i) in piece.number[rows..].iter().enumerate() {
            assert_eq!(piece.matrix.block.local(i), Some(LocalIndex::Ghost(ghost)));
        }
    });
}

/// A ghost layer with more numbers than fit into one message is exchanged.
pub fn long_messages(world: &World) {
    let ranks = world.group().size();
    let velocities = 70_000;
    let velocity_cells = format!("axis.0.v.cells={velocities}");
    let case = case("example1.toml", &["axis.0.x.cells=5", &velocity_cells]);
    let mesh = ProcessMesh { space: vec![ranks], groups: 1 };
    let communicator = Communicator::new(world, &mesh);
    let block = block_of(&case, &mesh, &communicator);
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

/// The value of mode `l` in a cell: random numbers, the same on any number of ranks.
pub fn mode_value(l: usize, cell: usize) -> Complex64 {
    let number = 1000 * cell + l;
    Complex64::new(noise(number, 1), noise(number, 2))
}

/// The modes of each rank, ascending: mode `l` is on rank `(l² + 1) mod ranks`, so that shares are
/// uneven and some ranks may have none.
pub fn dealt(modes: usize, ranks: usize) -> Vec<Vec<usize>> {
    let of = |rank: usize| (0..modes).filter(move |l| (l * l + 1) % ranks == rank);
    (0..ranks).map(|rank| of(rank).collect()).collect()
}

/// The transpose from some modes of all cells to all modes of some cells, and back, on every
/// process mesh: with uneven shares, ranks without modes or cells, and short messages.
pub fn transpose_and_back(world: &World) {
    let case = case("example1.toml", &["axis.0.x.cells=5", "axis.0.v.cells=4"]);
    for mesh in meshes(world, &case) {
        let communicator = Communicator::new(world, &mesh);
        for (modes, cells) in [(1, 1), (7, 5), (2, 11), (10, 3), (0, 4), (5, 0), (33, 29)] {
            for (at_once, most) in [(1, 1), (2, 3), (4, 1 << 20)] {
                let group = &communicator.modes;
                let lists = dealt(modes, group.size());
                let mut transpose = Transpose::in_pieces(group, lists, at_once, most);
                assert_eq!(transpose.modes(), modes);
                there_and_back(group, &mut transpose, cells, at_once);
            }
        }
    }
}

/// Transposes all cells, `at_once` of them at a time on each rank of `group`.
fn there_and_back(group: &Group, transpose: &mut Transpose<'_>, cells: usize, at_once: usize) {
    let (rank, size, modes) = (group.rank(), group.size(), transpose.modes());
    let mine = dealt(modes, size).swap_remove(rank);
    // Rows after the cells are not transposed.
    let rows = cells + 2;
    let of_mode = |l| (0..rows).map(move |cell| mode_value(l, cell));
    let field: Vec<Complex64> = mine.into_iter().flat_map(of_mode).collect();
    let mut back = vec![Complex64::ZERO; field.len()];
    let mut all = vec![Complex64::ZERO; at_once * modes];
    for first in (0..cells).step_by(at_once * size) {
        let at = |r: usize| (first + r * at_once).min(cells);
        let ranges: Vec<Range<usize>> = (0..size).map(|r| at(r)..at(r + 1)).collect();
        all.fill(Complex64::new(f64::NAN, f64::NAN));
        transpose.to_cells(&field, rows, &ranges, &mut all);
        for (i, cell) in ranges[rank].clone().enumerate() {
            for l in 0..modes {
                assert_eq!(all[i * modes + l], mode_value(l, cell), "mode {l}, {cell}");
            }
        }
        transpose.to_modes(&all, &ranges, &mut back, rows);
    }
    for (k, (found, expected)) in back.iter().zip(&field).enumerate() {
        let inside = k % rows < cells;
        let expected = if inside { *expected } else { Complex64::ZERO };
        assert_eq!(*found, expected, "{size} groups, {modes} modes, {cells} cells");
    }
}
