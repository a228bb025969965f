//! `result.h5` through MPI-IO: every rank writes the hyperslab of its own share.
//!
//! | object | shape | |
//! |---|---|---|
//! | `/f` | (N_x1, …, N_xn, N_v1, …, N_vn) | cell values at the final time |
//! | `/density` | (N_x1, …, N_xn) | ρ = ∫ f dv |
//! | `/momentum`, `/velocity` | (n, N_x1, …, N_xn) | ∫ v f dv and its mean; NaN where there is nothing |
//! | `/phi`, `/psi` | as `/f`; (n, …) | instead of `/f` for measure-valued data: `f = φ Π_a δ(ψ_a)` |
//! | `/exact` | as `/f` | the exact solution, where one is named |
//! | `/density_exact`, `/velocity_exact` | as `/density`, `/velocity` | instead of it for measure-valued data: cell averages |
//! | `/multivalued/x`, `v`, `density`, `branch` | points | the branches of the exact velocity, in one dimension |
//! | `/axis/x`, … `/axis/vz` | cell centres | dimension scales; `/axis/component` numbers vector components; also found in the root |
//! | `/case`, `/plan` | text | the case file; the plan as JSON, as far as it does not depend on ranks |
//! | `/plateau/p`, `/plateau/distance`, `/plateau/norm` | (K) | `f` read at other points `p`: relative l2 distance to `/f`, l2 norm |
//! | `/timings` | group | seconds by step, as attributes: datasets are the same bits for any ranks |
//!
//! Metadata are written by all ranks together; after each dataset the ranks agree whether it worked, so that none waits
//! for one that failed.

use super::failure;
use crate::case::{Case, Data, Exact};
use crate::characteristics::sheet::{Curve, ExactMoments, curve_points};
use crate::communicator::Group;
use crate::error::{Error, Result};
use crate::grid::Axis;
use crate::observables::Moments;
use crate::plan::{Plan, bytes_text};
use crate::system;
use hdf5::types::{VarLenArray, VarLenUnicode};
use hdf5::{Dataset, File, H5Type, Hyperslab, Location, ObjectReference1, SliceOrIndex};
use ndarray::{ArrayViewD, IxDyn};
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::ffi::{CStr, CString};
use std::mem::ManuallyDrop;
use std::ops::Range;
use std::path::Path;

/// The exact solution on a rank's share.
pub enum ExactSolution {
    /// `f` at cell centres.
    Field(Vec<f64>),
    /// Density and mean velocity as averages over cells, for measure-valued data.
    Moments(ExactMoments),
}

/// What goes into the file.
pub struct Results<'a> {
    /// The case.
    pub case: &'a Case,
    /// The plan it ran with.
    pub plan: &'a Plan,
    /// This rank's space cells, one range an x-axis; may be empty.
    pub share: &'a [Range<usize>],
    /// The case's fields on them, velocities fastest.
    pub fields: &'a [&'a [f64]],
    /// The exact solution there.
    pub exact: Option<&'a ExactSolution>,
    /// Moments there.
    pub moments: &'a Moments,
    /// The plateau; the same on all ranks.
    pub plateau: &'a [PlateauPoint],
    /// Seconds by step.
    pub seconds: &'a BTreeMap<String, f64>,
    /// Attributes of the file: what produced it.
    pub provenance: &'a [(&'a str, String)],
}

/// The field read at `p` instead of `p◇`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlateauPoint {
    /// `p`.
    pub p: f64,
    /// Relative l2 distance to the field read at `p◇`.
    pub distance: f64,
    /// `(∫ f² dx dv)^½`.
    pub norm: f64,
}

/// Names of the axes in storage order.
pub fn axis_names(dimension: usize) -> Vec<&'static str> {
    let (x, v) = (["x", "y", "z"], ["vx", "vy", "vz"]);
    x[..dimension]
        .iter()
        .chain(&v[..dimension])
        .copied()
        .collect()
}

