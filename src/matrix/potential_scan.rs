//! The properties of `V` on which the bounds depend, found layer by layer.

use crate::base::error::Result;
use crate::base::row_major::volume;
use crate::matrix::element_faces::ElementFaces;
use crate::problem::case::{Case, Limiter};
use crate::problem::grid::MAX_DIMENSION;
use crate::problem::potential::{LargestJump, Potential};
use std::collections::HashSet;

/// Kinds of cells are counted up to this number.
pub const MOST_KINDS: usize = 4096;

/// Number of cells of space on which `V` is evaluated together, unless a layer has more.
const CELLS_AT_ONCE: usize = 1 << 14;

/// The properties of `V` on the whole space grid on which the bounds depend.
pub(super) struct PotentialScan<'a> {
    /// Bound on the rate of the transport along the velocity axes.
    pub(super) force: f64,
    /// Whether a force acts along each axis.
    pub(super) forces: [bool; MAX_DIMENSION],
    /// The largest jump at faces across each axis.
    pub(super) jumps: [Option<LargestJump>; MAX_DIMENSION],
    /// The faces at which `V` jumps, if slopes are limited: see [`Potential::jump_faces`].
    pub(super) jump_faces: Vec<[usize; MAX_DIMENSION]>,
    /// Kinds of space cells by slopes and jumps, up to [`MOST_KINDS`].
    pub(super) kinds: HashSet<[u64; 2 * MAX_DIMENSION]>,
    /// Faces of elements.
    pub(super) faces: Option<ElementFaces<'a>>,
}

impl<'a> PotentialScan<'a> {
    /// Evaluates `V` some layers at a time, so that the whole potential is never stored.
    pub(super) fn new(case: &'a Case) -> Result<Self> {
        let mut ranges = case.space.space_ranges();
        let layer = volume(&ranges[1..]);
        let first = &case.space.x[0];
        let layers = (CELLS_AT_ONCE / layer.max(1)).max(1).next_multiple_of(first.nodes.count());
        let (mut force, mut forces) = (0.0f64, [false; MAX_DIMENSION]);
        let mut jumps = [None; MAX_DIMENSION];
        let mut jump_faces = Vec::new();
        let mut kinds = HashSet::new();
        let mut faces = case.is_galerkin().then(|| ElementFaces::new(case));
        for i in (0..first.cells).step_by(layers) {
            let end = (i + layers).min(first.cells);
            // The upper face of an element is the lower face of the next one.
            let beyond = usize::from(faces.is_some());
            ranges[0] = i..(end + beyond).min(first.cells);
            let layer = Potential::new(case, &ranges)?;
            force = force.max(layer.force_rate(&case.space));
            (forces.iter_mut().enumerate()).for_each(|(a, acts)| *acts |= layer.steepest(a) > 0.0);
            for (jump, found) in jumps.iter_mut().zip(layer.largest_jumps(&case.space)) {
                let height = |jump: Option<LargestJump>| jump.map_or(0.0, |jump| jump.height);
                *jump = if height(found) > height(*jump) { found } else { *jump };
            }
            if case.scheme.limiter != Limiter::None {
                jump_faces.extend(layer.jump_faces());
            }
            layer.collect_kinds(&mut kinds, MOST_KINDS);
            ranges[0] = i..end;
            faces.iter_mut().for_each(|faces| faces.add(&layer, &ranges));
        }
        Ok(Self { force, forces, jumps, jump_faces, kinds, faces })
    }
}
