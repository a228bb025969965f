//! The result from which a run continues (`initial.field`), checked before anything is computed.

use crate::base::error::Result;
use crate::base::version;
use crate::parallel::communicator::Group;
use crate::parallel::files::stored_checksum;
use crate::problem::case::{Case, GridErrorPair, ResultOrigin, StartField};
use crate::problem::grid::{Axis, PhaseSpace, axis_names};
use crate::propagate::exponential_error;
use crate::results::FileResult;
use crate::results::provenance::SAME_PROBLEM;
use crate::results::readback::{
    StoredCase, number_attribute, refuse_other_than_reals, text_attribute,
};
use crate::results::summary;
use crate::results::untrusted::{self, Inspection};
use hdf5::{Dataset, File};
use std::path::Path;

/// Largest relative difference of a number in the file from that of the case.
const SAME: f64 = 1e-12;

/// Checks that the file `start` holds `f` on the grid of `case` at its `time.start`, and returns
/// the origin of the continued run: checksum, time and error of that result. Collective over
/// `world`.
///
/// # Errors
/// [`crate::base::error::Error::Case`], the same on all ranks, that says what is wrong with the
/// file.
pub fn origin(world: &Group, start: &StartField, case: &Case) -> Result<ResultOrigin> {
    // One rank reads the file without MPI.
    world.of_first_rank(|| checked_origin(&start.path, case).map_err(|what| start.wrong(&what)))
}

fn checked_origin(path: &Path, case: &Case) -> FileResult<ResultOrigin> {
    let file = untrusted::open_given(path, Inspection::Field)?;
    let program = text_attribute(&file, "program").unwrap_or_default();
    if !version::is_own(&program) {
        return Err("is no result of phasewarp, which is expected".to_owned());
    }
    let f = file.dataset("f").map_err(|_| {
        if file.link_exists("phi") {
            "holds measure-valued data, /phi and /psi; /f is expected"
        } else {
            "holds no dataset /f"
        }
    })?;
    refuse_other_than_reals("f", &f)?;
    let time = number_attribute(&file, "time").map_err(|_| "says no time")?;
    if !is_same(time, case.start_time, time) {
        return Err(format!("is f at t = {time}, time.start is {}", case.start_time));
    }
    same_grid(&file, &f, &case.space)?;
    let case_of = stored_case(&file);
    let OriginErrors { error, grid_errors } =
        OriginErrors::of(path.parent().unwrap_or(Path::new("")), case_of.as_ref());
    Ok(ResultOrigin {
        checksum: stored_checksum(&f).map_err(|_| "/f carries no checksum")?,
        time,
        error,
        grid_errors,
        positive: case_of.as_ref().is_some_and(|case| case.output.positive),
        is_same_problem: case_of.is_some_and(|before| {
            let has_known_past =
                before.starts_anew() || text_attribute(&file, SAME_PROBLEM).is_ok();
            has_known_past && before.is_same_problem(case)
        }),
    })
}

/// The case of a result, if this program can read it.
fn stored_case(file: &File) -> Option<Case> {
    let stored = StoredCase::read(file).ok()?;
    Case::parse("case", &stored.text().ok()?, &stored.overrides).ok()
}

/// The errors of a result; none if its summary is not as it was written.
#[derive(Debug, Default, PartialEq)]
struct OriginErrors {
    /// Relative l2 distance of `f` to the semi-discrete solution since time 0.
    error: Option<f64>,
    grid_errors: GridErrorPair,
}

impl OriginErrors {
    /// The errors of the result of `case` in a directory.
    fn of(directory: &Path, case: Option<&Case>) -> Self {
        let Ok(summary) = summary::read(directory) else { return Self::default() };
        let accuracy = &summary["accuracy"];
        // Those that are mostly the algorithm's say little about the grid.
        let of_grid = accuracy["includes_algorithm"] != true;
        let [field, density] =
            ["grid", "grid_density"].map(|key| accuracy[key].as_f64().filter(|_| of_grid));
        let grid_errors = GridErrorPair { field, density };
        if summary["continued"].is_object() {
            return Self { error: summary["continued"]["error_total"].as_f64(), grid_errors };
        }
        let reliable = summary["error_estimate_reliable"].as_bool() == Some(true);
        let estimate = summary["error_estimate"].as_f64().filter(|_| reliable);
        // The field before `output.positive` is not stored.
        let exact = || {
            let applications = summary["matvecs"].as_u64()? as usize;
            exponential_error(case.filter(|case| !case.output.positive)?, applications)
        };
        let measured = summary["error_semidiscrete"].as_f64();
        Self { error: measured.or(estimate).or_else(exact), grid_errors }
    }
}

