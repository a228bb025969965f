//! What a search for a grid finds: the coarsest grid on which a scheme meets the accuracy, and the
//! evidence for its error.

use crate::study::advise::scheme::SchemeChoice;
use crate::study::order::Order;
use serde::Serialize;

/// A grid and the error of the density on it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MeasuredGrid {
    /// Elements along each axis.
    pub shape: Vec<usize>,
    /// Relative L1 error of the density.
    pub error: f64,
}

/// The evidence for an error.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Evidence {
    /// Compared with the exact solution.
    Measured,
    /// Compared with a grid twice as fine, by Richardson's estimate.
    Estimated,
    /// Extrapolated from coarser grids by the order.
    #[default]
    Extrapolated,
}

/// The coarsest grid on which a scheme reaches the accuracy.
#[derive(Clone, Debug)]
pub struct ReachedGrid {
    /// The scheme.
    pub scheme: SchemeChoice,
    /// Elements along each axis.
    pub shape: Vec<usize>,
    /// Relative L1 error of the density on it.
    pub error: f64,
    /// The evidence for the error.
    pub known: Evidence,
    /// The order that `grids` show.
    pub order: Order,
    /// The sequence of grids.
    pub grids: Vec<MeasuredGrid>,
    /// The part of the error that is due to space, between 0 and 1; the rest is due to velocity. It
    /// follows from the changes on two grids, one twice as fine in space and one in velocity. None
    /// if the budget does not hold these grids, or nothing changes.
    pub part_of_space: Option<f64>,
}

impl ReachedGrid {
    /// Whether the grid is extrapolated by an order that is assumed, or is from one pair of errors:
    /// another grid of the sequence may give another one.
    pub fn is_open(&self) -> bool {
        self.known == Evidence::Extrapolated && self.order.pairs.len() < 2
    }

    /// The shape of the first grid of the sequence.
    pub fn first(&self) -> &[usize] {
        self.grids.first().map_or(&self.shape, |grid| &grid.shape)
    }

    /// The error on another grid, extrapolated by the order. The parts of space and velocity each
    /// scale with the elements along their own axes. None if no grid was tried.
    pub fn extrapolated(&self, shape: &[usize]) -> Option<DensityError> {
        let grid = self.grids.last()?;
        // The finest grid that was tried.
        let (tried, error) = match self.known {
            Evidence::Extrapolated => (&grid.shape, grid.error),
            _ => (&self.shape, self.error),
        };
        let [space, velocity] = self.parts(tried, shape, self.part_of_space.unwrap_or(0.5));
        let ratio = space + velocity;
        Some(DensityError { error: error * ratio, known: Evidence::Extrapolated })
    }

    /// The part of the error on another grid that is due to space, by the order.
    pub fn part_of_space_on(&self, shape: &[usize]) -> Option<f64> {
        let [space, velocity] = self.parts(&self.shape, shape, self.part_of_space?);
        Some(space / (space + velocity))
    }

    /// The errors due to space and to velocity on the grid `to`, relative to the whole error on the
    /// grid `from`, of which `part_of_space` is due to space: each falls with the elements along
    /// its own axes.
    fn parts(&self, from: &[usize], to: &[usize], part_of_space: f64) -> [f64; 2] {
        let n = to.len() / 2;
        let finer = |axes: std::ops::Range<usize>| {
            let ratio = |k: usize| to[k] as f64 / from[k] as f64;
            let product: f64 = axes.map(ratio).product();
            product.powf(-self.order.counted_on / n as f64)
        };
        [part_of_space * finer(0..n), (1.0 - part_of_space) * finer(n..2 * n)]
    }
}

/// An error of the density, and the evidence for it.
#[derive(Clone, Copy, Debug)]
pub struct DensityError {
    /// Relative L1 error of the density.
    pub error: f64,
    /// The evidence for it.
    pub known: Evidence,
}
