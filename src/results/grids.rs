//! `plane_x.xdmf`, …, `space.xdmf`: one file per grid, with all times of the grid, for programs
//! that take lists of points and cells, such as meshio and VTK.
//!
//! Points, cells and values are in `grids.h5`:
//!
//! | object | shape | |
//! |---|---|---|
//! | `/GRID/points` | (points, 3) | corners of the cells, x fastest |
//! | `/GRID/cells` | (cells, 4 or 8) | numbers of the corners of quadrilaterals or hexahedra |
//! | `/GRID/K/NAME` | (cells) or (cells, 3) | values at time number `K` of the grid, from 0 |
//!
//! Values are not copied. They are virtual datasets of HDF5, which refer to a dataset of
//! `result.h5` or to one time of it, as a list in the same order. So `grids.h5` needs `result.h5`
//! beside it.

use crate::base::disk::{self, failure};
use crate::base::error::Result;
use crate::base::row_major::{DatasetBox, number};
use crate::parallel::files::selection;
use crate::problem::case::Case;
use crate::results::dataset::RESULT;
use crate::results::views::{Grid, GridsAtTime, View};
use crate::results::xdmf::{attribute, item};
use hdf5::filters::deflate_available;
use hdf5::{File, Group, H5Type};
use ndarray::ArrayView2;
use std::path::Path;

/// The file with points, cells and values.
const DATA_FILE: &str = "grids.h5";
/// Names of the grids in up to three dimensions: the planes, then space.
const GRIDS: [&str; 4] = ["plane_x", "plane_y", "plane_z", "space"];
/// Bytes that the virtual datasets of a time take at most.
const VIRTUAL_DATASETS: usize = 1 << 14;
/// Rows of points and cells that are written at a time.
const PIECE: usize = 1 << 14;
/// Times whose virtual datasets are written before the file is closed: HDF5 keeps what it knows of
/// all objects of an open file, about 40 kB a time.
const TIMES_AT_ONCE: usize = 32;

/// Names of all files that any run may write here.
fn names() -> impl Iterator<Item = String> {
    std::iter::once(DATA_FILE.to_owned()).chain(GRIDS.iter().map(|grid| format!("{grid}.xdmf")))
}

/// Names of all files that any run may write here, and whether a run of `case` writes them.
pub(crate) fn files(case: &Case) -> impl Iterator<Item = (String, bool)> + use<> {
    let (dimension, xdmf) = (case.space.dimension(), case.output.storage.xdmf);
    let planes = (0..GRIDS.len()).map(move |k| k < dimension || GRIDS[k] == "space");
    let written = std::iter::once(true).chain(planes);
    names().zip(written).map(move |(name, written)| (name, xdmf && written))
}

/// Upper bound on the bytes of points, cells and virtual datasets.
pub(crate) fn most_bytes(case: &Case) -> usize {
    if !case.output.storage.xdmf {
        return 0;
    }
    let space = &case.space;
    let list = |lengths: &[usize]| {
        let points: usize = lengths.iter().map(|n| n + 1).product();
        let corners = 1usize << lengths.len();
        8 * (3 * points + corners * lengths.iter().product::<usize>())
    };
    let planes = space.x.iter().zip(&space.v).map(|(x, v)| list(&[x.cells, v.cells]));
    let cells: Vec<usize> = space.x.iter().map(|axis| axis.cells).collect();
    let times = 1 + case.shown_times().count();
    planes.sum::<usize>() + list(&cells) + VIRTUAL_DATASETS * times
}

/// Writes the files for the times of `steps` into `directory`, which has their `result.h5`, and
/// removes older files that are not replaced. Only one rank calls it.
///
/// # Errors
/// [`crate::base::error::Error::Output`].
pub fn write(directory: &Path, steps: &[GridsAtTime]) -> Result<()> {
    for name in names() {
        let path = directory.join(name);
        disk::clear(&path).map_err(|e| failure(&path, &e))?;
    }
    if steps.is_empty() {
        return Ok(());
    }
    let path = directory.join(DATA_FILE);
    disk::put_in_place(&path, |partial| write_data_file(partial, &directory.join(RESULT), steps))?;
    for name in GRIDS {
        let times = times(steps, name);
        if !times.is_empty() {
            disk::write_pieces(&directory.join(format!("{name}.xdmf")), pieces(name, &times))?;
        }
    }
    Ok(())
}

/// The times of a grid, with its datasets at each time.
fn times<'a>(steps: &'a [GridsAtTime], name: &str) -> Vec<(f64, &'a Grid)> {
    let shown = |step: &'a GridsAtTime| {
        let grid = step.grids.iter().find(|grid| grid.name == name)?;
        Some((step.time, grid))
    };
    steps.iter().filter_map(shown).collect()
}

