//! The phase-space grid: axes, cells, and the one ordering of unknowns.
//!
//! An axis has elements of equal width with `degree + 1` nodes each (see
//! [`element`](crate::problem::element)). A *cell* belongs to one node: it is one unknown along the
//! axis, with the node as its centre and the quadrature weight as its width. For degree 0 an
//! element is a cell.
//!
//! Cells are ordered `(x1..xn, v1..vn)` row-major, the last velocity axis running fastest.

mod axis;

pub use crate::problem::grid::axis::{Axis, AxisPart};

use crate::base::row_major::{self, number};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use std::ops::Range;

/// The product of `n` space axes and `n` velocity axes.
#[derive(Clone, Debug, PartialEq)]
pub struct PhaseSpace {
    /// Space axes x1..xn.
    pub x: Vec<Axis>,
    /// Velocity axes v1..vn.
    pub v: Vec<Axis>,
    /// Which space axes are periodic: the first cell follows the last one.
    pub periodic: [bool; MAX_DIMENSION],
}

/// Largest number of space dimensions.
pub const MAX_DIMENSION: usize = 3;
/// Names of the axes of space.
pub const SPACE_NAMES: [&str; MAX_DIMENSION] = ["x", "y", "z"];

/// A cell as `[i1..in, j1..jn]`, unused entries zero.
pub type Cell = [usize; 2 * MAX_DIMENSION];

/// An end of an axis, of the `2n`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AxisEnd {
    /// Index of the axis, space first.
    pub axis: usize,
    /// Whether the end is the upper one.
    pub upper: bool,
}

impl AxisEnd {
    /// Number of the end among those of all axes: lower, upper of the first axis, and so on.
    pub fn number(self) -> usize {
        2 * self.axis + usize::from(self.upper)
    }
}

/// Index in `[x, y, z, vx, vy, vz]` of axis number `axis` of the `2n`, in `n` dimensions.
pub fn coordinate(n: usize, axis: usize) -> usize {
    if axis < n { axis } else { 3 + axis - n }
}

impl PhaseSpace {
    /// This box cut into `shape` elements.
    pub fn with_elements(&self, shape: &[usize]) -> Self {
        let mut space = self.clone();
        let axes = space.x.iter_mut().chain(&mut space.v);
        axes.zip(shape).for_each(|(axis, n)| axis.cells = n.saturating_mul(axis.nodes.count()));
        space
    }

    /// The grid of the case, before it was reduced.
    pub fn whole(&self) -> Self {
        self.with_axes(Axis::whole)
    }

    /// This grid with `changed(axis)` in place of each axis.
    pub fn with_axes(&self, changed: impl Fn(&Axis) -> Axis) -> Self {
        let all = |axes: &[Axis]| axes.iter().map(&changed).collect();
        Self { x: all(&self.x), v: all(&self.v), periodic: self.periodic }
    }

    /// Number of space dimensions `n`.
    pub fn dimension(&self) -> usize {
        self.x.len()
    }

    /// The `2n` axes in storage order.
    pub fn axes(&self) -> impl Iterator<Item = &Axis> {
        self.x.iter().chain(&self.v)
    }

    /// Axis number `k` of the `2n`, space first.
    pub fn axis(&self, k: usize) -> &Axis {
        let n = self.dimension();
        if k < n { &self.x[k] } else { &self.v[k - n] }
    }

    /// Number of cells along each axis, `(N_x1, …, N_xn, N_v1, …, N_vn)`.
    pub fn shape(&self) -> Vec<usize> {
        self.axes().map(|a| a.cells).collect()
    }

    /// Number of elements along each axis.
    pub fn elements(&self) -> Vec<usize> {
        self.axes().map(Axis::elements).collect()
    }

    /// All cells of space, one range for each space axis.
    pub fn space_ranges(&self) -> Vec<Range<usize>> {
        self.x.iter().map(|axis| 0..axis.cells).collect()
    }

    /// All cells of velocity, one range for each velocity axis.
    pub fn velocity_ranges(&self) -> Vec<Range<usize>> {
        self.v.iter().map(|axis| 0..axis.cells).collect()
    }

    /// The row-major index of a `cell` of space among all.
    pub fn space_index(&self, cell: &[usize]) -> usize {
        number(self.x.iter().map(|axis| axis.cells), cell.iter().copied())
    }

