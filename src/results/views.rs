//! The data that `fields.xdmf` and the file of each grid show: moments over space at all output
//! times, and fields on the planes (x_a, v_a) through the middle of the other axes at those output
//! times at which fields are written.
//!
//! XDMF takes the first index of a dataset for the last direction, and has no option for the other
//! order: it would show a dataset over (x, y) with y as the horizontal axis. So the shown data are
//! stored once more with their axes reversed and the three components of vectors last:
//! `/xdmf/space/NAME` (N_xn, …, N_x1[, 3]) and `/xdmf/plane_x/NAME` (N_vx, N_x). In one dimension
//! the plane is the whole phase space, and moments need no copy. Data of earlier times are in
//! `/xdmf/history`, with the time as first index.

use crate::base::error::Result;
use crate::base::row_major::DatasetBox;
use crate::problem::grid::{Axis, PhaseSpace, axis_names};
use crate::results::dataset::{ExactSolution, Results};
use crate::results::fields::{self, DIRECTION, Field};
use crate::results::history::{FIELD_TIME, TIME, with_fields};
use crate::results::writer::Writer;
use std::ops::Range;
use std::rc::Rc;

/// A grid of cells along three axes, and datasets over it.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid {
    /// Name of the grid.
    pub name: String,
    /// Number of axes on which it is drawn: two or three.
    pub dimension: usize,
    /// Lower ends of the three axes.
    pub origin: [f64; 3],
    /// Widths of the cells.
    pub spacing: [f64; 3],
    /// Numbers of cells along the three axes.
    pub cells: [usize; 3],
    /// Faces of the cells along all axes, if a degree above 0 makes cells unequal. The width of a
    /// cell is the quadrature weight of its node.
    pub faces: Option<Rc<[Vec<f64>; 3]>>,
    /// The datasets that are shown on it.
    pub fields: Vec<View>,
}

/// The grids at one time.
#[derive(Clone, Debug, PartialEq)]
pub struct GridsAtTime {
    /// The time.
    pub time: f64,
    /// Grids at that time.
    pub grids: Vec<Grid>,
}

/// One time of a dataset whose first index counts times.
#[derive(Clone, Debug, PartialEq)]
pub struct TimeSlice {
    /// Number of the time.
    pub index: usize,
    /// Lengths of the dataset, the times first.
    pub shape: Rc<[usize]>,
}

/// A dataset of `result.h5` over a grid, its last index along the grid's first axis.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// The name under which it is shown.
    pub name: &'static str,
    /// Path of the dataset, which the views of all times share.
    pub dataset: Rc<str>,
    /// Whether the dataset has three components, as its last index.
    pub vector: bool,
    /// The time of the view; `None` for a dataset without times.
    pub time_slice: Option<TimeSlice>,
}

impl Grid {
    /// A grid over one to three axes. A missing axis has one cell about zero that is as wide as a
    /// cell of the first axis.
    fn new(name: &str, axes: &[&Axis]) -> Self {
        let width = axes[0].width();
        let mut grid = Self {
            name: name.to_owned(),
            dimension: axes.len().max(2),
            origin: [-0.5 * width; 3],
            spacing: [width; 3],
            cells: [1; 3],
            faces: None,
            fields: Vec::new(),
        };
        for (a, axis) in axes.iter().enumerate() {
            (grid.origin[a], grid.spacing[a]) = (axis.lower, axis.width());
            grid.cells[a] = axis.cells;
        }
        if axes.iter().any(|axis| axis.nodes.degree > 0) {
            let flat = || vec![-0.5 * width, 0.5 * width];
            let faces = |a| axes.get(a).map_or_else(flat, |axis: &&Axis| axis.cell_faces());
            grid.faces = Some(Rc::new(std::array::from_fn(faces)));
        }
        grid
    }

    fn show(&mut self, name: &'static str, dataset: &str, vector: bool) {
        self.fields.push(View { name, dataset: dataset.into(), vector, time_slice: None });
    }
}

