//! The pieces of `V`: the region, or the value of a stepped table, that holds at a point.

use crate::base::random::evenly_spread_index;
use crate::problem::case::Region;
use crate::problem::formula::Expression;
use crate::problem::grid::{Axis, MAX_DIMENSION, PhaseSpace};

/// The region that holds at a point.
///
/// # Errors
/// The condition that is undefined there.
pub fn region<'r>(
    regions: &'r [Region],
    point: &[f64; 6],
) -> std::result::Result<usize, &'r Expression> {
    for (index, region) in regions.iter().enumerate() {
        let Some(condition) = &region.condition else { return Ok(index) };
        match condition.holds(point) {
            Some(true) => return Ok(index),
            Some(false) => {}
            None => return Err(condition),
        }
    }
    Ok(regions.len() - 1)
}

/// The piece of `V` in an element.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct PotentialPiece {
    pub(super) region: usize,
    /// For a table that is constant around its points: its value in the whole element.
    pub(super) constant: Option<f64>,
}

/// The piece of the element around `centre`, or the condition that is undefined there.
pub(super) fn piece<'r>(
    regions: &'r [Region],
    centre: &[f64; 6],
) -> std::result::Result<PotentialPiece, &'r Expression> {
    let region = region(regions, centre)?;
    let value = &regions[region].value;
    Ok(PotentialPiece { region, constant: value.is_stepped().then(|| value.eval(centre)) })
}

/// Whether one formula gives `V` on the whole grid.
pub fn is_one_piece(potential: &[Region]) -> bool {
    potential.len() == 1 && !potential[0].value.is_stepped()
}

/// Centre of space cell `i`, which is its node, as formulas take it.
pub fn space_point(axes: &[Axis], i: &[usize]) -> [f64; 6] {
    let mut point = [0.0; 6];
    for (a, axis) in axes.iter().enumerate() {
        point[a] = axis.centre(i[a] as i64);
    }
    point
}

/// Centre of the element that holds space cell `i`.
pub(super) fn element_centre(axes: &[Axis], i: &[usize]) -> [f64; 6] {
    let mut point = [0.0; 6];
    for (a, axis) in axes.iter().enumerate() {
        point[a] = axis.at(axis.element_of(i[a] as i64), 0.0);
    }
    point
}

/// The largest `v²/2` along an axis of the box: the scale of differences of `V`.
pub(super) fn energy_scale(space: &PhaseSpace) -> f64 {
    let fastest = space.v.iter().map(Axis::largest_magnitude);
    fastest.fold(0.0, |most: f64, v| most.max(0.5 * v * v))
}

/// All elements of `axes`, which have degree 0; if there are more than `most`, that many, spread
/// over the grid.
pub(super) fn spread(
    axes: &[Axis],
    most: usize,
) -> impl Iterator<Item = [usize; MAX_DIMENSION]> + '_ {
    let all: usize = axes.iter().map(|axis| axis.cells).product();
    let index = move |k: usize| {
        if all <= most { k } else { evenly_spread_index(k, all) }
    };
    (0..all.min(most)).map(index).map(move |mut index| {
        let mut element = [0; MAX_DIMENSION];
        for (at, axis) in element.iter_mut().zip(axes).rev() {
            (*at, index) = (index % axis.cells, index / axis.cells);
        }
        element
    })
}