    /// Number of cells of space alone.
    pub fn space_cells(&self) -> usize {
        self.x.iter().map(|a| a.cells).product()
    }

    /// Number of velocity cells at one point of space.
    pub fn velocity_cells(&self) -> usize {
        self.v.iter().map(|a| a.cells).product()
    }

    /// Number of unknowns.
    pub fn cells(&self) -> usize {
        self.space_cells() * self.velocity_cells()
    }

    /// Mean volume of a phase-space cell. For degree 0 all cells have this volume, `Π Δx Δv`.
    pub fn cell_volume(&self) -> f64 {
        self.axes().map(Axis::mean_width).product()
    }

    /// Mean volume of a velocity cell. For degree 0 all cells have this volume, `Π Δv`.
    pub fn velocity_cell_volume(&self) -> f64 {
        self.v.iter().map(Axis::mean_width).product()
    }

    /// Volume of the box in phase space.
    pub fn box_volume(&self) -> f64 {
        volume(self.axes())
    }

    /// Volume of the box in space.
    pub fn space_box_volume(&self) -> f64 {
        volume(self.x.iter())
    }

    /// Volume of the velocity box.
    pub fn velocity_box_volume(&self) -> f64 {
        volume(self.v.iter())
    }

    /// Volume of a cell relative to the mean: the product over the axes of `w_m (k + 1)/2` with the
    /// quadrature weights `w_m`. For degree 0 it is exactly 1.
    pub fn relative_volume(&self, cell: &Cell) -> f64 {
        self.axes().zip(cell).map(|(axis, &j)| axis.relative_weight(j)).product()
    }

    /// The least [`relative_volume`](Self::relative_volume) of a cell.
    pub fn least_relative_volume(&self) -> f64 {
        let least = |axis: &Axis| {
            let weights = (0..axis.nodes.count()).map(|m| axis.relative_weight(m));
            weights.fold(f64::INFINITY, f64::min)
        };
        self.axes().map(least).product()
    }

    /// Largest degree of an axis.
    pub fn degree(&self) -> usize {
        self.axes().map(|a| a.nodes.degree).max().unwrap_or(0)
    }

    /// Lowest degree of an axis of more than one cell.
    pub fn lowest_degree(&self) -> usize {
        let axes = self.axes().filter(|axis| axis.cells > 1);
        axes.map(|axis| axis.nodes.degree).min().unwrap_or(0)
    }

    /// Largest degree of an axis of the [`whole`](Self::whole) grid. It is larger than that of this
    /// grid if all axes of degrees above 0 were merged.
    pub fn whole_degree(&self) -> usize {
        self.axes().map(|a| a.whole().nodes.degree).max().unwrap_or(0)
    }

    /// This grid with the same elements and degree 0.
    pub fn by_elements(&self) -> Self {
        self.with_axes(Axis::by_elements)
    }

    /// The tensor product of points `along` the axes, given in `[−1, 1]` of the element that has
    /// the number `element[a]` along axis `a`. The last axis runs fastest.
    pub fn points_in<P: AsRef<[f64]>>(
        &self,
        element: &[usize],
        along: &[P],
    ) -> impl Iterator<Item = [f64; 6]> + use<P> {
        let n = self.dimension();
        let coordinates: Vec<Vec<f64>> = (self.axes().zip(along).zip(element))
            .map(|((axis, xi), j)| xi.as_ref().iter().map(|xi| axis.at(*j as i64, *xi)).collect())
            .collect();
        let mut place = vec![0; coordinates.len()];
        (0..coordinates.iter().map(Vec::len).product()).map(move |_| {
            let mut point = [0.0; 6];
            for (a, (along, at)) in coordinates.iter().zip(&place).enumerate() {
                point[coordinate(n, a)] = along[*at];
            }
            for (at, along) in place.iter_mut().zip(&coordinates).rev() {
                *at += 1;
                if *at < along.len() {
                    break;
                }
                *at = 0;
            }
            point
        })
    }

    /// Multi-index of global unknown `index`.
    pub fn cell(&self, mut index: usize) -> Cell {
        let mut cell = Cell::default();
        let axes = self.x.iter().chain(&self.v).rev();
        for (i, axis) in cell[..2 * self.dimension()].iter_mut().rev().zip(axes) {
            (*i, index) = (index % axis.cells, index / axis.cells);
        }
        cell
    }

