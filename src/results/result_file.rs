//! `result.h5` through MPI-IO: every rank writes the hyperslab of its own share.
//!
//! | object | shape | |
//! |---|---|---|
//! | `/f` | (N_x1, …, N_xn, N_v1, …, N_vn) | cell values at the final time |
//! | `/density` | (N_x1, …, N_xn) | ρ = ∫ f dv |
//! | `/momentum`, `/velocity` | (n, N_x1, …, N_xn) | ∫ v f dv and its mean; NaN in vacuum |
//! | `/phi`, `/psi` | as `/f`; (n, …) | measure-valued, instead of `/f`: `f = φ Π_a δ(ψ_a)` |
//! | `/potential` | (N_x1, …, N_xn) | `V` at the nodes; not finite where its formula is not |
//! | `/exact` | as `/f` | the exact solution, where one is named |
//! | `/density_exact`, `momentum_exact`, `velocity_exact` | as these | of the exact solution |
//! | `/multivalued/x`, `v`, `density`, `branch` | points | branches of the exact velocity (1D) |
//! | `/axis/x`, … `/axis/vz`, `component` | cell centres | dimension scales; also in the root |
//! | `/axis/weights_x`, … | as `/axis/x` | of a degree above 0: quadrature weights of the nodes |
//! | `/averages/f`, `/averages/density` | elements | the same: [`crate::results::averages`] |
//! | `/case`, `/plan` | text | case file; plan as JSON, without what depends on ranks |
//! | `/plateau/p`, `distance`, `norm` | (K) | `f` read at other `p`: l2 distance to `/f`, norm |
//! | `/readout/…` | (R) | measurements by row and estimator, see [`crate::quantum::readout`] |
//! | `/timings` | group | seconds by step, as attributes: datasets are the same on any ranks |
//! | `/history/…` | a time first | moments and fields earlier, see [`crate::results::history`] |
//! | `/xdmf/…` | axes reversed | what is shown of the grids, see [`crate::results::views`] |
//!
//! Every dataset has its [`crate::base::checksum`] as an attribute. The file is read back before it
//! gets its final name.

use crate::base::disk::{self, failure, require_room};
use crate::base::error::Result;
use crate::parallel::communicator::Group;
use crate::plan::Plan;
use crate::problem::case::{Case, Data};
use crate::problem::exact::sheet::curve_points;
use crate::problem::exact::sheet::sums::MultivaluedVelocity;
use crate::problem::grid::axis_names;
use crate::problem::limits::CHUNK;
use crate::quantum::readout::Readout;
use crate::quantum::readout::files::{ReadoutColumn, numbers as readout_numbers};
use crate::results::dataset::{FileAttributes, PlateauPoint, RESULT, Results};
use crate::results::fields::{self, COMPONENT, DIRECTION, DatasetLayout, POINT};
use crate::results::views::{self, GridsAtTime};
use crate::results::writer::{StoredText, Writer, attribute, text};
use crate::results::{averages, grids, history, readback};
use std::path::Path;

/// Writes `directory/result.h5`; returns the grids for the XDMF files, time by time. Collective
/// over `world`.
///
/// # Errors
/// [`crate::base::error::Error::Output`], the same on all ranks.
pub fn write(world: &Group, directory: &Path, results: &Results<'_>) -> Result<Vec<GridsAtTime>> {
    let path = directory.join(RESULT);
    world.on_first_rank(|| enough_room(directory, results.case))?;
    put_in_place(world, &path, |partial| {
        let steps = write_all(world, partial, results)?;
        readback::check(world, partial)?;
        Ok(steps)
    })
}

/// Lets `write` make the file `path`, under another name until it is complete. So an older file
/// stays intact, and an incomplete file is never taken for a result. Collective over `world`.
///
/// # Errors
/// As `write`; [`crate::base::error::Error::Output`] if the file cannot be renamed.
pub fn put_in_place<T>(
    world: &Group,
    path: &Path,
    write: impl FnOnce(&Path) -> Result<T>,
) -> Result<T> {
    let partial = disk::partial(path);
    // HDF5 would follow a link in its place.
    world.on_first_rank(|| disk::clear(&partial).map_err(|e| failure(&partial, &e)))?;
    let written = write(&partial);
    let renamed = match written {
        Ok(found) if world.is_first() => {
            std::fs::rename(&partial, path).map(|()| found).map_err(|e| failure(path, &e))
        }
        Err(_) if world.is_first() => {
            let _ = std::fs::remove_file(&partial);
            written
        }
        _ => written,
    };
    world.agree(renamed)
}

