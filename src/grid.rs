//! The phase-space grid: axes, cells, and the one ordering of unknowns.
//!
//! Cells are ordered `(x1..xn, v1..vn)` row-major, the last velocity axis running fastest.

/// A uniform axis: cells `[lower + j h, lower + (j+1) h]`, `h = (upper − lower)/cells`.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// Lower end of the box.
    pub lower: f64,
    /// Upper end of the box.
    pub upper: f64,
    /// Number of cells.
    pub cells: usize,
}

impl Axis {
    /// Cell width `h`.
    pub fn width(&self) -> f64 {
        (self.upper - self.lower) / self.cells as f64
    }

    /// A point `j/denominator` of the way along the axis, in units of cells; mirror images of an axis give exact
    /// mirror images of its points. `twice` counts half cells: an odd number is a centre, an even one a face.
    fn point(&self, twice: f64) -> f64 {
        let n = 2.0 * self.cells as f64;
        ((n - twice) * self.lower + twice * self.upper) / n
    }

    /// Centre of cell `j`; `j` may lie outside `0..cells` (ghost cells).
    pub fn centre(&self, j: i64) -> f64 {
        self.point(2.0 * j as f64 + 1.0)
    }

    /// Lower face of cell `j`, the upper face of cell `j − 1`.
    pub fn face(&self, j: i64) -> f64 {
        self.point(2.0 * j as f64)
    }

    /// Cell centres, in order.
    pub fn centres(&self) -> Vec<f64> {
        (0..self.cells as i64).map(|j| self.centre(j)).collect()
    }
}

/// The product of `n` space axes and `n` velocity axes.
#[derive(Clone, Debug, PartialEq)]
pub struct PhaseSpace {
    /// Space axes x1..xn.
    pub x: Vec<Axis>,
    /// Velocity axes v1..vn.
    pub v: Vec<Axis>,
    /// Which of the space axes close on themselves: behind the last cell comes the first.
    pub periodic: [bool; MAX_DIMENSION],
}

/// Largest number of space dimensions.
pub const MAX_DIMENSION: usize = 3;

/// A cell as `[i1..in, j1..jn]`, unused entries zero.
pub type Cell = [usize; 2 * MAX_DIMENSION];

impl PhaseSpace {
    /// Number of space dimensions `n`.
    pub fn dimension(&self) -> usize {
        self.x.len()
    }

    /// The `2n` axes in storage order.
    pub fn axes(&self) -> impl Iterator<Item = &Axis> {
        self.x.iter().chain(&self.v)
    }

    /// `(N_x1, …, N_xn, N_v1, …, N_vn)`.
    pub fn shape(&self) -> Vec<usize> {
        self.axes().map(|a| a.cells).collect()
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

    /// Volume of a phase-space cell, `Π Δx Δv`.
    pub fn cell_volume(&self) -> f64 {
        self.axes().map(Axis::width).product()
    }

    /// Volume of a velocity cell, `Π Δv`.
    pub fn velocity_volume(&self) -> f64 {
        self.v.iter().map(Axis::width).product()
    }

    /// Multi-index of global unknown `index`.
    pub fn cell(&self, mut index: usize) -> Cell {
        let n = self.dimension();
        let mut cell = Cell::default();
        for (a, axis) in self.v.iter().enumerate().rev() {
            cell[n + a] = index % axis.cells;
            index /= axis.cells;
        }
        for (a, axis) in self.x.iter().enumerate().rev() {
            cell[a] = index % axis.cells;
            index /= axis.cells;
        }
        cell
    }

    /// Global index of the unknown at `cell`.
    pub fn index(&self, cell: &Cell) -> usize {
        self.axes()
            .zip(cell)
            .fold(0, |index, (axis, &j)| index * axis.cells + j)
    }

    /// Whether space axis `a` closes on itself.
    pub fn is_periodic(&self, a: usize) -> bool {
        self.periodic[a]
    }

    /// The cell at place `i` along space axis `a`: counted on around a periodic axis, `None` off the grid.
    pub fn wrap(&self, a: usize, i: i64) -> Option<usize> {
        let cells = self.x[a].cells as i64;
        let i = if self.periodic[a] {
            i.rem_euclid(cells)
        } else {
            i
        };
        (0..cells).contains(&i).then_some(i as usize)
    }

    /// Whether the cells of space axis `a` are their own neighbours: a periodic axis of one cell.
    pub fn is_single(&self, a: usize) -> bool {
        self.periodic[a] && self.x[a].cells == 1
    }

    /// Most space blocks along space axis `a`. A periodic axis stays whole, so that the cell behind its end is on the same rank.
    pub fn most_blocks(&self, a: usize) -> usize {
        if self.periodic[a] { 1 } else { self.x[a].cells }
    }

    /// How far apart in the ordering two cells are that differ by one along axis `axis` (of the `2n`).
    pub fn stride(&self, axis: usize) -> usize {
        self.axes().skip(axis + 1).map(|a| a.cells).product()
    }

    /// Centre of a cell as formulas take it: `[x, y, z, vx, vy, vz]`, absent ones zero.
    pub fn point(&self, cell: &Cell) -> [f64; 6] {
        let n = self.dimension();
        let mut point = [0.0; 6];
        for a in 0..n {
            point[a] = self.x[a].centre(cell[a] as i64);
            point[3 + a] = self.v[a].centre(cell[n + a] as i64);
        }
        point
    }
}

/// A point written for people: `x = 0.1, v = -0.2`.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ordering_is_row_major_with_velocity_fastest() {
        let axis = |cells| Axis {
            lower: -1.0,
            upper: 2.0,
            cells,
        };
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
        let axis = Axis {
            lower: -0.3,
            upper: 1.7,
            cells: 7,
        };
        let mirror = Axis {
            lower: -1.7,
            upper: 0.3,
            cells: 7,
        };
        for j in 0..7 {
            assert_eq!(axis.centre(j), -mirror.centre(6 - j));
        }
        let odd = Axis {
            lower: -1.5,
            upper: 1.5,
            cells: 33,
        };
        assert_eq!(odd.centre(16), 0.0);
    }
}