/// Shows a dataset of this shape, whose first index counts times, on the grids of these times.
fn show_by_time(
    grids: &mut [Grid],
    name: &'static str,
    dataset: &str,
    vector: bool,
    shape: &[usize],
) {
    let (dataset, shape): (Rc<str>, Rc<[usize]>) = (dataset.into(), shape.into());
    for (index, grid) in grids.iter_mut().enumerate() {
        let time_slice = Some(TimeSlice { index, shape: shape.clone() });
        grid.fields.push(View { name, dataset: dataset.clone(), vector, time_slice });
    }
}

/// Writes the copies and lists the grids with their datasets, time by time. Collective.
///
/// # Errors
/// [`crate::base::error::Error::Output`].
pub fn write(writer: &Writer<'_>, results: &Results<'_>) -> Result<Vec<GridsAtTime>> {
    writer.group("xdmf")?;
    let mut grids = planes(writer, results)?;
    grids.push(space(writer, results)?);
    let mut steps = steps_before_end(writer, results)?;
    steps.push(GridsAtTime { time: results.case.end, grids });
    Ok(steps)
}

/// Writes the data of output times before the end. Collective.
fn steps_before_end(writer: &Writer<'_>, results: &Results<'_>) -> Result<Vec<GridsAtTime>> {
    if results.early.is_empty() {
        return Ok(Vec::new());
    }
    writer.group("xdmf/history")?;
    let mut steps: Vec<GridsAtTime> = results
        .early
        .iter()
        .map(|early| GridsAtTime { time: early.time, grids: Vec::new() })
        .collect();
    earlier_planes(writer, results, &mut steps)?;
    earlier_space(writer, results, &mut steps)?;
    Ok(steps)
}

/// Adds the fields on planes to the `steps` that have fields. Collective.
fn earlier_planes(
    writer: &Writer<'_>,
    results: &Results<'_>,
    steps: &mut [GridsAtTime],
) -> Result<()> {
    let count = with_fields(results).count();
    for a in (0..results.case.space.dimension()).filter(|_| count > 0) {
        let plane = PlanePart::new(results, a);
        writer.group(&format!("xdmf/history/{}", plane.grid.name))?;
        let [v, x] = plane.axes;
        let shape = [count, plane.velocities, plane.grid.cells[0]];
        let mut grids = vec![plane.grid.clone(); count];
        for (k, field) in results.case.fields.iter().enumerate() {
            let values: Vec<Vec<f64>> =
                with_fields(results).map(|e| plane.values(&e.fields[k])).collect();
            let slab = |time| plane.slab().after(time..time + 1);
            let slabs: Vec<(DatasetBox, &[f64])> =
                values.iter().enumerate().map(|(time, v)| (slab(time), &v[..])).collect();
            let path = format!("/xdmf/history/{}/{}", plane.grid.name, field.name);
            let what = format!("{} on this plane at the field times", field.name);
            writer.field(&path, &[FIELD_TIME, v, x], &slabs, &what)?;
            show_by_time(&mut grids, field.name, &path, false, &shape);
        }
        let with = steps.iter_mut().zip(results.early).filter(|(_, e)| !e.fields.is_empty());
        for ((step, _), grid) in with.zip(grids) {
            step.grids.push(grid);
        }
    }
    Ok(())
}

/// Adds the moments over space to all `steps`. Collective.
fn earlier_space(
    writer: &Writer<'_>,
    results: &Results<'_>,
    steps: &mut [GridsAtTime],
) -> Result<()> {
    let space = &results.case.space;
    let n = space.dimension();
    let times = fields::moments_by_time(results);
    let mut grids = vec![space_grid(space); steps.len()];
    for (k, Field { kind, .. }) in times[0].iter().enumerate() {
        let (mut path, vector) = (format!("/history/{}", kind.name), kind.vector && n > 1);
        let mut shape: Vec<usize> = vec![times.len()];
        shape.extend((kind.vector && n == 1).then_some(1));
        shape.extend(space.x.iter().rev().map(|axis| axis.cells));
        shape.extend(vector.then_some(3));
        if n > 1 {
            path = format!("/xdmf/history/{}", kind.name);
            let copies: Vec<ReversedShare<'_>> =
                times.iter().map(|fields| ReversedShare::new(results, &fields[k])).collect();
            let axes: Vec<&str> = [TIME].into_iter().chain(copies[0].axes.clone()).collect();
            let slab = |time| DatasetBox::of(&copies[0].ranges).after(time..time + 1);
            let slabs: Vec<(DatasetBox, &[f64])> =
                copies.iter().enumerate().map(|(t, copy)| (slab(t), &copy.values[..])).collect();
            let what = format!("copy of /history/{}, axes reversed", kind.name);
            writer.field(&path, &axes, &slabs, &what)?;
        }
        show_by_time(&mut grids, kind.name, &path, vector, &shape);
    }
    // V does not change, and is stored once.
    let dataset: Rc<str> = if n > 1 { "/xdmf/space/potential" } else { "/potential" }.into();
    let potential = View { name: "potential", dataset, vector: false, time_slice: None };
    for (step, mut grid) in steps.iter_mut().zip(grids) {
        grid.fields.push(potential.clone());
        grid.fields.sort_by_key(|view| view.vector);
        step.grids.push(grid);
    }
    Ok(())
}

