//! The whole warped field: `warped_f.h5`, written and read by all ranks, some cells at a time.
//!
//! | object | shape | |
//! |---|---|---|
//! | `/w` | (N_x1, …, N_xn, N_v1, …, N_vn, N_p) | `w(t, x, v, p_j)`, weights undone |
//! | `/axis/x`, … `/axis/vz`, `/axis/p` | | cell centres; `p_j = L + jP/N_p`; dimension scales |
//! | `/case`, `/plan`, `/timings` | | as in `result.h5` |
//!
//! The modes of the field are spread over the ranks: by cells over space, by number over the mode groups. In each round the mode groups of a
//! block transpose some of its cells, so that each rank has every mode of a few; it transforms them to values and writes those. Reading goes the
//! same way backwards. Buffers are [`crate::plan::memory::BUFFERS`], whatever the field.

use crate::base::checksum::Slab;
use crate::base::disk::failure;
use crate::base::error::{Error, Result};
use crate::base::text::bytes_text;
use crate::base::{checksum, machine};
use crate::parallel::communicator::transpose::Transpose;
use crate::parallel::communicator::{Communicator, Group};
use crate::parallel::partition::Block;
use crate::plan::memory::{cell_bytes, cells_at_once};
use crate::problem::case::{Case, Storage};
use crate::problem::grid::{PhaseSpace, axis_names};
use crate::results::dataset::About;
use crate::results::readback;
use crate::results::readback::read_slab;
use crate::results::result_file::{attributes, phase_axes, plan_text, put_in_place};
use crate::results::writer::{CHECKSUM, Writer};
use crate::schrodingerization::profile::series::Series;
use crate::schrodingerization::transform::Transform;
use crate::solve::kept::KeptModes;
use hdf5::types::TypeDescriptor;
use hdf5::{Dataset, File};
use num_complex::Complex64;
use std::mem::ManuallyDrop;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Name of the axis in `p`.
const POINTS: &str = "p";

/// Metadata and texts of a file, but for the case's and the plan's own.
const MARGIN: u64 = 256 << 10;

/// By how much points of a file's axes may differ from those of the case, as a part of the axis: those of other programs may be in single
/// precision. No more than [`OF_A_STEP`] at any rate.
const SAME: f64 = 1e-6;
/// The same as a part of a step.
const OF_A_STEP: f64 = 0.05;

/// Where the modes of a field are.
pub struct Spread<'a> {
    /// The process mesh.
    pub communicator: &'a Communicator,
    /// The grid.
    pub space: &'a PhaseSpace,
    /// This rank's block.
    pub block: &'a Block,
    /// `modes[g]`: the modes that rank `g` of the mode groups keeps, ascending.
    pub modes: &'a [Vec<usize>],
    /// `π` of the block's cells: kept are the modes of `√π w`.
    pub pi: &'a [f64],
    /// Bytes of a rank's buffers, if those of one cell are not more: [`crate::plan::memory::BUFFERS`].
    pub buffers: u64,
}