/// Writes points, cells and values into the file `path`.
fn write_data_file(path: &Path, result: &Path, steps: &[GridsAtTime]) -> hdf5::Result<()> {
    let result = File::open(result)?;
    File::create(path)?.close()?;
    for name in GRIDS {
        let times = times(steps, name);
        let Some((_, first)) = times.first() else { continue };
        let (points, cells) = (first.point_count(), first.cell_count());
        with_file(path, |file| {
            let group = file.create_group(name)?;
            table(&group, "points", [points, 3], |k, row| row.extend(first.point(k)))?;
            table(&group, "cells", [cells, first.corners()], |k, row| first.corners_of(k, row))
        })?;
        for (first, times) in (0..).step_by(TIMES_AT_ONCE).zip(times.chunks(TIMES_AT_ONCE)) {
            with_file(path, |file| {
                for (k, (_, grid)) in (first..).zip(times) {
                    let group = file.create_group(&format!("{name}/{k}"))?;
                    let of_view = |view| values(&group, &result, view, cells);
                    grid.fields.iter().try_for_each(of_view)?;
                }
                Ok(())
            })?;
        }
    }
    result.close()
}

/// Lets `write` add to the file `path`.
fn with_file(path: &Path, write: impl FnOnce(&File) -> hdf5::Result<()>) -> hdf5::Result<()> {
    let file = File::open_rw(path)?;
    write(&file)?;
    file.close()
}

/// A grid as a list of points and a list of cells, both x fastest.
impl Grid {
    /// Number of cells along each axis of the grid.
    fn lengths(&self) -> &[usize] {
        &self.cells[..self.dimension]
    }

    fn cell_count(&self) -> usize {
        self.lengths().iter().product()
    }

    fn point_count(&self) -> usize {
        self.lengths().iter().map(|n| n + 1).product()
    }

    /// Number of corners of a cell.
    fn corners(&self) -> usize {
        1 << self.dimension
    }

    /// Face number `k` along an axis.
    fn face(&self, axis: usize, k: usize) -> f64 {
        match &self.faces {
            Some(faces) => faces[axis][k],
            None => self.origin[axis] + k as f64 * self.spacing[axis],
        }
    }

    /// Point number `k`; a plane lies at z = 0.
    fn point(&self, mut k: usize) -> [f64; 3] {
        let mut point = [0.0; 3];
        for (axis, n) in self.lengths().iter().enumerate() {
            point[axis] = self.face(axis, k % (n + 1));
            k /= n + 1;
        }
        point
    }

    /// Appends the numbers of the corners of cell number `k`: around a quadrilateral; for a
    /// hexahedron around its lower face, then around its upper face.
    fn corners_of(&self, mut k: usize, corners: &mut Vec<i64>) {
        const AROUND: [[usize; 3]; 8] = [
            [0, 0, 0],
            [1, 0, 0],
            [1, 1, 0],
            [0, 1, 0],
            [0, 0, 1],
            [1, 0, 1],
            [1, 1, 1],
            [0, 1, 1],
        ];
        let mut lowest = [0; 3];
        for (axis, n) in self.lengths().iter().enumerate() {
            lowest[axis] = k % n;
            k /= n;
        }
        for upper in &AROUND[..self.corners()] {
            let axes = || (0..self.dimension).rev();
            let places = axes().map(|axis| lowest[axis] + upper[axis]);
            corners.push(number(axes().map(|axis| self.cells[axis] + 1), places) as i64);
        }
    }
}

/// Writes a dataset of `rows` by `width` numbers. It is compressed if HDF5 can, as such lists
/// compress well.
fn table<T: H5Type>(
    group: &Group,
    name: &str,
    [rows, width]: [usize; 2],
    fill: impl Fn(usize, &mut Vec<T>),
) -> hdf5::Result<()> {
    let mut builder = group.new_dataset::<T>().chunk([rows.min(PIECE), width]);
    if deflate_available() {
        builder = builder.shuffle().deflate(1);
    }
    let dataset = builder.shape([rows, width]).create(name)?;
    for first in (0..rows).step_by(PIECE) {
        let here = first..(first + PIECE).min(rows);
        let mut values = Vec::with_capacity(here.len() * width);
        here.clone().for_each(|k| fill(k, &mut values));
        let values = ArrayView2::from_shape((here.len(), width), &values)
            .map_err(|e| hdf5::Error::from(e.to_string()))?;
        dataset.write_slice(values, selection(&DatasetBox::of(&[here, 0..width])))?;
    }
    Ok(())
}