/// `values` over axes of these lengths, row-major, with the axes reversed.
fn reversed(values: &[f64], lengths: &[usize]) -> Vec<f64> {
    let mut out = vec![0.0; values.len()];
    for (i, value) in values.iter().enumerate() {
        let (mut rest, mut at) = (i, 0);
        for n in lengths.iter().rev() {
            at = at * n + rest % n;
            rest /= n;
        }
        out[at] = *value;
    }
    out
}

/// The grid of space. In one dimension its second axis has one cell as wide as the velocity axis,
/// so that it fills the frame of the plane (x, v).
fn space_grid(space: &PhaseSpace) -> Grid {
    let mut grid = Grid::new("space", &space.x.iter().collect::<Vec<_>>());
    if let [v] = &space.v[..] {
        (grid.origin[1], grid.spacing[1]) = (v.lower, v.upper - v.lower);
        if let Some(faces) = &mut grid.faces {
            Rc::make_mut(faces)[1] = vec![v.lower, v.upper];
        }
    }
    grid
}

/// Writes the moments over space.
fn space(writer: &Writer<'_>, results: &Results<'_>) -> Result<Grid> {
    let space = &results.case.space;
    let n = space.dimension();
    let mut grid = space_grid(space);
    // Scalars first.
    let mut fields = Vec::from(fields::moments(results.moments));
    fields.push(fields::potential(results.potential));
    fields.extend(results.exact_moments.last().into_iter().flat_map(fields::exact_moments));
    fields.sort_by_key(|field| field.kind.vector);
    if n == 1 {
        for Field { kind, .. } in fields {
            grid.show(kind.name, &format!("/{}", kind.name), false);
        }
        return Ok(grid);
    }
    writer.group("xdmf/space")?;
    for field in fields {
        let path = format!("/xdmf/space/{}", field.kind.name);
        let ReversedShare { axes, ranges, values } = ReversedShare::new(results, &field);
        let what = format!("copy of /{}, axes reversed", field.kind.name);
        writer.field(&path, &axes, &[(DatasetBox::of(&ranges), &values)], &what)?;
        grid.show(field.kind.name, &path, field.kind.vector);
    }
    Ok(grid)
}

/// A rank's share of a field over space with reversed axes; the three components of a vector last.
struct ReversedShare<'a> {
    /// Names of its axes.
    axes: Vec<&'a str>,
    /// The ranges of the share.
    ranges: Vec<Range<usize>>,
    /// Values of the field.
    values: Vec<f64>,
}

impl ReversedShare<'_> {
    fn new(results: &Results<'_>, field: &Field<'_>) -> Self {
        let names = axis_names(results.share.len());
        let mut axes: Vec<&str> = names[..results.share.len()].iter().rev().copied().collect();
        let mut ranges: Vec<Range<usize>> = results.share.iter().rev().cloned().collect();
        let lengths: Vec<usize> = results.share.iter().map(|r| r.len()).collect();
        let mut stride = 1;
        if field.kind.vector {
            stride = 3;
            axes.push(DIRECTION);
            ranges.push(0..3);
        }
        let mut values = vec![0.0; stride * field.components[0].len()];
        for (a, component) in field.components.iter().enumerate() {
            for (i, value) in reversed(component, &lengths).into_iter().enumerate() {
                values[stride * i + a] = value;
            }
        }
        Self { axes, ranges, values }
    }
}

