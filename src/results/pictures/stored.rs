//! A finished run, read from its files: datasets of `result.h5`, planes of these, attributes.

use crate::base::row_major::DatasetBox;
use crate::base::text::{on_one_line, short};
use crate::parallel::files::read_slab;
use crate::problem::case::Case;
use crate::problem::element::{LARGEST_DEGREE, Nodes};
use crate::problem::grid::{Axis, MAX_DIMENSION, PhaseSpace, axis_names};
use crate::results::dataset::RESULT;
use crate::results::figure;
use crate::results::pictures::mesh::{self, FineMesh, values_on_parts};
use crate::results::readback::{PIECE, StoredCase, number_attribute, read_text, text_attribute};
use crate::results::{FileResult, summary};
use hdf5::{Dataset, File};
use serde::Deserialize;
use serde_json::Value;
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// The largest number of cells of a map along an axis. Finer grids are averaged.
pub(crate) const FINEST: usize = 512;

/// `result.h5`, open for reading, with those values that are always needed.
pub struct StoredRun {
    /// The directory of the run.
    pub directory: PathBuf,
    /// The grid.
    pub space: PhaseSpace,
    /// The case, or why this program cannot read it.
    pub case: FileResult<Case>,
    /// The case file as it was read.
    pub text: String,
    /// The `--set` options applied to it.
    pub overrides: Vec<String>,
    /// The plan.
    pub plan: Value,
    /// Attributes of the file: what produced it.
    pub provenance: BTreeMap<String, String>,
    /// Time of the fields.
    pub time: f64,
    /// `summary.json`, or why it cannot be read.
    pub summary: FileResult<Value>,
    /// Seconds by step, from the summary, which has all steps, or else from the file.
    pub seconds: BTreeMap<String, f64>,
    file: File,
}

/// One of the times at which a run has fields.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StoredTime {
    /// The time.
    pub time: f64,
    /// Index in `/axis/field_time`; `None` for the end.
    early: Option<usize>,
}

impl StoredTime {
    /// The dataset that has the field or the moment `name` at this time.
    fn dataset(&self, name: &str) -> String {
        if self.early.is_some() { format!("history/{name}") } else { name.to_owned() }
    }
}

/// A dataset over two axes, on equal parts of the elements; averaged if these are more than
/// `FINEST`.
#[derive(Clone, Debug, PartialEq)]
pub struct Plane {
    /// Number of parts along both axes.
    pub shape: [usize; 2],
    /// A value for each part, the second axis fastest.
    pub values: Vec<f64>,
}

impl StoredRun {
    /// Opens `directory/result.h5`, which has been inspected
    /// ([`untrusted::open`](crate::results::untrusted::open)).
    pub(crate) fn read(directory: &Path) -> FileResult<Self> {
        let reason = |e: hdf5::Error| e.to_string();
        let file = File::open(directory.join(RESULT)).map_err(reason)?;
        let mut provenance = BTreeMap::new();
        for name in file.attr_names().map_err(reason)? {
            let number = |_| number_attribute(&file, &name).map(|x| x.to_string());
            let value = text_attribute(&file, &name).or_else(number);
            provenance.extend(value.ok().map(|value| (name, value)));
        }
        let time = number_attribute(&file, "time").map_err(reason)?;
        let stored = StoredCase::read_leniently(&file).map_err(reason)?;
        let text = stored.text().map_err(reason)?;
        let overrides = stored.overrides;
        let name = provenance.get("case_file").map_or("case", String::as_str);
        let found = grid(&file)?;
        refuse_other_shapes(&file, &found)?;
        let case =
            (Case::parse(name, &text, &overrides).map_err(|e| e.to_string())).and_then(|case| {
                let space = as_stored(&case.space, &found)
                    .ok_or_else(|| "its grid is not that of the result".to_owned())?;
                Ok(Case { space, ..case })
            });
        let plan = read_text(&file.dataset("plan").map_err(reason)?).map_err(reason)?;
        let plan = serde_json::from_str(&plan).map_err(|e| format!("/plan: {e}"))?;
        let summary = summary::read(directory).map_err(|e| e.to_string());
        let steps = summary.as_ref().ok().map(|s| &s["seconds"]);
        let of_summary = steps.and_then(|s| BTreeMap::deserialize(s).ok());
        let seconds = of_summary.map_or_else(|| timings(&file), Ok).map_err(reason)?;
        let space = case.as_ref().map_or(found, |case| case.space.clone());
        Ok(Self {
            directory: directory.to_owned(),
            space,
            case,
            text,
            overrides,
            plan,
            provenance,
            time,
            summary,
            seconds,
            file,
        })
    }