/// Writes the whole file. Collective over `world`.
fn write_all(world: &Group, path: &Path, results: &Results<'_>) -> Result<Vec<GridsAtTime>> {
    let plan = plan_text(world, results.plan);
    let most = most_bytes(results.case) + plan.length as u64;
    let writer = Writer::create(world, path, most, &results.case.output.storage)?;
    writer.metadata(|| attributes(&writer, world.size(), &results.about(), &plan))?;
    writer.metadata(|| axes(&writer, results))?;
    let layout = DatasetLayout::new(&results.case.space, results.share);
    for field in fields::at_the_end(results) {
        let (kind, slabs) = (field.kind, layout.slabs(&field));
        writer.field(kind.name, &layout.axes(kind), &slabs, kind.what)?;
    }
    averages::write(&writer, results)?;
    if let Some(curve) = results.curve() {
        multivalued(&writer, curve)?;
    }
    history::write(&writer, results, &layout)?;
    writer.metadata(|| plateau(&writer, results.plateau))?;
    if let Some(readout) = results.readout {
        writer.metadata(|| write_readout(&writer, readout))?;
    }
    let steps =
        if results.case.output.storage.xdmf { views::write(&writer, results)? } else { Vec::new() };
    writer.close()?;
    Ok(steps)
}

/// Refuses results that the disk cannot hold.
///
/// # Errors
/// [`crate::base::error::Error::Directory`].
pub fn enough_room(directory: &Path, case: &Case) -> Result<()> {
    let bytes = most_bytes(case).saturating_add(grids::most_bytes(case) as u64);
    require_room(directory, bytes, |bytes| format!("the results take {bytes}"))
}

/// Upper bound on the bytes of `result.h5`, if the curve of a multivalued velocity has no more
/// points than are estimated ([`curve_points`]).
pub fn most_bytes(case: &Case) -> u64 {
    /// Metadata, texts and the summary.
    const MARGIN: usize = 256 << 10;
    /// Bytes of the index entry of a chunk, if nodes of the index are half full.
    const CHUNK_ENTRY: usize = 160;
    let (space, storage) = (&case.space, &case.output.storage);
    let n = space.dimension();
    // Number of datasets over phase space and over space, and points of the curve.
    let (mut fields, mut moments, mut points) = (case.fields.len(), 2 + 2 * n, 0);
    let exact = usize::from(case.exact.is_some());
    moments += exact * (1 + 2 * n);
    match &case.data {
        Data::Measure { .. } => points = exact * 5 * curve_points(case),
        Data::Density => fields += exact,
    }
    let [early_fields, mut early_moments] = history::datasets(case);
    let planes = if storage.xdmf { fields + early_fields } else { 0 };
    if storage.xdmf && n > 1 {
        moments += 8 + 7 * exact;
        let kinds = if case.has_exact_history() { 2 } else { 1 };
        early_moments += 7 * kinds * (1 + case.shown_times().count());
    }
    let all = |sizes: &[usize]| {
        let planes = planes * (0..n).map(|a| sizes[a] * sizes[n + a]).sum::<usize>();
        (fields + early_fields) * sizes.iter().product::<usize>()
            + planes
            + (moments + early_moments) * sizes[..n].iter().product::<usize>()
    };
    let cells = space.shape();
    let (mut numbers, mut chunks) = (all(&cells), 0);
    let elements = averages::numbers(space);
    if let Some(given) = &storage.chunks {
        let each = || cells.iter().zip(given);
        chunks = all(&each().map(|(n, c)| n.div_ceil(*c)).collect::<Vec<_>>());
        if storage.compression == 0 {
            // Chunks that go beyond the upper ends of axes are stored whole. If compressed, the
            // part beyond takes hardly any room.
            numbers = all(&each().map(|(&n, &c)| n.next_multiple_of(c.min(n))).collect::<Vec<_>>());
        }
    } else if storage.compression > 0 {
        // As in `Storage::most_chunks`.
        chunks = 4 * numbers / CHUNK;
    }
    (8 * (numbers
        + elements
        + points
        + 5 * (1 + case.shown_times().count())
        + readout_numbers(case))
        + CHUNK_ENTRY * chunks
        + MARGIN
        + 2 * case.text.len()) as u64
}

/// Writes attributes of the file, `/case`, `/plan` and `/timings`.
pub(crate) fn attributes(
    writer: &Writer<'_>,
    ranks: usize,
    about: &FileAttributes<'_>,
    plan: &StoredText,
) -> hdf5::Result<()> {
    let (file, case) = (writer.file(), about.case);
    for (name, value) in about.provenance {
        attribute(file, name, &text(value))?;
    }
    attribute(file, "ranks", &(ranks as u64))?;
    attribute(file, "title", &text(&case.title))?;
    attribute(file, "reference", &text(&case.reference))?;
    attribute(file, "time", &about.time)?;
    let reductions = case.reductions.dropped.join("\n");
    attribute(file, "reductions", &text(&reductions))?;
    let dataset = writer.text("case", &StoredText::of_all_ranks(case.text.clone()))?;
    attribute(&dataset, "overrides", &text(&case.overrides.join("\n")))?;
    let dataset = writer.text("plan", plan)?;
    let layout = serde_json::to_string(&about.plan.layout).unwrap_or_default();
    attribute(&dataset, "layout", &text(&layout))?;
    let timings = file.create_group("timings")?;
    for (name, seconds) in about.seconds {
        attribute(&timings, name, seconds)?;
    }
    Ok(())
}