/// Writes `directory/result.h5`. Collective over `world`.
///
/// # Errors
/// [`crate::error::Error::Output`], the same on all ranks.
pub fn write(world: &Group, directory: &Path, results: &Results<'_>) -> Result<()> {
    let path = directory.join("result.h5");
    world.agree(if world.rank() == 0 {
        enough_room(directory, results.case)
    } else {
        Ok(())
    })?;
    // Files that are given up after an error stay open to the end; the library must not close them then.
    // SAFETY: a plain call before the library is used.
    unsafe { hdf5_sys::h5::H5dont_atexit() };
    // Under another name until it is complete: an older file stays whole, and no half a file is taken for a result.
    let partial = directory.join("result.h5.partial");
    let written = write_all(world, &partial, results);
    let renamed = match written {
        Ok(()) if world.rank() == 0 => {
            std::fs::rename(&partial, &path).map_err(|e| failure(&path, &e))
        }
        Err(_) if world.rank() == 0 => {
            let _ = std::fs::remove_file(&partial);
            written
        }
        _ => written,
    };
    world.agree(renamed)
}

/// Writes the whole file. Collective over `world`.
fn write_all(world: &Group, path: &Path, results: &Results<'_>) -> Result<()> {
    let mut writer = Writer::create(world, path)?;
    writer.attributes(results)?;
    writer.axes(results)?;
    let space = &results.case.space;
    let names = axis_names(space.dimension());
    let (x_names, all) = (&names[..space.dimension()], &names[..]);
    let velocities: Vec<Range<usize>> = space.v.iter().map(|a| 0..a.cells).collect();
    let phase: Vec<Range<usize>> = results.share.iter().cloned().chain(velocities).collect();
    let (first, others) = (results.fields[0], &results.fields[1..]);
    match results.case.data {
        Data::Density => {
            let what = "cell average of the phase-space density";
            writer.field("f", all, &phase, first, what)?;
        }
        Data::Measure { .. } => {
            let what = "density phi of f = phi delta(psi)";
            writer.field("phi", all, &phase, first, what)?;
            let what = "level sets psi of f = phi delta(psi), one a velocity axis";
            writer.vector("psi", all, &phase, others, what)?;
        }
    }
    match results.exact {
        None => {}
        Some(ExactSolution::Field(exact)) => {
            let what = "exact solution at cell centres";
            writer.field("exact", all, &phase, exact, what)?;
        }
        Some(ExactSolution::Moments(exact)) => {
            let (density, velocity) = (&exact.density, slices(&exact.velocity));
            let what = "exact density, average over the cell";
            writer.field("density_exact", x_names, results.share, density, what)?;
            let what = "exact mean velocity of the cell";
            writer.vector("velocity_exact", x_names, results.share, &velocity, what)?;
            if let Some(curve) = &exact.curve {
                writer.curve(curve)?;
            }
        }
    }
    let moments = results.moments;
    writer.field(
        "density",
        x_names,
        results.share,
        &moments.density,
        "integral of f over v",
    )?;
    writer.vector(
        "momentum",
        x_names,
        results.share,
        &slices(&moments.momentum),
        "integral of v f over v",
    )?;
    writer.vector(
        "velocity",
        x_names,
        results.share,
        &slices(&moments.velocity),
        "momentum / density",
    )?;
    writer.plateau(results.plateau)?;
    writer.close()
}

fn slices(vectors: &[Vec<f64>]) -> Vec<&[f64]> {
    vectors.iter().map(Vec::as_slice).collect()
}

/// Refuses to start what the disk cannot hold.
///
/// # Errors
/// [`Error::Directory`].
pub fn enough_room(directory: &Path, case: &Case) -> Result<()> {
    /// Metadata, texts and the summary.
    const MARGIN: usize = 256 << 10;
    let space = &case.space;
    let n = space.dimension();
    let (mut fields, mut moments, mut points) = (case.fields.len(), 1 + 2 * n, 0);
    match (&case.exact, &case.data) {
        (None, _) => {}
        (Some(Exact::Characteristics), Data::Measure { .. }) => {
            moments += 1 + n;
            points = 5 * curve_points(case);
        }
        (Some(_), _) => fields += 1,
    }
    let numbers = fields * space.cells() + moments * space.space_cells() + points;
    let needed = (8 * numbers + MARGIN + 2 * case.text.len()) as u64;
    let room = system::room_for_file(directory);
    if needed <= room {
        return Ok(());
    }
    Err(Error::Directory {
        path: directory.to_owned(),
        reason: format!(
            "the results take {}, there is room for {}",
            bytes_text(needed),
            bytes_text(room)
        ),
    })
}