    /// Number of space dimensions.
    pub fn dimension(&self) -> usize {
        self.space.dimension()
    }

    /// Names of the axes in storage order.
    pub fn names(&self) -> Vec<&'static str> {
        axis_names(self.dimension())
    }

    /// Axis number `a` in storage order.
    pub fn axis(&self, a: usize) -> &Axis {
        self.space.axis(a)
    }

    /// The axis of a panel that shows all of axis number `a`.
    pub fn drawn_axis(&self, a: usize) -> figure::PlotAxis {
        let Axis { lower, upper, .. } = *self.axis(a);
        figure::PlotAxis::linear(self.names()[a]).within(lower, upper)
    }

    /// Title of the case in one line, or else the name of its file.
    pub fn title(&self) -> String {
        let of = |key: &str| self.provenance.get(key).filter(|t| !t.is_empty());
        of("title").or_else(|| of("case_file")).map_or(String::new(), |title| on_one_line(title))
    }

    /// Whether the file has this dataset.
    pub fn has(&self, name: &str) -> bool {
        exists(&self.file, name)
    }

    /// Whether the data are measure-valued.
    pub fn is_measure(&self) -> bool {
        self.has("phi")
    }

    /// Whether the run is one by the classical method.
    pub fn is_classical(&self) -> bool {
        self.plan["method"] == "classical"
    }

    fn dataset(&self, name: &str) -> FileResult<Dataset> {
        if !self.has(name) {
            return Err(format!("there is no /{name} in result.h5"));
        }
        self.file.dataset(name).map_err(|e| format!("/{name} of result.h5: {e}"))
    }

    /// The values of a dataset.
    pub fn list(&self, name: &str) -> FileResult<Vec<f64>> {
        let dataset = self.dataset(name)?;
        dataset.read_raw().map_err(|e| format!("/{name} of result.h5: {e}"))
    }

    /// Whether moments of elements are averages over cells and not polynomials, as for
    /// measure-valued data.
    pub fn has_averaged_moments(&self) -> bool {
        self.space.degree() > 0 && self.is_measure()
    }

    /// A moment in one dimension as points of a line.
    pub fn line(&self, values: &[f64]) -> Vec<[f64; 2]> {
        if self.has_averaged_moments() {
            mesh::averages(self.axis(0), values)
        } else {
            mesh::line(self.axis(0), values)
        }
    }

    /// The time at the end of the run.
    pub fn end(&self) -> StoredTime {
        StoredTime { time: self.time, early: None }
    }

    /// The times at which there are fields, the end last.
    pub fn snapshots(&self) -> FileResult<Vec<StoredTime>> {
        let times =
            if self.has("axis/field_time") { self.list("axis/field_time")? } else { Vec::new() };
        let early = times.into_iter().enumerate();
        let early = early.map(|(k, time)| StoredTime { time, early: Some(k) });
        Ok(early.chain([self.end()]).collect())
    }

    /// A box of a field at a time, row-major; `ranges` are over the axes of the field at the end.
    pub fn field_slab(
        &self,
        at: StoredTime,
        name: &str,
        ranges: &[Range<usize>],
    ) -> FileResult<Vec<f64>> {
        let first = at.early.map(|k| k..k + 1);
        let ranges: Vec<_> = first.into_iter().chain(ranges.iter().cloned()).collect();
        self.slab(&at.dataset(name), &DatasetBox::of(&ranges))
    }

    /// A plane of a field at a time, as [`plane`](Self::plane).
    pub fn field_plane(
        &self,
        at: StoredTime,
        name: &str,
        plane: [usize; 2],
        cells: &[usize],
    ) -> FileResult<Plane> {
        self.plane(&at.dataset(name), at.early.as_slice(), plane, cells)
    }

    /// A scalar moment, such as `density`, at a time, over all of space.
    pub fn moment(&self, at: StoredTime, name: &str) -> FileResult<Vec<f64>> {
        let first = self.moment_time(at)?.map(|k| k..k + 1);
        let ranges: Vec<_> = first.into_iter().chain(self.space.space_ranges()).collect();
        self.slab(&at.dataset(name), &DatasetBox::of(&ranges))
    }

    /// A scalar moment at a time on a plane of space, through `cells`.
    pub fn moment_plane(
        &self,
        at: StoredTime,
        name: &str,
        plane: [usize; 2],
        cells: &[usize],
    ) -> FileResult<Plane> {
        self.plane(&at.dataset(name), self.moment_time(at)?.as_slice(), plane, cells)
    }

    /// The index of a time in `/axis/time`; `None` for the end.
    fn moment_time(&self, at: StoredTime) -> FileResult<Option<usize>> {
        if at.early.is_none() {
            return Ok(None);
        }
        let found = self.list("axis/time")?.iter().position(|time| *time == at.time);
        let lacking = || format!("/axis/time of result.h5 has no t = {}", short(at.time));
        found.ok_or_else(lacking).map(Some)
    }

    /// A box of a dataset, row-major.
    pub fn slab(&self, name: &str, slab: &DatasetBox) -> FileResult<Vec<f64>> {
        read_slab(&self.dataset(name)?, slab).map_err(|e| format!("/{name} of result.h5: {e}"))
    }

    /// A dataset on the plane of the axes `plane` (the lower first), through the cells `at` of the
    /// other axes; `first` gives its indices before those of the axes. Only that plane is read,
    /// some rows at a time. Averages ignore NaN.
    pub fn plane(
        &self,
        name: &str,
        first: &[usize],
        plane: [usize; 2],
        at: &[usize],
    ) -> FileResult<Plane> {
        let lengths = plane.map(|a| self.axis(a).cells);
        let field = name.rsplit('/').next().unwrap_or(name);
        let averaged = self.has_averaged_moments() && !["phi", "psi"].contains(&field);
        let meshes = plane.map(|a| {
            if averaged {
                FineMesh::of_averages(self.axis(a), FINEST)
            } else {
                FineMesh::new(self.axis(a), FINEST)
            }
        });
        let fine = [meshes[0].len(), meshes[1].len()];
        let shape = fine.map(|n| n.min(FINEST));
        let dataset = self.dataset(name)?;
        if dataset.ndim() != first.len() + at.len() {
            return Err(format!("/{name} of result.h5 has {} dimensions", dataset.ndim()));
        }
        let mut values = Vec::with_capacity(shape[0] * shape[1]);
        // Number of lines of the map that fit into a piece, at least one.
        let (ends, column) = (ends(fine[0], shape[0]), ends(fine[1], shape[1]));
        let parts = fine[0] / meshes[0].elements;
        let together = (PIECE * shape[0] / (lengths[0] * lengths[1]).max(1)).max(1);
        for lines in ends.chunks(together) {
            let (Some(lowest), Some(highest)) = (lines.first(), lines.last()) else { continue };
            // The elements that hold these lines.
            let elements = [lowest[0] / parts, highest[1].div_ceil(parts)];
            let [begin, end] = elements.map(|element| element * meshes[0].nodes());
            let ranges = [(plane[0], begin..end), (plane[1], 0..lengths[1])];
            let read = read_slab(&dataset, &plane_slab(first, at, ranges));
            let read = read.map_err(|e| format!("/{name} of result.h5: {e}"))?;
            let read = values_on_parts(&read, elements[1] - elements[0], &meshes);
            for line in lines {
                for column in &column {
                    let before = elements[0] * parts;
                    let rows = (line[0]..line[1]).map(|i| (i - before) * fine[1]);
                    let cells = rows.flat_map(|row| &read[row + column[0]..row + column[1]]);
                    values.push(average(cells.copied()));
                }
            }
        }
        Ok(Plane { shape, values })
    }
}