/// Writes the dimension scales of phase space.
pub(crate) fn phase_axes(writer: &Writer<'_>, case: &Case) -> hdf5::Result<()> {
    let chunks = &case.output.storage.chunks;
    writer.file().create_group("axis")?;
    let chunk = |axis: usize| chunks.as_ref().map(|chunks| chunks[axis]);
    let names = axis_names(case.space.dimension());
    for (axis, (name, a)) in names.into_iter().zip(case.space.axes()).enumerate() {
        let dataset = writer.scale(name, &a.centres(), chunk(axis))?;
        attribute(&dataset, "lower", &a.lower)?;
        attribute(&dataset, "upper", &a.upper)?;
        if a.nodes.degree > 0 {
            attribute(&dataset, "degree", &(a.nodes.degree as u64))?;
            attribute(&dataset, "elements", &(a.elements() as u64))?;
            let what = format!("quadrature weights of the nodes of {name}");
            writer.list(&format!("axis/weights_{name}"), &a.weights(), Some(&what))?;
        }
    }
    Ok(())
}

/// Writes all dimension scales.
fn axes(writer: &Writer<'_>, results: &Results<'_>) -> hdf5::Result<()> {
    phase_axes(writer, results.case)?;
    averages::axes(writer, results.case)?;
    let n = results.case.space.dimension();
    let numbers = |count: usize| -> Vec<f64> { (0..count).map(|c| c as f64).collect() };
    writer.scale(COMPONENT, &numbers(n), None)?;
    if results.case.output.storage.xdmf && n > 1 {
        writer.scale(DIRECTION, &numbers(3), None)?;
    }
    if let Some(curve) = results.curve() {
        writer.scale(POINT, &numbers(curve.x.len()), None)?;
    }
    history::axes(writer, results)
}

/// Writes the plateau, which is the same on all ranks.
fn plateau(writer: &Writer<'_>, points: &[PlateauPoint]) -> hdf5::Result<()> {
    if points.is_empty() {
        return Ok(());
    }
    writer.file().create_group("plateau")?;
    let column = |of: fn(&PlateauPoint) -> f64| points.iter().map(of).collect::<Vec<f64>>();
    for (name, values, what) in [
        ("p", column(|k| k.p), "recovery point"),
        ("distance", column(|k| k.distance), "relative l2 distance of f read at p to f"),
        ("norm", column(|k| k.norm), "l2 norm of f read at p"),
    ] {
        writer.list(&format!("plateau/{name}"), &values, Some(what))?;
    }
    Ok(())
}

/// Writes the emulated readout of a quantum computer, which is the same on all ranks.
fn write_readout(writer: &Writer<'_>, readout: &Readout) -> hdf5::Result<()> {
    let group = writer.file().create_group("readout")?;
    attribute(&group, "confidence", &readout.confidence)?;
    let single = [
        ("norm_of_field", &readout.norm_of_field),
        ("probability", &readout.probability),
        ("repetitions", &readout.repetitions),
        ("amplification_rounds", &readout.amplification_rounds),
        ("state_error", &readout.state_error),
    ];
    for (name, figure) in single {
        attribute(&group, name, &figure.or_nan())?;
    }
    for ReadoutColumn { name, description, values } in readout.columns() {
        writer.list(&format!("readout/{name}"), &values, Some(description))?;
    }
    Ok(())
}

/// Writes the multivalued velocity, which is the same on all ranks. Collective.
fn multivalued(writer: &Writer<'_>, curve: &MultivaluedVelocity) -> Result<()> {
    writer.group("multivalued")?;
    for (name, values, what) in [
        ("x", &curve.x, "position on a branch"),
        ("v", &curve.v, "velocity on a branch"),
        ("density", &curve.density, "the branch's part of the density"),
        ("branch", &curve.branch, "number of the branch"),
    ] {
        writer.replicated(&format!("multivalued/{name}"), POINT, values, what)?;
    }
    Ok(())
}

/// The part of the plan that does not depend on ranks, as JSON. Collective over `world`.
pub(crate) fn plan_text(world: &Group, plan: &Plan) -> StoredText {
    StoredText::of_first_rank(world, || serde_json::to_string(plan).unwrap_or_default())
}
