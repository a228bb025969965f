//! `/history` of `result.h5`: moments at all output times, and fields at those of
//! `output.field_times`.
//!
//! | object | shape | |
//! |---|---|---|
//! | `/axis/time` | (N_t) | the output times, the final one last |
//! | `/history/density` | (N_t, N_x1, …) | as `/density`, at each |
//! | `/history/momentum`, `/history/velocity` | (N_t, n, N_x1, …) | as `/momentum`, `/velocity` |
//! | `/history/density_exact`, …, `velocity_exact` | the same | with `exact.moments = "all"` |
//! | `/history/mass`, `kinetic_energy`, `potential_energy` | (N_t) | sums over all of space |
//! | `/axis/field_time` | (N_f) | `output.field_times` |
//! | `/history/f`; `/history/phi`, `psi` | (N_f, as `/f`, `/phi`); (N_f, n, …) | fields there |

use crate::base::error::Result;
use crate::base::row_major::DatasetBox;
use crate::matrix::observables::Totals;
use crate::problem::case::Case;
use crate::results::dataset::{EarlyResult, Results};
use crate::results::fields::{self, DatasetLayout, Field};
use crate::results::writer::Writer;

/// Name of the axis of output times.
pub const TIME: &str = "time";
/// Name of the axis of output times with fields.
pub const FIELD_TIME: &str = "field_time";

/// The early results whose fields are written.
pub fn with_fields<'a>(results: &'a Results<'_>) -> impl Iterator<Item = &'a EarlyResult> + Clone {
    results.early.iter().filter(|e| !e.fields.is_empty())
}

/// Writes the axes of times, if there are any.
pub fn axes(writer: &Writer<'_>, results: &Results<'_>) -> hdf5::Result<()> {
    if results.early.is_empty() {
        return Ok(());
    }
    let one = results.case.output.storage.chunks.as_ref().map(|_| 1);
    let times = results.early.iter().map(|e| e.time);
    let all: Vec<f64> = times.chain([results.case.end]).collect();
    writer.scale(TIME, &all, one)?;
    let times: Vec<f64> = with_fields(results).map(|e| e.time).collect();
    if !times.is_empty() {
        writer.scale(FIELD_TIME, &times, one)?;
    }
    Ok(())
}

/// Writes the group. Collective.
///
/// # Errors
/// [`crate::base::error::Error::Output`], the same on all ranks.
pub fn write(writer: &Writer<'_>, results: &Results<'_>, layout: &DatasetLayout) -> Result<()> {
    if results.early.is_empty() {
        return Ok(());
    }
    writer.group("history")?;
    moments(writer, results, layout)?;
    totals(writer, results)?;
    fields(writer, results, layout)
}

/// Writes density, momentum and mean velocity, computed and exact, at all times at once, as moments
/// are small.
fn moments(writer: &Writer<'_>, results: &Results<'_>, layout: &DatasetLayout) -> Result<()> {
    let times = fields::moments_by_time(results);
    for (k, field) in times[0].iter().enumerate() {
        let kind = field.kind;
        let values: Vec<f64> =
            (times.iter()).flat_map(|moments| moments[k].components.concat()).collect();
        let slab = DatasetBox::of(&layout.ranges(kind, 0..field.components.len()));
        let axes = with_time(TIME, layout.axes(kind));
        let name = format!("history/{}", kind.name);
        writer.field(&name, &axes, &[(slab.after(0..times.len()), &values)], kind.what)?;
    }
    Ok(())
}

fn with_time(time: &'static str, axes: Vec<&'static str>) -> Vec<&'static str> {
    [time].into_iter().chain(axes).collect()
}

/// Writes mass and energies in all of space.
fn totals(writer: &Writer<'_>, results: &Results<'_>) -> Result<()> {
    let early = results.early.iter().map(|e| e.totals);
    let totals: Vec<Totals> = early.chain([results.totals]).collect();
    let column = |of: fn(&Totals) -> f64| totals.iter().map(of).collect::<Vec<f64>>();
    for (name, values, what) in [
        ("mass", column(|t| t.mass), "integral of f"),
        ("kinetic_energy", column(|t| t.kinetic), "integral of |v|^2 f / 2"),
        ("potential_energy", column(|t| t.potential), "integral of V f"),
    ] {
        writer.replicated(&format!("history/{name}"), TIME, &values, what)?;
    }
    Ok(())
}

/// Writes the fields, one time after the other.
fn fields(writer: &Writer<'_>, results: &Results<'_>, layout: &DatasetLayout) -> Result<()> {
    let times: Vec<Vec<Field<'_>>> = with_fields(results)
        .map(|e| fields::fields(&results.case.data, e.fields.iter().map(Vec::as_slice)))
        .collect();
    let Some(first) = times.first() else { return Ok(()) };
    for (k, field) in first.iter().enumerate() {
        let kind = field.kind;
        let slabs: Vec<(DatasetBox, &[f64])> = (times.iter().enumerate())
            .flat_map(|(time, fields)| {
                let slabs = layout.slabs(&fields[k]).into_iter();
                slabs.map(move |(slab, values)| (slab.after(time..time + 1), values))
            })
            .collect();
        let axes = with_time(FIELD_TIME, layout.axes(kind));
        writer.field(&format!("history/{}", kind.name), &axes, &slabs, kind.what)?;
    }
    Ok(())
}

/// Number of datasets over phase space, and over space, that the history adds to a file.
pub fn datasets(case: &Case) -> [usize; 2] {
    let times = case.shown_times().count();
    if times == 0 {
        return [0, 0];
    }
    let fields = case.shown_times().filter(|t| t.fields).count();
    let kinds = if case.has_exact_history() { 2 } else { 1 };
    let moments = kinds * (1 + 2 * case.space.dimension());
    [fields * case.fields.len(), (times + 1) * moments]
}