/// Name of the axis of vector components.
const COMPONENT: &str = "component";
/// Name of the axis of the points of a curve.
const POINT: &str = "point";

struct Writer<'a> {
    world: &'a Group,
    path: &'a Path,
    /// Not closed when an error is on the way: closing waits for all ranks, and one may never come.
    file: ManuallyDrop<File>,
    /// The first failure of what rank 0 writes alone, while the others go on to the next step of all.
    trouble: RefCell<Option<hdf5::Error>>,
    shape: BTreeMap<&'static str, usize>,
}

type Outcome<T> = std::result::Result<T, hdf5::Error>;

fn text(s: &str) -> VarLenUnicode {
    // A text with a zero byte cannot be stored; such bytes are left out.
    s.replace('\0', "").parse().unwrap_or_default()
}

fn attribute<T: H5Type>(at: &Location, name: &str, value: &T) -> Outcome<()> {
    at.new_attr::<T>().create(name)?.write_scalar(value)
}

impl<'a> Writer<'a> {
    fn create(world: &'a Group, path: &'a Path) -> Result<Self> {
        let file = File::with_options()
            .with_fapl(|p| {
                p.mpio(world.raw(), None)
                    .all_coll_metadata_ops(true)
                    .coll_metadata_write(true)
            })
            .create(path)
            .map_err(|e| failure(path, &e));
        let file = world.agree(file)?;
        Ok(Self {
            world,
            path,
            file: ManuallyDrop::new(file),
            trouble: RefCell::new(None),
            shape: BTreeMap::new(),
        })
    }

    /// Agrees on the outcome of operations that all ranks did, and of those rank 0 did alone.
    fn agree<T>(&self, outcome: Outcome<T>) -> Result<T> {
        let outcome = match self.trouble.take() {
            Some(trouble) => Err(trouble),
            None => outcome,
        };
        self.world
            .agree(outcome.map_err(|e| failure(self.path, &e)))
    }

    /// Something that rank 0 writes alone.
    fn alone(&self, write: impl FnOnce() -> Outcome<()>) {
        if self.world.rank() == 0
            && let Err(error) = write()
        {
            self.trouble.borrow_mut().get_or_insert(error);
        }
    }

    fn attributes(&self, results: &Results<'_>) -> Result<()> {
        let outcome = (|| {
            for (name, value) in results.provenance {
                attribute(&self.file, name, &text(value))?;
            }
            attribute(&self.file, "title", &text(&results.case.title))?;
            attribute(&self.file, "reference", &text(&results.case.reference))?;
            attribute(&self.file, "time", &results.case.end)?;
            let case = self.text("case", &results.case.text)?;
            attribute(
                &case,
                "overrides",
                &text(&results.case.overrides.join("\n")),
            )?;
            let plan = self.text("plan", &plan_text(results.plan))?;
            let layout = serde_json::to_string(&results.plan.layout).unwrap_or_default();
            attribute(&plan, "layout", &text(&layout))?;
            let timings = self.file.create_group("timings")?;
            for (name, seconds) in results.seconds {
                attribute(&timings, name, seconds)?;
            }
            Ok(())
        })();
        self.agree(outcome)
    }

    /// A scalar text dataset, of fixed length: parallel HDF5 does not write texts of variable length.
    fn text(&self, name: &str, value: &str) -> Outcome<Dataset> {
        let bytes = value.as_bytes();
        let dataset = self
            .file
            .new_dataset_builder()
            .empty_as(hdf5::types::TypeDescriptor::FixedUnicode(
                bytes.len().max(1),
            ))
            .create(name)?;
        if !bytes.is_empty() {
            self.alone(|| write_bytes(&dataset, bytes));
        }
        Ok(dataset)
    }

