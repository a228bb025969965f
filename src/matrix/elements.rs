//! The elements of the grid in phase space, and matrices along the axes of their values.

use crate::problem::element::Nodes;
use crate::problem::grid::{Cell, PhaseSpace, coordinate, for_each_cell};
use std::ops::Range;

/// An element of the grid: the product of one element along each axis.
pub struct Element<'a> {
    space: &'a PhaseSpace,
    /// Number of the element along each of the `2n` axes.
    pub index: Cell,
}

/// Calls `visit` with every element over the space cells `ranges`, which are of whole elements, and
/// all velocities.
pub fn for_each_element(
    space: &PhaseSpace,
    ranges: &[Range<usize>],
    mut visit: impl FnMut(&Element<'_>),
) {
    let n = space.dimension();
    let of_space: Vec<Range<usize>> = (space.x.iter().zip(ranges))
        .map(|(a, r)| r.start / a.nodes.count()..r.end / a.nodes.count())
        .collect();
    let of_velocity: Vec<Range<usize>> = space.v.iter().map(|a| 0..a.elements()).collect();
    for_each_cell(&of_space, |i| {
        for_each_cell(&of_velocity, |j| {
            let mut index = Cell::default();
            index[..n].copy_from_slice(&i[..n]);
            index[n..2 * n].copy_from_slice(&j[..n]);
            visit(&Element { space, index });
        });
    });
}

impl Element<'_> {
    fn nodes(&self) -> impl Iterator<Item = Nodes> {
        self.space.axes().map(|axis| axis.nodes)
    }

    /// Nodes along each axis.
    pub fn shape(&self) -> Vec<usize> {
        self.nodes().map(|nodes| nodes.count()).collect()
    }

    /// Quadrature weights of its nodes: products of those on `[−1, 1]`, the last axis fastest.
    pub fn weights(&self) -> Vec<f64> {
        products(self.nodes().map(|nodes| &nodes.reference().weights[..]))
    }

    /// The point with the coordinates `xi` in the reference element.
    pub fn point(&self, xi: &[f64]) -> [f64; 6] {
        let n = self.space.dimension();
        let mut point = [0.0; 6];
        for (a, axis) in self.space.axes().enumerate() {
            point[coordinate(n, a)] = axis.at(self.index[a] as i64, xi[a]);
        }
        point
    }

    /// Its nodal values, of `values` on the space cells `ranges` with all velocities.
    pub fn nodal(&self, ranges: &[Range<usize>], values: &[f64]) -> Vec<f64> {
        let mut nodal = vec![0.0; self.shape().iter().product()];
        self.for_each_cell(ranges, |cell, node| nodal[node] = values[cell]);
        nodal
    }

    /// Calls `visit(cell, node)` for each of its cells, with the number of the cell in a block or
    /// share of the space cells `ranges` with all velocities, and its number in the element.
    pub fn for_each_cell(&self, ranges: &[Range<usize>], mut visit: impl FnMut(usize, usize)) {
        let cells = self.space.cells_of(&self.index, ranges).enumerate();
        cells.for_each(|(node, cell)| visit(cell, node));
    }

    /// The points of the product of the coordinates `along` the axes, the last axis fastest.
    pub fn points(&self, along: &[impl AsRef<[f64]>]) -> Vec<[f64; 6]> {
        self.space.points_in(&self.index, along).collect()
    }
}

/// The products of one of the `factors` along each axis, the last axis fastest.
pub fn products<'a>(factors: impl Iterator<Item = &'a [f64]>) -> Vec<f64> {
    factors.fold(vec![1.0], |products, factors| {
        products.iter().flat_map(|p| factors.iter().map(move |factor| p * factor)).collect()
    })
}

/// Applies a matrix along each axis to `values`, the last axis fastest.
pub fn apply_along_all<'a>(
    values: &[f64],
    matrices: impl Iterator<Item = &'a Vec<Vec<f64>>>,
) -> Vec<f64> {
    let axes: Vec<_> = matrices.map(|matrix| AxisMatrix { elements: 1, matrix }).collect();
    apply_in_elements(values, &axes)
}

/// The matrix that is applied along an axis in each of its elements.
pub struct AxisMatrix<'a> {
    /// Number of elements of the axis.
    pub elements: usize,
    /// Rows of the matrix, with a column for each cell of an element.
    pub matrix: &'a [Vec<f64>],
}

/// Applies a matrix along each of the `axes` in each of its elements. The last axis of `values` is
/// the fastest.
pub fn apply_in_elements(values: &[f64], axes: &[AxisMatrix<'_>]) -> Vec<f64> {
    let mut values = values.to_vec();
    let mut stride = 1;
    for AxisMatrix { elements, matrix } in axes.iter().rev() {
        let (rows, columns) = (matrix.len(), matrix[0].len());
        let outer = values.len() / (columns * stride);
        let mut next = vec![0.0; outer * rows * stride];
        for o in 0..outer {
            for (m, row) in matrix.iter().enumerate() {
                let out = &mut next[(o * rows + m) * stride..(o * rows + m + 1) * stride];
                for (q, c) in row.iter().enumerate() {
                    let from = &values[(o * columns + q) * stride..(o * columns + q + 1) * stride];
                    out.iter_mut().zip(from).for_each(|(out, value)| *out += c * value);
                }
            }
        }
        values = next;
        stride *= rows * elements;
    }
    values
}
