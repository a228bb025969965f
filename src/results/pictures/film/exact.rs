//! The exact density at any time, on the cells that a frame shows.

use crate::base::text::short;
use crate::problem::case::{Case, Data, Exact};
use crate::problem::exact::Tracer;
use crate::problem::exact::sheet::exact_moments;
use crate::problem::grid::{Cell, for_each_cell};
use crate::results::pictures::cut::Cut;
use crate::results::pictures::mesh::{FineMesh, drawn};
use crate::results::pictures::moments::planes;
use crate::results::pictures::stored::{FINEST, Plane, Read, Stored};

/// Points of phase space at most at which the exact solution of a film is computed: a minute's
/// work.
const MOST_POINTS: usize = 20_000_000;

/// The exact density of a run.
pub struct ExactDensity<'a> {
    case: &'a Case,
    exact: &'a Exact,
    /// Cells of space: in one dimension all, in more those of the planes, plane after plane.
    cells: Vec<Cell>,
}

impl<'a> ExactDensity<'a> {
    /// On what `frames` frames through `cut` show; none where the case names no exact solution.
    ///
    /// # Errors
    /// Why it is not computed.
    pub fn new(run: &'a Stored, cut: &Cut, frames: usize) -> Read<Option<Self>> {
        let Ok(case) = &run.case else {
            return Ok(None);
        };
        let Some(exact) = &case.exact else {
            return Ok(None);
        };
        let cells = shown_cells(run, cut);
        let measure = matches!(case.data, Data::Measure { .. });
        let velocities = if measure { 1 } else { case.space.velocity_cells() };
        let points = cells.len().saturating_mul(velocities).saturating_mul(frames);
        if points > MOST_POINTS {
            return Err(format!(
                "{} points of phase space in all frames; it is computed at no more than {}",
                short(points as f64),
                short(MOST_POINTS as f64)
            ));
        }
        Ok(Some(Self { case, exact, cells }))
    }

    /// The density at a time, cell by cell.
    ///
    /// # Errors
    /// A formula that is not finite.
    pub fn at(&self, time: f64) -> Read<Vec<f64>> {
        let said = |e: crate::base::error::Error| e.to_string();
        let case = Case { end: time, ..self.case.clone() };
        if let Some(moments) = exact_moments(&case).map_err(said)? {
            let space = &case.space;
            let row_major = |cell: &Cell| {
                let axes = space.x.iter().zip(cell);
                axes.fold(0, |index, (axis, i)| index * axis.cells + i)
            };
            return Ok(self.cells.iter().map(|cell| moments.density[row_major(cell)]).collect());
        }
        Ok(match self.exact {
            Exact::Characteristics => {
                let tracer = Tracer::new(&case).map_err(said)?;
                self.sums(|point| tracer.value(point, time))
            }
            Exact::Formula(f) => self.sums(|point| {
                let [x, y, z, vx, vy, vz] = *point;
                f.eval(&[x, y, z, vx, vy, vz, time])
            }),
        })
    }

    /// Sums over velocities, as those of `f` are.
    fn sums(&self, value: impl Fn(&[f64; 6]) -> f64) -> Vec<f64> {
        let space = &self.case.space;
        let n = space.dimension();
        let velocities: Vec<_> = space.v.iter().map(|axis| 0..axis.cells).collect();
        let weights: Vec<Vec<f64>> = space.v.iter().map(|axis| axis.weights()).collect();
        let density = |cell: &Cell| {
            let (mut cell, mut sum) = (*cell, 0.0);
            for_each_cell(&velocities, |j| {
                cell[n..2 * n].copy_from_slice(&j[..n]);
                let weight: f64 = weights.iter().zip(j).map(|(w, &j)| w[j]).product();
                sum += weight * value(&space.inner_point(&cell));
            });
            sum
        };
        self.cells.iter().map(density).collect()
    }
}

/// The cells of space that are shown.
fn shown_cells(run: &Stored, cut: &Cut) -> Vec<Cell> {
    let n = run.dimension();
    let mut cells = Vec::new();
    let shown = if n == 1 { vec![[0, 0]] } else { planes(n) };
    for plane in shown {
        let mut ranges: Vec<_> = (0..n).map(|a| cut.0[a]..cut.0[a] + 1).collect();
        for a in plane {
            ranges[a] = 0..run.axis(a).cells;
        }
        for_each_cell(&ranges, |i| {
            let mut cell = Cell::default();
            cell[..n].copy_from_slice(&i[..n]);
            cells.push(cell);
        });
    }
    cells
}

/// Cells of a plane of space.
pub fn cells_of(run: &Stored, plane: [usize; 2]) -> usize {
    plane.map(|a| run.axis(a).cells).iter().product()
}

/// Values at the cells of a plane as they are drawn.
pub fn drawn_on(run: &Stored, plane: [usize; 2], values: &[f64]) -> Plane {
    let meshes = plane.map(|a| match run.has_averaged_moments() {
        true => FineMesh::of_averages(run.axis(a), FINEST),
        false => FineMesh::new(run.axis(a), FINEST),
    });
    let values = drawn(values, meshes[0].elements(), &meshes);
    Plane { shape: [meshes[0].len(), meshes[1].len()], values }
}
