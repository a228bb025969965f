//! The deposits of followed boxes, added up on a share of the space cells.

use crate::problem::grid::{MAX_DIMENSION, PhaseSpace, box_cells};
use std::ops::Range;

/// Cells with less than this fraction of the largest mass count as empty: particles within 1e-11 of
/// a face are in the cell above it, and may leave a trace of mass there.
const EMPTY: f64 = 1e-9;
/// Points further apart than this fraction of a cell are not neighbours on a branch.
const GAP: f64 = 1e-6;

/// The mass that a first box leaves in a cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Deposit {
    /// Number of the box on its sheet.
    pub number: usize,
    /// Number of the cell, row-major in the space grid.
    pub cell: usize,
    /// Mass.
    pub mass: f64,
    /// Mass times velocity, by axis.
    pub momentum: [f64; MAX_DIMENSION],
}

/// A piece of the curve in one dimension.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Line {
    /// Number of its first box on its sheet.
    pub number: usize,
    /// History of the piece (see [`TracedPath`](crate::problem::exact::TracedPath)).
    pub history: u64,
    /// The branch's part of the density.
    pub density: f64,
    /// Position and velocity of its ends.
    pub ends: [[f64; 2]; 2],
}

/// The multivalued velocity in one dimension: points along the branches.
#[derive(Clone, Debug, Default)]
pub struct MultivaluedVelocity {
    /// Position.
    pub x: Vec<f64>,
    /// Velocity.
    pub v: Vec<f64>,
    /// `ρ0/|∂x/∂x0|`, the branch's part of the density.
    pub density: Vec<f64>,
    /// Number of the branch, from 0. Neighbouring points of a branch are joined by a line.
    pub branch: Vec<f64>,
}

/// The exact moments on the space cells of a share, as averages over cells.
#[derive(Clone, Debug)]
pub struct ExactMoments {
    /// `ρ`, row-major.
    pub density: Vec<f64>,
    /// `ρ u_a`, one vector per axis.
    pub momentum: Vec<Vec<f64>>,
    /// `u_a`, one vector per axis; NaN in empty cells.
    pub velocity: Vec<Vec<f64>>,
    /// The whole multivalued velocity, in one dimension.
    pub curve: Option<MultivaluedVelocity>,
}

/// The mass and momentum that deposits add up to on a share of the space cells, and the curve.
pub struct SheetSums<'a> {
    space: &'a PhaseSpace,
    share: &'a [Range<usize>],
    mass: Vec<f64>,
    momentum: Vec<Vec<f64>>,
    curve: MultivaluedVelocity,
    /// History and end of the last piece on the curve.
    last: Option<(u64, [f64; 2])>,
}

impl<'a> SheetSums<'a> {
    /// No mass on the space cells of `share`, which has one range per space axis.
    pub fn new(space: &'a PhaseSpace, share: &'a [Range<usize>]) -> Self {
        let cells = share.iter().map(ExactSizeIterator::len).product();
        Self {
            space,
            share,
            mass: vec![0.0; cells],
            momentum: vec![vec![0.0; cells]; space.dimension()],
            curve: MultivaluedVelocity::default(),
            last: None,
        }
    }

    /// Adds a deposit in a cell of the share. The bits of the sums depend on the order of deposits.
    pub fn add(&mut self, deposit: &Deposit) {
        let (mut rest, mut place, mut stride) = (deposit.cell, 0, 1);
        for (axis, range) in self.space.x.iter().zip(self.share).rev() {
            place += (rest % axis.cells - range.start) * stride;
            rest /= axis.cells;
            stride *= range.len();
        }
        self.mass[place] += deposit.mass;
        for (sums, momentum) in self.momentum.iter_mut().zip(deposit.momentum) {
            sums[place] += momentum;
        }
    }

    /// Adds the next piece of the curve: its second end, and its first end if it begins a branch.
    /// Pieces must be added in their order along the curve.
    pub fn draw(&mut self, line: &Line) {
        let width = [self.space.x[0].width(), self.space.v[0].width()];
        let [first, last] = line.ends;
        let continues = self.last.is_some_and(|(before, end)| {
            line.history == before
                && (first[0] - end[0]).abs() < GAP * width[0]
                && (first[1] - end[1]).abs() < GAP * width[1]
        });
        let mut branch = self.curve.branch.last().copied().unwrap_or(-1.0);
        let curve = &mut self.curve;
        let mut add = |[x, v]: [f64; 2], branch: f64| {
            curve.x.push(x);
            curve.v.push(v);
            curve.density.push(line.density);
            curve.branch.push(branch);
        };
        if !continues {
            branch += 1.0;
            add(first, branch);
        }
        add(last, branch);
        self.last = Some((line.history, last));
    }

    /// The largest mass in a cell of the share.
    pub fn largest(&self) -> f64 {
        self.mass.iter().fold(0.0, |m: f64, x| m.max(x.abs()))
    }

    /// The moments; `largest` is the largest mass in a cell of any share.
    pub fn finish(self, largest: f64) -> ExactMoments {
        let space = self.space;
        let volume = |i| space.x.iter().zip(i).map(|(axis, i)| axis.weight(i)).product();
        let volumes: Vec<f64> = box_cells(self.share).map(volume).collect();
        let average =
            |sums: &Vec<f64>| sums.iter().zip(&volumes).map(|(sum, volume)| sum / volume).collect();
        let mean = |momentum: &Vec<f64>| {
            let ratio = |(p, m): (&f64, &f64)| {
                if m.abs() > EMPTY * largest { p / m } else { f64::NAN }
            };
            momentum.iter().zip(&self.mass).map(ratio).collect()
        };
        ExactMoments {
            density: average(&self.mass),
            momentum: self.momentum.iter().map(average).collect(),
            velocity: self.momentum.iter().map(mean).collect(),
            curve: (space.dimension() == 1).then_some(self.curve),
        }
    }
}