/// Writes the fields on the planes (x_a, v_a) through the middle cells of the other axes.
fn planes(writer: &Writer<'_>, results: &Results<'_>) -> Result<Vec<Grid>> {
    let case = results.case;
    let mut fields: Vec<(&'static str, &[f64])> = (case.fields.iter().zip(results.fields))
        .map(|(field, values)| (field.name, *values))
        .collect();
    if let Some(ExactSolution::Field(exact)) = results.exact {
        fields.push(("exact", exact));
    }
    let mut grids = Vec::new();
    for a in 0..case.space.dimension() {
        let plane = PlanePart::new(results, a);
        let mut grid = plane.grid.clone();
        writer.group(&format!("xdmf/{}", grid.name))?;
        for &(name, field) in &fields {
            let path = format!("/xdmf/{}/{name}", grid.name);
            let what = format!("{name} on this plane through the middle of the other axes");
            writer.field(&path, &plane.axes, &[(plane.slab(), &plane.values(field))], &what)?;
            grid.show(name, &path, false);
        }
        grids.push(grid);
    }
    Ok(grids)
}

/// A plane (x_a, v_a), and the part of it that a rank holds: all of its velocities, or none.
struct PlanePart {
    /// The plane, without datasets.
    grid: Grid,
    /// Names of its axes in datasets: v_a, x_a.
    axes: [&'static str; 2],
    /// Cells along v_a.
    velocities: usize,
    /// Cells of the part along x_a.
    cells: Range<usize>,
    /// Index of its first value in the rank's fields.
    base: usize,
    /// Strides along x_a and v_a in the rank's fields.
    strides: [usize; 2],
}

impl PlanePart {
    /// The plane through the middle cells of the other axes; of two middle cells, the upper one.
    fn new(results: &Results<'_>, a: usize) -> Self {
        let (n, space) = (results.share.len(), &results.case.space);
        let middle: Vec<usize> = space.axes().map(|axis| axis.cells / 2).collect();
        let crossed = (0..n).all(|b| b == a || results.share[b].contains(&middle[b]));
        let share = results.share.iter().map(|r| (r.start, r.len()));
        let velocities = space.v.iter().map(|v| (0, v.cells));
        let lengths: Vec<(usize, usize)> = share.chain(velocities).collect();
        let (mut base, mut stride, mut strides) = (0, 1, [0; 2]);
        for b in (0..2 * n).rev() {
            let (start, length) = lengths[b];
            if b % n == a {
                strides[b / n] = stride;
            } else if crossed {
                base += (middle[b] - start) * stride;
            }
            stride *= length;
        }
        let names = axis_names(n);
        Self {
            grid: Grid::new(&format!("plane_{}", names[a]), &[&space.x[a], &space.v[a]]),
            axes: [names[n + a], names[a]],
            velocities: space.v[a].cells,
            cells: if crossed { results.share[a].clone() } else { 0..0 },
            base,
            strides,
        }
    }

    /// The part in a dataset over the plane.
    fn slab(&self) -> DatasetBox {
        DatasetBox::of(&[0..self.velocities, self.cells.clone()])
    }

    /// Values of a field, x_a fastest.
    fn values(&self, field: &[f64]) -> Vec<f64> {
        let at = |i: usize, j: usize| self.base + i * self.strides[0] + j * self.strides[1];
        (0..self.velocities)
            .flat_map(|j| (0..self.cells.len()).map(move |i| field[at(i, j)]))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_are_reversed() {
        let values: Vec<f64> = (0..24).map(f64::from).collect();
        let out = reversed(&values, &[2, 3, 4]);
        for x in 0..2 {
            for y in 0..3 {
                for z in 0..4 {
                    assert_eq!(out[(z * 3 + y) * 2 + x], values[(x * 3 + y) * 4 + z]);
                }
            }
        }
        assert_eq!(reversed(&out, &[4, 3, 2]), values);
        assert!(reversed(&[], &[0, 3]).is_empty());
    }
}