/// Writes a view as a virtual dataset: a list over the cells.
fn values(group: &Group, result: &File, view: &View, cells: usize) -> hdf5::Result<()> {
    let there = result.dataset(&view.dataset)?.shape();
    let mut from = DatasetBox::whole(&there);
    if let Some(slice) = &view.time_slice {
        (from.start[0], from.count[0]) = (slice.index, 1);
    }
    let mut shape = vec![cells];
    shape.extend(view.vector.then_some(3));
    let (from, to) = (selection(&from), selection(&DatasetBox::whole(&shape)));
    group
        .new_dataset::<f64>()
        .virtual_map(RESULT, &view.dataset, &there, from, &shape, to)
        .shape(&shape)
        .create(view.name)?;
    Ok(())
}

/// The text of a grid's file, a collection over the times, time by time.
fn pieces(name: &str, times: &[(f64, &Grid)]) -> impl Iterator<Item = String> {
    let start = format!(
        "<?xml version=\"1.0\"?>\n<Xdmf Version=\"3.0\">\n<Domain>\n\
         <Grid Name=\"{name}\" GridType=\"Collection\" CollectionType=\"Temporal\">\n"
    );
    let end = "</Grid>\n</Domain>\n</Xdmf>\n".to_owned();
    let texts = times.iter().enumerate().map(move |(k, (time, grid))| grid_text(k, *time, grid));
    std::iter::once(start).chain(texts).chain(std::iter::once(end))
}

/// The text of a grid at time number `k`.
fn grid_text(k: usize, time: f64, grid: &Grid) -> String {
    let name = &grid.name;
    let (cells, corners) = (grid.cell_count(), grid.corners());
    let kind = if corners == 8 { "Hexahedron" } else { "Quadrilateral" };
    let place = |of: &str| format!("{DATA_FILE}:/{name}/{of}");
    let mut text = format!(
        "<Grid Name=\"{name}\" GridType=\"Uniform\">\n\
         <Time Value=\"{time}\"/>\n\
         <Topology TopologyType=\"{kind}\" NumberOfElements=\"{cells}\">\n{}</Topology>\n\
         <Geometry GeometryType=\"XYZ\">\n{}</Geometry>\n",
        item(&format!("{cells} {corners}"), "Int", "HDF", &place("cells")),
        item(&format!("{} 3", grid.point_count()), "Float", "HDF", &place("points")),
    );
    for view in &grid.fields {
        let lengths = if view.vector { format!("{cells} 3") } else { cells.to_string() };
        let numbers = item(&lengths, "Float", "HDF", &place(&format!("{k}/{}", view.name)));
        text += &attribute(view, &numbers);
    }
    text + "</Grid>\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(dimension: usize) -> Grid {
        Grid {
            name: "space".to_owned(),
            dimension,
            origin: [-1.0, 2.0, 0.0],
            spacing: [0.5, 1.0, 2.0],
            cells: [4, 3, if dimension == 3 { 2 } else { 1 }],
            faces: None,
            fields: Vec::new(),
        }
    }

    /// The corners of each cell are those of its box, and no two cells are the same.
    #[test]
    fn corners_are_those_of_the_cells() {
        for dimension in [2, 3] {
            let grid = grid(dimension);
            let mut seen = std::collections::BTreeSet::new();
            for k in 0..grid.cell_count() {
                let mut corners = Vec::new();
                grid.corners_of(k, &mut corners);
                assert_eq!(corners.len(), grid.corners());
                let at = [k % 4, k / 4 % 3, k / 12];
                let points: Vec<[f64; 3]> =
                    corners.iter().map(|c| grid.point(*c as usize)).collect();
                for axis in 0..dimension {
                    let lower = grid.origin[axis] + at[axis] as f64 * grid.spacing[axis];
                    let ends = [lower, lower + grid.spacing[axis]];
                    let on = |end: f64| points.iter().filter(|p| p[axis] == end).count();
                    assert_eq!(ends.map(on), [grid.corners() / 2; 2], "{k} {axis}");
                }
                // Neighbours in the list share an edge: they go around.
                for ends in points[..4].windows(2) {
                    let changed = (0..3).filter(|a| ends[0][*a] != ends[1][*a]).count();
                    assert_eq!(changed, 1, "{k}: {points:?}");
                }
                assert!(seen.insert(corners));
            }
            assert_eq!(grid.point_count(), if dimension == 2 { 20 } else { 60 });
        }
    }
}