impl Spread<'_> {
    /// Cells of a rank in a round.
    fn cells_at_once(&self, points: usize) -> usize {
        let all = self.modes.iter().map(|modes| modes.len() as u64);
        let (count, most) = (all.clone().sum(), all.max().unwrap_or(0));
        let groups = self.modes.len() as u64;
        let bytes = cell_bytes(count, points as u64, most, groups);
        cells_at_once(self.buffers, bytes, self.block.cells() as u64, groups) as usize
    }

    /// Calls `visit` with the cells that each rank of the mode groups has in a round and this rank's slab of them in the grid, round after
    /// round, until all ranks of the world are through; those that are through before have no cells. Collective if `visit` is.
    fn rounds(
        &self,
        most: usize,
        mut visit: impl FnMut(&[Range<usize>], &Slab) -> Result<()>,
    ) -> Result<()> {
        let (rank, ranks) = (
            self.communicator.modes.rank(),
            self.communicator.modes.size(),
        );
        let shape: Vec<usize> = (self.block.ranges.iter().map(Range::len))
            .chain(self.space.v.iter().map(|axis| axis.cells))
            .collect();
        let count = Slab::pieces(&shape, most).count().div_ceil(ranks);
        let rounds = self.communicator.world.max_count(count);
        // Pieces follow each other in the order of the cells.
        let mut pieces = Slab::pieces(&shape, most);
        let mut next = 0;
        for _ in 0..rounds {
            let mut mine = Slab::of(&vec![0..0; shape.len()]);
            let cells: Vec<Range<usize>> = (0..ranks)
                .map(|r| {
                    let first = next;
                    if let Some(piece) = pieces.next() {
                        next += piece.size();
                        if r == rank {
                            mine = piece;
                        }
                    }
                    first..next
                })
                .collect();
            for (start, range) in mine.start.iter_mut().zip(&self.block.ranges) {
                *start += range.start;
            }
            visit(&cells, &mine)?;
        }
        Ok(())
    }

    /// The buffers of this rank: all modes of some cells, and their values.
    fn buffers(&self, transform: &Transform) -> (Transpose<'_>, Vec<Complex64>, Vec<f64>) {
        let most = self.cells_at_once(transform.points());
        (
            Transpose::new(&self.communicator.modes, self.modes.to_vec(), most),
            vec![Complex64::ZERO; most * transform.modes()],
            vec![0.0; most * transform.points()],
        )
    }

    /// The phases of all modes. Collective over the mode groups.
    fn phases(&self, kept: &KeptModes) -> Vec<Complex64> {
        let count: usize = self.modes.iter().map(Vec::len).sum();
        let mut parts = vec![f64::NEG_INFINITY; 2 * count];
        for (&l, progress) in kept.modes().iter().zip(kept.progress()) {
            (parts[2 * l], parts[2 * l + 1]) = (progress.phase.re, progress.phase.im);
        }
        self.communicator.modes.max_into(&mut parts);
        let (pairs, _) = parts.as_chunks();
        pairs
            .iter()
            .map(|&[re, im]| Complex64::new(re, im))
            .collect()
    }

    /// Checks that these are the modes of `kept` and of `transform`.
    fn fits(&self, kept: &KeptModes, transform: &Transform) {
        let mine = &self.modes[self.communicator.modes.rank()];
        assert_eq!(kept.modes(), &mine[..], "the modes of this rank");
        let all: usize = self.modes.iter().map(Vec::len).sum();
        assert_eq!(all, transform.modes(), "the modes of the series");
    }
}

/// A slab of cells with all points.
fn with_points(slab: &Slab, points: usize) -> Slab {
    let mut slab = slab.clone();
    slab.start.push(0);
    slab.count.push(points);
    slab
}

/// Name of the file of a field at the end; at an earlier output time number `early`, from 1 on.
pub fn file_name(field: &str, early: Option<usize>) -> String {
    match early {
        None => format!("warped_{field}.h5"),
        Some(number) => format!("warped_{field}_{number:04}.h5"),
    }
}

/// Names of the files that a run writes.
pub fn names(case: &Case) -> Vec<String> {
    let times = case.times.iter().filter(|t| t.fields).count();
    let of = |field: &'static str| {
        (1..=times)
            .map(Some)
            .chain([None])
            .map(move |t| file_name(field, t))
    };
    let fields = case.fields.iter().filter(|_| case.warped_field);
    fields.flat_map(|field| of(field.name)).collect()
}

/// Whether a run may have written a file of this name.
fn is_ours(name: &str) -> bool {
    let stem = name
        .strip_prefix("warped_")
        .and_then(|n| n.strip_suffix(".h5"));
    stem.is_some_and(|stem| {
        let number = |n: &str| n.len() >= 4 && n.bytes().all(|b| b.is_ascii_digit());
        let (field, _) = (stem.rsplit_once('_'))
            .filter(|(_, n)| number(n))
            .unwrap_or((stem, ""));
        ["f", "phi", "psi_x", "psi_y", "psi_z"].contains(&field)
    })
}

/// Removes from `directory` the files of runs before that this one did not write, but for the one that it started from. By one rank.
///
/// # Errors
/// [`Error::Output`].
pub fn remove_older(directory: &Path, case: &Case) -> Result<()> {
    let failed = |e: std::io::Error| failure(directory, &e);
    let written = names(case);
    let start = case.start.as_ref();
    let start = start.and_then(|start| std::fs::canonicalize(&start.path).ok());
    for entry in std::fs::read_dir(directory).map_err(failed)? {
        let name = entry.map_err(failed)?.file_name();
        let older = name
            .to_str()
            .is_some_and(|name| is_ours(name) && written.iter().all(|w| w != name));
        let path = directory.join(&name);
        if older
            && !path.is_dir()
            && (start.is_none() || std::fs::canonicalize(&path).ok() != start)
        {
            std::fs::remove_file(&path).map_err(|e| failure(&path, &e))?;
        }
    }
    Ok(())
}