/// The box of a dataset with these ranges along two axes, through the cells `at` of the other axes.
/// `first` are the indices before those of the axes.
fn plane_slab(first: &[usize], at: &[usize], ranges: [(usize, Range<usize>); 2]) -> DatasetBox {
    let start: Vec<usize> = first.iter().chain(at).copied().collect();
    let mut slab = DatasetBox { count: vec![1; start.len()], start };
    for (axis, range) in ranges {
        slab.start[first.len() + axis] = range.start;
        slab.count[first.len() + axis] = range.len();
    }
    slab
}

/// The first and the end of the cells of each of `parts` parts of `cells` cells.
fn ends(cells: usize, parts: usize) -> Vec<[usize; 2]> {
    let end = |k: usize| k * cells / parts.max(1);
    (0..parts).map(|k| [end(k), end(k + 1)]).collect()
}

/// The mean of the finite values; NaN if there are none.
fn average(values: impl Iterator<Item = f64>) -> f64 {
    let finite = values.filter(|v| v.is_finite());
    let (sum, count) = finite.fold((0.0, 0usize), |(sum, count), v| (sum + v, count + 1));
    sum / count as f64
}

/// The grid of a case as a result with the grid `found` stores it: a merged axis has one cell.
/// `None` if the grids do not match.
fn as_stored(whole: &PhaseSpace, found: &PhaseSpace) -> Option<PhaseSpace> {
    let axes = |whole: &[Axis], found: &[Axis]| -> Option<Vec<Axis>> {
        let same = |(whole, found): (&Axis, &Axis)| match found.cells {
            cells if cells == whole.cells => Some(whole.clone()),
            1 => Some(whole.merged()),
            _ => None,
        };
        if whole.len() != found.len() {
            return None;
        }
        whole.iter().zip(found).map(same).collect()
    };
    Some(PhaseSpace { x: axes(&whole.x, &found.x)?, v: axes(&whole.v, &found.v)?, ..whole.clone() })
}

