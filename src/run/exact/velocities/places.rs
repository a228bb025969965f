//! Positions at which integrals over the velocities are compared.

use crate::parallel::communicator::Group;
use crate::problem::grid::{MAX_DIMENSION, PhaseSpace, box_cells};

/// `value` at all `places`, of which each rank computes a part. Collective.
pub fn at_all(
    world: &Group,
    places: &[[f64; MAX_DIMENSION]],
    value: impl Fn(&[f64; MAX_DIMENSION]) -> f64,
) -> Vec<f64> {
    let mut found = vec![0.0; places.len()];
    for k in world.piece_of(&(0..places.len())) {
        found[k] = value(&places[k]);
    }
    world.gathered(found)
}

/// Up to `most` centres of elements along each axis.
pub fn centres(space: &PhaseSpace, most: usize) -> Vec<[f64; MAX_DIMENSION]> {
    let axes = &space.x;
    let counts: Vec<_> = axes.iter().map(|axis| 0..axis.elements().min(most)).collect();
    let centre = |k: [usize; MAX_DIMENSION]| {
        let mut position = [0.0; MAX_DIMENSION];
        for (a, axis) in axes.iter().enumerate() {
            let element = (2 * k[a] + 1) * axis.elements() / (2 * counts[a].len());
            position[a] = axis.at(element as i64, 0.0);
        }
        position
    };
    box_cells(&counts).map(centre).collect()
}
