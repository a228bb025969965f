//! Expands results from the reduced grid, on which they are computed, to the grid on which they are
//! written.
//!
//! Each rank expands its own share, as velocity axes and axes of one cell are never split among
//! ranks.

use crate::matrix::observables::Moments;
use crate::parallel::communicator::Communicator;
use crate::parallel::partition::Block;
use crate::plan::Plan;
use crate::problem::case::Case;
use crate::problem::grid::{Axis, AxisPart, PhaseSpace};
use crate::results::dataset::EarlyResult;
use crate::scheme::reduce::grid;
use crate::solve::rank_cells::RankCells;
use std::ops::Range;

/// A case on the grid of its results: the reduced grid with all velocities of the case; with
/// `output.expand` the whole grid of the case.
pub struct ResultGrid {
    /// The case on that grid.
    pub case: Case,
    from: PhaseSpace,
}

impl ResultGrid {
    /// The part of the result grid that belongs to `rank_cells`.
    pub(crate) fn rank_cells(
        &self,
        rank_cells: &RankCells,
        plan: &Plan,
        communicator: &Communicator,
    ) -> RankCells {
        let mesh = &plan.layout.mesh;
        let block = Block::new(&self.case.space, mesh, communicator.space.rank());
        let share = self.share(&rank_cells.share);
        let leading = &block.ranges[0];
        let layer = block.cells() / leading.len();
        let from = |i: usize| (i.max(leading.start) - leading.start) * layer;
        RankCells {
            mine: from(share[0].start)..from(share[0].end),
            ranges: Vec::new(),
            share,
            block,
        }
    }

    /// The result grid of `case`, which may have been reduced.
    pub fn new(case: &Case) -> Self {
        let space = grid(case);
        Self { case: Case { space, ..case.clone() }, from: case.space.clone() }
    }

    /// The space cells to which a rank's `share` of the reduced grid is expanded, one range per
    /// space axis.
    pub fn share(&self, share: &[Range<usize>]) -> Vec<Range<usize>> {
        let axes = self.from.x.iter().zip(&self.case.space.x);
        (share.iter().zip(axes))
            .map(
                |(range, (from, to))| {
                    if range.is_empty() || from == to { range.clone() } else { 0..to.cells }
                },
            )
            .collect()
    }

    /// A field on the reduced grid's `share`, expanded to [`share`](Self::share): repeated where
    /// cells were merged, zero at velocities that were left out.
    pub fn field(&self, share: &[Range<usize>], values: Vec<f64>) -> Vec<f64> {
        let velocities = self.from.v.iter().map(|v| 0..v.cells);
        let ranges: Vec<Range<usize>> = share.iter().cloned().chain(velocities).collect();
        let axes: Vec<(&Axis, &Axis)> = self.from.axes().zip(self.case.space.axes()).collect();
        expand(&axes, &ranges, values)
    }

    /// Values on space cells, expanded in the same way.
    fn points(&self, share: &[Range<usize>], values: Vec<f64>) -> Vec<f64> {
        let axes: Vec<(&Axis, &Axis)> = self.from.x.iter().zip(&self.case.space.x).collect();
        expand(&axes, share, values)
    }

    /// Results at an earlier time on the reduced grid's `share`, expanded to
    /// [`share`](Self::share).
    pub fn early(&self, share: &[Range<usize>], early: EarlyResult) -> EarlyResult {
        let points = |values| self.points(share, values);
        let Moments { density, momentum, velocity, kinetic } = early.moments;
        EarlyResult {
            moments: Moments {
                density: points(density),
                momentum: momentum.into_iter().map(points).collect(),
                velocity: velocity.into_iter().map(points).collect(),
                kinetic: points(kinetic),
            },
            fields: (early.fields.into_iter()).map(|f| self.field(share, f)).collect(),
            ..early
        }
    }
}

/// `values` over the cells `ranges` of the first of each pair of axes, row-major, expanded to the
/// second.
fn expand(axes: &[(&Axis, &Axis)], ranges: &[Range<usize>], values: Vec<f64>) -> Vec<f64> {
    if axes.iter().all(|(from, to)| from == to) || values.is_empty() {
        return values;
    }
    // By axis, for each cell of the expanded axis: the offset of its value, or None for zero.
    let mut stride = 1;
    let mut maps: Vec<Vec<Option<usize>>> = (axes.iter().zip(ranges).rev())
        .map(|((from, to), range)| {
            let step = stride;
            stride *= range.len();
            let value = |place: usize| Some(place * step);
            match from.part {
                _ if from == to => (0..range.len()).map(value).collect(),
                AxisPart::Window { .. } => (0..to.cells)
                    .map(|j| {
                        j.checked_sub(from.first_cell()).filter(|j| *j < from.cells).and_then(value)
                    })
                    .collect(),
                _ => vec![Some(0); to.cells],
            }
        })
        .collect();
    maps.reverse();
    let mut out = Vec::with_capacity(maps.iter().map(Vec::len).product());
    fill(&maps, Some(0), &values, &mut out);
    out
}

/// Appends the expanded values over the axes of `maps`, row-major; `base` is the index of the first
/// value, or `None` if all are zero.
fn fill(maps: &[Vec<Option<usize>>], base: Option<usize>, values: &[f64], out: &mut Vec<f64>) {
    let Some((map, rest)) = maps.split_first() else {
        out.push(base.map_or(0.0, |at| values[at]));
        return;
    };
    for offset in map {
        let at = base.zip(*offset).map(|(base, offset)| base + offset);
        fill(rest, at, values, out);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_repeated_and_filled_up_with_zeros() {
        let (x, y) = (Axis::new(0.0, 1.0, 5), Axis::new(0.0, 2.0, 3));
        let v = Axis::new(-1.0, 1.0, 6);
        let (merged, window) = (y.merged(), v.window(&(2..4)));
        let axes = [(&x, &x), (&merged, &y), (&window, &v)];
        // Cells 1 to 3 of x on this rank.
        let values: Vec<f64> = (1..=6).map(f64::from).collect();
        let out = expand(&axes, &[1..4, 0..1, 0..2], values.clone());
        for (k, value) in out.iter().enumerate() {
            let (i, j) = (k / 18, k % 6);
            let expected = if (2..4).contains(&j) { values[2 * i + j - 2] } else { 0.0 };
            assert_eq!(*value, expected, "{k}");
        }
        assert_eq!(out.len(), 54);
        // A rank without cells changes nothing.
        assert!(expand(&axes, &[1..1, 0..1, 0..2], Vec::new()).is_empty());
        assert_eq!(expand(&axes[..1], std::slice::from_ref(&(1..4)), vec![1.0; 3]), [1.0; 3]);
    }
}