    /// Global index of the unknown at `cell`.
    pub fn index(&self, cell: &Cell) -> usize {
        number(self.axes().map(|axis| axis.cells), cell.iter().copied())
    }

    /// The numbers of the unknowns of the element that has these numbers along the axes, in the
    /// space cells `ranges` with all velocities. For [`space_ranges`](Self::space_ranges) these are
    /// the global indices.
    pub fn cells_of(
        &self,
        element: &Cell,
        ranges: &[Range<usize>],
    ) -> impl Iterator<Item = usize> + use<> {
        let of_space = self.x.iter().zip(ranges.iter().cloned());
        let of_velocity = self.v.iter().map(|axis| (axis, 0..axis.cells));
        let cells = of_space.chain(of_velocity).zip(element).fold(
            vec![0],
            |cells, ((axis, Range { start, end }), e)| {
                let count = axis.nodes.count();
                let along = move |index| {
                    (e * count..(e + 1) * count).map(move |j| index * (end - start) + j - start)
                };
                cells.into_iter().flat_map(along).collect()
            },
        );
        cells.into_iter()
    }

    /// Whether space axis `a` is periodic.
    pub fn is_periodic(&self, a: usize) -> bool {
        self.periodic[a]
    }

    /// The axes in storage order: name, axis, and whether it is periodic. Velocity axes never are.
    pub fn named_axes(&self) -> impl Iterator<Item = (&'static str, &Axis, bool)> {
        let n = self.dimension();
        let axes = axis_names(n).into_iter().zip(self.axes()).enumerate();
        axes.map(move |(a, (name, axis))| (name, axis, a < n && self.is_periodic(a)))
    }

    /// The cell of number `i` along space axis `a`, modulo the number of cells on a periodic axis;
    /// `None` off the grid.
    pub fn wrap(&self, a: usize, i: i64) -> Option<usize> {
        let cells = self.x[a].cells as i64;
        let i = if self.periodic[a] { i.rem_euclid(cells) } else { i };
        (0..cells).contains(&i).then_some(i as usize)
    }

    /// Whether the cells of space axis `a` are their own neighbours: a periodic axis of one cell.
    pub fn is_single(&self, a: usize) -> bool {
        self.periodic[a] && self.x[a].cells == 1
    }

    /// Largest number of blocks along space axis `a`, each of whole elements. A periodic axis is
    /// not split, so that both of its ends are on the same rank.
    pub fn most_blocks(&self, a: usize) -> usize {
        if self.periodic[a] { 1 } else { self.x[a].elements() }
    }

    /// Difference of the indices of two cells that are neighbours along axis `axis` (of the `2n`).
    pub fn stride(&self, axis: usize) -> usize {
        self.axes().skip(axis + 1).map(|a| a.cells).product()
    }

    /// Centre of a cell as formulas take it, `[x, y, z, vx, vy, vz]`; absent coordinates are zero.
    pub fn point(&self, cell: &Cell) -> [f64; 6] {
        let n = self.dimension();
        let mut point = [0.0; 6];
        for a in 0..n {
            point[a] = self.x[a].centre(cell[a] as i64);
            point[3 + a] = self.v[a].centre(cell[n + a] as i64);
        }
        point
    }

    /// The open ends of the box.
    pub fn open_ends(&self) -> Vec<AxisEnd> {
        let n = self.dimension();
        let axes = (0..2 * n).filter(|&a| a >= n || !self.is_periodic(a));
        axes.flat_map(|axis| [false, true].map(|upper| AxisEnd { axis, upper })).collect()
    }

    /// `count` random points of the box, the same in every call.
    pub fn random_points(&self, count: usize) -> Vec<[f64; 6]> {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let n = self.dimension();
        let mut points = vec![[0.0; 6]; count];
        for point in &mut points {
            for (k, axis) in self.axes().enumerate() {
                let part = f64::from(random.next_u32()) / 2f64.powi(32);
                point[coordinate(n, k)] = axis.lower + part * (axis.upper - axis.lower);
            }
        }
        points
    }