/// The grid of a file from the centres of its cells, without the case.
fn grid(file: &File) -> FileResult<PhaseSpace> {
    let axis = |name: &str| -> FileResult<Axis> {
        let dataset =
            file.dataset(&format!("axis/{name}")).map_err(|e| format!("/axis/{name}: {e}"))?;
        if let Some(axis) = by_elements(name, &dataset) {
            return Ok(axis);
        }
        let centres = dataset.read_raw::<f64>().map_err(|e| format!("/axis/{name}: {e}"))?;
        let (Some(first), Some(last)) = (centres.first(), centres.last()) else {
            return Err(format!("/axis/{name}: is empty"));
        };
        let width = match centres.len() {
            // The file does not give the width of a single cell.
            1 => 1.0,
            n => (last - first) / (n - 1) as f64,
        };
        if !centres.is_sorted_by(|a, b| a < b) {
            return Err(format!("/axis/{name}: is not ascending"));
        }
        let ends = [first - 0.5 * width, last + 0.5 * width];
        Ok(Axis::new(ends[0], ends[1], centres.len()))
    };
    let there = |name: &&&str| file.link_exists(&format!("axis/{name}"));
    let n = ["x", "y", "z"].iter().filter(there).count();
    let names = axis_names(n);
    let mut x = names.iter().map(|name| axis(name)).collect::<FileResult<Vec<_>>>()?;
    let v = x.split_off(n);
    if n == 0 {
        return Err("/axis: no axes".to_owned());
    }
    Ok(PhaseSpace { x, v, periodic: [false; MAX_DIMENSION] })
}