/// Bytes of a file of so many points, without the plan's text.
fn bytes(case: &Case, points: usize) -> u64 {
    let cells = case.space.cells() as u64;
    let axes: usize = case.space.axes().map(|axis| axis.cells).sum();
    8 * (cells * points as u64 + (axes + points) as u64) + MARGIN + 2 * case.text.len() as u64
}

/// Refuses to start what the disk cannot hold: the warped fields of a run, if it writes them, on so many points.
///
/// # Errors
/// [`Error::Directory`].
pub fn enough_room(directory: &Path, case: &Case, points: usize) -> Result<()> {
    let needed = all_bytes(case, points);
    let room = machine::room_for_file(directory);
    if needed <= room {
        return Ok(());
    }
    Err(Error::Directory {
        path: directory.to_owned(),
        reason: format!(
            "output.warped_field takes {} ({points} points in p, {} files), there is room for {}",
            bytes_text(needed),
            names(case).len(),
            bytes_text(room)
        ),
    })
}

/// Bytes of all files with `points` points in `p`.
pub fn all_bytes(case: &Case, points: usize) -> u64 {
    names(case).len() as u64 * bytes(case, points)
}

/// Writes `directory/name`: the field whose modes are `kept`, for the factors of `series` on the period that begins at `lower`. Collective over the
/// world.
///
/// # Errors
/// [`Error::Output`], the same on all ranks.
pub fn write(
    directory: &Path,
    name: &str,
    about: &About<'_>,
    spread: &Spread<'_>,
    (series, lower): (&Series, f64),
    kept: &KeptModes,
) -> Result<()> {
    let world = &spread.communicator.world;
    put_in_place(world, &directory.join(name), |partial| {
        let transform = Transform::new(series, lower).with_phases(&spread.phases(kept));
        write_all(partial, about, spread, transform, kept)?;
        readback::check(world, partial)
    })?;
    Ok(())
}

fn write_all(
    path: &Path,
    about: &About<'_>,
    spread: &Spread<'_>,
    mut transform: Transform,
    kept: &KeptModes,
) -> Result<()> {
    spread.fits(kept, &transform);
    let world = &spread.communicator.world;
    let plan = plan_text(about.plan);
    let points = transform.points();
    let most = bytes(about.case, points) + plan.len() as u64;
    // Not in chunks: ranks write what they have at hand, and each chunk is written by one rank at once.
    let storage = Storage {
        compression: 0,
        chunks: None,
        xdmf: false,
    };
    let mut writer = Writer::create(world, path, most, &storage)?;
    writer.agree(attributes(&writer, world.size(), about, &plan))?;
    let axes = phase_axes(&mut writer, about.case).and_then(|()| {
        let p: Vec<f64> = (0..points).map(|j| transform.point(j)).collect();
        writer.scale(POINTS, &p, None)
    });
    writer.agree(axes)?;
    let mut names = axis_names(spread.space.dimension());
    names.push(POINTS);
    let mut field = writer.slabs("w", &names, "warped phase-space density")?;
    let (mut transpose, mut all, mut values) = spread.buffers(&transform);
    let modes = transform.modes();
    spread.rounds(spread.cells_at_once(points), |cells, slab| {
        transpose.to_cells(kept.values(), kept.rows(), cells, &mut all);
        let own = cells[transpose.rank()].clone();
        let values = &mut values[..own.len() * points];
        let lines = all.chunks_exact(modes).zip(values.chunks_exact_mut(points));
        for (cell, (modes, values)) in own.zip(lines) {
            transform.to_values(modes, 1.0 / spread.pi[cell].sqrt(), values);
        }
        field.write(&with_points(slab, points), values)
    })?;
    field.finish()?;
    writer.close()
}

/// A file to start from.
#[derive(Clone, Debug, PartialEq)]
pub struct Given {
    /// Where it is.
    pub path: PathBuf,
    /// `[L, R]`: the first point, and one period further.
    pub interval: [f64; 2],
    /// `N_p`.
    pub points: usize,
}