    /// The [`point`](Self::point) of the cell that holds `point`, or is nearest to it.
    pub fn nearest_centre(&self, point: &[f64; 6]) -> [f64; 6] {
        let mut cell = [0; 6];
        let n = self.dimension();
        for (k, axis) in self.axes().enumerate() {
            cell[k] = axis.cell_at(point[coordinate(n, k)]);
        }
        self.point(&cell)
    }

    /// The [`point`](Self::point) of a cell at which formulas are evaluated that may have edges on
    /// faces: beside a face on which it lies, in its element.
    pub fn point_in_element(&self, cell: &Cell) -> [f64; 6] {
        self.point_with(cell, Axis::centre_in_element)
    }

    /// The [`point`](Self::point) of a cell. If it is on a face of space, it is moved inside its
    /// element by a billionth of the width, as a function may jump at the face.
    pub fn inner_point(&self, cell: &Cell) -> [f64; 6] {
        self.point_with(cell, Axis::inner_centre)
    }

    /// The [`point`](Self::point) of a cell, with other coordinates in space.
    fn point_with(&self, cell: &Cell, coordinate: fn(&Axis, i64) -> f64) -> [f64; 6] {
        let mut point = self.point(cell);
        for (a, axis) in self.x.iter().enumerate() {
            point[a] = coordinate(axis, cell[a] as i64);
        }
        point
    }
}

/// Volume of the box that these axes span.
fn volume<'a>(axes: impl Iterator<Item = &'a Axis>) -> f64 {
    axes.map(|axis| axis.upper - axis.lower).product()
}

/// A point as text: `x = 0.1, v = -0.2`.
pub fn describe_point(dimension: usize, point: &[f64]) -> String {
    let names: &[&str] = match dimension {
        1 => &["x", "v"],
        2 => &["x", "y", "vx", "vy"],
        _ => &["x", "y", "z", "vx", "vy", "vz"],
    };
    let slots = (0..dimension).chain(3..3 + dimension);
    names
        .iter()
        .zip(slots)
        .filter_map(|(name, slot)| point.get(slot).map(|p| format!("{name} = {p}")))
        .collect::<Vec<_>>()
        .join(", ")
}

/// Names of the axes in storage order.
pub fn axis_names(dimension: usize) -> Vec<&'static str> {
    let v = ["vx", "vy", "vz"];
    SPACE_NAMES[..dimension].iter().chain(&v[..dimension]).copied().collect()
}

/// Every multi-index of a box, row-major.
pub fn box_cells(ranges: &[Range<usize>]) -> impl Iterator<Item = [usize; MAX_DIMENSION]> {
    let mut next = std::array::from_fn(|a| ranges.get(a).map_or(0, |range| range.start));
    (0..row_major::volume(ranges)).map(move |_| {
        let cell = next;
        for (i, range) in next.iter_mut().zip(ranges).rev() {
            *i += 1;
            if *i < range.end {
                break;
            }
            *i = range.start;
        }
        cell
    })
}

/// Calls `visit` with every multi-index of a box, row-major.
pub fn for_each_cell(ranges: &[Range<usize>], mut visit: impl FnMut(&[usize; MAX_DIMENSION])) {
    box_cells(ranges).for_each(|cell| visit(&cell));
}

