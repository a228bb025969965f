//! Tests what ranks send each other: ghost layers, and the transpose between modes and cells.

use crate::*;

pub fn ghost_exchange(world: &World) {
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
            assert_eq!(piece.matrix.block.local(i), Some(LocalIndex::Ghost(ghost)));
        }
    });
}

/// A ghost layer of more numbers than go in one message.
pub fn long_messages(world: &World) {
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