impl Given {
    /// Looks at the file: whether `/w` is a warped field on the grid of `case`, and on which points. `key` is the file, line and key
    /// that names it. Collective over `world`.
    ///
    /// # Errors
    /// [`Error::Input`], saying what is wrong with it.
    pub fn new(world: &Group, path: &Path, case: &Case, key: &str) -> Result<Self> {
        let wrong = |what: &dyn std::fmt::Display| {
            Error::Input(format!("{key} = \"{}\": {what}", path.display()))
        };
        // One rank looks at it as any program would.
        let found = if world.rank() == 0 {
            look(path, &case.space).map_err(|e| wrong(&e))
        } else {
            Ok(([f64::NEG_INFINITY; 2], 0))
        };
        let (mut interval, points) = world.agree(found)?;
        world.max_into(&mut interval);
        Ok(Self {
            path: path.to_owned(),
            interval,
            points: world.max_count(points),
        })
    }

    /// Reads the field into the modes `kept` for the factors of `series`; gives the checksum of `/w` and the
    /// largest magnitude in it. Collective over the world.
    ///
    /// # Errors
    /// [`Error::Input`] where the file cannot be read, is not as it was written, or holds NaN or infinity.
    pub fn read(
        &self,
        spread: &Spread<'_>,
        series: &Series,
        kept: &mut KeptModes,
    ) -> Result<(u64, f64)> {
        let world = &spread.communicator.world;
        let wrong =
            |what: &dyn std::fmt::Display| Error::Input(format!("{}: {what}", self.path.display()));
        // A file that only some ranks can open stays open to the end; the library must not close it then.
        // SAFETY: a plain call.
        unsafe { hdf5_sys::h5::H5dont_atexit() };
        let opened = File::with_options()
            .with_fapl(|p| p.mpio(world.raw(), None))
            .open(&self.path);
        let file = ManuallyDrop::new(world.agree(opened.map_err(|e| wrong(&e)))?);
        let read = self.read_from(&file, spread, series, kept);
        // All ranks have the same outcome, so that all close it, as must be.
        let closed = ManuallyDrop::into_inner(file).close();
        world.agree(closed.map_err(|e| wrong(&e)))?;
        read
    }

    fn read_from(
        &self,
        file: &File,
        spread: &Spread<'_>,
        series: &Series,
        kept: &mut KeptModes,
    ) -> Result<(u64, f64)> {
        let world = &spread.communicator.world;
        let wrong =
            |what: &dyn std::fmt::Display| Error::Input(format!("{}: {what}", self.path.display()));
        let dataset = world.agree(file.dataset("w").map_err(|e| wrong(&e)))?;
        let shape = dataset.shape();
        let mut transform = Transform::new(series, self.interval[0]);
        spread.fits(kept, &transform);
        assert_eq!(shape.last(), Some(&transform.points()), "the file's points");
        let (mut transpose, mut all, _) = spread.buffers(&transform);
        let (modes, points, rows) = (transform.modes(), transform.points(), kept.rows());
        let (mut sum, mut largest) = (0u64, 0.0f64);
        spread.rounds(spread.cells_at_once(points), |cells, slab| {
            let own = cells[transpose.rank()].clone();
            let slab = with_points(slab, points);
            let values = if own.is_empty() {
                Ok(Vec::new())
            } else {
                read_slab(&dataset, &slab).map_err(|e| wrong(&e))
            };
            let values = world.agree(values.and_then(|values| {
                match values.iter().position(|w| !w.is_finite()) {
                    Some(place) => {
                        let (cell, j) = (place / points, place % points);
                        let at = format!("the {cell}-th cell from {:?} and point {j}", slab.start);
                        Err(wrong(&format!("/w is {} at {at}", values[place])))
                    }
                    None => Ok(values),
                }
            }))?;
            sum = sum.wrapping_add(checksum::of_slab(&shape, &slab, &values));
            largest = values.iter().fold(largest, |most, w| most.max(w.abs()));
            let lines = all.chunks_exact_mut(modes).zip(values.chunks_exact(points));
            for (cell, (modes, values)) in own.zip(lines) {
                transform.to_modes(values, spread.pi[cell].sqrt(), modes);
            }
            transpose.to_modes(&all, cells, kept.values_mut(), rows);
            Ok(())
        })?;
        // Files of other programs carry none.
        let expected = dataset.attr(CHECKSUM).and_then(|a| a.read_scalar::<u64>());
        let sum = world.sum_modulo(sum);
        world.agree(match expected {
            Ok(expected) if expected != sum => {
                Err(wrong(&"/w is not as it was written (its checksum differs)"))
            }
            _ => Ok((sum, world.max(largest))),
        })
    }
}