/// Averages of cell values, given on a grid of `from` cells along each axis, over the cells of a
/// grid of `to` cells on the same box. Overlaps of cells are weighted by their volume.
pub fn averaged(values: &[f64], from: &[usize], to: &[usize]) -> Vec<f64> {
    let mut shape = from.to_vec();
    let mut values = values.to_vec();
    for a in 0..from.len() {
        let (old, new) = (shape[a], to[a]);
        let inner: usize = shape[a + 1..].iter().product();
        let outer: usize = shape[..a].iter().product();
        let mut result = vec![0.0; outer * new * inner];
        for j in 0..new {
            // Cell j of the new axis is [j old, (j + 1) old) in units of 1/(old new); cell i of the
            // old one [i new, (i + 1) new).
            for i in j * old / new..((j + 1) * old).div_ceil(new).min(old) {
                let common = ((i + 1) * new).min((j + 1) * old) - (i * new).max(j * old);
                let share = common as f64 / old as f64;
                for o in 0..outer {
                    for k in 0..inner {
                        result[(o * new + j) * inner + k] +=
                            share * values[(o * old + i) * inner + k];
                    }
                }
            }
        }
        values = result;
        shape[a] = new;
    }
    values
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::problem::element::Nodes;

    #[test]
    fn ordering_is_row_major_with_velocity_fastest() {
        let axis = |cells| Axis::new(-1.0, 2.0, cells);
        let space = PhaseSpace {
            x: vec![axis(3), axis(4)],
            v: vec![axis(5), axis(2)],
            periodic: [false; MAX_DIMENSION],
        };
        for index in 0..space.cells() {
            assert_eq!(space.index(&space.cell(index)), index);
        }
        assert_eq!(space.cell(1)[..4], [0, 0, 0, 1]);
        assert_eq!(space.stride(0), 40);
        assert_eq!(space.stride(3), 1);
    }

    #[test]
    fn mirrored_axes_have_mirrored_points_exactly() {
        let axis = Axis::new(-0.3, 1.7, 7);
        let mirror = Axis::new(-1.7, 0.3, 7);
        for j in 0..7 {
            assert_eq!(axis.centre(j), -mirror.centre(6 - j));
        }
        let odd = Axis::new(-1.5, 1.5, 33);
        assert_eq!(odd.centre(16), 0.0);
    }

    #[test]
    fn nodes_lie_between_the_faces_of_their_cells() {
        use crate::problem::element::LARGEST_DEGREE;
        for degree in 0..=LARGEST_DEGREE {
            for nodes in [Nodes::of_space(degree), Nodes::of_velocity(degree)] {
                let axis = Axis::new(-0.3, 1.7, 5).with_nodes(nodes);
                let (faces, centres) = (axis.cell_faces(), axis.centres());
                assert_eq!((faces[0], faces[axis.cells]), (-0.3, 1.7));
                for (j, centre) in centres.iter().enumerate() {
                    assert!(faces[j] <= *centre && *centre <= faces[j + 1], "{nodes:?} {j}");
                    let inside = faces[j] + 0.5 * (faces[j + 1] - faces[j]);
                    let found = axis.cell_at(inside);
                    assert_eq!(found / nodes.count(), j / nodes.count(), "{nodes:?} {j}");
                }
                assert_eq!(axis.cell_at(axis.upper), axis.cells - 1);
            }
        }
    }

    #[test]
    fn windows_have_the_points_of_the_whole_exactly() {
        let axis = Axis::new(-0.3, 1.7, 7);
        let window = axis.window(&(2..5));
        assert_eq!(window.width(), axis.width());
        for j in -3..8 {
            assert_eq!(window.centre(j), axis.centre(j + 2));
            assert_eq!(window.face(j), axis.face(j + 2));
            let point = 0.31 * j as f64;
            assert_eq!(window.position(point), axis.position(point) - 2.0);
            let inside = (0..3).contains(&j);
            assert_eq!(window.leaves_out(j), (-2..5).contains(&j) && !inside, "{j}");
        }
        let merged = axis.merged();
        assert_eq!((merged.cells, merged.width()), (1, 2.0));
        assert_eq!(merged.centre(0), 0.7);
        assert!(!merged.leaves_out(0) && !axis.leaves_out(7));
        for part in [window, merged] {
            assert_eq!(part.whole(), axis);
        }
    }

    #[test]
    fn averages_keep_the_sum_and_are_exact_where_grids_nest() {
        let values: Vec<f64> = (0..24).map(|k| ((k * k) % 7) as f64).collect();
        let coarse = averaged(&values, &[6, 4], &[3, 2]);
        for (c, value) in coarse.iter().enumerate() {
            let (i, j) = (c / 2 * 2, c % 2 * 2);
            let four = [(i, j), (i + 1, j), (i, j + 1), (i + 1, j + 1)];
            let mean = four.iter().map(|(i, j)| values[i * 4 + j]).sum::<f64>() / 4.0;
            assert!((value - mean).abs() < 1e-14);
        }
        let other = averaged(&values, &[6, 4], &[5, 7]);
        let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
        assert!((mean(&other) - mean(&values)).abs() < 1e-13);
        // Three cells to two, computed by hand.
        assert_eq!(averaged(&[3.0, 6.0, 9.0], &[3], &[2]), [4.0, 8.0]);
    }
}
