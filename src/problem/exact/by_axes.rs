//! Particles that move along each axis as if it were the only one.
//!
//! Where the slopes and jumps of `V` along each axis depend on the place along that axis alone, so
//! does the motion. Then particles that agree in `(x_a, v_a)` are followed along axis `a` once, and
//! points of a rule in many dimensions share a few paths. Where `V` has slopes, which take an event
//! a cell, that is most of the work.

use crate::problem::grid::{MAX_DIMENSION, PhaseSpace, for_each_cell};
use crate::problem::potential::Potential;
use std::cell::RefCell;
use std::collections::HashMap;

/// Slopes and jumps that differ by this part of the largest are the same but for round-off.
const SAME: f64 = 1e-11;
/// Paths that are kept.
const MOST_PATHS: usize = 1 << 18;

/// A path along an axis: the axis, the bits of place, velocity and time.
type Path = [u64; 4];

/// The paths that were followed: place and velocity at their ends, none of those that leave the
/// box.
#[derive(Clone, Debug, Default)]
pub(super) struct AxisPaths(RefCell<HashMap<Path, Option<[f64; 2]>>>);

/// What becomes of a particle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum EndByAxes {
    /// It is in the box, at a point of phase space.
    Inside([f64; 6]),
    /// It leaves the box.
    Leaves,
}

/// Whether `V`, which has slopes in more than one dimension, moves particles along each axis as if
/// it were the only one.
pub(super) fn moves_by_axes(space: &PhaseSpace, potential: &Potential) -> bool {
    let n = space.dimension();
    let ranges: Vec<_> = space.x.iter().map(|axis| 0..axis.cells).collect();
    let mut largest = [0.0f64; MAX_DIMENSION];
    for_each_cell(&ranges, |i| {
        for (a, largest) in largest.iter_mut().enumerate().take(n) {
            *largest = largest.max(potential.jump_below(i, a).abs());
        }
    });
    let steepest: Vec<f64> = (0..n).map(|a| potential.steepest(a)).collect();
    let mut same = n > 1 && steepest.iter().any(|slope| *slope != 0.0);
    if !same {
        return false;
    }
    for_each_cell(&ranges, |i| {
        for a in 0..n {
            let mut alone = [0; MAX_DIMENSION];
            alone[a] = i[a];
            let slopes = [i, &alone].map(|i| potential.slope(i, a));
            let jumps = [i, &alone].map(|i| potential.jump_below(i, a));
            same &= (slopes[0] - slopes[1]).abs() <= SAME * steepest[a];
            same &= (jumps[0] - jumps[1]).abs() <= SAME * largest[a];
            same &= (jumps[0] == 0.0) == (jumps[1] == 0.0);
        }
    });
    same
}

impl AxisPaths {
    /// What becomes of a particle at `point` after `time` that moves along `axes` axes, each path
    /// that is not known followed by `follow(axis, [x, v])`: its end, or none if it leaves the box.
    pub(super) fn end(
        &self,
        axes: usize,
        point: &[f64; 6],
        time: f64,
        follow: impl Fn(usize, [f64; 2]) -> Option<[f64; 2]>,
    ) -> EndByAxes {
        let mut end = [0.0; 6];
        for a in 0..axes {
            let (x, v) = (point[a], point[3 + a]);
            let path = [a as u64, x.to_bits(), v.to_bits(), time.to_bits()];
            let known = self.0.borrow().get(&path).copied();
            let found = known.unwrap_or_else(|| {
                let found = follow(a, [x, v]);
                let mut paths = self.0.borrow_mut();
                if paths.len() == MOST_PATHS {
                    paths.clear();
                }
                paths.insert(path, found);
                found
            });
            let Some([x, v]) = found else { return EndByAxes::Leaves };
            (end[a], end[3 + a]) = (x, v);
        }
        EndByAxes::Inside(end)
    }
}