/// How far a point of an axis of so many steps may be off.
fn allowed(step: f64, count: usize) -> f64 {
    step * (SAME * count as f64).min(OF_A_STEP)
}

/// The largest distance of two numbers, infinite where one is none, and which two they are.
fn furthest(found: &[f64], expected: &[f64]) -> (f64, usize) {
    let off = |(a, b): (&f64, &f64)| match (a - b).abs() {
        off if off.is_nan() => f64::INFINITY,
        off => off,
    };
    let all = found.iter().zip(expected).map(off).zip(0..);
    all.fold((0.0, 0), |a, b| if b.0 > a.0 { b } else { a })
}

/// `[L, R]` and `N_p` of a file that holds a warped field on `space`.
fn look(path: &Path, space: &PhaseSpace) -> std::result::Result<([f64; 2], usize), String> {
    let found = std::fs::metadata(path).map_err(|e| e.to_string())?;
    if !found.is_file() {
        return Err("is no file".to_owned());
    }
    std::fs::File::open(path).map_err(|e| e.to_string())?;
    // HDF5 tells every function that it passed through.
    let file = File::open(path).map_err(|_| "cannot be read as HDF5; is it whole?")?;
    let missing = |name: &str| format!("holds no dataset /{name}");
    let w = file.dataset("w").map_err(|_| missing("w"))?;
    let kind = w.dtype().and_then(|kind| kind.to_descriptor());
    if !matches!(
        kind,
        Ok(TypeDescriptor::Float(_) | TypeDescriptor::Integer(_))
    ) {
        return Err("/w holds other than real numbers, which are expected".to_owned());
    }
    let shape = w.shape();
    let expected = space.shape();
    if shape.len() != expected.len() + 1 || shape[..expected.len()] != expected[..] {
        return Err(format!(
            "/w has the shape {shape:?}; {expected:?} and the points in p are expected"
        ));
    }
    let axis = |name: &str| -> std::result::Result<Vec<f64>, String> {
        let name = format!("axis/{name}");
        let dataset: Dataset = file.dataset(&name).map_err(|_| missing(&name))?;
        dataset.read_raw().map_err(|e| format!("/{name}: {e}"))
    };
    for (name, expected) in axis_names(space.dimension()).iter().zip(space.axes()) {
        let (found, centres) = (axis(name)?, expected.centres());
        let other = || {
            let (lower, upper) = (expected.lower, expected.upper);
            let cells = expected.cells;
            format!(
                "/axis/{name} holds other cell centres than the case's {cells} from {lower} to {upper}"
            )
        };
        if found.len() != centres.len() {
            return Err(format!("{}: {} numbers", other(), found.len()));
        }
        let (off, i) = furthest(&found, &centres);
        let most = allowed(expected.width(), centres.len());
        if off > most {
            return Err(format!(
                "{}: number {i} is off by {off:.1e}, at most {most:.1e} is allowed",
                other()
            ));
        }
    }
    let p = axis(POINTS)?;
    let points = shape[expected.len()];
    if p.len() != points {
        return Err(format!("/axis/p holds {} points, /w {points}", p.len()));
    }
    if points < 2 || !points.is_multiple_of(2) {
        return Err(format!(
            "/w has {points} points in p; an even number expected"
        ));
    }
    let step = (p[points - 1] - p[0]) / (points - 1) as f64;
    let uneven = "/axis/p is not ascending in equal steps";
    if !(step > 0.0 && step.is_finite()) {
        return Err(format!("{uneven}: from {} to {}", p[0], p[points - 1]));
    }
    let even: Vec<f64> = (0..points).map(|j| p[0] + step * j as f64).collect();
    let ((off, j), most) = (furthest(&p, &even), allowed(step, points));
    if off > most {
        return Err(format!(
            "{uneven}: point {j} is off by {off:.1e}, at most {most:.1e} is allowed"
        ));
    }
    Ok(([p[0], p[0] + step * points as f64], points))
}