/// Whether there is such a dataset. Each group of its path is checked first, as HDF5 reports a
/// missing group as an error.
fn exists(file: &File, name: &str) -> bool {
    let mut path = String::new();
    name.split('/').all(|part| {
        path = format!("{path}/{part}");
        file.link_exists(&path)
    })
}

/// Refuses datasets whose shape does not match the axes.
fn refuse_other_shapes(file: &File, space: &PhaseSpace) -> FileResult<()> {
    let (cells, n) = (space.shape(), space.dimension());
    let after = |first: usize, rest: &[usize]| -> Vec<usize> {
        std::iter::once(first).chain(rest.iter().copied()).collect()
    };
    let of_components = |cells: &[usize]| after(n, cells);
    let times = |name: &str| {
        if exists(file, name) {
            file.dataset(name).map(|axis| axis.size()).map_err(|e| e.to_string())
        } else {
            Ok(0)
        }
    };
    let (moments, fields) = (times("axis/time")?, times("axis/field_time")?);
    let expected: [(&[&str], Vec<usize>); 7] = [
        (&["history/f", "history/phi"], after(fields, &cells)),
        (&["history/psi"], after(fields, &of_components(&cells))),
        (&["history/density", "history/density_exact"], after(moments, &cells[..n])),
        (&["f", "phi", "exact"], cells.clone()),
        (&["psi"], of_components(&cells)),
        (&["density", "potential", "density_exact"], cells[..n].to_vec()),
        (&["momentum", "velocity", "momentum_exact", "velocity_exact"], of_components(&cells[..n])),
    ];
    for (names, expected) in expected {
        for name in names.iter().filter(|name| exists(file, name)) {
            let shape = file.dataset(name).map_err(|e| e.to_string())?.shape();
            if shape != expected {
                return Err(format!("/{name}: its shape is {shape:?}, the axes' {expected:?}"));
            }
        }
    }
    Ok(())
}

/// The axis of elements that the attributes of a dataset describe; `None` for degree 0.
fn by_elements(name: &str, dataset: &Dataset) -> Option<Axis> {
    let number = |key: &str| number_attribute(dataset, key).ok();
    let (degree, elements) = (number("degree")? as usize, number("elements")? as usize);
    let nodes =
        if name.starts_with('v') { Nodes::of_velocity(degree) } else { Nodes::of_space(degree) };
    let sound = (1..=LARGEST_DEGREE).contains(&degree) && elements > 0;
    sound.then_some(())?;
    Some(Axis::new(number("lower")?, number("upper")?, elements).with_nodes(nodes))
}

/// `/timings`; empty if the file has none.
fn timings(file: &File) -> hdf5::Result<BTreeMap<String, f64>> {
    if !file.link_exists("timings") {
        return Ok(BTreeMap::new());
    }
    let timings = file.group("timings")?;
    let names = timings.attr_names()?.into_iter();
    names.map(|name| Ok((name.clone(), number_attribute(&timings, &name)?))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn averages_cover_all_cells() {
        for (cells, parts) in [(7, 7), (7, 3), (1000, 512), (1, 1)] {
            let parts = ends(cells, parts);
            assert_eq!((parts[0][0], parts[parts.len() - 1][1]), (0, cells));
            assert!(parts.windows(2).all(|w| w[0][1] == w[1][0]));
            assert!(parts.iter().all(|p| p[0] < p[1]));
        }
        assert_eq!(average([1.0, f64::NAN, 2.0].into_iter()), 1.5);
        assert!(average([f64::NAN].into_iter()).is_nan());
    }
}