    fn axes(&mut self, results: &Results<'_>) -> Result<()> {
        let space = &results.case.space;
        let outcome = (|| {
            // In the root, where netCDF readers look for the scales of its variables, and linked from /axis.
            self.file.create_group("axis")?;
            let names = axis_names(space.dimension());
            let count = |n: usize| (0..n).map(|c| c as f64).collect();
            let mut numbered = vec![(COMPONENT, count(space.dimension()))];
            if let Some(ExactSolution::Moments(exact)) = results.exact
                && let Some(curve) = &exact.curve
            {
                numbered.push((POINT, count(curve.x.len())));
            }
            let axes = names.into_iter().zip(space.axes().map(Axis::centres));
            for (name, centres) in axes.chain(numbered) {
                let dataset = self
                    .file
                    .new_dataset::<f64>()
                    .shape(centres.len())
                    .create(name)?;
                self.alone(|| dataset.write(&centres));
                terminated_text(&dataset, "CLASS", c"DIMENSION_SCALE")?;
                terminated_text(&dataset, "NAME", &CString::new(name).unwrap_or_default())?;
                attribute(&dataset, "units", &text("1"))?;
                self.file
                    .link_hard(&format!("/{name}"), &format!("/axis/{name}"))?;
                self.shape.insert(name, centres.len());
            }
            Ok(())
        })();
        self.agree(outcome)
    }

    fn create_field(&self, name: &str, axes: &[&str], what: &str) -> Outcome<Dataset> {
        let shape: Vec<usize> = axes.iter().map(|a| self.shape[a]).collect();
        let dataset = self.file.new_dataset::<f64>().shape(shape).create(name)?;
        attribute(&dataset, "long_name", &text(what))?;
        attribute(&dataset, "units", &text("1"))?;
        // Dimension scales, as the HDF5 specification lays them down: one list of references a dimension.
        let scale = |axis: &&str| {
            let path = format!("/{axis}");
            let reference = self.file.reference::<ObjectReference1>(&path)?;
            Ok(VarLenArray::from_slice(&[reference]))
        };
        let list = axes.iter().map(scale).collect::<Outcome<Vec<_>>>()?;
        dataset
            .new_attr::<VarLenArray<ObjectReference1>>()
            .shape(list.len())
            .create("DIMENSION_LIST")?
            .write(&list)?;
        Ok(dataset)
    }

    fn field(
        &self,
        name: &str,
        axes: &[&str],
        share: &[Range<usize>],
        values: &[f64],
        what: &str,
    ) -> Result<()> {
        let dataset = ManuallyDrop::new(self.agree(self.create_field(name, axes, what))?);
        self.agree(write_slab(&dataset, None, share, values))?;
        drop(ManuallyDrop::into_inner(dataset));
        Ok(())
    }

    /// A vector of fields: the component is the first index.
    fn vector(
        &self,
        name: &str,
        axes: &[&str],
        share: &[Range<usize>],
        values: &[&[f64]],
        what: &str,
    ) -> Result<()> {
        let axes: Vec<&str> = [COMPONENT].iter().chain(axes).copied().collect();
        let dataset = ManuallyDrop::new(self.agree(self.create_field(name, &axes, what))?);
        let outcome = (values.iter().enumerate()).try_for_each(|(component, values)| {
            write_slab(&dataset, Some(component), share, values)
        });
        self.agree(outcome)?;
        drop(ManuallyDrop::into_inner(dataset));
        Ok(())
    }

    /// The plateau, which is the same on all ranks: rank 0 writes it.
    fn plateau(&self, points: &[PlateauPoint]) -> Result<()> {
        let column = |of: fn(&PlateauPoint) -> f64| points.iter().map(of).collect();
        let columns: [(&str, &str, Vec<f64>); 3] = [
            ("p", "recovery point", column(|point| point.p)),
            (
                "distance",
                "relative l2 distance of f read at p to f",
                column(|point| point.distance),
            ),
            ("norm", "l2 norm of f read at p", column(|point| point.norm)),
        ];
        if points.is_empty() {
            return Ok(());
        }
        let outcome = (|| {
            self.file.create_group("plateau")?;
            for (name, what, values) in &columns {
                let dataset = self
                    .file
                    .new_dataset::<f64>()
                    .shape(values.len())
                    .create(format!("plateau/{name}").as_str())?;
                attribute(&dataset, "long_name", &text(what))?;
                attribute(&dataset, "units", &text("1"))?;
                self.alone(|| dataset.write(values));
            }
            Ok(())
        })();
        self.agree(outcome)
    }