/// Whether `a` and `b` are equal up to round-off of numbers of this size.
fn is_same(a: f64, b: f64, size: f64) -> bool {
    (a - b).abs() <= SAME * size.abs()
}

/// Refuses a grid other than `space`; a merged axis represents all of its cells.
fn same_grid(file: &File, f: &Dataset, space: &PhaseSpace) -> FileResult<()> {
    let whole = space.whole();
    let names = axis_names(whole.dimension());
    let shape = f.shape();
    if shape.len() != names.len() {
        let (found, expected) = (shape.len(), names.len());
        return Err(format!("/f has {found} axes, the case {expected}"));
    }
    for ((name, axis), cells) in names.iter().zip(whole.axes()).zip(shape) {
        let dataset = file.dataset(&format!("axis/{name}"));
        let dataset = dataset.map_err(|_| format!("holds no dataset /axis/{name}"))?;
        same_axis(name, &dataset, cells, axis)?;
    }
    Ok(())
}

fn same_axis(name: &str, dataset: &Dataset, cells: usize, axis: &Axis) -> FileResult<()> {
    let degree = dataset.attr("degree").and_then(|a| a.read_scalar::<u64>()).unwrap_or(0);
    let size = axis.largest_magnitude();
    for (what, expected) in [("lower", axis.lower), ("upper", axis.upper)] {
        let found =
            number_attribute(dataset, what).map_err(|_| format!("/axis/{name} says no {what}"))?;
        if !is_same(found, expected, size) {
            return Err(format!("{what} end of {name}: {found} there, {expected} in the case"));
        }
    }
    if cells == 1 {
        return Ok(());
    }
    let own = axis.nodes.degree;
    let elements = (cells / (own + 1)) as u64;
    for (what, found, expected) in
        [("degree", degree, own as u64), ("cells", elements, axis.elements() as u64)]
    {
        if found != expected {
            return Err(format!("{what} along {name}: {found} there, {expected} in the case"));
        }
    }
    let centres = dataset.read_raw::<f64>().map_err(|e| format!("/axis/{name}: {e}"))?;
    let expected = axis.centres();
    let mut both = centres.iter().zip(&expected);
    match both.find(|(found, expected)| !is_same(**found, **expected, size)) {
        _ if centres.len() != expected.len() => {
            Err(format!("/axis/{name} has {} points, {} expected", centres.len(), expected.len()))
        }
        Some((found, expected)) => {
            Err(format!("/axis/{name} holds {found} where the case has {expected}"))
        }
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::accuracy::Accuracy;
    use crate::results::summary::Summary;

    #[test]
    fn the_errors_of_a_changed_summary_are_not_taken() {
        let directory = tempfile::tempdir().expect("a directory");
        let grid_errors = GridErrorPair { field: Some(0.5), density: Some(0.75) };
        let accuracy = Accuracy::default().with_grid(GridErrorPair::default(), grid_errors);
        let written = Summary { error_semidiscrete: Some(0.25), accuracy, ..Summary::default() };
        written.write(directory.path()).expect("a summary");
        let expected = OriginErrors { error: Some(0.25), grid_errors };
        assert_eq!(OriginErrors::of(directory.path(), None), expected);
        let path = directory.path().join(summary::NAME);
        let text = std::fs::read_to_string(&path).expect("a text");
        let changed = text.replacen("0.25", "0.125", 1);
        assert_ne!(changed, text);
        std::fs::write(&path, changed).expect("written");
        assert_eq!(OriginErrors::of(directory.path(), None), OriginErrors::default());
    }
}
