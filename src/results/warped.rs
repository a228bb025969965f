//! The whole warped field, `warped_f.h5`, which all ranks write and read, some cells at a time.
//!
//! | object | shape | |
//! |---|---|---|
//! | `/w` | (N_x1, …, N_xn, N_v1, …, N_vn, N_p) | `w(t, x, v, p_j)`, weights undone |
//! | `/axis/x`, … `/axis/vz`, `/axis/p` | | cell centres; `p_j = L + jP/N_p`; dimension scales |
//! | `/case`, `/plan`, `/timings` | | as in `result.h5` |
//!
//! The modes of the field are spread over the ranks: cells over the blocks of space, and modes over
//! the mode groups. In each round the mode groups of a block transpose some of its cells, so that
//! each rank has all modes of a few cells; it transforms them to values and writes these. Reading
//! does the same in reverse. Buffers take [`crate::plan::memory::BUFFERS`] for a field of any size.

pub mod initial_file;
pub mod spread;

use crate::base::disk::{failure, require_room};
use crate::base::error::Result;
use crate::problem::case::{Case, Storage};
use crate::problem::grid::axis_names;
use crate::results::dataset::FileAttributes;
use crate::results::readback;
use crate::results::result_file::{attributes, phase_axes, plan_text, put_in_place};
use crate::results::warped::spread::{POINTS, Spread, with_points};
use crate::results::writer::Writer;
use crate::schrodingerization::profile::series::Series;
use crate::schrodingerization::transform::Transform;
use crate::solve::rank_modes::RankModes;
use std::path::Path;

/// Bytes for metadata and texts of a file, except those of case and plan.
const MARGIN: u64 = 256 << 10;

/// Name of the file of a field at the end, or at the earlier output time of number `early`, counted
/// from 1.
pub fn file_name(field: &str, early: Option<usize>) -> String {
    let number = early.map_or(String::new(), |number| format!("_{number:04}"));
    format!("warped_{field}{number}.h5")
}

/// Names of the files that a run writes.
pub fn names(case: &Case) -> Vec<String> {
    let times = case.output.times.iter().filter(|t| t.fields).count();
    let of =
        |field: &'static str| (1..=times).map(Some).chain([None]).map(move |t| file_name(field, t));
    let fields = case.fields.iter().filter(|_| case.output.warped_field);
    fields.flat_map(|field| of(field.name)).collect()
}

/// Whether a run may have written a file of this name.
fn is_ours(name: &str) -> bool {
    let stem = name.strip_prefix("warped_").and_then(|n| n.strip_suffix(".h5"));
    stem.is_some_and(|stem| {
        let number = |n: &str| n.len() >= 4 && n.bytes().all(|b| b.is_ascii_digit());
        let (field, _) = (stem.rsplit_once('_')).filter(|(_, n)| number(n)).unwrap_or((stem, ""));
        ["f", "phi", "psi_x", "psi_y", "psi_z"].contains(&field)
    })
}

/// Removes warped fields of earlier runs from `directory`: those that this run did not write, for
/// which `is_older` holds, and from which the run did not start. Only one rank calls it.
///
/// # Errors
/// [`crate::base::error::Error::Output`].
pub fn remove_older(directory: &Path, case: &Case, is_older: impl Fn(&Path) -> bool) -> Result<()> {
    let failed = |e: std::io::Error| failure(directory, &e);
    let written = names(case);
    let start = case.warped_start.as_ref();
    let start = start.and_then(|start| std::fs::canonicalize(&start.path).ok());
    for entry in std::fs::read_dir(directory).map_err(failed)? {
        let name = entry.map_err(failed)?.file_name();
        let older =
            name.to_str().is_some_and(|name| is_ours(name) && written.iter().all(|w| w != name));
        let path = directory.join(&name);
        if older
            && !path.is_dir()
            && is_older(&path)
            && (start.is_none() || std::fs::canonicalize(&path).ok() != start)
        {
            std::fs::remove_file(&path).map_err(|e| failure(&path, &e))?;
        }
    }
    Ok(())
}

/// Bytes of a file with `points` points in `p`, without the plan's text.
fn bytes(case: &Case, points: usize) -> u64 {
    let cells = case.space.cells() as u64;
    let axes: usize = case.space.axes().map(|axis| axis.cells).sum();
    8 * (cells * points as u64 + (axes + points) as u64) + MARGIN + 2 * case.text.len() as u64
}

/// Refuses warped fields with `points` points in `p` that the disk cannot hold.
///
/// # Errors
/// [`crate::base::error::Error::Directory`].
pub fn enough_room(directory: &Path, case: &Case, points: usize) -> Result<()> {
    require_room(directory, all_bytes(case, points), |bytes| {
        let files = names(case).len();
        format!("output.warped_field takes {bytes} ({points} points in p, {files} files)")
    })
}

/// Bytes of all warped fields of a run with `points` points in `p`.
pub fn all_bytes(case: &Case, points: usize) -> u64 {
    names(case).len() as u64 * bytes(case, points)
}

/// Writes the file `path`: the field with the modes `kept` and the factors of `series`, on the
/// period that begins at `lower`. Collective over the world.
///
/// # Errors
/// [`crate::base::error::Error::Output`], the same on all ranks.
pub fn write(
    path: &Path,
    about: &FileAttributes<'_>,
    spread: &Spread<'_>,
    series: &Series,
    lower: f64,
    kept: &RankModes,
) -> Result<()> {
    let world = &spread.communicator.world;
    put_in_place(world, path, |partial| {
        let transform = Transform::new(series, lower).with_phases(&spread.phases(kept));
        write_all(partial, about, spread, transform, kept)?;
        readback::check(world, partial)
    })?;
    Ok(())
}

fn write_all(
    path: &Path,
    about: &FileAttributes<'_>,
    spread: &Spread<'_>,
    mut transform: Transform,
    kept: &RankModes,
) -> Result<()> {
    spread.fits(kept, &transform);
    let world = &spread.communicator.world;
    let plan = plan_text(world, about.plan);
    let points = transform.points();
    let most = bytes(about.case, points) + plan.length as u64;
    // No chunks: HDF5 lets one rank write a whole chunk, but ranks have parts of each.
    let storage = Storage { compression: 0, chunks: None, xdmf: false };
    let writer = Writer::create(world, path, most, &storage)?;
    writer.metadata(|| attributes(&writer, world.size(), about, &plan))?;
    writer.metadata(|| {
        phase_axes(&writer, about.case)?;
        let p: Vec<f64> = (0..points).map(|j| transform.point(j)).collect();
        writer.scale(POINTS, &p, None)
    })?;
    let mut names = axis_names(spread.space.dimension());
    names.push(POINTS);
    let mut field = writer.slabs("w", &names, "warped phase-space density")?;
    let mut transpose = spread.transpose(&transform);
    let mut all = spread.modes_of_a_round(&transform);
    let mut values = vec![0.0; spread.cells_at_once(points) * points];
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