    /// The multivalued velocity, the same on all ranks and written by rank 0.
    fn curve(&self, curve: &Curve) -> Result<()> {
        self.agree(self.file.create_group("multivalued").map(drop))?;
        let count = if self.world.rank() == 0 {
            curve.x.len()
        } else {
            0
        };
        let mine = 0..count;
        let share = std::slice::from_ref(&mine);
        for (name, values, what) in [
            ("x", &curve.x, "position on a branch"),
            ("v", &curve.v, "velocity on a branch"),
            (
                "density",
                &curve.density,
                "the branch's part of the density",
            ),
            ("branch", &curve.branch, "number of the branch"),
        ] {
            let name = format!("multivalued/{name}");
            self.field(&name, &[POINT], share, &values[..count], what)?;
        }
        Ok(())
    }

    fn close(self) -> Result<()> {
        self.agree(self.file.flush())?;
        let closed = ManuallyDrop::into_inner(self.file).close();
        let closed = closed.map_err(|e| failure(self.path, &e));
        self.world.agree(closed)
    }
}

/// The part of the plan that is the same for any ranks.
fn plan_text(plan: &Plan) -> String {
    let mut value = serde_json::to_value(plan).unwrap_or_default();
    if let Some(object) = value.as_object_mut() {
        object.remove("layout");
    }
    serde_json::to_string_pretty(&value).unwrap_or_default()
}

/// An attribute that is a zero-terminated text, the only kind that the dimension-scale interface of HDF5 takes and one
/// that the safe interface does not make.
fn terminated_text(at: &Dataset, name: &str, value: &CStr) -> Outcome<()> {
    use hdf5_sys::{h5a, h5p::H5P_DEFAULT, h5s, h5t};
    let name = CString::new(name).unwrap_or_default();
    // SAFETY: plain calls on handles that are alive; each handle made here is closed here.
    let written = unsafe {
        let kind = h5t::H5Tcopy(*h5t::H5T_C_S1);
        let sized = h5t::H5Tset_size(kind, value.to_bytes_with_nul().len());
        let scalar = h5s::H5Screate(h5s::H5S_class_t::H5S_SCALAR);
        let attribute = h5a::H5Acreate2(
            at.id(),
            name.as_ptr(),
            kind,
            scalar,
            H5P_DEFAULT,
            H5P_DEFAULT,
        );
        let written = h5a::H5Awrite(attribute, kind, value.as_ptr().cast());
        let closed = [
            h5a::H5Aclose(attribute),
            h5s::H5Sclose(scalar),
            h5t::H5Tclose(kind),
        ];
        sized
            .min(written)
            .min(closed.into_iter().min().unwrap_or(0))
    };
    if written < 0 {
        return Err(hdf5::Error::from("an attribute could not be written"));
    }
    Ok(())
}

/// Writes a text whose length is known at run time only, which the safe interface has no type for.
fn write_bytes(dataset: &Dataset, bytes: &[u8]) -> Outcome<()> {
    let kind = dataset.dtype()?;
    // SAFETY: the dataset is scalar and of the type `kind`, a string of `bytes.len()` bytes, and the handles are alive.
    let status = unsafe {
        hdf5_sys::h5d::H5Dwrite(
            dataset.id(),
            kind.id(),
            hdf5_sys::h5s::H5S_ALL,
            hdf5_sys::h5s::H5S_ALL,
            hdf5_sys::h5p::H5P_DEFAULT,
            bytes.as_ptr().cast(),
        )
    };
    if status < 0 {
        return Err(hdf5::Error::from("a text could not be written"));
    }
    Ok(())
}

fn write_slab(
    dataset: &Dataset,
    component: Option<usize>,
    share: &[Range<usize>],
    values: &[f64],
) -> Outcome<()> {
    if values.is_empty() {
        return Ok(());
    }
    let mut selection: Vec<SliceOrIndex> = Vec::new();
    let mut shape = Vec::new();
    if let Some(component) = component {
        selection.push(SliceOrIndex::Index(component));
    }
    for range in share {
        selection.push(SliceOrIndex::SliceTo {
            start: range.start,
            step: 1,
            end: range.end,
            block: 1,
        });
        shape.push(range.len());
    }
    let view = ArrayViewD::from_shape(IxDyn(&shape), values)
        .map_err(|e| hdf5::Error::from(e.to_string()))?;
    dataset.write_slice(view, Hyperslab::from(selection))
}
